"""A sweep is refused, or doubted, with a setup that it was not measured with."""

import re

import pytest

from calibration.sweep.fit import PitchSweep, SweepSetup, fit_sweep_points, sweep_points
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Setup

ANGLES = [-4.0, -2.0, 0.0, 2.0, 4.0]
CAMERA = {
    "focal_length": "35 mm",
    "pixel_pitch": ["11.7 um", "27.5 um"],
    "sensor": [752, 240],
    "position": ["0 m", "-56 in", "60 mm"],
}
REFLECTION = {"radius": "60 mm", "lamp": ["0 m", "-0.6 m", "1.5 m"]}


def setup_of(camera=None, **glint):
    return Setup.model_validate({"camera": {**CAMERA, **(camera or {})}, "glint": glint})


def sweep_of(setup, columns=(10.0, 750.0)):
    points = sweep_points(ANGLES, 1e-3, ANGLES, 1e-3)
    return fit_sweep_points(points, setup=SweepSetup.of(setup, columns=columns))


@pytest.mark.parametrize(
    ("made_with", "used_with", "said"),
    [
        (
            setup_of(),
            setup_of({"position": ["0 m", "-1.43 m", "60 mm"]}),
            "camera.position is [0, -1.43, 0.06] m here and was [0, -1.4224, 0.06] m in the sweep",
        ),
        (
            setup_of({"rotation": ["0 deg", "1 deg", "0 deg"]}),
            setup_of(),
            "camera.rotation is [0, 0, 0] rad here and was [0, 0.01745329, 0] rad in the sweep",
        ),
        (
            setup_of(),
            setup_of({"distortion": [-0.1, 0, 0, 0, 0]}),
            "camera.distortion is [-0.1, 0, 0, 0, 0] here and was [0, 0, 0, 0, 0] in the sweep",
        ),
        (
            setup_of(),
            setup_of({"principal_point": [370.0, 119.5]}),
            "camera.principal_point is [370, 119.5] here and was [375.5, 119.5] in the sweep",
        ),
        (
            setup_of(),
            setup_of(y="-49 mm"),
            "glint.y is -0.049 m here and was 0 m in the sweep",
        ),
        (
            setup_of(),
            setup_of(nose="right"),
            'glint.nose is "right" here and was "left" in the sweep',
        ),
        (
            setup_of(),
            setup_of(reflection=REFLECTION),
            "it is used with [glint.reflection] and was measured without it",
        ),
        (
            setup_of(reflection=REFLECTION),
            setup_of(),
            "it is used without [glint.reflection] and was measured with it",
        ),
        (
            setup_of(reflection=REFLECTION),
            setup_of(reflection={**REFLECTION, "lamp": ["0 m", "-0.7 m", "1.5 m"]}),
            "glint.reflection.lamp is [0, -0.7, 1.5] m here and was [0, -0.6, 1.5] m in the sweep",
        ),
        (
            setup_of(),
            Setup(),
            "camera.focal_length is not given here and was 0.035 m in the sweep; "
            "camera.pixel_pitch is not given here and was [1.17e-05, 2.75e-05] m in the sweep; "
            "camera.principal_point is not given here and was [375.5, 119.5] in the sweep; "
            "camera.position is not given here and was [0, -1.4224, 0.06] m in the sweep",
        ),
    ],
)
def test_another_geometry_is_refused_with_what_differs(made_with, used_with, said):
    message = (
        f"sweep.toml was measured with another setup ({said}); repeat glint-aoa calibrate sweep "
        "with this one, or go back to the other"
    )
    with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
        sweep_of(made_with).check_setup(used_with, source="sweep.toml")


@pytest.mark.parametrize(
    ("used_with", "columns", "said"),
    [
        (
            setup_of(estimator="gaussian"),
            None,
            'glint.estimator is "gaussian" here and was "auto" in the sweep',
        ),
        (
            setup_of(yaw="5 deg"),
            None,
            "glint.yaw is 0.08726646 rad here and was 0 rad in the sweep",
        ),
        (
            setup_of(polarity="dark"),
            None,
            'glint.polarity is "dark" here and was "bright" in the sweep',
        ),
        (setup_of(), (200.0, 600.0), "columns 200 to 600 were measured, 10 to 750 in the sweep"),
    ],
)
def test_what_may_change_the_angle_a_little_is_a_doubt(used_with, columns, said):
    sweep = sweep_of(setup_of())
    sweep.check_setup(used_with)
    assert sweep.setup_doubts(used_with, columns=columns) == (said,)


def test_what_says_the_same_in_other_words_is_no_difference():
    sweep = sweep_of(setup_of())
    same = setup_of(
        {
            "focal_length": "0.035 m",
            "position": ["0 in", "-1422.4 mm", "0.06 m"],
            "principal_point": [375.5, 119.5],
        },
        column_step=1,
        search_window=[5, 60],
        mean="plain",
    )
    sweep.check_setup(same)
    assert sweep.setup_doubts(same, columns=(0.0, 751.0)) == ()


def test_the_file_keeps_it(tmp_path):
    made_with = setup_of({"rotation": ["1 deg", "2 deg", "3 deg"]}, reflection=REFLECTION)
    sweep = sweep_of(made_with)
    sweep.save(tmp_path / "sweep.toml")
    loaded = PitchSweep.load(tmp_path / "sweep.toml")
    assert loaded.setup == sweep.setup
    assert loaded.setup.lines == 240
    loaded.check_setup(made_with)
    with pytest.raises(CalibrationError, match=r"glint\.reflection\.radius is 0\.05 m here"):
        loaded.check_setup(
            setup_of(
                {"rotation": ["1 deg", "2 deg", "3 deg"]},
                reflection={**REFLECTION, "radius": "50 mm"},
            )
        )


def test_a_sweep_that_does_not_say_is_taken():
    sweep = fit_sweep_points(sweep_points(ANGLES, 1e-3, ANGLES, 1e-3))
    sweep.check_setup(setup_of(y="1 m"))
    assert sweep.setup_doubts(setup_of(estimator="gaussian")) == ()
