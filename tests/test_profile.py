import numpy as np
import pytest
from scenes import PER_COLUMN, flags_of, measured, scene
from scipy.special import ndtr
from synthetic import line_fields

from glint_aoa.flags import Flag
from glint_aoa.optical import profile
from glint_aoa.records import fields as fields_module

U = np.linspace(-1, 1, 752)
V = np.arange(40.0)[:, None]
LIMIT = 0.0003
"""Greatest bias that is allowed [deg]."""


def against_the_bound(line, *, n_fields=80, seed=1, **glint):
    """Noise over that of an efficient slope from the same fields, its error, and the measurement.

    Both see the same noise, so the error of their ratio is that of what they do not share.
    """
    fields = line.fields(np.random.default_rng(seed), n_fields)
    slope, angles, how = measured(fields, **glint)
    efficient = line.efficient(fields, how.columns)
    ratio = np.std(slope) / np.std(efficient)
    shared = np.corrcoef(slope, efficient)[0, 1]
    return ratio, np.sqrt((1 - shared**2) / n_fields), angles, how


def bias(line, *, n_fields=40, seed=2, **glint):
    """Mean error of the angle over what noise explains, and its own error [deg]."""
    fields = line.fields(np.random.default_rng(seed), n_fields)
    slope, angles, how = measured(fields, **glint)
    error = (slope - line.efficient(fields, how.columns)) * PER_COLUMN
    return error.mean(), error.std() / np.sqrt(n_fields), angles, how


def test_where_columns_are_noisy_their_common_line_helps_each(monkeypatch):
    line = scene(row=31.27, lines=64, sigma=0.7, peak=20.0, read_noise=3.0)
    ratio, error, angles, _ = against_the_bound(line, n_fields=500, seed=5)
    assert ratio < 1.1
    assert flags_of(angles) & ~(Flag.LOW_CONTRAST | Flag.PIXEL_LOCKING) == Flag(0)
    monkeypatch.setattr(profile, "_NOISY", np.inf)
    alone, _, _, _ = against_the_bound(line, n_fields=500, seed=5)
    assert ratio < alone - error


def test_the_efficient_slope_is_at_the_bound():
    """What the other tests lean on: unbiased, and its noise that of the bound."""
    line = scene(slope=0.0007, peak=150 * (1 + 0.4 * U), background=10 + 0.5 * V)
    fields = line.fields(np.random.default_rng(3), 300)
    columns = np.arange(10, 752, 20)
    error = line.efficient(fields, columns) - 0.0007
    assert error.std() / line.bound(columns) == pytest.approx(1, abs=4 / np.sqrt(2 * 300))
    assert abs(error.mean()) < 4 * line.bound(columns) / np.sqrt(300)


@pytest.mark.parametrize("sigma", [0.7, 1.4, 4.0])
@pytest.mark.parametrize("slope", [0.0, 0.0005, 0.01])
def test_noise_is_near_the_bound(sigma, slope):
    line = scene(
        slope=slope, sigma=sigma, lines=60 if sigma > 2 else 40, row=20.3 if sigma < 2 else 30.3
    )
    ratio, error, angles, how = against_the_bound(line)
    assert how.estimator.name == "profile"
    assert error < 0.03
    assert ratio + 2 * error < 1.10
    assert flags_of(angles) == 0


@pytest.mark.parametrize(
    ("peak", "read_noise"), [(20.0, 0.5), (20.0, 3.0), (60.0, 3.0), (240.0, 0.5), (240.0, 3.0)]
)
def test_noise_is_near_the_bound_at_any_contrast(peak, read_noise):
    line = scene(slope=0.0005, peak=peak, read_noise=read_noise)
    ratio, error, _, how = against_the_bound(line)
    assert how.estimator.name == "profile"
    assert error < 0.03
    assert ratio + 2 * error < 1.10


def test_noise_is_near_the_bound_with_all_columns():
    ratio, error, _, how = against_the_bound(scene(slope=0.01), n_fields=64, column_step=1)
    assert how.columns.size == 752
    assert ratio + 2 * error < 1.10


@pytest.mark.parametrize("sigma", [0.7, 1.4])
def test_noise_is_near_the_bound_with_a_learnt_profile(sigma):
    """A moving line has no single scene: the bound is taken at each field's own place."""
    rng = np.random.default_rng(4)
    rows = 20 + rng.uniform(-1, 1, 300)
    lines = {"shape": (40, 400), "slope": 0.0, "sigma": sigma}
    fields = line_fields(rng, n_fields=300, row=rows, **lines)
    slope, angles, how = measured(fields, column_step=10)
    assert how.estimator.settings["profile_source"] == "learnt"
    bounds = [scene(row=row, sigma=sigma, columns=400).bound(how.columns) for row in rows]
    # 300 fields show their noise to 4.1 %.
    assert (slope / bounds).std() < 1.10
    assert abs(slope.mean()) < 4 * np.mean(bounds) / np.sqrt(300)
    assert flags_of(angles) == 0


