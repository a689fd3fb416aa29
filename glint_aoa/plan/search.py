"""A map of layouts, and the best of them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import SetupError
from glint_aoa.plan.forecast import (
    LayoutForecast,
    calibration_std,
    forecast,
    noise_of_mean,
)
from glint_aoa.plan.layout import Layout
from glint_aoa.plan.light import glint_light
from glint_aoa.plan.predict import (
    Prediction,
    body_span,
    matte_radiance,
    predict,
    predict_lit,
    stations_of,
    with_zero,
)
from glint_aoa.setup import Setup

__all__ = ["LayoutMap", "TestPlan", "make_plan", "map_size"]

_Array = NDArray[np.float64]

_LENSES_MM = (8.0, 12.5, 16.0, 25.0, 35.0, 50.0, 75.0, 100.0)
_LAMP_AWAY_M = 0.6
_LAMP_UP = 0.25
_ANGLES = 5
_PARTS = 2  # of the map, each way: from each a search for the best layout starts
_Place = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class LayoutMap:
    """What many layouts would measure.

    Attributes
    ----------
    distances, focal_lengths, lamp_y, lamp_z : ndarray
        Axes of the map: camera to known plane, lenses, the lamp's place [m].
    std_deg : ndarray, shape (distance, lens, lamp_y, lamp_z)
        Largest standard uncertainty of a point's mean over the wanted angles, from noise and
        vibration alone [deg]; NaN where the glint is not measured.
    field_std_deg : ndarray, of the same shape
        Largest noise of one field [deg].
    visible : ndarray of bool, of the same shape
        Whether the whole wanted range is seen.
    exposure_ratio : ndarray, of the same shape
        Exposure that keeps the peak, over that of the present layout.
    first_line : ndarray of int, of the same shape
        Where the recorded window must begin.
    """

    distances: _Array
    focal_lengths: _Array
    lamp_y: _Array
    lamp_z: _Array
    std_deg: _Array
    field_std_deg: _Array
    visible: NDArray[np.bool_]
    exposure_ratio: _Array
    first_line: NDArray[np.int64]

    @property
    def allowed_std_deg(self) -> _Array:
        """`std_deg` where the whole wanted range is seen, elsewhere NaN."""
        return np.where(self.visible, self.std_deg, np.nan)


@dataclass(frozen=True, eq=False)
class TestPlan:
    """A test that is planned.

    Attributes
    ----------
    setup : Setup
        What it was planned for.
    present : LayoutForecast
        The layout that the setup describes.
    suggestion : LayoutForecast or None
        The least uncertain layout, calibration included, of those in the map that see the whole
        wanted range; None without a map or where none does.
    layouts : LayoutMap or None
        The map.
    """

    __test__ = False  # not a test, whatever its name

    setup: Setup
    present: LayoutForecast
    suggestion: LayoutForecast | None
    layouts: LayoutMap | None


def make_plan(
    setup: Setup,
    *,
    with_map: bool = True,
    progress: Callable[[int], None] | None = None,
) -> TestPlan:
    """Predict what a setup will measure, and look for a better one.

    Parameters
    ----------
    setup : Setup
        A setup with an oriented camera, its sensor, body and lamp.
    with_map : bool, optional
        Whether other layouts are looked at.
    progress : callable, optional
        Called with the number of layouts that were done since.

    Returns
    -------
    TestPlan
        The plan. In the map the camera keeps its direction and what it looks at, the lamp its X
        and direction, the window its height; the lens's aperture stays, and the exposure (or the
        lamp's power) keeps the glint's peak.

    Raises
    ------
    SetupError
        If the setup does not say enough, or the body mirrors no light into the camera.
    """
    layout = Layout.of_setup(setup)
    nominal = predict(setup, layout, setup.plan.angles)
    if not np.isfinite(nominal.gain):
        raise SetupError(
            "the body does not mirror the lamp to where the camera looks at zero pitch; check "
            "[glint.reflection], plan.body and plan.pivot against the camera's position"
        )
    ambient = matte_radiance(setup.plan, nominal)
    known = _with_body(setup, layout)
    present = forecast(known, layout, ambient=ambient, present_gain=nominal.gain)
    if not with_map:
        return TestPlan(setup, present, None, None)
    layouts = _Search(known, layout, ambient, nominal.gain).map(progress)
    best = _best(known, layout, layouts, ambient)
    suggestion = None
    if best is not None:
        suggestion = forecast(known, best, ambient=ambient, present_gain=nominal.gain)
    return TestPlan(setup, present, suggestion, layouts)


def _with_body(setup: Setup, layout: Layout) -> Setup:
    """State how far the body reaches: other layouts see no more of it than is known to be there."""
    plan = setup.plan.model_copy(update={"body": body_span(setup, layout)})
    return setup.model_copy(update={"plan": plan})


def map_size(setup: Setup) -> int:
    """Return how many layouts the map of a setup has."""
    return int(np.prod([axis.size for axis in _axes(setup, Layout.of_setup(setup))]))


def _axes(setup: Setup, layout: Layout) -> tuple[_Array, _Array, _Array, _Array]:
    """Return distances, lenses and the lamp's Y and Z of the map [m]."""
    plan, (y, z) = setup.plan, layout.lamp_yz
    near, far = plan.distances or (layout.distance / 2, layout.distance * 2)
    lenses = plan.focal_lengths or (*(f / 1e3 for f in _LENSES_MM), layout.focal_length)
    spans = (
        plan.lamp_y or (y - _LAMP_AWAY_M, y + _LAMP_AWAY_M),
        plan.lamp_z or (z - abs(z) * _LAMP_UP, z + abs(z) * _LAMP_UP),
    )
    distances = _axis(near, far, plan.steps[0], layout.distance)
    lamp_y, lamp_z = (
        _axis(*span, n, place) for span, n, place in zip(spans, plan.steps[1:], (y, z), strict=True)
    )
    return distances, np.unique(np.round(np.array(lenses, np.float64), 9)), lamp_y, lamp_z


