"""Filming a scene in motion: recorded fields, and the truth about every one of them."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.records.fields import FieldInfo
from render_sim.air import light_in_time
from render_sim.mirror import glint_line
from render_sim.motion import Motion
from render_sim.pixel import lens_falloff
from render_sim.recorder import camera_turns, recorded_levels, stored_exposures
from render_sim.renderer import Renderer
from render_sim.scene import Scene
from render_sim.sensor import Levels

__all__ = ["Film", "attitude", "exposure_times", "film"]

Floats = NDArray[np.float64]
Parity = Literal["even", "odd"]

_ROWS_TOGETHER = 4  # lines that a rolling shutter exposes as one


@dataclass(frozen=True, eq=False)
class Film:
    """A filmed sequence.

    Attributes
    ----------
    fields : ndarray
        Grey levels, uint8 or uint16 [field, line, column].
    info : FieldInfo
        Rate, exposure, window and parity, as a recording states them.
    truth : dict of str to ndarray
        By field, means over the exposure: ``pitch_deg``, ``yaw_deg``, ``axis_intercept_mm`` (Z of
        the body's axis at X = 0), ``glint_angle_deg`` and ``glint_intercept_mm`` (see
        `render_sim.mirror.glint_line`); and ``pose`` [field, sub_exposure, 4, 4] [m]. With a
        rolling shutter, those of the window's middle line.
    times_s : ndarray or None
        Start of each field's exposure after the trigger [field] [s], where they are stored.
    """

    fields: Levels
    info: FieldInfo
    truth: dict[str, NDArray[Any]]
    times_s: Floats | None = None


def film(
    scene: Scene,
    motion: Motion,
    n_fields: int,
    *,
    renderer: Renderer,
    rng: np.random.Generator,
    start_s: float = 0.0,
    sub_exposures: int = 5,
    first_parity: Parity | None = None,
) -> Film:
    """Film a scene in motion.

    Parameters
    ----------
    scene : Scene
        The scene; `scene.fields` must state rate and exposure.
    motion : Motion
        Where the model is.
    n_fields : int
        How many fields to record.
    renderer : Renderer
        A renderer of the same scene.
    rng : numpy.random.Generator
        Source of the sensor's noise.
    start_s : float
        Start of field 0's exposure after the trigger [s].
    sub_exposures : int
        Instants over which the light of one exposure is averaged, evenly spread.
    first_parity : {"even", "odd"} or None
        Parity of field 0; the scene's if None.

    Returns
    -------
    Film
        Fields and truth.

    Raises
    ------
    InputError
        If rate or exposure is missing, or there is nothing to record.
    """
    if n_fields < 1 or sub_exposures < 1:
        raise InputError(
            f"{n_fields} fields of {sub_exposures} sub-exposures; give one of each at least"
        )
    first_parity = first_parity or scene.fields.first_parity or "even"
    interlaced = scene.fields.interlaced is not False
    stored = stored_exposures(scene.recorder, n_fields)
    times = exposure_times(
        scene, int(stored[-1]) + 1, start_s=start_s, sub_exposures=sub_exposures
    )[stored]
    parity = (stored + (first_parity == "odd")) % 2 if interlaced else np.zeros_like(stored)
    shutter = _Shutter(scene, motion, renderer, span=(times[0, 0], times[-1, -1]))
    shape = (n_fields, scene.sensor.rows, scene.sensor.columns)
    fields = np.empty(shape, dtype=np.uint8 if scene.sensor.bits == 8 else np.uint16)
    for n in range(n_fields):
        if n and stored[n] == stored[n - 1]:
            fields[n] = fields[n - 1]
            continue
        light = shutter.expose(times[n], int(parity[n]))
        when = float(times[n].mean())
        fields[n] = recorded_levels(light, scene.sensor, scene.recorder, time_s=when, rng=rng)
    info = FieldInfo(
        rate_hz=scene.fields.rate,
        exposure_s=scene.fields.exposure,
        first_line=scene.fields.first_line or 0,
        first_column=scene.fields.first_column or 0,
        first_parity=_stated_parity(int(parity[0]), scene) if interlaced else "even",
        interlaced=interlaced,
        start_s=start_s,
    )
    poses = motion.pose(times + _line_delay(scene, scene.sensor.rows / 2))
    return Film(
        fields=fields,
        info=info,
        truth={**_truth(scene, poses), "pose": poses},
        times_s=_timestamps(scene, stored, start_s),
    )


def _stated_parity(parity: int, scene: Scene) -> Parity:
    return "odd" if parity != scene.recorder.parity_is_wrong else "even"


def _line_delay(scene: Scene, row: float) -> float:
    """Return how much later than the first line a row is exposed [s]."""
    return row * scene.recorder.line_time_s


def _timestamps(scene: Scene, stored: NDArray[np.int64], start_s: float) -> Floats | None:
    if not scene.recorder.timestamps or scene.fields.rate is None:
        return None
    return np.asarray(start_s + stored / scene.fields.rate)


def exposure_times(
    scene: Scene, n_fields: int, *, start_s: float = 0.0, sub_exposures: int = 5
) -> Floats:
    """Return the middles of the sub-exposures [field, sub_exposure] [s after the trigger].

    Raises
    ------
    InputError
        If the scene states no field rate or no exposure.
    """
    rate, exposure = scene.fields.rate, scene.fields.exposure
    if rate is None or exposure is None:
        raise InputError("fields.rate and fields.exposure are missing; a film needs both")
    middles = (np.arange(sub_exposures) + 0.5) / sub_exposures * exposure
    return start_s + np.arange(n_fields)[:, None] / rate + middles


def attitude(scene: Scene, poses: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what poses say about the body's axis.

    Parameters
    ----------
    scene : Scene
        Says where the nose points.
    poses : ndarray
        Poses, model to tunnel [..., 4, 4] [m].

    Returns
    -------
    pitch_rad : ndarray
        Elevation of the axis, nose up positive [...] [rad].
    yaw_rad : ndarray
        Heading about tunnel +Z from straight into the wind [...] [rad].
    intercept_m : ndarray
        The axis's Z at X = 0 [...] [m].
    """
    axis, origin = poses[..., :3, 0], poses[..., :3, 3]
    ahead = -1.0 if scene.nose == "left" else 1.0
    pitch = np.arctan2(axis[..., 2], np.hypot(axis[..., 0], axis[..., 1]))
    yaw = np.arctan2(ahead * axis[..., 1], ahead * axis[..., 0])
    intercept = origin[..., 2] - origin[..., 0] * axis[..., 2] / axis[..., 0]
    return pitch, yaw, intercept


