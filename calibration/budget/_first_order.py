"""The law of propagation of uncertainty (JCGM 100:2008) for the angle."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibration.budget._inputs import GeometryCovariance
from calibration.budget._model import AngleModel, Angles, Recalibration
from calibration.budget._rows import BudgetBlock, BudgetRow, geometry_rows, plain_row
from glint_aoa.coverage import effective_freedom

__all__ = ["FirstOrder", "SweepUncertainty"]

Floats = NDArray[np.float64]

_FIT, _ONBOARD, _CENTROIDS = "pitch sweep", "onboard accuracy", "centroids"


@dataclass(frozen=True, eq=False)
class SweepUncertainty:
    """What a pitch sweep itself leaves uncertain of angles.

    Attributes
    ----------
    fit_std_deg : ndarray [line]
        Of the polynomial [deg], 1 sigma.
    accuracy_deg : float
        Error that all onboard angles share [deg], 1 sigma.
    degrees_of_freedom : float
        Of `fit_std_deg`; finite where the scatter of the sweep's points stands for it.
    gain : ndarray [line]
        Change of the calibrated angle with the one before.
    outside : ndarray of bool [line]
        Whether the angle lies outside the range of the sweep.
    """

    fit_std_deg: Floats
    accuracy_deg: float
    degrees_of_freedom: float
    gain: Floats
    outside: NDArray[np.bool_]

    @classmethod
    def of(cls, again: Recalibration, raw_deg: Floats) -> Self:
        """Evaluate a sweep at angles [line] before calibration [deg]."""
        sweep = again.sweep
        applied = sweep.apply(raw_deg, temperature_k=again.temperature_k)
        return cls(
            applied.fit_std_deg,
            sweep.onboard_accuracy_deg,
            sweep.scatter_freedom,
            applied.gain,
            applied.outside,
        )

    def draw(self, draws: int, rng: np.random.Generator) -> Floats:
        """Draw errors [draw, line] of the calibrated angles [deg]."""
        deviate = rng.standard_normal((draws, 2))
        if np.isfinite(self.degrees_of_freedom):
            deviate[:, 0] = rng.standard_t(self.degrees_of_freedom, draws)
        errors: Floats = deviate[:, :1] * self.fit_std_deg + deviate[:, 1:] * self.accuracy_deg
        return errors


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """Sensitivities of lines' angles, and what is uncertain.

    Attributes
    ----------
    angles : Angles
        The angles themselves.
    covariance : GeometryCovariance
        Of the geometry.
    sensitivities : tuple of Angles
        For each block of it, the derivatives [input, line].
    noise : Angles
        Change of the angle with the noise of a column's centre [deg / line].
    row_std : float
        That noise [lines].
    sweep : SweepUncertainty or None
        Of the sweep that is applied.
    """

    angles: Angles
    covariance: GeometryCovariance
    sensitivities: tuple[Angles, ...]
    noise: Angles
    row_std: float
    sweep: SweepUncertainty | None

    @classmethod
    def of(cls, model: AngleModel, covariance: GeometryCovariance, row_std: float) -> Self:
        """Differentiate a model."""
        angles = Angles(*(each[0] for each in model.angles(model.chain.geometry[None])))
        noise = np.degrees(model.chain.noise(model.v))
        again = model.recalibration
        sweep = None if again is None else SweepUncertainty.of(again, angles.raw_deg)
        return cls(
            angles=angles,
            covariance=covariance,
            sensitivities=tuple(model.sensitivities(block) for block in covariance.blocks),
            noise=Angles(noise, noise if sweep is None else noise * np.abs(sweep.gain)),
            row_std=row_std,
            sweep=sweep,
        )

    def blocks(self, line: int) -> tuple[BudgetBlock, ...]:
        """Return what each source contributes to a line's angle; they are independent."""
        blocks = []
        for inputs, sensitivity in zip(self.covariance.blocks, self.sensitivities, strict=True):
            raw, calibrated = (
                math.sqrt(max(float(c @ inputs.covariance @ c), 0.0))
                for c in (each[:, line] for each in sensitivity)
            )
            blocks.append(BudgetBlock(inputs.name, calibrated, raw, inputs.degrees_of_freedom))
        if self.sweep is not None:
            fit = float(self.sweep.fit_std_deg[line])
            blocks.append(BudgetBlock(_FIT, fit, 0.0, self.sweep.degrees_of_freedom))
            blocks.append(BudgetBlock(_ONBOARD, self.sweep.accuracy_deg, 0.0, np.inf))
        raw, calibrated = (self.row_std * float(each[line]) for each in self.noise)
        blocks.append(BudgetBlock(_CENTROIDS, calibrated, raw, np.inf))
        return tuple(blocks)

    def rows(self, line: int) -> tuple[BudgetRow, ...]:
        """Return what each input contributes to a line's angle."""
        whole = self.std(line)[0] ** 2
        rows = [
            row
            for block, sensitivity in zip(self.covariance.blocks, self.sensitivities, strict=True)
            for row in geometry_rows(block, sensitivity, line, whole)
        ]
        if self.sweep is not None:
            fit, accuracy = float(self.sweep.fit_std_deg[line]), self.sweep.accuracy_deg
            rows.append(plain_row(_FIT, "deg", fit, (1.0, 0.0), whole))
            rows.append(plain_row(_ONBOARD, "deg", accuracy, (1.0, 0.0), whole))
        raw, calibrated = (float(each[line]) for each in self.noise)
        rows.append(plain_row(_CENTROIDS, "lines", self.row_std, (calibrated, raw), whole))
        return tuple(rows)

    def std(self, line: int) -> tuple[float, float]:
        """Return a line's standard uncertainty [deg] and its effective degrees of freedom."""
        blocks = self.blocks(line)
        variances = [block.contribution_deg**2 for block in blocks]
        freedom = effective_freedom(variances, [block.degrees_of_freedom for block in blocks])
        return math.sqrt(math.fsum(variances)), float(freedom)
