"""The modal correction: band, integrate, square, divide by the radius, superpose.

The paper's method for several modes in both planes (its section "Bias Error Correction"). Each
mode's tangential velocity V_r at the sensor follows from the accelerometer on the package's face;
its centripetal acceleration V_r^2 / rho_r is added to the package's output before the low-pass.
In place of one band-pass a mode, the modes of a plane are separated together: as complex parts of
one response where a single broadband force explains the spectrum (`receptance`), else by sharing
out its power (`separation`), which also serves sines and independent forces.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.channels import (
    Accelerometer,
    PackageOutput,
    companions,
    tangential,
    tangential_missing,
)
from glint_aoa.inertial.consistency import shown_by_package
from glint_aoa.inertial.estimate import BiasEstimate, CorrectionTask
from glint_aoa.inertial.filters import filter_spectrum
from glint_aoa.inertial.lateral import sensor_per_accelerometer, tipping_m
from glint_aoa.inertial.modes import CREDIBLE_TURN, PLANES, Mode
from glint_aoa.inertial.receptance import Receptances, fit_receptances
from glint_aoa.inertial.separation import Share, separate
from glint_aoa.inertial.spectrum import PlaneSpectrum
from glint_aoa.inertial.turning import turning_per_acceleration
from glint_aoa.inertial.unlisted import named_unlisted, unlisted_resonances, unlisted_terms

__all__ = ["estimate_bias", "missing"]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]

_SETTLING_S = 1.0
"""A resonance is cut out at least 2 Hz wide; its cut remembers two periods of that."""

_CONTRADICTION = 0.25
"""Relative difference of two inverse radii beyond which the survey's is not believed."""

_HARMONIC_BAND = 0.08
"""Half-width over frequency of the second harmonic of a mode."""

_CLEAR = 0.1
"""Standard deviation, over the share, up to which the second harmonic speaks clearly."""

_GAIN_STD = 0.01
"""Uncertainty of the ratio of two accelerometers' gains, 1 sigma."""

_LONGEST_ARM_M = 1e3
"""A model that turns about a point farther away does not turn."""

_CROSS_STD = 0.25
"""Uncertainty of the product of two modes where their power overlaps, over its largest value."""

_FIT_FROM, _FIT_TO = 0.7, 1.5  # times lowest and highest mode: where receptances are fitted


@dataclass(frozen=True, eq=False)
class _PlaneBias:
    addition: _Floats
    std_terms: list[_Floats]
    frequencies_hz: dict[int, float]
    credited: list[int]
    how: str
    turned_m: dict[int, float] = field(default_factory=dict)
    denied: dict[int, float] = field(default_factory=dict)
    unlisted_hz: list[float] = field(default_factory=list)


def missing(task: CorrectionTask) -> str | None:
    """Say what the method lacks, or None if it can be used.

    Parameters
    ----------
    task : CorrectionTask
        Record, package output and modes.

    Returns
    -------
    str or None
        The missing channels or modes, as the end of a sentence.
    """
    if not task.modes:
        return "modes: list each vibration mode as [[inertial.mode]] in the setup"
    planes = [plane for plane in PLANES if any(mode.plane == plane for mode in task.modes)]
    return tangential_missing(task.record, planes, task.package)


