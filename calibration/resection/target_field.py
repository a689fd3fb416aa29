"""Known targets and their images: tables, and circles in an image matched to known targets."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calibration.resection._checks import UNIT_NAMES, UNITS_MM
from calibration.resection._matching import match
from calibration.resection._projection import Interior
from calibration.targets.table import TargetTable
from glint_aoa.errors import CalibrationError
from glint_aoa.setup import Camera

__all__ = [
    "ImageTargets",
    "MatchedTargets",
    "TargetField",
    "match_targets",
    "read_image_targets",
    "read_target_field",
]

Floats = NDArray[np.float64]

_SAME_PLACE = 1e-6  # of the field's size
_SAME_PIXEL = 1e-6
_AXES = ("X", "Y", "Z")
_PARITY = {"even": 0.0, "0": 0.0, "odd": 0.5, "1": 0.5, "": 0.0}
_PIXELS = ("", "pixel", "pixels", "px")
_MOST_NAMED = 5
_MOST_STD = 1000.0  # pixels


@dataclass(frozen=True, eq=False)
class TargetField:
    """Targets of known place.

    Attributes
    ----------
    ids : tuple of str
        Their names.
    points : ndarray [target, 3]
        X, Y, Z in the tunnel frame [m].
    std : ndarray [target, 3]
        Uncertainty of each coordinate, 1 sigma, independent from target to target [m].

    Raises
    ------
    CalibrationError
        If a name is there twice, two targets share a place, or a number cannot be.
    """

    ids: tuple[str, ...]
    points: Floats
    std: Floats

    def __post_init__(self) -> None:
        """Refuse what cannot be a field of targets."""
        shape = (len(self.ids), 3)
        if self.points.shape != shape or self.std.shape != shape:
            raise CalibrationError(
                f"{len(self.ids)} targets have points of shape {self.points.shape} and std of "
                f"shape {self.std.shape}; give X, Y, Z of each"
            )
        _refuse_twice(self.ids)
        if not (np.isfinite(self.points).all() and np.isfinite(self.std).all()):
            raise CalibrationError("a target's coordinates are not finite; leave that target out")
        if (self.std < 0).any():
            raise CalibrationError("a target's std is below zero; give 0 or more")
        size = float(np.ptp(self.points, axis=0).max(initial=0.0))
        pair = _nearest_pair(self.points)
        if pair is not None and pair[2] <= _SAME_PLACE * size:
            raise CalibrationError(
                f"targets {self.ids[pair[0]]} and {self.ids[pair[1]]} have the same coordinates; "
                "correct one of them or leave it out"
            )

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.ids)

    def of(self, ids: Iterable[str]) -> "TargetField":
        """Return the targets of these names, in this order."""
        ids = tuple(ids)
        place = {name: i for i, name in enumerate(self.ids)}
        unknown = [name for name in ids if name not in place]
        if unknown:
            raise CalibrationError(
                f"{_named(unknown)} not in the target field, which has {_some(self.ids)}; "
                "correct the id or add the target to the field"
            )
        index = [place[name] for name in ids]
        return TargetField(ids, self.points[index], self.std[index])


@dataclass(frozen=True, eq=False)
class ImageTargets:
    """Where targets are seen.

    Attributes
    ----------
    ids : tuple of str
        Names, as in the target field.
    uv : ndarray [target, 2]
        Sensor column and sensor line of an even field [pixels]: line = row + first_line
        + 0.5 parity.
    covariance : ndarray [target, 2, 2] or None
        Of u and v [pixels^2]; None where it is not known.

    Raises
    ------
    CalibrationError
        If a name or a place is there twice, or a number cannot be.
    """

    ids: tuple[str, ...]
    uv: Floats
    covariance: Floats | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be measurements."""
        n = len(self.ids)
        if self.uv.shape != (n, 2) or not np.isfinite(self.uv).all():
            raise CalibrationError(f"{n} measured targets need u and v of each, all finite")
        _refuse_twice(self.ids)
        if self.covariance is not None:
            fits = self.covariance.shape == (n, 2, 2) and np.isfinite(self.covariance).all()
            if not fits or (np.linalg.eigvalsh(self.covariance) <= 0).any():
                raise CalibrationError(
                    "the covariance of a measured target has no variance greater than zero; "
                    "give a std of u and v for each target"
                )
        pair = _nearest_pair(self.uv)
        if pair is not None and pair[2] <= _SAME_PIXEL:
            raise CalibrationError(
                f"targets {self.ids[pair[0]]} and {self.ids[pair[1]]} are measured at the same "
                "place in the image; correct one of them or leave it out"
            )

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.ids)


