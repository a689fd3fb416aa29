"""From the glint's line to the body's axis: closed forms, round trips, ray-traced sweeps."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glint_aoa.errors import SetupError
from glint_aoa.geometry import GlintReflection, PixelToPlane
from glint_aoa.process import measure_point
from glint_aoa.records.fields import FieldStack
from glint_aoa.setup import Camera, Glint, Reflection, Setup, load_setup
from render_sim.film import film
from render_sim.motion import StaticMotion
from render_sim.renderer import make_renderer
from render_sim.scene import Lamp, Scene, paper_scene

COLUMNS = np.arange(6.0, 752.0, 20.0)
WINDOW = (98.0, 189.0)
PITCHES = np.radians([-5.0, 0.0, 5.0])


def camera_at(position=(0.0, -1422.4, 60.0), rotation=(0.0, 0.0, 0.0), **more):
    return Camera(
        focal_length=more.pop("focal_length", "35 mm"),
        pixel_pitch=("11.7 um", "27.5 um"),
        sensor=(752, 240),
        position=[f"{p} mm" for p in position],
        rotation=[f"{a} deg" for a in rotation],
        **more,
    )


def plane(camera=None, *, y=-49.0, yaw=0.0):
    return PixelToPlane.of_camera(camera or camera_at(), y=y / 1e3, yaw=np.radians(yaw))


def lit(lamp=(0.0, -600.0, 1500.0), *, radius=60.0, axis_y=0.0, **more):
    metres = [f"{c} mm" for c in lamp]
    return Reflection(radius=f"{radius} mm", axis_y=f"{axis_y} mm", lamp=metres, **more)


def prepared(reflection=None, to_plane=None, columns=COLUMNS, **more):
    return GlintReflection.of_window(
        reflection or lit(), to_plane or plane(), columns, WINDOW, **more
    )


def line_of(axis, rise, height):
    """Slope and intercept of the line that a body's glint shows."""
    slope, middle, *_ = axis.prediction.line(rise, height)
    return slope, middle - slope * axis.prediction.middle


def column_fit(axis, to_plane, rise, height, columns):
    """Pixels of the glint's points through the lens, and the line through them on the plane."""
    points = axis.prediction.points(rise, height)[:-1]
    u, v = to_plane.project(points)
    along, seen = to_plane(columns, np.polynomial.Polynomial.fit(u, v, 6)(columns))
    return along, seen


lamps = st.tuples(st.floats(-800, 800), st.floats(-1000, 200), st.floats(800, 2500))
bodies = st.tuples(st.floats(2, 110), st.floats(-30, 30), st.floats(-4, 4))
cameras = st.builds(
    camera_at,
    st.tuples(st.floats(-150, 150), st.floats(-2000, -1000), st.floats(-50, 150)),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2)),
)
attitudes = st.tuples(st.floats(-12, 12), st.floats(0.1, 0.9))


@settings(max_examples=12)
@given(lamps, bodies, cameras, attitudes, st.sampled_from(["long", "small"]))
def test_axis_is_found_again_from_its_glints_line(lamp, body, camera, attitude, shape):
    radius, axis_y, yaw = body
    axis = prepared(
        lit(lamp, radius=radius, axis_y=axis_y, lamp_shape=shape), plane(camera, yaw=yaw)
    )
    rise, (low, high) = np.radians(attitude[:1]), axis.heights
    height = low + attitude[1] * (high - low) - 0.7 * radius / 1e3
    found = axis.axis_line(*line_of(axis, rise, height))
    np.testing.assert_allclose(np.degrees(found.pitch - rise), 0.0, atol=1e-6)
    np.testing.assert_allclose(found.axis_intercept, height, atol=1e-8)
    x, _, z = axis.prediction.points(rise, height)[0, -1]
    assert (x, z) == pytest.approx((0.0, found.glint_intercept[0]), abs=1e-8)


@settings(max_examples=12)
@given(attitudes, cameras, st.floats(-4, 4))
def test_body_without_thickness_is_paint(attitude, camera, yaw):
    to_plane = plane(camera, y=10.0, yaw=yaw)
    axis = prepared(lit(radius=1e-6, axis_y=10.0), to_plane)
    slope = np.tan(np.radians(attitude[:1]))
    found = axis.axis_line(slope, 0.03)
    np.testing.assert_allclose(np.degrees(found.pitch - np.arctan(slope)), 0.0, atol=1e-6)
    np.testing.assert_allclose(found.axis_intercept, 0.03, atol=1e-8)
    np.testing.assert_allclose(found.glint_intercept, 0.03, atol=1e-8)