def estimate_bias(task: CorrectionTask) -> BiasEstimate:
    """Estimate the bias of the package's output from its modes.

    Parameters
    ----------
    task : CorrectionTask
        A record with one tangential accelerometer for each plane that has modes.

    Returns
    -------
    BiasEstimate
        Sum of V_r^2 / rho_r [m/s^2] and its error terms: radius and gain of each mode, the
        energy of other modes around each resonance (the leak), and what lies between resonances.

    Notes
    -----
    An accelerometer ahead of the package by d moves (rho_r + d) / rho_r as fast as the sensor.
    Turning also tips it in gravity: a mode's signal is that of an arm longer by
    g sin(alpha) / w_r^2, 1.5 % for mode 3 at 6 deg; both are taken out.

    Where accelerometers at other stations show that the model turns about another point than the
    survey says, by more than a quarter in the inverse radius, their radius is taken and named.
    Where the package's own second harmonic (eq. 6) clearly shows less than half of what a mode's
    radius predicts, as for a sine at the frequency of a mode with a small radius that another
    mode's skirt answers too, what it shows is taken, to within its whole size.

    A resonance that no mode lists is named, and what it may add counts as uncertainty
    (`unlisted_terms`); it is not corrected.

    Products of velocity and angular rate of different modes have no mean in steady motion at
    well-separated frequencies. They are kept where one force is seen to move all modes and left
    out, as in eq. 8, elsewhere.
    """
    record, package, relative_std = task.record, task.package, task.relative_std
    force = float(np.mean(package.specific_force))
    found: list[_PlaneBias] = []
    channels = []
    for plane in PLANES:
        in_plane = tuple(mode for mode in task.modes if mode.plane == plane)
        sensor = tangential(record, plane, package) if in_plane else None
        if sensor is None:
            continue
        channels.append(sensor.channel)
        others = companions(record, plane, package, sensor)
        found.append(_plane_bias(package, sensor, others, in_plane, force, relative_std))
    credited = sorted(number for plane in found for number in plane.credited)
    turned = {number: radius for plane in found for number, radius in plane.turned_m.items()}
    denied = {number: part for plane in found for number, part in plane.denied.items()}
    unlisted = [each for plane in found for each in plane.unlisted_hz]
    which = _which(credited, turned, denied)
    which += named_unlisted(unlisted)
    return BiasEstimate(
        addition=np.sum([plane.addition for plane in found], axis=0),
        std_terms=[term for plane in found for term in plane.std_terms if np.any(term)],
        channels=tuple(channels),
        settling_s=_SETTLING_S,
        why=f"modal correction from {' and '.join(each.name for each in channels)}; {which}",
        settings={
            "relative_std": relative_std,
            "mode_frequencies_hz": {k: v for p in found for k, v in p.frequencies_hz.items()},
            "modes_credited": tuple(credited),
            "measured_radii_m": turned,
            "shown_fractions": denied,
            "unlisted_hz": tuple(unlisted),
            "separation": tuple(plane.how for plane in found),
        },
    )


def _which(credited: list[int], turned: Iterable[int], denied: Iterable[int]) -> str:
    """Say which modes were used, and whose radii were not believed."""
    sentence = "no mode stands out"
    if credited:
        sentence = f"modes that stand out: {', '.join(str(number) for number in credited)}"
    for numbers, reason in (
        (sorted(turned), "the accelerometers contradict the radius of mode {}, theirs was taken"),
        (
            sorted(denied),
            "the package's second harmonic denies the radius of mode {}, what it shows was taken",
        ),
    ):
        if numbers:
            sentence += "; " + reason.format(" and ".join(str(number) for number in numbers))
    return sentence


def _plane_bias(
    package: PackageOutput,
    sensor: Accelerometer,
    others: list[Accelerometer],
    modes: tuple[Mode, ...],
    force: float,
    relative_std: float,
) -> _PlaneBias:
    spectrum = PlaneSpectrum.of(sensor.acceleration, sensor.channel.rate_hz, modes)
    inside = (spectrum.bins_hz >= _FIT_FROM * modes[0].frequency_hz) & (
        spectrum.bins_hz <= _FIT_TO * modes[-1].frequency_hz
    )
    receptances = fit_receptances(
        spectrum.bins_hz[inside], spectrum.power[inside], spectrum.averages, spectrum.peaks_hz
    )
    if receptances is None:
        shares = separate(spectrum, modes)
        found = _from_shares(package, sensor, others, shares, force, relative_std)
    else:
        found = _from_receptances(sensor, modes, spectrum, receptances, force, relative_std)
    unlisted = unlisted_resonances(spectrum)
    terms = unlisted_terms(package, sensor, modes, unlisted)
    return replace(found, std_terms=[*found.std_terms, *terms], unlisted_hz=unlisted)


