"""``glint-aoa batch``: many points at once."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    Resume,
    SetupFile,
    Strict,
    bar,
    check_folder,
    check_names,
    print_json,
    tell_flags,
)

if TYPE_CHECKING:
    from glint_aoa.batch import BatchResult
    from glint_aoa.setup import Setup
    from glint_aoa.workers import Pool

__all__ = ["batch"]


def batch(
    campaign: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN",
            help="Folder of recorded points; or, with --points, a campaign as of simulate.",
            show_default=False,
        ),
    ],
    out: Annotated[
        str,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Folder for the results, or a URL such as s3://bucket/results.",
        ),
    ],
    setup: SetupFile = Path("glint-aoa.toml"),
    points: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of the campaign's points, taken in its order."),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", min=1, metavar="N", help="Processes at most; one for each processor if left."
        ),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE", help="What all processes may take, e.g. 4GB; most of what is free."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers share the points."),
    ] = None,
    overwrite: Overwrite = False,
    resume: Resume = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Measure many points at once, as process does each.

    Writes <point>.csv and <point>.nc for each point, and a row of log.csv, the same to the bit as
    process. Points that fail are listed at the end; a process that dies costs no other point.

    \b
    Example: glint-aoa batch points --setup glint-aoa.toml --out results --memory 4GB
    """
    from glint_aoa.batch import open_store, process_batch
    from glint_aoa.setup import load_setup

    if scheduler is not None:
        setup = setup.absolute()
    settings, store = load_setup(setup), open_store(out)
    paths = _paths(campaign, points, absolute=scheduler is not None)
    check_names(paths, taken=["log"])
    if "://" not in out:
        check_folder(Path(out))
        store = open_store(str(Path(out).absolute())) if scheduler is not None else store
    rows: list[dict[str, Any]] = []

    def told(name: str, row: Mapping[str, Any]) -> None:
        if as_json:
            rows.append({"name": name, **row})

    context, measure = _pool(len(paths), settings, store, jobs, memory, scheduler)
    with context as pool, bar(len(paths)) as advance:
        result = process_batch(
            paths,
            settings,
            store,
            pool,
            measure,
            overwrite=overwrite,
            resume=resume,
            told=told,
            progress=lambda path: advance(1, path.stem),
        )
    if as_json:
        failed = [{"point": path, "why": why} for path, why in result.failures]
        print_json({"points": rows, "failed": failed, "without_fields": result.without_fields})
    _tell(result, len(paths), out, on_stderr=as_json)
    if result.failures:
        raise typer.Exit(2)
    if strict and any(result.flags):
        raise typer.Exit(3)


def _paths(campaign: str, points: Path | None, *, absolute: bool) -> list[Path]:
    """Return the recordings: all of a folder, or those that a campaign plans."""
    from glint_aoa.batch import points_in
    from glint_aoa.errors import InputError
    from render_sim.campaign import load_campaign

    folder = Path(campaign) if points is None else points
    folder = folder.absolute() if absolute else folder
    if points is not None:
        return [folder / f"{point.name}.h5" for point in load_campaign(campaign).points]
    if not folder.is_dir() and (folder.suffix == ".toml" or campaign in {"demo", "paper"}):
        raise InputError(f"{campaign}: a campaign; say with --points where its points are")
    return points_in(folder)


def _pool(
    n_points: int,
    settings: "Setup",
    store: Any,
    jobs: int | None,
    memory: str | None,
    scheduler: str | None,
) -> "tuple[AbstractContextManager[Pool], Any]":
    """Return what shares the points, and what it is to do with each."""
    from functools import partial

    from glint_aoa.batch.point import measure_into, measure_or_split
    from glint_aoa.batch.sizing import Sizing, memory_bytes
    from glint_aoa.errors import InputError
    from glint_aoa.workers import Workers

    if scheduler is not None:
        from glint_aoa.batch.cluster import Cluster

        given = "--jobs" if jobs is not None else "--memory" if memory is not None else None
        if given:
            raise InputError(
                f"{given} is of this machine; with --scheduler, give it to the workers "
                "(dask worker --nworkers N --memory-limit SIZE)"
            )
        return Cluster(scheduler), partial(measure_or_split, setup=settings, store=store)
    sizing = Sizing.of_machine(
        n_points, jobs=jobs, memory=None if memory is None else memory_bytes(memory)
    )
    measure = partial(
        measure_into,
        setup=settings,
        store=store,
        threads=sizing.threads,
        block_bytes=sizing.block_bytes,
    )
    return Workers(sizing.jobs, memory=sizing.memory, apart=True), measure


def _tell(result: "BatchResult", n_points: int, out: str, *, on_stderr: bool) -> None:
    measured = len(result.flags)
    typer.echo(f"Measured {measured} of {n_points} points; results in {out}", err=on_stderr)
    if result.finished:
        typer.echo(f"{len(result.finished)} of {n_points} were finished before", err=True)
    if result.without_fields:
        typer.echo(f"{len(result.without_fields)} are records without fields", err=True)
    mask = 0
    for each in result.flags:
        mask |= each
    tell_flags("flagged", mask, result.flags, "points")
    for _, why in result.failures:
        typer.echo(f"glint-aoa: {why}", err=True)
