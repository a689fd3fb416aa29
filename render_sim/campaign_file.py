"""The campaign file: runs of points with their excitations and levels, as TOML.

A run holds the model at one angle; its first and last points have the shaker off, as in the paper.
A sweep steps the still model through its angles, to calibrate with.
"""

import datetime
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from glint_aoa.errors import SetupError
from glint_aoa.setup import Section, load_section, positive, quantity
from render_sim.excitation import Tones, modulated_sine, random_band, sine
from render_sim.modes import ModelSystem, Plane, paper_model_system
from render_sim.scene import Scene, load_scene, paper_scene

__all__ = ["Campaign", "Drift", "Point", "Run", "Series", "Sweep", "load_campaign", "scene_of"]

_Radians = Annotated[float, quantity("rad"), Field(allow_inf_nan=False)]
_Spread = Annotated[float, quantity("rad"), Field(ge=0, allow_inf_nan=False)]
_Hertz = Annotated[float, quantity("Hz"), positive]
_Seconds = Annotated[float, quantity("s"), positive]
_Moment = Annotated[float, quantity("N*m"), positive]
_Kelvin = Annotated[float, quantity("K"), positive]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


class Series(Section):
    """Points of one excitation at rising levels; hertz and N m."""

    kind: Literal["sine", "modulated sine", "random"] = Field(description="the shaker's signal")
    plane: Plane = Field(description="plane of the force")
    frequency: _Hertz | None = Field(None, description="of the sine; none for random")
    modulation: _Hertz = Field(0.25, description="frequency of the amplitude modulation")
    depth: Annotated[float, Field(strict=True, gt=0, le=1)] = Field(
        1.0, description="depth of the force's amplitude modulation"
    )
    band: tuple[_Hertz, _Hertz] = Field((5.0, 60.0), description="of the random signal")
    moments: Annotated[tuple[_Moment, ...], Field(min_length=1)] = Field(
        description="levels: peak-to-peak balance moment in the plane, over the record"
    )

    @model_validator(mode="after")
    def _signal_is_whole(self) -> Self:
        if (self.frequency is None) != (self.kind == "random"):
            raise ValueError("give frequency for a sine or modulated sine, and none for random")
        if self.band[0] >= self.band[1]:
            raise ValueError("band is empty; give its lower end, then its upper")
        return self

    @property
    def label(self) -> str:
        """What is written of the excitation, such as ``"yaw sine 9.8 Hz"``."""
        if self.kind == "random":
            return f"{self.plane} random {self.band[0]:g}-{self.band[1]:g} Hz"
        at = f" at {self.modulation:g} Hz" if self.kind == "modulated sine" else ""
        return f"{self.plane} {self.kind} {self.frequency:g} Hz{at}"

    def force(self, rng: np.random.Generator) -> Tones:
        """Return the shaker's force at unit level, its phases drawn from `rng`."""
        if self.frequency is None:
            return random_band(*self.band, rng=rng)
        if self.kind == "sine":
            return sine(self.frequency, rng=rng)
        return modulated_sine(
            self.frequency, modulation_hz=self.modulation, depth=self.depth, rng=rng
        )


class Run(Section):
    """Points at one angle, between a first and a last with the shaker off."""

    name: _Name = Field(description="points are called <name>-01, <name>-02 ...")
    angle: _Radians = Field(description="nominal pitch of the run")
    series: Annotated[tuple[Series, ...], Field(min_length=1)] = Field(
        description="the excitations, in the order of the points"
    )


class Sweep(Section):
    """A pitch sweep of the still model."""

    name: _Name = Field(description="points are called <name>-01, <name>-02 ...")
    first: _Radians = Field(description="nominal pitch of the first point")
    last: _Radians = Field(description="nominal pitch of the last point")
    points: Annotated[int, Field(strict=True, ge=2)] = Field(description="how many, equal steps")


class Drift(Section):
    """How well the support holds the model: standard deviations of its true pitch [rad]."""

    run: _Spread = Field(0.0, description="offset of a whole run from its nominal angle")
    within_run: _Spread = Field(0.0, description="change from first to last point, linear")


