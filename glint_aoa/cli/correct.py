"""``glint-aoa correct``: the inertial angle without the bias of vibration."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from glint_aoa.cli._common import Json, Out, Overwrite, SetupFile, Strict, bar, print_json, table

__all__ = ["correct"]


class _Method(StrEnum):
    AUTO = "auto"
    MODAL = "modal"


def correct(
    records: Annotated[list[Path], typer.Argument(help="Acquisition records.", show_default=False)],
    out: Out,
    setup: SetupFile = Path("glint-aoa.toml"),
    method: Annotated[_Method, typer.Option(help="How to correct.")] = _Method.AUTO,
    causal: Annotated[
        bool, typer.Option("--causal", help="Filter forward only, as on-line.")
    ] = False,
    rate: Annotated[float, typer.Option(help="Rows a second [Hz].")] = 20.0,
    overwrite: Overwrite = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Correct the onboard angle for the centrifugal bias of vibration.

    Writes <record>.csv: time_s, angle_deg, angle_std_deg, raw_angle_deg, bias_deg, flags.

    Example: glint-aoa correct point-01.h5 --setup glint-aoa.toml --out corrected
    """
    from glint_aoa.errors import InputError
    from glint_aoa.flags import describe
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    summaries: list[dict[str, Any]] = []
    failures: list[InputError] = []
    with bar(len(records)) as advance:
        for path in records:
            try:
                summaries.append(
                    _correct_one(path, settings, out, method.value, causal, rate, overwrite)
                )
            except InputError as error:
                failures.append(error)
            advance(1, path.stem)
    if as_json:
        print_json(summaries)
    elif summaries:
        header = ["record", "raw [deg]", "corrected [deg]", "bias [deg]", "largest bias"]
        keys = ["mean_raw_angle_deg", "mean_angle_deg", "mean_bias_deg", "largest_bias_deg"]
        table(header, [[s["record"], *(f"{s[key]:+.4f}" for key in keys)] for s in summaries])
        typer.echo(f"\n{summaries[0]['method']}: {summaries[0]['why']}")
        typer.echo(f"Wrote {out}/<record>.csv")
        for summary in summaries:
            for words in describe(summary["flags"]):
                typer.echo(f"{summary['record']}: {words}", err=True)
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)
    if strict and any(summary["flags"] for summary in summaries):
        raise typer.Exit(3)


def _correct_one(
    path: Path, settings: Any, out: Path, method: str, causal: bool, rate: float, overwrite: bool
) -> dict[str, Any]:
    import numpy as np

    from glint_aoa.inertial.correct import correct as correct_record
    from glint_aoa.inertial.correct import write_correction
    from glint_aoa.records.formats.hdf5 import read_acquisition

    record = read_acquisition(path, settings.inertial)
    rows = correct_record(record, settings.inertial, method=method, causal=causal, rate_hz=rate)
    target = write_correction(out, path.stem, rows, overwrite=overwrite)
    largest = int(np.argmax(np.abs(rows.bias_deg)))
    return {
        "record": path.stem,
        "file": target,
        "method": rows.method,
        "why": rows.why,
        "mean_raw_angle_deg": rows.raw_angle_deg.mean(),
        "mean_angle_deg": rows.angle_deg.mean(),
        "mean_angle_std_deg": rows.angle_std_deg.mean(),
        "mean_bias_deg": rows.bias_deg.mean(),
        "largest_bias_deg": rows.bias_deg[largest],
        "flags": int(np.bitwise_or.reduce(rows.flags)),
    }
