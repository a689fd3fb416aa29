"""The command ``benchmark``, whose first word may name one of its studies in place of points."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand

from glint_aoa.cli.benchmark_figures import benchmark_figures
from glint_aoa.cli.benchmark_inertial import benchmark_inertial

__all__ = ["STUDIES", "BenchmarkCommand", "studies_like"]

STUDIES: dict[str, Callable[..., None]] = {
    "inertial": benchmark_inertial,
    "figures": benchmark_figures,
}
"""Studies by name."""

_NEED_POINTS = {"figures"}
"""Studies that do nothing without arguments."""


def studies_like(incomplete: str) -> list[str]:
    """Return the studies that a word may become, for the shell's completion."""
    return [name for name in STUDIES if name.startswith(incomplete)]


class BenchmarkCommand(TyperCommand):
    """The command ``benchmark``; ``benchmark inertial`` and ``figures`` are others."""

    def studies(self) -> dict[str, Any]:
        """Return the commands that the first word may name, each under its own name."""
        return {name: _command(name) for name in STUDIES}

    def make_context(
        self, info_name: Any, args: list[str], parent: Any = None, **extra: Any
    ) -> Any:
        """Hand over to a study if one is asked for."""
        name = args[0] if args else ""
        if name not in STUDIES:
            return super().make_context(info_name, args, parent, **extra)
        command = _command(name)
        return command.make_context(f"{info_name} {name}", args[1:], parent, **extra)


def _command(name: str) -> Any:
    app = typer.Typer(
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    app.command(name, no_args_is_help=name in _NEED_POINTS)(STUDIES[name])
    return typer.main.get_command(app)
