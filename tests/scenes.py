"""A static line in closed form: fields of it, and what their noise lets any estimator know."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from glint_aoa.flags import Flag
from glint_aoa.optical.bound import centre_information, pixel_variance, slope_std_bound
from glint_aoa.optical.measure import measure_stack
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Camera, Glint, Setup

PITCH = Camera(pixel_pitch=("11.7 um", "27.5 um"))
PER_COLUMN = np.degrees(27.5 / 11.7)
"""A line per column, as an angle where it is small [deg]."""
ELECTRONS_PER_GREY = 40_000 / 255


@dataclass(frozen=True)
class Scene:
    """A line whose expected grey levels are known.

    `image` is what the pixels expect and `gradient` how it changes as the line moves down by one
    row [line, column].
    """

    image: NDArray
    gradient: NDArray
    row: float
    slope: float
    read_noise: float
    white: int = 255

    @property
    def variance(self):
        return pixel_variance(
            self.image, read_noise=self.read_noise, electrons_per_grey=ELECTRONS_PER_GREY
        )

    def fields(self, rng, n_fields):
        """Draw fields: noise, whole grey levels, clipped at the top.

        A thousand electrons and more are behind every pixel: shot noise is normal.
        """
        noise = rng.standard_normal((n_fields, *self.image.shape), np.float32)
        noise *= np.sqrt(self.variance - 1 / 12).astype(np.float32)
        return np.clip(np.round(self.image + noise), 0, self.white).astype(np.uint8)

    def bound(self, columns):
        """Least noise of one field's slope [lines / column]."""
        return slope_std_bound(self._information(columns), columns)

    def efficient(self, fields, columns):
        """Slope that is at the bound: linear in the noise, with everything but the row known.

        Pixels that may clip tell it nothing. What an estimator differs from it by has far less
        scatter than the estimator itself, so a few fields show bias and efficiency.
        """
        information = self._information(columns)
        u = columns - (information * columns).sum() / information.sum()
        weight = (self.gradient / self.variance * self._unclipped)[:, columns] * u
        noise = fields[:, :, columns] - self.image[:, columns]
        slope = np.einsum("fvu,vu->f", noise, weight) / (information * u**2).sum()
        return self.slope + slope

    @property
    def _unclipped(self):
        return self.image + 6 * np.sqrt(self.variance) < self.white

    def _information(self, columns):
        gradient = (self.gradient * self._unclipped)[:, columns]
        return centre_information(gradient, self.variance[:, columns])


def scene(
    *,
    row=20.3,
    slope=0.0,
    sigma=1.4,
    peak=170.0,
    background=10.0,
    read_noise=0.7,
    lines=40,
    columns=752,
):
    """A Gaussian line, integrated over pixels; `peak` and `background` broadcast to an image."""
    centre = row + slope * (np.arange(columns) - (columns - 1) / 2)
    edges = (np.arange(lines + 1)[:, None] - 0.5 - centre) / sigma
    height = np.broadcast_to(peak, columns) * np.sqrt(2 * np.pi) * sigma
    image = background + height * np.diff(ndtr(edges), axis=0)
    bell = np.exp(-0.5 * edges**2) / np.sqrt(2 * np.pi)
    gradient = -height * np.diff(bell, axis=0) / sigma
    return Scene(np.broadcast_to(image, (lines, columns)), gradient, row, slope, read_noise)


def measured(fields, *, threads=1, camera=PITCH, **glint):
    """Slopes of the measured fields, lines a column, v down; angles and measurement."""
    setup = Setup(camera=camera, glint=Glint(**glint))
    stack = FieldStack.from_array(fields, FieldInfo(rate_hz=60.0))
    angles, how = measure_stack(stack, setup, resolve_recording(stack, setup), threads=threads)
    return np.tan(angles.angle) / (27.5 / 11.7), angles, how


def flags_of(angles):
    """Flags that any field has, that of the missing calibration left out."""
    return Flag(int(np.bitwise_or.reduce(angles.flags))) & ~Flag.UNCALIBRATED
