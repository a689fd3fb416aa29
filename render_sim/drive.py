"""The shaker's signals as a campaign file states them: kind, frequencies, levels, when it stops."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from glint_aoa.setup import Section, positive, quantity
from render_sim.excitation import (
    Tones,
    modulated_sine,
    period_beyond,
    random_band,
    sine,
    sine_sweep,
)
from render_sim.modes import Plane

__all__ = ["Drive", "Series"]

_Hertz = Annotated[float, quantity("Hz"), positive]
_Seconds = Annotated[float, quantity("s"), positive]
_Moment = Annotated[float, quantity("N*m"), positive]

HIGHEST_HZ = 400.0
"""Half the acquisition's rate [Hz]."""

_OWN_KEYS = {
    "sine": {"frequency"},
    "modulated sine": {"frequency", "modulation", "depth"},
    "random": {"band"},
    "sine sweep": {"band", "law", "sweep_time"},
}
_NEEDED = {"sine": "frequency", "modulated sine": "frequency"}
_REST_S = 30.0  # after a sine sweep, for the modes to come to rest before it comes round again


class Drive(Section):
    """A signal of the shaker at one level or several; hertz, seconds and N m."""

    kind: Literal["sine", "modulated sine", "random", "sine sweep"] = Field(
        description="the shaker's signal"
    )
    frequency: _Hertz | None = Field(None, description="of a sine or modulated sine")
    modulation: _Hertz = Field(0.25, description="frequency of the amplitude modulation")
    depth: Annotated[float, Field(strict=True, gt=0, le=4)] = Field(
        1.0, description="depth of the force's amplitude modulation; a mode follows less deeply"
    )
    band: tuple[_Hertz, _Hertz] = Field(
        (5.0, 60.0), description="of the random signal; of a sine sweep, its first and last"
    )
    law: Literal["linear", "logarithmic"] = Field(
        "logarithmic", description="how a sine sweep's frequency goes with time"
    )
    sweep_time: _Seconds | None = Field(
        None, description="how long a sine sweep takes, from the trigger; the record if not given"
    )
    moments: Annotated[tuple[_Moment, ...], Field(min_length=1)] = Field(
        description="levels: peak-to-peak balance moment in the plane, over the record"
    )

    @model_validator(mode="after")
    def _signal_is_whole(self) -> Self:
        needed = _NEEDED.get(self.kind)
        if needed is not None and self.frequency is None:
            raise ValueError(f"{self.kind} needs a {needed}, such as {needed} = '9.8 Hz'")
        strange = sorted((self.model_fields_set & _SIGNAL_KEYS) - _OWN_KEYS[self.kind])
        if strange:
            usual = ", ".join(sorted(_OWN_KEYS[self.kind]))
            raise ValueError(f"{strange[0]} is not of kind {self.kind}, which has {usual}")
        return self

    @model_validator(mode="after")
    def _band_can_be_recorded(self) -> Self:
        low, high = self.band
        if low == high or (self.kind == "random" and low > high):
            raise ValueError("band is empty; give its lower end, then its upper")
        if self.highest >= HIGHEST_HZ:
            raise ValueError(
                f"{self.highest:g} Hz is not below {HIGHEST_HZ:g} Hz, half the acquisition's "
                "rate; lower it"
            )
        return self

    @property
    def highest(self) -> float:
        """Highest frequency asked for [Hz]."""
        return max(self.band) if self.frequency is None else self.frequency

    @property
    def signal_label(self) -> str:
        """What is written of the signal, such as ``"sine 9.8 Hz"``."""
        if self.frequency is None:
            return f"{self.kind} {self.band[0]:g}-{self.band[1]:g} Hz"
        at = f" at {self.modulation:g} Hz" if self.kind == "modulated sine" else ""
        return f"{self.kind} {self.frequency:g} Hz{at}"

    def force(self, rng: np.random.Generator, *, duration_s: float, lead_s: float) -> Tones:
        """Return the shaker's force at unit level, its phases drawn from `rng`.

        Parameters
        ----------
        rng : Generator
            Source of the phases.
        duration_s, lead_s : float
            Length of the record and of what is needed ahead of it [s]; nothing repeats in either.
        """
        if self.kind == "random":
            return random_band(*self.band, period_s=period_beyond(duration_s + lead_s), rng=rng)
        if self.frequency is None:
            return sine_sweep(
                *self.band,
                law=self.law,
                time_s=self.sweep_time or duration_s,
                period_s=period_beyond(duration_s + lead_s + _REST_S),
                rng=rng,
            )
        if self.kind == "sine":
            return sine(self.frequency, rng=rng)
        return modulated_sine(
            self.frequency, modulation_hz=self.modulation, depth=self.depth, rng=rng
        )


_SIGNAL_KEYS = set().union(*_OWN_KEYS.values())


class Series(Drive):
    """Points of one excitation at rising levels."""

    plane: Plane = Field(description="plane of the force")
    shaker_off: _Seconds | None = Field(
        None, description="when the shaker stops and the model rings down; never if not given"
    )
    other_plane: Drive | None = Field(
        None, description="what drives the other plane at the same time, level by level"
    )

    @model_validator(mode="after")
    def _levels_are_pairs(self) -> Self:
        other = self.other_plane
        if other is not None and len(other.moments) != len(self.moments):
            raise ValueError(
                f"other_plane has {len(other.moments)} moments, the series {len(self.moments)}; "
                "give as many"
            )
        return self

    @property
    def across(self) -> Plane:
        """The other plane."""
        return "pitch" if self.plane == "yaw" else "yaw"

    @property
    def label(self) -> str:
        """What is written of the excitation, such as ``"yaw sine 9.8 Hz"``."""
        own = f"{self.plane} {self.signal_label}"
        also = f" and {self.across} {self.other_plane.signal_label}" if self.other_plane else ""
        off = "" if self.shaker_off is None else f", off at {self.shaker_off:g} s"
        return f"{own}{also}{off}"

    def check_within(self, duration_s: float) -> None:
        """Refuse what cannot happen in a record of this length [s]; raise ValueError."""
        if self.shaker_off is not None and self.shaker_off >= duration_s:
            raise ValueError(
                f"shaker_off at {self.shaker_off:g} s is not within the record of "
                f"{duration_s:g} s; give an earlier time or a longer duration"
            )
        for drive in (self, self.other_plane):
            if drive is not None and (drive.sweep_time or 0.0) > duration_s:
                raise ValueError(
                    f"sweep_time of {drive.sweep_time:g} s does not fit in the record of "
                    f"{duration_s:g} s; shorten it or give a longer duration"
                )
