"""The report of a folder of results: one HTML file that needs nothing else to be read."""

import datetime
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import tomli_w

from calibration.sweep.pitch_sweep import PitchSweep
from glint_aoa._version import __version__
from glint_aoa.errors import InputError
from glint_aoa.records._files import check_new, make_folder, replacing
from glint_aoa.report import overview
from glint_aoa.report.calibration_section import Part, budget_parts, calibration_part
from glint_aoa.report.cells import Cell, Table
from glint_aoa.report.figures import error_figure
from glint_aoa.report.pictures import (
    FigureFiles,
    Picture,
    PictureFormat,
    drawing,
    embedded,
    picture,
)
from glint_aoa.report.point_page import PageOptions, PointPage, point_page
from glint_aoa.report.recordings import find_calibrations
from glint_aoa.report.results_folder import ResultsFolder, read_results_folder
from glint_aoa.setup import Setup
from glint_aoa.workers import Workers

__all__ = ["Report", "figures_folder", "write_report"]

_LIBRARIES = ("numpy", "scipy", "matplotlib", "netCDF4", "h5py", "Jinja2")
_KINDS = {".png": "image/png", ".svg": "image/svg+xml"}
_SENTENCES = {
    "points": "No results of points are here: glint-aoa process POINT... --setup FILE --out FOLDER "
    "measures them.",
    "table4": "Table 4 is not here: glint-aoa benchmark POINT... --setup FILE --out FOLDER holds "
    "the points of runs against the onboard sensor.",
    "sweep": "No pitch sweep is here or was applied: glint-aoa calibrate sweep POINT... --setup "
    "FILE --out sweep.toml makes one of points at rest.",
    "camera": "No calibration of the camera or its pose is here: glint-aoa calibrate camera and "
    "glint-aoa calibrate resect make them.",
}


@dataclass
class Report:
    """What a report holds.

    Attributes
    ----------
    file : Path
        The HTML file.
    pages : list of PointPage
        One for each point.
    lacks : list of str
        What is not in it as a whole, and how to get it.
    figures : Path or None
        Folder of the figures as files.
    """

    file: Path
    pages: list[PointPage]
    lacks: list[str]
    figures: Path | None = None


@dataclass
class _Content:
    """What the template is filled with."""

    folder: ResultsFolder
    pages: list[PointPage] = field(default_factory=list)
    errors: list[Picture] = field(default_factory=list)
    calibrations: list[Part] = field(default_factory=list)
    budgets: list[Part] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)


def figures_folder(out: Path) -> Path:
    """Return the folder beside a report in which its figures are written."""
    return out.with_name(f"{out.stem}-figures")


