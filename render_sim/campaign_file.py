"""The campaign file: runs of points with their excitations and levels, as TOML.

A run holds the model at one angle; its first and last points have the shaker off, as in the paper.
A sweep steps the still model through its angles, to calibrate with. A record stands for itself.
"""

import datetime
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from glint_aoa.errors import SetupError
from glint_aoa.setup import Section, load_section, positive, quantity
from render_sim.disturbance import Knock, LooseMass
from render_sim.drive import Series
from render_sim.instruments import SensorErrors
from render_sim.modes import ModelSystem, paper_model_system
from render_sim.package import InertialPackage
from render_sim.scene import Scene, load_scene, paper_scene

__all__ = [
    "Campaign",
    "Drift",
    "Point",
    "Record",
    "Run",
    "Series",
    "Sweep",
    "load_campaign",
    "scene_of",
]

_Radians = Annotated[float, quantity("rad"), Field(allow_inf_nan=False)]
_Spread = Annotated[float, quantity("rad"), Field(ge=0, allow_inf_nan=False)]
_Seconds = Annotated[float, quantity("s"), positive]
_Kelvin = Annotated[float, quantity("K"), positive]
_Line = Annotated[int, Field(strict=True, ge=0)]
_Rows = Annotated[int, Field(strict=True, ge=1)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


class Run(Section):
    """Points at one angle, between a first and a last with the shaker off."""

    name: _Name = Field(description="points are called <name>-01, <name>-02 ...")
    angle: _Radians = Field(description="nominal pitch of the run")
    yaw: _Radians = Field(0.0, description="nominal yaw of the run")
    series: Annotated[tuple[Series, ...], Field(min_length=1)] = Field(
        description="the excitations, in the order of the points"
    )


class Sweep(Section):
    """A pitch sweep of the still model."""

    name: _Name = Field(description="points are called <name>-01, <name>-02 ...")
    first: _Radians = Field(description="nominal pitch of the first point")
    last: _Radians = Field(description="nominal pitch of the last point")
    points: Annotated[int, Field(strict=True, ge=2)] = Field(description="how many, equal steps")


class Record(Section):
    """One point that belongs to no run, of a length and window of its own."""

    name: _Name = Field(description="name of the point")
    angle: _Radians = Field(0.0, description="nominal pitch")
    yaw: _Radians = Field(0.0, description="nominal yaw")
    duration: _Seconds | None = Field(
        None, description="length of the acquisition; the campaign's if not given"
    )
    n_fields: Annotated[int, Field(strict=True, ge=0)] | None = Field(
        None, description="fields, 0 for none; the campaign's if not given"
    )
    window: tuple[_Line, _Rows] | None = Field(
        None, description="first line and how many of them; the scene's if not given"
    )
    excitation: Series | None = Field(
        None, description="as a series, with one level; the shaker is off if not given"
    )
    loose: LooseMass | None = Field(None, description="a loose mass; none if not given")
    knock: Knock | None = Field(None, description="a nod of the model; none if not given")

    @model_validator(mode="after")
    def _is_one_point(self) -> Self:
        if self.excitation is not None and len(self.excitation.moments) > 1:
            raise ValueError(
                f"a record has one level, excitation.moments {len(self.excitation.moments)}; "
                "make it one record each"
            )
        if self.n_fields == 0 and self.window is not None:
            raise ValueError("window without fields; leave it out or give n_fields")
        return self


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
        Its name, which is unique, and its run's; a record's run has its own name.
    run_kind : {"dynamic", "sweep", "record"}
        Whether the shaker is used in the run, and whether there is one.
    angle_rad, yaw_rad : float
        Nominal pitch and yaw [rad].
    progress : float
        How far through its run it is taken, 0 first and 1 last.
    duration_s : float
        Length of the acquisition [s].
    n_fields : int
        How many fields; 0 for none.
    order : int
        Place in the campaign, from 0; sets the time of day.
    series : Series or None
        The excitation; None with the shaker off.
    level : int
        Which of the series' levels.
    window : (int, int) or None
        First line and number of lines; None for the scene's.
    loose : LooseMass or None
        A loose mass in the model.
    knock : Knock or None
        A nod of the model.
    """

    name: str
    run: str
    run_kind: Literal["dynamic", "sweep", "record"]
    angle_rad: float
    yaw_rad: float
    progress: float
    duration_s: float
    n_fields: int
    order: int = 0
    series: Series | None = None
    level: int = 0
    window: tuple[int, int] | None = None
    loose: LooseMass | None = None
    knock: Knock | None = None

    @property
    def moment_n_m(self) -> float:
        """Level in the plane of the series, peak to peak [N m]; 0 with the shaker off."""
        return 0.0 if self.series is None else self.series.moments[self.level]

    @property
    def other_moment_n_m(self) -> float:
        """Level in the other plane [N m]; 0 where it is not driven."""
        other = None if self.series is None else self.series.other_plane
        return 0.0 if other is None else other.moments[self.level]


class Campaign(Section):
    """A campaign file."""

    name: _Name = Field(description="name of the campaign")
    start: datetime.datetime = Field(description="time of day of the first trigger")
    interval: _Seconds = Field(300.0, description="time from point to point")
    temperature: _Kelvin = Field(294.0, description="tunnel temperature")
    n_fields: Annotated[int, Field(strict=True, ge=0)] = Field(
        60, description="fields a point, 0 for none"
    )
    duration: _Seconds = Field(8.0, description="length of the acquisition from the trigger")
    drift: Drift = Drift()
    model: ModelSystem = Field(
        default_factory=paper_model_system, description="the model system; the paper's by default"
    )
    scene: Path | None = Field(
        None, description="scene file, relative to this one; the paper's if not given"
    )
    package: InertialPackage = Field(
        default_factory=InertialPackage, description="the inertial package; ideal by default"
    )
    sensor: tuple[SensorErrors, ...] = Field((), description="what is wrong with single sensors")
    sweep: tuple[Sweep, ...] = Field((), description="pitch sweeps, taken first")
    run: tuple[Run, ...] = Field((), description="the runs")
    record: tuple[Record, ...] = Field((), description="single points, taken last")

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        counted = Counter(point.name for point in self.points)
        twice = [name for name, count in counted.items() if count > 1]
        if not counted:
            raise ValueError("no points; give at least one [[run]], [[sweep]] or [[record]]")
        if twice:
            raise ValueError(f"two points are called {twice[0]}; rename a run or record")
        runs = {each.name for each in self.sweep} | {each.name for each in self.run}
        for record in self.record:
            if record.name in runs:
                raise ValueError(f"a record is called {record.name} like a run; rename it")
        return self

    @model_validator(mode="after")
    def _excitations_fit_their_records(self) -> Self:
        for point in self.points:
            if point.series is not None:
                try:
                    point.series.check_within(point.duration_s)
                except ValueError as error:
                    raise ValueError(f"{point.run}: {error}") from None
        return self

    @property
    def points(self) -> tuple[Point, ...]:
        """All points in the order in which they are taken."""
        found = [p for each in self.sweep for p in self._sweep_points(each)]
        found += [p for each in self.run for p in self._run_points(each)]
        found += [self._record_point(each) for each in self.record]
        return tuple(replace(point, order=order) for order, point in enumerate(found))

    def _sweep_points(self, sweep: Sweep) -> Iterator[Point]:
        for number in range(sweep.points):
            progress = number / (sweep.points - 1)
            yield Point(
                name=f"{sweep.name}-{number + 1:02d}",
                run=sweep.name,
                run_kind="sweep",
                angle_rad=sweep.first + progress * (sweep.last - sweep.first),
                yaw_rad=0.0,
                progress=progress,
                duration_s=self.duration,
                n_fields=self.n_fields,
            )

    def _run_points(self, run: Run) -> Iterator[Point]:
        driven = [(series, level) for series in run.series for level in range(len(series.moments))]
        levels = [(None, 0), *driven, (None, 0)]
        for number, (series, level) in enumerate(levels):
            yield Point(
                name=f"{run.name}-{number + 1:02d}",
                run=run.name,
                run_kind="dynamic",
                angle_rad=run.angle,
                yaw_rad=run.yaw,
                progress=number / (len(levels) - 1),
                duration_s=self.duration,
                n_fields=self.n_fields,
                series=series,
                level=level,
            )

    def _record_point(self, record: Record) -> Point:
        return Point(
            name=record.name,
            run=record.name,
            run_kind="record",
            angle_rad=record.angle,
            yaw_rad=record.yaw,
            progress=0.5,
            duration_s=self.duration if record.duration is None else record.duration,
            n_fields=self.n_fields if record.n_fields is None else record.n_fields,
            series=record.excitation,
            window=record.window,
            loose=record.loose,
            knock=record.knock,
        )


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
