"""The TOML file of a pitch sweep: what it holds, and how it is read and written."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from calibration._result_file import ResultFile
from calibration.sweep._hysteresis import Hysteresis
from calibration.sweep.curve import SweepCurve
from calibration.sweep.point import SweepPoint
from calibration.sweep.setup import SweepSetup
from glint_aoa.setup import Section

__all__ = [
    "CurveEntry",
    "HysteresisEntry",
    "PointEntry",
    "Provenance",
    "SweepFile",
    "read_sweep_file",
    "write_sweep_file",
]

_RESULT = ResultFile(
    "pitch sweep",
    "sweep",
    """\
# No-flow pitch sweep of glint-aoa: onboard angle as a polynomial of the optical angle, one curve
# for each tunnel temperature,
#   onboard_deg = sum over k of coefficients_deg[k] * t^k,
#   t = (optical_deg - centre_deg) / half_range_deg.
# Every std is 1 sigma.
# {summary}

""",
)

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
_NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
_Degree = Annotated[str, Field(pattern="^[1-9][0-9]*$")]


class Provenance(Section):
    """Where the numbers of a calibration came from.

    Attributes
    ----------
    files : tuple of str
        Recorded points, in the order in which they were given.
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
        least = len(self.coefficients_deg)
        rows = self.covariance_deg2
        if len(rows) < least or any(len(row) != len(rows) for row in rows):
            raise ValueError(f"covariance_deg2 must be square, {least} x {least} at least")
        covariance = np.array(rows)
        scale = np.abs(covariance).max()
        if np.abs(covariance - covariance.T).max() > 1e-9 * scale:
            raise ValueError("covariance_deg2 is not symmetric")
        if np.linalg.eigvalsh(covariance).min() < -1e-9 * scale:
            raise ValueError("covariance_deg2 has a negative variance")
        return self


class HysteresisEntry(Section):
    """Difference of the branches of a sweep; see `calibration.sweep._hysteresis.Hysteresis`."""

    width_deg: _Finite
    std_deg: _NotNegative
    p_value: Annotated[float, Field(ge=0, le=1)]
    up: tuple[str, ...]
    down: tuple[str, ...]
    degrees_of_freedom: Annotated[float, Field(gt=0)] = math.inf

    def hysteresis(self) -> Hysteresis:
        """Return it as the calibration has it."""
        return Hysteresis(**self.model_dump())


class CurveEntry(_Polynomial):
    """The curve of one temperature; see `calibration.sweep_curve.SweepCurve`."""

    temperature_K: _Positive | None = None  # noqa: N815  kelvin
    chi_square: _NotNegative
    degrees_of_freedom: Annotated[int, Field(ge=0)]
    scatter_deg: _NotNegative = 0.0
    criterion: dict[_Degree, _NotNegative] = Field(default_factory=dict)
    hysteresis: HysteresisEntry | None = None

    @classmethod
    def of(cls, curve: SweepCurve) -> Self:
        """Take a curve for the file."""
        loop = curve.hysteresis
        return cls(
            temperature_K=curve.temperature_k,
            centre_deg=curve.centre_deg,
            half_range_deg=curve.half_range_deg,
            coefficients_deg=curve.coefficients_deg.tolist(),
            covariance_deg2=curve.covariance_deg2.tolist(),
            chi_square=curve.chi_square,
            degrees_of_freedom=curve.degrees_of_freedom,
            scatter_deg=curve.scatter_deg,
            criterion={str(degree): value for degree, value in curve.criterion.items()},
            hysteresis=None if loop is None else HysteresisEntry(**vars(loop)),
        )

    def curve(self, points: "Sequence[PointEntry]") -> SweepCurve:
        """Return the curve with its points."""
        return SweepCurve(
            coefficients_deg=np.array(self.coefficients_deg),
            covariance_deg2=np.array(self.covariance_deg2),
            centre_deg=self.centre_deg,
            half_range_deg=self.half_range_deg,
            points=tuple(each.point() for each in points if each.used),
            left_out={each.point(): each.reason for each in points if not each.used},
            chi_square=self.chi_square,
            temperature_k=self.temperature_K,
            scatter_deg=self.scatter_deg,
            hysteresis=None if self.hysteresis is None else self.hysteresis.hysteresis(),
            criterion={int(degree): value for degree, value in self.criterion.items()},
        )


