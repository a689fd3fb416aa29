"""Uncertainty budgets with calibrations and sweeps, and what is carried to measured angles."""

import re
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import tomli_w
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
    swept,
)
from scipy import stats

from benchmarks._draws import BAND
from benchmarks.budget_coverage import COLUMNS, STUDIES, TrueCamera, camera_file, coverage
from calibration.budget._chain import Chain
from calibration.budget.uncertainty import (
    geometry_covariance,
    geometry_uncertainty,
    uncertain_geometry,
    uncertainty_budget,
)
from calibration.resection.resect import resect
from calibration.resection.target_field import ImageTargets, TargetField
from calibration.sweep.fit import fit_sweep
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.geometry import PixelToPlane
from glint_aoa.report.budget_tables import format_exact
from glint_aoa.setup import load_setup


@cache
def resected():
    """A pose with its covariance from 12 targets, seen with noise that is not known."""
    rng = np.random.default_rng(5)
    true = TrueCamera.of_setup(setup_of(TURNED))
    x, z = (each.ravel() for each in np.meshgrid(np.linspace(-0.1, 0.1, 4), [0.0, 0.05, 0.1]))
    targets = np.stack([x, np.resize([-0.05, 0.05, 0.0], x.size), z], axis=-1)
    seen = true.pixels(targets) + rng.normal(0.0, [0.05, 0.02], (12, 2))
    ids = tuple("ABCDEFGHIJKL")
    field = TargetField(ids, targets, np.zeros(targets.shape))
    return resect(field, ImageTargets(ids, seen), setup_of(TURNED).camera)


CAMERA_STD = np.array([50e-6, 0.02e-6, 2.0, 1.5, 0.004])
CORRELATION = np.eye(5) + 0.6 * (np.eye(5, k=1) + np.eye(5, k=-1)) * [[1], [1], [0], [0], [0]]
CAMERA_NAMES = ["focal_length_m", "pixel_pitch_v_m", "principal_point_u", "principal_point_v", "k1"]
CAMERA = {
    "focal_length": "35 mm",
    "pixel_pitch": ["11.7 um", "27.5 um"],
    "sensor": [752, 240],
    "principal_point": [370.5, 117.5],
    "distortion": [-0.15, 0.1, 0.001, -0.001, 0.05],
}
CALIBRATED = """
[glint]
y = "-20 mm"
yaw = "1.5 deg"
[uncertainty]
y = "1 mm"
[calibration]
camera = "camera.toml"
pose = "pose.toml"
"""


@pytest.fixture
def calibrated(tmp_path):
    """Write a calibrated setup; `matrix` and `text` replace what would be written."""

    def write(matrix=None, *, pose=None):
        correlation = (CORRELATION + CORRELATION.T) / 2
        given = correlation * np.outer(CAMERA_STD, CAMERA_STD) if matrix is None else matrix
        (tmp_path / "camera.toml").write_text(camera_file(CAMERA, CAMERA_NAMES, given))
        resected().save(tmp_path / "pose.toml", overwrite=True)
        if pose is not None:
            content = tomllib.loads((tmp_path / "pose.toml").read_text())
            pose(content)
            (tmp_path / "pose.toml").write_text(tomli_w.dumps(content))
        (tmp_path / "glint-aoa.toml").write_text(CALIBRATED)
        return load_setup(tmp_path / "glint-aoa.toml")

    return write


