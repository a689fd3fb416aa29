"""``glint-aoa benchmark inertial``: the inertial corrections beside the paper's figures."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Strict,
    bar,
    check_folder,
    check_new_files,
    number,
    print_json,
    table,
)

if TYPE_CHECKING:
    from glint_aoa.cli._regression_study import StudyRow
    from glint_aoa.inertial_benchmark import FigureRow, Table1Row

__all__ = ["benchmark_inertial"]

_FILES = ("inertial-table1.csv", "inertial-figures.csv", "inertial-tables23.csv")
_METHODS = ("modal", "kinematic")
_INCH = 0.0254
_POOR = 2 / 3  # reduction below which the paper's own regression failed: there a warning will do
_SENSOR_M = 0.9  # station of the simulated package


def benchmark_inertial(
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Folder for the tables as CSV."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of noise and phases.")] = 0,
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Hold the inertial corrections against the paper's Figures 11-17 and Tables 1-3.

    Simulates the paper's records from rigid-body kinematics, corrects them and prints what is left
    beside the paper's figures. Takes a minute.

    \b
    Example: glint-aoa benchmark inertial --out results
    """
    if out is not None:
        check_folder(out)
        check_new_files((out / name for name in _FILES), overwrite=overwrite)
    found = _study(seed)
    if out is not None:
        _write(out, found, overwrite=overwrite)
    if as_json:
        print_json(found)
    else:
        _tell(found)
        if out is not None:
            typer.echo("\nWrote " + ", ".join(str(out / name) for name in _FILES))
    if strict and not all(row["met"] for rows in found.values() for row in rows):
        raise typer.Exit(3)


def _study(seed: int) -> dict[str, list[dict[str, Any]]]:
    """Simulate, correct and compare; rows of the three tables."""
    import tomllib

    from glint_aoa.cli._inertial_study import DAS_CHANNELS, study_records, survey_shapes
    from glint_aoa.cli._regression_study import regression_study
    from glint_aoa.inertial.modes import TABLE_1, modes_toml
    from glint_aoa.inertial_benchmark import PAPER_FIGURES, figure_row, table_1
    from glint_aoa.setup import Inertial

    inertial = Inertial.model_validate(tomllib.loads(modes_toml(TABLE_1))["inertial"])
    methods = dict(zip(_METHODS, (DAS_CHANNELS, ()), strict=True))
    with bar(len(PAPER_FIGURES) + 2) as advance:
        advance(0, "Table 1")
        surveyed = [_table_1_row(row) for row in table_1(survey_shapes(seed=seed), _SENSOR_M)]
        figures = []
        for figure in PAPER_FIGURES:
            advance(1, f"Figure {figure}")
            records = study_records(figure, seed=seed)
            figures.append(_figure_row(figure_row(figure, records, inertial, methods=methods)))
        advance(1, "Tables 2 and 3")
        regressed = [_regression_row(row) for row in regression_study(seed=seed + 1)]
        advance(1)
    return {"table_1": surveyed, "figures": figures, "tables_2_3": regressed}


def _table_1_row(row: "Table1Row") -> dict[str, Any]:
    found = row.found
    return {
        "mode": row.paper.number,
        "plane": row.paper.plane,
        "paper_hz": row.paper.frequency_hz,
        "frequency_hz": found.mode.frequency_hz if found else math.nan,
        "paper_radius_in": row.paper.radius_m / _INCH,
        "radius_in": found.mode.radius_m / _INCH if found else math.nan,
        "radius_std_in": found.radius_std_m / _INCH if found else math.nan,
        "residual": found.residual if found else math.nan,
        "met": row.is_met,
    }


def _figure_row(row: "FigureRow") -> dict[str, Any]:
    return {
        "figure": row.paper.number,
        "what": row.paper.what,
        "statistic": row.paper.statistic,
        "paper_raw_deg": row.paper.raw_deg,
        "raw_deg": row.raw_deg,
        "paper_left_deg": row.paper.left_deg,
        **{f"{name}_left_deg": left for name, left in row.left_deg.items()},
        **{f"{name}_std_deg": std for name, std in row.std_deg.items()},
        "met": row.is_met,
    }


def _regression_row(row: "StudyRow") -> dict[str, Any]:
    paper = row.paper
    return {
        "table": 2 if paper.plane == "pitch" else 3,
        "from_s": paper.between_s[0],
        "to_s": paper.between_s[1],
        "source": f"{paper.plane} {paper.source}",
        "paper_bias_deg": paper.bias_deg,
        "bias_deg": row.figures["bias_deg"],
        "paper_error_deg": paper.standard_error_deg,
        "error_deg": row.figures["standard_error_deg"],
        "paper_reduction": row.paper_reduction,
        "reduction": row.figures["reduction"],
        "correlated": row.is_correlated,
        "met": row.figures["reduction"] >= row.paper_reduction
        or (row.paper_reduction < _POOR and not row.is_correlated),
    }


_SPECS = {
    "paper_hz": ".1f",
    "frequency_hz": ".2f",
    "paper_radius_in": ".2f",
    "radius_in": ".2f",
    "radius_std_in": ".2f",
    "residual": ".1e",
    "from_s": ".0f",
    "to_s": ".0f",
    "paper_reduction": ".0%",
    "reduction": ".0%",
    **{f"paper_{name}_deg": ".3f" for name in ("raw", "left", "bias", "error")},
    **{f"{name}_deg": ".4f" for name in ("raw", "bias", "error")},
    **{f"{name}_{what}_deg": ".4f" for name in _METHODS for what in ("left", "std")},
}
_TITLES = {
    "table_1": "Table 1: modes of a simulated survey (random force, three stations a plane)",
    "figures": (
        "Figures 11-17: bias of the raw angle and what is left of it. modal: one accelerometer a "
        "plane; kinematic: three"
    ),
    "tables_2_3": (
        "Tables 2 and 3: regression on the filtered angle. Where the record is not correlated, "
        "the method warns"
    ),
}


def _tell(found: dict[str, list[dict[str, Any]]]) -> None:
    for name, rows in found.items():
        typer.echo(("" if name == "table_1" else "\n") + _TITLES[name])
        header = [key.removesuffix("_deg").replace("_", " ") for key in rows[0]]
        cells = [[_cell(key, value) for key, value in row.items()] for row in rows]
        table(header, cells, left=3)


def _cell(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value, _SPECS[key]) if key in _SPECS else str(value)


def _write(folder: Path, found: dict[str, list[dict[str, Any]]], *, overwrite: bool) -> None:
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.tables import write_csv

    make_folder(folder)
    for name, rows in zip(_FILES, found.values(), strict=True):
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        write_csv(folder / name, columns, overwrite=overwrite)
