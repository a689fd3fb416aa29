"""Wing twist: how far each station has turned between a picture without flow and one with it.

The ancestor of the glint's method: one camera, targets in planes of known Y, and a conformal
transformation between their coordinates without flow and with it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.twist._planes import WingPlanes
from calibration.twist.conformal import Conformal, fit_conformal
from calibration.twist.sighting import Sightings
from calibration.twist.wing_targets import WingTargets
from glint_aoa.errors import CalibrationError, SetupError
from glint_aoa.optical.average import mean_angle
from glint_aoa.setup import Setup

__all__ = ["StationTwist", "TargetMotion", "WingTwist", "measure_twist"]

Floats = NDArray[np.float64]

_LEAST_PICTURES = 8  # in which a motion can be seen


@dataclass(frozen=True)
class StationTwist:
    """What was measured at a station.

    Attributes
    ----------
    station : str
        Its name.
    y_m : float
        Mean known Y of its targets [m].
    twist_deg, twist_std_deg, twist_u95_deg : float
        Rotation from no flow to flow, leading edge up positive, its standard deviation (1 sigma)
        and half its 95 % interval [deg].
    relative_deg, relative_std_deg, relative_u95_deg : float or None
        The same less the rotation of the reference station [deg]; None without one.
    motion_std_deg : float
        What the wing's motion during the recordings adds, in `twist_std_deg` [deg].
    shift_x_m, shift_z_m : float
        Displacement of the middle of the targets along the plane's heading and up [m].
    scale : float
        Scale of the transformation; exactly 1 where it was held.
    rms_m : float
        Root mean square residual of the targets that were used [m].
    reduced_chi_square : float or None
        Of the fit; None where nothing is to spare.
    excess : float
        What the variance of the fit was multiplied by, since the noise of the centroids does not
        explain the residuals; 1 where it does.
    used : tuple of str
        Targets that the rotation rests on.
    outlying : tuple of str
        Targets that did not move with the others.
    missing : tuple of str
        Targets that were not found in one of the states.
    """

    station: str
    y_m: float
    twist_deg: float
    twist_std_deg: float
    twist_u95_deg: float
    relative_deg: float | None
    relative_std_deg: float | None
    relative_u95_deg: float | None
    motion_std_deg: float
    shift_x_m: float
    shift_z_m: float
    scale: float
    rms_m: float
    reduced_chi_square: float | None
    excess: float
    used: tuple[str, ...]
    outlying: tuple[str, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class TargetMotion:
    """One target in both states: pixels, metres of its plane, and its residual [m]."""

    id: str
    station: str
    no_flow_uv: tuple[float, float]
    flow_uv: tuple[float, float]
    no_flow_xz_m: tuple[float, float]
    flow_xz_m: tuple[float, float]
    residual_xz_m: tuple[float, float]
    used: bool


@dataclass(frozen=True)
class WingTwist:
    """Twist along the span.

    Attributes
    ----------
    name : str
        Name of the state with flow.
    reference : str or None
        Station that the others are held against.
    stations : tuple of StationTwist
        By their Y.
    targets : tuple of TargetMotion
        Those that were found in both states.
    clipped : tuple of str
        Targets some pixels of which clip.
    """

    name: str
    reference: str | None
    stations: tuple[StationTwist, ...]
    targets: tuple[TargetMotion, ...]
    clipped: tuple[str, ...]


def measure_twist(
    targets: WingTargets,
    no_flow: Sightings,
    flow: Sightings,
    setup: Setup,
    *,
    reference: str | None = None,
    free_scale: bool = False,
    allow_missing: bool = False,
) -> WingTwist:
    """Measure the twist of each station.

    Pixels become X and Z in the plane of each target's Y by collinearity; the rotation of each
    station is that of the conformal transformation between its targets without flow and with it.

    Parameters
    ----------
    targets : WingTargets
        The targets.
    no_flow, flow : Sightings
        The same targets in both states.
    setup : Setup
        Camera, heading of the known planes (`glint.yaw`) and where the nose points.
    reference : str, optional
        Station on the body, or one that does not twist: what it turned is the model's attitude.
    free_scale : bool, optional
        Whether the scale is fitted too.
    allow_missing : bool, optional
        Whether to go on with two targets or more of a station where others were not found.

    Returns
    -------
    WingTwist
        Twist of each station.

    Raises
    ------
    CalibrationError
        If a target is missing or its image has not the size that radius and Y give it, a station
        is not in front of the camera, or the reference is no station.
    SetupError
        If the camera has no place in the tunnel.

    Notes
    -----
    A. W. Burner and T. Liu, "Videogrammetric model deformation measurement technique", J.
    Aircraft 38(4), 2001, doi:10.2514/2.2826. With eight pictures or more the rotation picture by
    picture tells the weights of the mean, so that a vibration does not leak into it, and what
    motion leaves is part of the uncertainty. The uncertainty is that of centroids and motion;
    camera, pose and Y are not in it. Without flow and with it they are the same, so that they
    scale the twist but give it no zero: a Y that is wrong by a hundredth of its distance does
    not change the angle for a camera that looks squarely at the plane.
    """
    _check(targets, no_flow, flow, setup, reference, allow_missing)
    solved = [
        _solved(targets, targets.at(name), no_flow, flow, setup, free_scale)
        for name in targets.stations
    ]
    sign = setup.glint.nose_sign
    base = solved[targets.stations.index(reference)] if reference is not None else None
    clipped = no_flow.clipped | flow.clipped
    return WingTwist(
        name=flow.name,
        reference=reference,
        stations=tuple(
            _station(name, targets, one, base, sign)
            for name, one in zip(targets.stations, solved, strict=True)
        ),
        targets=tuple(each for one in solved for each in one.motions(targets)),
        clipped=tuple(np.array(targets.ids)[clipped].tolist()),
    )


def _check(
    targets: WingTargets,
    no_flow: Sightings,
    flow: Sightings,
    setup: Setup,
    reference: str | None,
    allow_missing: bool,
) -> None:
    if not setup.camera.is_oriented:
        raise SetupError(
            "camera.position is missing in the setup; twist is measured in planes of known Y, so "
            "give focal_length, pixel_pitch, position and rotation in [camera]"
        )
    if reference is not None:
        targets.at(reference)
    for state in (no_flow, flow):
        if state.ids != targets.ids:
            raise CalibrationError(
                f"{state.name} was measured for {len(state.ids)} other targets than these "
                f"{len(targets)}; measure both states with one table of targets"
            )
        if state.missing and not allow_missing:
            raise CalibrationError(
                f"{state.name}: {', '.join(state.missing)} not found; see that every target is in "
                "view and lit, take it out of the table, or allow missing targets"
            )


@dataclass(frozen=True, eq=False)
class _State:
    """A station's targets in one state: where they are seen, and where they are."""

    uv: Floats
    xz: Floats
    covariance: Floats  # of xz
    motion_std: float = 0.0  # of the mean rotation [rad], noise not counted
    motion_u95: float = 0.0  # half its 95 % interval [rad]