class TestCalibrations:
    def test_covariance_joins_both_files_with_their_correlation(self, calibrated):
        setup = calibrated()
        joined = geometry_covariance(setup)
        place = joined.parameters.index
        camera = [place(name) for name in CAMERA_NAMES]
        pose = [place(f"{axis}_m") for axis in "XYZ"]
        pose += [place(f"{angle}_rad") for angle in ("omega", "phi", "kappa")]
        interior = np.array(tomllib.loads(setup.camera_path.read_text())["covariance"]["matrix"])
        found = resected()
        columns = [found.interior_parameters.index(joined.parameters[k]) for k in camera]
        follows = found.sensitivity[:, columns]
        expected = {
            (0, 0): interior,
            (1, 0): follows @ interior,
            (1, 1): found.covariance + follows @ interior @ follows.T,
        }
        for (row, column), value in expected.items():
            part = joined.matrix[np.ix_((camera, pose)[row], (camera, pose)[column])]
            np.testing.assert_allclose(part, value, rtol=1e-9, atol=1e-30)
        assert joined.matrix[place("y_m"), place("y_m")] == pytest.approx(1e-6)
        assert joined.matrix[place("k2"), place("k2")] == 0

    def test_what_the_camera_calibration_held_is_said(self, calibrated):
        budget = uncertainty_budget(calibrated(), [3.0], intercepts_m=[0.1], draws=1000)
        terms = tuple(f"distortion {name}" for name in ("k2", "p1", "p2", "k3"))
        assert budget.held == ("pixel pitch, horizontal", *terms)
        assert budget.exact == ("yaw",)
        assert format_exact(budget).splitlines()[1:] == [
            "Held by a calibration, so taken as exact: pixel pitch, horizontal; distortion k2; "
            "distortion p1; distortion p2; distortion k3",
            "Taken as exact, since nothing is said of them: yaw",
        ]

    def test_draws_have_that_covariance(self, calibrated):
        (budget,) = uncertainty_budget(calibrated(), [3.0], intercepts_m=[0.1], draws=4000).angles
        # The pose has few degrees of freedom: its draws are Student's, wider than the normal.
        freedom = resected().degrees_of_freedom
        pose, others = 0.0, 0.0
        for block in budget.blocks:
            if block.name == "space resection":
                pose = block.contribution_deg**2 * freedom / (freedom - 2)
            else:
                others += block.contribution_deg**2
        assert budget.monte_carlo.std_deg == pytest.approx(np.sqrt(pose + others), rel=0.06)

    def test_few_degrees_of_freedom_widen_the_interval(self, calibrated):
        (budget,) = uncertainty_budget(calibrated(), [3.0], intercepts_m=[0.1], draws=1000).angles
        blocks = {block.name: block for block in budget.blocks}
        pose = blocks["space resection"]
        assert pose.degrees_of_freedom == resected().degrees_of_freedom == 18
        share = (pose.contribution_deg / budget.std_deg) ** 2
        assert 0.3 < share < 1
        camera = (blocks["camera calibration"].contribution_deg / budget.std_deg) ** 2
        freedom = 1 / (share**2 / 18 + camera**2 / 1500)  # Welch-Satterthwaite
        assert budget.degrees_of_freedom == pytest.approx(freedom)
        factor = stats.t.ppf(0.975, freedom)
        assert budget.u95_deg == pytest.approx(factor * budget.std_deg)
        shares = sum(row.share for row in budget.rows)
        assert shares == pytest.approx(1.0)

    def test_a_pose_follows_its_camera(self, calibrated):
        """A shifted principal point is mostly taken up by the pose that was found with it."""
        setup = calibrated()
        (budget,) = uncertainty_budget(setup, [3.0], intercepts_m=[0.1], draws=1000).angles
        sensitivity = rows_of(budget)["principal point v"].sensitivity
        plane = {"y": setup.glint.y, "yaw": setup.glint.yaw}
        rows = TrueCamera.of_setup(setup).rows(3.0, 0.1)
        camera = setup.camera
        moved = np.array(camera.position + camera.rotation)
        column = resected().interior_parameters.index("principal_point_v")
        moved = moved + 0.5 * resected().sensitivity[:, column]
        changed = camera.model_copy(
            update={
                "principal_point": (camera.principal_point[0], camera.principal_point[1] + 0.5),
                "position": tuple(moved[:3]),
                "rotation": tuple(moved[3:]),
            }
        )
        seen = [
            np.polyfit(*PixelToPlane.of_camera(each, **plane)(COLUMNS, rows), 1)[0]
            for each in (camera, changed)
        ]
        change = -np.degrees(np.diff(np.arctan(seen)))[0]
        assert sensitivity == pytest.approx(change / 0.5, rel=0.02, abs=1e-5)

    def test_a_covariance_that_is_none_is_refused(self, calibrated):
        setup = calibrated(np.outer(CAMERA_STD, CAMERA_STD) * (3 * np.eye(5) - 2))
        message = (
            f"{setup.camera_path}: not a camera calibration that can be used (covariance.matrix "
            "has a negative variance); repeat glint-aoa calibrate camera"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            geometry_covariance(setup)

    def test_a_pose_that_follows_nobody_knows_what_is_refused(self, calibrated):
        def rename(content):
            content["interior"]["parameters"][0] = "focus"

        setup = calibrated(pose=rename)
        message = (
            f"{setup.pose_path}: interior.parameters: focus is unknown; "
            "repeat glint-aoa calibrate resect"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            geometry_covariance(setup)

    def test_a_pose_found_with_another_camera_is_refused(self, calibrated, tmp_path):
        def older(content):
            interior = content["interior"]
            assert len(interior["values"]) == len(interior["parameters"])
            interior["values"][interior["parameters"].index("focal_length_m")] = 0.0352
            interior["values"][interior["parameters"].index("k1")] = 0.0

        message = (
            f"{tmp_path / 'pose.toml'} was found with another camera (focal_length_m was 0.0352 "
            "and is 0.035; k1 was 0 and is -0.15); take calibration.pose out of the setup and "
            "repeat glint-aoa calibrate resect with the present camera"
        )
        with pytest.raises(SetupError, match=re.escape(message)):
            calibrated(pose=older)

    def test_a_pose_that_does_not_say_its_camera_is_taken(self, calibrated):
        def forget(content):
            del content["interior"]["values"]

        assert calibrated(pose=forget).camera.position == pytest.approx(resected().position_m)

    @pytest.mark.parametrize("values", [[0.035], "0.035", [[]] * 10, 3])
    def test_values_that_are_none_are_refused(self, calibrated, tmp_path, values):
        def spoil(content):
            content["interior"]["values"] = values

        message = f"{tmp_path / 'pose.toml'}: interior.values is not one number for each of "
        with pytest.raises(SetupError, match=re.escape(message)):
            calibrated(pose=spoil)

    def test_a_pose_that_does_not_follow_the_camera_is_refused(self, calibrated):
        def forget(content):
            number = content["interior"]["parameters"].index("k1")
            del content["interior"]["parameters"][number]
            del content["interior"]["values"][number]
            for row in content["interior"]["sensitivity"]:
                del row[number]

        setup = calibrated(pose=forget)
        message = (
            f"{setup.pose_path}: interior does not say how the pose follows k1, which is "
            "uncertain; repeat glint-aoa calibrate resect with the present camera"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            geometry_covariance(setup)


class TestSweep:
    def test_roll_and_ratio_of_the_pitches_cancel(self):
        text = ALIGNED + EVERYTHING
        sweep = swept(setup_of(text), degree=3)
        (budget,) = budget_of(text, [3.0], intercepts_m=None, sweep=sweep).angles[1:2]
        rows = rows_of(budget)
        for name in ("rotation phi", "pixel pitch, vertical", "pixel pitch, horizontal"):
            assert rows[name].before_sweep_deg > 1e-3
            assert rows[name].contribution_deg < 1e-3 * rows[name].before_sweep_deg
        expected = sweep.apply(budget.raw_angle_deg).systematic_std_deg
        assert rows["pitch sweep"].contribution_deg == pytest.approx(expected)

    @pytest.mark.parametrize("degree", [1, 3])
    def test_what_is_left_is_that_of_a_sweep_fitted_again(self, degree):
        setup = setup_of(TURNED)
        sweep = swept(setup, (0.05, 1.01), degree=degree)
        how = {"sweep": sweep, "intercepts_m": [0.03, 0.1]}
        both = uncertainty_budget(setup_of(TURNED + EVERYTHING), [4.5], draws=1000, **how).angles
        nominal, intercepts = TrueCamera.of_setup(setup), (0.03, 0.1)
        middle = np.mean([each.line for each in both])
        optical = np.array([point.optical_deg for point in sweep.points])
        places = [_through(nominal, angle, middle) for angle in optical]
        raw = both[0].raw_angle_deg
        onboard = [point.onboard_deg for point in sweep.points]
        for number in (2, 8, 15, 17):  # of pitch, p2, kappa and yaw
            step, seen = 20 * STEPS[number], []
            for sign in (1, -1):
                off = nominal.values.copy()
                off[number] += sign * step
                true = TrueCamera(off)
                points = [
                    nominal_angle(setup, true.rows(*place))[0]
                    for place in zip(optical, places, strict=True)
                ]
                again = fit_sweep(points, 4e-4, onboard, 1e-3, degree=degree)
                lines = [nominal_angle(setup, true.rows(raw, z))[0] for z in intercepts]
                seen.append(again.predict(lines))
            expected = (seen[1] - seen[0]) / (2 * step * PER_SI[number])
            got = [rows_of(budget)[NAMES[number]].sensitivity for budget in both]
            np.testing.assert_allclose(got, expected, rtol=0.01, atol=2e-5)

    def test_the_lines_of_the_sweep_lie_where_its_file_says(self):
        text = ALIGNED + '[uncertainty]\nrotation = ["0 deg", "0 deg", "0.5 deg"]\n'
        sweep = swept(setup_of(text))
        curve = sweep.curves[0]
        points = tuple(replace(point, intercept_mm=100.0) for point in curve.points)
        placed = replace(sweep, curves=(replace(curve, points=points),))
        here, there = (
            budget_of(text, [0.0], intercepts_m=[z], sweep=placed, draws=1000).angles[0]
            for z in (0.1, 0.03)
        )
        assert rows_of(here)["rotation kappa"].contribution_deg < 1e-4
        expected = 0.5 * 0.07 / 1.4  # turned about the vertical, heights change the slope
        got = rows_of(there)["rotation kappa"].contribution_deg
        assert got == pytest.approx(expected, rel=0.01)

    def test_monte_carlo_calibrates_anew_too(self):
        text = TURNED + EVERYTHING
        sweep = swept(setup_of(text), degree=3, onboard_accuracy_deg=0.003)
        for budget in budget_of(text, [3.0], intercepts_m=None, sweep=sweep, draws=2000).angles:
            limit = 4 / np.sqrt(2 * 2000)
            assert budget.monte_carlo.std_deg == pytest.approx(budget.std_deg, rel=limit)
            assert budget.confirmed

    def test_scatter_of_the_sweep_has_its_degrees_of_freedom(self):
        rng = np.random.default_rng(3)
        optical = np.arange(-7.0, 7.1, 2.0)
        onboard = optical + 0.05 * rng.standard_normal(optical.size)
        sweep = fit_sweep(optical, 4e-4, onboard, 1e-3, degree=1)
        assert sweep.curves[0].is_widened
        (budget,) = budget_of(ALIGNED, [1.0], sweep=sweep).angles
        assert budget.degrees_of_freedom == pytest.approx(6, rel=1e-3)
        assert budget.u95_deg == pytest.approx(stats.t.ppf(0.975, 6) * budget.std_deg, rel=1e-3)

    def test_angles_outside_the_sweep_are_marked(self):
        sweep = swept(setup_of(ALIGNED))
        inside, outside = budget_of(ALIGNED, [6.0, 9.0], sweep=sweep).angles
        assert (inside.outside_sweep, outside.outside_sweep) == (False, True)


def _through(camera, angle_deg, row):
    """Intercept of a glint that crosses the middle of the columns at a row, by bisection."""
    low, high = -0.1, 0.3
    for _ in range(60):
        middle = (low + high) / 2
        below = np.interp(COLUMNS.mean(), COLUMNS, camera.rows(angle_deg, middle)) > row
        low, high = (middle, high) if below else (low, middle)
    return (low + high) / 2


class TestCarriedToFields:
    def carried(self, text, angle_deg, intercept, **how):
        setup = setup_of(text)
        return geometry_uncertainty(
            setup,
            uncertain_geometry(setup),
            np.radians(angle_deg),
            np.asarray(intercept, float),
            u=COLUMNS,
            std=np.ones(COLUMNS.size),
            **how,
        ).std_deg

    def test_degrees_of_freedom_are_the_budgets(self, calibrated):
        setup = calibrated()
        how = {"intercepts_m": [0.1], "centroid_std_lines": 0.0, "draws": 1000}
        (budget,) = uncertainty_budget(setup, [3.0], **how).angles
        carried = geometry_uncertainty(
            setup,
            uncertain_geometry(setup),
            np.radians([3.0, np.nan]),
            np.array([0.1, np.nan]),
            u=COLUMNS,
            std=np.ones(COLUMNS.size),
        )
        assert carried.degrees_of_freedom[0] == pytest.approx(budget.degrees_of_freedom, rel=1e-6)
        assert np.isinf(carried.degrees_of_freedom[1])

    @pytest.mark.parametrize("with_sweep", [False, True])
    def test_is_the_budgets_at_each_field(self, with_sweep):
        text = TURNED + EVERYTHING
        sweep = swept(setup_of(text), (0.0, 1.0), degree=3) if with_sweep else None
        if sweep is not None:
            curve = sweep.curves[0]
            points = tuple(replace(point, intercept_mm=70.0) for point in curve.points)
            sweep = replace(sweep, curves=(replace(curve, points=points),))
        angles, places = [-3.0, 0.5, 4.0], [0.05, 0.1]
        budgets = budget_of(text, angles, intercepts_m=places, sweep=sweep).angles
        raw = [each.raw_angle_deg for each in budgets]
        got = self.carried(text, raw, np.tile(places, 3), sweep=sweep)
        for std, budget in zip(got, budgets, strict=True):
            expected = {block.name: block.contribution_deg for block in budget.blocks}["taped"]
            assert std == pytest.approx(expected, rel=2e-3)

    def test_a_field_gone_wrong_does_not_matter_to_the_others(self):
        text = TURNED + EVERYTHING
        rng = np.random.default_rng(1)
        angle, place = rng.normal(2.0, 0.1, 40), rng.normal(0.1, 1e-4, 40)
        alone = self.carried(text, angle, place)
        wild = self.carried(text, np.append(angle, [80.0, np.nan]), np.append(place, [9.0, np.nan]))
        np.testing.assert_allclose(wild[:40], alone, rtol=1e-3)
        assert np.isfinite(wild[40])
        assert np.isnan(wild[41])

    def test_lines_out_of_sight_do_not_hide_the_others(self):
        text = TURNED + EVERYTHING
        angle, place = np.full(6, 2.0), 0.1 + 1e-3 * np.arange(6)
        far = [5.0, 20.0, 40.0, 80.0, 100.0]
        chain = Chain.of_setup(setup_of(text), COLUMNS)
        assert np.isnan(chain.pixels(np.radians(2.0), 20.0)).all()
        many = self.carried(text, np.append(angle, [2.0] * 5), np.append(place, far))
        np.testing.assert_allclose(many[:6], self.carried(text, angle, place), rtol=0.02)
        assert np.isfinite(many).all()

    def test_nothing_measured_nothing_known(self):
        assert np.isnan(self.carried(TURNED + EVERYTHING, [np.nan] * 2, [np.nan] * 2)).all()

    def test_a_setup_that_says_nothing_has_no_uncertain_geometry(self):
        assert uncertain_geometry(setup_of(TURNED)) is None
        assert uncertain_geometry(setup_of('[camera]\npixel_pitch = ["10 um", "10 um"]\n')) is None


@pytest.mark.parametrize("study", STUDIES)
def test_errors_of_measured_angles_follow_the_budget(study):
    (row,) = coverage(25, 7, [study])
    # four standard deviations of 25 draws
    assert row.inside > BAND[0] - 4 * np.sqrt(0.05 * 0.95 / 25)
    assert row.rms_error_deg == pytest.approx(row.rms_std_deg, rel=4 / np.sqrt(2 * 25))
