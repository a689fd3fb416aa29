"""What camera and recorder add to the light: which exposures are stored, jitter, drift, faults."""

import numpy as np
from numpy.typing import NDArray

from render_sim.motion import rotation_x, rotation_y, rotation_z
from render_sim.scene import Recorder, Sensor, Shake
from render_sim.sensor import Levels, record

__all__ = ["camera_turns", "recorded_levels", "stored_exposures"]

Floats = NDArray[np.float64]

_ABOUT = {"roll": rotation_y, "tilt": rotation_x, "pan": rotation_z}


def stored_exposures(recorder: Recorder, n_fields: int) -> NDArray[np.int64]:
    """Return the numbers of the exposures that a recording of `n_fields` holds [field].

    Parameters
    ----------
    recorder : Recorder
        Says which are dropped, and which are stored twice.
    n_fields : int
        Fields in the recording.
    """
    taken = np.arange(n_fields + len(set(recorder.dropped)))
    kept = taken[~np.isin(taken, recorder.dropped)]
    times = np.where(np.isin(kept, recorder.repeated), 2, 1)
    return np.repeat(kept, times)[:n_fields]


def camera_turns(shake: tuple[Shake, ...], time_s: Floats) -> Floats | None:
    """Return how the camera is turned at times [time] [s], as `Renderer.radiance` takes it.

    Parameters
    ----------
    shake : tuple of Shake
        Its vibrations.
    time_s : ndarray
        Times after the trigger [time] [s].

    Returns
    -------
    ndarray or None
        Rotations [time, 3, 3]; None for a camera that stands still.
    """
    if not shake:
        return None
    turns = np.eye(3)
    for each in shake:
        phase = 2 * np.pi * each.frequency_hz * time_s + each.phase_rad
        turns = turns @ _ABOUT[each.axis](each.amplitude_rad * np.sin(phase))
    return turns


def recorded_levels(
    light: Floats,
    sensor: Sensor,
    recorder: Recorder,
    *,
    time_s: float,
    rng: np.random.Generator,
) -> Levels:
    """Turn the light of one exposure into stored grey levels.

    Parameters
    ----------
    light : ndarray
        Mean light over the exposure, above black [row, column] [grey levels].
    sensor : Sensor
        Noise, black level and bits.
    recorder : Recorder
        Drift, jitter and dead columns.
    time_s : float
        Time of the exposure after the trigger [s].
    rng : numpy.random.Generator
        Source of jitter and noise.

    Returns
    -------
    ndarray
        Grey levels [row, column].
    """
    if recorder.line_jitter > 0:
        light = _jittered(light, recorder.line_jitter * rng.standard_normal(len(light)))
    if recorder.dead_columns:
        light = light.copy()
        light[:, list(recorder.dead_columns)] = 0.0
    return record(
        light,
        sensor,
        rng=rng,
        gain=1.0 + recorder.gain_drift * time_s,
        black_change=recorder.black_drift * time_s,
    )


def _jittered(light: Floats, shift: Floats) -> Floats:
    """Shift each row to the right by its own part of a column; what lies beyond is the edge's."""
    columns = np.arange(light.shape[1], dtype=np.float64)
    rows = [np.interp(columns - by, columns, row) for by, row in zip(shift, light, strict=True)]
    return np.array(rows)
