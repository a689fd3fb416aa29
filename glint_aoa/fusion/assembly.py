"""Put a point's fusion together: planes, package, fields, and all that is not known of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.signal
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.fusion.inputs import Assumed, OpticalAngles
from glint_aoa.fusion.oscillators import Oscillators
from glint_aoa.fusion.plane import (
    PlaneSignals,
    PlaneVibration,
    Unknown,
    motion_rows,
    sensed,
    vibration,
)
from glint_aoa.fusion.slow import SlowAngle, slow_angle
from glint_aoa.fusion.smoother import Beliefs, Measurements, Smoothed, smooth
from glint_aoa.inertial.channels import PackageOutput
from glint_aoa.inertial.filters import low_pass_sos, settling_s
from glint_aoa.inertial.modes import Plane
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Setup
from glint_aoa.units import STANDARD_GRAVITY

__all__ = ["Fields", "Parts", "parts_of", "slow_of", "smoothed_pitch"]

_Floats = NDArray[np.float64]

_YAW_IN_OPTICAL = 0.03  # deg per deg: the glint walks round a yawing body
_START_STD = float(np.radians(0.5))
_LEAST_STD = float(np.radians(1e-6))

_YAW = "yaw in the optical angle"
_SCALE = "scale of the optical angle"
_BIAS = "bias of the package"
_OFFSET = "offset of the optical angle"

_NO_YAW = "no accelerometer along model y: yaw is not known, nor its part of the package's bias"
_SINGLE = "one accelerometer: each mode's radius is learnt from video and package"


@dataclass(frozen=True, eq=False)
class Parts:
    """What the fusion is made from; unknowns: those of pitch, of yaw, then the common ones."""

    record: AcquisitionRecord
    package: PackageOutput
    reference: float
    pitch: PlaneVibration
    yaw: PlaneVibration | None
    unknowns: list[Unknown]
    beliefs: Beliefs
    notes: list[str]

    @property
    def rate_hz(self) -> float:
        """Samples a second [Hz]."""
        return self.package.channel.rate_hz

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.package.specific_force.size

    def whole(self, columns: _Floats, plane: Plane) -> _Floats:
        """Spread the columns [sample, 1 + own unknown] of a plane over all unknowns."""
        start = 1 if plane == "pitch" else 1 + len(self.pitch.unknowns)
        spread = np.zeros((len(columns), 1 + len(self.unknowns)))
        spread[:, 0] = columns[:, 0]
        spread[:, start : start + columns.shape[1] - 1] = columns[:, 1:]
        return spread

    def yaw_columns(self, what: str) -> _Floats:
        """Angle, rate or velocity in yaw, over all unknowns; zero without accelerometers."""
        if self.yaw is None:
            return np.zeros((self.samples, 1 + len(self.unknowns)))
        return self.whole(getattr(self.yaw.motion, what), "yaw")

    def column(self, name: str) -> int:
        """Give the number of an unknown's column."""
        return 1 + [each.name for each in self.unknowns].index(name)

    @property
    def nod(self) -> _Floats:
        """What a turn in yaw about the pitched model's own axis takes off the pitch [rad]."""
        return np.asarray(-np.tan(self.reference) * self.yaw_columns("angle")[:, 0] ** 2 / 2)


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields within the record: sample before or after, what lies between [s], angle, variance."""

    sample: NDArray[np.int64]
    ahead_s: _Floats
    angle: _Floats
    variance: _Floats
    exposure_s: float
    systematic_std: float
    scale_std: float

    @classmethod
    def of(cls, optical: OpticalAngles | None, parts: Parts) -> "Fields | None":
        """Take the good fields of the record; None if there are none."""
        if optical is None:
            return None
        position = (optical.time_s - parts.package.channel.start_s) * parts.rate_hz
        sample = np.rint(position).astype(np.int64)
        use = optical.good & (sample >= 0) & (sample < parts.samples)
        if not use.any():
            return None
        return cls(
            sample[use],
            (position - sample)[use] / parts.rate_hz,
            np.radians(optical.angle_deg[use]),
            np.radians(optical.std_deg[use]) ** 2,
            optical.exposure_s,
            max(float(np.radians(optical.systematic_std_deg)), _LEAST_STD),
            max(optical.scale_std, _LEAST_STD),
        )

    def values(self, signal: _Floats, rate: _Floats) -> _Floats:
        """Read a signal [sample] at the fields, by its rate."""
        return np.asarray(signal[self.sample] + rate[self.sample] * self.ahead_s)


def parts_of(
    record: AcquisitionRecord,
    package: PackageOutput,
    signals: Mapping[Plane, PlaneSignals],
    assumed: Assumed,
) -> Parts:
    """Smooth the planes by themselves and list all that is not known."""
    sine = float(np.clip(package.specific_force.mean() / STANDARD_GRAVITY, -1.0, 1.0))
    pitch, yaw = signals["pitch"], signals.get("yaw")

    def smoothed(own: PlaneSignals, other: PlaneSignals | None) -> PlaneVibration:
        return vibration(
            own,
            other,
            sine=sine,
            rate_hz=package.channel.rate_hz,
            gain_std=assumed.gain_std,
            misalignment_std=assumed.misalignment_std,
        )

    in_pitch = smoothed(pitch, yaw)
    in_yaw = None if yaw is None else smoothed(yaw, pitch)
    common = [
        Unknown(_YAW, _YAW_IN_OPTICAL),
        Unknown(_SCALE, 1.0),
        Unknown(_BIAS, float(np.radians(assumed.package_std_deg))),
        Unknown(_OFFSET, 1.0),
    ]
    planes = [each for each in (in_pitch, in_yaw) if each is not None]
    unknowns = [each for plane in planes for each in plane.unknowns] + common
    covariance = scipy.linalg.block_diag(
        *(plane.beliefs.covariance for plane in planes), np.diag([each.std**2 for each in common])
    )
    mean = np.concatenate([*(plane.beliefs.mean for plane in planes), np.zeros(len(common))])
    notes = [] if yaw is not None else [_NO_YAW]
    notes += [f"{plane.signals.plane}: {_SINGLE}" for plane in planes if plane.signals.turns]
    beliefs = Beliefs(mean, covariance)
    return Parts(
        record, package, float(np.arcsin(sine)), in_pitch, in_yaw, unknowns, beliefs, notes
    )


def _product(one: _Floats, other: _Floats) -> _Floats:
    """Product of two signals by columns, to first order in the unknowns."""
    product = one * other[:, :1] + one[:, :1] * other
    product[:, 0] /= 2
    return product


def slow_of(parts: Parts, setup: Setup) -> SlowAngle:
    """Turn the package's output into slow angles: products of vibration back, vibration off."""
    cosine = STANDARD_GRAVITY * np.cos(parts.reference)
    motion = parts.pitch.motion
    products = _product(motion.velocity, motion.rate) / cosine
    columns = parts.whole(products - motion.angle, "pitch")
    columns += _product(parts.yaw_columns("velocity"), parts.yaw_columns("rate")) / cosine
    columns[:, 0] += np.tan(parts.reference) * motion.angle[:, 0] ** 2 / 2 - parts.nod
    settling = 0.0
    if parts.package.is_filtered:
        sections = low_pass_sos(setup.inertial.filter, parts.rate_hz)
        columns = np.asarray(scipy.signal.sosfilt(sections, columns, axis=0))
        settling = settling_s(setup.inertial.filter)
        if parts.samples < (settling + 1.0) * parts.rate_hz:
            raise RecordingError(
                f"{parts.record.name}: only the package's filtered output is recorded, and its "
                f"filter needs {settling:.3g} s to settle; record longer, or the unfiltered output"
            )
    output = parts.package.specific_force - STANDARD_GRAVITY * np.sin(parts.reference)
    columns[:, 0] += output / cosine
    columns[:, parts.column(_BIAS)] = 1.0
    return slow_angle(columns, parts.rate_hz, parts.beliefs, first=round(settling * parts.rate_hz))


