"""``glint-aoa monitor``: the live page."""

from pathlib import Path
from typing import Annotated

import typer

from glint_aoa.cli._common import SetupFile, check_folder

__all__ = ["monitor"]


def monitor(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of points.", show_default=False)
    ],
    setup: SetupFile = Path("glint-aoa.toml"),
    results: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Folder for the results; in that of the points if not given."
        ),
    ] = None,
    live: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Live session to show: glint-aoa live with --http."),
    ] = None,
    live_token: Annotated[
        str | None,
        typer.Option(
            envvar="GLINT_AOA_TOKEN", metavar="TOKEN", help="What requests to --live must show."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Port; 0 takes a free one.")
    ] = 5007,
    listen: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="IP address to listen on; 0.0.0.0 for all networks."),
    ] = "127.0.0.1",
    token: Annotated[
        str | None,
        typer.Option(
            envvar="GLINT_AOA_MONITOR_TOKEN",
            metavar="TOKEN",
            help="What a browser must know; made up if not given, unless on localhost.",
        ),
    ] = None,
) -> None:
    """Show the points of a folder in a browser as they come.

    Measures each new point as process does, and shows its mean and standard deviation, newest
    field, angle against time, flags, onboard sensor and spectra; with --live a live session as
    well. Results that are there are used. Its buttons trigger a point and mark that the shaker is
    off: in the live session, or without one in FOLDER/trigger and FOLDER/marks.csv. Ctrl-C ends it.

    \b
    Example: glint-aoa monitor run-01 --setup glint-aoa.toml --live http://127.0.0.1:8765
    """
    from glint_aoa.errors import InputError, MissingLibraryError, OutputError
    from glint_aoa.process import load_sweep
    from glint_aoa.resume import finished_points
    from glint_aoa.setup import load_setup

    try:
        from glint_aoa.monitor.live_client import LiveClient
        from glint_aoa.monitor.page import Shared
        from glint_aoa.monitor.serve import serve
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"the live page needs {str(error.name).partition('.')[0]}, which is not installed; "
            'run pip install "glint-aoa[monitor]"'
        ) from None
    from glint_aoa.monitor.marks import FolderControls
    from glint_aoa.monitor.watch import FolderWatch
    from glint_aoa.monitor.worker import PointWorker

    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give the folder that points are recorded to")
    settings = load_setup(setup)
    load_sweep(settings)
    if results is None:
        results = folder / "results"
        if not results.resolve().is_relative_to(folder.resolve()):
            raise OutputError(f"{results} leads out of {folder}; name the folder with --results")
    check_folder(results)
    try:
        finished_points([], settings, results)
    except OutputError:
        raise OutputError(
            f"{results / 'log.csv'}: no log of results; give another --results"
        ) from None
    pitch = settings.camera.pixel_pitch or (1.0, 1.0)
    session = None
    if live is not None:
        session = LiveClient(live, token=live_token, pixel_aspect=pitch[1] / pitch[0])
    watch = FolderWatch(folder)
    shared = Shared(
        title=str(folder),
        points=PointWorker(watch, settings, results.resolve()),
        controls=session or FolderControls(watch.folder),
        live=session,
    )
    serve(
        shared,
        address=listen,
        port=port,
        token=token,
        announce=lambda url: typer.echo(f"Monitor of {folder} at {url} (Ctrl-C ends it)", err=True),
    )
