"""Column centres by maximum likelihood: the line's own profile matched to each column."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.fused import FusedEstimator
from glint_aoa.optical.line_profile import LineProfile, background_shapes, learn_profile
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.optical.shape import GlintShape

__all__ = ["ProfileMatch", "learn"]

_Array = NDArray[np.float64]

_PHASES = 64  # tabulated to a line
_REACH = 2.0  # lines that a centre may lie from its start, at least
_CLEARLY = 3.0  # standard deviations of a scatter by chance
_NOISY = 0.05  # lines of noise in a column's centre, from which columns are matched twice
_CORE = 0.6  # of the half width must lie within the window


@dataclass(frozen=True)
class ProfileMatch(FusedEstimator):
    """Matches the profile to columns; made by `learn`.

    The height is that of the profile's top over the background.
    """

    profile: LineProfile
    noise: NoiseModel
    shape: GlintShape
    tables: "_Tables"
    uneven: _Array
    usual: _Array

    @property
    def name(self) -> str:
        """Name in the setup."""
        return "profile"

    @property
    def settings(self) -> Mapping[str, object]:
        """Figures behind the estimator, for the record's attributes."""
        return {
            "profile_source": self.profile.source,
            "profile_model": self.profile.model,
            "profile_reach_lines": self.profile.reach,
            "profile_misfit": self.profile.misfit,
        }

    @property
    def step_correction(self) -> _Array:
        """What steps of the background across the line were taken to draw the centres by [column].

        In lines; where such a step lies under the glint, and how blurred it is, cannot be seen.
        """
        height, drawn = self.usual[0], np.zeros(self.usual.shape[1])
        pull = self.uneven[1] * self.tables.uneven_gain[1].mean()
        np.divide(pull, height, out=drawn, where=height > 0)
        return drawn

    @property
    def _kernel(self) -> ModuleType:
        from glint_aoa.optical import _profile_kernel  # noqa: PLC0415  compiles

        return _profile_kernel

    @cached_property
    def _settings(self) -> tuple[Any, ...]:
        tables, shape, noise = self.tables, self.shape, self.noise
        return (
            shape.sign,
            tables.profile,
            (tables.filters, tables.bend, tables.uneven_gain, tables.spread),
            self.uneven,
            self.usual,
            np.array([noise.read_variance, noise.variance_per_grey, noise.black]),
            _CORE * shape.half_width,
            max(_REACH, 0.5 * shape.half_width),
            shape.threshold,
            float(shape.saturation),
            bool(np.median(tables.spread) > _NOISY * np.median(self.usual[0])),
        )


def learn(sample: Sample, shape: GlintShape, noise: NoiseModel) -> ProfileMatch:
    r"""Learn the profile, and tabulate the filters that match it.

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
    ProfileMatch
        The estimator.

    Notes
    -----
    About a phase c of the line a column's grey levels are linear in its height A, level B, tilt T,
    step S across the line, and A times the shift:
    :math:`I_v = A P(t) - A\,dc\,P'(t) + B + T t + S E(t), \; t = v - c`. Weighted least squares
    with the noise model's variances gives A and A dc as two filters for each of 64 phases; a
    column costs two sums of products. Tilt and step are held near the column's own, from the whole
    sample, as firmly as the sample knows them: free, they would cost a tenth more noise.
    """
    profile, light = learn_profile(sample, shape, noise)
    pairs = zip(light.uneven, light.uneven_std, strict=True)
    uneven, left = zip(*(_usual(values, std) for values, std in pairs), strict=True)
    usual = np.stack([_filled(light.height), _filled(light.level)])
    tables = _tabulated(profile, shape, noise, usual.mean(axis=1), np.array(left))
    return ProfileMatch(profile, noise, shape, tables, np.stack(uneven), usual)


def _filled(values: _Array) -> _Array:
    known = np.isfinite(values)
    middle = float(np.median(values[known])) if known.any() else 0.0
    filled: _Array = np.where(known, values, middle)
    return filled


def _usual(values: _Array, std: _Array) -> tuple[_Array, float]:
    """Shrink a figure of each column to the columns' mean by what the sample knows of it.

    The scatter of the columns clearly beyond their noise says how much they differ: a column's
    own figure brings the sample's noise into all fields. Returns the figures [column], and the
    standard deviation that is left.
    """
    known = np.isfinite(values) & np.isfinite(std) & (std > 0)
    if known.sum() < 3:
        return np.zeros(values.size), 1e-3
    value, noise = values[known], std[known] ** 2
    mean = np.average(value, weights=1 / noise)
    chance = _CLEARLY * float(np.mean(noise)) * np.sqrt(2 / known.sum())
    between = max(float(np.mean((value - mean) ** 2 - noise)) - chance, 0.0)
    share = between / (between + noise)
    shrunk = np.full(values.size, mean)
    shrunk[known] += share * (value - mean)
    left = float(np.sqrt(np.median(share * noise)))
    return shrunk, max(left, 1e-6)


@dataclass(frozen=True)
class _Tables:
    """What the kernel looks up, by phase."""

    profile: NDArray[np.float64]  # [4, phase, line] profile, slope, taper of the weights, step
    filters: NDArray[np.float32]  # [phase, 2, line]
    bend: _Array  # [phase]
    uneven_gain: _Array  # [2, phase]
    spread: _Array  # [phase]


def _tabulated(
    profile: LineProfile, shape: GlintShape, noise: NoiseModel, usual: _Array, left: _Array
) -> _Tables:
    side = int(np.ceil(profile.reach))
    rows = np.arange(-side, side + 1)
    phase = (np.arange(_PHASES) - _PHASES // 2) / _PHASES
    t = rows - phase[:, None]
    value, slope, bend = (profile.curve(t, order) for order in range(3))
    taper = np.clip(profile.reach + 0.5 - np.abs(t), 0.0, 1.0)
    height, level = usual
    weight = taper / noise.variance(shape.sign * (level + height * value))
    tilt, step = background_shapes(t)
    design = np.stack([value, -slope, np.ones_like(t), tilt, step], axis=2)
    normal = np.einsum("pri,pr,prj->pij", design, weight, design)
    normal[:, [3, 4], [3, 4]] += 1 / left**2
    inverse = np.linalg.inv(normal)
    filters = np.einsum("pij,prj,pr->pir", inverse, design, weight)
    # Second order of the shift, per unit height: 0.5 P'' shift^2 seen through the shift's filter.
    second = 0.5 * np.einsum("pr,pr->p", filters[:, 1], bend)
    return _Tables(
        profile=np.stack([value, slope, taper, step]),
        filters=np.ascontiguousarray(filters[:, :2], np.float32),
        bend=second,
        uneven_gain=np.stack([np.einsum("pr,pr->p", filters[:, 1], each) for each in (tilt, step)]),
        spread=np.sqrt(inverse[:, 1, 1]),
    )
