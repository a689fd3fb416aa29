"""Simulating a campaign: every point filmed, acquired and written.

Every point draws from random streams of its own, seeded by the seed and its name, so that neither
the order nor the number of processes changes a single bit.
"""

import datetime
import hashlib
import importlib.metadata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np

from glint_aoa.errors import OutputError
from glint_aoa.records._files import make_folder
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.formats.hdf5 import read_meta
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.units import convert
from glint_aoa.workers import Workers
from render_sim.acquisition import Acquisition, Recording, acquire
from render_sim.campaign_file import Campaign, Point, load_campaign, scene_of
from render_sim.decay import ShutOff, UntilOff
from render_sim.disturbance import Knocked, loose_signals
from render_sim.drive import Drive
from render_sim.excitation import Tones, peak_to_peak, period_beyond
from render_sim.film import film
from render_sim.modal_motion import ModalMotion, Signal
from render_sim.modes import Plane, balance_moment, joint_angles, modal_angles
from render_sim.motion import Motion, StaticMotion
from render_sim.renderer import Renderer, make_renderer
from render_sim.scene import Scene

__all__ = [
    "Campaign",
    "Point",
    "PointMotion",
    "load_campaign",
    "point_acquisition",
    "point_motion",
    "point_scene",
    "simulate_campaign",
    "simulate_point",
]

RendererName = Literal["auto", "raytrace", "pyrender"]


@dataclass(frozen=True, eq=False)
class PointMotion:
    """How the model moves at a point.

    Attributes
    ----------
    motion, static : Motion
        With vibration, and without.
    forces : dict of "yaw" or "pitch" to Signal
        The shaker's force in each plane that it drives [N], the series' own plane first; empty
        with the shaker off.
    """

    motion: Motion
    static: Motion
    forces: Mapping[Plane, Signal] = field(default_factory=dict)


@dataclass(frozen=True)
class _Streams:
    """The random streams of a point, independent of each other and of all other points."""

    force: np.random.Generator
    fields: np.random.Generator
    acquisition: np.random.Generator
    loose: np.random.Generator


def _seeded(seed: int, name: str) -> np.random.SeedSequence:
    return np.random.SeedSequence([seed, *name.encode()])


def _streams(point: Point, seed: int) -> _Streams:
    return _Streams(*map(np.random.default_rng, _seeded(seed, f"point {point.name}").spawn(4)))


def _static_pitch(campaign: Campaign, point: Point, seed: int) -> float:
    rng = np.random.default_rng(_seeded(seed, f"run {point.run}"))
    offset, change = rng.standard_normal(2) * (campaign.drift.run, campaign.drift.within_run)
    return float(point.angle_rad + offset + (point.progress - 0.5) * change)


def point_motion(
    campaign: Campaign, point: Point, *, scene: Scene | None = None, seed: int = 0
) -> PointMotion:
    """Return how the model moves at a point, its shaker force scaled to the point's level."""
    scene, model = scene or scene_of(campaign), campaign.model
    pitch = _static_pitch(campaign, point, seed)
    static = StaticMotion(scene, pitch, yaw_rad=point.yaw_rad)
    if point.series is None:
        return PointMotion(_knocked(static, point), static)
    forces = _forces(campaign, point, _streams(point, seed).force)
    angles = joint_angles(model, forces)
    off = point.series.shaker_off
    if off is None:
        return PointMotion(_knocked(ModalMotion(static, model, angles), point), static, forces)
    ringing = ModalMotion(static, model, [(mode, ShutOff(mode, a, off)) for mode, a in angles])
    until_off = {plane: UntilOff(force, off) for plane, force in forces.items()}
    return PointMotion(_knocked(ringing, point), static, until_off)


def _knocked(motion: Motion, point: Point) -> Motion:
    return motion if point.knock is None else Knocked(motion, point.knock)


def _forces(campaign: Campaign, point: Point, rng: np.random.Generator) -> dict[Plane, Tones]:
    """Return the force in each plane [N], at the point's level until the shaker stops."""
    series = point.series
    if series is None:
        return {}
    forces = {series.plane: _at_level(campaign, point, series, series.plane, rng)}
    if series.other_plane is not None:
        other = series.across
        forces[other] = _at_level(campaign, point, series.other_plane, other, rng)
    return forces


