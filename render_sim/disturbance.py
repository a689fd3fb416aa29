"""What disturbs a record beside the shaker: a loose mass in the model, and a knock.

The paper's regression study met both: balance and accelerometers that move without the indicated
angle, and an impulse in the angle that neither of them shows.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from glint_aoa.setup import Section, positive, quantity
from render_sim.excitation import Tones, random_band
from render_sim.modal_motion import Signal
from render_sim.modes import Plane
from render_sim.motion import Floats, Motion, rigid, rotation_y

__all__ = ["Knock", "Knocked", "LooseMass", "loose_signals"]

_Metres = Annotated[float, quantity("m"), Field(ge=0, allow_inf_nan=False)]
_Seconds = Annotated[float, quantity("s"), positive]
_Hertz = Annotated[float, quantity("Hz"), positive]

_SENSORS: Mapping[Plane, tuple[str, str, str]] = {
    "yaw": ("side_force", "yaw_moment", "ay_face"),
    "pitch": ("normal_force", "pitch_moment", "az_face"),
}
"""Force, moment and accelerometer of each plane; a force ahead gives a moment of its sign."""

_SWELL_S = 0.5


class LooseMass(Section):
    """A loose mass that the balance feels and the package does not; SI units.

    It moves at random in a narrow band, and makes the bracket of the accelerometer on the package's
    face tremble in the same band.
    """

    plane: Plane = Field(description="plane in which it moves")
    mass: Annotated[float, quantity("kg"), positive] = Field(description="of the loose part")
    station: Annotated[float, quantity("m"), Field(allow_inf_nan=False)] = Field(
        description="model x where it strikes"
    )
    travel: _Metres = Field(description="standard deviation of its motion")
    bracket: _Metres = Field(0.0, description="standard deviation of the bracket's motion")
    band: tuple[_Hertz, _Hertz] = Field(description="of both motions")
    rattle: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] = Field(
        1.0, description="how many times as far it moves in the end"
    )
    rattle_from: _Seconds = Field(1.0, description="from when on, after the trigger")

    @model_validator(mode="after")
    def _band_is_not_empty(self) -> Self:
        if self.band[0] >= self.band[1]:
            raise ValueError("band is empty; give its lower end, then its upper")
        return self


class Knock(Section):
    """A short nod about the balance's moment centre, as after a knock; radians and seconds."""

    time: _Seconds = Field(description="when, after the trigger")
    angle: Annotated[float, quantity("rad"), Field(allow_inf_nan=False)] = Field(
        description="how far, nose up"
    )
    width: _Seconds = Field(0.5, description="from its height to 1/e of it")


@dataclass(frozen=True, eq=False)
class Knocked:
    """A motion with a nod on top of it."""

    motion: Motion
    knock: Knock

    def pose(self, time_s: Floats) -> Floats:
        """Return the poses; see `render_sim.motion.Motion`."""
        shape = np.exp(-(((time_s - self.knock.time) / self.knock.width) ** 2))
        nod = rotation_y(-self.knock.angle * shape)
        return np.asarray(self.motion.pose(time_s) @ rigid(nod, np.zeros(3)))


@dataclass(frozen=True, eq=False)
class _Swelling:
    """A signal that grows to `rattle` times its size about a time."""

    signal: Tones
    rattle: float
    from_s: float

    def at(self, time_s: Floats) -> Floats:
        grown = 1 / (1 + np.exp(-(time_s - self.from_s) / _SWELL_S))
        return np.asarray((1 + (self.rattle - 1) * grown) * self.signal.at(time_s))


def loose_signals(
    loose: LooseMass, *, period_s: float, rng: np.random.Generator
) -> dict[str, Signal]:
    """Return what a loose mass adds to the sensors.

    Parameters
    ----------
    loose : LooseMass
        The mass.
    period_s : float
        Period after which its motion repeats [s].
    rng : Generator
        Draws the motions.

    Returns
    -------
    dict of str to Signal
        By sensor: its reaction and the reaction's moment on the balance [N, N m], and the
        acceleration of the bracket [m/s^2].
    """
    force, moment, felt = _SENSORS[loose.plane]
    shaken, trembling = (
        random_band(*loose.band, period_s=period_s, rng=rng).derivative(2) for _ in range(2)
    )
    reaction = shaken.scaled(-loose.mass * loose.travel)
    grown = (loose.rattle, loose.rattle_from)
    return {
        force: _Swelling(reaction, *grown),
        moment: _Swelling(reaction.scaled(loose.station), *grown),
        felt: trembling.scaled(loose.bracket),
    }
