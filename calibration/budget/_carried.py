"""The geometry's uncertainty at measured angles, cheap enough for every field."""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.budget._chain import Chain, middle_of
from calibration.budget._inputs import GeometryCovariance, geometry_covariance
from calibration.budget._model import AngleModel, Recalibration
from calibration.sweep.fit import PitchSweep
from glint_aoa.coverage import effective_freedom
from glint_aoa.setup import Setup

__all__ = ["CarriedUncertainty", "geometry_uncertainty", "uncertain_geometry"]

Floats = NDArray[np.float64]
_Span = tuple[float, float]
"""Middle and half width."""

_NODES = np.sqrt(0.75) * np.array([-1.0, 0.0, 1.0])  # Chebyshev's, of -1 ... 1
_WIDEST = 6.0  # robust standard deviations about the median that nodes cover
_NARROWEST = 1e-4  # rad and m: half the range of what stands still


class CarriedUncertainty(NamedTuple):
    """What the geometry leaves uncertain of measured angles.

    Attributes
    ----------
    std_deg : ndarray [field]
        Standard uncertainty, 1 sigma [deg]; NaN for a field that was not measured.
    degrees_of_freedom : ndarray [field]
        Effective ones (Welch-Satterthwaite); infinite where nothing of it was estimated.
    """

    std_deg: Floats
    degrees_of_freedom: Floats


def uncertain_geometry(setup: Setup) -> GeometryCovariance | None:
    """Return what a setup says of its geometry's uncertainty; None where it says nothing.

    Parameters
    ----------
    setup : Setup
        The setup; a camera that is not oriented has no geometry.

    Raises
    ------
    CalibrationError
        If a calibration that the setup names cannot be used.
    """
    if not setup.camera.is_oriented:
        return None
    covariance = geometry_covariance(setup)
    return covariance.uncertain() if covariance.is_stated else None


def geometry_uncertainty(
    setup: Setup,
    covariance: GeometryCovariance,
    angle: Floats,
    intercept: Floats,
    *,
    u: Floats,
    std: Floats,
    sweep: PitchSweep | None = None,
    temperature_k: float | None = None,
) -> CarriedUncertainty:
    """Carry the geometry's uncertainty to measured angles, to first order.

    The sensitivities are worked out at three angles and three intercepts and interpolated
    between. A field far off the others gets the value of the nearest that is not.

    Parameters
    ----------
    setup : Setup
        The setup.
    covariance : GeometryCovariance
        From `uncertain_geometry`.
    angle, intercept : ndarray [field]
        Measured angles before a sweep is applied [rad], and the glint's Z at X = 0 [m].
    u, std : ndarray [column]
        Sensor columns that are measured [pixels], and the noise of each one's centre, up to a
        factor; infinite for a column that does not count in the line.
    sweep : PitchSweep, optional
        The sweep that is applied: what it takes out of the geometry's errors is not counted.
    temperature_k : float, optional
        Tunnel temperature at which it is applied [K].

    Returns
    -------
    CarriedUncertainty
        The standard uncertainty is NaN where `angle` is.
    """
    carried = CarriedUncertainty(np.full(angle.shape, np.nan), np.full(angle.shape, np.inf))
    known = np.isfinite(angle) & np.isfinite(intercept)
    if not known.any():
        return carried
    measured = angle[known], intercept[known]
    chain = Chain.of_setup(setup, u, std=std)
    spans, v = _placed(chain, measured)
    again = None
    if sweep is not None:
        row = float(np.median(middle_of(v)))
        again = Recalibration.of(sweep, chain, row=row, temperature_k=temperature_k)
    model = AngleModel(chain, again, v)
    share = np.einsum(
        "fa,fi->fai",
        *(_interpolation(each, *span) for each, span in zip(measured, spans, strict=True)),
    ).reshape(-1, len(v))
    variances = []
    for block in covariance.blocks:
        c = share @ model.sensitivities(block).calibrated_deg.T
        variances.append(np.maximum(np.einsum("fi,ij,fj->f", c, block.covariance, c), 0.0))
    freedoms = [block.degrees_of_freedom for block in covariance.blocks]
    carried.std_deg[known] = np.sqrt(np.sum(variances, axis=0))
    carried.degrees_of_freedom[known] = effective_freedom(variances, freedoms)
    return carried


def _placed(chain: Chain, measured: tuple[Floats, Floats]) -> tuple[list[_Span], Floats]:
    """Return the spans of the nodes, and the nodes' lines in pixels.

    Spans that reach to lines out of the camera's sight shrink towards the usual line.
    """
    spans = [_span(each) for each in measured]
    v = chain.pixels(*_nodes(*spans))
    while not np.isfinite(v).all() and max(half for _, half in spans) > _NARROWEST:
        usual = (float(np.median(each)) for each in measured)
        spans = [
            (middle, max(half / 4, _NARROWEST))
            for middle, (_, half) in zip(usual, spans, strict=True)
        ]
        v = chain.pixels(*_nodes(*spans))
    return spans, chain.check_seen(v)


def _nodes(angle: _Span, intercept: _Span) -> Floats:
    """Return all pairs of nodes [2, node] over two spans, the intercept's running faster."""
    each = [middle + half * _NODES for middle, half in (angle, intercept)]
    return np.array(list(product(*each))).T


def _span(values: Floats) -> _Span:
    """Return middle and half width of the range that most values lie in."""
    middle = np.median(values)
    reach = _WIDEST * 1.4826 * np.median(np.abs(values - middle))
    low, high = np.clip([values.min(), values.max()], middle - reach, middle + reach)
    return float((low + high) / 2), max(float(high - low) / 2, _NARROWEST)


def _interpolation(values: Floats, middle: float, half: float) -> Floats:
    """Return what each node counts [value, node] in a parabola through the nodes."""
    place = np.clip((values - middle) / half, -1.0, 1.0)
    powers = np.vander(place, _NODES.size, increasing=True)
    return powers @ np.linalg.inv(np.vander(_NODES, increasing=True))
