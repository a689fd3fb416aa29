"""Corners of a chessboard: closed form, phases of the pixels, what is no corner."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from calibration.camera._corner_fit import fit_corners

HALF = (9, 4)
ASPECT = 27.5 / 11.7


def integral_of_edge(t, sigma):
    """Integral of 2 Phi(t / sigma) - 1."""
    return t * (2 * ndtr(t / sigma) - 1) + np.sqrt(2 / np.pi) * sigma * np.exp(
        -0.5 * (t / sigma) ** 2
    )


def upright_corner(at, *, size=(60, 30), sigma=0.6, aspect=ASPECT, contrast=80.0):
    """Edges along columns and lines: the product separates, and so does the pixel's area."""
    parts = []
    for place, n, scale in zip(at, size, (1.0, aspect), strict=True):
        ends = (np.arange(n + 1) - 0.5 - place) * scale
        parts.append(np.diff(integral_of_edge(ends, sigma)) / scale)
    return (120 + contrast * np.outer(parts[1], parts[0])).astype(np.float32)


def crossed(at, edges, *, size=(60, 30), aspect=ASPECT, parts=(7, 15), light=(0, 0), contrast=80.0):
    """Any two edges, in many more parts of a pixel than the fit's."""
    u, v = (
        ((np.arange(n * k) + 0.5) / k - 0.5 - place)
        for n, k, place in zip(size, parts, at, strict=True)
    )
    x, y = u[None, :], v[:, None] * aspect
    product = np.prod([2 * ndtr((np.cos(a) * y - np.sin(a) * x) / 0.6) - 1 for a in edges], axis=0)
    grey = (120 + contrast * product) * (1 + light[0] * u[None, :] + light[1] * v[:, None])
    return grey.reshape(size[1], parts[1], size[0], parts[0]).mean(axis=(1, 3)).astype(np.float32)


def fit(picture, start, edges, *, aspect=ASPECT, half=HALF):
    return fit_corners(picture, np.atleast_2d(start), np.atleast_2d(edges), half, aspect)


@settings(max_examples=15)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0.4, 1.5))
def test_upright_edges_come_back_at_every_phase_of_the_pixels(du, dv, sigma):
    at = np.array([30.0 + du, 14.0 + dv])
    found = fit(upright_corner(at, sigma=sigma), [30.3, 13.8], [0.02, np.pi / 2 - 0.03])
    assert found.good.all()
    np.testing.assert_allclose(found.points[0], at, atol=5e-4)
    assert found.blur[0] == pytest.approx(sigma, rel=0.1)  # parts of a pixel blur, too


@settings(max_examples=15)
@given(
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(0, np.pi),
    st.floats(np.radians(60), np.radians(120)),
    st.booleans(),
)
def test_turned_edges_come_back_under_uneven_light(du, dv, first, between, dark):
    at, edges = np.array([30.0 + du, 14.0 + dv]), (first, first + between)
    picture = crossed(at, edges, light=(0.01, -0.02), contrast=-80.0 if dark else 80.0)
    found = fit(picture, [30.0, 14.0], [edges[0] + 0.05, edges[1] - 0.04])
    assert found.good.all()
    np.testing.assert_allclose(found.points[0], at, atol=4e-3)


def test_square_pixels():
    at, edges = (20.3, 19.6), (0.4, 2.1)
    picture = crossed(at, edges, size=(40, 40), aspect=1.0, parts=(15, 15))
    found = fit(picture, [20, 20], edges, aspect=1.0, half=(7, 7))
    np.testing.assert_allclose(found.points[0], at, atol=1e-3)


def test_noise_averages_as_the_information_says():
    """Scatter over many fits against the Cramer-Rao bound of the same window."""
    rng = np.random.default_rng(4)
    at, edges, noise = np.array([30.2, 14.1]), (0.3, 1.9), 2.0
    clean = crossed(at, edges)
    n = 100
    noisy = np.tile(clean, n) + noise * rng.standard_normal((30, 60 * n))
    middles = np.column_stack([60 * np.arange(n), np.zeros(n)])
    found = fit_corners(
        noisy.astype(np.float32), at + middles, np.tile(edges, (n, 1)), HALF, ASPECT
    )
    off = found.points - middles
    step = 1e-2
    window = np.s_[10:19, 21:40]
    slopes = [
        (crossed(at + d, edges) - crossed(at - d, edges))[window].ravel() / (2 * step)
        for d in (np.array([step, 0]), np.array([0, step]))
    ]
    bound = noise * np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T)))
    scatter = off.std(axis=0, ddof=1)
    assert np.all(scatter > 0.85 * bound)
    assert np.all(scatter < 1.8 * bound)  # seven more unknowns, and less weight to the rim
    assert np.all(np.abs(off.mean(axis=0) - at) < 4 * scatter / np.sqrt(n))


def test_each_corner_is_fitted_on_its_own():
    picture = np.hstack([upright_corner((30.2, 14.3)), upright_corner((29.7, 13.9), contrast=-60)])
    starts = np.array([[30.0, 14.0], [90.0, 14.0]])
    found = fit_corners(picture, starts, np.tile([0.0, np.pi / 2], (2, 1)), HALF, ASPECT)
    np.testing.assert_allclose(found.points, [[30.2, 14.3], [89.7, 13.9]], atol=3e-3)


class TestNoCorner:
    def test_a_window_that_leaves_the_picture(self):
        picture = upright_corner((5.0, 14.0))
        found = fit(picture, [5.0, 14.0], [0.0, np.pi / 2])
        assert not found.good.any()
        np.testing.assert_array_equal(found.points, [[5.0, 14.0]])
        assert np.isnan(found.blur).all()

    @pytest.mark.parametrize("kind", ["flat", "edge", "noise", "glare"])
    def test_pixels_that_are_not_like_a_corners(self, kind):
        picture = upright_corner((30.0, 14.0))
        if kind == "flat":
            picture[:] = 100
        elif kind == "edge":
            picture = np.where(np.arange(60) > 30, 200, 40) * np.ones((30, 1), np.float32)
        elif kind == "noise":
            picture = np.random.default_rng(1).uniform(0, 255, picture.shape)
        else:
            picture[12:16, 24:34] = 255
        found = fit(picture.astype(np.float32), [30.0, 14.0], [0.0, np.pi / 2])
        assert not found.good.any()
        np.testing.assert_array_equal(found.points, [[30.0, 14.0]])

    def test_a_corner_far_from_where_it_should_be(self):
        picture = crossed((35.5, 14.0), (0.3, 1.9))
        assert not fit(picture, [30.0, 14.0], [0.3, 1.9]).good.any()
