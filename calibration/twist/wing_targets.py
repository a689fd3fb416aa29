"""The list of a wing's targets: which station each belongs to, and where it is to be found."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.targets.table import TargetTable
from glint_aoa.errors import CalibrationError
from glint_aoa.geometry import PixelToPlane
from glint_aoa.setup import Setup

__all__ = ["WingTargets", "read_wing_targets"]

Floats = NDArray[np.float64]

_COLUMNS = ("id", "station", "y", "u", "v", "x", "z", "radius", "nx", "ny", "nz")
_PIXELS = ("", "pixel", "pixels", "px")


@dataclass(frozen=True, eq=False)
class WingTargets:
    """Targets of a wing.

    Attributes
    ----------
    ids : tuple of str
        Their names.
    station : tuple of str
        Name of the station of each.
    y : ndarray, shape (target,)
        Known Y in the tunnel frame [m].
    start : ndarray, shape (target, 2)
        Sensor column and field line near which each is seen without flow [pixels]; all of them
        may be shifted, turned and scaled together.
    radius : ndarray, shape (target,)
        Radius of the disc [m]; 0 where it is not known, and perspective is not corrected for.
    normal : ndarray, shape (target, 3)
        Normal of the disc in the tunnel frame, of any length.

    Raises
    ------
    CalibrationError
        If a name is there twice, two targets start from one place, or a station has one only.
    """

    ids: tuple[str, ...]
    station: tuple[str, ...]
    y: Floats
    start: Floats
    radius: Floats
    normal: Floats

    def __post_init__(self) -> None:
        """Refuse what does not make a rotation at each station."""
        twice = next((name for name in self.ids if self.ids.count(name) > 1), None)
        if twice is not None:
            raise CalibrationError(f"target {twice} is there twice; give each target once")
        for name in self.stations:
            own = [
                each for each, where in zip(self.ids, self.station, strict=True) if where == name
            ]
            if len(own) < 2:
                raise CalibrationError(
                    f"station {name} has one target only ({own[0]}), which shows no rotation; "
                    "add a target there or leave the station out"
                )
        for i, place in enumerate(self.start):
            same = np.flatnonzero((self.start[:i] == place).all(axis=1))
            if same.size:
                raise CalibrationError(
                    f"targets {self.ids[same[0]]} and {self.ids[i]} are at the same place; correct "
                    "one of them or leave it out"
                )

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.ids)

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of the stations by their Y."""
        mean = {
            name: self.y[[each == name for each in self.station]].mean() for name in self.station
        }
        return tuple(sorted(mean, key=mean.__getitem__))

    def at(self, station: str) -> NDArray[np.int64]:
        """Return the numbers of a station's targets.

        Raises
        ------
        CalibrationError
            If there is no such station.
        """
        if station not in self.station:
            raise CalibrationError(
                f"{station!r} is no station of the targets; give one of {', '.join(self.stations)}"
            )
        return np.flatnonzero([each == station for each in self.station])


def read_wing_targets(path: str | Path, setup: Setup) -> WingTargets:
    """Read the table of a wing's targets.

    Parameters
    ----------
    path : str or Path
        CSV with the columns ``id``; ``y`` with its unit in the header, such as ``y [mm]`` or
        ``y_in``, or ``station`` with a unit in its place; where they are seen without flow, as
        ``u, v`` [sensor column, field line] or ``x, z`` with unit; optionally ``station`` (a
        name), ``radius`` with unit, and the disc's normal ``nx, ny, nz``, which is that of the
        known plane where not given.
    setup : Setup
        The camera, by which ``x, z`` are projected.

    Returns
    -------
    WingTargets
        In metres and pixels.

    Raises
    ------
    CalibrationError
        If the table cannot be read, lacks a unit, or holds targets that cannot be; the message
        names file and line.
    """
    table = TargetTable.read(path, _COLUMNS, ("id",))
    ids = table.ids()
    column = "y" if "y" in table else "station"
    if column not in table:
        raise CalibrationError(
            f"{table.path}: no column y; give each target's known Y with its unit, e.g. y [mm]"
        )
    y = table.lengths(column, None)
    is_named = "station" in table and column != "station"
    station = table.cells["station"] if is_named else [f"{1e3 * each:.6g} mm" for each in y]
    radius = table.lengths("radius", None) if "radius" in table else np.zeros(len(ids))
    if (radius < 0).any():
        line = table.rows[int(np.argmax(radius < 0))]
        raise CalibrationError(f"{table.path}: line {line}: a radius must not be negative")
    try:
        return WingTargets(
            ids, tuple(station), y, _start(table, y, setup), radius, _normals(table, setup)
        )
    except CalibrationError as error:
        named = str(error).startswith(str(table.path))
        raise CalibrationError(str(error) if named else f"{table.path}: {error}") from None


def _start(table: TargetTable, y: Floats, setup: Setup) -> Floats:
    """Where the targets are seen without flow [pixels]."""
    if "u" in table and "v" in table:
        for name in ("u", "v"):
            if table.units[name].lower() not in _PIXELS:
                raise CalibrationError(
                    f"{table.path}: column {name} says {table.units[name]}; u and v are in pixels"
                )
        start = np.stack([table.numbers("u"), table.numbers("v")], axis=-1)
        _check_on_sensor(table, start, setup)
        return start
    if "x" in table and "z" in table:
        points = np.stack([table.lengths("x", None), y, table.lengths("z", None)], axis=-1)
        plane = PixelToPlane.of_camera(setup.camera, y=0.0, yaw=0.0)
        return np.stack(plane.project(points), axis=-1)
    raise CalibrationError(
        f"{table.path}: no columns u, v [pixels] or x, z [mm]; say where each target is seen "
        "without flow"
    )


def _check_on_sensor(table: TargetTable, start: Floats, setup: Setup) -> None:
    if setup.camera.sensor is None:
        return
    columns, lines = setup.camera.sensor
    for name, values, limit in (("u", start[:, 0], columns), ("v", start[:, 1], lines)):
        off = (values < -0.5) | (values > limit)
        if off.any():
            line, value = table.rows[int(np.argmax(off))], values[off][0]
            frame = ", which has half as many lines as a frame" if name == "v" else ""
            raise CalibrationError(
                f"{table.path}: line {line}: {name} = {value:g} is not on the sensor of {columns} "
                f"columns and {lines} lines per field{frame}; correct it or camera.sensor"
            )


def _normals(table: TargetTable, setup: Setup) -> Floats:
    names = ("nx", "ny", "nz")
    given = [name in table for name in names]
    if not any(given):
        yaw = setup.glint.yaw
        return np.tile([-np.sin(yaw), np.cos(yaw), 0.0], (len(table.rows), 1))
    if not all(given):
        raise CalibrationError(f"{table.path}: a normal has nx, ny and nz; give all three or none")
    normals = np.stack([table.numbers(name) for name in names], axis=-1)
    empty = ~normals.any(axis=1)
    if empty.any():
        line = table.rows[int(np.argmax(empty))]
        raise CalibrationError(f"{table.path}: line {line}: the normal has no length; correct it")
    return normals
