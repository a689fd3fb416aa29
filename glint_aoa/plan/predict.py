"""What a layout will show and how well: the glint's place, width and light, and the angle's noise.

From the law of reflection and the pixels' noise alone; nothing is rendered.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.geometry.camera import rotation_matrix
from glint_aoa.optical.bound import pixel_variance, slope_std_bound
from glint_aoa.plan.layout import Layout
from glint_aoa.plan.light import GlintLight, glint_light
from glint_aoa.plan.noise import LineProfile, smear_rms
from glint_aoa.setup import Plan, Setup

__all__ = [
    "Prediction",
    "body_span",
    "matte_radiance",
    "predict",
    "predict_lit",
    "stations_of",
    "with_zero",
]

_Array = NDArray[np.float64]
_Bools = NDArray[np.bool_]

_STATIONS = 33
_HALF_WIDTH = (2.77, 0.55)  # of the measurement's own window [standard deviations; lines]
_LEAST_HALF_WIDTH = 2.5  # lines
_CORE = 0.6  # share of that which must lie within the recorded window
_FULL_TURN = np.sqrt(2 * np.pi)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a layout shows at several angles.

    Attributes
    ----------
    layout : Layout
        The layout.
    angle : ndarray, shape (angle,)
        Pitch of the body [rad], rising; zero is always among them.
    glint_angle : ndarray, shape (angle,)
        Angle that the glint shows on the known plane [rad].
    std : ndarray, shape (angle,)
        Least noise of the angle from one field, 1 sigma [rad]; NaN where two columns do not see
        the glint.
    row, sigma, peak : ndarray, shape (angle, column)
        Sensor line of the glint, its standard deviation [lines], and the grey level of its middle,
        black included; NaN where there is no body.
    on_body, in_window, lit, sharp : ndarray of bool, shape (angle, column)
        Whether the column sees the body; the glint wholly in the recorded window, bright enough
        to be found, and in focus.
    intercept, glint_y : ndarray, shape (angle,)
        The glint's Z at X = 0, and Y in the middle of the columns, where it lies on the body [m].
    gain : float
        Grey levels for a unit of radiance: what the exposure must be, in proportion.
    """

    layout: Layout
    angle: _Array
    glint_angle: _Array
    std: _Array
    row: _Array
    sigma: _Array
    peak: _Array
    on_body: _Bools
    in_window: _Bools
    lit: _Bools
    sharp: _Bools
    intercept: _Array
    glint_y: _Array
    gain: float

    @property
    def sees(self) -> _Bools:
        """Whether the column measures the glint [angle, column]."""
        return self.on_body & self.in_window & self.lit & self.sharp

    def visible(self, least_columns: float) -> _Bools:
        """Return at which angles [angle] enough of the columns on the body measure the glint."""
        seen, there = self.sees.sum(axis=1), self.on_body.sum(axis=1)
        return np.asarray((seen >= least_columns * there) & (seen > 1))

    def at(self, angle: ArrayLike) -> NDArray[np.intp]:
        """Return the places of angles [rad] among those that were predicted."""
        wanted = np.atleast_1d(np.asarray(angle, np.float64))
        return np.asarray(np.abs(self.angle - wanted[:, None]).argmin(axis=1))


def predict(
    setup: Setup, layout: Layout, angle: ArrayLike, *, ambient: float | None = None
) -> Prediction:
    """Predict what a layout shows.

    Parameters
    ----------
    setup : Setup
        Says what to expect in its section ``[plan]``.
    layout : Layout
        Where camera and lamp stand.
    angle : array_like, shape (angle,)
        Pitch [rad], nose up positive.
    ambient : float, optional
        Radiance of the body beside the glint, as `matte_radiance` of the present layout gives it;
        such that it is `Plan.background` in this layout if not given.

    Returns
    -------
    Prediction
        With zero pitch, for which the exposure is set, among the angles.
    """
    angle = with_zero(angle)
    light = glint_light(
        layout.reflection,
        setup.plan,
        eye=np.array(layout.camera.position),
        yaw=layout.yaw,
        rise=setup.glint.nose_sign * angle,
        stations=stations_of(body_span(setup, layout)),
    )
    return predict_lit(setup, layout, angle, light, ambient=ambient)


