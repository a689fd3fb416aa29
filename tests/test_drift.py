"""Points taken later: each cause of a drift, drawn by the simulator's own law of reflection."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.sweep_coverage import optical_angles
from calibration.drift._signatures import SignatureModel
from calibration.drift.check import Change, check_drift
from calibration.sweep.fit import SweepPoint, SweepSetup, fit_sweep_points
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Camera, Glint, Reflection, Setup
from render_sim.scene import paper_scene

SCENE = paper_scene()
PLAIN = Setup(camera=SCENE.camera, glint=Glint(y=f"{SCENE.glint_y_m} m"))
BODY = Reflection(radius="60 mm", lamp=["0 m", "-0.6 m", "1.5 m"])
MIRROR = PLAIN.model_copy(update={"glint": PLAIN.glint.model_copy(update={"reflection": BODY})})
SWEEP_DEG = np.arange(-6.0, 6.01, 1.0)
CHECK_DEG = np.array([-5.0, -2.5, 0.0, 2.5, 5.0])
OPTICAL_STD, ONBOARD_STD, INTERCEPT_STD, NOMINAL_STD = 0.0003, 0.0005, 0.01, 0.001
MARK = (230.0, 50.0)


@cache
def seen(scene, pitch_deg):
    """Optical angle and intercept of the mirror line; dear enough to be worked out once."""
    return optical_angles(np.array(pitch_deg), scene)


def turned(**degrees):
    """Turn the camera by omega, phi, kappa [deg]."""
    rotation = [np.radians(degrees.get(name, 0.0)) for name in ("omega", "phi", "kappa")]
    return replace(SCENE, camera=SCENE.camera.model_copy(update={"rotation": tuple(rotation)}))


def lamp_at(y=-0.6, z=1.5):
    return replace(SCENE, lamp=replace(SCENE.lamp, centre_m=(0.0, y, z)))


def points_of(scene, pitch_deg, day, *, rng, heave_mm=0.0, sag_deg=0.0, zero_deg=0.0, mark=None):
    """Points at rest with noise; the support is set to `pitch_deg`, the model sags from there."""
    optical, intercept = seen(scene, tuple(pitch_deg + sag_deg))
    noise = rng.standard_normal((5, pitch_deg.size))
    shift = (None, None) if mark is None else np.array(MARK) + mark
    return [
        SweepPoint(
            name=f"day {day}, {number}",
            optical_deg=float(optical[number] + OPTICAL_STD * noise[0, number]),
            optical_std_deg=OPTICAL_STD,
            onboard_deg=float(pitch + sag_deg + zero_deg + ONBOARD_STD * noise[1, number]),
            onboard_std_deg=ONBOARD_STD,
            time=f"2026-01-{day:02d}T{8 + number // 6:02d}:{10 * (number % 6):02d}:00",
            nominal_deg=float(pitch + NOMINAL_STD * noise[2, number]),
            intercept_mm=float(intercept[number] + heave_mm + INTERCEPT_STD * noise[3, number]),
            intercept_std_mm=INTERCEPT_STD,
            mark_row=shift[0],
            mark_column=shift[1],
            mark_at=None if mark is None else MARK,
        )
        for number, pitch in enumerate(pitch_deg)
    ]


def drift_of(scene=SCENE, *, setup=PLAIN, seed=5, silent=(), pitch_deg=CHECK_DEG, **changes):
    """Take a sweep, and check it two days on; `silent` are fields that nobody recorded."""
    rng = np.random.default_rng(seed)
    mark = changes.pop("mark", None)
    still = None if mark is None else (0.0, 0.0)
    before = points_of(SCENE, SWEEP_DEG, 1, rng=rng, mark=still)
    later = points_of(scene, pitch_deg, 3, rng=rng, mark=mark, **changes)
    blank = dict.fromkeys(silent)
    before, later = ([replace(p, **blank) for p in points] for points in (before, later))
    made_with = SweepSetup.of(setup, columns=(5.0, 746.0))
    return check_drift(fit_sweep_points(before, setup=made_with), later, setup)


def value_of(drift, name):
    return next(each for each in drift.signatures if each.name == name)


def best_of(drift):
    return next(each for each in drift.hypotheses if each.cause != "nothing")


class TestSignatures:
    """The geometry's derivatives against differences of the simulator's mirror line."""

    @pytest.mark.parametrize(
        ("scene", "step", "signature"),
        [
            (turned(omega=0.02), 0.02, lambda model: model.camera_turned(0)),
            (turned(phi=0.02), 0.02, lambda model: model.camera_turned(1)),
            (turned(kappa=0.02), 0.02, lambda model: model.camera_turned(2)),
            (lamp_at(y=-0.59), 10.0, lambda model: model.lamp_moved(1)),
            (lamp_at(z=1.51), 10.0, lambda model: model.lamp_moved(2)),
        ],
        ids=["omega", "phi", "kappa", "lamp across", "lamp up"],
    )
    def test_they_are_what_the_simulator_shows(self, scene, step, signature):
        angle, intercept = seen(SCENE, tuple(CHECK_DEG))
        moved_angle, moved_intercept = seen(scene, tuple(CHECK_DEG))
        # with the reflection in the setup the angle is the axis's own: 1.012 times the line's
        model = SignatureModel(MIRROR, CHECK_DEG, intercept, (5.0, 746.0))
        predicted = signature(model)
        change, rise = moved_angle - angle, moved_intercept - intercept
        assert step * predicted.intercept_mm == pytest.approx(rise, rel=0.01, abs=2e-4)
        assert step * predicted.angle_deg == pytest.approx(1.012 * change, rel=0.03, abs=5e-5)

    def test_a_camera_moved_by_a_millimetre(self):
        x, y, z = SCENE.camera.position
        angle, intercept = seen(SCENE, tuple(CHECK_DEG))
        model = SignatureModel(MIRROR, CHECK_DEG, intercept, (5.0, 746.0))
        for axis, place in enumerate([(x + 1e-3, y, z), (x, y + 1e-3, z), (x, y, z + 1e-3)]):
            camera = SCENE.camera.model_copy(update={"position": place})
            moved = optical_angles(CHECK_DEG, replace(SCENE, camera=camera))
            signature = model.camera_moved(axis)
            assert signature.intercept_mm == pytest.approx(moved[1] - intercept, abs=5e-4)
            assert signature.angle_deg == pytest.approx(moved[0] - angle, abs=1e-4)

    def test_a_painted_line_rises_with_its_model(self):
        model = SignatureModel(PLAIN, CHECK_DEG, np.full(5, 55.0), (5.0, 746.0))
        raised = model.model_raised()
        assert raised.intercept_mm == pytest.approx(np.ones(5), abs=1e-9)
        assert raised.angle_deg == pytest.approx(np.zeros(5), abs=1e-9)

    def test_a_mark_moves_as_the_camera_turns(self):
        model = SignatureModel(PLAIN, CHECK_DEG, np.full(5, 55.0), (5.0, 746.0), mark=MARK)
        degree = np.radians(1.0)
        focal = 0.035 / np.array([27.5e-6, 11.7e-6])  # field lines, columns
        off = (np.array(MARK) - [119.5, 375.5]) / focal  # down and to the right
        row, column = model.camera_turned(0).mark  # a camera that looks up moves the mark down
        assert row == pytest.approx(degree * focal[0] * (1 + off[0] ** 2), rel=1e-6)
        row, column = model.camera_turned(1).mark  # right side down: all turns the other way
        assert row == pytest.approx(-degree * focal[0] * off[1], rel=1e-6)
        assert column == pytest.approx(degree * focal[1] * off[0], rel=1e-6)
        assert SignatureModel(PLAIN, CHECK_DEG, np.full(5, 55.0), (5.0, 746.0)).camera_turned(
            0
        ).mark.tolist() == [0, 0]


class TestVerdicts:
    @pytest.mark.parametrize("setup", [PLAIN, MIRROR], ids=["plain", "reflection"])
    def test_nothing(self, setup):
        drift = drift_of(setup=setup)
        assert drift.verdict == "unchanged"
        assert not drift.has_drifted
        assert drift.angle_holds
        assert drift.sentence == (
            "Nothing has changed that these points could show; the calibration holds"
        )
        for each in drift.signatures:
            assert abs(each.value) < 3.5 * each.std
        assert drift.points[0].hours == pytest.approx(46.0)

    @pytest.mark.parametrize("setup", [PLAIN, MIRROR], ids=["plain", "reflection"])
    def test_a_camera_that_turned(self, setup):
        wanted = {"omega": 0.02, "phi": 0.01, "kappa": -0.03}
        drift = drift_of(turned(**wanted), setup=setup)
        assert drift.verdict == "camera"
        assert drift.sentence.startswith("The camera turned about several axes, or moved (omega +")
        assert drift.sentence.endswith("; the calibrated angle has changed: repeat the sweep")
        assert best_of(drift).p_value > 0.001
        for change in best_of(drift).changes:
            assert abs(change.value - wanted[change.name]) < 3.5 * change.std
        assert value_of(drift, "angle offset").value == pytest.approx(-0.0101, abs=0.001)

    @pytest.mark.parametrize("scene", [lamp_at(y=-0.54), lamp_at(z=1.6)], ids=["across", "up"])
    @pytest.mark.parametrize("setup", [PLAIN, MIRROR], ids=["plain", "reflection"])
    def test_a_lamp_that_moved(self, scene, setup):
        drift = drift_of(scene, setup=setup)
        assert drift.verdict == "lamp"
        assert drift.sentence.startswith("The lamp moved (")
        assert not drift.angle_holds
        scale = value_of(drift, "angle per deg")
        assert scale.value > 5 * scale.std

    def test_and_how_far(self):
        across, up = best_of(drift_of(lamp_at(y=-0.54), setup=MIRROR)).changes
        assert (across.name, up.name) == ("lamp Y", "lamp Z")
        assert abs(across.value - 60) < 3 * across.std
        assert abs(up.value) < 3 * up.std

    def test_a_model_that_sagged(self):
        drift = drift_of(heave_mm=-0.5, sag_deg=-0.04)
        assert drift.verdict == "model"
        height, turn = best_of(drift).changes
        assert abs(height.value + 0.5) < 3.5 * height.std
        assert abs(turn.value + 0.04) < 3.5 * turn.std
        assert drift.angle_holds
        assert drift.sentence.endswith("; the calibration still holds for the angle")

    def test_an_onboard_zero_that_the_settings_give_away(self):
        drift = drift_of(zero_deg=0.02)
        assert drift.verdict == "onboard sensor"
        (zero,) = best_of(drift).changes
        assert abs(zero.value - 0.02) < 3.5 * zero.std

    def test_height_alone_may_be_camera_or_model(self):
        drift = drift_of(turned(omega=0.02), silent=["nominal_deg"])
        assert drift.verdict == "undecided"
        assert "the camera tilted, or rose or sank" in drift.sentence
        assert "the model moved up or down" in drift.sentence
        assert drift.angle_holds

    def test_an_offset_alone_may_be_camera_or_onboard_zero(self):
        drift = drift_of(turned(phi=0.01), silent=["nominal_deg"])
        assert drift.verdict == "undecided"
        named = drift.sentence.removeprefix("One of these, and the points cannot tell which: ")
        *causes, what, step = re.split("[;:] ", named)
        assert set(causes) == {"the camera rolled", "the onboard sensor's zero shifted"}
        assert (what, step) == ("the calibrated angle has changed", "repeat the sweep")

    @pytest.mark.parametrize(
        ("scene", "changes", "verdict"),
        [
            (turned(omega=0.02), {"mark": (0.4476, -0.0099)}, "camera"),
            (turned(phi=0.01), {"mark": (0.0242, 0.0453)}, "camera"),
            (SCENE, {"zero_deg": 0.01, "mark": (0.0, 0.0)}, "onboard sensor"),
        ],
        ids=["tilt", "roll", "zero"],
    )
    def test_a_mark_in_view_decides(self, scene, changes, verdict):
        assert drift_of(scene, silent=["nominal_deg"], **changes).verdict == verdict

    def test_a_level_edge_will_do(self):
        silent = ["nominal_deg", "mark_column"]
        drift = drift_of(turned(omega=0.02), silent=silent, mark=(0.4476, 0.0))
        assert drift.verdict == "camera"
        still = drift_of(turned(phi=0.01), silent=silent, mark=(0.0242, 0.0))
        assert still.verdict == "camera"

    def test_a_mark_that_stands_still_clears_the_camera(self):
        drift = drift_of(heave_mm=-0.5, mark=(0.0, 0.0))
        assert "camera" not in drift.sentence
        assert "the model moved up or down" in drift.sentence

    def test_points_that_drift_meanwhile_fit_nothing(self):
        rng = np.random.default_rng(1)
        sweep = fit_sweep_points(points_of(SCENE, SWEEP_DEG, 1, rng=rng))
        early = points_of(turned(phi=0.02, omega=0.05), CHECK_DEG[::2], 2, rng=rng)
        late = points_of(turned(phi=-0.03, omega=-0.05), CHECK_DEG[1::2], 3, rng=rng)
        drift = check_drift(sweep, [*early, *late], PLAIN)
        assert drift.verdict == "unknown"
        assert drift.sentence.startswith("Something has changed that no single cause explains")

    def test_one_angle_shows_offsets_only(self):
        drift = drift_of(turned(omega=0.02, phi=0.01), pitch_deg=np.zeros(3))
        assert drift.has_drifted
        assert [each.name for each in drift.signatures] == ["angle offset", "intercept offset"]

    def test_without_intercepts_the_angle_speaks_alone(self):
        drift = drift_of(turned(phi=0.01), silent=["intercept_mm", "nominal_deg"])
        assert drift.verdict == "undecided"
        assert drift.points[0].intercept_mm is None
        assert [each.name for each in drift.signatures] == ["angle offset", "angle per deg"]

    def test_nothing_is_called_a_drift_once_in_twenty_times_at_most(self):
        rng = np.random.default_rng(6)
        sweep = fit_sweep_points(points_of(SCENE, SWEEP_DEG, 1, rng=rng))
        checks = [points_of(SCENE, CHECK_DEG, 3, rng=rng) for _ in range(25)]
        assert sum(check_drift(sweep, each, PLAIN).has_drifted for each in checks) <= 1


class TestRefusals:
    def refused(self, message, points, setup=PLAIN, sweep_setup=None):
        rng = np.random.default_rng(0)
        sweep = fit_sweep_points(points_of(SCENE, SWEEP_DEG, 1, rng=rng), setup=sweep_setup)
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
            check_drift(sweep, points, setup)

    def later(self):
        return points_of(SCENE, CHECK_DEG, 3, rng=np.random.default_rng(0))

    def test_no_point(self):
        self.refused("no check points; give at least one point at rest", [])

    def test_a_point_twice(self):
        points = self.later()
        self.refused("point day 3, 0 is given twice; give each point once", [*points, points[0]])

    def test_a_point_of_the_sweep(self):
        own = points_of(SCENE, SWEEP_DEG, 1, rng=np.random.default_rng(0))[2]
        self.refused(
            "day 1, 2: taken at 2026-01-01T08:20:00, as a point of the sweep itself; "
            "give points that were taken later",
            [own],
        )

    def test_a_camera_without_a_place(self):
        self.refused(
            "a drift is told by the camera's geometry; give focal_length, pixel_pitch and "
            "position in [camera]",
            self.later(),
            Setup(camera=Camera(pixel_pitch=["11.7 um", "27.5 um"])),
        )

    def test_another_setup(self):
        self.refused(
            "the pitch sweep was measured with another setup (it is used with [glint.reflection] "
            "and was measured without it); repeat glint-aoa calibrate sweep with this one, or go "
            "back to the other",
            self.later(),
            MIRROR,
            SweepSetup.of(PLAIN),
        )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (Change("phi", 0.01, 0.00031, "deg"), "phi +0.01000 +/- 0.00031 deg"),
        (Change("lamp Y", 56.21, 8.14, "mm"), "lamp Y +56.2 +/- 8.1 mm"),
        (Change("scale", -0.00012, 0.000086, ""), "scale -0.000120 +/- 0.000086"),
        (Change("lamp Z", 113.0, 21.0, "mm"), "lamp Z +113 +/- 21 mm"),
    ],
)
def test_a_change_is_printed_with_two_digits_of_its_uncertainty(change, text):
    assert str(change) == text
