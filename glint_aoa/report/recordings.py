"""The recording behind a point's results: found again, and known to be the same."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from glint_aoa.errors import InputError
from glint_aoa.records.provenance import file_hash
from glint_aoa.report.results_folder import MeasuredPoint

__all__ = ["InputFile", "find_calibrations", "find_recording"]

_HOW = "give the folder of the recordings with --points"


@dataclass(frozen=True)
class InputFile:
    """A file that results were made from.

    Attributes
    ----------
    what : str
        What it is, such as "recording".
    name : str
        Its path as the results say it.
    digest : str
        SHA-256 that the results say; empty where they do not.
    state : str
        What was found: "unchanged", or why it cannot be used.
    path : Path or None
        Where it was found unchanged (or where nothing says that it is not).
    """

    what: str
    name: str
    digest: str
    state: str
    path: Path | None = None


def find_recording(point: MeasuredPoint, folder: Path, points: Path | None) -> InputFile | None:
    """Find the recording of a point by the path and the hash in its results.

    Parameters
    ----------
    point : MeasuredPoint
        The point.
    folder : Path
        Folder of the results, from which a relative path is looked for, too.
    points : Path, optional
        Folder to look in instead.

    Returns
    -------
    InputFile or None
        None if the results do not say what they were made from.
    """
    name = str(point.attrs.get("recording", ""))
    if not name and points is None:
        return None
    places = list(_places(point, name, folder, points))
    return _checked("recording", name or point.name, places, point, "recording_sha256")


def find_calibrations(point: MeasuredPoint, folder: Path) -> list[InputFile]:
    """Find the calibrations that a point's results name with their hashes."""
    sweep = str(point.attrs.get("calibration", "none"))
    found = []
    if sweep != "none":
        places = [Path(sweep), folder / sweep]
        found.append(_checked("pitch sweep", sweep, places, point, "calibration_sha256"))
    for key, what in (("camera", "camera calibration"), ("pose", "space resection")):
        attribute = f"{key}_calibration_sha256"
        if attribute in point.attrs:
            place = Path(str(point.attrs[f"{key}_calibration"]))
            found.append(_checked(what, str(place), [place], point, attribute))
    return found


def _places(point: MeasuredPoint, name: str, folder: Path, points: Path | None) -> Iterator[Path]:
    if points is None:
        yield from (Path(name), folder / name)
    elif name:
        yield points / Path(name).name
    else:
        yield from sorted(points.glob(f"{point.name}.*")) if points.is_dir() else ()


def _checked(
    what: str, name: str, places: list[Path], point: MeasuredPoint, attribute: str
) -> InputFile:
    digest = str(point.attrs.get(attribute, ""))
    path = next((place for place in places if place.exists()), None)
    if path is None:
        how = f"; {_HOW}" if what == "recording" else ""
        return InputFile(what, name, digest, f"not found{how}")
    if not digest:
        return InputFile(what, name, "", "found; the results do not say its hash", path)
    try:
        found = file_hash(path)
    except InputError as error:
        return InputFile(what, name, digest, str(error))
    if found != digest:
        how = f"; process the point again, or {_HOW} as they were" if what == "recording" else ""
        return InputFile(what, name, digest, f"changed since then: {path} has another hash{how}")
    return InputFile(what, name, digest, "unchanged", path)