def _from_shares(
    package: PackageOutput,
    sensor: Accelerometer,
    others: list[Accelerometer],
    shares: list[Share],
    force: float,
    relative_std: float,
) -> _PlaneBias:
    """Sum the squares of velocities that share the power of the plane."""
    surveyed = [share.mode for share in shares]
    shares = [_as_it_turns(share, sensor, others, force) for share in shares]
    turned = {
        share.mode.number: share.mode.radius_m
        for mode, share in zip(surveyed, shares, strict=True)
        if share.mode != mode
    }
    responses = [_velocity(share.gain) for share in shares]
    responses += [_velocity(share.foreign_gain) for share in shares]
    velocities = filter_spectrum(sensor.acceleration, sensor.channel.rate_hz, responses)
    speeds: list[_Floats] = []
    parts: list[_ShareBias] = []
    for share, own, foreign in zip(shares, velocities, velocities[len(shares) :], strict=False):
        arm = sensor_per_accelerometer(
            share.mode, share.frequency_hz, ahead_m=sensor.ahead_m, force=force
        )
        speeds.append(arm * own)
        parts.append(_share_bias(package, share, own, foreign, arm=arm, gain_std=relative_std))
        if share.mode.number in turned and parts[-1].is_believed:
            parts[-1].terms.append(_GAIN_STD / _baseline(sensor, others) * speeds[-1] ** 2)
    terms = [term for part in parts for term in part.terms]
    radii = [share.mode.radius_m for share in shares]
    for (one, r), (other, s) in itertools.combinations(zip(speeds, radii, strict=True), 2):
        terms.append(_CROSS_STD * (1 / r + 1 / s) * one * other)
    return _PlaneBias(
        addition=np.sum([part.addition for part in parts], axis=0),
        std_terms=terms,
        frequencies_hz={share.mode.number: share.frequency_hz for share in shares},
        credited=[
            share.mode.number
            for share, part in zip(shares, parts, strict=True)
            if share.credited and part.is_believed
        ],
        how="shares of power",
        turned_m=turned,
        denied={
            share.mode.number: part.shown
            for share, part in zip(shares, parts, strict=True)
            if part.shown is not None
        },
    )


@dataclass(frozen=True, eq=False)
class _ShareBias:
    addition: _Floats
    terms: list[_Floats]
    is_believed: bool = False
    shown: float | None = None


def _share_bias(
    package: PackageOutput,
    share: Share,
    own: _Floats,
    foreign: _Floats,
    *,
    arm: float,
    gain_std: float,
) -> _ShareBias:
    """Square one mode's velocity and divide it by its radius, if that can be believed."""
    factor = arm**2 / share.mode.radius_m
    addition = factor * own**2
    shown = _shown_instead(package, addition, share)
    if shown is not None:
        part = max(shown.real, 0.0)
        return _ShareBias(part * addition, [abs(shown) * addition], shown=part)
    if not _turns_credibly(arm * own, share):
        # V * omega with a rate of turning that is not known, but within what is credible
        unknown = CREDIBLE_TURN * 2 * np.pi * share.frequency_hz * np.abs(own)
        return _ShareBias(np.zeros_like(own), [unknown])
    leak = share.foreign_std * factor * foreign**2
    return _ShareBias(
        addition, [_relative_std(share.mode, gain_std) * addition, leak], is_believed=True
    )


def _shown_instead(package: PackageOutput, addition: _Floats, share: Share) -> complex | None:
    """Fraction of a mode's predicted bias that the package shows, where it denies the rest."""
    if package.is_filtered or not share.credited:
        return None
    shown, std = shown_by_package(
        package.specific_force,
        addition,
        package.channel.rate_hz,
        low_hz=2 * (1 - _HARMONIC_BAND) * share.frequency_hz,
        high_hz=2 * (1 + _HARMONIC_BAND) * share.frequency_hz,
    )
    is_clear = std < _CLEAR * share.purity
    return shown / share.purity if is_clear and shown.real < share.purity / 2 else None


def _as_it_turns(
    share: Share, sensor: Accelerometer, others: list[Accelerometer], force: float
) -> Share:
    """Take a mode's radius from the accelerometers where they contradict the survey's."""
    if not share.credited or not others:
        return share
    tipping = tipping_m(share.frequency_hz, force)
    surveyed = 1 / (share.mode.radius_m + sensor.ahead_m + tipping)
    measured = turning_per_acceleration(sensor, others, share.frequency_hz)
    if abs(measured - surveyed) <= _CONTRADICTION * abs(surveyed):
        return share
    arm = 1 / measured if abs(measured) * _LONGEST_ARM_M > 1 else _LONGEST_ARM_M
    radius = arm - sensor.ahead_m - tipping
    return replace(share, mode=replace(share.mode, radius_m=radius, radius_std_m=0.0))