def smoothed_pitch(parts: Parts, slow: SlowAngle, fields: Fields | None) -> Smoothed:
    """Smooth pitch with all that is measured of it."""
    own = parts.pitch.signals
    model = Oscillators(own.coordinates, parts.rate_hz, slow.drift, _START_STD)
    size, own_size = len(parts.unknowns), len(parts.pitch.unknowns)
    information, pull = np.zeros((size, size)), np.zeros(size)
    information[:own_size, :own_size], pull[:own_size] = parts.pitch.normal
    measured = sensed(
        own,
        None if parts.yaw is None else parts.yaw.signals,
        model,
        sine=float(np.sin(parts.reference)),
        size=size,
        informs=np.ones(size, bool),
    )
    measured.append(_package_angles(slow, model))
    beliefs = parts.beliefs
    if fields is not None:
        measured.append(_field_angles(parts, fields, model))
        covariance = beliefs.covariance.copy()
        for name, std in ((_OFFSET, fields.systematic_std), (_SCALE, fields.scale_std)):
            at = parts.column(name) - 1
            covariance[at, at] = std**2
        beliefs = Beliefs(beliefs.mean, covariance)
    return smooth(
        model,
        measured,
        beliefs,
        samples=parts.samples,
        seen=motion_rows(own, model),
        told=(information, pull),
    )


def _package_angles(slow: SlowAngle, model: Oscillators) -> Measurements:
    count = slow.sample.size
    return Measurements(
        source="package",
        sample=slow.sample,
        rows=np.eye(model.size)[-1:],
        kind=np.zeros(count, np.int64),
        value=slow.columns[:, 0],
        regressors=slow.columns[:, 1:],
        variance=np.full(count, slow.variance),
        informs=np.ones(slow.columns.shape[1] - 1, bool),
    )


def _field_angles(parts: Parts, fields: Fields, model: Oscillators) -> Measurements:
    motion = parts.pitch.motion
    count = fields.sample.size
    columns = np.zeros((count, 1 + len(parts.unknowns)))
    columns[:, 0] = fields.angle - parts.reference - parts.nod[fields.sample]
    turn, rate = parts.yaw_columns("angle")[:, 0], parts.yaw_columns("rate")[:, 0]
    columns[:, parts.column(_YAW)] = fields.values(turn, rate)
    columns[:, parts.column(_SCALE)] = fields.values(motion.angle[:, 0], motion.rate[:, 0])
    columns[:, parts.column(_OFFSET)] = 1.0
    first = 1 + 3 * len(parts.pitch.signals.sensors)
    for index, (displacement, speed) in enumerate(motion.coordinates):
        columns[:, first + index] = fields.values(displacement, speed)
    return Measurements(
        source="optical",
        sample=fields.sample,
        rows=model.angle_rows(fields.ahead_s, fields.exposure_s),
        kind=np.arange(count),
        value=columns[:, 0],
        regressors=columns[:, 1:],
        variance=fields.variance,
        informs=np.ones(len(parts.unknowns), bool),
    )
