"""Fields of one static line whose angle is known, and the Cramer-Rao bound of that angle."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from glint_aoa.optical.measure import Measurement, prepare
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup

COLUMNS = 752
BLACK = 10.0
ELECTRONS_PER_GREY = 40_000 / 255
PITCH = (11.7e-6, 27.5e-6)
ESTIMATORS = ("centroid", "profile", "gaussian", "steger")


@dataclass(frozen=True)
class Scene:
    """A Gaussian line, integrated over the pixels; `row` is at the window's middle."""

    sigma: float = 1.4
    peak: float = 160.0
    read_noise: float = 0.7
    slope: float = 0.011
    row: float = 40.3
    lines: int = 92

    @property
    def angle_deg(self) -> float:
        """Angle that a nose-left model with this line has [deg]."""
        return float(np.degrees(np.arctan(self.slope * PITCH[1] / PITCH[0])))

    def grey(self, shift: float = 0.0) -> NDArray[np.float64]:
        """Return the expected grey levels [line, column] of the line moved down by `shift`."""
        centre = self.row + shift + self.slope * (np.arange(COLUMNS) - (COLUMNS - 1) / 2)
        edges = np.arange(self.lines + 1)[:, None] - 0.5
        share = np.diff(ndtr((edges - centre) / self.sigma), axis=0)
        return BLACK + self.peak * np.sqrt(2 * np.pi) * self.sigma * share

    def fields(self, rng: np.random.Generator, n_fields: int) -> NDArray[np.uint8]:
        """Return noisy fields [field, line, column]."""
        expected = self.grey().astype(np.float32)
        std = np.sqrt(expected / ELECTRONS_PER_GREY + self.read_noise**2)
        fields = np.empty((n_fields, *expected.shape), np.uint8)
        for field in fields:
            noise = rng.standard_normal(expected.shape, np.float32)
            field[:] = np.clip(np.round(expected + std * noise), 0, 255)
        return fields

    def bound_deg(self, columns: NDArray[np.int64]) -> float:
        """Return the Cramer-Rao bound of one field's angle from `columns` [deg]."""
        step = 1e-3
        gradient = (self.grey(step) - self.grey(-step)) / (2 * step)
        variance = pixel_variance(
            self.grey(), read_noise=self.read_noise, electrons_per_grey=ELECTRONS_PER_GREY
        )
        slope = slope_std_bound(centre_information(gradient, variance)[columns], columns)
        return float(np.degrees(slope * PITCH[1] / PITCH[0]))


def setup_for(estimator: str, step: int) -> Setup:
    """Return a setup with this estimator, using every `step` columns."""
    camera: dict[str, Any] = {
        "focal_length": "35 mm",
        "pixel_pitch": [f"{1e6 * p:g} um" for p in PITCH],
        "sensor": [COLUMNS, 240],
        "position": ["0 m", "-56 in", "60 mm"],
    }
    glint = {"column_step": step, "estimator": estimator}
    return Setup.model_validate({"camera": camera, "glint": glint})


def prepared(fields: NDArray[np.uint8], estimator: str, step: int) -> Measurement:
    """Return how the fields are measured, learnt from them."""
    setup = setup_for(estimator, step)
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0))
    return prepare(stack, setup, resolve_recording(stack, setup))


def table_row(cells: list[str], widths: list[int]) -> str:
    """Return a line of a table: the first cell to the left, the others to the right."""
    first, *others = (
        cell.ljust(width) if k == 0 else cell.rjust(width)
        for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return "".join([first, *others])
