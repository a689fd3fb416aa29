"""One grey level a pixel out of a colour picture."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.records.formats._beside import Channel

__all__ = ["grey_note", "grey_of"]

_WEIGHTS = {"red": 0.299, "green": 0.587, "blue": 0.114}
"""Of luma, ITU-R BT.601; a grey picture stored in colour comes out as it went in."""


def grey_of(rgb: NDArray[Any], channel: Channel | None) -> NDArray[Any]:
    """Take a channel, or luma.

    Parameters
    ----------
    rgb : ndarray [line, column, channel]
        Red, green, blue, uint8 or uint16.
    channel : {"luma", "red", "green", "blue"} or None
        None for luma.

    Returns
    -------
    ndarray [line, column]
        Of the same type: a channel as stored; luma, rounded to whole grey levels.
    """
    if channel in _WEIGHTS:
        return np.ascontiguousarray(rgb[..., list(_WEIGHTS).index(channel)])
    weights = np.array(list(_WEIGHTS.values()), np.float32)
    luma = rgb[..., 0] * weights[0] + rgb[..., 1] * weights[1] + rgb[..., 2] * weights[2]
    return np.asarray(np.rint(luma), rgb.dtype)


def grey_note(channel: Channel | None) -> str:
    """Say what was made of colour."""
    if channel in _WEIGHTS:
        return f"colour: the {channel} channel was taken"
    weights = " + ".join(f"{weight} {name}" for name, weight in _WEIGHTS.items())
    return f"colour: grey was made of it as {weights}; a channel of its own can be chosen"
