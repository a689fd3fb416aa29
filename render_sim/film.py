"""Filming a scene in motion: recorded fields, and the truth about every one of them."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.records.fields import FieldInfo
from render_sim.mirror import glint_line
from render_sim.motion import Motion
from render_sim.renderer import Renderer
from render_sim.scene import Scene
from render_sim.sensor import Levels, record

__all__ = ["Film", "attitude", "exposure_times", "film"]

Floats = NDArray[np.float64]
Parity = Literal["even", "odd"]


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
        `render_sim.mirror.glint_line`); and ``pose`` [field, sub_exposure, 4, 4] [m].
    """

    fields: Levels
    info: FieldInfo
    truth: dict[str, NDArray[Any]]


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
    times = exposure_times(scene, n_fields, start_s=start_s, sub_exposures=sub_exposures)
    poses = motion.pose(times)
    distinct, which = _distinct(poses)
    camera = _Shutter(renderer, distinct)
    shape = (n_fields, scene.sensor.rows, scene.sensor.columns)
    fields = np.empty(shape, dtype=np.uint8 if scene.sensor.bits == 8 else np.uint16)
    for n in range(n_fields):
        parity = (n + (first_parity == "odd")) % 2 if interlaced else 0
        fields[n] = record(camera.expose(which[n], parity), scene.sensor, rng=rng)
    info = FieldInfo(
        rate_hz=scene.fields.rate,
        exposure_s=scene.fields.exposure,
        first_line=scene.fields.first_line or 0,
        first_column=scene.fields.first_column or 0,
        first_parity=first_parity if interlaced else "even",
        interlaced=interlaced,
        start_s=start_s,
    )
    truth = {name: values[which].mean(axis=1) for name, values in _truth(scene, distinct).items()}
    return Film(fields=fields, info=info, truth={**truth, "pose": poses})


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
    pitch, yaw, intercept = attitude(scene, poses)
    angle, glint_intercept = glint_line(scene, poses)
    return {
        "pitch_deg": np.degrees(pitch),
        "yaw_deg": np.degrees(yaw),
        "axis_intercept_mm": intercept * 1e3,
        "glint_angle_deg": np.degrees(angle),
        "glint_intercept_mm": glint_intercept * 1e3,
    }


def _distinct(poses: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the poses that differ, and which of them each sub-exposure shows."""
    distinct, which = np.unique(poses.reshape(-1, 16), axis=0, return_inverse=True)
    return distinct.reshape(-1, 4, 4), which.reshape(poses.shape[:2])


class _Shutter:
    """Averages the light of an exposure; a pose that lasts is rendered once for each parity."""

    def __init__(self, renderer: Renderer, poses: Floats) -> None:
        self._renderer = renderer
        self._poses = poses
        self._last: dict[int, tuple[bytes, Floats]] = {}

    def expose(self, which: NDArray[np.intp], parity: int) -> Floats:
        key = which.tobytes()
        if parity not in self._last or self._last[parity][0] != key:
            used, times = np.unique(which, return_counts=True)
            images = self._renderer.radiance(self._poses[used], parity=parity)
            mean = (times / which.size) @ images.reshape(len(used), -1)
            self._last[parity] = key, mean.reshape(images.shape[1:])
        return self._last[parity][1]
