"""Figures: what is drawn, where, in which units, and the files."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from glint_aoa.benchmark import BenchmarkPoint, PointError
from glint_aoa.errors import OutputError
from glint_aoa.report.figures import error_figure, field_with_line, save_figure


def error(plane, moment, video, inertial, corrected):
    point = BenchmarkPoint(
        run="1",
        point="2",
        excitation=f"{plane} sine",
        kind="sine",
        plane=plane,
        moment_in_lb_pp=moment,
        optical_deg=0.0,
        optical_std_deg=0.001,
        intercept_mm=0.0,
        intercept_std_mm=0.01,
        inertial_deg=0.0,
    )
    return PointError(point, video, inertial, corrected)


def drawn(axes, label):
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return line


class TestErrorFigure:
    def test_panels_points_and_units(self):
        figure = error_figure(
            [
                error("yaw", 1000.0, 0.001, -0.05, 0.002),
                error("yaw", 4000.0, -0.001, -0.2, None),
                error("yaw", None, 0.5, 0.5, 0.5),
                error("pitch", 3000.0, 0.003, -0.1, -0.006),
            ]
        )
        yaw, pitch = figure.axes
        assert yaw.get_ylabel() == "error of the mean angle [deg]"
        assert yaw.get_xlabel() == "peak-to-peak yaw moment [in lbf]"
        assert pitch.get_xlabel() == "peak-to-peak pitch moment [in lbf]"
        assert drawn(yaw, "video").get_xydata().tolist() == [[1000, 0.001], [4000, -0.001]]
        assert drawn(yaw, "inertial, raw").get_ydata().tolist() == [-0.05, -0.2]
        assert drawn(yaw, "inertial, corrected").get_xdata().tolist() == [1000]
        assert drawn(pitch, "video").get_xydata().tolist() == [[3000, 0.003]]
        assert len(yaw.get_legend().get_texts()) == 3

    def test_nothing_to_draw(self, tmp_path):
        save_figure(error_figure([]), tmp_path / "empty.png")


class TestField:
    field = np.zeros((20, 100), np.uint8)
    line_v = 108 + 0.01 * np.arange(100)
    centre_u = np.array([10.0, 30.0, 50.0, 70.0])
    centre_v = np.array([108.12, 108.28, np.nan, 109.7])

    def draw(self, **options):
        return field_with_line(
            self.field,
            self.line_v,
            centre_u=self.centre_u,
            centre_v=self.centre_v,
            first_line=98,
            **options,
        )

    def test_the_field_lies_where_its_lines_and_columns_are(self):
        whole, cut, residuals = self.draw(title="field 0").axes
        assert whole.get_images()[0].get_extent() == [-0.5, 99.5, 117.5, 97.5]
        assert whole.get_ylim() == (117.5, 97.5)
        assert whole.get_xlabel() == "column u [pixels]"
        assert whole.get_ylabel() == "line v [field lines]"
        low, high = cut.get_xlim()
        assert low < 30 < high
        assert residuals.get_ylabel() == "centre - line [field lines]"

    def test_centres_and_what_was_left_out(self):
        used = np.array([True, True, True, False])
        whole, _, residuals = self.draw(used=used).axes
        assert drawn(whole, "centres").get_xdata().tolist() == [10, 30]
        assert drawn(whole, "left out").get_xdata().tolist() == [70]
        assert drawn(whole, "fitted line").get_ydata() == pytest.approx(self.line_v)
        shown = residuals.get_lines()[1].get_ydata()
        assert shown == pytest.approx([0.02, -0.02])
        assert residuals.get_title() == "residuals, rms 0.0200 lines, 1 left out"

    def test_without_centres(self, tmp_path):
        figure = field_with_line(
            self.field,
            np.full(100, np.nan),
            centre_u=self.centre_u,
            centre_v=np.full(4, np.nan),
        )
        assert figure.axes[2].get_title() == "residuals, no centres"
        save_figure(figure, tmp_path / "field.png")

    def test_shapes_that_do_not_fit(self):
        with pytest.raises(ValueError, match=re.escape("line_v has shape (99,) for 100 columns")):
            field_with_line(
                self.field, self.line_v[1:], centre_u=self.centre_u, centre_v=self.centre_v
            )


class TestSave:
    @pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.pdf", b"%PDF")])
    def test_written_whole(self, tmp_path, name, start):
        save_figure(Figure(), tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(start)
        assert [each.name for each in tmp_path.iterdir()] == [name]

    def test_not_overwritten_unasked(self, tmp_path):
        path = tmp_path / "a.png"
        path.write_bytes(b"mine")
        message = f"{path}: exists already; choose another name or allow overwriting"
        with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
            save_figure(Figure(), path)
        assert path.read_bytes() == b"mine"
        save_figure(Figure(), path, overwrite=True)
        assert path.read_bytes() != b"mine"

    def test_a_suffix_that_is_no_picture(self, tmp_path):
        path = tmp_path / "a.xyz"
        message = f"{path}: not a kind of picture; end its name with .png, .pdf, .svg"
        with pytest.raises(OutputError, match=f"^{re.escape(message)}$"):
            save_figure(Figure(), path)

    def test_a_folder_that_is_not_there(self, tmp_path):
        with pytest.raises(OutputError, match="cannot be written"):
            save_figure(Figure(), tmp_path / "none" / "a.png")
