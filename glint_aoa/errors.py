"""The errors of glint-aoa.

::

    GlintError                 anything this project raises on purpose
    +-- InputError             what the user gave cannot be used (exit code 2)
    |   +-- SetupError         the setup file
    |   +-- RecordingError     a file of fields or acquisition channels
    |   +-- CalibrationError   calibration data or a calibration file
    |   +-- OutputError        where results should go
    +-- MissingLibraryError    an optional part of the machine is not there
    +-- WorkerDiedError        a process that shared the work is gone

Every message is one sentence that names what was wrong, followed by the next step.
"""

__all__ = [
    "CalibrationError",
    "GlintError",
    "InputError",
    "MissingLibraryError",
    "OutputError",
    "RecordingError",
    "SetupError",
    "WorkerDiedError",
]


class GlintError(Exception):
    """Base of every error that this project raises on purpose.

    What a damaged file has put into a message is shown as spaces where it cannot be printed.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__("".join(c if c.isprintable() else " " for c in str(message)))


class InputError(GlintError):
    """What the user gave cannot be used."""


class SetupError(InputError):
    """The setup file is missing, malformed or contradicts the recording."""


class RecordingError(InputError):
    """A recording of fields or of acquisition channels cannot be used."""


class CalibrationError(InputError):
    """Calibration data do not determine what was asked of them."""


class OutputError(InputError):
    """Results cannot be written where they were asked for."""


class MissingLibraryError(GlintError):
    """A library that only some uses need is not installed or does not work."""


class WorkerDiedError(GlintError):
    """A process that shared the work died under an item, and another one after it."""
