"""One recording of the torture set: what is in view, how it moves, and what is owed for it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torture.profile import Profile

__all__ = ["LINES_PER_MM", "RATE_HZ", "Scene", "draw_scene"]

_Array = NDArray[np.float64]

RATE_HZ = 60.0
LINES_PER_MM = 35 / 1422.4 / 27.5e-3  # of motion in the plane of the paper's test
_PITCHES_UM = ((11.7, 27.5), (11.7, 27.5), (11.7, 27.5), (7.4, 7.4))
_WINDOWS = ((92, 752), (92, 752), (40, 752), (92, 376), (40, 300), (64, 500))
STEEPEST = np.tan(np.radians(12.0))


@dataclass
class Scene:
    """What a recording shows; rows and slopes are those of the true fields, in order of time.

    Attributes
    ----------
    kind : str
        What is wrong with it.
    lines, columns : int
        The window.
    pitch_um : (float, float)
        Pixel pitch, horizontal and vertical per field line.
    oriented : bool
        Whether the setup has a whole camera or a pixel pitch only.
    row, slope : ndarray, shape (field,)
        The line at the window's middle column, in rows of an even field, and its slope
        [lines / column], v down.
    profile : Profile
        Across the line.
    peak : float
        Height of the line over the background [grey levels].
    over_fields, over_columns : ndarray
        Brightness along time and along the line, times `peak`.
    background : ndarray, shape (line, column)
        Grey level without the line.
    texture : float
        Standard deviation of what in the background is texture [grey levels].
    read_noise, electrons_per_grey : float
        Noise.
    sign : int
        -1 for a dark line.
    interlaced : bool
        Whether the recording says that its fields are interlaced.
    parity : ndarray, shape (field,)
        True parity of each true field.
    first_parity : int
        Parity that the recording states for its first field.
    order : ndarray, shape (stored field,)
        Which true field each stored one shows.
    shows : ndarray, shape (stored field,)
        Which true field each stored one is taken for.
    second : list of (float, float)
        Parallel lines: offset [lines] and height relative to `peak`.
    fixed : list of ndarray, shape (line, column)
        What lies over everything and does not move; NaN where it lets through.
    camera_row, camera_slope : ndarray, shape (field,)
        What a moved camera adds to every line in view.
    mark : (float, slice) or None
        Row and columns of the static reference mark.
    glint : dict
        The setup's section ``[glint]``.
    times_s : ndarray or None
        Timestamps of the stored fields.
    owed : ndarray, shape (stored field,)
        Mask of flags of which each stored field must carry one; 0 for none.
    allowed : int
        Flags of the sequence that are no false alarm anywhere in this recording.
    """

    kind: str
    lines: int
    columns: int
    pitch_um: tuple[float, float]
    oriented: bool
    row: _Array
    slope: _Array
    profile: Profile
    peak: float
    over_fields: _Array
    over_columns: _Array
    background: _Array
    texture: float
    read_noise: float
    electrons_per_grey: float
    sign: int
    interlaced: bool
    parity: NDArray[np.int64]
    first_parity: int
    order: NDArray[np.int64]
    shows: NDArray[np.int64]
    camera_row: _Array
    camera_slope: _Array
    owed: NDArray[np.int64]
    second: list[tuple[float, float]] = field(default_factory=list)
    fixed: list[_Array] = field(default_factory=list)
    mark: tuple[float, slice] | None = None
    glint: dict[str, Any] = field(default_factory=dict)
    times_s: _Array | None = None
    allowed: int = 0

    @property
    def u(self) -> _Array:
        """Columns from the window's middle."""
        return np.arange(self.columns) - (self.columns - 1) / 2

    @property
    def aspect(self) -> float:
        """Vertical over horizontal pixel pitch."""
        return self.pitch_um[1] / self.pitch_um[0]

    @property
    def angle_deg(self) -> _Array:
        """True pitch of each true field, nose left [deg]."""
        return np.degrees(np.arctan(self.slope * self.aspect))

    def centre(self, k: int) -> _Array:
        """Row of the line in each column of true field `k`, in rows of the window."""
        row = self.row[k] + self.camera_row[k] - 0.5 * self.parity[k]
        return row + (self.slope[k] + self.camera_slope[k]) * self.u

    def keep_in_view(self) -> None:
        """Move and flatten the line so that it stays in the window."""
        margin = self.profile.body + 2.0
        self.row += (self.lines - 1) / 2 - (self.row.max() + self.row.min()) / 2
        room = (self.lines - 1) / 2 - margin - 0.5
        heave = np.ptp(self.row) / 2
        if heave > 0.4 * room:
            middle = (self.row.max() + self.row.min()) / 2
            self.row = middle + (self.row - middle) * 0.4 * room / heave
            heave = 0.4 * room
        steepest = np.abs(self.slope).max() * (self.columns - 1) / 2
        if steepest > room - heave:
            self.slope *= (room - heave) / steepest


