"""A planned test: closed forms, what must grow with what, and a simulation that knows nothing."""

import re
import tomllib

import numpy as np
import pytest
from plan_setups import SETUP, SMALL_MAP

from benchmarks.plan_agreement import Case, measured_range, noise, predicted_range
from glint_aoa.errors import SetupError
from glint_aoa.plan import Layout, forecast, make_plan, map_size, mean_noise, predict
from glint_aoa.plan.light import glint_light
from glint_aoa.plan.noise import LineProfile, smear_rms
from glint_aoa.plan.predict import matte_radiance
from glint_aoa.setup import Plan, PlanVibration, Reflection, Setup, load_setup

DEG = np.pi / 180


def setup(plan="", *, text=SETUP):
    return Setup.model_validate(tomllib.loads(text + plan))


def planned(plan="", *, text=SETUP, angles=(-6, -3, 0, 3, 6)):
    settings = setup(plan, text=text)
    return predict(settings, Layout.of_setup(settings), np.radians(angles))


def shaken(amplitude=0.28 * DEG, frequency=9.2, **more):
    return PlanVibration(amplitude=f"{amplitude} rad", frequency=f"{frequency} Hz", **more)


def said(settings):
    layout = Layout.of_setup(settings)
    level = predict(settings, layout, [0.0])
    ambient = matte_radiance(settings.plan, level)
    return forecast(settings, layout, ambient=ambient, present_gain=level.gain)


# Noise


def test_information_on_a_broad_line_in_white_noise_has_a_closed_form():
    sigma, flux, read_noise = np.array([3.0]), np.array([400.0]), 2.0
    profile = LineProfile(sigma, flux, 0.0)
    got = profile.information([0.3], read_noise=read_noise, electrons=1e12)
    blurred = np.sqrt(sigma**2 + 1 / 12)  # the pixel's own width
    expected = flux**2 / (4 * np.sqrt(np.pi) * blurred**3) / (read_noise**2 + 1 / 12)
    assert got == pytest.approx(expected, rel=1e-3)


def test_a_level_line_is_at_the_bound_of_evenly_informed_columns():
    got = planned(angles=[-1, 0, 1])
    k, columns = int(got.at(0.0)[0]), got.layout.columns
    flux = (got.peak[k] - 10 - 15) / (got.peak[k] - 25).max() * 145  # all but even
    assert np.ptp(flux) < 1
    share = LineProfile(got.sigma[k], np.ones(columns.size), 0.0).peak
    profile = LineProfile(got.sigma[k], (got.peak[k] - 25) / share, 15.0)
    electrons = 40_000 / 245
    one, other = (
        profile.information(got.row[k] + shift, read_noise=0.7, electrons=electrons)
        for shift in (0.0, 0.5)
    )
    information = (one + other) / 2
    off = columns - (information * columns).sum() / information.sum()
    slope = 1 / np.sqrt((information * off**2).sum())
    to_axis = 2 / np.degrees(np.ptp(got.glint_angle))  # the glint turns less than the body
    assert got.std[k] == pytest.approx(slope * 27.5 / 11.7 * to_axis, rel=1e-4)
    assert np.degrees(got.std[k]) == pytest.approx(0.0009, abs=5e-5)  # as measured in the paper's


@pytest.mark.parametrize("hz", [3.0, 9.2, 29.7, 59.9])
def test_a_plain_mean_keeps_what_does_not_close(hz):
    vibration, n, rate, exposure = shaken(frequency=hz), 60, 60.0, 4e-3
    start = np.arange(n)[:, None] / rate
    within = (np.arange(400) + 0.5) / 400 * exposure
    phase = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    turn = 2 * np.pi * hz * (start + within)
    means = [np.cos(turn + each).mean() * vibration.amplitude for each in phase]
    got = mean_noise(n, rate_hz=rate, exposure_s=exposure, vibration=vibration, fitted=False)
    assert got.from_vibration == pytest.approx(np.sqrt(np.mean(np.square(means))), rel=1e-4)
    assert got.from_noise == pytest.approx(1 / np.sqrt(n))


@pytest.mark.parametrize("fitted", [True, False])
def test_at_a_multiple_of_the_field_rate_nothing_averages_out(fitted):
    got = mean_noise(60, rate_hz=60.0, vibration=shaken(1e-3, 120.0), fitted=fitted)
    assert got.from_vibration == pytest.approx(1e-3 / np.sqrt(2))


