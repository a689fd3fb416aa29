"""Fuse the optical angle of the fields with the inertial channels of the same point."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.flags import Flag
from glint_aoa.fusion.assembly import Fields, Parts, parts_of, slow_of, smoothed_pitch
from glint_aoa.fusion.inputs import Assumed, OpticalAngles
from glint_aoa.fusion.modal_radii import FusedMode, radii
from glint_aoa.fusion.plane import Motion, PlaneSignals, motion_of, plane_signals
from glint_aoa.fusion.result import FusedAttitude
from glint_aoa.fusion.slow import SlowAngle
from glint_aoa.fusion.smoother import Beliefs, Smoothed
from glint_aoa.inertial.channels import PackageOutput
from glint_aoa.inertial.modes import PLANES, Plane, modes_from_setup
from glint_aoa.inertial.package import calibrated_output
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Setup

__all__ = ["fuse"]

_Floats = NDArray[np.float64]

_UNCERTAIN_DEG = 0.01
_SURE_EXCESS = 3.0  # standard deviations of the fields' scatter before it is believed
_SHORTEST_S, _LONGEST_S = 1.0, 120.0  # of a record: memory grows by 5 MB a second


def fuse(
    record: AcquisitionRecord,
    optical: OpticalAngles | None = None,
    setup: Setup | None = None,
    *,
    assumed: Assumed | None = None,
) -> FusedAttitude:
    """Estimate the instantaneous attitude from video and inertial channels together.

    Parameters
    ----------
    record : AcquisitionRecord
        Package output and accelerometers on one clock, as from
        `glint_aoa.records.conditioning.prepared`.
    optical : OpticalAngles, optional
        Of the same point on the same trigger. Without it the package alone carries the slow angle.
    setup : Setup, optional
        Package, heading of the glint's plane, and modes for their numbers.
    assumed : Assumed, optional
        Uncertainties of the sensors.

    Returns
    -------
    FusedAttitude
        One row a sample of the package's output.

    Raises
    ------
    RecordingError
        If the package's output or accelerometers along model z are missing, or the record is
        longer than two minutes or shorter than a second.

    Notes
    -----
    Biased where the fuselage bends, and where the optical angle is wrong by more than it says.
    Between 0.3 and 2 Hz motion of the support shows only through the package.
    """
    setup, assumed = setup or Setup(), assumed or Assumed()
    package = calibrated_output(record, setup.inertial)
    _check_length(record, package)
    signals = _signals(record, package, setup)
    result = _fused(record, package, signals, optical, setup, assumed)
    if any(each.turns for each in signals.values()):
        # turns multiply what they turn: once more, from those that were found
        signals = {plane: _turned(each, result) for plane, each in signals.items()}
        result = _fused(record, package, signals, optical, setup, assumed)
    return result


def _fused(
    record: AcquisitionRecord,
    package: PackageOutput,
    signals: Mapping[Plane, PlaneSignals],
    optical: OpticalAngles | None,
    setup: Setup,
    assumed: Assumed,
) -> FusedAttitude:
    """Fuse once, with the fields' noise as it shows."""
    parts = parts_of(record, package, signals, assumed)
    slow = slow_of(parts, setup)
    used = Fields.of(optical, parts)
    found = smoothed_pitch(parts, slow, used)
    excess = found.consistency.get("optical", 1.0)
    if used is not None and excess > 1 + _SURE_EXCESS * np.sqrt(2 / used.sample.size):
        used = replace(used, variance=used.variance * excess)
        found = smoothed_pitch(parts, slow, used)
        parts.notes.append(f"the fields scatter {np.sqrt(excess):.1f} times as far as they say")
    return _attitude(parts, found, used, setup, optical, slow)


def _signals(
    record: AcquisitionRecord, package: PackageOutput, setup: Setup
) -> dict[Plane, PlaneSignals]:
    """Take the accelerometers of the planes that have any."""
    modes = modes_from_setup(setup.inertial)
    found = {plane: plane_signals(record, plane, package, modes) for plane in PLANES}
    signals = {plane: each for plane, each in found.items() if each is not None}
    if "pitch" not in signals:
        raise RecordingError(
            f"{record.name}: no accelerometer along model z shows the vibration in pitch; record "
            "one, or give its axis under [[inertial.channel]] in the setup"
        )
    return signals


def _turned(signals: PlaneSignals, result: FusedAttitude) -> PlaneSignals:
    return signals.turned([result.unknowns[each.name][0] for each in signals.turns])


