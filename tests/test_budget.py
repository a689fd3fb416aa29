"""The uncertainty budget: closed forms, OpenCV, draws, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from budget_setups import (
    ALIGNED,
    EVERYTHING,
    NAMES,
    PER_SI,
    STEPS,
    TURNED,
    budget_of,
    nominal_angle,
    rows_of,
    setup_of,
)
from scipy import stats

from benchmarks.budget_coverage import COLUMNS, TrueCamera
from calibration.budget._chain import Chain
from calibration.budget._first_order import FirstOrder
from calibration.budget._model import AngleModel
from calibration.budget.uncertainty import geometry_covariance
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.geometry import GlintReflection, PixelToPlane
from glint_aoa.setup import Reflection

REFLECTION = """
[glint.reflection]
radius = "60 mm"
lamp = ["50 mm", "-600 mm", "1500 mm"]
"""


def test_the_chain_is_the_measurements_own():
    setup = setup_of(TURNED)
    chain = Chain.of_setup(setup, COLUMNS)
    angles, places = np.array([-6.0, 0.3, 8.0]), np.array([0.09, 0.03, 0.12])
    v = chain.pixels(np.radians(angles), places)
    for rows, angle, place in zip(v, angles, places, strict=True):
        assert nominal_angle(setup, rows) == pytest.approx((angle, place), abs=1e-9)
        np.testing.assert_allclose(rows, TrueCamera.of_setup(setup).rows(angle, place), atol=1e-4)
    others = chain.geometry * [[1.0], [1.001]]
    together = chain.angles(np.stack([v, v[::-1]]), others)
    np.testing.assert_allclose(np.degrees(together[0]), angles, atol=1e-9)
    alone = chain.angles(v[None, ::-1], others[1:])
    np.testing.assert_allclose(together[1], alone[0], rtol=1e-12)


class TestSensitivities:
    @pytest.mark.parametrize("nose", ["left", "right"])
    @pytest.mark.parametrize("angle", [-6.0, 0.0, 4.3])
    def test_aligned_camera_in_closed_form(self, angle, nose):
        text = ALIGNED + f'nose = "{nose}"\n' + EVERYTHING
        (budget,) = budget_of(text, [angle], intercepts_m=[0.09]).angles
        got = {name: row.sensitivity for name, row in rows_of(budget).items()}
        alpha, sign = np.radians(angle), 1 if nose == "right" else -1
        slope = sign * np.tan(alpha)
        above = (0.09 - 0.06) / 1.4  # tangent of the elevation at which the glint passes X = 0
        per_ratio = np.degrees(np.sin(2 * alpha) / 2)
        expected = {
            "rotation phi": -sign,  # roll is pitch, one to one
            "rotation kappa": -sign * above * np.cos(alpha) ** 2,
            "rotation omega": sign * slope * above * np.cos(alpha) ** 2,
            "yaw": sign * above * np.cos(alpha) ** 2,
            "pixel pitch, vertical": per_ratio / 27.5,  # the ratio of the pitches scales the slope
            "pixel pitch, horizontal": -per_ratio / 11.7,
        }
        for name, value in expected.items():
            assert got[name] == pytest.approx(value, rel=2e-6, abs=1e-9), name
        scaled_or_shifted = ("principal distance", "principal point u", "principal point v")
        for name in (*scaled_or_shifted, "position X", "position Y", "position Z", "known Y"):
            assert got[name] == 0, name

    def test_turned_and_distorted_camera_against_opencv(self):
        setup = setup_of(TURNED)
        (budget,) = budget_of(TURNED + EVERYTHING, [-4.0]).angles
        rows, true = rows_of(budget), TrueCamera.of_setup(setup)
        for number, (name, step, per_si) in enumerate(zip(NAMES, STEPS, PER_SI, strict=True)):
            seen = []
            for sign in (1, -1):
                off = true.values.copy()
                off[number] += sign * step
                seen.append(nominal_angle(setup, TrueCamera(off).rows(-4.0, 0.1))[0])
            # What the camera truly has more, the setup has less.
            expected = -(seen[0] - seen[1]) / (2 * step * per_si)
            assert rows[name].sensitivity == pytest.approx(expected, rel=2e-3, abs=2e-6), name

    def test_centroid_noise_of_a_level_line_in_closed_form(self):
        how = {"centroid_std_lines": 0.02, "fields": 25}
        (budget,) = budget_of(ALIGNED, [0.0], **how).angles
        spread = np.sqrt(np.sum((COLUMNS - COLUMNS.mean()) ** 2))
        expected = np.degrees(0.02 / 5 * 27.5 / 11.7 / spread)
        assert rows_of(budget)["centroids"].contribution_deg == pytest.approx(expected, rel=1e-6)
        assert budget.std_deg == pytest.approx(expected, rel=1e-6)

    @pytest.mark.parametrize("reflection", ["", REFLECTION])
    def test_centroid_noise_of_a_steep_line_against_draws(self, reflection):
        setup, draws = setup_of(TURNED + reflection), 400
        chain = Chain.of_setup(setup, COLUMNS)
        v = chain.pixels(np.radians([-8.0]), [0.1])
        noise = 0.05 * np.random.default_rng(2).standard_normal((draws, COLUMNS.size))
        drawn = chain.angles((v + noise)[None], chain.geometry[None])
        expected = 0.05 * chain.noise(v)[0]
        assert drawn.std() == pytest.approx(expected, rel=4 / np.sqrt(2 * draws))

    def test_body_and_lamp_as_the_measurement_turns_lines_into_axes(self):
        stated = '[uncertainty.reflection]\nradius = "1 mm"\naxis_y = "1 mm"\n'
        stated += 'lamp = ["10 mm", "10 mm", "10 mm"]\nlamp_direction = ["1 deg", "1 deg"]\n'
        setup = setup_of(TURNED + REFLECTION + stated)
        chain = Chain.of_setup(setup, COLUMNS)
        model = AngleModel(chain, None, chain.pixels(np.radians([5.0]), [0.09]))
        first = FirstOrder.of(model, geometry_covariance(setup), 0.0)
        rows = {row.source: row for row in first.rows(0)}
        plane = PixelToPlane.of_camera(setup.camera, y=setup.glint.y, yaw=setup.glint.yaw)

        def axis_of(reflection):
            return GlintReflection.of_window(reflection, plane, COLUMNS, (40.0, 140.0))

        prediction, rise = axis_of(setup.glint.reflection).prediction, np.radians([-5.0])
        height = 0.09 - 0.06
        for _ in range(5):
            height = height + 0.09 - prediction.line(rise, height)[3]
        slope, middle = prediction.line(rise, height)[:2]
        line = slope, middle - slope * prediction.middle
        nominal = {
            "radius": np.array(0.06),
            "axis_y": np.array(0.0),
            "lamp": np.array([0.05, -0.6, 1.5]),
            "lamp_direction": np.array([1.0, 0.0, 0.0]),
        }
        step = 2e-3
        for name, key, move, per_si in (
            ("body's radius", "radius", 1.0, 1e3),
            ("axis Y", "axis_y", 1.0, 1e3),
            *((f"lamp {axis}", "lamp", np.eye(3)[k], 1e3) for k, axis in enumerate("XYZ")),
            ("lamp's heading", "lamp_direction", np.eye(3)[1], np.degrees(1)),
            ("lamp's elevation", "lamp_direction", np.eye(3)[2], np.degrees(1)),
        ):
            seen = []
            for sign in (1, -1):
                changed = nominal | {key: nominal[key] + sign * step * move}
                content = {
                    each: [f"{number} m" for number in value] if value.ndim else f"{value} m"
                    for each, value in changed.items()
                } | {"lamp_direction": changed["lamp_direction"].tolist()}
                found = axis_of(Reflection.model_validate(content)).axis_line(*line)
                seen.append(-np.degrees(found.pitch[0]))
            expected = (seen[0] - seen[1]) / (2 * step * per_si)
            assert rows[name].sensitivity == pytest.approx(expected, rel=2e-3, abs=2e-6), name
        assert rows["known Y"].sensitivity == pytest.approx(0, abs=1e-6)


class TestFirstOrderAndMonteCarlo:
    def test_rows_blocks_and_shares_make_up_the_whole(self):
        for budget in budget_of(TURNED + EVERYTHING, [-6.0, 0.0, 6.0], intercepts_m=None).angles:
            assert sum(row.share for row in budget.rows) == pytest.approx(1.0, rel=1e-9)
            own = np.sqrt(sum(row.contribution_deg**2 for row in budget.rows))
            assert budget.std_deg == pytest.approx(own, rel=1e-9)  # all of it is independent
            together = np.sqrt(sum(block.contribution_deg**2 for block in budget.blocks))
            assert budget.std_deg == pytest.approx(together, rel=1e-9)
            assert budget.u95_deg == pytest.approx(stats.norm.ppf(0.975) * budget.std_deg)
            assert np.isinf(budget.degrees_of_freedom)

    def test_both_agree_where_the_angle_is_nearly_linear(self):
        for budget in budget_of(TURNED + EVERYTHING, [-6.0, 6.0], draws=4000).angles:
            drawn = budget.monte_carlo
            assert drawn.std_deg == pytest.approx(budget.std_deg, rel=4 / np.sqrt(2 * 4000))
            assert drawn.u95_deg == pytest.approx(budget.u95_deg, rel=0.06)
            assert drawn.converged
            assert budget.confirmed

    def test_far_from_linear_the_draws_show_it(self):
        # Turned by kappa and omega at once the picture rolls by their product.
        text = ALIGNED + '[uncertainty]\nrotation = ["6 deg", "0 deg", "8 deg"]\n'
        (budget,) = budget_of(text, [0.0], intercepts_m=[0.06], draws=4000).angles
        assert budget.std_deg < 0.001  # to first order nothing happens on the optical axis
        assert budget.monte_carlo.std_deg > 0.1
        assert not budget.confirmed
        assert budget.departure > 1

    def test_product_of_two_turns_in_closed_form(self):
        text = ALIGNED + '[uncertainty]\nrotation = ["1 deg", "0 deg", "2 deg"]\n'
        (budget,) = budget_of(text, [0.0], intercepts_m=[0.06], draws=4000, fields=10**6).angles
        # R = Rz Ry Rx: the line sees the turn of omega about an X that kappa has turned.
        expected = np.degrees(np.radians(1.0) * np.radians(2.0))
        assert budget.monte_carlo.std_deg == pytest.approx(expected, rel=0.08)

    def test_the_seed_decides(self):
        first, same, other = (
            budget_of(ALIGNED + EVERYTHING, seed=seed).angles[0] for seed in (1, 1, 2)
        )
        assert first == same
        assert first.monte_carlo != other.monte_carlo
        assert first.u95_deg == other.u95_deg

    def test_few_draws_are_said_to_be_few(self):
        many = budget_of(ALIGNED + EVERYTHING, draws=6000).angles[0].monte_carlo
        assert many.converged
        # density of the normal distribution at its 2.5 % point
        density = stats.norm.pdf(stats.norm.ppf(0.025)) / many.std_deg
        error = np.sqrt(0.025 * 0.975 / 6000) / density
        assert many.standard_error_deg == pytest.approx(error, rel=0.6)
        assert not replace(many, standard_error_deg=0.03 * many.u95_deg).converged


@pytest.mark.parametrize(
    ("text", "how", "error", "message"),
    [
        (
            '[camera]\npixel_pitch = ["11.7 um", "27.5 um"]\n',
            {},
            SetupError,
            "the setup has no camera in space, so nothing can be carried to the angle; give "
            "focal_length, pixel_pitch and position in [camera], or calibrate them",
        ),
        (
            ALIGNED.replace("sensor = [752, 240]\n", ""),
            {},
            SetupError,
            "camera.sensor is missing, so nobody knows which columns see the glint; "
            "give it in [camera], columns and lines per field",
        ),
        (
            ALIGNED,
            {"angles": [75.0]},
            CalibrationError,
            "angles between -60 and 60 deg are wanted and 75 deg is none; give angles in degrees",
        ),
        (
            ALIGNED,
            {"intercepts_m": [60.0]},
            CalibrationError,
            "a glint at 3 deg and 6e+04 mm is not in the picture; give another angle or intercept",
        ),
        (
            ALIGNED,
            {"intercepts_m": [np.nan]},
            CalibrationError,
            "the intercepts are none, or not all numbers; give mm",
        ),
        (
            ALIGNED,
            {"draws": 10},
            CalibrationError,
            "draws is 10; a 95 % interval takes 1000 at least, 10000 are better",
        ),
        (
            ALIGNED,
            {"centroid_std_lines": -1.0},
            CalibrationError,
            "the centroids' noise is -1.0 lines; give zero or more",
        ),
        (ALIGNED, {"fields": 0}, CalibrationError, "fields is 0; give 1 or more"),
        (
            ALIGNED + '[uncertainty]\nfocal_length = "30 mm"\n',
            {},
            CalibrationError,
            "of the draws the camera does not see the line: the geometry is too uncertain for a "
            "budget; give smaller values in [uncertainty], or calibrate",
        ),
        (
            ALIGNED.replace(
                'position = ["0 m", "-1.4 m", "60 mm"]', 'position = ["0 m", "1 m", "0 m"]'
            ),
            {},
            CalibrationError,
            "the camera of the setup does not see such a line in all columns; check position and "
            "rotation in [camera], the angles and the intercepts",
        ),
    ],
)
def test_what_cannot_be_is_refused(text, how, error, message):
    with pytest.raises(error, match=re.escape(message)):
        budget_of(text, **how)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[uncertainty]\ny = "-1 mm"\n', "Input should be greater than or equal to 0"),
        (
            '[uncertainty.reflection]\nradius = "1 mm"\n',
            "uncertainty.reflection is given without glint.reflection; describe body and lamp "
            "there, or take [uncertainty.reflection] out",
        ),
    ],
)
def test_uncertainties_that_cannot_be_are_refused_with_the_setup(text, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        setup_of(ALIGNED + text)
