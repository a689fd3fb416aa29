"""What is known of a recording once its file and the setup have both spoken."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import SetupError
from glint_aoa.records.fields import FieldStack
from glint_aoa.setup import Fields, Setup

__all__ = ["SAID_BY_BOTH", "Recording", "resolve_recording"]

SAID_BY_BOTH = {
    "rate": "rate_hz",
    "exposure": "exposure_s",
    "first_line": "first_line",
    "first_column": "first_column",
    "first_parity": "first_parity",
    "interlaced": "interlaced",
}
"""Keys of the setup's ``[fields]``, and what a file's `FieldInfo` calls them."""

_RELATIVE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Recording:
    """Timing and window of a recording; `parity_of` and `time_of` follow from them."""

    rate_hz: float
    exposure_s: float
    first_line: int
    first_column: int
    first_parity: int
    interlaced: bool
    start_s: float

    def parity_of(self, field: NDArray[np.int64]) -> NDArray[np.int64]:
        """Parity, 0 even and 1 odd, of each field number."""
        if not self.interlaced:
            return np.zeros_like(field)
        return (field + self.first_parity) % 2

    def line_of(self, row: NDArray[np.float64], field: NDArray[np.int64]) -> NDArray[np.float64]:
        """Sensor field lines [field, ...] of rows of the recorded window; parity enters here."""
        parity = self.parity_of(field).reshape(-1, *[1] * (row.ndim - 1))
        lines: NDArray[np.float64] = self.first_line + row + 0.5 * parity
        return lines

    def time_of(self, field: NDArray[np.int64]) -> NDArray[np.float64]:
        """Start of the exposure of each field number [s], for fields without timestamps."""
        return self.start_s + field / self.rate_hz


def resolve_recording(stack: FieldStack, setup: Setup) -> Recording:
    """Join what the file says of itself with what the setup says.

    Raises
    ------
    SetupError
        If both speak and differ, if neither gives the field rate, or if the window does not lie
        on the sensor.
    """
    said = _agreed(stack, setup.fields)
    # Only interlaced fields have a parity: who states one says so.
    interlaced = said["interlaced"]
    if interlaced is None:
        interlaced = said["first_parity"] is not None
    if said["rate"] is None and stack.times_s is not None and stack.n_fields > 1:
        said["rate"] = 1 / float(np.median(np.diff(stack.times_s)))
    if said["rate"] is None or not said["rate"] > 0:
        raise SetupError(
            f"{stack.name}: the file does not say its field rate; give fields.rate in the setup"
        )
    recording = Recording(
        rate_hz=said["rate"],
        exposure_s=said["exposure"] or 0.0,
        first_line=said["first_line"] or 0,
        first_column=said["first_column"] or 0,
        first_parity=1 if said["first_parity"] == "odd" else 0,
        interlaced=interlaced,
        start_s=stack.info.start_s or 0.0,
    )
    _check_window(recording, stack, setup)
    return recording


def _agreed(stack: FieldStack, fields: Fields) -> dict[str, Any]:
    said = {}
    for key, name in SAID_BY_BOTH.items():
        file_says, setup_says = getattr(stack.info, name), getattr(fields, key)
        if file_says is not None and setup_says is not None and _differ(file_says, setup_says):
            raise SetupError(
                f"{stack.name}: the file says {key} {file_says}, the setup fields.{key} "
                f"{setup_says}; take it out of the setup or correct it{_or_beside(stack)}"
            )
        said[key] = setup_says if file_says is None else file_says
    return said


def _or_beside(stack: FieldStack) -> str:
    """Say where to overrule a file: a slowed video states the rate at which it is shown."""
    if stack.path is None:
        return ""
    return f"; where the file is wrong, tell {stack.path.name}.toml beside it"


def _differ(one: Any, other: Any) -> bool:
    if isinstance(one, float) or isinstance(other, float):
        return not abs(one - other) <= _RELATIVE_TOLERANCE * abs(other)
    return bool(one != other)


def _check_window(recording: Recording, stack: FieldStack, setup: Setup) -> None:
    window = setup.glint.search_window
    if window is not None and window[1] > stack.n_lines:
        raise SetupError(
            f"glint.search_window {list(window)} ends outside the {stack.n_lines} recorded rows "
            f"of {stack.name}; its last row is excluded and may be {stack.n_lines} at most"
        )
    _check_reference(stack, setup)
    if setup.camera.sensor is None:
        return
    columns, lines = setup.camera.sensor
    fits = (
        recording.first_column + stack.n_columns <= columns
        and recording.first_line + stack.n_lines <= lines
    )
    if not fits:
        raise SetupError(
            f"{stack.name}: a window of {stack.n_columns} x {stack.n_lines} at column "
            f"{recording.first_column}, line {recording.first_line} does not fit the sensor of "
            f"{columns} x {lines}; correct camera.sensor, fields.first_line or first_column"
        )


def _check_reference(stack: FieldStack, setup: Setup) -> None:
    reference = setup.glint.reference
    if reference is None:
        return
    if reference.rows[1] > stack.n_lines or reference.columns[1] > stack.n_columns:
        raise SetupError(
            f"glint.reference rows {list(reference.rows)}, columns {list(reference.columns)} lie "
            f"outside the {stack.n_columns} x {stack.n_lines} recorded window of {stack.name}; "
            "the last of each is excluded"
        )
