"""One vibration mode in closed form (eq. 1 to 6): record and bias, sine or modulated sine."""

import numpy as np

from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.modes import Mode
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import InertialFilter

RATE_HZ = 800.0
GRAVITY = 9.80665


def channel(name, samples, quantity, *, units="m/s^2", axis=None, station_m=0.9):
    return Channel(
        name,
        np.asarray(samples),
        RATE_HZ,
        quantity=quantity,
        units=units,
        axis=axis,
        station_m=station_m,
    )


def velocity_and_acceleration(mode, time_s, *, speed, depth, modulation_hz):
    """v = V (1 + m cos W t) cos(w t + 0.3) and its derivative."""
    w, slow = 2 * np.pi * mode.frequency_hz, 2 * np.pi * modulation_hz
    envelope = speed * (1 + depth * np.cos(slow * time_s))
    change = -speed * depth * slow * np.sin(slow * time_s)
    phase = w * time_s + 0.3
    velocity = envelope * np.cos(phase)
    return velocity, change * np.cos(phase) - w * envelope * np.sin(phase)


def task(
    mode, *, turn_rad=0.003, depth=0.0, modulation_hz=0.3, duration_s=20.0, angle=0.0, modes=None
):
    """Task of a single mode without noise, and its bias V^2 / rho before the low-pass."""
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    circular = 2 * np.pi * mode.frequency_hz
    speed = turn_rad * abs(mode.radius_m) * circular
    velocity, acceleration = velocity_and_acceleration(
        mode, time, speed=speed, depth=depth, modulation_hz=modulation_hz
    )
    bias = velocity**2 / mode.radius_m
    tipped = 1 + GRAVITY * np.sin(angle) / circular**2 / mode.radius_m
    axes = {"yaw": "+y", "pitch": "+z"}
    found = [channel("aoa", GRAVITY * np.sin(angle) - bias, "aoa_unfiltered", axis="+x")]
    for plane, axis in axes.items():
        shown = acceleration * tipped if plane == mode.plane else np.zeros(time.size)
        found.append(channel(f"a{axis[1]}", shown, "acceleration", axis=axis))
    record = AcquisitionRecord("closed-form", {each.name: each for each in found})
    modes = (mode,) if modes is None else modes
    return CorrectionTask(record, package_output(record), modes, InertialFilter()), bias


def mode(number, plane, frequency_hz, radius_m):
    return Mode(number, plane, frequency_hz, radius_m)