def test_paint_behind_the_known_plane_is_put_where_it_is():
    axis = prepared(lit(radius=1e-6, axis_y=51.0), plane(y=-49.0))
    further = (1422.4 + 51.0) / (1422.4 - 49.0)  # seen from the camera
    found = axis.axis_line(np.tan(PITCHES), 0.03)
    np.testing.assert_allclose(np.degrees(found.pitch - PITCHES), 0.0, atol=1e-6)
    np.testing.assert_allclose(found.axis_intercept, 0.06 - 0.03 * further, atol=1e-8)


@pytest.mark.parametrize("shape", ["long", "small"])
def test_far_lamp_and_camera_show_the_axis_itself(shape):
    camera = camera_at((0.0, -1e9, 0.0), focal_length="25000 m")
    reflection = lit((0.0, -0.4e9, 1e9), lamp_shape=shape)
    axis = prepared(reflection, plane(camera))
    found = axis.axis_line(np.tan(PITCHES), 0.03)
    np.testing.assert_allclose(np.degrees(found.pitch - PITCHES), 0.0, atol=1e-5)


def test_five_degrees_show_as_the_trials_line():
    axis = prepared()
    slope, _ = line_of(axis, np.radians(5.0), 0.0)
    assert np.degrees(np.arctan(slope)) == pytest.approx(4.942, abs=5e-4)


@pytest.mark.parametrize("y", [-60.0, 0.0, 30.0])
def test_known_y_does_not_matter(y):
    to_plane, usual = plane(y=y), plane()
    axis, reference = prepared(to_plane=to_plane), prepared()
    for rise in PITCHES:
        fits = [
            np.polyfit(*column_fit(each, place, rise, 0.002, COLUMNS), 1)
            for each, place in ((axis, to_plane), (reference, usual))
        ]
        here, there = (
            each.axis_line(*fit) for each, fit in zip((axis, reference), fits, strict=True)
        )
        np.testing.assert_allclose(
            np.degrees([here.pitch, there.pitch]), np.degrees(rise), atol=1e-6
        )
        np.testing.assert_allclose(here.axis_intercept, 0.002, atol=1e-8)
        np.testing.assert_allclose(here.glint_intercept, there.glint_intercept, atol=1e-8)


def test_predicted_line_is_what_a_distorting_camera_sees():
    camera = camera_at((80.0, -1300.0, 90.0), (-1.5, 1.0, 2.0), distortion=(-0.2, 0.1, 5e-4, 0, 0))
    to_plane = plane(camera, yaw=2.0)
    weight = np.linspace(1.0, 3.0, COLUMNS.size)
    axis = prepared(to_plane=to_plane, weight=weight)
    along, seen = column_fit(axis, to_plane, 0.08, 0.01, COLUMNS)
    slope, intercept = np.polyfit(along, seen, 1, w=np.sqrt(weight))
    expected = line_of(axis, 0.08, 0.01)
    # a column is not quite upright: its distance along the plane is that of the window's middle
    np.testing.assert_allclose(np.degrees(slope - expected[0]), 0.0, atol=2e-5)
    np.testing.assert_allclose(intercept, expected[1], atol=1e-7)


@pytest.mark.parametrize("shape", ["long", "small"])
def test_sagitta_is_that_of_the_fitted_parabola(shape):
    to_plane = plane()
    axis = prepared(lit((200.0, -600.0, 1500.0), lamp_shape=shape), to_plane)
    along, seen = column_fit(axis, to_plane, 0.08, 0.0, COLUMNS)
    bend = np.polyfit(along, seen, 2)[0]
    found = axis.axis_line(*np.polyfit(along, seen, 1))
    assert found.sagitta == pytest.approx(-bend * (np.ptp(along) / 2) ** 2, rel=1e-3)
    assert abs(found.sagitta[0]) > 1e-6