@pytest.mark.parametrize(("sigma", "slope"), [(0.7, 0.003), (1.4, 0.0), (1.4, 0.0007)])
@pytest.mark.parametrize("row", [20.0, 20.25, 20.5])
def test_no_phase_of_the_line_biases_it(row, slope, sigma):
    error, known_to, _, _ = bias(scene(row=row, slope=slope, sigma=sigma))
    assert known_to < 0.1 * LIMIT
    assert abs(error) + 2 * known_to < LIMIT


BACKGROUNDS = {
    "grows down the window": 10 + 1.0 * V + 0 * U,
    "grows down on the left and up on the right": 40 + 1.0 * (V - 20) * U,
    "twice as bright below the line": "step",
}


@pytest.mark.parametrize("slope", [0.0007, 0.003, 0.01])
@pytest.mark.parametrize("background", list(BACKGROUNDS))
def test_no_background_biases_it(background, slope):
    light = BACKGROUNDS[background]
    if isinstance(light, str):  # it lies along the line and belongs to it
        light = 10 + 10 * ndtr((V - 20.3 - slope * 375.5 * U) / 1.4)
    error, known_to, _, how = bias(scene(slope=slope, background=light))
    assert how.estimator.name == "profile"
    assert known_to < 0.1 * LIMIT
    assert abs(error) + 2 * known_to < LIMIT


@pytest.mark.parametrize("slope", [0.0007, 0.01])
@pytest.mark.parametrize("along", [0.4 * U, 0.4 * np.sin(7 * U + 1)], ids=["growing", "wavy"])
def test_no_brightness_along_the_line_biases_it(along, slope):
    error, known_to, _, _ = bias(scene(slope=slope, peak=150 * (1 + along)))
    assert known_to < 0.1 * LIMIT
    assert abs(error) + 2 * known_to < LIMIT


@pytest.mark.parametrize("slope", [0.0007, 0.01])
@pytest.mark.parametrize(("peak", "clipped"), [(260.0, 1), (300.0, 2), (400.0, 3)])
def test_clipped_lines_do_not_bias_it(peak, clipped, slope):
    line = scene(slope=slope, peak=peak)
    assert (line.image[:, 376] >= 254.5).sum() == clipped
    error, known_to, angles, _ = bias(line, n_fields=80)
    assert known_to < 0.25 * LIMIT
    assert abs(error) + 2 * known_to < LIMIT
    assert flags_of(angles) == Flag.SATURATED


def test_clipped_lines_do_not_bias_it_at_the_worst_phase():
    """Along the line the number of clipped lines changes once, and with it a centroid's error."""
    error, known_to, _, _ = bias(scene(slope=0.0007, row=20.0, peak=330.0), n_fields=80)
    assert abs(error) + 2 * known_to < LIMIT


def test_a_profile_is_learnt_where_the_phases_are_covered():
    rng = np.random.default_rng(5)
    shape = (40, 400)
    for row, slope, source in (
        (20.3, 0.0, "parametric"),
        (20 + rng.uniform(-1, 1, 64), 0.0, "learnt"),
        (20.3, 0.0171, "parametric"),  # each column has a phase of its own, and only that
    ):
        fields = line_fields(rng, n_fields=64, shape=shape, row=row, slope=slope)
        _, _, how = measured(fields, column_step=10, estimator="profile")
        assert how.estimator.settings["profile_source"] == source


def test_the_parametric_model_is_the_gaussian_that_it_is():
    _, _, _, how = against_the_bound(scene(row=20.3, sigma=1.4))
    settings = how.estimator.settings
    assert settings["profile_model"] == "Gaussian (1.4)"
    assert settings["profile_misfit"] == pytest.approx(1, abs=0.05)
    assert how.estimator.profile.curve(0.0) == pytest.approx(1, abs=1e-6)


def test_a_learnt_profile_is_that_of_the_line():
    """A flat-topped line with soft shoulders, which no Gaussian can follow."""
    rng = np.random.default_rng(6)
    edges = np.arange(41)[:, None] - 0.5
    rows = 20 + rng.uniform(-1, 1, 64)

    def box(centre):  # a bar of three lines, blurred by 0.6, integrated over pixels
        def ramp(t):
            x = t / 0.6
            return t * ndtr(x) + 0.6 * np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)

        step = ramp(edges - centre + 1.5) - ramp(edges - centre - 1.5)
        return np.diff(step, axis=0)

    image = np.stack([10 + 150 * np.repeat(box(row), 400, axis=1) for row in rows])
    fields = np.round(rng.normal(image, 1.0)).astype(np.uint8)
    slope, _, how = measured(fields, column_step=10, estimator="profile")
    assert how.estimator.settings["profile_source"] == "learnt"
    t = np.linspace(-3, 3, 13)
    expected = np.array([box(20 - each)[20, 0] for each in t])
    found = how.estimator.profile.curve(t)
    np.testing.assert_allclose(found / found[6], expected / expected[6], atol=0.01)
    assert abs(slope.mean()) < 4 * slope.std() / np.sqrt(64)