@dataclass(frozen=True)
class Point:
    """One point of the campaign.

    Attributes
    ----------
    name, run : str
        Its name, which is unique, and its run's.
    run_kind : {"dynamic", "sweep"}
        Whether the shaker is used in the run.
    angle_rad : float
        Nominal pitch [rad].
    progress : float
        How far through its run it is taken, 0 first and 1 last.
    order : int
        Place in the campaign, from 0; sets the time of day.
    series : Series or None
        The excitation; None with the shaker off.
    moment_n_m : float
        Level, peak to peak [N m].
    """

    name: str
    run: str
    run_kind: Literal["dynamic", "sweep"]
    angle_rad: float
    progress: float
    order: int
    series: Series | None = None
    moment_n_m: float = 0.0


class Campaign(Section):
    """A campaign file."""

    name: _Name = Field(description="name of the campaign")
    start: datetime.datetime = Field(description="time of day of the first trigger")
    interval: _Seconds = Field(300.0, description="time from point to point")
    temperature: _Kelvin = Field(294.0, description="tunnel temperature")
    n_fields: Annotated[int, Field(strict=True, ge=1)] = Field(60, description="fields a point")
    duration: _Seconds = Field(8.0, description="length of the acquisition from the trigger")
    drift: Drift = Drift()
    model: ModelSystem = Field(
        default_factory=paper_model_system, description="the model system; the paper's by default"
    )
    scene: Path | None = Field(
        None, description="scene file, relative to this one; the paper's if not given"
    )
    sweep: tuple[Sweep, ...] = Field((), description="pitch sweeps, taken first")
    run: tuple[Run, ...] = Field((), description="the runs")

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        counted = Counter(point.name for point in self.points)
        twice = [name for name, count in counted.items() if count > 1]
        if not counted:
            raise ValueError("no points; give at least one [[run]] or [[sweep]]")
        if twice:
            raise ValueError(f"two points are called {twice[0]}; rename a run")
        return self

    @property
    def points(self) -> tuple[Point, ...]:
        """All points in the order in which they are taken."""
        found = [p for each in self.sweep for p in _sweep_points(each)]
        found += [p for each in self.run for p in _run_points(each)]
        return tuple(replace(point, order=order) for order, point in enumerate(found))


def _sweep_points(sweep: Sweep) -> Iterator[Point]:
    for number in range(sweep.points):
        progress = number / (sweep.points - 1)
        angle = sweep.first + progress * (sweep.last - sweep.first)
        name = f"{sweep.name}-{number + 1:02d}"
        yield Point(name, sweep.name, "sweep", angle, progress, order=0)


def _run_points(run: Run) -> Iterator[Point]:
    driven = [(series, moment) for series in run.series for moment in series.moments]
    levels = [(None, 0.0), *driven, (None, 0.0)]
    for number, (series, moment) in enumerate(levels):
        progress = number / (len(levels) - 1)
        name = f"{run.name}-{number + 1:02d}"
        yield Point(name, run.name, "dynamic", run.angle, progress, 0, series, moment)


def load_campaign(campaign: str | Path) -> Campaign:
    """Read a campaign.

    Parameters
    ----------
    campaign : str or Path
        ``"paper"`` for the paper's whole test, ``"demo"`` for a part of it, or a TOML file.

    Returns
    -------
    Campaign
        In SI units and radians.

    Raises
    ------
    SetupError
        If there is no such campaign, or the file holds an unknown key or a wrong value; the
        message names it.
    """
    built_in = files("render_sim") / "data" / f"{campaign}.toml"
    if campaign in ("demo", "paper"):
        with as_file(built_in) as path:
            return load_section(path, Campaign)
    path = Path(campaign)
    if not path.suffix and not path.exists():
        raise SetupError(f"no campaign is called {campaign}; choose paper, demo or a TOML file")
    loaded = load_section(path, Campaign)
    if loaded.scene is None:
        return loaded
    return loaded.model_copy(update={"scene": path.parent / loaded.scene})


@lru_cache(maxsize=4)
def scene_of(campaign: Campaign) -> Scene:
    """Return the campaign's test section; raise SetupError if its file cannot be used."""
    return paper_scene() if campaign.scene is None else load_scene(campaign.scene)
