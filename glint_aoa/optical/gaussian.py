"""Column centres: a Gaussian integrated over the pixels, fitted by maximum likelihood."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.bar import ColumnBars, fit_bars
from glint_aoa.optical.estimator import ColumnCentres, Estimator, Sample
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.optical.pooling import over_fields, shrunk
from glint_aoa.optical.shape import GlintShape

__all__ = ["GaussianEstimator", "learn"]

_Array = NDArray[np.float64]

_LEAST_WIDTH = 0.25  # lines: below this a pixel holds nearly all of the line's light
_HALF_AT = 1.18  # widths from the middle of a Gaussian to half its height
_LARGEST_CHANGE = 0.3  # of the width, in one round
_PHASES = 5
_ROUNDS = 12
_SETTLED = 1e-4  # of the width


@dataclass(frozen=True, eq=False)
class GaussianEstimator(Estimator):
    r"""Fits a Gaussian, integrated over each pixel, to every column; made by `learn`.

    The expected grey level of line v in a column is

    .. math:: \mu_v = A \int_{v-1/2}^{v+1/2} e^{-(y-c)^2 / 2 s^2} dy + b + t (v - v_0)

    with height A, centre c and level b free in each field and column. The width s comes from the
    sample. The tilt t is free too, but held near what the sample showed of the column by as much
    as it stayed the same there: a tilt that is free altogether costs 5 % of precision.

    Backgrounds that differ on both sides, or a line that is no Gaussian, shift the centre. The
    shift is that of the same fit to the asymmetric bars of the sample (`glint_aoa.optical.bar`),
    and is taken away.

    The likelihood is the noise model's: each pixel is normal about its expected level with the
    variance at that level. A clipped pixel is a censored observation: what it recorded says that
    its true level is at least `saturation` - 0.5 (Tobin, Econometrica 26 (1958) 24).

    Attributes
    ----------
    shape : GlintShape
        What is known of the glint.
    noise : NoiseModel
        The camera's noise.
    columns : ndarray, shape (column,)
        Columns of the sample, 0-based in the recorded window.
    width : ndarray, shape (column,)
        Standard deviation s of the Gaussian [lines].
    tilt, tilt_precision : ndarray, shape (column,)
        Usual tilt of the background [grey levels / line], and how firmly it is held to that
        [1 / (grey levels / line)^2].
    bias : ndarray, shape (column,)
        Shift of the centre in each column [lines]; positive is down.

    Notes
    -----
    Efficient and free of pixel locking for a Gaussian glint on a background that is straight on
    each side. For another symmetric profile it stays unbiased but for pixel locking where the
    line is narrow; its noise grows as the profile departs from a Gaussian. It is biased by a line
    that is itself not symmetric, by a curved background, by a background that changes within the
    stack and by a second line in the window.
    """

    shape: GlintShape
    noise: NoiseModel
    columns: NDArray[np.int64]
    width: _Array
    tilt: _Array
    tilt_precision: _Array
    bias: _Array

    @property
    def name(self) -> str:
        """Name in the setup."""
        return "gaussian"

    @property
    def settings(self) -> Mapping[str, object]:
        """Figures behind the estimator, for the record's attributes."""
        return {
            "gaussian_width_lines": float(np.median(self.width)),
            "gaussian_width_least_lines": float(self.width.min()),
            "gaussian_width_most_lines": float(self.width.max()),
            "gaussian_tilt_grey_per_line": float(np.median(self.tilt)),
            "gaussian_bias_lines": float(np.median(self.bias)),
            "gaussian_bias_spread_lines": float(np.std(self.bias)),
        }

    def centres(
        self,
        fields: NDArray[np.integer | np.floating],
        columns: NDArray[np.int64],
        start: NDArray[np.float64],
    ) -> ColumnCentres:
        """Measure the centres.

        Parameters
        ----------
        fields : ndarray, shape (field, line, column)
            Grey levels.
        columns : ndarray, shape (column,)
            Columns to measure, 0-based in the recorded window; what was learnt is taken between
            neighbours for one that the sample lacks.
        start : ndarray, shape (field, column)
            Row at which the line is expected, good to two lines; NaN where there is none.

        Returns
        -------
        ColumnCentres
            Centres; heights are those of the Gaussians [grey levels].
        """
        from glint_aoa.optical import _gaussian_kernel as kernel  # noqa: PLC0415  compiles
        from glint_aoa.optical._window_kernel import CUT  # noqa: PLC0415

        row, height = np.empty(start.shape), np.empty(start.shape)
        status, clipped = np.empty(start.shape, np.uint8), np.empty(start.shape, np.bool_)
        kernel.column_centres(
            fields,
            columns,
            start,
            np.stack([np.interp(columns, self.columns, x) for x in self._learnt], axis=1),
            _geometry(self.shape),
            _noise_figures(self.noise),
            self.shape.threshold,
            row,
            height,
            status,
            clipped,
        )
        row -= np.interp(columns, self.columns, self.bias)
        return ColumnCentres(row=row, height=height, cut=status == CUT, clipped=clipped)

    @property
    def _learnt(self) -> tuple[_Array, ...]:
        return self.width, self.tilt, self.tilt_precision