def _at_level(
    campaign: Campaign, point: Point, drive: Drive, plane: Plane, rng: np.random.Generator
) -> Tones:
    model = campaign.model
    unit = drive.force(rng, duration_s=point.duration_s, lead_s=campaign.package.settling_s)
    moment = balance_moment(model, unit, modal_angles(model, unit, plane), plane)
    shaken_s = (point.series and point.series.shaker_off) or point.duration_s
    level = drive.moments[point.level]
    return unit.scaled(level / peak_to_peak(moment, duration_s=shaken_s))


def point_acquisition(
    campaign: Campaign, point: Point, *, scene: Scene | None = None, seed: int = 0
) -> Acquisition:
    """Return the acquisition record of a point; no field is rendered."""
    return _acquire(campaign, point, point_motion(campaign, point, scene=scene, seed=seed), seed)


def _acquire(campaign: Campaign, point: Point, moved: PointMotion, seed: int) -> Acquisition:
    return acquire(
        campaign.model,
        moved.motion,
        moved.static,
        forces=moved.forces,
        recording=Recording(
            duration_s=point.duration_s,
            package=campaign.package.later(point.order * campaign.interval),
            errors=campaign.sensor,
            strays=_strays(campaign, point, seed),
        ),
        rng=_streams(point, seed).acquisition,
    )


def _strays(campaign: Campaign, point: Point, seed: int) -> dict[str, Signal]:
    if point.loose is None:
        return {}
    period = period_beyond(point.duration_s + campaign.package.settling_s)
    return loose_signals(point.loose, period_s=period, rng=_streams(point, seed).loose)


def simulate_point(
    campaign: Campaign,
    point: Point,
    *,
    renderer: Renderer,
    scene: Scene | None = None,
    seed: int = 0,
) -> RecordedPoint:
    """Film and acquire one point.

    Parameters
    ----------
    campaign : Campaign
        Model, lengths and drift.
    point : Point
        One of its points.
    renderer : Renderer
        Of the scene, through the point's window.
    scene : Scene, optional
        The test section; the campaign's by default.
    seed : int
        Seed of the whole campaign.

    Returns
    -------
    RecordedPoint
        Fields if the point has any, 28 channels, truth and description, on one trigger.
    """
    scene = point_scene(point, scene or scene_of(campaign))
    moved = point_motion(campaign, point, scene=scene, seed=seed)
    acquired = _acquire(campaign, point, moved, seed)
    trigger = campaign.start + datetime.timedelta(seconds=point.order * campaign.interval)
    recorded = RecordedPoint(
        acquisition=AcquisitionRecord(name=point.name, channels=acquired.channels),
        truth=acquired.truth,
        meta=_meta(campaign, point, scene=scene, seed=seed, renderer=renderer.name),
    )
    if point.n_fields == 0:  # the fields would have stated the trigger
        return replace(recorded, meta={**recorded.meta, "trigger_time": trigger.isoformat()})
    filmed = film(
        scene,
        moved.motion,
        point.n_fields,
        renderer=renderer,
        rng=_streams(point, seed).fields,
    )
    return replace(
        recorded,
        fields=filmed.fields,
        info=replace(filmed.info, trigger_time=trigger.isoformat()),
        truth={**filmed.truth, **acquired.truth},
        fields_time_s=filmed.times_s,
    )


def point_scene(point: Point, scene: Scene) -> Scene:
    """Return the campaign's scene as recorded at a point: through the point's window."""
    return scene if point.window is None else scene.with_window(*point.window)


def _meta(
    campaign: Campaign, point: Point, *, scene: Scene, seed: int, renderer: str
) -> dict[str, str | float | int]:
    return {
        "campaign": campaign.name,
        "run": point.run,
        "run_kind": point.run_kind,
        "point": point.name,
        **_excitation_meta(point),
        "nominal_angle_deg": round(float(np.rad2deg(point.angle_rad)), 9),
        "nominal_yaw_deg": round(float(np.rad2deg(point.yaw_rad)), 9),
        "tunnel_temperature_K": campaign.temperature,
        "versions": _versions(),
        "seed": seed,
        "renderer": renderer,
        "plan_hash": _plan_hash(campaign, scene),
    }


def _excitation_meta(point: Point) -> dict[str, str | float]:
    series, in_lb = point.series, convert("N*m", "in*lbf")
    meta: dict[str, str | float] = {
        "excitation": series.label if series else "off",
        "excitation_plane": series.plane if series else "none",
        "excitation_kind": series.kind if series else "off",
        "nominal_moment_in_lb": round(point.moment_n_m * in_lb, 6),
    }
    if series and series.other_plane:
        meta["other_plane_kind"] = series.other_plane.kind
        meta["other_plane_moment_in_lb"] = round(point.other_moment_n_m * in_lb, 6)
    if series and series.shaker_off is not None:
        meta["shaker_off_s"] = series.shaker_off
    return meta


