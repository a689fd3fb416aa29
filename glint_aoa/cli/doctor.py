"""``glint-aoa doctor``: what is installed, which renderer works, how fast this machine is."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import Json, print_json

if TYPE_CHECKING:
    from glint_aoa.cli._renderer_trial import RendererTrial
    from glint_aoa.installation import LibraryState, SystemLibrary
    from glint_aoa.machine import Machine, Speed

__all__ = ["doctor"]

_GB = 1e9
_WIDTH = 24  # of the names
_OPTIONAL = "pyrender"  # the renderer that one can do without


def doctor(
    folder: Annotated[
        Path,
        typer.Option(
            "--folder", metavar="FOLDER", help="Folder whose disk to look at, such as for results."
        ),
    ] = Path(),
    seconds: Annotated[
        float,
        typer.Option("--seconds", min=0.0, max=60.0, metavar="N", help="How long to time."),
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Tell what is installed, what renders, and how fast it is.

    Each renderer draws a small scene in a process of its own, and synthetic fields are measured
    for two seconds. The first use compiles, which takes a minute. Ends with exit code 2 and the
    next step if something is missing that every use needs.

    \b
    Example: glint-aoa doctor --folder results
    """
    from glint_aoa.cli._renderer_trial import RENDERERS, try_renderer
    from glint_aoa.errors import MissingLibraryError, OutputError
    from glint_aoa.installation import library_states, system_libraries

    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; make it, or give another --folder")
    libraries = library_states()
    system = system_libraries()
    problems = list(filter(None, (each.problem for each in libraries if each.extra is None)))
    found: dict[str, Any] = {"installed": libraries, "system": system}
    if not as_json:
        _tell_versions(libraries, system)
    if not problems:
        _look_further(found, folder, seconds, [try_renderer(name) for name in RENDERERS], as_json)
        problems = [*_problems(found)]
    if as_json:
        print_json(_versions() | _plain(found) | {"problems": problems})
    if problems:
        raise MissingLibraryError("; ".join(problems))
    if not as_json:
        typer.echo("\nAll that is needed works")


def _look_further(
    found: dict[str, Any],
    folder: Path,
    seconds: float,
    renderers: "list[RendererTrial]",
    as_json: bool,
) -> None:
    """Look at what needs the libraries; told as it is found."""
    from glint_aoa.machine import field_rate, look_at_machine

    found["renderers"] = renderers
    found["machine"] = look_at_machine(folder)
    if not as_json:
        _tell_renderers(renderers, found["system"])
        _tell_machine(found["machine"])
    found["speed"] = field_rate(seconds=seconds)
    if not as_json:
        _tell_speed(found["speed"])


def _problems(found: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with what every use needs."""
    for trial in found["renderers"]:
        if not trial.works and trial.name != _OPTIONAL:
            yield f"the renderer {trial.name} does not work: {trial.problem}"
    machine, speed = found["machine"], found["speed"]
    if not machine.is_writable:
        yield f"{machine.folder}: nothing can be written there; give another --folder"
    if not speed.is_right:
        yield (
            f"fields of a known angle were measured {speed.error_deg:+.5f} deg off; install numba "
            "and numpy again and report it if that does not help"
        )


def _versions() -> dict[str, str]:
    import platform

    from glint_aoa._version import __version__

    return {
        "glint_aoa": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def _tell_versions(libraries: "list[LibraryState]", system: "list[SystemLibrary]") -> None:
    import platform

    from glint_aoa._version import __version__

    typer.echo(
        f"glint-aoa {__version__}, Python {platform.python_version()}, {platform.platform()}"
    )
    typer.echo("\nInstalled")
    if not libraries:
        typer.echo("  glint-aoa runs from a source tree that is not installed; pip install .")
    for each in libraries:
        label = each.name if each.extra is None else f"{each.name} [{each.extra}]"
        _line(label, each.version or "-", each.problem or "")
    for one in system:
        _line(f"lib{one.name}", one.file or "-", "" if one.file else f"apt install {one.package}")


def _tell_renderers(trials: "list[RendererTrial]", system: "list[SystemLibrary]") -> None:
    typer.echo("\nRenderers")
    missing = " ".join(each.package for each in system if each.file is None)
    for each in trials:
        if each.seconds is not None:
            _line(each.name, f"works, {1e3 * each.seconds:.1f} ms an image of 752 x 24 pixels")
            continue
        advice = f" (apt install {missing})" if missing and each.name == _OPTIONAL else ""
        _line(each.name, f"does not work: {each.problem}{advice}")


def _tell_machine(machine: "Machine") -> None:
    typer.echo("\nThis machine")
    _line("processors", str(machine.processors))
    if machine.memory_bytes is not None and machine.free_bytes is not None:
        memory, free = machine.memory_bytes / _GB, machine.free_bytes / _GB
        _line("memory", f"{memory:.1f} GB, {free:.1f} GB free")
    can = "can be written to" if machine.is_writable else "cannot be written to"
    _line("folder", f"{machine.folder} {can}, {machine.disk_free_bytes / _GB:.1f} GB free")


def _tell_speed(speed: "Speed") -> None:
    size = f"{speed.columns} x {speed.lines}"
    _line("speed", f"{speed.fields_per_s:.0f} fields/s of {size} pixels, from memory")
    _line("", f"and {speed.learning_s:.1f} s a point to learn the glint and the noise")
    _line("angle", f"off by {speed.error_deg:+.6f} deg, stated 1 sigma {speed.std_deg:.6f} deg")


def _line(name: str, what: str, remark: str = "") -> None:
    typer.echo(f"  {name:{_WIDTH}} {what:{12 if remark else 0}}  {remark}".rstrip())


def _plain(found: dict[str, Any]) -> dict[str, Any]:
    """Return dataclasses as dictionaries, with what they conclude."""
    from dataclasses import asdict

    plain: dict[str, Any] = {
        key: [asdict(each) for each in value] if isinstance(value, list) else asdict(value)
        for key, value in found.items()
    }
    for one, each in zip(plain["installed"], found["installed"], strict=True):
        one["problem"] = each.problem
    return plain