def write_report(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    points: str | Path | None = None,
    figures: PictureFormat | None = None,
    overwrite: bool = False,
    jobs: int = 1,
    date: datetime.datetime | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> Report:
    """Write the report of a folder of results as one HTML file.

    Parameters
    ----------
    folder : str or Path
        As for `glint_aoa.report.results_folder.read_results_folder`.
    out : str or Path, optional
        The file; ``report.html`` in the folder if not given.
    points : str or Path, optional
        Folder of the recordings, where they are no longer where they were measured.
    figures : {"png", "svg", "pdf"}, optional
        Format in which the figures are also written, to `figures_folder`.
    overwrite : bool, optional
        Whether file and figures may be replaced.
    jobs : int, optional
        How many processes share the points; the file is the same to the byte.
    date : datetime, optional
        When the report was made; now if not given.
    progress : callable, optional
        Called with how many points are done since, and how many there are in words.

    Returns
    -------
    Report
        What was written.

    Raises
    ------
    InputError
        If there are no results in the folder, or `points` is no folder.
    OutputError
        If something is there already or cannot be written.
    """
    out = Path(folder) / "report.html" if out is None else Path(out)
    recordings = None if points is None else Path(points)
    if recordings is not None and not recordings.is_dir():
        raise InputError(f"{recordings}: no such folder; give that of the recordings with --points")
    files = None if figures is None else FigureFiles(figures_folder(out), figures)
    if not overwrite:
        check_new([out, *([] if files is None else [files.folder])])
    results = read_results_folder(folder)
    options = PageOptions(results.path, recordings, files)
    content = _Content(results, list(_pages(results, options, jobs, progress)))
    with drawing():
        _add_sections(content, files)
    date = date or datetime.datetime.now(datetime.UTC)
    text = _rendered(content, date.isoformat(sep=" ", timespec="minutes"))
    make_folder(out.parent)
    with replacing(out, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return Report(out, content.pages, content.lacks, None if files is None else files.folder)


def _pages(
    results: ResultsFolder,
    options: PageOptions,
    jobs: int,
    progress: Callable[[int, str], None] | None,
) -> Iterator[PointPage]:
    count = len(results.points)
    with Workers(min(jobs, max(count, 1))) as workers:
        numbered = enumerate(results.points, start=1)
        for page in workers.map(partial(point_page, options=options), numbered):
            yield page
            if progress is not None:
                progress(1, page.key)


def _add_sections(content: _Content, files: FigureFiles | None) -> None:
    results = content.folder
    setups = _setups(results)
    content.lacks += results.problems
    _add_errors(content, files)
    sweeps = _add_calibrations(content, setups, files)
    content.budgets += budget_parts(results.points, setups, sweeps, files=files)
    content.lacks += _lacking(content)


def _setups(results: ResultsFolder) -> dict[str, Setup]:
    """Return each setup of the results by its hash; those that cannot be read are left out."""
    setups: dict[str, Setup] = {}
    for point in results.points:
        attrs, name = point.attrs, str(point.attrs.get("setup_hash", ""))
        if name and name not in setups and "setup" in attrs:
            beside = Path(str(attrs.get("calibration", ""))).parent
            place = Path(str(attrs.get("setup_folder", beside)))
            try:
                setups[name] = Setup.of_results(str(attrs["setup"]), place)
            except InputError:  # each of its points says so
                continue
    return setups


def _add_errors(content: _Content, files: FigureFiles | None) -> None:
    try:
        errors = overview.point_errors_of(content.folder)
    except InputError as error:
        content.lacks.append(f"{error}.")
        return
    if not errors:
        return
    content.errors.append(
        picture(
            error_figure(errors),
            "errors",
            alt="Error of the mean angle against peak-to-peak moment, for excitation in yaw and in "
            "pitch, by video and onboard sensor; figures in the table of points.",
            caption="Error of the mean angle with the shaker on.",
            files=files,
            stem="errors-against-moment",
        )
    )


def _add_calibrations(
    content: _Content, setups: dict[str, Setup], files: FigureFiles | None
) -> dict[str, PitchSweep | None]:
    """Add the calibrations in the folder and those that were applied; return the sweeps."""
    results, sweeps = content.folder, dict[str, PitchSweep | None]()
    shown = {path.resolve(): (path, kind) for path, kind in results.calibrations}
    for point in results.points:
        for each in find_calibrations(point, results.path):
            if each.path is not None:
                shown.setdefault(each.path.resolve(), (each.path, each.what))
            elif (said := f"The {each.what} {each.name}: {each.state}.") not in content.lacks:
                content.lacks.append(said)
            name = str(point.attrs.get("setup_hash", ""))
            if each.what == "pitch sweep" and each.path is not None and name not in sweeps:
                sweeps[name] = _sweep(each.path)
    setup = next(iter(setups.values()), None)
    for number, (path, kind) in enumerate(shown.values(), start=1):
        try:
            part = calibration_part(path, kind, number, setup=setup, files=files)
            content.calibrations.append(part)
        except InputError as error:
            content.lacks.append(f"{error}.")
    return sweeps


def _sweep(path: Path) -> PitchSweep | None:
    try:
        return PitchSweep.load(path)
    except InputError:  # said where it is shown
        return None


def _lacking(content: _Content) -> list[str]:
    kinds = " ".join(part.title.lower() for part in content.calibrations)
    there = {
        "points": bool(content.folder.points),
        "table4": "table4" in content.folder.tables,
        "sweep": "pitch sweep" in kinds,
        "camera": "camera calibration" in kinds or "space resection" in kinds,
    }
    return [sentence for name, sentence in _SENTENCES.items() if not there[name]]


def _rendered(content: _Content, date: str) -> str:
    loader = jinja2.PackageLoader("glint_aoa.report", "templates")
    environment = jinja2.Environment(
        loader=loader,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    results = content.folder
    return environment.get_template("report.html").render(
        content=content,
        title=results.path.resolve().name,
        date=date,
        summary=overview.summary(results),
        flags=overview.flag_lines(results.points),
        tables=overview.table_4(results),
        point_table=overview.point_table(results.points, content.pages) if content.pages else None,
        other_tables=overview.other_tables(results),
        paper_pictures=_paper_pictures(results),
        inputs=_inputs(content.pages),
        settings=_settings(content),
        versions=_versions(),
    )


def _paper_pictures(results: ResultsFolder) -> list[Picture]:
    found = []
    for path in results.pictures:
        number = path.stem.removeprefix("figure-")
        source = embedded(path.read_bytes(), _KINDS[path.suffix])
        alt = f"The paper's figure {number}, from the points recorded here."
        found.append(Picture("paper", alt, f"Figure {number} ({path.name})", source))
    return found


def _inputs(pages: Sequence[PointPage]) -> Table | None:
    """Return the files behind all points, each once."""
    files = dict.fromkeys(each for page in pages for each in page.inputs)
    rows = [[Cell(e.what), Cell(e.name), Cell(e.digest), Cell(e.state)] for e in files]
    header = ["What", "File", "SHA-256 when it was used", "Now"]
    return Table("Files that the results were made from", header, rows) if rows else None


def _settings(content: _Content) -> list[tuple[str, str]]:
    """Return each setup as TOML, numbers in SI units and radians, without what is not given."""
    found = _setups(content.folder)
    return [
        (name, tomli_w.dumps(setup.model_dump(exclude_none=True))) for name, setup in found.items()
    ]


def _versions() -> Sequence[tuple[str, Any]]:
    named = [(name, version(name)) for name in _LIBRARIES]
    return [("glint-aoa", __version__), ("Python", platform.python_version()), *named]