def test_departure_keeps_a_line_right_of_which_half_is_missing():
    to_plane = plane()
    axis = prepared(lit(lamp_shape="small"), to_plane)
    left = slice(0, 19)
    for rise in PITCHES:
        along, seen = column_fit(axis, to_plane, rise, 0.0, COLUMNS)
        plain = axis.axis_line(*np.polyfit(along[left], seen[left], 1))
        straight = axis.axis_line(*np.polyfit(along[left], (seen - axis.departure)[left], 1))
        assert abs(np.degrees(plain.pitch - rise)) > 0.009
        assert abs(np.degrees(straight.pitch - rise)) < 0.001
    assert np.polyfit(along, axis.departure, 1) == pytest.approx([0, 0], abs=1e-12)


def test_jacobians_and_stds_follow_the_line():
    axis = prepared(lit((300.0, -500.0, 1300.0)), plane(camera_at((200.0, -1422.4, 60.0)), yaw=2.0))
    slope, intercept, step = np.array([-0.08, 0.02, 0.3]), np.array([0.02, 0.04, 0.03]), 1e-5
    found = axis.axis_line(slope, intercept)
    for name, jacobian in (
        ("pitch", found.pitch_jacobian),
        ("axis_intercept", found.axis_jacobian),
        ("glint_intercept", found.glint_jacobian),
    ):
        for k, (ds, di) in enumerate(((step, 0), (0, step))):
            more, less = (
                getattr(axis.axis_line(slope + sign * ds, intercept + sign * di), name)
                for sign in (1, -1)
            )
            np.testing.assert_allclose(jacobian[:, k], (more - less) / (2 * step), atol=1e-6)
    rng = np.random.default_rng(5)
    noise = rng.multivariate_normal([0, 0], [[1e-10, -4e-12], [-4e-12, 4e-13]], 20_000).T
    stds = found.stds(np.full(3, 1e-10), np.full(3, 4e-13), np.full(3, -4e-12))
    drawn = axis.axis_line(slope[0] + noise[0], intercept[0] + noise[1])
    for std, values in zip(
        stds, (drawn.pitch, drawn.axis_intercept, drawn.glint_intercept), strict=True
    ):
        assert values.std() == pytest.approx(std[0], rel=0.02)


def test_lines_beyond_the_table_are_solved_and_missing_ones_stay_missing():
    axis = prepared()
    rise = np.radians([3.0, 20.0, 3.0])
    slope, intercept = line_of(axis, rise, np.array([0.0, 0.0, 0.2]))
    found = axis.axis_line(np.append(slope, np.nan), np.append(intercept, np.nan))
    np.testing.assert_allclose(np.degrees(found.pitch[:3] - rise), 0.0, atol=1e-7)
    assert np.isnan(found.pitch[3])
    assert np.isnan(found.pitch_jacobian[3]).all()


def test_fields_in_blocks_are_as_all_at_once():
    axis = prepared()
    slope, intercept = np.linspace(-0.3, 0.3, 40), np.linspace(0.0, 0.06, 40)
    whole = axis.axis_line(slope, intercept).pitch
    parts = [axis.axis_line(slope[k : k + 7], intercept[k : k + 7]).pitch for k in range(0, 40, 7)]
    assert np.array_equal(np.concatenate(parts), whole)


@settings(max_examples=12)
@given(attitudes, st.floats(-300, 300), st.floats(-2, 2))
def test_mirrored_scene_negates_the_angle(attitude, lamp_x, yaw):
    slope = np.tan(np.radians(attitude[0]))
    pair = []
    for sign in (1, -1):
        axis = prepared(
            lit((sign * lamp_x, -600.0, 1500.0)),
            plane(camera_at((sign * 100.0, -1422.4, 60.0)), yaw=sign * yaw),
            columns=COLUMNS if sign > 0 else 751.0 - COLUMNS[::-1],
        )
        pair.append(axis.axis_line(sign * slope, 0.03))
    np.testing.assert_allclose(pair[0].pitch, -pair[1].pitch, atol=1e-10)
    np.testing.assert_allclose(pair[0].axis_intercept, pair[1].axis_intercept, atol=1e-10)


def lamp_of(scene):
    return tuple(1e3 * c for c in scene.lamp.centre_m)


