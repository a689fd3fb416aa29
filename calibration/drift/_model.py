"""What check points say, and what each cause of a drift would make them say."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.drift._reference import SweepReference
from calibration.drift._signatures import Signature, SignatureModel
from calibration.sweep.pitch_sweep import PitchSweep
from calibration.sweep.point import SweepPoint
from glint_aoa.setup import Setup

__all__ = ["Cause", "Observations", "Trial", "observe", "trials"]

Floats = NDArray[np.float64]
Cause = Literal["nothing", "camera", "lamp", "model", "onboard sensor"]

_PLAUSIBLE = {
    "turn_deg": 0.1,
    "lamp_mm": 50.0,
    "height_mm": 5.0,
    "sag_deg": 0.05,
    "zero_deg": 0.02,
    "scale": 0.002,
    "glint_mm": 1.0,
}
"""How large a change may well be, 1 sigma: what is much larger needs better evidence."""


class Parameter(NamedTuple):
    """One parameter of a hypothesis: its name, unit, plausible size, and effect per unit."""

    name: str
    unit: str
    plausible: float
    effect: Floats


class Trial(NamedTuple):
    """A hypothesis: what may have happened, and by what parameters it shows."""

    name: str
    cause: Cause
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True, eq=False)
class Observations:
    """How check points differ from the sweep; one vector of all that is known.

    Attributes
    ----------
    values : ndarray, shape (value,)
        Calibrated optical less onboard angle [deg]; then, where sweep and points have them,
        intercept less the sweep's [mm], onboard less nominal angle less the sweep's [deg], and
        the reference mark's row and column less the sweep's [pixels].
    covariance : ndarray, shape (value, value)
        Of the values where nothing has changed.
    n_points : int
        Number of check points; each kind of value has one for each.
    kinds : tuple of str
        ``"angle"``, then those of ``"intercept"``, ``"support"``, ``"row"``, ``"column"`` that are
        known.
    """

    values: Floats
    covariance: Floats
    n_points: int
    kinds: tuple[str, ...]

    def of(self, kind: str) -> slice:
        """Where the values of a kind stand."""
        start = self.kinds.index(kind) * self.n_points
        return slice(start, start + self.n_points)

    def std(self, kind: str) -> Floats:
        """Return the standard deviation of the values of a kind, as [point]."""
        return np.sqrt(np.diag(self.covariance)[self.of(kind)])

    def stacked(self, effects: dict[str, Floats]) -> Floats:
        """Return effects by kind as one vector; what is not named does not change."""
        none = np.zeros(self.n_points)
        return np.concatenate([effects.get(kind, none) + none for kind in self.kinds])


def observe(
    sweep: PitchSweep, reference: SweepReference, points: Sequence[SweepPoint]
) -> Observations:
    """Hold check points against the sweep.

    Parameters
    ----------
    sweep : PitchSweep
        The calibration.
    reference : SweepReference
        What the sweep says of intercept, support and mark.
    points : sequence of SweepPoint
        The check points.

    Returns
    -------
    Observations
        With the calibration's own covariance, which all points share.
    """
    optical = np.array([point.optical_deg for point in points])
    warm = [point.temperature_k for point in points]
    applied = [sweep.apply(x, temperature_k=t) for x, t in zip(optical, warm, strict=True)]
    noise = [
        np.hypot(point.onboard_std_deg, float(each.gain) * point.optical_std_deg)
        for point, each in zip(points, applied, strict=True)
    ]
    lasting = [sweep.lasting_std_deg(each) for each in warm]
    angle = np.array([float(each.angle_deg) for each in applied])
    values = {"angle": angle - [point.onboard_deg for point in points]}
    blocks = {
        "angle": sweep.covariance(optical, warm) + np.diag(np.square([noise, lasting]).sum(0))
    }
    for kind, (shift, covariance) in reference.shifts(points).items():
        values[kind], blocks[kind] = shift, covariance
    n, total = len(points), len(points) * len(values)
    covariance = np.zeros((total, total))
    for number, block in enumerate(blocks.values()):
        covariance[number * n : (number + 1) * n, number * n : (number + 1) * n] = block
    return Observations(np.concatenate(list(values.values())), covariance, n, tuple(values))


def trials(
    seen: Observations,
    sweep: PitchSweep,
    points: Sequence[SweepPoint],
    setup: Setup,
    columns: tuple[float, float],
) -> tuple[Trial, ...]:
    """Return the hypotheses, each with what it does to the observations.

    Parameters
    ----------
    seen : Observations
        Says what is known.
    sweep : PitchSweep
        Turns changes of the optical angle into changes of the calibrated one.
    points : sequence of SweepPoint
        The check points.
    setup : Setup
        Says where camera, known plane and lamp are.
    columns : tuple of float
        First and last sensor column measured.
    """
    found = [Trial("nothing has changed", "nothing", ()), *_onboard(seen, points)]
    if "intercept" in seen.kinds:
        scene = _scene(points, setup, columns)
        gain = np.array(
            [float(sweep.derivative(p.optical_deg, temperature_k=p.temperature_k)) for p in points]
        )
        found += [*_camera(seen, scene, gain), *_model(seen, scene, gain)]
        found.append(_lamp(seen, scene, gain, points))
    else:
        roll = seen.stacked({"angle": np.ones(len(points))})
        named = Parameter("roll", "deg", _PLAUSIBLE["turn_deg"], roll)
        found.append(Trial("the camera rolled", "camera", (named,)))
    return tuple(found)


def _scene(
    points: Sequence[SweepPoint], setup: Setup, columns: tuple[float, float]
) -> SignatureModel:
    return SignatureModel(
        setup=setup,
        angle_deg=np.array([point.optical_deg for point in points]),
        intercept_mm=np.array([point.intercept_mm for point in points], np.float64),
        columns=columns,
        mark=next((point.mark_at for point in points if point.mark_at is not None), None),
    )


def _effect(seen: Observations, signature: Signature, gain: Floats) -> Floats:
    row, column = signature.mark
    none = np.zeros(seen.n_points)
    return seen.stacked(
        {
            "angle": gain * signature.angle_deg,
            "intercept": signature.intercept_mm,
            "row": none + row,
            "column": none + column,
        }
    )


def _camera(seen: Observations, scene: SignatureModel, gain: Floats) -> list[Trial]:
    size = _PLAUSIBLE["turn_deg"]
    tilt, roll, pan = (
        Parameter(name, "deg", size, _effect(seen, scene.camera_turned(axis), gain))
        for axis, name in enumerate(("omega", "phi", "kappa"))
    )
    return [
        Trial("the camera rolled", "camera", (roll,)),
        Trial("the camera tilted, or rose or sank", "camera", (tilt,)),
        Trial("the camera panned, or moved along the tunnel", "camera", (pan,)),
        Trial("the camera turned about several axes, or moved", "camera", (tilt, roll, pan)),
    ]


def _model(seen: Observations, scene: SignatureModel, gain: Floats) -> list[Trial]:
    raised = _effect(seen, scene.model_raised(), gain)
    height = Parameter("height", "mm", _PLAUSIBLE["height_mm"], raised)
    found = [Trial("the model moved up or down", "model", (height,))]
    if "support" in seen.kinds:
        turned = seen.stacked({"support": np.ones(seen.n_points)})
        sag = Parameter("pitch at the same setting", "deg", _PLAUSIBLE["sag_deg"], turned)
        found.append(Trial("the model sagged on its support", "model", (height, sag)))
    return found


def _lamp(
    seen: Observations, scene: SignatureModel, gain: Floats, points: Sequence[SweepPoint]
) -> Trial:
    if scene.knows_lamp:
        size = _PLAUSIBLE["lamp_mm"]
        moved = [
            Parameter(f"lamp {name}", "mm", size, _effect(seen, scene.lamp_moved(axis), gain))
            for axis, name in ((1, "Y"), (2, "Z"))
        ]
        return Trial("the lamp moved", "lamp", tuple(moved))
    none = np.zeros(seen.n_points)
    angle = np.array([point.onboard_deg for point in points])
    scale = Parameter("scale", "", _PLAUSIBLE["scale"], seen.stacked({"angle": angle}))
    glint = seen.stacked({"intercept": none + 1})
    height = Parameter("glint's height", "mm", _PLAUSIBLE["glint_mm"], glint)
    return Trial("the lamp moved", "lamp", (scale, height))


def _onboard(seen: Observations, points: Sequence[SweepPoint]) -> list[Trial]:
    angle = np.array([point.onboard_deg for point in points])
    ones = np.ones(seen.n_points)
    zero = seen.stacked({"angle": -ones, "support": ones})
    scale = seen.stacked({"angle": -angle, "support": angle})
    return [
        Trial(
            "the onboard sensor's zero shifted",
            "onboard sensor",
            (Parameter("zero", "deg", _PLAUSIBLE["zero_deg"], zero),),
        ),
        Trial(
            "the onboard sensor's scale changed",
            "onboard sensor",
            (Parameter("scale", "", _PLAUSIBLE["scale"], scale),),
        ),
    ]
