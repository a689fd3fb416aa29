"""The smoother against closed forms: dense Gaussian conditionals, Riccati, integrals."""

import numpy as np
import pytest
import scipy.linalg

from glint_aoa.fusion._kernel import filtered
from glint_aoa.fusion.oscillators import STATES, Coordinate, Oscillators, fit_coordinate
from glint_aoa.fusion.slow import slow_angle
from glint_aoa.fusion.smoother import Beliefs, Measurements, smooth

RATE_HZ = 800.0
HEAVE = Coordinate(1.0, 0.0, 9.3, 9.0, 0.4)
TURNING = Coordinate(0.0, 1.0, 9.1, 12.0, 0.7)
MODEL = Oscillators((HEAVE, TURNING), RATE_HZ, drift=0.01, start_std=0.02)
SAMPLES = 14


def measured(rng, *, informs=True):
    """Two accelerometers with gaps and a few angles; three unknowns."""
    found = []
    for name, row, spoilt in (
        ("face", MODEL.row(2, heave=1.0), {3, 4}),
        ("aft", MODEL.row(2, heave=1.0, turning=-0.8), {0}),
        ("angle", MODEL.angle_rows(np.array([2e-4]), 1e-3)[0], set(range(SAMPLES)) - {2, 9}),
    ):
        at = np.array([t for t in range(SAMPLES) if t not in spoilt])
        found.append(
            Measurements(
                source=name,
                sample=at,
                rows=row[None],
                kind=np.zeros(at.size, np.int64),
                value=rng.normal(0.0, 1e-2, at.size),
                regressors=rng.normal(0.0, 1.0, (at.size, 3)),
                variance=rng.uniform(0.5, 2.0, at.size) * 1e-4,
                informs=np.full(3, informs),
            )
        )
    return found


def dense(measurements, beliefs):
    """Posterior of all states and unknowns from one joint covariance."""
    transition, process, start = MODEL.matrices
    n = MODEL.size
    prior = np.zeros((SAMPLES * n, SAMPLES * n))
    spread = start
    for t in range(SAMPLES):
        block = spread
        for later in range(t, SAMPLES):
            prior[later * n : (later + 1) * n, t * n : (t + 1) * n] = block
            prior[t * n : (t + 1) * n, later * n : (later + 1) * n] = block.T
            block = transition @ block
        spread = transition @ spread @ transition.T + process
    joint = scipy.linalg.block_diag(prior, beliefs.covariance)
    mean = np.concatenate([np.zeros(SAMPLES * n), beliefs.mean])
    rows, values, variances = [], [], []
    for each in measurements:
        for index, t in enumerate(each.sample):
            row = np.zeros(mean.size)
            row[t * n : (t + 1) * n] = each.rows[each.kind[index]]
            row[SAMPLES * n :] = each.regressors[index]
            rows.append(row)
            values.append(each.value[index])
            variances.append(each.variance[index])
    h = np.array(rows)
    expected = h @ joint @ h.T + np.diag(variances)
    gain = np.linalg.solve(expected, h @ joint).T
    return mean + gain @ (np.array(values) - h @ mean), joint - gain @ h @ joint


def test_smoother_is_the_dense_gaussian_conditional():
    measurements = measured(np.random.default_rng(1))
    beliefs = Beliefs(np.array([0.01, 0.0, -0.02]), np.diag([1e-4, 4e-4, 1e-3]))
    seen = np.stack([MODEL.row(0, turning=1.0) + np.eye(MODEL.size)[-1], MODEL.row(1, heave=1.0)])
    found = smooth(MODEL, measurements, beliefs, samples=SAMPLES, seen=seen)
    mean, covariance = dense(measurements, beliefs)
    n = MODEL.size
    np.testing.assert_allclose(found.unknowns.mean, mean[SAMPLES * n :], rtol=1e-6)
    at = slice(SAMPLES * n, None)
    np.testing.assert_allclose(found.unknowns.covariance, covariance[at, at], rtol=1e-6)
    got = found.columns[:, :, 0] - found.columns[:, :, 1:] @ found.unknowns.mean
    sensitive = found.columns[:, :, 1:]
    spread = found.spread + sensitive @ found.unknowns.covariance @ sensitive.transpose(0, 2, 1)
    for t in range(SAMPLES):
        here = slice(t * n, (t + 1) * n)
        np.testing.assert_allclose(got[t], seen @ mean[here], rtol=1e-6, atol=1e-10)
        wanted = seen @ covariance[here, here] @ seen.T
        np.testing.assert_allclose(spread[t], wanted, rtol=1e-5, atol=1e-9 * wanted.max())


def test_what_may_not_inform_leaves_the_unknowns_alone():
    beliefs = Beliefs(np.array([0.01, 0.0, -0.02]), np.diag([1e-4, 4e-4, 1e-3]))
    measurements = measured(np.random.default_rng(1), informs=False)
    found = smooth(MODEL, measurements, beliefs, samples=SAMPLES, seen=np.eye(MODEL.size)[:1])
    np.testing.assert_allclose(found.unknowns.mean, beliefs.mean, rtol=1e-9)
    np.testing.assert_allclose(found.unknowns.covariance, beliefs.covariance, rtol=1e-9)