def _axis(low: float, high: float, steps: int, present: float) -> _Array:
    """Return places from one end to the other; the one nearest to the present for a single one."""
    if steps == 1 or low == high:
        return np.array([np.clip(present, low, high)])
    return np.linspace(low, high, steps)


class _Search:
    """Goes over the layouts; the light on the body is found once for all lenses."""

    def __init__(self, setup: Setup, layout: Layout, ambient: float, gain: float) -> None:
        self._setup, self._layout, self._ambient, self._gain = setup, layout, ambient, gain
        self._wanted = np.linspace(*setup.plan.angles, _ANGLES)
        self._angle = with_zero(self._wanted)
        self._mean = noise_of_mean(setup)
        self._stations = stations_of(body_span(setup, layout))

    def map(self, progress: Callable[[int], None] | None) -> LayoutMap:
        axes = _axes(self._setup, self._layout)
        shape = tuple(axis.size for axis in axes)
        std, ratio = np.full(shape, np.nan), np.full(shape, np.nan)
        visible, first = np.zeros(shape, bool), np.zeros(shape, np.int64)
        distances, lenses, lamp_y, lamp_z = axes
        for d, y, z in np.ndindex(distances.size, lamp_y.size, lamp_z.size):
            layout = self._layout.moved(
                distance=float(distances[d]), lamp_y=float(lamp_y[y]), lamp_z=float(lamp_z[z])
            )
            for f, each in enumerate(self._predictions(layout, lenses)):
                places = each.at(self._wanted)
                std[d, f, y, z] = np.degrees(each.std[places].max())
                visible[d, f, y, z] = each.visible(self._setup.plan.least_columns)[places].all()
                ratio[d, f, y, z] = each.gain / self._gain
                first[d, f, y, z] = each.layout.first_line
            if progress is not None:
                progress(lenses.size)
        together = np.hypot(std * self._mean.from_noise, np.degrees(self._mean.from_vibration))
        return LayoutMap(*axes, together, std, visible, ratio, first)

    def _predictions(self, layout: Layout, lenses: _Array) -> list[Prediction]:
        light = glint_light(
            layout.reflection,
            self._setup.plan,
            eye=np.array(layout.camera.position),
            yaw=layout.yaw,
            rise=self._setup.glint.nose_sign * self._angle,
            stations=self._stations,
        )
        return [
            predict_lit(
                self._setup,
                layout.with_lens(float(lens)),
                self._angle,
                light,
                ambient=self._ambient,
                move_window=True,
            )
            for lens in lenses
        ]


