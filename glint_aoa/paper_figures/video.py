"""Figures 31 to 36: angle and intercept of field after field."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glint_aoa.flags import REJECTING
from glint_aoa.paper_figures.figure_data import Curve, Fact, FigureData, Panel
from glint_aoa.paper_figures.points import CampaignPoint
from glint_aoa.paper_figures.table import FigureSpec
from glint_aoa.process import load_sweep, measure_point
from glint_aoa.units import convert

__all__ = ["MeasuredFilm", "film_figure", "films_of", "measure_film"]

_Floats = NDArray[np.float64]

_MOMENTS = 4  # several moments of figures 31 and 32


@dataclass(frozen=True, eq=False)
class MeasuredFilm:
    """Angle and intercept of the fields of a point.

    Attributes
    ----------
    point : CampaignPoint
        The point.
    time_s : ndarray [field]
        Middle of the exposures after the trigger [s].
    angle_deg, intercept_in : ndarray [field]
        Calibrated angle [deg] and intercept [in]; NaN where nothing was measured.
    """

    point: CampaignPoint
    time_s: _Floats
    angle_deg: _Floats
    intercept_in: _Floats


def measure_film(point: CampaignPoint) -> MeasuredFilm:
    """Measure the fields of a point.

    Parameters
    ----------
    point : CampaignPoint
        With fields.

    Returns
    -------
    MeasuredFilm
        After the pitch sweep where the setup names one.

    Raises
    ------
    InputError
        If fields or setup cannot be used.
    """
    found = measure_point(point.fields(), point.setup, sweep=load_sweep(point.setup)).values
    good = (found["flags"] & int(REJECTING)) == 0
    angle, intercept = (
        np.where(good, found[name], np.nan) for name in ("angle_deg", "intercept_mm")
    )
    time_s = np.asarray(found["time_s"], np.float64)
    return MeasuredFilm(point, time_s, angle, intercept * convert("mm", "in"))


def films_of(spec: FigureSpec, points: Sequence[CampaignPoint]) -> list[CampaignPoint]:
    """Choose the films that a figure shows.

    Parameters
    ----------
    spec : FigureSpec
        The figure.
    points : sequence of CampaignPoint
        That it can be made from.

    Returns
    -------
    list of CampaignPoint
        By rising moment: of a figure of several moments four that are spread over them, the
        largest among them; of the others that at the largest moment.
    """
    rising = sorted(points, key=lambda point: np.nan_to_num(point.moment_in_lb))
    if spec.wanted.least_film_s > 0:
        return rising[-1:]
    wanted = np.linspace(0, len(rising) - 1, min(_MOMENTS, len(rising)))
    return [rising[round(number)] for number in wanted]


def film_figure(spec: FigureSpec, films: Sequence[MeasuredFilm]) -> FigureData:
    """Show angle or intercept against time, a panel for each moment: figures 31 to 36.

    Parameters
    ----------
    spec : FigureSpec
        The figure; its maker says which of the two.
    films : sequence of MeasuredFilm
        By rising moment.

    Returns
    -------
    FigureData
        The facts are the peak-to-peak change at each moment [deg or in], noise of the single
        fields included, and of the last the largest departure from its mean.
    """
    is_angle = spec.maker == "angle"
    panels, facts = [], []
    for film in films:
        values = film.angle_deg if is_angle else film.intercept_in
        moment = film.point.moment_in_lb
        title = f"{moment:.0f} in lbf peak to peak"
        panels.append(Panel(spec.y, (Curve(title, film.time_s, values, "joined points"),), title))
        facts.append(Fact(f"change at {moment:.0f} in lbf", _change(values), spec.y.unit))
    last = films[-1]
    values = last.angle_deg if is_angle else last.intercept_in
    largest = {
        "largest change": (_change(values), spec.y.unit),
        "largest departure from the mean": (
            float(np.nanmax(np.abs(values - np.nanmean(values)))),
            spec.y.unit,
        ),
        "at a moment of": (last.point.moment_in_lb, "in lbf"),
    }
    facts = facts[:-1] + [
        Fact(what, *found, spec.paper.get(what)) for what, found in largest.items()
    ]
    return FigureData(
        spec.number,
        spec.title,
        spec.x,
        tuple(panels),
        tuple(facts),
        tuple(film.point.name for film in films),
    )


def _change(values: _Floats) -> float:
    return float(np.nanmax(values) - np.nanmin(values))
