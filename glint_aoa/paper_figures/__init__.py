"""The paper's data figures, 11 to 37, as numbers, from recorded points.

`table` says which point feeds which figure and in which axes; `points` reads the points and
chooses among them; `bias`, `regression`, `errors` and `video` make the numbers; `make` puts one
figure after the other together. Nothing is drawn here.
"""

from glint_aoa.paper_figures.figure_data import Axis, Curve, Fact, FigureData, Panel
from glint_aoa.paper_figures.make import FigureSource, check_number, make_figure
from glint_aoa.paper_figures.points import CampaignPoint, MissingPointError, read_points
from glint_aoa.paper_figures.table import FIGURES, FigureSpec

__all__ = [
    "FIGURES",
    "Axis",
    "CampaignPoint",
    "Curve",
    "Fact",
    "FigureData",
    "FigureSource",
    "FigureSpec",
    "MissingPointError",
    "Panel",
    "check_number",
    "make_figure",
    "read_points",
]