def _best(setup: Setup, layout: Layout, layouts: LayoutMap, ambient: float) -> Layout | None:
    """Return the least uncertain layout, calibration included; None where none sees all."""
    total = _Total(setup, layout, layouts, ambient)
    starts = list(total.starts())
    if not starts:
        return None
    best = min(starts, key=total)
    while (better := min([best, *total.beside(best)], key=total)) != best:
        best = better
    return total.layout(best)


class _Total:
    """Uncertainty of the mean [deg] with the calibration's part, by distance and the lamp's Y, Z.

    What calibration leaves takes long to work out, so not all of the map is: the search starts from
    the least noisy layout of each part of the map and goes on to neighbours while these are better.
    Of the lenses the least noisy one counts: calibration hardly depends on it.
    """

    def __init__(self, setup: Setup, layout: Layout, layouts: LayoutMap, ambient: float) -> None:
        self._setup, self._present, self._layouts, self._ambient = setup, layout, layouts, ambient
        self._wanted = np.linspace(*setup.plan.angles, _ANGLES)
        noise = np.where(np.isfinite(layouts.allowed_std_deg), layouts.allowed_std_deg, np.inf)
        self._lens, self._noise = noise.argmin(axis=1), noise.min(axis=1)
        self._known: dict[_Place, float] = {}

    def __call__(self, place: _Place) -> float:
        if place not in self._known:
            prediction = predict(
                self._setup, self.layout(place), self._wanted, ambient=self._ambient
            )
            systematic = float(np.degrees(calibration_std(self._setup, prediction).max()))
            self._known[place] = float(np.hypot(self._noise[place], systematic))
        return self._known[place]

    def layout(self, place: _Place) -> Layout:
        """Return the layout at a place of the map."""
        layouts, (d, y, z), f = self._layouts, place, self._lens[place]
        moved = self._present.moved(
            distance=float(layouts.distances[d]),
            lamp_y=float(layouts.lamp_y[y]),
            lamp_z=float(layouts.lamp_z[z]),
        )
        moved = moved.with_lens(float(layouts.focal_lengths[f]))
        return moved.with_window(int(layouts.first_line[d, f, y, z]))

    def starts(self) -> Iterator[_Place]:
        """Give the least noisy place in each part of the map."""
        halves = [np.array_split(np.arange(n), _PARTS) for n in self._noise.shape]
        for part in product(*halves):
            inside = self._noise[np.ix_(*part)]
            if np.isfinite(inside).any():
                at = np.unravel_index(inside.argmin(), inside.shape)
                d, y, z = (int(axis[k]) for axis, k in zip(part, at, strict=True))
                yield d, y, z

    def beside(self, place: _Place) -> Iterator[_Place]:
        """Give the neighbours of a place that see the whole wanted range."""
        for axis, step in product(range(3), (-1, 1)):
            d, y, z = (k + step * (n == axis) for n, k in enumerate(place))
            inside = all(0 <= k < n for k, n in zip((d, y, z), self._noise.shape, strict=True))
            if inside and np.isfinite(self._noise[d, y, z]):
                yield d, y, z
