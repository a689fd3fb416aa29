"""Recorded points of one vibration mode in closed form, for the paper's figures."""

import numpy as np

from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.points import RecordedPoint, write_point

GRAVITY, INCH = 9.80665, 0.0254
RATE_HZ = 200.0
RADIUS = {"yaw": 31.0 * INCH, "pitch": 30.2 * INCH}


def channel(name, samples, quantity, units, axis, station_m=0.9):
    about = {"quantity": quantity, "units": units, "axis": axis, "station_m": station_m}
    return Channel(name, samples, RATE_HZ, **about)


def das(
    plane="yaw",
    hz=9.8,
    *,
    bias_deg=0.0,
    moment_in_lb=0.0,
    envelope=np.ones_like,
    filtered=np.ones_like,
    stray=np.zeros_like,
    angle_deg=0.0,
    seconds=16.0,
):
    """One mode in closed form: velocity V e(t) cos(w t) at the package, bias -V^2 / (2 rho g).

    `filtered` is e(t)^2 behind the package's low-pass; `stray` adds to the square of the envelope
    that the balance and the accelerometer show, and the package does not.
    """
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    pulse = 2 * np.pi * hz
    speed = np.sqrt(2 * RADIUS[plane] * GRAVITY * np.radians(bias_deg))
    seen = np.sqrt(envelope(time) ** 2 + stray(time))
    acceleration = -speed * pulse * seen * np.sin(pulse * time)
    aoa = np.sin(np.radians(angle_deg)) - np.radians(bias_deg) * filtered(time)
    # a moment and an acceleration of the same phase; peak to peak at the envelope's largest
    moment = moment_in_lb / 2 * seen / seen.max() * np.sin(pulse * time)
    y, z = ("y", "z") if plane == "yaw" else ("z", "y")
    channels = [
        channel("aoa_filtered", aoa, "aoa_filtered", "g_0", "+x"),
        channel(f"a{y}", acceleration, "acceleration", "m/s^2", f"+{y}"),
        channel(f"a{z}", 0 * time, "acceleration", "m/s^2", f"+{z}"),
        channel(f"{plane}_moment", moment, "moment", "in*lbf", f"+{z}", 0.0),
    ]
    return AcquisitionRecord("das", {each.name: each for each in channels})


def described(run, excitation, **more):
    return {"run": run, "excitation": excitation, "nominal_angle_deg": 0.0} | more


def written(folder, name, record, meta, **fields):
    path = folder / f"{name}.h5"
    write_point(path, RecordedPoint(acquisition=record, meta={"point": name, **meta}, **fields))
    return path


def gain(hz, cutoff_hz=0.4):
    """A Butterworth low-pass of second order, once forward, as a complex number."""
    s = 1j * hz / cutoff_hz
    return 1 / (s**2 + np.sqrt(2) * s + 1)


def modulated(plane, hz, at_hz, *, depth=0.6, **more):
    """A bias of 0.1 deg whose envelope squared is 1 + depth cos(2 pi at_hz t)."""
    passed = depth * gain(at_hz)

    def filtered(time):
        return 1 + np.real(passed * np.exp(2j * np.pi * at_hz * time))

    def envelope(time):
        return np.sqrt(1 + depth * np.cos(2 * np.pi * at_hz * time))

    shape = {"envelope": envelope, "filtered": filtered, "bias_deg": 0.1, "moment_in_lb": 4000.0}
    return das(plane, hz, **shape, **more)