def learn(sample: Sample, shape: GlintShape, noise: NoiseModel) -> GaussianEstimator:
    """Learn the glint's width, the background's tilt and the fit's bias from a sample.

    The width maximises the sample's likelihood together with all centres, heights, levels and
    tilts. Each column has its own figures as far as the columns differ by more than their noise.

    Parameters
    ----------
    sample : Sample
        Fields in which the line is known.
    shape : GlintShape
        What is known of the glint.
    noise : NoiseModel
        The camera's noise.

    Returns
    -------
    GaussianEstimator
        The estimator.
    """
    bars = fit_bars(sample, shape)
    none = np.zeros(sample.columns.size)
    guess = (shape.half_box + 0.5) / _HALF_AT if bars is None else bars.bar.scale
    width = none + max(guess, _LEAST_WIDTH)
    found = GaussianEstimator(shape, noise, sample.columns, width, none, none, none)
    for _ in range(_ROUNDS):
        value, variance = _asked(sample, found)
        if not np.isfinite(value).any():
            return found
        better = _improved(found, value, variance)
        change = np.abs(better.width / found.width - 1).max()
        found = better
        if change < _SETTLED:
            break
    return found if bars is None else replace(found, bias=_bias(found, bars))


def _asked(sample: Sample, known: GaussianEstimator) -> tuple[_Array, _Array]:
    """Change of the width and tilt that each column asks for, and variances [2, field, column]."""
    from glint_aoa.optical import _gaussian_kernel as kernel  # noqa: PLC0415  compiles

    value, variance = np.empty((2, *sample.row.shape)), np.empty((2, *sample.row.shape))
    none = np.zeros_like(known.width)
    kernel.width_and_tilt(
        sample.fields,
        sample.columns,
        sample.row,
        np.stack([known.width, none, none], axis=1),
        _geometry(known.shape),
        _noise_figures(known.noise),
        value,
        variance,
    )
    return value, variance


def _improved(known: GaussianEstimator, value: _Array, variance: _Array) -> GaussianEstimator:
    """Change width and tilt as the sample asks for."""
    change, tilt = (over_fields(*each) for each in zip(value, variance, strict=True))
    limit = _LARGEST_CHANGE * known.width
    width, _ = shrunk(known.width + np.clip(change.value, -limit, limit), change.variance)
    return replace(
        known,
        width=np.clip(width, _LEAST_WIDTH, known.shape.half_width),
        tilt=np.nan_to_num(tilt.value),
        tilt_precision=1 / (tilt.spread + tilt.variance),
    )


def _bias(found: GaussianEstimator, bars: ColumnBars) -> _Array:
    """Mean departure of the fit from the middle of noise-free bars at a few sub-line phases."""
    reach = math.ceil(found.shape.half_width + found.shape.flank) + 2
    centre = reach + np.linspace(-0.5, 0.5, _PHASES, endpoint=False)
    fields = bars.expected(2 * reach + 1, centre)
    start = np.where(np.isfinite(fields).all(axis=1), centre[:, None], np.nan)
    columns = np.arange(found.width.size)
    noise = replace(found.noise, saturation=np.inf)
    fit = replace(found, noise=noise, columns=columns).centres(fields, columns, start)
    departure = (fit.row - centre[:, None]).mean(axis=0)
    bias, _ = shrunk(departure, bars.bias(float(np.median(found.width)))[1])
    return np.nan_to_num(bias)


def _geometry(shape: GlintShape) -> _Array:
    return np.array([shape.sign, shape.half_width, shape.flank])


def _noise_figures(noise: NoiseModel) -> _Array:
    return np.array([noise.read_variance, noise.variance_per_grey, noise.black, noise.saturation])
