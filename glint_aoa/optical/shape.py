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
    band_first, band_last : int
        Rows between which the sample's lines lie; looked at first.
    half_box : int
        Half the box of lines whose sum finds the glint [lines].
    surround : int
        From a box to those above and below that it is held against [lines].
    half_width, flank : float
        Half the centroid's window, and the lines of background on each side of it [lines].
    sign : int
        +1 for a bright glint, -1 for a dark one.
    threshold : float
        Least height over the background of a column [grey levels].
    patch_threshold : float
        Least height over what surrounds it of a patch of eight pixels along a line [grey levels].
    usual_contrast : float
        Height of the sample's glint in such patches [grey levels].
    saturation : float
        Grey level at which pixels clip.
    noise : float
        Noise of a background pixel, texture included [grey levels].
    second : float
        Height of a second, parallel line over that of the glint.
    found : bool
        Whether the sample showed a glint; if not, the widths are the least ones.
    """

    first_row: int
    last_row: int
    band_first: int
    band_last: int
    half_box: int
    surround: int
    half_width: float
    flank: float
    sign: int
    threshold: float
    patch_threshold: float
    usual_contrast: float
    saturation: float
    noise: float
    second: float
    found: bool
