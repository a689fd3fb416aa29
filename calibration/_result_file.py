"""The TOML file that a calibration writes, and reads back or refuses in one sentence."""

from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pydantic
import tomli_w

from glint_aoa.errors import CalibrationError
from glint_aoa.records._files import replacing
from glint_aoa.setup import Section, read_toml
from glint_aoa.setup.section import first_problem

__all__ = ["ResultFile"]

_S = TypeVar("_S", bound=Section)


class ResultFile(NamedTuple):
    """What a file holds, and which command makes it.

    Attributes
    ----------
    kind : str
        Such as ``"space resection"``.
    command : str
        The command under ``glint-aoa calibrate``.
    header : str
        What stands above the content, as comments; ``{summary}`` is filled in.
    """

    kind: str
    command: str
    header: str

    def write(self, path: Path, content: dict[str, Any], summary: str, *, overwrite: bool) -> None:
        """Write the file, which appears under its name only when it is whole.

        Raises
        ------
        OutputError
            If the file exists and `overwrite` is False, or it cannot be written.
        """
        text = self.header.format(summary=summary) + tomli_w.dumps(content)
        with replacing(path, overwrite=overwrite) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")

    def read(self, path: Path) -> dict[str, Any]:
        """Read the file.

        Raises
        ------
        CalibrationError
            If it is missing, cannot be read or is not TOML.
        """
        missing = f"no such {self.kind}; make one with glint-aoa calibrate {self.command}"
        return read_toml(path, missing=missing, error=CalibrationError)

    def validated(self, path: Path, content: dict[str, Any], section: type[_S]) -> _S:
        """Make a section of the content.

        Raises
        ------
        CalibrationError
            If it is not such a calibration; the message names the key.
        """
        try:
            return section.model_validate(content)
        except pydantic.ValidationError as error:
            raise CalibrationError(
                f"{path}: not a {self.kind} that can be used ({first_problem(error, section)}); "
                f"repeat glint-aoa calibrate {self.command}"
            ) from None
