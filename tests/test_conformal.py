"""The conformal transformation: rotation, shift and scale with their covariance."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calibration.twist.conformal import fit_conformal
from glint_aoa.errors import CalibrationError

STD = 5e-6
NOISE = np.tile(STD**2 * np.array([[2.0, 0.3], [0.3, 1.0]]), (6, 1, 1))
CHORD = np.array([[-0.12, 0.01], [-0.07, 0.0], [-0.02, 0.012], [0.03, -0.01], [0.08, 0], [0.13, 0]])


def turned(points, angle, shift=(0.0, 0.0), scale=1.0):
    matrix = Rotation.from_euler("z", angle).as_matrix()[:2, :2]
    return scale * points @ matrix.T + np.asarray(shift)


def drawn(rng, points, noise=NOISE):
    return points + np.einsum(
        "nij,nj->ni", np.linalg.cholesky(noise[: len(points)]), rng.standard_normal(points.shape)
    )


@given(
    angle=st.floats(-3.0, 3.0),
    shift=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    scale=st.floats(0.5, 2.0),
)
def test_what_was_done_is_found(angle, shift, scale):
    fit = fit_conformal(CHORD, turned(CHORD, angle, shift), NOISE, NOISE)
    assert fit.rotation == pytest.approx(angle, abs=1e-9)
    middle = CHORD.mean(axis=0)
    assert fit.shift == pytest.approx(turned(middle, angle, shift) - middle, abs=1e-9)
    assert fit.scale == 1.0
    assert fit.used.all()
    free = fit_conformal(CHORD, turned(CHORD, angle, shift, scale), NOISE, NOISE, free_scale=True)
    assert free.rotation == pytest.approx(angle, abs=1e-9)
    assert free.scale == pytest.approx(scale, abs=1e-9)


def test_the_direction_from_the_first_axis_to_the_second_is_positive():
    end = np.array([[0.0, 0.0], [0.0, 1.0]])
    start = np.array([[0.0, 0.0], [1.0, 0.0]])
    fit = fit_conformal(start, end, NOISE[:2], NOISE[:2])
    assert fit.rotation == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("free_scale", [False, True])
def test_it_is_the_minimum_that_scipy_finds(free_scale):
    rng = np.random.default_rng(1)
    start, end = drawn(rng, CHORD), drawn(rng, turned(CHORD, 0.05, (0.01, 0.02)))
    before = NOISE * np.arange(1, 7)[:, None, None]
    fit = fit_conformal(start, end, before, NOISE, free_scale=free_scale)

    def residuals(parameters):
        angle, scale = parameters[0], parameters[3] if free_scale else 1.0
        left = end - turned(start, angle, parameters[1:3], scale)
        # the weights belong to the solution, as in Gauss and Newton's steps
        noise = NOISE + matrix_of_fit @ before @ matrix_of_fit.T
        return np.einsum("nij,nj->ni", np.linalg.cholesky(np.linalg.inv(noise)).mT, left).ravel()

    matrix_of_fit = turned(np.eye(2), fit.rotation, scale=fit.scale).T
    theirs = least_squares(residuals, [0.05, 0.01, 0.02, 1.0][: 4 if free_scale else 3], xtol=1e-15)
    assert fit.rotation == pytest.approx(theirs.x[0], abs=1e-10)
    assert fit.chi_square == pytest.approx(2 * theirs.cost, rel=1e-6)
    covariance = np.linalg.inv(theirs.jac.T @ theirs.jac)
    assert fit.rotation_std == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-4)
    if free_scale:
        assert fit.scale == pytest.approx(theirs.x[3], abs=1e-10)
    assert fit.degrees_of_freedom == 12 - len(theirs.x)


def test_intervals_and_outliers_by_chance():
    """Of 300 draws 95 % hold the truth and about 1 % lose a point without need."""
    rng = np.random.default_rng(2)
    held, lost, scaled = 0, 0, 0
    for _ in range(300):
        fit = fit_conformal(drawn(rng, CHORD), drawn(rng, turned(CHORD, 0.02)), NOISE, NOISE)
        held += abs(fit.rotation - 0.02) <= fit.rotation_u95
        lost += not fit.used.all()
        scaled += fit.excess > 1
    assert 0.92 < held / 300 < 0.975
    assert lost <= 9
    assert scaled <= 9


def test_a_point_that_slipped_is_named_and_left_out():
    rng = np.random.default_rng(3)
    end = turned(drawn(rng, CHORD), 0.03)
    end[2] += [0.0, 2e-4]
    fit = fit_conformal(drawn(rng, CHORD), end, NOISE, NOISE)
    assert fit.used.tolist() == [True, True, False, True, True, True]
    assert abs(fit.rotation - 0.03) < 4 * fit.rotation_std
    assert fit.residuals[2] == pytest.approx([0.0, 2e-4], abs=3e-5)
    assert fit.rms < 2e-5


def test_noise_that_is_larger_than_stated_scales_the_covariance():
    rng = np.random.default_rng(4)
    start, end = drawn(rng, CHORD, 25 * NOISE), drawn(rng, turned(CHORD, 0.03), 25 * NOISE)
    fit = fit_conformal(start, end, NOISE, NOISE)
    honest = fit_conformal(start, end, 25 * NOISE, 25 * NOISE)
    assert honest.excess == 1.0
    assert fit.used.all()
    assert fit.excess == pytest.approx(fit.chi_square / 9)
    assert fit.excess == pytest.approx(25 * honest.chi_square / 9, rel=1e-6)
    assert fit.rotation_u95 > 2.2 * fit.rotation_std  # Student's t
    assert honest.rotation_u95 == pytest.approx(1.959964 * honest.rotation_std)


def test_two_points_suffice_and_leave_one_degree_of_freedom():
    rng = np.random.default_rng(5)
    fit = fit_conformal(CHORD[[0, 5]], drawn(rng, CHORD[[0, 5]]), NOISE[:2], NOISE[:2])
    assert fit.degrees_of_freedom == 1
    free = fit_conformal(
        CHORD[[0, 5]], drawn(rng, CHORD[[0, 5]]), NOISE[:2], NOISE[:2], free_scale=True
    )
    assert free.degrees_of_freedom == 0
    assert free.excess == 1.0


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            CHORD[:1],
            "a rotation needs two points or more, got 1; measure more targets",
        ),
        (
            np.zeros((3, 2)),
            "all points lie in one place, which has no direction; measure targets that are apart",
        ),
    ],
)
def test_refusals(points, message):
    with pytest.raises(CalibrationError, match=f"^{re.escape(message)}$"):
        fit_conformal(points, points, NOISE[: len(points)], NOISE[: len(points)])
