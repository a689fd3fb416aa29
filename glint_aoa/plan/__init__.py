"""A test before it is run: what a setup will measure, how well, and where it would do better.

Nothing is rendered and nothing is simulated: the glint's place, width and light follow from the
law of reflection, the noise of the angle from the Cramer-Rao bound.
"""

from glint_aoa.plan.forecast import AngleForecast, LayoutForecast, VisibleRange, forecast
from glint_aoa.plan.layout import Layout
from glint_aoa.plan.noise import MeanNoise, mean_noise
from glint_aoa.plan.predict import Prediction, predict
from glint_aoa.plan.search import LayoutMap, TestPlan, make_plan, map_size

__all__ = [
    "AngleForecast",
    "Layout",
    "LayoutForecast",
    "LayoutMap",
    "MeanNoise",
    "Prediction",
    "TestPlan",
    "VisibleRange",
    "forecast",
    "make_plan",
    "map_size",
    "mean_noise",
    "predict",
]
