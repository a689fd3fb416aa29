"""Column centres: Steger's curvilinear detector, the bias of its points removed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.bar import AsymmetricBar, fit_bars
from glint_aoa.optical.estimator import ColumnCentres, Estimator, Sample
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.optical.pooling import shrunk
from glint_aoa.optical.shape import GlintShape

__all__ = ["StegerEstimator", "learn", "line_taps"]

_Array = NDArray[np.float64]

_LEAST_SCALE = 1.0  # lines: a narrower filter lets the pixels' grid through
_HALF_AT = 1.18  # standard deviations of a Gaussian from its middle to half its height
_REACH = 3.0  # scales of the filter along the line, on each side
_DIRECTION_REACH = 2.0  # scales: the least that tells the line's direction


@dataclass(frozen=True, eq=False)
class StegerEstimator(Estimator):
    r"""Finds the points of a curvilinear line; made by `learn`.

    The field r is filtered with a Gaussian and its partial derivatives. The Hessian's eigenvector
    n of the larger eigenvalue is the direction across the line, and the line runs through

    .. math:: -\frac{\nabla r \cdot n}{n^T H n} \, n

    from where the derivatives were taken; this is repeated from there until it stays, and read
    at the column. Different backgrounds on both sides shift that point. The shift is predicted
    from the line's width, blur and contrasts on both sides by the scale-space model of an
    asymmetric bar (`glint_aoa.optical.bar`), and taken away.

    Attributes
    ----------
    shape : GlintShape
        What is known of the glint.
    noise : NoiseModel
        The camera's noise.
    bar : AsymmetricBar
        Width and blur of the line in the sample.
    scale : float
        Standard deviation of the filter [lines, and columns along the line].
    columns : ndarray, shape (column,)
        Columns of the sample, 0-based in the recorded window.
    bias : ndarray, shape (column,)
        Shift of the point in each column [lines]; positive is down.

    Notes
    -----
    C. Steger, "An unbiased detector of curvilinear structures", PAMI 20 (1998) 113,
    doi:10.1109/34.659930. Three things differ. The derivatives are taken at the point itself and
    not at the nearest pixel, whose series to second order is off by up to 0.03 line. The
    contrasts are those of the sample's mean, since one field's would double the noise. The filter
    along the line reaches no further than half-way to the next column that is measured, so that
    columns stay independent; with every column in use the filter acts across the line only.

    Its noise is near the bound where read noise prevails, above it where shot noise does, since
    the filter does not know the noise. It is biased by clipping of an asymmetric line, by a curved
    background, by pixel locking where the line is narrow (0.004 line for sigma 0.7), and where a
    background that differs on both sides changes within a stack.
    """

    shape: GlintShape
    noise: NoiseModel
    bar: AsymmetricBar
    scale: float
    columns: NDArray[np.int64]
    bias: _Array

    @property
    def name(self) -> str:
        """Name in the setup."""
        return "steger"

    @property
    def settings(self) -> Mapping[str, object]:
        """Figures behind the estimator, for the record's attributes."""
        return {
            "steger_scale_lines": self.scale,
            "steger_half_width_lines": self.bar.half_width,
            "steger_blur_lines": self.bar.blur,
            "steger_bias_lines": float(np.median(self.bias)),
            "steger_bias_spread_lines": float(np.std(self.bias)),
        }

    def centres(
        self,
        fields: NDArray[np.integer],
        columns: NDArray[np.int64],
        start: NDArray[np.float64],
    ) -> ColumnCentres:
        """Measure the centres.

        Parameters
        ----------
        fields : ndarray, shape (field, line, column)
            Grey levels, uint8 or uint16.
        columns : ndarray, shape (column,)
            Columns to measure, 0-based in the recorded window; the bias of one that the sample
            lacks is taken between its neighbours.
        start : ndarray, shape (field, column)
            Row at which the line is expected, good to two lines; NaN where there is none.

        Returns
        -------
        ColumnCentres
            Centres; heights are those of Gaussians with the line's width and the points'
            curvature [grey levels].
        """
        from glint_aoa.optical import _steger_kernel as kernel  # noqa: PLC0415  compiles
        from glint_aoa.optical._window_kernel import CUT  # noqa: PLC0415

        row, height = np.empty(start.shape), np.empty(start.shape)
        status, clipped = np.empty(start.shape, np.uint8), np.empty(start.shape, np.bool_)
        kernel.column_centres(
            fields,
            columns,
            start,
            self.scale,
            np.array([self.shape.sign, self.shape.half_width]),
            _height_over_curvature(self.bar.scale, self.scale),
            line_taps(self.scale),
            self._reach(columns, fields.shape[2]),
            self.shape.threshold,
            self.noise.saturation,
            row,
            height,
            status,
            clipped,
        )
        row -= np.interp(columns, self.columns, self.bias)
        return ColumnCentres(row=row, height=height, cut=status == CUT, clipped=clipped)

    def _reach(self, columns: NDArray[np.int64], n_columns: int) -> NDArray[np.int64]:
        """Columns on each side that the filter along the line may take."""
        apart = int(np.diff(columns).min()) if columns.size > 1 else n_columns
        inside = np.minimum(columns, n_columns - 1 - columns)
        return np.minimum(inside, min((apart - 1) // 2, _taps_reach(self.scale)))


def learn(sample: Sample, shape: GlintShape, noise: NoiseModel) -> StegerEstimator:
    """Learn the line's width, from which the filter's follows, and its asymmetry from a sample.

    The filter is as wide as the line, which is best against white noise, but not narrower than
    one line. Each column has its own bias as far as the columns differ by more than their noise.

    Parameters
    ----------
    sample : Sample
        Fields in which the line is known.
    shape : GlintShape
        What is known of the glint.
    noise : NoiseModel
        The camera's noise; only its saturation is used.

    Returns
    -------
    StegerEstimator
        The estimator.
    """
    bars = fit_bars(sample, shape)
    none = np.zeros(sample.columns.size)
    if bars is None:
        half = (shape.half_box + 0.5) / _HALF_AT
        bar = AsymmetricBar(0.5 * half, half)
        return StegerEstimator(shape, noise, bar, max(half, _LEAST_SCALE), sample.columns, none)
    scale = max(bars.bar.scale, _LEAST_SCALE)
    bias, _ = shrunk(*bars.bias(scale))
    return StegerEstimator(shape, noise, bars.bar, scale, sample.columns, np.nan_to_num(bias))


def line_taps(scale: float) -> _Array:
    """Return filters along the line: a Gaussian, its first and its second derivative.

    Parameters
    ----------
    scale : float
        Standard deviation of the Gaussian [columns].

    Returns
    -------
    ndarray, shape (reach + 1, 3, 2 reach + 1)
        Taps for every reach up to three scales, zero beyond it. Those of the derivatives return a
        slope and a curvature unchanged, and nothing else; below two scales they are zero, since
        what is cut shorter has more noise than it tells of the direction.
    """
    most = _taps_reach(scale)
    away = np.arange(-most, most + 1)
    bell = np.exp(-0.5 * (away / scale) ** 2)
    taps = np.zeros((most + 1, 3, away.size))
    for reach in range(most + 1):
        smooth = np.where(np.abs(away) <= reach, bell, 0.0)
        smooth /= smooth.sum()
        taps[reach, 0] = smooth
        if reach < _DIRECTION_REACH * scale:
            continue
        variance = (smooth * away**2).sum()
        curved = smooth * (away**2 - variance)
        taps[reach, 1] = smooth * away / variance
        taps[reach, 2] = 2 * curved / (curved * away**2).sum()
    return taps


def _taps_reach(scale: float) -> int:
    return max(1, math.ceil(_REACH * scale))


def _height_over_curvature(line: float, scale: float) -> float:
    """Height of a Gaussian line over the second derivative of its filtered profile."""
    total: float = (line**2 + scale**2 + 2 / 12) ** 1.5 / line
    return total
