"""The one table of flags: bit, name and meaning.

A flag is a bit of a decimal mask; 0 is good. The same table serves columns, fields, points and
acquisition samples, so a mask means the same wherever it stands.
"""

from enum import IntFlag

__all__ = ["REJECTING", "Flag", "describe"]


class Flag(IntFlag):
    """What may be wrong with a measurement; a member's docstring says it in words."""

    NO_GLINT = 1 << 0
    LOW_CONTRAST = 1 << 1
    TRUNCATED = 1 << 2
    SATURATED = 1 << 3
    FEW_COLUMNS = 1 << 4
    POOR_LINE = 1 << 5
    UNCALIBRATED = 1 << 6
    OUTSIDE_CALIBRATION = 1 << 7
    TIMING = 1 << 8
    CLIPPED_CHANNEL = 1 << 9
    FILTER_SETTLING = 1 << 10
    UNCERTAIN_CORRECTION = 1 << 11
    FEW_FIELDS = 1 << 12
    ALIASED = 1 << 13
    PARITY_ORDER = 1 << 14
    REPEATED = 1 << 15
    DROPPED = 1 << 16
    FADING = 1 << 17
    MOVED = 1 << 18
    CAMERA_MOVED = 1 << 19
    SECOND_GLINT = 1 << 20
    CURVED_LINE = 1 << 21
    PIXEL_LOCKING = 1 << 22
    UNCORRELATED = 1 << 23
    GAP = 1 << 24
    UNEVEN = 1 << 25


_MEANINGS = {
    Flag.NO_GLINT: "no glint was found; nothing was measured",
    Flag.LOW_CONTRAST: "the glint hardly stands out from its background",
    Flag.TRUNCATED: "the glint runs out of the recorded window",
    Flag.SATURATED: "pixels of the glint are clipped at the top of the scale",
    Flag.FEW_COLUMNS: "fewer than half of the columns could be used",
    Flag.POOR_LINE: "the centres scatter about the line by more than their noise",
    Flag.UNCALIBRATED: "no camera in the setup: the angle is that of the image plane",
    Flag.OUTSIDE_CALIBRATION: "the calibration does not cover angle, temperature, line or setup",
    Flag.TIMING: "timestamps are irregular",
    Flag.CLIPPED_CHANNEL: "an acquisition channel reached the end of its range",
    Flag.FILTER_SETTLING: "the low-pass filter has not settled here",
    Flag.UNCERTAIN_CORRECTION: "the correction leaves more than it can vouch for",
    Flag.FEW_FIELDS: "fewer than half of the fields could be used",
    Flag.ALIASED: "the model moves faster than half the field rate can show",
    Flag.PARITY_ORDER: "even and odd fields seem to be in the wrong order here",
    Flag.REPEATED: "the field is a copy of the one before it",
    Flag.DROPPED: "fields are missing before this one",
    Flag.FADING: "the glint is less than half as bright as it was elsewhere in the point",
    Flag.MOVED: "the glint is not where the fields around this one put it",
    Flag.CAMERA_MOVED: "the reference mark is not where it was: camera or window moved",
    Flag.SECOND_GLINT: "another line is nearly as bright; the angle may be that of the wrong one",
    Flag.CURVED_LINE: "the line is bent beyond its noise: see calibration, focus or the model",
    Flag.PIXEL_LOCKING: "the centres are drawn to whole field lines",
    Flag.UNCORRELATED: "vibration below the modulation frequency that no channel explains",
    Flag.GAP: "acquisition samples are missing here and were bridged",
    Flag.UNEVEN: "columns lie off the line for good and leave more doubt than the fields' noise",
}

REJECTING = (
    Flag.NO_GLINT
    | Flag.FEW_COLUMNS
    | Flag.POOR_LINE
    | Flag.REPEATED
    | Flag.MOVED
    | Flag.CAMERA_MOVED
)
"""A field with any of these is left out of the mean of its point."""


def describe(mask: int) -> list[str]:
    """Say in words what the bits of `mask` mean, lowest bit first; empty for a good one."""
    return [f"{flag.name}: {_MEANINGS[flag]}" for flag in Flag if mask & flag]