def test_a_fitted_sine_leaves_nothing_and_costs_some_noise():
    n, rate, hz, rng = 30, 60.0, 3.7, np.random.default_rng(7)
    got = mean_noise(n, rate_hz=rate, vibration=shaken(frequency=hz))
    turn = 2 * np.pi * hz * np.arange(n) / rate
    design = np.stack([np.ones(n), np.cos(turn), np.sin(turn)], 1)
    trials = rng.standard_normal((20_000, n)) + design @ [0.3, 2.0, -1.0]
    means = np.linalg.lstsq(design, trials.T, rcond=None)[0][0]
    assert got.from_vibration == 0
    assert got.from_noise > 1.001 / np.sqrt(n)
    assert means.std() == pytest.approx(got.from_noise, rel=0.02)  # known to 0.5 %


def test_smear_is_the_motion_about_the_mean_of_the_exposure():
    vibration, exposure = shaken(1e-3, 40.0), 12e-3
    phase = np.linspace(0, 2 * np.pi, 64, endpoint=False)[:, None]
    turn = 2 * np.pi * 40.0 * exposure * (np.arange(2000) + 0.5) / 2000
    angle = 1e-3 * np.cos(turn + phase)
    expected = np.sqrt((angle - angle.mean(axis=1, keepdims=True)).var())
    assert smear_rms(vibration, exposure) == pytest.approx(expected, rel=1e-4)


def test_vibration_within_the_exposure_widens_the_ends_and_not_the_centre():
    vibration = '[plan.vibration]\namplitude = "1 deg"\nfrequency = "30 Hz"\n'
    slow = SETUP.replace("1 ms", "10 ms")
    still, moved = (planned(each, text=slow, angles=[0, 1]) for each in ("", vibration))
    swing = smear_rms(shaken(1 * DEG, 30.0), 10e-3)
    arm = 375.5 - 10  # columns from the point that it turns about
    extra = np.sqrt(moved.sigma[0, 0] ** 2 - still.sigma[0, 0] ** 2)
    assert extra == pytest.approx(swing * arm * 11.7 / 27.5, rel=5e-3)
    assert moved.sigma[0, 18] == pytest.approx(still.sigma[0, 18], rel=1e-2)
    assert moved.std[0] > 1.1 * still.std[0]


# Light


def lit(*, lamp=(0.0, 0.0, 1000.0), eye=(0.0, -1000.0, 0.0), radius=0.06, plan=None, x=0.0, **more):
    reflection = Reflection(radius=f"{radius} m", lamp=tuple(f"{each} m" for each in lamp), **more)
    plan = plan or Plan()
    return glint_light(reflection, plan, eye=eye, yaw=0.0, rise=[0.0], stations=[x - 0.01, x])


@pytest.mark.parametrize("roughness", [0.01, 0.04])
def test_far_away_the_width_is_the_radius_times_the_slope(roughness):
    got = lit(plan=Plan(roughness=roughness, lamp_width="1 mm"))
    width = np.linalg.norm(got.spread, axis=-1)
    assert width == pytest.approx(0.06 * roughness / np.sqrt(2), rel=2e-4)
    assert got.points[0, 1] == pytest.approx([0, -0.06 / np.sqrt(2), 0.06 / np.sqrt(2)], abs=1e-5)


def test_a_wide_lamp_adds_by_squares():
    """Half the angle that the lamp fills, over the root of twelve."""
    got = lit(plan=Plan(roughness=0.04, lamp_width="80 m"))
    half_angle = 80 / 1000 / 2
    slope = np.hypot(0.04 / np.sqrt(2), half_angle / np.sqrt(12))
    assert np.linalg.norm(got.spread, axis=-1) == pytest.approx(0.06 * slope, rel=2e-4)
    assert got.rough_share == pytest.approx(0.04 / np.sqrt(2) / slope, rel=2e-4)


def test_light_of_a_long_lamp_falls_with_the_distance():
    near, far = (lit(lamp=(0, 0, z), radius=0.001).radiance[0, 1] for z in (10.0, 20.0))
    assert near / far == pytest.approx(2.0, rel=5e-3)


