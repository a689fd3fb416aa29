"""The figure of a camera calibration."""

import dataclasses

import numpy as np
import pytest
from board_pictures import Lens, views
from matplotlib.quiver import Quiver

from calibration.camera.boards import Board, BoardImage
from calibration.camera.calibrate import CameraCalibration, calibrate_camera
from glint_aoa.report.camera_figures import camera_figure
from glint_aoa.report.figures import save_figure

LENS = Lens(0.008, (1e-5, 1e-5), (640, 480), (322.0, 236.0), (-0.2, 0, 0, 0, 0))
BOARD = Board("chessboard", 7, 5, 0.03)
REASON = "no chessboard is seen; show it whole with a white margin of a square around it"


@pytest.fixture(scope="module")
def calibration():
    seen = views(LENS, BOARD.places, np.random.default_rng(1), 7)
    images = [BoardImage(f"{k}.png", f"{k}", np.arange(35), uv) for k, (uv, _) in enumerate(seen)]
    images.append(BoardImage("none.png", "none", np.empty(0, int), np.empty((0, 2)), note=REASON))
    return calibrate_camera(
        images,
        BOARD,
        sensor=LENS.sensor,
        pixel_pitch=LENS.pitch,
        distortion=1,
        board_std=0.0,
        draws=0,
    )


def arrows(axes):
    return [each for each in axes.collections if isinstance(each, Quiver)]


def axes_of(figure):
    everything, radial, *panels = [axes for part in figure.subfigs for axes in part.axes]
    return everything, radial, panels


def test_residuals_are_drawn_where_they_are_and_enlarged(calibration):
    everything, radial, panels = axes_of(camera_figure(calibration))
    (drawn,) = arrows(everything)
    uv = np.concatenate([image.uv for image in calibration.images])
    residuals = np.concatenate([image.residuals for image in calibration.images])
    np.testing.assert_array_equal(np.column_stack([drawn.X, drawn.Y]), uv)
    np.testing.assert_array_equal(np.column_stack([drawn.U, drawn.V]), residuals)
    enlarged = 1 / drawn.scale
    assert f"residuals of 245 corners, {enlarged:.0f} times enlarged" in everything.get_title()
    assert 10 < enlarged * calibration.rms_pixels < 20  # of 640 columns
    assert everything.get_ylim() == (479.5, -0.5)  # v points down
    assert everything.get_xlabel() == "column u [pixels]"
    assert radial.get_ylabel() == "radial residual [columns]"
    assert len(panels) == 10


def test_each_picture_has_its_panel_with_rms_or_reason(calibration):
    _, _, panels = axes_of(camera_figure(calibration))
    first, last = panels[0], panels[7]
    assert first.get_title() == f"0.png: {calibration.images[0].rms:.3f}"
    assert len(arrows(first)[0].X) == 35
    assert last.get_title() == "none.png: left out"
    assert not arrows(last)
    assert " ".join(last.texts[0].get_text().split()) == REASON
    assert not panels[8].axison


def test_of_many_pictures_the_worst_are_drawn(calibration):
    many = [
        dataclasses.replace(calibration.images[k % 7], name=f"{k:02d}", rms=0.01 * (k + 1))
        for k in range(40)
    ]
    many[3] = dataclasses.replace(calibration.images[7], name="03")
    _, _, panels = axes_of(camera_figure(dataclasses.replace(calibration, images=tuple(many))))
    names = [panel.get_title().split(":")[0] for panel in panels]
    assert names == ["03", *(f"{k:02d}" for k in range(11, 40))]


def test_a_calibration_from_its_file_has_nothing_to_draw_but_its_numbers(calibration, tmp_path):
    calibration.save(tmp_path / "camera.toml")
    figure = camera_figure(CameraCalibration.load(tmp_path / "camera.toml"))
    everything, _, _ = axes_of(figure)
    assert not arrows(everything)
    assert figure.get_suptitle().startswith("Camera calibration, 7 of 8 pictures, rms 0.0")
    save_figure(figure, tmp_path / "camera.png")
    assert (tmp_path / "camera.png").stat().st_size > 10_000
