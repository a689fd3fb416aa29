"""``glint-aoa correct``: the inertial angle without the bias of vibration."""

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Out,
    Overwrite,
    bar,
    check_folder,
    check_names,
    print_json,
    table,
    tell_flags,
)

if TYPE_CHECKING:
    from glint_aoa.inertial.correct import Correction

__all__ = ["correct"]

_MOST_ROWS_A_SECOND = 1e5
_COLUMNS = "time_s,angle_deg,angle_std_deg,raw_angle_deg,bias_deg,flags"


class _Method(StrEnum):
    AUTO = "auto"
    KINEMATIC = "kinematic"
    MODAL = "modal"
    REGRESSION = "regression"
    NLR = "nlr"
    HARMONIC = "harmonic"
    SPECTRAL = "spectral"


def correct(
    records: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD", help="Files with acquisition channels.", show_default=False
        ),
    ],
    out: Out,
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            "-s",
            metavar="FILE",
            help="Setup file; glint-aoa.toml if there is one, else what the records say.",
        ),
    ] = None,
    method: Annotated[
        _Method, typer.Option(help="How to correct; auto takes the best that the record allows.")
    ] = _Method.AUTO,
    causal: Annotated[
        bool,
        typer.Option(
            "--causal", help="Filter forward only, with delay, as on-line; else there and back."
        ),
    ] = False,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Rows a second to write.")] = 20.0,
    gain_std: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            help="Uncertainty, 1 sigma, of accelerometer gains, and of a mode's bias from its "
            "radius.",
        ),
    ] = 1.0,
    misalignment_std: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="Uncertainty, 1 sigma, of the directions accelerometers sense in."
        ),
    ] = 0.5,
    overwrite: Overwrite = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Exit with code 3 if anything is flagged but the filter's settling at the ends.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Correct the onboard angle for the bias of vibration.

    The package takes centrifugal acceleration for gravity; that is estimated and added back.
    kinematic needs two accelerometers a plane at different stations and no modal test; modal one
    a plane at the package and the modes' radii; regression vibration that grows and fades; nlr
    and spectral one mode a plane; harmonic the package's unfiltered output. auto takes the first
    of them that the record allows and that is certain to 0.01 deg, and says why.

    Writes <record>.csv: time_s, angle_deg, angle_std_deg, raw_angle_deg, bias_deg, flags. The
    means that it prints leave out the ends of a record, where the low-pass has not settled.

    \b
    Example: glint-aoa correct point-01.h5 --setup glint-aoa.toml --out corrected
    """
    from glint_aoa.errors import InputError
    from glint_aoa.setup import Setup, load_setup

    if setup is None and Path("glint-aoa.toml").exists():
        setup = Path("glint-aoa.toml")
    settings = Setup() if setup is None else load_setup(setup)
    check_names(records)
    check_folder(out)
    if not 0 < rate <= _MOST_ROWS_A_SECOND:
        raise InputError(
            f"--rate is {rate:g}; give rows a second, above 0 and at most {_MOST_ROWS_A_SECOND:g}"
        )
    for option, value in (("--gain-std", gain_std), ("--misalignment-std", misalignment_std)):
        if not 0 <= value < math.inf:
            raise InputError(f"{option} is {value:g}; give an uncertainty of zero or more")
    corrected: dict[Path, Correction] = {}
    failures: list[InputError] = []
    with bar(len(records)) as advance:
        for path in records:
            advance(0, path.stem)
            try:
                corrected[path] = _correct_one(
                    path,
                    settings,
                    out,
                    overwrite=overwrite,
                    method=method.value,
                    causal=causal,
                    rate_hz=rate,
                    relative_std=gain_std / 100,
                    misalignment_std=math.radians(misalignment_std),
                )
            except InputError as error:
                failures.append(error)
            advance(1)
    summaries = [_summary(path, out, rows) for path, rows in corrected.items()]
    if as_json:
        print_json(summaries)
    elif summaries:
        _print(summaries, out)
        for path, rows in corrected.items():
            tell_flags(path.stem, _mask(rows.flags), rows.flags, "rows")
    for failure in failures:
        typer.echo(f"glint-aoa: {failure}", err=True)
    if failures:
        raise typer.Exit(2)
    if strict and any(_mask(rows.flags[rows.settled]) for rows in corrected.values()):
        raise typer.Exit(3)


def _correct_one(
    path: Path, settings: Any, out: Path, *, overwrite: bool, **options: Any
) -> "Correction":
    from glint_aoa.inertial.correct import correct as correct_record
    from glint_aoa.inertial.correct import write_correction
    from glint_aoa.records.conditioning import prepared
    from glint_aoa.records.formats import open_acquisition

    record = prepared(open_acquisition(path, settings.inertial))
    rows = correct_record(record, settings.inertial, **options)
    _check_is_correction(out / f"{path.stem}.csv")
    write_correction(out, path.stem, rows, overwrite=overwrite)
    return rows


def _check_is_correction(path: Path) -> None:
    """Refuse to replace what is no correction, such as the optical results of the same point."""
    from glint_aoa.errors import OutputError

    if not path.is_file():
        return
    with path.open("rb") as file:
        header = file.readline(len(_COLUMNS) + 1)
    if header.strip() != _COLUMNS.encode():
        raise OutputError(f"{path} is there already and holds no correction; give another --out")


def _mask(flags: Any) -> int:
    import numpy as np

    return int(np.bitwise_or.reduce(flags))


def _summary(path: Path, out: Path, rows: "Correction") -> dict[str, Any]:
    import numpy as np

    settled = rows.settled
    bias = rows.bias_deg[settled]
    return {
        "record": path.stem,
        "file": out / f"{path.stem}.csv",
        "method": rows.method,
        "why": rows.why,
        "mean_raw_angle_deg": rows.raw_angle_deg[settled].mean(),
        "mean_angle_deg": rows.angle_deg[settled].mean(),
        "mean_angle_std_deg": rows.angle_std_deg[settled].mean(),
        "mean_bias_deg": bias.mean(),
        "largest_bias_deg": bias[np.argmax(np.abs(bias))],
        "flags": _mask(rows.flags),
    }


def _print(summaries: list[dict[str, Any]], out: Path) -> None:
    keys = ["mean_raw_angle_deg", "mean_angle_deg", "mean_bias_deg", "largest_bias_deg"]
    header = ["record", "raw [deg]", "corrected [deg]", "bias [deg]", "largest bias [deg]"]
    table(header, [[s["record"], *(f"{s[key]:+.4f}" for key in keys)] for s in summaries])
    typer.echo("")
    reasons: dict[str, list[str]] = {}
    for summary in summaries:
        reasons.setdefault(f"{summary['method']}: {summary['why']}", []).append(summary["record"])
    for reason, names in reasons.items():
        typer.echo(reason if len(reasons) == 1 else f"{', '.join(names)}: {reason}")
    typer.echo(f"Wrote {out / '<record>.csv'}")