def draw_scene(
    rng: np.random.Generator, kind: str, *, window: tuple[int, int] | None = None
) -> Scene:
    """Draw a recording with nothing wrong yet: a line in view that vibrates a little."""
    lines, columns = window or _WINDOWS[rng.integers(len(_WINDOWS))]
    n = int(rng.integers(24, 61))
    pitch_um = _PITCHES_UM[rng.integers(len(_PITCHES_UM))]
    interlaced = bool(rng.random() < 0.7)
    first_parity = int(rng.integers(2)) if interlaced else 0
    sigma = rng.uniform(0.8, 2.2)
    read_noise = rng.uniform(0.5, 2.0)
    texture = rng.choice([0.0, rng.uniform(0.0, 1.0)])
    background = rng.uniform(5, 40) + texture * _texture(rng, lines, columns)
    time = np.arange(n) / RATE_HZ
    pitch = rng.uniform(-12, 12) + _swing(rng, time, rng.choice([0.0, rng.uniform(0, 0.1)]))
    heave = _swing(rng, time, rng.choice([0.0, rng.uniform(0, 1.0)]))
    aspect = pitch_um[1] / pitch_um[0]
    scene = Scene(
        kind=kind,
        lines=lines,
        columns=columns,
        pitch_um=pitch_um,
        oriented=bool(rng.random() < 0.5),
        row=lines / 2 + rng.uniform(-3, 3) + LINES_PER_MM * heave,
        slope=np.tan(np.radians(pitch)) / aspect,
        profile=_profile(rng, sigma),
        peak=rng.uniform(50, 190),
        over_fields=np.ones(n),
        over_columns=np.ones(columns),
        background=background,
        texture=float(texture),
        read_noise=read_noise,
        electrons_per_grey=rng.uniform(60, 300),
        sign=1,
        interlaced=interlaced,
        parity=(np.arange(n) + first_parity) % 2 if interlaced else np.zeros(n, np.int64),
        first_parity=first_parity,
        order=np.arange(n),
        shows=np.arange(n),
        camera_row=np.zeros(n),
        camera_slope=np.zeros(n),
        owed=np.zeros(n, np.int64),
        glint={"column_step": 20 if columns > 600 else 10},
    )
    scene.keep_in_view()
    return scene


def _profile(rng: np.random.Generator, sigma: float) -> Profile:
    which = rng.integers(4)
    if which == 0:
        return Profile.skewed(sigma, rng.uniform(-1.2, 1.2))
    if which == 1:
        return Profile.skirted(sigma)
    if which == 2:
        return Profile.flat(min(sigma, 1.2), rng.uniform(0.5, 2.5))
    return Profile.gaussian(sigma)


def _texture(rng: np.random.Generator, lines: int, columns: int) -> _Array:
    """Grain of a pixel or two, of unit standard deviation."""
    grain = rng.standard_normal((lines + 1, columns + 2))
    soft: _Array = (grain[1:, :-2] + grain[:-1, :-2] + grain[1:, 1:-1] + grain[:-1, 2:]) / 2
    return soft


def _swing(rng: np.random.Generator, time: _Array, amplitude: float) -> _Array:
    """Return a sine of any frequency from 3 to 28 Hz."""
    phase = 2 * np.pi * (rng.uniform(3, 28) * time + rng.random())
    swing: _Array = amplitude * np.sin(phase)
    return swing