@lru_cache(maxsize=4)
def _plan_hash(campaign: Campaign, scene: Scene) -> str:
    """Tell campaigns and scenes apart; where their files lie does not count."""
    plan = campaign.model_dump_json(exclude={"scene"}) + repr(scene)
    return hashlib.sha256(plan.encode()).hexdigest()[:16]


def _versions() -> str:
    try:
        own = importlib.metadata.version("glint-aoa")
    except importlib.metadata.PackageNotFoundError:  # run from its source tree
        own = "not installed"
    return f"glint-aoa {own}, numpy {np.__version__}"


def simulate_campaign(
    campaign: Campaign,
    out_dir: str | Path,
    *,
    renderer: RendererName = "auto",
    seed: int = 0,
    jobs: int = 1,
    scene: Scene | None = None,
    overwrite: bool = False,
    resume: bool = False,
) -> Iterator[Path]:
    """Simulate a campaign and write each point as ``<point>.h5``.

    Parameters
    ----------
    campaign : Campaign
        What to simulate; ``len(campaign.points)`` files.
    out_dir : str or Path
        Where to write; made if it is not there.
    renderer : {"auto", "raytrace", "pyrender"}
        Which renderer to use.
    seed : int
        The same seed and renderer give the same bits.
    jobs : int
        How many processes share the points.
    scene : Scene, optional
        The test section; the campaign's by default.
    overwrite : bool
        Whether files of these names may be replaced.
    resume : bool
        Whether points that the folder holds already are left as they are.

    Returns
    -------
    iterator of Path
        Each file in the campaign's order, as soon as it is whole; those that were there already
        come first. The points are simulated as the iterator is run.

    Raises
    ------
    OutputError
        At once if a file exists and `overwrite` is False, or the folder cannot be made; with
        `resume` only if a file comes from another campaign, scene, seed or renderer.
    MissingLibraryError
        If the renderer asked for does not work here.
    """
    scene = scene or scene_of(campaign)
    name = _renderer(scene, renderer).name
    out_dir = Path(out_dir)
    make_folder(out_dir)
    there = [point for point in campaign.points if (out_dir / f"{point.name}.h5").exists()]
    if resume:
        for point in there:
            seen = point_scene(point, scene)
            expected = _meta(campaign, point, scene=seen, seed=seed, renderer=name)
            _check_origin(out_dir / f"{point.name}.h5", expected)
    elif there and not overwrite:
        raise OutputError(
            f"{out_dir}: {there[0].name}.h5 exists already; choose another folder, resume or allow "
            "overwriting"
        )
    write = partial(
        _write,
        campaign=campaign,
        out_dir=out_dir,
        scene=scene,
        renderer=renderer,
        seed=seed,
        overwrite=overwrite,
    )
    kept = there if resume else []
    left = tuple(point for point in campaign.points if point not in kept)
    return chain((out_dir / f"{point.name}.h5" for point in kept), _written(write, left, jobs))


def _check_origin(path: Path, expected: dict[str, str | float | int]) -> None:
    """Refuse to go on from a point that this campaign would not have written."""
    found = read_meta(path)
    for key in ("plan_hash", "seed", "renderer"):
        if found.get(key) != expected[key]:
            what = "campaign or scene" if key == "plan_hash" else key
            raise OutputError(
                f"{path}: was simulated with another {what}; choose another folder or overwrite"
            )


def _written(write: "partial[Path]", points: tuple[Point, ...], jobs: int) -> Iterator[Path]:
    with Workers(jobs) as workers:
        yield from workers.map(write, points)


def _write(
    point: Point,
    *,
    campaign: Campaign,
    out_dir: Path,
    scene: Scene,
    renderer: RendererName,
    seed: int,
    overwrite: bool,
) -> Path:
    path = out_dir / f"{point.name}.h5"
    made = _renderer(point_scene(point, scene), renderer)
    recorded = simulate_point(campaign, point, renderer=made, scene=scene, seed=seed)
    write_point(path, recorded, overwrite=overwrite)
    return path


@lru_cache(maxsize=1)
def _renderer(scene: Scene, name: RendererName) -> Renderer:
    """Make the renderer once in each process; OpenGL contexts and kernels are dear."""
    return make_renderer(scene, name)
