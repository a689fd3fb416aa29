r"""How wide and how bright the glint of a rough cylinder is, from the law of reflection.

The surface is made of small mirrors whose slopes s are normally distributed, with a density
:math:`\propto \exp(-s^2 / m^2)` (Beckmann). Across the glint the slope that mirrors the lamp into
the camera grows in proportion to the turn round the body, so that the glint is a normal curve;
along it the light is the sum over the lamp.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glint_aoa.geometry.specular import Cylinder, glint_points
from glint_aoa.setup import Plan, Reflection

__all__ = ["GlintLight", "glint_light"]

_Array = NDArray[np.float64]

_LAMP_POINTS = 33
_LOBES = 8.0  # of the lamp on either side of the place that is mirrored: beyond, no light comes


@dataclass(frozen=True, eq=False)
class GlintLight:
    """The glint on bodies of several attitudes, at stations along them.

    Attributes
    ----------
    points : ndarray, shape (attitude, station, 3)
        Where it lies, tunnel X, Y, Z [m]; NaN where the body mirrors nothing.
    spread : ndarray, shape (attitude, station, 3)
        One standard deviation of its light across it, along the surface [m].
    rough_share : ndarray, shape (attitude, station)
        Share of that which the roughness alone makes; the rest is the lamp's width.
    radiance : ndarray, shape (attitude, station)
        Of its middle, under a lamp of no width and the present power [arbitrary unit].
    """

    points: _Array
    spread: _Array
    rough_share: _Array
    radiance: _Array


def glint_light(
    reflection: Reflection,
    plan: Plan,
    *,
    eye: ArrayLike,
    yaw: float,
    rise: ArrayLike,
    stations: ArrayLike,
) -> GlintLight:
    r"""Find where the glint lies, how wide and how bright it is.

    With :math:`\xi = t h / (n h)` the slope of the half-vector round the body, t the tangent
    and n the normal, a turn :math:`\varphi` changes it by
    :math:`\xi' = t (\hat v' + \hat l') / (n (\hat v + \hat l)) - 1`, and the glint's standard
    deviation round the body is :math:`m / \sqrt 2 / |\xi'|`. A lamp of width w adds w over
    :math:`\sqrt{12}`, as it shows in :math:`\xi`, by squares. The radiance is Beckmann's
    distribution over :math:`4 (v h)^2`, summed over the lamp, which is matte and turned to the
    body (P. Beckmann and A. Spizzichino, "The Scattering of Electromagnetic Waves from Rough
    Surfaces", 1963; C. Kelemen and L. Szirmay-Kalos, Eurographics 2001).

    Parameters
    ----------
    reflection : Reflection
        Body and lamp.
    plan : Plan
        Roughness, size of the lamp, and the point that the support keeps.
    eye : array_like, shape (3,)
        Perspective centre of the camera [m].
    yaw : float
        Heading of the body [rad].
    rise : array_like, shape (attitude,)
        Elevation of the axis along the heading [rad].
    stations : array_like, shape (station,)
        Distances along the heading from X = 0 [m].

    Returns
    -------
    GlintLight
        Its width holds for a smooth change of slope: a flat or a sharp edge is not a cylinder.
    """
    rise, stations = np.asarray(rise, np.float64), np.asarray(stations, np.float64)
    eye = np.asarray(eye, np.float64)
    heading = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    body = Cylinder.of_attitude(
        rise,
        plan.pivot[1] - plan.pivot[0] * np.tan(rise),
        yaw=yaw,
        axis_y=reflection.axis_y,
        radius=reflection.radius,
    )
    planes = np.broadcast_to(heading, (stations.size, 3))
    offset = stations + reflection.axis_y * heading[1]
    points = glint_points(body, planes, offset, eye=eye, lamp=reflection)
    mirror = _Mirror(body, points, heading, eye, reflection)
    per_slope, lamp_slope = mirror.widths(plan.lamp_width)
    rough = plan.roughness / np.sqrt(2.0)
    slope = np.hypot(rough, lamp_slope)
    return GlintLight(
        points=points,
        spread=per_slope * slope[..., None],
        rough_share=rough / slope,
        radiance=mirror.radiance(plan),
    )


class _Mirror:
    """Normals and directions at the points where the body mirrors the lamp."""

    def __init__(
        self, body: Cylinder, points: _Array, heading: _Array, eye: _Array, lamp: Reflection
    ) -> None:
        self._points, self._heading, self._radius = points, heading, body.radius
        self._axis = body.axis[:, None, :]
        away = points - body.origin[:, None, :]
        away = away - _dot(away, self._axis)[..., None] * self._axis
        self._normal = away / body.radius
        self._tangent = np.cross(self._normal, self._axis)
        self._view, self._view_distance = _unit(eye - points)
        self._lamp = np.array(lamp.lamp)
        self._along = np.array(lamp.lamp_direction) / np.linalg.norm(lamp.lamp_direction)
        self._long = lamp.lamp_shape == "long"
        self._place = self._mirrored_place()

    def _mirrored_place(self) -> _Array:
        """Place along the lamp's line [m] that the mirrored line of sight passes closest to."""
        facing = _dot(self._normal, self._view)[..., None]
        ray = 2 * facing * self._normal - self._view
        to_lamp = self._lamp - self._points
        share = ray @ self._along
        place = (share * _dot(ray, to_lamp) - to_lamp @ self._along) / (1 - share**2)
        return np.asarray(place)

    def _source(self) -> _Array:
        place = self._place[..., None] if self._long else 0.0
        source: _Array = self._lamp + place * self._along
        return source

    def widths(self, lamp_width: float) -> tuple[_Array, _Array]:
        """Return how the point moves with the slope [m], and the slope that the lamp's width is."""
        light, light_distance = _unit(self._source() - self._points)
        slip = self._radius * (self._tangent @ self._heading) / (self._axis @ self._heading)
        motion = self._radius * self._tangent - slip[..., None] * self._axis
        turned = -_across(motion, self._view) / self._view_distance
        turned = turned - _across(motion, light) / light_distance
        facing = _dot(self._normal, self._view + light)
        per_turn = np.abs(_dot(self._tangent, turned) / facing - 1)
        seen = np.linalg.norm(_across(self._tangent, light), axis=-1)
        lamp_slope = lamp_width * seen / (light_distance[..., 0] * facing) / np.sqrt(12.0)
        return motion / per_turn[..., None], lamp_slope

    def radiance(self, plan: Plan) -> _Array:
        """Sum the light that the lamp's points send to the camera [attitude, station]."""
        half = np.inf if plan.lamp_length is None else plan.lamp_length / 2
        if not self._long:
            half = (plan.lamp_length or plan.lamp_width) / 2
        _, distance = _unit(self._source() - self._points)
        reach = _LOBES * plan.roughness * distance[..., 0]
        low = np.clip(self._place - reach, -half, half)
        high = np.clip(self._place + reach, -half, half)
        nodes, weights = np.polynomial.legendre.leggauss(_LAMP_POINTS)
        place = (low + high)[..., None] / 2 + (high - low)[..., None] / 2 * nodes
        to_lamp = self._lamp - self._points
        to_lamp = to_lamp[..., None, :] + place[..., None] * self._along
        light, distances = _unit(to_lamp)
        length = distances[..., 0]
        leaving = np.sqrt(np.maximum(1 - (light @ self._along) ** 2, 0.0))
        arriving = np.maximum(_dot(light, self._normal[..., None, :]), 0.0)
        size2 = 2 + 2 * _dot(light, self._view[..., None, :])
        cosine2 = (arriving + _dot(self._normal, self._view)[..., None]) ** 2 / size2
        m2 = plan.roughness**2
        lobe = np.exp((1 - 1 / cosine2) / m2) / cosine2**2
        total = (weights * leaving * arriving * lobe / size2 / length**2).sum(axis=-1)
        return np.asarray(total * (high - low) / 2)


def _dot(a: _Array, b: _Array) -> _Array:
    product: _Array = np.einsum("...i,...i->...", a, b)
    return product


def _unit(vector: _Array) -> tuple[_Array, _Array]:
    length = np.sqrt(_dot(vector, vector))[..., None]
    return vector / length, length


def _across(vector: _Array, unit: _Array) -> _Array:
    """Part of a vector across a unit vector."""
    return vector - _dot(vector, unit)[..., None] * unit
