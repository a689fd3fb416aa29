"""The front of a report: summary, Table 4, the table of points, and the other tables."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from glint_aoa.benchmark import BenchmarkPoint, PointError
from glint_aoa.errors import InputError
from glint_aoa.flags import Flag, describe
from glint_aoa.report.cells import Cell, Table, printed, table_of
from glint_aoa.report.point_page import Fact, PointPage
from glint_aoa.report.results_folder import MeasuredPoint, ResultsFolder, Row

__all__ = ["flag_lines", "other_tables", "point_errors_of", "point_table", "summary", "table_4"]

_ANY = ""
_TABLE_4 = {
    "excitation": ("Excitation", _ANY),
    "kind": ("Kind", _ANY),
    "technique": ("Technique", _ANY),
    "mean_deg": ("Mean [deg]", "+.4f"),
    "std_deg": ("Std [deg]", ".4f"),
    "max_deg": ("Max [deg]", "+.4f"),
    "points": ("Points", _ANY),
    "paper_mean_deg": ("Paper: mean", "+.3f"),
    "paper_std_deg": ("Paper: std", ".3f"),
    "paper_max_deg": ("Paper: max", "+.3f"),
    "paper_points": ("Paper: points", _ANY),
}
_REPEATABILITY = {
    "quantity": ("Quantity", _ANY),
    "statistic": ("Statistic", _ANY),
    "value": ("Value", ".5f"),
    "units": ("Unit", _ANY),
    "value_mm": ("Value [mm]", ".4f"),
    "count": ("Points or runs", _ANY),
    "paper": ("Paper", ".4f"),
}
_FIGURES = {
    "figure": ("Figure", _ANY),
    "what": ("What", _ANY),
    "here": ("Here", ".4g"),
    "paper": ("Paper", ".4g"),
    "unit": ("Unit", _ANY),
}
_POINT = {
    "mean_angle_deg": ("Mean angle [deg]", "+.4f"),
    "mean_angle_u95_deg": ("95 % within [deg]", ".4f"),
    "std_angle_deg": ("Std [deg]", ".4f"),
    "mean_intercept_mm": ("Intercept [mm]", ".3f"),
}
_ERROR = {
    "video_error_deg": ("Error, video [deg]", "+.4f"),
    "inertial_error_deg": ("Error, onboard raw [deg]", "+.4f"),
    "corrected_error_deg": ("Error, onboard corrected [deg]", "+.4f"),
}
_OF_ERRORS = (
    "Errors: after the mean of the run's first and last point, which have the shaker off and "
    "therefore no error, has been subtracted."
)


def summary(folder: ResultsFolder) -> list[Fact]:
    """Return the summary of a folder of results."""
    points = folder.points
    log = [point.log for point in points if point.log]
    flagged = sum(bool(_mask(point)) for point in points)
    facts = [
        Fact("Points", str(len(points)), str(len(points))),
        Fact("Runs", str(len({str(point.attrs.get("run", "")) for point in points} - {""}))),
        Fact("Fields used", f"{_sum(log, 'n_used')} of {_sum(log, 'n_fields')}"),
        Fact("Flagged points", f"{flagged} of {len(points)}"),
        *_extremes(points),
        Fact("First and last trigger", _period(points)),
        Fact("Measured by", _several("glint-aoa", points, "glint_aoa_version")),
        Fact("Setup", _several("", points, "setup_hash")),
    ]
    return [fact for fact in facts if fact.text] if points else []


def flag_lines(points: Sequence[MeasuredPoint]) -> list[str]:
    """Say what is flagged in the whole folder, and at how many points."""
    counts = Counter(flag for point in points for flag in Flag if _mask(point) & flag)
    lines = []
    for flag in Flag:
        if counts[flag]:
            name, _, meaning = describe(flag)[0].partition(": ")
            lines.append(f"{name} at {counts[flag]} of {len(points)} points: {meaning}")
    return lines


def table_4(folder: ResultsFolder) -> list[Table]:
    """Return Table 4 beside the paper's, and repeatability; empty without a comparison."""
    tables = []
    if rows := folder.tables.get("table4"):
        note = "Std: n - 1 in the denominator. Max: signed error of largest magnitude."
        caption = "Table 4: error of the angle with the shaker on, beside the paper's"
        tables.append(table_of(caption, rows, _TABLE_4, note=note))
    if rows := folder.tables.get("repeatability"):
        caption = "Repeatability with the shaker off, 1 sigma, beside the paper's"
        tables.append(table_of(caption, rows, _REPEATABILITY))
    return tables