def test_at_the_mirrored_end_of_the_lamp_half_the_light_is_left():
    plan = Plan(lamp_length="2 m")
    eye, lamp = (0.0, -1.5, 0.0), (0.0, 0.0, 1.5)
    middle = lit(plan=plan, eye=eye, lamp=lamp).radiance[0, 1]
    places = np.linspace(0.0, 0.8, 801)
    light = [lit(plan=plan, eye=eye, lamp=lamp, x=x).radiance[0, 1] for x in places[::40]]
    half = np.interp(-0.5 * middle, -np.array(light), places[::40])
    assert half == pytest.approx(0.5, abs=0.02)  # the ray leaves as it came: half way to the end
    assert light[-1] < 1e-3 * middle


# Place and range


def test_the_glint_lies_where_similar_triangles_put_it():
    got = planned()
    for k in range(got.angle.size):
        off = got.layout.columns - 375.5
        middle = np.interp(0.0, off, got.row[k])
        expected = middle + np.tan(got.glint_angle[k]) * off * 11.7 / 27.5
        assert got.row[k] == pytest.approx(expected, abs=0.05)  # and it bows a little


def test_the_range_ends_where_the_last_column_leaves_the_window():
    settings = setup("least_columns = 1\n")
    visible = said(settings).visible
    edge = np.radians([visible.low_deg - 0.05, visible.low_deg, visible.high_deg])
    edge = np.append(edge, edge[-1] + 0.05 * DEG)
    got = predict(settings, Layout.of_setup(settings), edge)
    clear = 0.6 * (2.77 * np.hypot(got.sigma, np.sqrt(1 / 12)) + 0.55)
    beyond = (got.row + clear > 98 + 92 - 0.5) | (got.row - clear < 98 - 0.5)
    assert (visible.low_limit, visible.high_limit) == ("window", "window")
    assert list(beyond.any(axis=1)[got.at(edge)]) == [True, False, False, True]


def test_nose_right_mirrors_the_picture():
    left = planned(angles=[4, 5])
    right = planned(text=SETUP.replace("[glint]", '[glint]\nnose = "right"'), angles=[4, 5])
    assert right.glint_angle == pytest.approx(left.glint_angle, rel=1e-4)
    columns = left.layout.columns
    inside = columns[1:-1]
    for one, other in zip(left.row, right.row, strict=True):
        mirrored = np.interp(2 * 375.5 - inside, columns, other)
        assert one[1:-1] == pytest.approx(mirrored, abs=1e-3)
    assert right.row[2, 0] > right.row[2, -1]


def test_out_of_focus_is_not_seen():
    turned = SETUP.replace("[fields]", 'rotation = ["0 deg", "0 deg", "20 deg"]\n[fields]')
    settings = setup(
        "f_number = 1.4\n", text=turned.replace('position = ["0 m"', 'position = ["0.5 m"')
    )
    got = predict(settings, Layout.of_setup(settings), [0.0])
    assert got.in_window[0].all()
    assert 0 < got.sharp[0].sum() < got.sharp.shape[1] / 2
    edge = np.flatnonzero(got.sharp[0])[[0, -1]]
    u = got.layout.columns[edge] - 375.5
    aim, slant = got.layout.distance, np.tan(20 * DEG)
    depth = aim / (1 - u * 11.7e-6 / 35e-3 * slant)  # a plane that is turned from the sensor
    disc = 0.035**2 / 1.4 * np.abs(depth - aim) / (depth * (aim - 0.035))
    assert (disc < 11.7e-6).all()
    assert (disc > 0.5 * 11.7e-6).any()


# What must grow with what


def test_from_farther_away_the_same_body_is_measured_worse():
    settings = setup('body = ["-0.15 m", "0.15 m"]\n')
    layout = Layout.of_setup(settings)
    far = [
        predict(settings, layout.moved(distance=d, lamp_y=-0.6, lamp_z=1.5), [0.0]).std[0]
        for d in (1.1, 1.4, 1.8, 2.4, 3.2)
    ]
    assert (np.diff(far) > 0).all()


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("read_noise", (0.0, 0.7, 3.0)),
        ("roughness", (0.02, 0.04, 0.08)),
        ("blur", (0.3, 0.8, 2.0)),
        ("background", (0, 15, 60)),
        ("peak_level", (250, 170, 60)),
        ("full_well", (80_000, 40_000, 10_000)),
    ],
)
def test_noise_grows(key, values):
    std = [planned(f"{key} = {value}\n", angles=[0]).std[0] for value in values]
    assert (np.diff(std) > 0).all()