def predict_lit(
    setup: Setup,
    layout: Layout,
    angle: _Array,
    light: GlintLight,
    *,
    ambient: float | None = None,
    move_window: bool = False,
) -> Prediction:
    """Predict as `predict` does, from light that is known; it is the same for every lens.

    Parameters
    ----------
    setup, layout, ambient
        As for `predict`.
    angle : ndarray, shape (angle,)
        The light's attitudes as pitch [rad], rising, zero among them.
    light : GlintLight
        The glint on the body.
    move_window : bool, optional
        Whether the recorded window is moved to where the glint is.
    """
    plan = setup.plan
    seen = _Seen.of(layout, light, plan)
    if move_window and np.isfinite(seen.row).any():
        layout = layout.with_window_about((np.nanmin(seen.row) + np.nanmax(seen.row)) / 2)
    gain, background = _exposure(plan, seen, int(np.abs(angle).argmin()), ambient)
    profile = LineProfile(seen.sigma, gain * seen.flux, background)
    electrons = setup.glint.electrons_per_grey or plan.full_well / (
        plan.top_level - plan.black_level
    )
    read_noise = plan.read_noise if setup.glint.read_noise is None else setup.glint.read_noise
    dark = pixel_variance(background, read_noise=read_noise, electrons_per_grey=electrons)
    on_body = np.isfinite(seen.row)
    clear = _clear(seen.sigma, setup.glint.half_width)
    top, bottom = layout.first_line - 0.5, layout.first_line + layout.lines - 0.5
    with np.errstate(invalid="ignore"):
        in_window = (seen.row - clear >= top) & (seen.row + clear <= bottom)
        lit = profile.peak - background >= setup.glint.min_contrast * np.sqrt(dark)
        sharp = seen.disc <= (plan.circle or _pitch(layout)[0])
    line = _Line.of(layout, seen.row)
    smeared = np.hypot(seen.sigma, line.smear(setup))
    rows = [seen.row] if setup.fields.interlaced is False else [seen.row, seen.row + 0.5]
    blurred = LineProfile(smeared, profile.flux, background)
    information = np.mean(
        [blurred.information(r, read_noise=read_noise, electrons=electrons) for r in rows], axis=0
    )
    counts = on_body & in_window & lit & sharp
    glint_angle = setup.glint.nose_sign * np.arctan(line.slope)
    to_axis = np.abs(np.gradient(angle) / np.gradient(glint_angle))
    return Prediction(
        layout=layout,
        angle=angle,
        glint_angle=glint_angle,
        std=to_axis * line.std(np.where(counts, information, 0.0)),
        row=seen.row,
        sigma=smeared,
        peak=plan.black_level + profile.peak,
        on_body=on_body,
        in_window=in_window,
        lit=lit,
        sharp=sharp,
        intercept=_crossing(light.points, layout.yaw)[:, 2],
        glint_y=light.points[:, light.points.shape[1] // 2, 1],
        gain=gain,
    )


def matte_radiance(plan: Plan, prediction: Prediction) -> float:
    """Return the radiance that is `Plan.background` grey levels in a predicted layout."""
    return plan.background / prediction.gain


def body_span(setup: Setup, layout: Layout) -> tuple[float, float]:
    """Return where the body's tube begins and ends along the heading, from X = 0 [m].

    What is not stated is what the layout's camera sees of the known plane.
    """
    if setup.plan.body is not None:
        return setup.plan.body
    assert layout.camera.sensor is not None
    columns, lines = layout.camera.sensor
    along, _ = layout.plane([-0.5, columns - 0.5], [(lines - 1) / 2] * 2)
    return float(along.min()), float(along.max())


def stations_of(span: tuple[float, float]) -> _Array:
    """Return stations that span a body [m]."""
    return np.linspace(*span, _STATIONS)


def with_zero(angle: ArrayLike) -> _Array:
    """Return the angles [rad], rising, each once and zero among them; two at least."""
    given = np.round(np.atleast_1d(np.asarray(angle, np.float64)), 12)
    whole = np.unique(np.append(given, 0.0))
    return whole if whole.size > 1 else np.array([0.0, np.radians(1.0)])


def _clear(sigma: _Array, half_width: float | None) -> _Array:
    """Return how much of a glint must lie in the window on either side to be measured [lines]."""
    if half_width is not None:
        return np.full_like(sigma, _CORE * half_width)
    in_pixels = np.sqrt(sigma**2 + 1 / 12)
    slope, least = _HALF_WIDTH
    return np.asarray(_CORE * np.maximum(slope * in_pixels + least, _LEAST_HALF_WIDTH))


def _pitch(layout: Layout) -> tuple[float, float]:
    assert layout.camera.pixel_pitch is not None
    return layout.camera.pixel_pitch


@dataclass(frozen=True, eq=False)
class _Seen:
    """The glint as the columns see it, every array [angle, column]."""

    row: _Array
    sigma: _Array
    flux: _Array  # for a gain of one
    disc: _Array  # across a point out of focus, on the sensor [m]

    @classmethod
    def of(cls, layout: Layout, light: GlintLight, plan: Plan) -> "_Seen":
        plane, pitch = layout.plane, _pitch(layout)
        u, v = plane.project(light.points)
        du, dv = (
            more - here
            for more, here in zip(plane.project(light.points + light.spread), (u, v), strict=True)
        )
        slope = np.gradient(v, axis=1) / np.gradient(u, axis=1)
        width = np.abs(dv - slope * du)
        axis = rotation_matrix(*layout.camera.rotation)[:, 1]
        depth = (light.points - np.array(layout.camera.position)) @ axis
        disc = _disc(layout, plan, depth)
        sigma = np.sqrt(width**2 + plan.blur**2 + (disc / 4 / pitch[1]) ** 2)
        flux = light.radiance * width * light.rough_share * _FULL_TURN
        along = _at_columns(layout.columns, u, (v, sigma, flux, disc))
        return cls(*along)


def _disc(layout: Layout, plan: Plan, depth: _Array) -> _Array:
    """Return the disc of a point at a depth [m] while the aim is in focus (thin lens)."""
    if plan.f_number is None:
        return np.zeros_like(depth)
    focus, length = layout.distance, layout.focal_length
    return length**2 / plan.f_number * np.abs(depth - focus) / (depth * (focus - length))


def _at_columns(columns: _Array, u: _Array, values: tuple[_Array, ...]) -> list[_Array]:
    """Interpolate values [angle, station] to columns; NaN beyond the stations."""
    found = [np.full((len(u), columns.size), np.nan) for _ in values]
    for k, across in enumerate(u):
        order = np.argsort(across)
        for each, value in zip(found, values, strict=True):
            each[k] = np.interp(columns, across[order], value[k, order], left=np.nan, right=np.nan)
    return found


def _crossing(points: _Array, yaw: float) -> _Array:
    """Return the points [angle, 3] of lines of points [angle, station, 3] at X = 0."""
    along = points[..., 0] * np.cos(yaw) + points[..., 1] * np.sin(yaw)
    nearest = np.abs(along).argmin(axis=1)
    first = np.clip(nearest - (np.take_along_axis(along, nearest[:, None], 1)[:, 0] > 0), 0, None)
    first = np.minimum(first, along.shape[1] - 2)
    each = np.arange(len(points))
    low, high = points[each, first], points[each, first + 1]
    share = -low[:, 0] / (high[:, 0] - low[:, 0])
    return np.asarray(low + share[:, None] * (high - low))


def _exposure(plan: Plan, seen: _Seen, zero: int, ambient: float | None) -> tuple[float, float]:
    """Return the gain that takes the brightest pixel at zero pitch to its level, and background."""
    unit = LineProfile(seen.sigma[zero], seen.flux[zero], 0.0).peak
    brightest = float(np.nanmax(unit, initial=0.0))
    over_black = plan.peak_level - plan.black_level
    if brightest <= 0:
        return np.nan, plan.background
    if ambient is None:
        return (over_black - plan.background) / brightest, plan.background
    gain = over_black / (brightest + ambient)
    return gain, gain * ambient


@dataclass(frozen=True, eq=False)
class _Line:
    """The straight line through the glint on the known plane; arrays [angle, column]."""

    along: _Array
    slope: _Array  # [angle]
    per_row: _Array  # of the height over the line [m / line]

    @classmethod
    def of(cls, layout: Layout, row: _Array) -> "_Line":
        plane, columns = layout.plane, np.broadcast_to(layout.columns, row.shape)
        (s, z), (s_more, z_more) = plane(columns, row - 0.5), plane(columns, row + 0.5)
        along, height = (s + s_more) / 2, (z + z_more) / 2
        known = np.isfinite(along) & np.isfinite(height)
        count = np.maximum(known.sum(axis=1), 1)[:, None]
        ds, dz = (
            np.where(known, each - np.where(known, each, 0).sum(axis=1, keepdims=True) / count, 0)
            for each in (along, height)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = (ds * dz).sum(axis=1) / (ds**2).sum(axis=1)
        return cls(along, slope, (z_more - z) - slope[:, None] * (s_more - s))

    def smear(self, setup: Setup) -> _Array:
        """Return how far vibration within the exposure spreads the glint, rms [lines]."""
        vibration, exposure = setup.plan.vibration, setup.fields.exposure
        if vibration is None or exposure is None:
            return np.zeros_like(self.along)
        arm = np.abs(self.along - vibration.centre) * (1 + self.slope[:, None] ** 2)
        return np.asarray(smear_rms(vibration, exposure) * arm / np.abs(self.per_row))

    def std(self, information: _Array) -> _Array:
        """Return the least noise of the angle [rad], as [angle], for J per line^2."""
        found = np.full(len(information), np.nan)
        for k, each in enumerate(information):
            used = each > 0
            if used.sum() > 1:
                of_height = each[used] / self.per_row[k, used] ** 2
                found[k] = slope_std_bound(of_height, self.along[k, used])
        return found / (1 + self.slope**2)
