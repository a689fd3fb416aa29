"""The program ``glint-aoa``: its commands, and how every error ends."""

import _thread
import os
import sys
import threading
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli import calibrate
from glint_aoa.cli._benchmark_command import BenchmarkCommand
from glint_aoa.cli._grouped import GroupedCommands
from glint_aoa.cli.batch import batch
from glint_aoa.cli.benchmark import benchmark
from glint_aoa.cli.convert import convert
from glint_aoa.cli.correct import correct
from glint_aoa.cli.demo import demo
from glint_aoa.cli.doctor import doctor
from glint_aoa.cli.fuse import fuse
from glint_aoa.cli.init import init
from glint_aoa.cli.inspect import inspect
from glint_aoa.cli.live import live
from glint_aoa.cli.monitor import monitor
from glint_aoa.cli.plan import plan
from glint_aoa.cli.process import process
from glint_aoa.cli.report import report
from glint_aoa.cli.simulate import simulate
from glint_aoa.cli.twist import twist
from glint_aoa.cli.uncertainty import uncertainty
from glint_aoa.errors import GlintError

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

__all__ = ["app", "main"]

_DEBUG = "GLINT_AOA_DEBUG"
_STOPPED = 130  # what a shell makes of an interrupt
_AGAIN = 0.01  # s, until an interrupt that was swallowed comes again

app = typer.Typer(
    name="glint-aoa",
    cls=GroupedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.command("demo")(demo)
app.command("doctor")(doctor)
app.command("init")(init)
app.command("plan", no_args_is_help=True)(plan)
app.command("simulate", no_args_is_help=True)(simulate)
app.add_typer(calibrate.app, name="calibrate")
app.command("uncertainty", no_args_is_help=True)(uncertainty)
app.command("inspect", no_args_is_help=True)(inspect)
app.command("convert", no_args_is_help=True)(convert)
app.command("process", no_args_is_help=True)(process)
app.command("batch", no_args_is_help=True)(batch)
app.command("live", no_args_is_help=True)(live)
app.command("monitor", no_args_is_help=True)(monitor)
app.command("twist", no_args_is_help=True)(twist)
app.command("correct", no_args_is_help=True)(correct)
app.command("fuse", no_args_is_help=True)(fuse)
app.command("benchmark", cls=BenchmarkCommand, no_args_is_help=True)(benchmark)
app.command("report", no_args_is_help=True)(report)


def _show_version(wanted: bool) -> None:
    if wanted:
        from glint_aoa._version import __version__

        typer.echo(f"glint-aoa {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[  # noqa: ARG001  its callback acts
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error; stands before COMMAND.")
    ] = False,
) -> None:
    """Attitude of a wind-tunnel model from video of a glint, held against its inertial sensor.

    \b
    Example: glint-aoa process point-01.h5 --setup glint-aoa.toml --out results
    """
    if debug:
        os.environ[_DEBUG] = "1"


def main() -> None:
    """Run the program; bad input ends in one sentence on stderr and exit code 2."""
    sys.unraisablehook = _interrupt_again
    try:
        app()
    except SystemExit as end:
        if end.code == _STOPPED:
            _stop("stopped; what was written before is whole")
        raise
    except GlintError as error:
        if os.environ.get(_DEBUG):
            raise
        _end(str(error), 2)
    except BrokenPipeError:  # the reader of our output left; that is its right
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except KeyboardInterrupt:  # while the commands were loaded
        _stop("stopped; nothing was written")
    except Exception as error:
        if os.environ.get(_DEBUG):
            raise
        _end(
            f"an error of the program itself ({type(error).__name__}: {error}); "
            "run it again with --debug and report what it prints",
            1,
        )


def _interrupt_again(ignored: "UnraisableHookArgs") -> None:
    """Send an interrupt again that Python had to ignore: it fell into a finaliser or a callback."""
    if ignored.exc_type is KeyboardInterrupt:
        threading.Timer(_AGAIN, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(ignored)


def _stop(sentence: str) -> None:
    """End at once: what the interrupt cut in two would complain while Python takes it down."""
    typer.echo(f"glint-aoa: {sentence}", err=True)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(_STOPPED)


def _end(sentence: str, code: int) -> None:
    typer.echo(f"glint-aoa: {sentence}", err=True)
    sys.exit(code)