@dataclass(frozen=True, eq=False)
class _Solved:
    index: NDArray[np.int64]
    missing: tuple[str, ...]
    before: _State
    after: _State
    fit: Conformal

    @property
    def motion_std(self) -> float:
        return float(np.hypot(self.before.motion_std, self.after.motion_std))

    @property
    def std(self) -> float:
        return float(np.hypot(self.fit.rotation_std, self.motion_std))

    @property
    def u95(self) -> float:
        motion = self.before.motion_u95, self.after.motion_u95
        return float(np.linalg.norm([self.fit.rotation_u95, *motion]))

    def motions(self, targets: WingTargets) -> list[TargetMotion]:
        """Return the targets in both states."""
        return [
            TargetMotion(
                id=targets.ids[number],
                station=targets.station[number],
                no_flow_uv=_pair(self.before.uv[k]),
                flow_uv=_pair(self.after.uv[k]),
                no_flow_xz_m=_pair(self.before.xz[k]),
                flow_xz_m=_pair(self.after.xz[k]),
                residual_xz_m=_pair(self.fit.residuals[k]),
                used=bool(self.fit.used[k]),
            )
            for k, number in enumerate(self.index)
        ]


def _pair(values: Floats) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _solved(
    targets: WingTargets,
    index: NDArray[np.int64],
    no_flow: Sightings,
    flow: Sightings,
    setup: Setup,
    free_scale: bool,
) -> _Solved:
    gone = {*no_flow.missing, *flow.missing}
    lost = np.array([targets.ids[number] in gone for number in index])
    name, index = targets.station[index[0]], index[~lost]
    if index.size < 2:
        raise CalibrationError(
            f"{flow.name}: station {name} has {index.size} target found without flow and with it, "
            "too few for a rotation; light the others or leave the station out"
        )
    before, after = (_state(targets, index, each, setup) for each in (no_flow, flow))
    fit = fit_conformal(
        before.xz, after.xz, before.covariance, after.covariance, free_scale=free_scale
    )
    missing = tuple(each for each in targets.ids if each in gone and _is_at(targets, each, name))
    return _Solved(index, missing, before, after, fit)


