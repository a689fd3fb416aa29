"""What is known of the glint before its columns are measured."""

from dataclasses import dataclass

__all__ = ["GlintShape"]


@dataclass(frozen=True)
class GlintShape:
    """What is known of the glint before its columns are measured.

    Attributes
    ----------
    first_row, last_row : int
        Rows of the recorded window to look in, last one excluded.
    half_box : int
        Half the box of lines whose sum finds the glint [lines].
    half_width, flank : float
        Half the centroid's window, and the lines of background on each side of it [lines].
    sign : int
        +1 for a bright glint, -1 for a dark one.
    threshold : float
        Least height over the background [grey levels].
    saturation : float
        Grey level at which pixels clip.
    noise : float
        Noise of a background pixel, texture included [grey levels].
    found : bool
        Whether the sample showed a glint; if not, the widths are the least ones.
    """

    first_row: int
    last_row: int
    half_box: int
    half_width: float
    flank: float
    sign: int
    threshold: float
    saturation: float
    noise: float
    found: bool
