"""The commands of the program in the order in which a test needs them, under a heading each."""

from typing import Any

from typer.core import TyperGroup

__all__ = ["GROUPS", "GroupedCommands"]

GROUPS: dict[str, tuple[str, ...]] = {
    "Set up": ("demo", "doctor", "init", "plan", "simulate"),
    "Calibrate": ("calibrate", "uncertainty"),
    "Measure": ("inspect", "convert", "process", "batch", "live", "monitor", "twist"),
    "Compare": ("correct", "fuse", "benchmark", "report"),
}
"""Names of the commands under each heading."""


class GroupedCommands(TyperGroup):
    """A program whose help lists its commands by `GROUPS`."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002  as Click calls it
        """Return the names of all commands, group by group."""
        return [name for names in GROUPS.values() for name in names]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands with their short help, group by group."""
        width = max(map(len, self.list_commands(ctx)))
        limit = formatter.width - 6 - width
        for title, names in GROUPS.items():
            rows = [
                (f"{name:{width}}", self.commands[name].get_short_help_str(limit)) for name in names
            ]
            with formatter.section(title):
                formatter.write_dl(rows)
