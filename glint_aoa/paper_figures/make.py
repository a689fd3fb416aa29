"""One figure after the other, from the points that are there."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from glint_aoa.benchmark import BenchmarkPoint, PointError, point_errors
from glint_aoa.campaign import compare_point
from glint_aoa.errors import InputError
from glint_aoa.paper_figures import bias, errors, regression, video
from glint_aoa.paper_figures.figure_data import FigureData
from glint_aoa.paper_figures.points import CampaignPoint, chosen
from glint_aoa.paper_figures.table import FIGURES, FigureSpec
from glint_aoa.workers import Workers

__all__ = ["FigureSource", "check_number", "make_figure"]

_Maker = Callable[[FigureSpec, Sequence[CampaignPoint]], FigureData]

_FROM_RECORDS: Mapping[str, _Maker] = {
    "shut-off": bias.shut_off,
    "levels": bias.bias_of_levels,
    "bias": bias.bias_in_time,
    "series": regression.time_series,
    "spectra": regression.spectra,
    "coherence": regression.coherence,
    "residual": regression.residual,
}


class FigureSource:
    """Recorded points, and what several figures share of what is measured of them.

    Parameters
    ----------
    points : sequence of CampaignPoint
        As from `glint_aoa.paper_figures.points.read_points`; those of a run in the order in which
        they were taken.
    jobs : int, optional
        How many processes share the points; the results are the same to the bit.
    progress : callable, optional
        Called with each point once its fields have been measured.
    """

    def __init__(
        self,
        points: Sequence[CampaignPoint],
        *,
        jobs: int = 1,
        progress: Callable[[CampaignPoint], None] | None = None,
    ) -> None:
        self.points = tuple(points)
        self._jobs = jobs
        self._progress = progress or (lambda _: None)
        self._compared: dict[Path, BenchmarkPoint] = {}
        self._films: dict[Path, video.MeasuredFilm] = {}

    def compared(self, points: Sequence[CampaignPoint]) -> list[BenchmarkPoint]:
        """Return points as both systems measured them, each measured once."""
        new = [point for point in points if point.path not in self._compared]
        if new:
            measure = partial(compare_point, setup=new[0].setup)
            with Workers(min(self._jobs, len(new))) as workers:
                found = workers.map(measure, [(point.path, point.announced) for point in new])
                for point, (measured, _) in zip(new, found, strict=True):
                    self._compared[point.path] = measured
                    self._progress(point)
        return [self._compared[point.path] for point in points]

    def errors(self, points: Sequence[CampaignPoint]) -> list[PointError]:
        """Return the errors of points of runs that start and end with the shaker off."""
        runs = dict.fromkeys(point.announced.run for point in points)
        whole = [point for point in self.points if point.announced.run in runs]
        wanted = {point.path for point in points}
        used = [p for p in whole if p.path in wanted or p.announced.shaker_off]
        return point_errors(self.compared(used))

    def film(self, point: CampaignPoint) -> video.MeasuredFilm:
        """Return angle and intercept of a point's fields, measured once."""
        if point.path not in self._films:
            self._films[point.path] = video.measure_film(point)
            self._progress(point)
        return self._films[point.path]


def check_number(number: int) -> None:
    """Refuse a figure that the paper does not have, or that shows no data.

    Raises
    ------
    InputError
        If `number` is none of `FIGURES`.
    """
    if number not in FIGURES:
        first, last = min(FIGURES), max(FIGURES)
        raise InputError(
            f"figure {number} is no data figure of the paper; choose {first} to {last}"
        )


def make_figure(number: int, source: FigureSource) -> FigureData:
    """Make the numbers of one figure.

    Parameters
    ----------
    number : int
        As in the paper, 11 to 37.
    source : FigureSource
        The points.

    Returns
    -------
    FigureData
        Its numbers.

    Raises
    ------
    InputError
        If there is no such figure, or a recording or the setup cannot be used.
    MissingPointError
        If no point can feed it.
    """
    check_number(number)
    spec = FIGURES[number]
    points = chosen(source.points, spec.wanted)
    if spec.maker in _FROM_RECORDS:
        return _FROM_RECORDS[spec.maker](spec, points)
    if spec.maker in ("angle", "intercept"):
        films = [source.film(point) for point in video.films_of(spec, points)]
        return video.film_figure(spec, films)
    if spec.maker == "scatter":
        return errors.scatter_against_moment(spec, source.compared(points))
    make = errors.errors_against_moment if spec.maker == "moments" else errors.errors_by_run
    return make(spec, source.errors(points))
