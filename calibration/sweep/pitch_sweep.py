"""A pitch-sweep calibration: what it holds, and how it is applied."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.sweep._file import (
    CurveEntry,
    PointEntry,
    Provenance,
    SweepFile,
    read_sweep_file,
    write_sweep_file,
)
from calibration.sweep._limits import SweepLimits
from calibration.sweep.curve import SweepCurve
from calibration.sweep.point import SweepPoint
from calibration.sweep.setup import SweepSetup
from calibration.sweep.temperatures import TemperatureWeights
from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Setup

__all__ = ["CalibratedAngle", "PitchSweep"]

Floats = NDArray[np.float64]


class CalibratedAngle(NamedTuple):
    """What `PitchSweep.apply` makes of optical angles; arrays have their shape.

    Attributes
    ----------
    angle_deg : ndarray
        Angle after calibration [deg].
    systematic_std_deg : ndarray
        Uncertainty of the calibration there, 1 sigma [deg]; averaging does not reduce it.
    fit_std_deg : ndarray
        The same without the onboard sensor's accuracy; it has `PitchSweep.scatter_freedom`.
    outside : ndarray of bool
        Whether the sweep does not cover the angle, the temperature or the line's place.
    gain : ndarray
        d calibrated / d optical: it scales a field's own noise.
    doubts : tuple of str
        What the sweep does not cover, in words.
    """

    angle_deg: Floats
    systematic_std_deg: Floats
    fit_std_deg: Floats
    outside: NDArray[np.bool_]
    gain: Floats
    doubts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PitchSweep:
    """A calibration of the optical angle against the onboard sensor.

    Attributes
    ----------
    curves : tuple of SweepCurve
        One for each tunnel temperature, in rising order of it.
    onboard_accuracy_deg : float
        Error that all onboard angles share, 1 sigma [deg]; no number of points reduces it.
    setup : SweepSetup or None
        What the optical angles were measured with; None if the file does not say.
    provenance : Provenance
        Files, setup and date the sweep came from.
    """

    curves: tuple[SweepCurve, ...]
    onboard_accuracy_deg: float = 0.0
    setup: SweepSetup | None = None
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return max(curve.degree for curve in self.curves)

    @property
    def points(self) -> tuple[SweepPoint, ...]:
        """Points of the fit, curve by curve."""
        return tuple(point for curve in self.curves for point in curve.points)

    @property
    def left_out(self) -> dict[SweepPoint, str]:
        """Points that lie off their curve, and how far."""
        return {point: why for curve in self.curves for point, why in curve.left_out.items()}

    @property
    def temperatures_k(self) -> Floats:
        """Mean tunnel temperature of each curve [K], as [curve]; NaN where unknown."""
        return np.array(
            [np.nan if c.temperature_k is None else c.temperature_k for c in self.curves]
        )

    @property
    def chi_square(self) -> float:
        """Sum of squared residuals in units of their uncertainty, over all curves."""
        return sum(curve.chi_square for curve in self.curves)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of points less number of coefficients, over all curves."""
        return sum(curve.degrees_of_freedom for curve in self.curves)

    @property
    def reduced_chi_square(self) -> float | None:
        """Chi-square per degree of freedom; None where no point is to spare."""
        freedom = self.degrees_of_freedom
        return self.chi_square / freedom if freedom else None

    @property
    def scatter_freedom(self) -> float:
        """Degrees of freedom of the calibration's uncertainty, over all curves.

        The least of the curves; infinite where the stated uncertainties explain the scatter.
        """
        return min(curve.scatter_freedom for curve in self.curves)

    @property
    def range_deg(self) -> tuple[float, float]:
        """Least and greatest optical angle that every curve covers [deg]."""
        lows, highs = zip(*(curve.range_deg for curve in self.curves), strict=True)
        return max(lows), min(highs)

    @property
    def temperature_range_k(self) -> tuple[float, float] | None:
        """Least and greatest tunnel temperature of the points [K], or None."""
        known = [p.temperature_k for p in self.points if p.temperature_k is not None]
        return (min(known), max(known)) if known else None

    @property
    def line_range(self) -> tuple[float, float] | None:
        """Least and greatest place of the line on the image [field lines], or None."""
        known = [point.line_v for point in self.points if point.line_v is not None]
        return (min(known), max(known)) if known else None

    @property
    def optical_deg(self) -> Floats:
        """Mean optical angles of the points of the fit [deg], as [point]."""
        return np.array([point.optical_deg for point in self.points])

    @property
    def onboard_deg(self) -> Floats:
        """Mean onboard angles of the points of the fit [deg], as [point]."""
        return np.array([point.onboard_deg for point in self.points])

    @property
    def residuals_deg(self) -> Floats:
        """Onboard angle less calibrated optical angle of the points [deg], as [point]."""
        return np.array([self.residual_deg(point) for point in self.points])

    def curve_of(self, point: SweepPoint) -> SweepCurve:
        """Return the curve that a point, used or left out, belongs to."""
        return next(c for c in self.curves if point in c.points or point in c.left_out)

    def residual_deg(self, point: SweepPoint) -> float:
        """Return onboard less calibrated optical angle of a point [deg]."""
        return point.onboard_deg - float(self.curve_of(point).predict(point.optical_deg))

    def residual_std_deg(self, point: SweepPoint) -> float:
        """Return the stated uncertainty of a point's residual from both angles, 1 sigma [deg]."""
        slope = float(self.curve_of(point).derivative(point.optical_deg))
        return math.hypot(point.onboard_std_deg, slope * point.optical_std_deg)

    def apply(
        self,
        angle_deg: ArrayLike,
        *,
        temperature_k: float | None = None,
        line_v: ArrayLike | None = None,
    ) -> CalibratedAngle:
        """Calibrate optical angles.

        Parameters
        ----------
        angle_deg : array_like
            Optical angles before calibration [deg]; NaN where nothing was measured.
        temperature_k : float, optional
            Tunnel temperature [K]. Between the sweeps' the curves are interpolated, linearly
            between two and quadratically among more; outside, the nearest one counts.
        line_v : array_like, optional
            Where the line lies on the image, of the shape of `angle_deg`: field line at the middle
            of the columns measured.

        Returns
        -------
        CalibratedAngle
            Angle [deg], systematic uncertainty (1 sigma) [deg], whether outside, gain, and what is
            outside in words. NaN stays NaN and is not outside.

        Notes
        -----
        The systematic uncertainty holds the coefficients' covariance, scatter of the points beyond
        their noise, a significant hysteresis, what the interpolation between temperatures cannot
        know (see `calibration.sweep.temperatures`), and the onboard accuracy. It grows quickly
        outside the range of angles, and still says nothing of powers that the sweep could not see:
        heed `outside`. A hundredth of the range of angles is allowed on either side, since single
        fields scatter about the sweep's end points; 2 K in temperature; and in the line's place a
        hundredth of the sensor's lines: the angle of a distorted or turned camera depends on it.
        """
        angle = np.asarray(angle_deg, np.float64)
        weights = self._weights(temperature_k)
        values = np.array([curve.predict(angle) for curve in self.curves])
        slopes = np.array([curve.derivative(angle) for curve in self.curves])
        variance = weights.doubt(values) ** 2
        for curve, weight in zip(self.curves, weights.best, strict=True):
            variance = variance + weight**2 * curve.variance_of(angle)
        fit_std = np.sqrt(variance + self.lasting_std_deg(temperature_k) ** 2)
        outside, doubts = self._limits(temperature_k).outside(angle, temperature_k, line_v)
        return CalibratedAngle(
            np.tensordot(weights.best, values, 1),
            np.hypot(fit_std, self.onboard_accuracy_deg),
            fit_std,
            outside,
            np.tensordot(weights.best, slopes, 1),
            doubts,
        )

    def predict(self, angle_deg: ArrayLike, *, temperature_k: float | None = None) -> Floats:
        """Return the calibrated angle [deg] for optical angles [deg]; see `apply`."""
        return self.apply(angle_deg, temperature_k=temperature_k).angle_deg

    def derivative(self, angle_deg: ArrayLike, *, temperature_k: float | None = None) -> Floats:
        """Return d calibrated / d optical at optical angles [deg]; see `apply`."""
        return self.apply(angle_deg, temperature_k=temperature_k).gain

    def interval(
        self,
        angle_deg: ArrayLike,
        angle_std_deg: ArrayLike = 0.0,
        *,
        temperature_k: float | None = None,
        level: float = 0.95,
    ) -> tuple[Floats, Floats]:
        """Return the prediction interval of the true angle.

        Parameters
        ----------
        angle_deg : array_like
            Optical angles before calibration [deg].
        angle_std_deg : array_like
            Their own noise, 1 sigma [deg].
        temperature_k : float, optional
            Tunnel temperature [K].
        level : float
            Probability that the interval holds the true angle.

        Returns
        -------
        low, high : ndarray
            Limits [deg], in the shape of `angle_deg`. From the normal distribution, or Student's
            where the scatter of the points was taken instead of their stated uncertainty.
        """
        applied = self.apply(angle_deg, temperature_k=temperature_k)
        std = np.hypot(applied.systematic_std_deg, applied.gain * np.asarray(angle_std_deg))
        factor = coverage_factor(self.scatter_freedom, level)
        return applied.angle_deg - factor * std, applied.angle_deg + factor * std

    def expanded_deg(self, point: SweepPoint) -> tuple[float, float]:
        """Return half the 95 % intervals at a point of the sweep [deg].

        Parameters
        ----------
        point : SweepPoint
            The point, used or left out.

        Returns
        -------
        calibration, another : float
            Of the calibrated angle for itself, and of what another point with this one's noise
            would show against it (prediction interval).
        """
        kelvins = self.curve_of(point).temperature_k
        gain = float(self.derivative(point.optical_deg, temperature_k=kelvins))
        halves = []
        for noise in (0.0, self.residual_std_deg(point) / gain):
            low, high = self.interval(point.optical_deg, noise, temperature_k=kelvins)
            halves.append(float(high - low) / 2)
        return halves[0], halves[1]

    def covariance(
        self, angle_deg: ArrayLike, temperatures_k: Sequence[float | None] | None = None
    ) -> Floats:
        """Return the covariance of calibrated angles that they owe to the curves [deg^2].

        Parameters
        ----------
        angle_deg : array_like [point]
            Optical angles before calibration [deg].
        temperatures_k : sequence of float or None [point], optional
            Tunnel temperature of each [K].

        Returns
        -------
        ndarray [point, point]
            Of the coefficients and of the interpolation between temperatures; what each point may
            be off for itself (`lasting_std_deg`) and the onboard accuracy are not in it.
        """
        angle = np.asarray(angle_deg, np.float64)
        told = [None] * angle.size if temperatures_k is None else list(temperatures_k)
        weights = [self._weights(each) for each in told]
        values = np.array([curve.predict(angle) for curve in self.curves])
        doubt = np.array([each.doubt(values[:, k]) for k, each in enumerate(weights)])
        covariance = np.outer(doubt, doubt)
        for number, curve in enumerate(self.curves):
            share = np.array([each.best[number] for each in weights])
            covariance += np.outer(share, share) * curve.covariance_of(angle)
        return covariance

    def lasting_std_deg(self, temperature_k: float | None = None) -> float:
        """Return what a point at rest may be off beyond noise and curve, 1 sigma [deg]."""
        weights = self._weights(temperature_k).straight
        own = np.array([curve.lasting_std_deg for curve in self.curves])
        return float(np.sqrt(weights @ own**2))

    def check_setup(self, setup: Setup, *, source: str | Path = "the pitch sweep") -> None:
        """Refuse a setup whose optical angle is another than the sweep was measured with.

        Parameters
        ----------
        setup : Setup
            The setup that the sweep is to be applied with.
        source : str or Path
            What to call the sweep.

        Raises
        ------
        CalibrationError
            If camera, known Y, nose or reflection differ. A sweep that does not say what it was
            measured with is taken.
        """
        if self.setup is None:
            return
        said = self.setup.contradictions(SweepSetup.of(setup))
        if said:
            raise CalibrationError(
                f"{source} was measured with another setup ({'; '.join(said)}); repeat glint-aoa "
                "calibrate sweep with this one, or go back to the other"
            )

    def setup_doubts(
        self, setup: Setup, *, columns: tuple[float, float] | None = None
    ) -> tuple[str, ...]:
        """Say what else of a setup differs that may change the angle a little.

        Parameters
        ----------
        setup : Setup
            The setup that the sweep is applied with.
        columns : tuple of float, optional
            First and last sensor column measured.
        """
        if self.setup is None:
            return ()
        return tuple(self.setup.doubts(SweepSetup.of(setup, columns=columns)))

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the calibration as TOML, with units in the names and the points it came from.

        Parameters
        ----------
        path : str or Path
            The file; it appears under its name only when it is whole.
        overwrite : bool
            Whether a file of that name may be replaced.

        Raises
        ------
        OutputError
            If the file exists and `overwrite` is False, or it cannot be written.
        """
        content = SweepFile(
            kind="pitch sweep",
            onboard_accuracy_deg=self.onboard_accuracy_deg,
            curve=[CurveEntry.of(curve) for curve in self.curves],
            point=[
                entry
                for number, curve in enumerate(self.curves, 1)
                for entry in PointEntry.of_curve(curve, number)
            ],
            setup=self.setup,
            provenance=self.provenance,
        )
        write_sweep_file(Path(path), content, self.summary, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> "PitchSweep":
        """Read a calibration that `save` wrote, or an earlier version's with one polynomial.

        Parameters
        ----------
        path : str or Path
            The TOML file.

        Returns
        -------
        PitchSweep
            The same calibration, to the last bit.

        Raises
        ------
        CalibrationError
            If the file is missing, not TOML, or not a pitch sweep; the message names the key.
        """
        content = read_sweep_file(Path(path))
        return cls(
            curves=content.curves(),
            onboard_accuracy_deg=content.onboard_accuracy_deg,
            setup=content.setup,
            provenance=content.provenance,
        )

    @property
    def summary(self) -> str:
        """One sentence on the fit."""
        low, high = self.range_deg
        ratio = self.reduced_chi_square
        fit = "no point to spare" if ratio is None else f"reduced chi-square {ratio:.2f}"
        known = [curve.temperature_k for curve in self.curves if curve.temperature_k is not None]
        at = f" at {', '.join(f'{each:.1f}' for each in known)} K" if known else ""
        out = f", {len(self.left_out)} left out" if self.left_out else ""
        return (
            f"Degree {self.degree}{at}, {len(self.points)} points{out} from {low:.3f} to "
            f"{high:.3f} optical deg, {fit}, residuals "
            f"{np.sqrt(np.mean(self.residuals_deg**2)):.4f} deg rms."
        )

    def _weights(self, temperature_k: float | None) -> TemperatureWeights:
        known = self.temperatures_k
        if len(self.curves) == 1:
            known = np.zeros(1)
        elif temperature_k is None:
            return TemperatureWeights.unknown(known.size)
        return TemperatureWeights.at(temperature_k or 0.0, known)

    def _limits(self, temperature_k: float | None) -> SweepLimits:
        """Return what the curves that count at a temperature cover."""
        counts = self._weights(temperature_k).straight > 0
        ranges = [c.range_deg for c, used in zip(self.curves, counts, strict=True) if used]
        return SweepLimits(
            angle_deg=(max(low for low, _ in ranges), min(high for _, high in ranges)),
            temperature_k=self.temperature_range_k,
            line_v=self.line_range,
            lines=None if self.setup is None else self.setup.lines,
            n_curves=len(self.curves),
        )