def _is_at(targets: WingTargets, target: str, station: str) -> bool:
    return targets.station[targets.ids.index(target)] == station


def _state(
    targets: WingTargets, index: NDArray[np.int64], sightings: Sightings, setup: Setup
) -> _State:
    planes = WingPlanes(targets, index, setup)
    uv, noise = (each[index] for each in sightings.mean())
    planes.check(uv, sightings)
    perspective = planes.perspective(uv)
    xz, slope = planes.mapped(uv - perspective)
    still = _State(uv, xz, slope @ noise @ slope.transpose(0, 2, 1))
    shown = sightings.seen[:, index].all(axis=1)
    if shown.sum() < _LEAST_PICTURES:
        return still
    each = np.full((sightings.seen.shape[0], index.size, 2), np.nan)
    each[shown] = planes.places(sightings.uv[shown][:, index] - perspective)
    pixels = np.nan_to_num(sightings.covariance[:, index])
    noise = slope @ pixels @ slope.transpose(0, 2, 1)
    return _moving(uv, xz, each, noise)


def _moving(uv: Floats, xz: Floats, each: Floats, noise: Floats) -> _State:
    """Average places [picture, target, 2] that turn and move as one piece, NaN where not shown.

    A mean of places that turn would shrink them about their middle, so that each picture is
    turned back first. The noise of the mean is that of its weights.
    """
    arms = (xz - xz.mean(axis=0)) @ np.array([1, 1j])
    middle = each.mean(axis=1)
    own = (each - middle[:, None]) @ np.array([1, 1j])
    turn = np.angle(own @ arms.conj())
    mean = mean_angle(turn)
    shape = np.nanmean(own * np.exp(1j * (mean.mean - turn))[:, None], axis=0)
    centre = mean.weights @ np.nan_to_num(middle)
    # A small turn of the arms by noise: (X dZ - Z dX) / (X^2 + Z^2), summed over the targets.
    lever = np.stack([-arms.imag, arms.real], axis=-1) / (np.abs(arms) ** 2).sum()
    of_turn = np.einsum("ti,ptij,tj->p", lever, noise, lever)
    squares = mean.weights**2
    motion_std = float(np.sqrt(max(mean.std**2 - float(squares @ of_turn), 0.0)))
    return _State(
        uv=uv,
        xz=centre + np.stack([shape.real, shape.imag], axis=-1),
        covariance=np.einsum("p,ptij->tij", squares, noise),
        motion_std=motion_std,
        motion_u95=motion_std * mean.expanded() / mean.std,
    )


def _station(
    name: str, targets: WingTargets, one: _Solved, base: _Solved | None, sign: int
) -> StationTwist:
    fit = one.fit
    ids = np.array(targets.ids)[one.index]
    relative = std = u95 = None
    if base is one:
        relative = std = u95 = 0.0
    elif base is not None:
        relative = float(np.degrees(sign * (fit.rotation - base.fit.rotation)))
        std = float(np.degrees(np.hypot(one.std, base.std)))
        u95 = float(np.degrees(np.hypot(one.u95, base.u95)))
    return StationTwist(
        station=name,
        y_m=float(targets.y[targets.at(name)].mean()),
        twist_deg=float(np.degrees(sign * fit.rotation)),
        twist_std_deg=float(np.degrees(one.std)),
        twist_u95_deg=float(np.degrees(one.u95)),
        relative_deg=relative,
        relative_std_deg=std,
        relative_u95_deg=u95,
        motion_std_deg=float(np.degrees(one.motion_std)),
        shift_x_m=float(fit.shift[0]),
        shift_z_m=float(fit.shift[1]),
        scale=fit.scale,
        rms_m=fit.rms,
        reduced_chi_square=(
            fit.chi_square / fit.degrees_of_freedom if fit.degrees_of_freedom else None
        ),
        excess=fit.excess,
        used=tuple(ids[fit.used].tolist()),
        outlying=tuple(ids[~fit.used].tolist()),
        missing=one.missing,
    )