def swept(scene: Scene, pitches_deg, *, yaw_deg=0.0, glint_y="-49 mm"):
    """Film a sweep, measure it, undo the reflection; errors of the angle before and after [deg]."""
    glint = Glint(y=glint_y, yaw=f"{yaw_deg} deg", nose=scene.nose, column_step=4)
    first, rows, columns = scene.fields.first_line, scene.sensor.rows, scene.sensor.columns
    axis = GlintReflection.of_window(
        lit(lamp_of(scene), radius=1e3 * scene.body.radius_m),
        PixelToPlane.of_camera(scene.camera, y=glint.y, yaw=glint.yaw),
        np.arange(columns, dtype=float),
        (first, first + rows - 1),
    )
    renderer, before, after = make_renderer(scene), [], []
    for k, pitch in enumerate(pitches_deg):
        held = StaticMotion(scene, np.radians(pitch), yaw_rad=np.radians(yaw_deg))
        rng = np.random.default_rng(k)
        shot = film(scene, held, 12, renderer=renderer, rng=rng, sub_exposures=1)
        stack = FieldStack.from_array(shot.fields, shot.info)
        result = measure_point(stack, Setup(camera=scene.camera, glint=glint))
        raw = result.record["angle_raw_deg"].to_numpy()
        slope = glint.nose_sign * np.tan(np.radians(raw))
        found = axis.axis_line(slope, result.record["intercept_mm"].to_numpy() / 1e3)
        truth = shot.truth["pitch_deg"].mean()
        before.append(raw.mean() - truth)
        after.append(glint.nose_sign * np.degrees(found.pitch).mean() - truth)
        away = found.axis_intercept - shot.truth["axis_intercept_mm"] / 1e3
        assert np.abs(away).max() < 0.05e-3  # the glint's skirts are not alike: 0.02 mm
    return np.array(before), np.array(after)


def turned_camera(scene):
    pose = {"position": (0.1, -1.3, 0.1), "rotation": (-0.03, 0.02, 0.05)}
    lens = {"distortion": (-0.2, 0.1, 5e-4, -5e-4, 0.0)}
    return replace(scene, camera=scene.camera.model_copy(update=pose | lens)).with_window(60, 150)


SWEEPS = {
    "the paper's scene": (paper_scene(), {"pitches_deg": (-5, -2.5, 0, 2.5, 5)}),
    "yaw": (paper_scene(), {"pitches_deg": (-5, 0, 5), "yaw_deg": 2.0}),
    "yaw the other way": (paper_scene(), {"pitches_deg": (-5, 5), "yaw_deg": -2.0}),
    "nose right": (replace(paper_scene(), nose="right"), {"pitches_deg": (-5, 5)}),
    "lamp aside": (
        replace(paper_scene(), lamp=Lamp(centre_m=(0.4, -0.3, 1.2))),
        {"pitches_deg": (-5, 5)},
    ),
    "known Y wrong": (paper_scene(), {"pitches_deg": (-5, 5), "glint_y": "0 mm"}),
    "camera turned": (turned_camera(paper_scene()), {"pitches_deg": (-5, 5), "yaw_deg": 1.0}),
}


@pytest.mark.parametrize(("scene", "motion"), SWEEPS.values(), ids=SWEEPS)
def test_ray_traced_sweep_needs_no_calibration(scene, motion):
    before, after = swept(scene, **motion)
    assert np.abs(before).max() > 0.03
    assert np.abs(after).max() < 0.001  # a third of what is asked for


def test_long_lamp_across_the_body_is_refused():
    expected = (
        "glint.reflection: the lamp runs 90 deg off the body, and only a lamp along the body makes "
        'a line of light; correct lamp_direction, or give lamp_shape = "small"'
    )
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        prepared(lit(lamp_direction=(0, 1, 0)))
    prepared(lit(lamp_direction=(0, 1, 0), lamp_shape="small"))


def test_lamp_that_is_not_mirrored_is_refused():
    expected = (
        "glint.reflection: the body does not mirror the lamp to where the camera looks; check "
        "radius, axis_y and lamp against the camera's position"
    )
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        prepared(lit((0.0, 0.0, 20.0)))


def test_camera_that_looks_away_is_refused():
    expected = (
        "glint.reflection: the camera does not see the plane of glint.y in all columns; check "
        "position and rotation in [camera]"
    )
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        prepared(to_plane=plane(camera_at((0.0, 1422.4, 60.0))))


def test_camera_without_a_place_is_refused():
    expected = "glint.reflection needs the camera's place; give position in [camera]"
    with pytest.raises(SetupError, match=f"^{re.escape(expected)}$"):
        prepared(to_plane=plane(Camera()))


SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
position = ["0 m", "-56 in", "60 mm"]

[glint.reflection]
radius = "60 mm"
lamp = ["0 m", "-0.6 m", "1.5 m"]
"""


def test_setup_reads_the_reflection(tmp_path):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP)
    reflection = load_setup(path).glint.reflection
    assert reflection == lit()
    assert (reflection.lamp_direction, reflection.lamp_shape) == ((1.0, 0.0, 0.0), "long")
    assert Setup().glint.reflection is None


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('radius = "60 mm"', "", "glint.reflection.radius: missing"),
        ('"60 mm"\nlamp', '"0 mm"\nlamp', "glint.reflection.radius: 0 must be greater than zero"),
        ("radius =", "raduis =", "unknown key glint.reflection.raduis; did you mean radius?"),
        (
            "radius =",
            "lamp_direction = [0, 0, 0]\nradius =",
            "glint.reflection: lamp_direction has no length; [1, 0, 0] is a lamp along the tunnel",
        ),
        (
            SETUP[: SETUP.index("[glint")],
            '[camera]\npixel_pitch = ["1 um", "1 um"]\n',
            "glint.reflection needs the camera's place; give focal_length, pixel_pitch and "
            "position in [camera], or take [glint.reflection] out",
        ),
    ],
)
def test_setup_refuses_what_cannot_be_used(tmp_path, old, new, expected):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP.replace(old, new))
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {expected}')}$"):
        load_setup(path)


def error_of(wrong_lamp=None, wrong_plane=None):
    """Errors of the angle at -5, 0 and 5 deg where one thing is not what the setup says [deg]."""
    true_plane, stated_plane = plane(), wrong_plane or plane()
    true, stated = prepared(), prepared(wrong_lamp, stated_plane)
    errors = []
    for rise in PITCHES:
        points = true.prediction.points(rise, 0.0)[:-1]
        u, v = true_plane.project(points)
        seen = np.polynomial.Polynomial.fit(u, v, 6)(COLUMNS)
        found = stated.axis_line(*np.polyfit(*stated_plane(COLUMNS, seen), 1))
        errors.append(np.degrees(found.pitch[0] - rise))
    return np.array(errors)


LAMP = (0.0, -600.0, 1500.0)
WRONG = {
    "radius, 1 mm": {"wrong_lamp": lit(radius=61)},
    "radius, 1 cm": {"wrong_lamp": lit(radius=70)},
    "lamp along X, 1 cm": {"wrong_lamp": lit((10.0, -600.0, 1500.0))},
    "lamp along Y, 1 mm": {"wrong_lamp": lit((0.0, -601.0, 1500.0))},
    "lamp along Y, 1 cm": {"wrong_lamp": lit((0.0, -610.0, 1500.0))},
    "lamp along Z, 1 cm": {"wrong_lamp": lit((0.0, -600.0, 1510.0))},
    "lamp turned 0.1 deg in plan": {"wrong_lamp": lit(lamp_direction=(1, np.radians(0.1), 0))},
    "lamp tilted 0.1 deg": {"wrong_lamp": lit(lamp_direction=(1, 0, np.radians(0.1)))},
    "small lamp taken for a long one": {"wrong_lamp": lit(lamp_shape="small")},
    "`axis_y`, 1 cm": {"wrong_lamp": lit(axis_y=10)},
    "`glint.y`, 1 cm": {"wrong_plane": plane(y=-39)},
    "camera's Y, 1 cm": {"wrong_plane": plane(camera_at((0, -1412.4, 60)))},
    "camera's Z, 1 cm": {"wrong_plane": plane(camera_at((0, -1422.4, 70)))},
    "yaw, 0.1 deg": {"wrong_plane": plane(yaw=0.1)},
}


def test_conventions_say_what_a_wrong_setup_costs():
    page = Path(__file__).parents[1] / "docs" / "conventions.md"
    rows = dict(re.findall(r"^\| (.+?) \| ([\d.]+ \| [\d.]+) \|$", page.read_text(), re.MULTILINE))
    measured = {}
    for name, wrong in WRONG.items():
        low, zero, high = error_of(**wrong)
        measured[name] = f"{abs(zero):.4f} | {abs(high - low) / 2:.4f}"
    assert {name: rows.get(name) for name in WRONG} == measured