def _relative_std(mode: Mode, gain_std: float) -> float:
    """Uncertainty of a mode's bias from its radius and from gains, 1 sigma, relative."""
    return float(np.hypot(gain_std, mode.radius_std_m / mode.radius_m))


def _baseline(sensor: Accelerometer, others: list[Accelerometer]) -> float:
    return max(abs(other.ahead_m - sensor.ahead_m) for other in others)


def _turns_credibly(speed: _Floats, share: Share) -> bool:
    """Whether the turning that the mode's radius implies is one that a sting allows.

    Driven off its own shape, as by a sine at the frequency of a mode whose point of rotation lies
    next to the sensor, the model moves with the skirts of other modes; one accelerometer cannot
    tell, but the turning that the small radius would imply can.
    """
    arm = abs(share.mode.radius_m) * 2 * np.pi * share.frequency_hz
    return bool(np.sqrt(2 * np.mean(speed**2)) <= CREDIBLE_TURN * arm)


def _from_receptances(
    sensor: Accelerometer,
    modes: tuple[Mode, ...],
    spectrum: PlaneSpectrum,
    receptances: Receptances,
    force: float,
    relative_std: float,
) -> _PlaneBias:
    """Multiply velocity and angular rate of the plane, both summed over its modes.

    One force moves all modes, so products of different modes need not vanish on average; for a
    single mode this is V^2 / rho.
    """
    low, high = spectrum.bins_hz[0], spectrum.bins_hz[-1]

    def part(index: int) -> Callable[[_Floats], _Complex]:
        def gain(frequency_hz: _Floats) -> _Complex:
            inside = (frequency_hz >= low) & (frequency_hz <= high)
            result = np.zeros(frequency_hz.size, np.complex128)
            result[inside] = receptances.fraction(index, frequency_hz[inside])
            return result

        return _velocity(gain)

    responses = [part(index) for index in range(len(modes))]
    parts = filter_spectrum(sensor.acceleration, sensor.channel.rate_hz, responses)
    velocities, rates = [], []
    for mode, frequency, velocity in zip(modes, receptances.frequency_hz, parts, strict=True):
        arm = sensor_per_accelerometer(mode, frequency, ahead_m=sensor.ahead_m, force=force)
        velocities.append(arm * velocity)
        rates.append(velocities[-1] / mode.radius_m)
    credited = receptances.credited
    total = np.sum(np.array(velocities)[credited], axis=0)
    turning = np.sum(np.array(rates)[credited], axis=0)
    terms = []
    for index, (velocity, rate) in enumerate(zip(velocities, rates, strict=True)):
        strength, std = abs(receptances.strength[index]), receptances.strength_std[index]
        if credited[index]:
            terms.append(_relative_std(modes[index], relative_std) * total * rate)
            terms.append(std / strength * (total * rate + turning * velocity))
        else:
            scale = np.hypot(strength, std) / max(strength, np.finfo(float).tiny)
            terms.append(scale * (total * rate + turning * velocity) + scale**2 * velocity * rate)
    return _PlaneBias(
        addition=np.asarray(total * turning),
        std_terms=terms,
        frequencies_hz={
            mode.number: float(frequency)
            for mode, frequency in zip(modes, receptances.frequency_hz, strict=True)
        },
        credited=[mode.number for mode, use in zip(modes, credited, strict=True) if use],
        how="receptances",
    )


def _velocity(gain: Callable[[_Floats], _Floats | _Complex]) -> Callable[[_Floats], _Complex]:
    def response(frequency_hz: _Floats) -> _Complex:
        circular = 2 * np.pi * np.maximum(frequency_hz, np.finfo(float).tiny)
        return np.asarray(gain(frequency_hz) / (1j * circular), np.complex128)

    return response
