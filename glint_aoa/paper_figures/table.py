"""Which point feeds which figure, and in which axes: the one place that says so.

Titles are our own words for what the paper's captions and text say; published numbers are those of
its section "Discussion of Test Results" and its Tables 2 to 4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from glint_aoa.inertial.modes import Plane
from glint_aoa.paper_figures.figure_data import Axis

__all__ = ["FIGURES", "FigureSpec", "Kind", "Maker", "Wanted"]

Kind = Literal["sine", "modulated sine", "random"]
"""Excitations that figures show."""

Maker = Literal[
    "shut-off",
    "levels",
    "bias",
    "series",
    "spectra",
    "coherence",
    "residual",
    "moments",
    "runs",
    "angle",
    "intercept",
    "scatter",
]
"""How the numbers of a figure are made; see `glint_aoa.paper_figures.make`."""


@dataclass(frozen=True)
class Wanted:
    """The points that a figure can be made from.

    Attributes
    ----------
    plane : {"yaw", "pitch"} or None
        Plane of the excitation; any if None.
    kind : {"sine", "modulated sine", "random"} or None
        Kind of excitation; any if None.
    frequency_hz : float or None
        Of a sine [Hz]; the first mode was met over several per cent.
    angle_deg : float or None
        Nominal pitch angle [deg].
    other_than_deg : float or None
        Nominal pitch angle that is not meant [deg].
    in_run : bool
        Whether the point must be of a run that starts and ends with the shaker off.
    shuts_off : bool
        Whether the shaker must stop within the record.
    least_s : float
        Shortest acquisition record [s].
    least_film_s : float
        Shortest recording of fields [s].
    most_in_lb : float
        Largest peak-to-peak moment [in lbf].
    """

    plane: Plane | None = None
    kind: Kind | None = None
    frequency_hz: float | None = None
    angle_deg: float | None = None
    other_than_deg: float | None = None
    in_run: bool = False
    shuts_off: bool = False
    least_s: float = 0.0
    least_film_s: float = 0.0
    most_in_lb: float = float("inf")

    def __str__(self) -> str:
        """Say in words what is wanted."""
        what = " ".join(each for each in (self.plane, self.kind) if each) or "any excitation"
        if self.frequency_hz is not None:
            what += f" near {self.frequency_hz:g} Hz"
        if self.angle_deg is not None:
            what += f" at {self.angle_deg:g} deg"
        if self.other_than_deg is not None:
            what += f" at an angle other than {self.other_than_deg:g} deg"
        wishes = (
            (self.in_run, "in a run that starts and ends with the shaker off"),
            (self.shuts_off, "with the shaker shut off within the record"),
            (self.least_s > 0, f"recorded for {self.least_s:g} s or more"),
            (self.least_film_s > 0, f"with fields over {self.least_film_s:g} s or more"),
            (self.most_in_lb < float("inf"), f"at {self.most_in_lb:g} in lbf or less"),
        )
        return " ".join([what, *(words for wish, words in wishes if wish)])


@dataclass(frozen=True)
class FigureSpec:
    """A data figure of the paper.

    Attributes
    ----------
    number : int
        As in the paper.
    title : str
        What it shows.
    maker : str
        How its numbers are made; see `glint_aoa.paper_figures.make`.
    wanted : Wanted
        The points that it can be made from.
    x, y : Axis
        Its axes.
    paper : mapping of str to float or str
        What the paper states of it, by the name of the fact.
    source : {"acceleration", "moment"}
        What the regression's integral-squared signal comes from.
    between_s : (float, float) or None
        Stretch of the record that is regressed [s].
    """

    number: int
    title: str
    maker: Maker
    wanted: Wanted
    x: Axis
    y: Axis
    paper: Mapping[str, float | str]
    source: Literal["acceleration", "moment"] = "moment"
    between_s: tuple[float, float] | None = None


_TIME = Axis("time", "s")
_MOMENT = Axis("peak-to-peak moment", "in lbf", low=0.0)
_FREQUENCY = Axis("frequency", "Hz", low=0.0, high=1.0)
_RUN = Axis("point of the test")
_INDICATED = Axis("indicated angle", "deg")
_BIAS = Axis("bias of the inertial angle", "deg", has_zero=True)
_FILTERED = Axis("filtered angle", "deg")
_DENSITY = Axis("power density", "deg^2/Hz", log=True)
_COHERENCE = Axis("coherence", low=0.0, high=1.05)
_RESIDUAL = Axis("residual", "deg", has_zero=True)
_ERROR = Axis("error of the mean angle", "deg", has_zero=True)
_ANGLE = Axis("video angle", "deg")
_INTERCEPT = Axis("intercept", "in")
_SCATTER = Axis("standard deviation over 1 s", "deg")

_YAW_REGRESSION = Wanted("yaw", "modulated sine", 9.8, least_s=60.0)
_PITCH_REGRESSION = Wanted("pitch", "modulated sine", 9.2, least_s=60.0)
_YAW_FILMS = Wanted("yaw", "sine", 9.8, angle_deg=0.0, in_run=True, most_in_lb=4100.0)
_MODULATED_FILM = Wanted("pitch", "modulated sine", 9.2, least_film_s=4.0)
_RANDOM_FILM = Wanted("pitch", "random", least_film_s=4.0)


def _shut_off(number: int, frequency_hz: float, sign: str) -> FigureSpec:
    return FigureSpec(
        number,
        f"Indicated angle, yaw sine at {frequency_hz:g} Hz, shaker on then off",
        "shut-off",
        Wanted("yaw", "sine", frequency_hz, shuts_off=True),
        _TIME,
        _INDICATED,
        {"shift": sign},
    )


def _regression(number: int, title: str, between_s: tuple[float, float]) -> FigureSpec:
    errors = {24: (0.014, 71.0), 25: (0.0057, 88.0), 26: (0.007, 91.0)}
    standard_error, reduction = errors[number]
    return FigureSpec(
        number,
        f"Residual of the {title}, {between_s[0]:g} to {between_s[1]:g} s",
        "residual",
        _YAW_REGRESSION if number == 26 else _PITCH_REGRESSION,
        _TIME,
        _RESIDUAL,
        {"standard error": standard_error, "reduction": reduction},
        between_s=between_s,
    )


FIGURES: Mapping[int, FigureSpec] = {
    each.number: each
    for each in (
        _shut_off(11, 9.8, "negative"),
        _shut_off(12, 19.5, "negative"),
        _shut_off(13, 29.8, "positive"),
        FigureSpec(
            14,
            "Measured and estimated bias against level, yaw sine at 9.8 Hz, angle 0",
            "levels",
            Wanted("yaw", "sine", 9.8, angle_deg=0.0, in_run=True),
            _MOMENT,
            _BIAS,
            {"largest bias": -0.146, "largest left": -0.009},
        ),
        FigureSpec(
            15,
            "Measured and estimated bias against level, pitch sine at 9.2 Hz, angle 0",
            "levels",
            Wanted("pitch", "sine", 9.2, angle_deg=0.0, in_run=True),
            _MOMENT,
            _BIAS,
            {"largest bias": -0.175, "largest left": -0.006},
        ),
        FigureSpec(
            16,
            "Measured and estimated bias, pitch 9.2 Hz modulated at 0.25 Hz",
            "bias",
            Wanted("pitch", "modulated sine", 9.2, in_run=True),
            _TIME,
            _BIAS,
            {"largest difference": "below 0.005"},
        ),
        FigureSpec(
            17,
            "Inertial response and bias estimate of the 9.2 Hz mode alone, pitch random",
            "bias",
            Wanted("pitch", "random", in_run=True),
            _TIME,
            _BIAS,
            {},
        ),
        FigureSpec(
            18,
            "Filtered angle and integral-squared yawing moment, yaw 9.75 Hz modulated at 0.3 Hz",
            "series",
            _YAW_REGRESSION,
            _TIME,
            _FILTERED,
            {},
        ),
        FigureSpec(
            19,
            "Power spectra of filtered angle and integral-squared yawing moment",
            "spectra",
            _YAW_REGRESSION,
            _FREQUENCY,
            _DENSITY,
            {"peak of the angle": 0.3, "peak of the square": 0.3},
        ),
        FigureSpec(
            20,
            "Coherence of filtered angle and integral-squared yawing moment",
            "coherence",
            _YAW_REGRESSION,
            _FREQUENCY,
            _COHERENCE,
            {},
        ),
        FigureSpec(
            21,
            "Filtered angle and integral-squared y accelerometer, the same record",
            "series",
            _YAW_REGRESSION,
            _TIME,
            _FILTERED,
            {},
            source="acceleration",
        ),
        FigureSpec(
            22,
            "Power spectrum of the integral-squared y accelerometer",
            "spectra",
            _YAW_REGRESSION,
            _FREQUENCY,
            _DENSITY,
            {"peak of the square": 0.3},
            source="acceleration",
        ),
        FigureSpec(
            23,
            "Coherence of filtered angle and integral-squared y accelerometer",
            "coherence",
            _YAW_REGRESSION,
            _FREQUENCY,
            _COHERENCE,
            {},
            source="acceleration",
        ),
        _regression(24, "pitch regression", (15.0, 85.0)),
        _regression(25, "pitch regression", (20.0, 40.0)),
        _regression(26, "yaw regression", (10.0, 30.0)),
        FigureSpec(
            27,
            "Error of video and inertial angle against peak-to-peak moment",
            "moments",
            Wanted(in_run=True),
            _MOMENT,
            _ERROR,
            {
                "yaw, video, largest": 0.006,
                "yaw, inertial, largest": -0.217,
                "pitch, video, largest": 0.010,
                "pitch, inertial, largest": -0.174,
            },
        ),
        FigureSpec(
            28,
            "Errors run by run, yaw, angle 0",
            "runs",
            Wanted("yaw", angle_deg=0.0, in_run=True),
            _RUN,
            _ERROR,
            {},
        ),
        FigureSpec(
            29,
            "Errors run by run, yaw, other pitch angles",
            "runs",
            Wanted("yaw", other_than_deg=0.0, in_run=True),
            _RUN,
            _ERROR,
            {},
        ),
        FigureSpec(
            30,
            "Errors run by run, pitch",
            "runs",
            Wanted("pitch", in_run=True),
            _RUN,
            _ERROR,
            {"video, largest": 0.010, "inertial, largest": -0.174},
        ),
        FigureSpec(
            31,
            "Video angle over 1 s, yaw sine at 9.8 Hz, several moments",
            "angle",
            _YAW_FILMS,
            _TIME,
            _ANGLE,
            {"largest change": 0.04, "at a moment of": 4000.0},
        ),
        FigureSpec(
            32,
            "Intercept over 1 s, yaw sine at 9.8 Hz, several moments",
            "intercept",
            _YAW_FILMS,
            _TIME,
            _INTERCEPT,
            {"largest change": 0.01, "at a moment of": 4000.0},
        ),
        FigureSpec(
            33,
            "Video angle over 4.6 s, pitch 9.2 Hz modulated at 0.25 Hz",
            "angle",
            _MODULATED_FILM,
            _TIME,
            _ANGLE,
            {"largest departure from the mean": "almost 0.3"},
        ),
        FigureSpec(
            34,
            "Video angle over 4.6 s, pitch random 5 to 60 Hz",
            "angle",
            _RANDOM_FILM,
            _TIME,
            _ANGLE,
            {},
        ),
        FigureSpec(
            35,
            "Intercept over 4.6 s, pitch 9.2 Hz modulated at 0.25 Hz",
            "intercept",
            _MODULATED_FILM,
            _TIME,
            _INTERCEPT,
            {"largest change": 0.1},
        ),
        FigureSpec(
            36,
            "Intercept over 4.6 s, pitch random 5 to 60 Hz",
            "intercept",
            _RANDOM_FILM,
            _TIME,
            _INTERCEPT,
            {},
        ),
        FigureSpec(
            37,
            "Standard deviation of the video angle over 1 s against moment",
            "scatter",
            Wanted(in_run=True),
            _MOMENT,
            _SCATTER,
            {"yaw, largest": "below 0.02", "pitch over yaw": 10.0},
        ),
    )
}
"""The paper's data figures by number."""
