"""The TOML file of a pitch sweep: what it holds, and how it is read and written."""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import pydantic
import tomli_w
from pydantic import Field, model_validator

from glint_aoa.errors import CalibrationError
from glint_aoa.records._files import replacing
from glint_aoa.setup import Section, read_toml

_HEADER = """\
# No-flow pitch sweep of glint-aoa: onboard angle as a polynomial of the optical angle,
#   onboard_deg = sum over k of coefficients_deg[k] * t^k,
#   t = (optical_deg - centre_deg) / half_range_deg.
# Every std is 1 sigma.
# {summary}

"""

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
_NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
_Degree = Annotated[str, Field(pattern="^[1-9][0-9]*$")]


class Provenance(Section):
    """Where the numbers of a calibration came from.

    Attributes
    ----------
    files : tuple of str
        Recorded points, in the order of the sweep.
    setup_hash : str
        Hash of the setup that the optical angles were measured with.
    date : str
        When the sweep was measured, ISO 8601; empty if unknown.
    """

    files: tuple[str, ...] = ()
    setup_hash: str = ""
    date: str = ""


class _Polynomial(Section):
    centre_deg: _Finite
    half_range_deg: _Positive
    coefficients_deg: Annotated[list[_Finite], Field(min_length=2)]
    covariance_deg2: list[list[_Finite]]

    @model_validator(mode="after")
    def _covariance_is_one(self) -> Self:
        size = len(self.coefficients_deg)
        rows = self.covariance_deg2
        if len(rows) != size or any(len(row) != size for row in rows):
            raise ValueError(f"covariance_deg2 must be {size} x {size}, as the coefficients are")
        covariance = np.array(rows)
        scale = np.abs(covariance).max()
        if np.abs(covariance - covariance.T).max() > 1e-9 * scale:
            raise ValueError("covariance_deg2 is not symmetric")
        if np.linalg.eigvalsh(covariance).min() < -1e-9 * scale:
            raise ValueError("covariance_deg2 has a negative variance")
        return self


class _Fit(Section):
    chi_square: _NotNegative
    degrees_of_freedom: Annotated[int, Field(ge=0)]
    onboard_accuracy_deg: _NotNegative = 0.0
    criterion: dict[_Degree, _NotNegative] = Field(default_factory=dict)


class _Points(Section):
    optical_deg: Annotated[list[_Finite], Field(min_length=2)]
    optical_std_deg: list[_Positive]
    onboard_deg: list[_Finite]
    onboard_std_deg: list[_Positive]

    @model_validator(mode="after")
    def _lengths_agree(self) -> Self:
        if len({len(values) for _, values in self}) > 1:
            raise ValueError("the columns are not of one length")
        return self


class SweepFile(Section):
    """The content of the file of a pitch sweep."""

    kind: Literal["pitch sweep"]
    polynomial: _Polynomial
    fit: _Fit
    points: _Points
    provenance: Provenance = Provenance()

    @model_validator(mode="after")
    def _points_carry_the_fit(self) -> Self:
        freedom = len(self.points.optical_deg) - len(self.polynomial.coefficients_deg)
        if freedom != self.fit.degrees_of_freedom:
            raise ValueError(
                f"fit.degrees_of_freedom is {self.fit.degrees_of_freedom}, "
                f"the points and coefficients give {freedom}"
            )
        return self


def write_sweep_file(path: Path, content: SweepFile, summary: str, *, overwrite: bool) -> None:
    """Write the file; see `calibration.sweep.PitchSweep.save`."""
    text = _HEADER.format(summary=summary) + tomli_w.dumps(content.model_dump())
    with replacing(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def read_sweep_file(path: Path) -> SweepFile:
    """Read the file; see `calibration.sweep.PitchSweep.load`."""
    content = read_toml(
        path,
        missing="no such pitch sweep; make one with glint-aoa calibrate sweep",
        error=CalibrationError,
    )
    try:
        return SweepFile.model_validate(content)
    except pydantic.ValidationError as error:
        raise CalibrationError(f"{path}: {_first_problem(error)}") from None


def _first_problem(error: pydantic.ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "missing":
        message = "missing"
    elif problem["type"] == "extra_forbidden":
        message = "unknown key"
    said = f"{where}: {message}" if where else message
    return f"not a pitch sweep that can be used ({said}); repeat glint-aoa calibrate sweep"