def _truth(scene: Scene, poses: Floats) -> dict[str, Floats]:
    """Return means over the exposures of what poses [field, sub_exposure, 4, 4] are."""
    distinct, which = _distinct(poses)
    pitch, yaw, intercept = attitude(scene, distinct)
    angle, glint_intercept = glint_line(scene, distinct)
    values = {
        "pitch_deg": np.degrees(pitch),
        "yaw_deg": np.degrees(yaw),
        "axis_intercept_mm": intercept * 1e3,
        "glint_angle_deg": np.degrees(angle),
        "glint_intercept_mm": glint_intercept * 1e3,
    }
    return {name: each[which].mean(axis=1) for name, each in values.items()}


def _distinct(poses: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the poses that differ, and which of them each sub-exposure shows."""
    distinct, which = np.unique(poses.reshape(-1, 16), axis=0, return_inverse=True)
    return distinct.reshape(-1, 4, 4), which.reshape(poses.shape[:2])


class _Shutter:
    """Averages the light of an exposure; what stands still is rendered once for each parity."""

    def __init__(
        self, scene: Scene, motion: Motion, renderer: Renderer, *, span: tuple[float, float]
    ) -> None:
        self._scene = scene
        self._motion = motion
        self._renderer = renderer
        self._span = span
        self._falloff = {parity: lens_falloff(scene, parity=parity) for parity in (0, 1)}
        self._last: dict[tuple[int, int], tuple[bytes, Floats]] = {}

    def expose(self, times: Floats, parity: int) -> Floats:
        """Return the light of an exposure, `times` [sub_exposure] those of the first line."""
        if self._scene.recorder.line_time_s == 0:
            return self._exposed(times, parity, 0)
        rows = self._scene.sensor.rows
        light = np.empty((rows, self._scene.sensor.columns))
        for first in range(0, rows, _ROWS_TOGETHER):
            band = slice(first, min(first + _ROWS_TOGETHER, rows))
            delay = _line_delay(self._scene, (band.start + band.stop - 1) / 2)
            light[band] = self._exposed(times + delay, parity, first)[band]
        return light

    def _exposed(self, times: Floats, parity: int, place: int) -> Floats:
        share, airlight = light_in_time(self._scene.air, times, self._span)
        images, which = self._images(times, parity, place)
        weight = np.bincount(which, share, minlength=len(images)) / times.size
        light = np.tensordot(weight, images, axes=1) * self._falloff[parity]
        return np.asarray(light + airlight.mean())

    def _images(self, times: Floats, parity: int, place: int) -> tuple[Floats, NDArray[np.intp]]:
        """Return the images that differ, and which of them each time shows."""
        poses, turns = self._motion.pose(times), camera_turns(self._scene.shake, times)
        seen = poses.reshape(-1, 16)
        if turns is not None:
            seen = np.concatenate([seen, turns.reshape(-1, 9)], axis=1)
        _, first, which = np.unique(seen, axis=0, return_index=True, return_inverse=True)
        key = seen[first].tobytes()
        if self._last.get((parity, place), (b"",))[0] != key:
            how = {} if turns is None else {"turns": turns[first]}
            images = self._renderer.radiance(poses[first], parity=parity, **how)
            self._last[parity, place] = key, images
        return self._last[parity, place][1], which.reshape(-1)