def other_tables(folder: ResultsFolder) -> list[Table]:
    """Return the tables of the paper's figures and of ``benchmark inertial`` that are there."""
    tables = []
    if rows := folder.tables.get("figures"):
        caption = "What the paper's figures come down to, here and in the paper"
        tables.append(table_of(caption, rows, _FIGURES))
    for name, rows in folder.studies.items():
        columns = {key: (key.replace("_", " "), _spec(key)) for key in rows[0]} if rows else {}
        tables.append(table_of(name.replace("-", " "), rows, columns))
    return tables


def point_table(points: Sequence[MeasuredPoint], pages: Sequence[PointPage]) -> Table:
    """Return the table of points, each with a link to its page."""
    has_errors = any(point.error for point in points)
    columns = {**_POINT, **(_ERROR if has_errors else {})}
    header = ["Point", "Run", "Excitation", "Fields used"]
    rows = [
        list(_point_row(point, page, columns)) for point, page in zip(points, pages, strict=True)
    ]
    headings = [heading for heading, _ in columns.values()]
    caption = "All points, in the order in which they were taken"
    note = _OF_ERRORS if has_errors else ""
    return Table(caption, [*header, *headings, "Flags"], rows, note)


def point_errors_of(folder: ResultsFolder) -> list[PointError]:
    """Make errors of points, as a figure wants them, of the rows of ``errors.csv``.

    Raises
    ------
    InputError
        If a cell is no number, or the table is another.
    """
    try:
        return [_point_error(row) for row in folder.tables.get("errors", ())]
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{folder.path}: errors.csv cannot be read ({error}); repeat glint-aoa benchmark"
        ) from None


def _point_row(
    point: MeasuredPoint, page: PointPage, columns: Mapping[str, tuple[str, str]]
) -> Iterator[Cell]:
    log = point.log
    yield Cell(point.key, link=f"#point-{page.number}")
    yield Cell(str(point.attrs.get("run") or log.get("run", "")))
    yield Cell(page.excitation)
    yield Cell(f"{log['n_used']}/{log['n_fields']}" if log else "", log.get("n_used", ""))
    for name, (_, spec) in columns.items():
        cell = {**log, **point.error}.get(name, "")
        yield Cell(printed(cell, spec), cell)
    yield Cell(", ".join(flag.name or "" for flag in Flag if _mask(point) & flag) or "none")


def _point_error(row: Row) -> PointError:
    def number(name: str) -> float | None:
        return float(row[name]) if row[name] else None

    said: dict[str, Any] = {"kind": row["kind"], "plane": row["plane"]}  # checked by the class
    point = BenchmarkPoint(
        run=row["run"],
        point=row["point"],
        excitation=row["excitation"],
        **said,
        moment_in_lb_pp=number("moment_in_lb_pp"),
        optical_deg=float(row["optical_deg"] or "nan"),
        optical_std_deg=float(row["optical_std_deg"] or "nan"),
        intercept_mm=float(row["intercept_mm"] or "nan"),
        intercept_std_mm=float(row["intercept_std_mm"] or "nan"),
        inertial_deg=float(row["inertial_deg"] or "nan"),
        corrected_deg=number("corrected_deg"),
        flags=int(row["flags"]),
    )
    errors = (number(f"{name}_error_deg") for name in ("video", "inertial", "corrected"))
    return PointError(point, *errors)


def _mask(point: MeasuredPoint) -> int:
    fields = np.bitwise_or.reduce(point.values["flags"].astype(np.int64))
    return int(fields) | int(point.log.get("flags") or 0)


def _sum(log: Sequence[Row], name: str) -> int:
    return sum(int(row[name] or 0) for row in log)


def _extremes(points: Sequence[MeasuredPoint]) -> Iterator[Fact]:
    for name, what in (
        ("mean_angle_u95_deg", "Least certain mean, 95 %"),
        ("std_angle_deg", "Largest std over fields"),
    ):
        known = [point for point in points if point.log.get(name)]
        if known:
            worst = max(known, key=lambda point: float(point.log[name]))
            cell = worst.log[name]
            yield Fact(what, f"{printed(cell, '.4f')} deg at {worst.key}", cell)


def _period(points: Sequence[MeasuredPoint]) -> str:
    moments = sorted(str(p.attrs["trigger_time"]) for p in points if p.attrs.get("trigger_time"))
    return f"{moments[0]} to {moments[-1]}" if moments else ""


def _several(what: str, points: Sequence[MeasuredPoint], attribute: str) -> str:
    values = sorted({str(p.attrs[attribute]) for p in points if attribute in p.attrs})
    return f"{what} {', '.join(values)}".strip() if values else ""


def _spec(column: str) -> str:
    names = ("mode", "plane", "figure", "what", "statistic", "table", "source", "met", "correlated")
    return _ANY if column in names else ".4g"
