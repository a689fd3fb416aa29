"""What a layout will measure: the mean angle's uncertainty, part by part, and how far it sees."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.budget.uncertainty import geometry_uncertainty, uncertain_geometry
from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import SetupError
from glint_aoa.plan.layout import Layout
from glint_aoa.plan.noise import MeanNoise, mean_noise
from glint_aoa.plan.predict import Prediction, predict
from glint_aoa.setup import Setup

__all__ = [
    "AngleForecast",
    "LayoutForecast",
    "VisibleRange",
    "calibration_std",
    "forecast",
    "noise_of_mean",
]

_Array = NDArray[np.float64]

_FURTHEST_DEG = 20.0
_STEP_DEG = 0.05
_ANGLES = 5  # of the wanted range that are told


@dataclass(frozen=True)
class AngleForecast:
    """What is expected at one pitch.

    Attributes
    ----------
    angle_deg, glint_angle_deg : float
        Pitch of the body, and angle that its glint shows on the known plane [deg].
    row_left, row_middle, row_right : float
        Sensor lines of the glint in the first, the middle and the last column that see the body.
    sigma_lines : float
        Standard deviation of the glint across the lines, in the middle [lines].
    columns, columns_on_body : int
        Columns that measure the glint, and that see the body.
    field_std_deg : float
        Least noise of one field (Cramer-Rao), vibration within the exposure included [deg].
    noise_std_deg, vibration_std_deg, calibration_std_deg : float
        Parts of the mean's standard uncertainty: noise of the fields, what vibration leaves, and
        the geometry or the pitch sweep [deg].
    mean_std_deg, mean_u95_deg : float
        Standard uncertainty of the mean, and half its 95 % interval [deg].
    """

    angle_deg: float
    glint_angle_deg: float
    row_left: float
    row_middle: float
    row_right: float
    sigma_lines: float
    columns: int
    columns_on_body: int
    field_std_deg: float
    noise_std_deg: float
    vibration_std_deg: float
    calibration_std_deg: float
    mean_std_deg: float
    mean_u95_deg: float


@dataclass(frozen=True)
class VisibleRange:
    """From what pitch to what pitch the glint is seen.

    Attributes
    ----------
    low_deg, high_deg : float
        The range [deg]; not a number where nothing is seen.
    low_limit, high_limit : str
        What ends it: ``"window"``, ``"light"``, ``"focus"``, or ``""`` where nothing does within
        20 deg.
    """

    low_deg: float
    high_deg: float
    low_limit: str
    high_limit: str

    def holds(self, low_deg: float, high_deg: float) -> bool:
        """Whether all of a range is seen; a step of the search may be missing at either end."""
        return self.low_deg <= low_deg + _STEP_DEG and self.high_deg >= high_deg - _STEP_DEG


@dataclass(frozen=True, eq=False)
class LayoutForecast:
    """What is expected of one layout.

    Attributes
    ----------
    layout : Layout
        The layout.
    angles : tuple of AngleForecast
        Over the wanted range.
    visible : VisibleRange
        Angles at which the glint is seen.
    glint_y_m : float
        Y of the glint in the middle at zero pitch: what ``glint.y`` should be [m].
    exposure_ratio : float
        Exposure (or power of the lamp) that keeps the peak, over that of the present layout.
    prediction : Prediction
        What lies behind.
    """

    layout: Layout
    angles: tuple[AngleForecast, ...]
    visible: VisibleRange
    glint_y_m: float
    exposure_ratio: float
    prediction: Prediction

    @property
    def worst_std_deg(self) -> float:
        """Largest standard uncertainty of the mean in the wanted range [deg]; NaN if one is."""
        return float(np.max([each.mean_std_deg for each in self.angles]))


def noise_of_mean(setup: Setup) -> MeanNoise:
    """Return what becomes of the fields' noise and of vibration in the mean of a point.

    Raises
    ------
    SetupError
        If vibration is expected and the setup does not say how fields are taken.
    """
    plan, fields = setup.plan, setup.fields
    for name in ("rate", "exposure"):
        if plan.vibration is not None and getattr(fields, name) is None:
            raise SetupError(
                f"fields.{name} is missing, and plan.vibration needs it; give it in [fields]"
            )
    return mean_noise(
        plan.fields,
        rate_hz=fields.rate or 1.0,
        exposure_s=fields.exposure or 0.0,
        vibration=plan.vibration,
        fitted=setup.glint.mean != "plain",
    )


def calibration_std(setup: Setup, prediction: Prediction) -> _Array:
    """Return what calibration leaves uncertain [angle], 1 sigma [rad].

    What `Plan.sweep_std` says of a planned sweep, or else what ``[uncertainty]`` and the
    calibrations of camera and pose leave, to first order.
    """
    if setup.plan.sweep_std is not None:
        return np.full(prediction.angle.shape, setup.plan.sweep_std)
    layout = prediction.layout
    known = np.isfinite(prediction.row).all(axis=0)
    covariance = uncertain_geometry(setup)
    if covariance is None or known.sum() < 2:
        return np.zeros(prediction.angle.shape)
    glint = setup.glint.model_copy(update={"reflection": layout.reflection})
    moved = setup.model_copy(update={"camera": layout.camera, "glint": glint})
    columns = layout.columns[known]
    carried = geometry_uncertainty(
        moved,
        covariance,
        prediction.angle,
        prediction.intercept,
        u=columns,
        std=np.ones(columns.size),
    )
    return np.radians(carried.std_deg)


def forecast(
    setup: Setup, layout: Layout, *, ambient: float, present_gain: float
) -> LayoutForecast:
    """Say what a layout will measure.

    Parameters
    ----------
    setup : Setup
        The setup, with its section ``[plan]``.
    layout : Layout
        The layout.
    ambient, present_gain : float
        Radiance beside the glint, and gain, of the present layout; see `predict`.

    Returns
    -------
    LayoutForecast
        NaN where fewer than two columns measure the glint.

    Raises
    ------
    SetupError, CalibrationError
        As `noise_of_mean` and `uncertain_geometry`.
    """
    wanted = np.linspace(*setup.plan.angles, _ANGLES)
    prediction = predict(setup, layout, wanted, ambient=ambient)
    mean, systematic = noise_of_mean(setup), calibration_std(setup, prediction)
    zero = int(prediction.at(0.0)[0])
    return LayoutForecast(
        layout=layout,
        angles=tuple(
            _angle_forecast(prediction, int(k), mean, float(systematic[k]))
            for k in prediction.at(wanted)
        ),
        visible=_visible_range(setup, layout, ambient),
        glint_y_m=float(prediction.glint_y[zero]),
        exposure_ratio=prediction.gain / present_gain,
        prediction=prediction,
    )


def _angle_forecast(
    prediction: Prediction, k: int, mean: MeanNoise, systematic: float
) -> AngleForecast:
    there = np.flatnonzero(prediction.on_body[k])
    ends = [there[0], there[there.size // 2], there[-1]] if there.size else []
    rows = [float(prediction.row[k, each]) for each in ends] or [np.nan] * 3
    noise = float(prediction.std[k]) * mean.from_noise
    together = float(np.sqrt(noise**2 + mean.from_vibration**2 + systematic**2))
    return AngleForecast(
        angle_deg=float(np.degrees(prediction.angle[k])),
        glint_angle_deg=float(np.degrees(prediction.glint_angle[k])),
        row_left=rows[0],
        row_middle=rows[1],
        row_right=rows[2],
        sigma_lines=float(prediction.sigma[k, ends[1]]) if ends else np.nan,
        columns=int(prediction.sees[k].sum()),
        columns_on_body=there.size,
        field_std_deg=float(np.degrees(prediction.std[k])),
        noise_std_deg=float(np.degrees(noise)),
        vibration_std_deg=float(np.degrees(mean.from_vibration)),
        calibration_std_deg=float(np.degrees(systematic)),
        mean_std_deg=float(np.degrees(together)),
        mean_u95_deg=coverage_factor() * float(np.degrees(together)),
    )


def _visible_range(setup: Setup, layout: Layout, ambient: float) -> VisibleRange:
    """Follow the glint from the middle of the wanted range to where it is lost."""
    scan = np.radians(np.arange(-_FURTHEST_DEG, _FURTHEST_DEG + _STEP_DEG / 2, _STEP_DEG))
    prediction = predict(setup, layout, scan, ambient=ambient)
    seen = prediction.visible(setup.plan.least_columns)
    if not seen.any():
        reason = _limit(prediction, int(prediction.at(np.mean(setup.plan.angles))[0]))
        return VisibleRange(np.nan, np.nan, reason, reason)
    places = np.flatnonzero(seen)
    middle = int(prediction.at(np.mean(setup.plan.angles))[0])
    start = int(places[np.abs(places - middle).argmin()])
    low, high = start, start
    while low > 0 and seen[low - 1]:
        low -= 1
    while high < seen.size - 1 and seen[high + 1]:
        high += 1
    return VisibleRange(
        float(np.degrees(prediction.angle[low])),
        float(np.degrees(prediction.angle[high])),
        _limit(prediction, low - 1) if low > 0 else "",
        _limit(prediction, high + 1) if high < seen.size - 1 else "",
    )


def _limit(prediction: Prediction, k: int) -> str:
    """Name what hides the glint in most columns at an angle."""
    hidden = {
        "window": ~prediction.in_window[k],
        "light": ~prediction.lit[k],
        "focus": ~prediction.sharp[k],
    }
    there = prediction.on_body[k]
    counts = {name: int((each & there).sum()) for name, each in hidden.items()}
    return max(counts, key=lambda name: counts[name])