class MatchedTargets(NamedTuple):
    """Circles of an image with their names.

    Attributes
    ----------
    measured : ImageTargets
        Circles that are targets of the field.
    circle : ndarray [target]
        Which of the circles each of them is.
    missing : tuple of str
        Targets of the field that no circle shows.
    """

    measured: ImageTargets
    circle: NDArray[np.int64]
    missing: tuple[str, ...]


def match_targets(
    targets: TargetField, uv: Floats, covariance: Floats | None, camera: Camera
) -> MatchedTargets:
    """Tell which circle of an image is which known target.

    Parameters
    ----------
    targets : TargetField
        The known targets.
    uv : ndarray [circle, 2]
        Sensor column and sensor line of the circles, as of an even field [pixels].
    covariance : ndarray [circle, 2, 2] or None
        Of these [pixels^2].
    camera : Camera
        Interior orientation and approximate pose: its turn about the optical axis within 25 deg,
        its distance within a factor 1.6, and no more than some ten degrees aside.

    Returns
    -------
    MatchedTargets
        Circles that are no target and targets that no circle shows are left out.

    Raises
    ------
    CalibrationError
        If fewer than four, or fewer than half of targets or circles, belong together.

    Notes
    -----
    On a regular grid of which a border row is hidden the image itself cannot tell how the grid
    lies; the position nearest to the approximate pose is taken then.
    """
    interior = Interior.of_camera(camera)
    pose = np.array([*(camera.position or (0.0, 0.0, 0.0)), *camera.rotation])
    found = match(targets.points, uv, interior, pose)
    if found is None:
        _explain_no_match(targets, uv, interior, pose)
        if not len(uv):
            raise CalibrationError(
                "no circle is found; see that the targets are lit, in focus and 4 pixels across "
                "or more, and choose their polarity"
            )
        circles = "1 circle is" if len(uv) == 1 else f"{len(uv)} circles are"
        raise CalibrationError(
            f"{circles} found that cannot be told to be the {len(targets)} targets of the field; "
            "check polarity, position and rotation in [camera], and the target field"
        )
    matched = set(found.target.tolist())
    return MatchedTargets(
        measured=ImageTargets(
            ids=tuple(targets.ids[i] for i in found.target),
            uv=uv[found.circle],
            covariance=None if covariance is None else covariance[found.circle],
        ),
        circle=found.circle,
        missing=tuple(name for i, name in enumerate(targets.ids) if i not in matched),
    )


def _explain_no_match(targets: TargetField, uv: Floats, interior: Interior, pose: Floats) -> None:
    """Refuse targets that would be the circles if they were in another unit."""
    for true, size in UNITS_MM.items():
        for taken, other in UNITS_MM.items():
            scaled = targets.points * size / other
            if true != taken and match(scaled, uv, interior, pose) is not None:
                raise CalibrationError(
                    f"the circles found are the targets of the field if {UNIT_NAMES[true]} were "
                    f"taken for {UNIT_NAMES[taken]}; correct the unit of the target field"
                )