def test_more_columns_are_less_noisy_by_the_sum_of_their_squared_places():
    every = planned(text=SETUP.replace("[glint]", "[glint]\ncolumn_step = 1"), angles=[0])
    some = planned(angles=[0])
    of_752, of_38 = (((c - c.mean()) ** 2).sum() for c in (np.arange(752), np.arange(10, 752, 20)))
    assert some.std[0] / every.std[0] == pytest.approx(np.sqrt(of_752 / of_38), rel=1e-3)


# Calibration


def test_a_camera_rolled_by_some_angle_turns_the_body_by_it():
    settings = setup('[uncertainty]\nrotation = ["0 deg", "0.05 deg", "0 deg"]\n')
    got = said(settings).angles[2]
    assert got.calibration_std_deg == pytest.approx(0.05, rel=0.02)
    assert got.mean_std_deg == pytest.approx(
        np.hypot(got.calibration_std_deg, got.noise_std_deg), rel=1e-9
    )
    assert got.mean_u95_deg == pytest.approx(1.96 * got.mean_std_deg, rel=1e-3)


def test_a_planned_sweep_stands_for_the_geometry():
    text = 'sweep_std = "0.002 deg"\n[uncertainty]\nrotation = ["0 deg", "0.05 deg", "0 deg"]\n'
    got = [each.calibration_std_deg for each in said(setup(text)).angles]
    assert got == pytest.approx([0.002] * 5)


def test_what_is_planned_is_no_part_of_how_a_point_is_measured():
    assert setup("fields = 10\n").hash == setup().hash


# The map


def test_the_suggestion_is_the_least_noisy_layout_that_sees_all():
    settings = setup(SMALL_MAP)
    done = []
    plan = make_plan(settings, progress=done.append)
    layouts, best = plan.layouts, plan.suggestion
    assert sum(done) == map_size(settings) == layouts.std_deg.size == 3 * 2 * 2 * 1
    assert best.worst_std_deg == pytest.approx(np.nanmin(layouts.allowed_std_deg), rel=1e-9)
    assert best.visible.holds(-6, 6)
    d, f, y, z = np.unravel_index(np.nanargmin(layouts.allowed_std_deg), layouts.std_deg.shape)
    assert best.layout.distance == pytest.approx(layouts.distances[d])
    assert best.layout.focal_length == layouts.focal_lengths[f]
    assert best.layout.lamp_yz == pytest.approx((layouts.lamp_y[y], layouts.lamp_z[z]))
    assert best.layout.first_line == layouts.first_line[d, f, y, z]


def test_calibration_counts_in_the_suggestion():
    """An unsure lamp matters the less the farther away it is: the noise alone wants it near."""
    lamp = SMALL_MAP.replace('lamp_y = ["-0.6 m", "0 m"]', 'lamp_y = ["-2 m", "-0.6 m"]')
    uncertain = '[uncertainty.reflection]\nlamp = ["0 m", "20 mm", "20 mm"]\n'
    sure, unsure = (make_plan(setup(lamp + each)) for each in ("", uncertain))
    quiet = setup(lamp + uncertain)
    ambient = matte_radiance(quiet.plan, predict(quiet, Layout.of_setup(quiet), [0.0]))
    least_noisy = forecast(quiet, sure.suggestion.layout, ambient=ambient, present_gain=1.0)
    assert unsure.suggestion.worst_std_deg < 0.95 * least_noisy.worst_std_deg
    assert unsure.suggestion.layout != sure.suggestion.layout


def test_layouts_that_lose_the_glint_are_not_suggested():
    narrow = SETUP.replace("lines = 92", "lines = 40") + SMALL_MAP
    plan = make_plan(setup('angles = ["-18 deg", "18 deg"]\n', text=narrow))
    assert plan.suggestion is None
    assert not plan.layouts.visible.any()


def test_the_present_layout_in_the_map_is_the_present_layout():
    here = Layout.of_setup(setup())
    axes = f'distances = ["{here.distance} m", "{here.distance} m"]\nfocal_lengths = ["35 mm"]\n'
    axes += 'lamp_y = ["-0.6 m", "-0.6 m"]\nlamp_z = ["1.5 m", "1.5 m"]\n'
    plan = make_plan(setup(axes))
    assert plan.layouts.std_deg.shape == (1, 1, 1, 1)
    assert plan.layouts.std_deg.item() == pytest.approx(plan.present.worst_std_deg, rel=1e-6)
    assert plan.layouts.exposure_ratio.item() == pytest.approx(1.0, rel=1e-9)