class PointEntry(Section):
    """A point and which curve it belongs to; see `calibration.sweep_point.SweepPoint`."""

    name: str
    curve: Annotated[int, Field(ge=1)]
    used: bool = True
    reason: str = ""
    time: str = ""
    optical_deg: _Finite
    optical_std_deg: _Positive
    onboard_deg: _Finite
    onboard_std_deg: _Positive
    onboard_note: str = ""
    temperature_K: _Positive | None = None  # noqa: N815  kelvin
    nominal_deg: _Finite | None = None
    intercept_mm: _Finite | None = None
    intercept_std_mm: _NotNegative | None = None
    line_v: _Finite | None = None
    mark_row: _Finite | None = None
    mark_column: _Finite | None = None
    mark_at: tuple[_Finite, _Finite] | None = None

    @classmethod
    def of_curve(cls, curve: SweepCurve, number: int) -> list[Self]:
        """Take the points of a curve for the file, those left out last."""
        told = [(point, True, "") for point in curve.points]
        told += [(point, False, reason) for point, reason in curve.left_out.items()]
        return [
            cls(
                curve=number,
                used=used,
                reason=reason,
                temperature_K=point.temperature_k,
                **{key: value for key, value in vars(point).items() if key != "temperature_k"},
            )
            for point, used, reason in told
        ]

    def point(self) -> SweepPoint:
        """Return the point as the calibration has it."""
        told = self.model_dump(exclude={"curve", "used", "reason", "temperature_K"})
        return SweepPoint(temperature_k=self.temperature_K, **told)


class SweepFile(Section):
    """The content of the file of a pitch sweep."""

    kind: Literal["pitch sweep"]
    onboard_accuracy_deg: _NotNegative = 0.0
    curve: Annotated[list[CurveEntry], Field(min_length=1)]
    point: list[PointEntry]
    setup: SweepSetup | None = None
    provenance: Provenance = Provenance()

    def curves(self) -> tuple[SweepCurve, ...]:
        """Return the curves, each with its points."""
        return tuple(
            curve.curve([point for point in self.point if point.curve == number])
            for number, curve in enumerate(self.curve, 1)
        )

    @model_validator(mode="after")
    def _points_carry_the_curves(self) -> Self:
        for number, curve in enumerate(self.curve, 1):
            used = sum(point.used and point.curve == number for point in self.point)
            freedom = used - len(curve.coefficients_deg)
            if freedom != curve.degrees_of_freedom:
                raise ValueError(
                    f"degrees_of_freedom of curve {number} is {curve.degrees_of_freedom}, "
                    f"its points and coefficients give {freedom}"
                )
        return self

    @model_validator(mode="after")
    def _curves_rise_in_temperature(self) -> Self:
        known = [each.temperature_K for each in self.curve if each.temperature_K is not None]
        if len(self.curve) > 1 and len(known) < len(self.curve):
            raise ValueError("temperature_K is missing in a curve of several")
        if any(later <= earlier for earlier, later in itertools.pairwise(known)):
            raise ValueError("temperature_K must rise from curve to curve")
        return self


class _Columns(Section):
    """Points of a file with one curve, as columns."""

    optical_deg: Annotated[list[_Finite], Field(min_length=2)]
    optical_std_deg: list[_Positive]
    onboard_deg: list[_Finite]
    onboard_std_deg: list[_Positive]

    @model_validator(mode="after")
    def _lengths_agree(self) -> Self:
        if len({len(values) for _, values in self}) > 1:
            raise ValueError("the columns are not of one length")
        return self


class _Fit(Section):
    chi_square: _NotNegative
    degrees_of_freedom: Annotated[int, Field(ge=0)]
    onboard_accuracy_deg: _NotNegative = 0.0
    criterion: dict[_Degree, _NotNegative] = Field(default_factory=dict)


class _OneCurveFile(Section):
    """The file as version 0.1 wrote it: one polynomial and columns of points."""

    kind: Literal["pitch sweep"]
    polynomial: _Polynomial
    fit: _Fit
    points: _Columns
    provenance: Provenance = Provenance()

    def in_curves(self) -> dict[str, Any]:
        """Return the content as `SweepFile` has it."""
        fit = self.fit.model_dump()
        accuracy = fit.pop("onboard_accuracy_deg")
        columns = self.points.model_dump()
        n_points = len(self.points.optical_deg)
        files = self.provenance.files
        named = len(set(files)) == len(files) == n_points
        names = [Path(name).stem for name in files] if named else None
        return {
            "kind": self.kind,
            "onboard_accuracy_deg": accuracy,
            "curve": [{**self.polynomial.model_dump(), **fit}],
            "point": [
                {
                    "name": names[k] if names else f"point {k + 1}",
                    "curve": 1,
                    **{key: values[k] for key, values in columns.items()},
                }
                for k in range(n_points)
            ],
            "provenance": self.provenance,
        }


def write_sweep_file(path: Path, content: SweepFile, summary: str, *, overwrite: bool) -> None:
    """Write the file; see `calibration.sweep.PitchSweep.save`."""
    plain = content.model_dump(exclude_none=True, exclude_defaults=False)
    _RESULT.write(path, plain, summary, overwrite=overwrite)


def read_sweep_file(path: Path) -> SweepFile:
    """Read the file; see `calibration.sweep.PitchSweep.load`."""
    content = _RESULT.read(path)
    if "polynomial" in content:
        content = _RESULT.validated(path, content, _OneCurveFile).in_curves()
    return _RESULT.validated(path, content, SweepFile)