def read_target_field(path: str | Path, *, units: str | None = None) -> TargetField:
    """Read a table of known targets.

    Parameters
    ----------
    path : str or Path
        CSV with columns ``id, X, Y, Z`` and optionally ``std_X, std_Y, std_Z`` (1 sigma). The
        unit of a length stands in the header: ``X [mm]``, ``X (mm)`` or ``X_mm``.
    units : str, optional
        Unit of all lengths whose heading has none.

    Returns
    -------
    TargetField
        In metres.

    Raises
    ------
    CalibrationError
        If the table cannot be read, says no unit or two, or holds targets that cannot be; the
        message names file and line.
    """
    stds = [f"std_{axis}" for axis in _AXES]
    table = TargetTable.read(path, ("id", *_AXES, *stds), ("id", *_AXES))
    ids = table.ids()
    points = np.stack([table.lengths(axis, units) for axis in _AXES], axis=-1)
    std = np.stack(
        [table.lengths(name, units) if name in table else np.zeros(len(ids)) for name in stds],
        axis=-1,
    )
    with _naming(table.path):
        return TargetField(ids, points, std)


def read_image_targets(path: str | Path) -> ImageTargets:
    """Read a table of measured targets.

    Parameters
    ----------
    path : str or Path
        CSV with columns ``id, u, v`` [pixels] and optionally ``std_u, std_v`` (1 sigma) and
        ``parity`` (even or odd, 0 or 1), which adds half a line. u and v are sensor column and
        sensor field line; what was measured in a window has `first_column` and `first_line`
        added.

    Returns
    -------
    ImageTargets
        With the half line of odd fields.

    Raises
    ------
    CalibrationError
        As for `read_target_field`.
    """
    names = ("u", "v", "std_u", "std_v")
    table = TargetTable.read(path, ("id", *names, "parity"), ("id", "u", "v"))
    for name in names:
        if name in table and table.units[name].lower() not in _PIXELS:
            raise CalibrationError(
                f"{table.path}: column {name} says {table.units[name]}; image measurements are in "
                "pixels"
            )
    ids = table.ids()
    uv = np.stack([table.numbers("u"), table.numbers("v") + _half_lines(table)], axis=-1)
    covariance = _covariance(table)
    with _naming(table.path):
        return ImageTargets(ids, uv, covariance)


def _half_lines(table: TargetTable) -> Floats:
    if "parity" not in table:
        return np.zeros(len(table.rows))
    shifts = []
    for line, cell in zip(table.rows, table.cells["parity"], strict=True):
        if cell.lower() not in _PARITY:
            raise CalibrationError(
                f"{table.path}: line {line}: parity is {cell!r}; give even or odd"
            )
        shifts.append(_PARITY[cell.lower()])
    return np.array(shifts)


def _covariance(table: TargetTable) -> Floats | None:
    given = [name for name in ("std_u", "std_v") if name in table]
    if not given:
        return None
    if len(given) == 1:
        raise CalibrationError(f"{table.path}: {given[0]} alone; give std_u and std_v, or neither")
    std = np.stack([table.numbers(name) for name in given], axis=-1)
    bad = ~((std > 0) & (std <= _MOST_STD)).all(axis=1)
    if bad.any():
        line = table.rows[int(np.argmax(bad))]
        raise CalibrationError(
            f"{table.path}: line {line}: a std must be greater than zero, and {_MOST_STD:g} pixels "
            "at most"
        )
    return std[:, :, None] ** 2 * np.eye(2)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file's name before what is wrong with its content."""
    try:
        yield
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _refuse_twice(ids: tuple[str, ...]) -> None:
    twice = [name for name in dict.fromkeys(ids) if ids.count(name) > 1]
    if twice:
        raise CalibrationError(f"{_named(twice)} given twice; give each target once")


def _nearest_pair(places: Floats) -> tuple[int, int, float] | None:
    if len(places) < 2:
        return None
    distance, neighbour = (np.asarray(each) for each in KDTree(places).query(places, k=2))
    first = int(np.argmin(distance[:, 1]))
    other = next(int(each) for each in neighbour[first] if each != first)
    return min(first, other), max(first, other), float(distance[first, 1])


def _named(ids: Iterable[str]) -> str:
    names = list(ids)
    return f"target {names[0]} is" if len(names) == 1 else f"targets {_some(names)} are"


def _some(ids: Iterable[str]) -> str:
    names = list(ids)
    rest = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")