def _check_length(record: AcquisitionRecord, package: PackageOutput) -> None:
    duration = len(package.channel) / package.channel.rate_hz
    if not _SHORTEST_S <= duration <= _LONGEST_S:
        raise RecordingError(
            f"{record.name}: the record lasts {duration:.3g} s, but the fusion takes "
            f"{_SHORTEST_S:g} to {_LONGEST_S:g} s; cut it to a stretch of that length"
        )


def _attitude(
    parts: Parts,
    found: Smoothed,
    fields: Fields | None,
    setup: Setup,
    optical: OpticalAngles | None,
    slow: SlowAngle,
) -> FusedAttitude:
    """Turn the smoother's columns into angles, uncertainties and radii."""
    motion = motion_of(parts.pitch.signals, found)
    mean, covariance = found.unknowns.mean, found.unknowns.covariance
    turn = parts.yaw_columns("angle")
    pitch = parts.reference + motion.angle[:, 0] - motion.angle[:, 1:] @ mean + parts.nod
    yaw = turn[:, 0] - turn[:, 1:] @ mean
    shared = motion.angle[:, 1:] @ covariance
    pitch_variance = motion.angle_variance + np.sum(shared * motion.angle[:, 1:], axis=1)
    yaw_variance = np.sum(turn[:, 1:] @ covariance * turn[:, 1:], axis=1)
    if parts.yaw is None:
        yaw, yaw_variance = np.full_like(yaw, np.nan), np.full_like(yaw, np.nan)
    else:
        yaw_variance = yaw_variance + parts.yaw.motion.angle_variance
    level = np.cos(parts.reference)
    pitch_std = np.degrees(np.sqrt(pitch_variance))
    return FusedAttitude(
        time_s=parts.package.channel.time_s,
        pitch_deg=np.degrees(pitch),
        pitch_std_deg=pitch_std,
        yaw_deg=np.degrees(setup.glint.yaw + yaw / level),
        yaw_std_deg=np.degrees(np.sqrt(yaw_variance)) / level,
        pitch_yaw_covariance_deg2=np.degrees(np.degrees(np.sum(shared * turn[:, 1:], axis=1)))
        / level,
        flags=_flags(parts, fields, optical, pitch_std),
        modes=_modes(parts, motion, found.unknowns, setup),
        unknowns={
            each.name: (float(value), float(std))
            for each, value, std in zip(parts.unknowns, mean, found.unknowns.std, strict=True)
        },
        consistency=found.consistency | ({} if parts.yaw is None else parts.yaw.consistency),
        notes=parts.notes,
        settings={
            "fields_used": 0 if fields is None else fields.sample.size,
            "package_channel": parts.package.channel.name,
            "package_angle_std_deg": float(np.degrees(np.sqrt(slow.variance))),
            "package_angle_spacing_s": float(np.diff(slow.sample).mean() / parts.rate_hz),
            "drift_deg_per_sqrt_s": float(np.degrees(slow.drift)),
        },
    )


def _modes(parts: Parts, motion: Motion, beliefs: Beliefs, setup: Setup) -> list[FusedMode]:
    """Radii in both planes; what one plane shows at the other's mode is left out."""
    listed = modes_from_setup(setup.inertial)
    in_pitch = parts.pitch, motion.rate, motion.velocity
    in_yaw = parts.yaw, parts.yaw_columns("rate"), parts.yaw_columns("velocity")
    found = [
        mode
        for (plane, rate, velocity), (_, across, _) in ((in_pitch, in_yaw), (in_yaw, in_pitch))
        if plane is not None
        for mode in radii(
            plane.signals.plane,
            rate,
            velocity,
            beliefs,
            plane.signals.resonances,
            listed,
            rate_hz=parts.rate_hz,
            across=across[:, 0],
        )
    ]
    return sorted(found, key=lambda mode: mode.frequency_hz)


def _flags(
    parts: Parts, fields: Fields | None, optical: OpticalAngles | None, std_deg: _Floats
) -> NDArray[np.int64]:
    flags = np.zeros(parts.samples, np.int64)
    for plane in (parts.pitch, parts.yaw):
        if plane is not None:
            flags[plane.signals.clipped] |= Flag.CLIPPED_CHANNEL
            flags[plane.signals.lost] |= Flag.GAP
            if plane.signals.turns:  # modes that hardly move its one accelerometer stay unseen
                flags |= Flag.UNCERTAIN_CORRECTION
    flags[~(std_deg <= _UNCERTAIN_DEG)] |= Flag.UNCERTAIN_CORRECTION
    few = fields is None or optical is None or 2 * fields.sample.size < optical.angle_deg.size
    if few:
        flags |= Flag.FEW_FIELDS
    return flags