def test_filter_settles_on_the_riccati_equation():
    model = Oscillators((TURNING,), RATE_HZ)
    transition, process, start = model.matrices
    row, variance = model.row(2, turning=1.0), 1e-4
    samples = 6000
    _, spread, *_ = filtered(
        transition,
        process,
        np.zeros((STATES, 1)),
        start,
        np.arange(samples),
        np.zeros(samples, np.int64),
        row[None],
        np.zeros((samples, 1)),
        np.full(samples, variance),
        samples,
    )
    settled = scipy.linalg.solve_discrete_are(
        transition.T, row[:, None], process, np.array([[variance]])
    )
    for each in (row, model.row(0, turning=1.0), model.row(1, turning=1.0)):
        assert each @ spread[-1] @ each == pytest.approx(each @ settled @ each, rel=1e-4)


def test_coordinates_are_stationary_with_the_force_they_are_given():
    transition, process, start = Oscillators((TURNING,), RATE_HZ).matrices
    np.testing.assert_allclose(
        transition @ start @ transition.T + process, start, rtol=1e-9, atol=1e-12 * start.max()
    )
    assert np.sqrt(start[2, 2]) == pytest.approx(TURNING.force_std)
    assert np.linalg.eigvalsh(process).min() > -1e-12 * process.max()


def test_the_mean_over_an_exposure_is_that_of_the_motion():
    model = Oscillators((TURNING,), RATE_HZ)
    state = np.array([0.3, 2.0, 40.0, 0.0, 0.0])
    exposure, ahead = 1e-3, 3e-4
    steps = ahead + (np.arange(400) + 0.5) / 400 * exposure - exposure / 2
    exact = np.mean(model.angle_rows(steps, 0.0) @ state)
    assert model.angle_rows(np.array([ahead]), exposure)[0] @ state == pytest.approx(
        exact, rel=1e-7
    )


def test_acceleration_is_the_second_derivative_of_the_displacement():
    model = Oscillators((HEAVE, TURNING), RATE_HZ)
    rng = np.random.default_rng(2)
    state = rng.normal(size=model.size)
    step = 1e-4
    before, now, after = model.angle_rows(np.array([-step, 0.0, step]), 0.0) @ state
    assert (after - 2 * now + before) / step**2 == pytest.approx(
        model.row(2, turning=1.0) @ state, rel=1e-3
    )
    assert (after - before) / (2 * step) == pytest.approx(
        model.row(1, turning=1.0) @ state, rel=1e-3
    )


@pytest.mark.parametrize("frequency_hz", [9.2, 30.0])
def test_the_spring_of_a_sine_is_its_frequency(frequency_hz):
    time = np.arange(3200) / RATE_HZ
    noise = np.random.default_rng(3).normal(0.0, 1e-3, time.size)
    signal = 5.0 * np.sin(2 * np.pi * frequency_hz * time) + noise
    found = fit_coordinate(signal, 1e-6, RATE_HZ, heave=1.0, turning=0.0)
    assert found.frequency_hz == pytest.approx(frequency_hz, rel=0.005)
    assert found.force_std < 0.1 * np.std(signal)


def slow(rng, *, drift=0.0, samples=24_000):
    """Angle of a package with white noise, a strong vibration and a random walk."""
    time = np.arange(samples) / RATE_HZ
    walk = np.cumsum(rng.normal(0.0, drift / np.sqrt(RATE_HZ), samples))
    angle = walk + 5e-5 * rng.normal(size=samples) + 5e-3 * np.sin(2 * np.pi * 9.2 * time)
    columns = np.column_stack([angle, np.ones(samples)])
    beliefs = Beliefs(np.zeros(1), np.eye(1) * 1e-6)
    return walk, slow_angle(columns, RATE_HZ, beliefs)


def test_windows_keep_the_vibration_out_and_know_their_noise():
    _, found = slow(np.random.default_rng(4))
    # Blackman and Harris' window of a second has a noise bandwidth of 2 Hz
    white = 5e-5 * np.sqrt(2.0 / RATE_HZ)
    assert np.sqrt(found.variance) == pytest.approx(white, rel=0.3)
    assert np.std(found.columns[:, 0]) == pytest.approx(white, rel=0.3)
    assert found.drift == pytest.approx(np.radians(5e-5), rel=1e-9)


def test_a_drift_is_found_from_the_scatter_of_the_windows():
    drift = 2e-4
    walk, found = slow(np.random.default_rng(5), drift=drift)
    assert found.drift == pytest.approx(drift, rel=0.5)
    left = found.columns[:, 0] - walk[found.sample]
    assert np.std(left) < 0.5 * np.std(walk[found.sample])