def test_columns_that_differ_are_left_to_the_centroid():
    """A line whose width doubles along it has no profile that its columns share."""
    sigma = 1.2 + 0.6 * (1 + U)
    line = scene(row=20.3, slope=0.003, sigma=sigma, peak=120)
    fields = line.fields(np.random.default_rng(7), 64)
    _, _, left = measured(fields)
    assert left.estimator.name == "centroid"
    _, _, asked = measured(fields, estimator="profile")
    assert asked.estimator.name == "profile"
    assert asked.estimator.settings["profile_misfit"] > 2


@pytest.mark.parametrize("estimator", ["profile", "centroid"])
def test_threads_and_blocks_do_not_change_a_bit(monkeypatch, estimator):
    fields = line_fields(
        np.random.default_rng(8), n_fields=83, shape=(40, 400), row=20.3, slope=0.01
    )
    whole, angles, _ = measured(fields, estimator=estimator)
    for threads, few in ((2, 7), (3, 10), (1, 1)):
        monkeypatch.setattr(fields_module, "BLOCK_BYTES", few * fields[0].nbytes)
        again, others, _ = measured(fields, threads=threads, estimator=estimator)
        np.testing.assert_array_equal(again, whole)
        np.testing.assert_array_equal(others.angle_std, angles.angle_std)
        np.testing.assert_array_equal(others.flags, angles.flags)


def test_a_bent_line_is_told():
    """A sagitta of half a line, from lens distortion or a bent body."""
    rng = np.random.default_rng(9)
    bend = 0.5 * (U**2 - 1 / 3)
    line = scene(slope=0.003)
    bent = scene_along(bend, slope=0.003)
    assert Flag.CURVED_LINE in flags_of(measured(bent.fields(rng, 40))[1])
    assert Flag.CURVED_LINE not in flags_of(measured(line.fields(rng, 40))[1])


def scene_along(departure, **kwargs):
    """A scene whose line departs from a straight one [lines], column by column."""
    each, index = np.unique(np.round(departure, 2), return_inverse=True)
    parts = [scene(**(kwargs | {"row": 20.3 + off})) for off in each]
    image = np.stack([parts[k].image[:, i] for i, k in enumerate(index)], axis=1)
    gradient = np.stack([parts[k].gradient[:, i] for i, k in enumerate(index)], axis=1)
    first = parts[0]
    return type(first)(image, gradient, first.row, first.slope, first.read_noise)


def test_lasting_departures_that_leave_doubt_are_told():
    """Columns that lie off in stretches: the slope is no longer known to the fields' noise."""
    rng = np.random.default_rng(10)
    errors, doubts = [], []
    for _ in range(8):
        off = np.repeat(rng.normal(0, 0.15, 10), 40)
        fields = scene_along(off, slope=0.003, columns=400).fields(rng, 16)
        slope, angles, how = measured(fields, column_step=10)
        assert Flag.UNEVEN in flags_of(angles)
        errors.append(np.arctan(slope.mean() * 27.5 / 11.7) - np.arctan(0.003 * 27.5 / 11.7))
        doubts.append(how.slope_doubt)
    # What looks like slope is not seen as a departure: the doubt is too small, by a factor of two.
    rms = np.sqrt(np.mean(np.square([errors, doubts]), axis=1))
    assert 0.8 < rms[0] / rms[1] < 2.5


def test_a_second_line_nearly_as_bright_is_told():
    rng = np.random.default_rng(11)
    for share, told in ((0.9, True), (0.6, False)):
        second = scene(row=48.4, lines=70, peak=100 * share).image - 10
        fields = scene(row=20.3, lines=70, peak=100, background=10 + second).fields(rng, 40)
        assert (Flag.SECOND_GLINT in flags_of(measured(fields)[1])) == told


def test_a_line_too_faint_to_be_sure_of_is_told():
    rng = np.random.default_rng(12)
    faint = measured(scene(peak=12.0, read_noise=3.0).fields(rng, 40))[1]
    assert (np.degrees(faint.angle_std) > 0.01).any()
    assert Flag.LOW_CONTRAST in flags_of(faint)
    clear = measured(scene(peak=60.0, read_noise=1.0).fields(rng, 40))[1]
    assert flags_of(clear) == 0


@pytest.mark.parametrize(("peak", "read_noise"), [(170.0, 0.7), (20.0, 2.0)])
def test_the_stated_noise_covers_what_it_should(peak, read_noise):
    """Of 600 fields: 68 % within one and 95 % within two standard deviations."""
    n = 600
    line = scene(slope=0.0007, peak=peak, read_noise=read_noise, lines=30, row=15.3, columns=400)
    fields = line.fields(np.random.default_rng(13), n)
    slope, angles, how = measured(fields, column_step=10)
    std = angles.angle_std * np.cos(angles.angle) ** 2
    pull = np.abs(np.arctan(slope * 27.5 / 11.7) - np.arctan(0.0007 * 27.5 / 11.7)) / std
    for width, share in ((1.0, 0.6827), (1.96, 0.95)):
        error = np.sqrt(share * (1 - share) / n)
        assert (pull < width).mean() == pytest.approx(share, abs=3 * error)
    assert how.knows_noise
