"""Fitting parametric profiles to the pixels of many columns, brought together in fine bins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from glint_aoa.optical._line_models import GAUSSIAN, RICHER, LineModel

__all__ = ["Bins", "ProfileFit", "best_fit", "gaussian", "height_and_level", "refined"]

_Array = NDArray[np.float64]

_MOST_STEPS = 40


@dataclass(frozen=True)
class Bins:
    """Means in fine bins of the distance from the line, and their weights."""

    t: _Array
    value: _Array
    weight: _Array


@dataclass(frozen=True)
class ProfileFit:
    """A parametric profile with its centre and figures, and the sum of squares that it leaves."""

    model: LineModel
    figures: _Array
    misfit: float = np.inf

    def curve(self, t: _Array) -> _Array:
        """Return the profile at `t` lines, its centre at the first figure."""
        return self.model.parts(t - self.figures[0], *self.figures[1:])[0]

    def __str__(self) -> str:
        told = ", ".join(f"{each:.3g}" for each in self.figures[1:])
        return f"{self.model.name} ({told})"


def gaussian(sigma: float) -> ProfileFit:
    """Return a Gaussian of a width [lines] to start from."""
    return ProfileFit(GAUSSIAN, np.array([0.0, sigma]))


def best_fit(bins: Bins, start: ProfileFit) -> ProfileFit:
    """Fit the Gaussian, and richer profiles as long as none explains the sample.

    Schwarz's criterion chooses; with few bins the Gaussian is all that they can tell.

    Parameters
    ----------
    bins : Bins
        The pixels.
    start : ProfileFit
        A Gaussian to start from.
    """
    best = refined(bins, start)
    width = best.figures[1]
    for model in RICHER:
        figures = np.where(model.is_width, width, 1.0) * model.start
        trial = ProfileFit(model, np.concatenate([[0.0], figures]))
        if _explains(bins, best) or bins.t.size < 3 * (trial.figures.size + 2):
            break
        best = min(best, refined(bins, trial), key=lambda fit: _score(bins, fit))
    return best


def _explains(bins: Bins, fit: ProfileFit) -> bool:
    free = bins.t.size - fit.figures.size - 2
    return bool(fit.misfit < free + 4 * np.sqrt(2 * free))


def _score(bins: Bins, fit: ProfileFit) -> float:
    return float(fit.misfit + fit.figures.size * np.log(bins.t.size))


def refined(bins: Bins, start: ProfileFit) -> ProfileFit:
    """Improve a profile's figures by least squares, height and level free."""
    model, problem = start.model, _Problem(bins, start.model)
    low, high = np.array((-1.0, *model.low)), np.array((1.0, *model.high))
    fit = least_squares(
        problem.residual,
        np.clip(start.figures, low + 1e-6, high - 1e-6),
        jac=problem.jacobian,
        bounds=(low, high),
        x_scale=0.3,
        max_nfev=_MOST_STEPS,
    )
    return ProfileFit(model, fit.x, float(2 * fit.cost))


class _Problem:
    """Residuals of a profile, its height and level the best ones for any figures.

    The derivatives leave out how height and level turn with the figures (Kaufman, BIT 15, 1975,
    49; doi:10.1007/BF01932995): the gradient is exact all the same.
    """

    def __init__(self, bins: Bins, model: LineModel) -> None:
        self._bins, self._model = bins, model
        self._root = np.sqrt(bins.weight)

    def residual(self, figures: _Array) -> _Array:
        bins = self._bins
        shape = self._model.parts(bins.t - figures[0], *figures[1:])[0]
        height, level = height_and_level(bins, shape)
        left: _Array = (bins.value - level - height * shape) * self._root
        return left

    def jacobian(self, figures: _Array) -> _Array:
        bins, root = self._bins, self._root
        shape, along, by_figures = self._model.parts(bins.t - figures[0], *figures[1:])
        height, _ = height_and_level(bins, shape)
        changes = (np.vstack([-along, by_figures]) * root).T
        free, _ = np.linalg.qr(np.stack([root, shape * root], axis=1))
        seen: _Array = -height * (changes - free @ (free.T @ changes))
        return seen


def height_and_level(bins: Bins, shape: _Array) -> tuple[float, float]:
    """Return height and level with which a profile [point] explains the pixels best."""
    total = bins.weight.sum()
    shape_mean = (bins.weight @ shape) / total
    value_mean = (bins.weight @ bins.value) / total
    departure = shape - shape_mean
    height = (
        (bins.weight * departure) @ bins.value / ((bins.weight * departure) @ departure + 1e-30)
    )
    return float(height), float(value_mean - height * shape_mean)
