"""Parametric profiles of a line, and how they are fitted."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import approx_fprime
from scipy.special import ndtr

from glint_aoa.optical._line_models import GAUSSIAN, RICHER, edge
from glint_aoa.optical._profile_fit import Bins, ProfileFit, best_fit, gaussian, refined

BAND, SKIRTED = RICHER
T = np.linspace(-6.3, 6.1, 41)
FIGURES = {"Gaussian": (1.3,), "band": (1.7, 0.5, 0.9), "skirted": (0.8, 0.2, 0.4, 2.5)}


@pytest.mark.parametrize("model", [GAUSSIAN, *RICHER], ids=lambda model: model.name)
def test_derivatives_are_those_of_the_profile(model):
    figures = np.array(FIGURES[model.name])
    _, along, by_figures = model.parts(T, *figures)
    for k, t in enumerate(T):
        numerical = approx_fprime(
            np.array([t, *figures]),
            lambda p: float(model.parts(np.array([p[0]]), *p[1:])[0][0]),
            1e-7,
        )
        np.testing.assert_allclose([along[k], *by_figures[:, k]], numerical, atol=2e-6)


@pytest.mark.parametrize(
    ("model", "density"),
    [
        (GAUSSIAN, lambda t: np.exp(-0.5 * (t / 1.3) ** 2)),
        (BAND, lambda t: ndtr((t + 1.7) / 0.5) - ndtr((t - 1.7) / 0.9)),
    ],
    ids=["Gaussian", "band"],
)
def test_profiles_are_integrated_over_pixels(model, density):
    expected = [quad(density, t - 0.5, t + 0.5)[0] for t in T]
    np.testing.assert_allclose(
        model.parts(T, *FIGURES[model.name])[0], expected, rtol=1e-9, atol=1e-12
    )


def test_an_edge_rises_from_nothing_to_one():
    assert edge(np.array([-9.0, 0.0, 9.0]), 0.5) == pytest.approx([0.0, 0.5, 1.0], abs=1e-12)


def seen(model, figures, *, noise=1e-3, seed=0):
    """Bins that show a profile of height 2 on a level of 0.3."""
    error = noise * np.random.default_rng(seed).standard_normal(T.size)
    true = ProfileFit(model, np.array(figures))
    return Bins(T, 0.3 + 2.0 * true.curve(T) + error, np.full(T.size, noise**-2.0))


@pytest.mark.parametrize("model", [GAUSSIAN, *RICHER], ids=lambda model: model.name)
def test_the_profile_that_is_shown_is_found_again(model):
    figures = np.array([0.2, *FIGURES[model.name]])
    fit = refined(seen(model, figures), ProfileFit(model, np.array([0.0, *model.start])))
    np.testing.assert_allclose(fit.figures, figures, atol=0.02)
    assert fit.misfit == pytest.approx(T.size, abs=4 * np.sqrt(2 * T.size))


@pytest.mark.parametrize("model", [GAUSSIAN, *RICHER], ids=lambda model: model.name)
def test_the_simplest_profile_that_explains_the_sample_is_taken(model):
    bins = seen(model, [0.0, *FIGURES[model.name]], noise=3e-4)
    assert best_fit(bins, gaussian(1.0)).model is model