def test_a_single_step_stays_where_it_is():
    plan = make_plan(setup('focal_lengths = ["35 mm"]\nsteps = [1, 1, 1]\n'))
    assert plan.layouts.std_deg.item() == pytest.approx(plan.present.worst_std_deg, rel=1e-6)
    assert plan.suggestion.layout.camera.position == pytest.approx((0, -56 * 0.0254, 0.06))


# Simulation


@pytest.mark.parametrize(
    "case",
    [
        Case("16 mm, near, lamp in front", 0.9, 16.0, -1.2, 1.0, pitch_deg=-4.0),
        Case("50 mm, far, lamp high", 2.0, 50.0, -0.3, 2.0, pitch_deg=3.0),
    ],
    ids=lambda case: case.name,
)
def test_simulation_measures_what_was_planned(case):
    got = noise(case, fields=500, seed=3)  # the noise is then known to 3.2 %
    assert got.ratio == pytest.approx(1.0, abs=0.1)
    assert got.place_error < 0.05
    assert abs(got.error_deg) < 1e-3


def test_simulation_sees_the_planned_range():
    case = Case("near, 16 mm, 30 lines", 0.9, 16.0, lines=30)
    expected = predicted_range(case)
    found = measured_range(case, expected, start=0.92)
    assert np.ptp(found) == pytest.approx(np.ptp(expected), rel=0.1)
    assert found == pytest.approx(expected, abs=0.1 * np.ptp(expected))


# Refusals


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '[glint.reflection]\nradius = "60 mm"\nlamp = ["0 m", "-0.6 m", "1.5 m"]\n',
            "",
            "a plan needs to know what is mirrored; give body and lamp in [glint.reflection]",
        ),
        (
            "sensor = [752, 240]\n",
            "",
            "camera.sensor is missing, so nobody knows how far the picture reaches; give it in "
            "[camera], columns and lines per field",
        ),
        (
            "lines = 92",
            "lines = 200",
            "the recorded window, lines 98 to 297, is not on the sensor of 240 lines; correct "
            "fields.first_line or plan.lines",
        ),
        (
            "[glint]\n",
            "[glint]\nsearch_window = [95, 99]\n",
            "glint.search_window [95, 99] lies beyond the 92 recorded lines; correct it, or "
            "plan.lines",
        ),
        (
            "[fields]",
            'rotation = ["0 deg", "0 deg", "180 deg"]\n[fields]',
            "the camera does not look at the plane of glint.y; check position and rotation in "
            "[camera]",
        ),
        (
            "lines = 92",
            'lines = 92\nbody = ["5 m", "6 m"]',
            "the body does not mirror the lamp to where the camera looks at zero pitch; check "
            "[glint.reflection], plan.body and plan.pivot against the camera's position",
        ),
        (
            'rate = "60 Hz"\n',
            "",
            "fields.rate is missing, and plan.vibration needs it; give it in [fields]",
        ),
    ],
)
def test_what_cannot_be_planned_is_told(old, new, message):
    text = SETUP + '[plan.vibration]\namplitude = "0.1 deg"\nfrequency = "9 Hz"\n'
    assert old in text
    with pytest.raises(SetupError, match=f"^{re.escape(message)}$"):
        make_plan(setup(text=text.replace(old, new)), with_map=False)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('angles = ["6 deg", "-6 deg"]', "plan: angles must rise; give the lower end first"),
        (
            'angles = ["-30 deg", "6 deg"]',
            "plan: angles reach beyond 20 deg, where no line is looked for; narrow them",
        ),
        (
            "peak_level = 300",
            "plan: peak_level 300 must lie above black_level plus background (25) and not above "
            "top_level (255)",
        ),
        ("roughnes = 0.1", "unknown key plan.roughnes; did you mean roughness?"),
        ("blur = -1", "plan.blur: Input should be greater than or equal to 0"),
    ],
)
def test_a_section_that_cannot_be_is_told(tmp_path, line, message):
    path = tmp_path / "glint-aoa.toml"
    path.write_text(SETUP + line + "\n")
    with pytest.raises(SetupError, match=f"^{re.escape(f'{path}: {message}')}$"):
        load_setup(path)
