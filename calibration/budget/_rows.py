"""The rows of an uncertainty budget: what each input contributes to one angle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.budget._inputs import InputBlock
from calibration.budget._model import Angles
from calibration.budget._parameters import PARAMETERS

__all__ = [
    "BudgetBlock",
    "BudgetRow",
    "geometry_rows",
    "plain_row",
]

Floats = NDArray[np.float64]

_BY_NAME = {each.name: each for each in PARAMETERS}


@dataclass(frozen=True)
class BudgetBlock:
    """Inputs from one source together; independent of all other blocks.

    Attributes
    ----------
    name : str
        As `BudgetRow.block`.
    contribution_deg : float
        Standard uncertainty of the angle from all its inputs, their correlation included [deg].
    before_sweep_deg : float
        What it would be without the sweep [deg].
    degrees_of_freedom : float
        Infinite where the uncertainty is stated and not estimated.
    """

    name: str
    contribution_deg: float
    before_sweep_deg: float
    degrees_of_freedom: float


@dataclass(frozen=True)
class BudgetRow:
    """One input and what it contributes to an angle.

    Attributes
    ----------
    block : str
        Where the input comes from: a calibration, ``taped``, ``pitch sweep``, ``onboard
        accuracy`` or ``centroids``.
    source : str
        The input.
    unit : str
        Unit of `std`.
    std : float
        Its standard uncertainty [unit].
    sensitivity : float
        Change of the angle with the input [deg / unit], with the sweep fitted again.
    contribution_deg : float
        Standard uncertainty of the angle from this input alone [deg].
    share : float
        Share of the angle's variance. Within a calibration half of each covariance counts to
        either input, so that a share can be negative; the shares of all rows sum to 1.
    before_sweep_deg : float
        What the contribution would be without the sweep [deg].
    """

    block: str
    source: str
    unit: str
    std: float
    sensitivity: float
    contribution_deg: float
    share: float
    before_sweep_deg: float


def geometry_rows(
    block: InputBlock, sensitivity: Angles, line: int, variance_deg2: float
) -> list[BudgetRow]:
    """Return the rows of a block of geometry.

    Parameters
    ----------
    block : InputBlock
        The inputs.
    sensitivity : Angles
        Derivatives [input, line] by them, degrees per SI unit.
    line : int
        Which line.
    variance_deg2 : float
        Variance of the angle from all inputs [deg^2].
    """
    after, before = sensitivity.calibrated_deg[:, line], sensitivity.raw_deg[:, line]
    shares = after * (block.covariance @ after) / (variance_deg2 or 1.0)
    rows = []
    for name, *figures in zip(block.parameters, block.std, after, before, shares, strict=True):
        parameter = _BY_NAME[name]
        std, by_input, by_input_raw, share = map(float, figures)
        rows.append(
            BudgetRow(
                block=block.name,
                source=parameter.label,
                unit=parameter.unit,
                std=std * parameter.per_si,
                sensitivity=by_input / parameter.per_si,
                contribution_deg=abs(by_input) * std,
                share=share,
                before_sweep_deg=abs(by_input_raw) * std,
            )
        )
    return rows


def plain_row(
    name: str,
    unit: str,
    std: float,
    sensitivity: tuple[float, float],
    variance_deg2: float,
) -> BudgetRow:
    """Return the row of an input that is independent of all others.

    Parameters
    ----------
    name, unit, std
        As the attributes of `BudgetRow`; block and source have one name.
    sensitivity : tuple of float
        Change of the angle with the input, with and without the sweep [deg / unit].
    variance_deg2 : float
        Variance of the angle from all inputs [deg^2].
    """
    contribution, before = (abs(each) * std for each in sensitivity)
    return BudgetRow(
        block=name,
        source=name,
        unit=unit,
        std=std,
        sensitivity=sensitivity[0],
        contribution_deg=contribution,
        share=contribution**2 / (variance_deg2 or 1.0),
        before_sweep_deg=before,
    )
