"""A line whose row is known in every column, and an estimator that has learnt from it."""

import numpy as np
from scipy.special import ndtr
from synthetic import FULL_WELL, line_fields

from glint_aoa.optical.columns import used_columns
from glint_aoa.optical.detect import find_glint
from glint_aoa.optical.estimator import Sample
from glint_aoa.optical.noise import NoiseModel
from glint_aoa.setup import Glint


def noise_model(*, read_noise=0.7, white=255):
    """The noise of `line_fields`."""
    return NoiseModel(read_noise**2 + 1 / 12, white / FULL_WELL, 0.0, white)


def rows_of(row, slope, columns, n_fields, width=752):
    """Rows of the line of `line_fields` [field, column]."""
    row = np.broadcast_to(np.asarray(row, float), n_fields)
    slope = np.broadcast_to(np.asarray(slope, float), n_fields)
    return row[:, None] + slope[:, None] * (columns - (width - 1) / 2)


def fitted(learn, fields, rows, *, columns, noise, start_error=0.3, glint=None, sample=64):
    """Centres by an estimator that learnt from the first fields, started off by up to a part."""
    shape = find_glint(fields[:7], glint or Glint())
    estimator = learn(Sample(fields[:sample], columns, rows[:sample]), shape, noise)
    off = np.random.default_rng(99).uniform(-start_error, start_error, rows.shape)
    return estimator.centres(fields, columns, rows + off), estimator


def straight_line(
    learn,
    rng=None,
    *,
    n_fields=64,
    row=15.3,
    slope=0.004,
    read_noise=0.7,
    shape=(32, 152),
    step=4,
    **kwargs,
):
    """Centres of `line_fields`, the rows they should have, the columns and the estimator."""
    white = kwargs.get("white", 255)
    fields = line_fields(
        rng,
        n_fields=n_fields,
        row=row,
        slope=slope,
        read_noise=read_noise,
        shape=shape,
        **kwargs,
    )
    columns = used_columns(shape[1], step)
    rows = rows_of(row, slope, columns, n_fields, shape[1])
    noise = noise_model(read_noise=read_noise, white=white)
    found, estimator = fitted(learn, fields, rows, columns=columns, noise=noise)
    return found, rows, columns, estimator


def bar_fields(rng, *, n_fields=32, half_width, blur, height, step, slope=0.004, row=40.3):
    """Fields of a bar between backgrounds that differ by `step` [column], and its rows.

    The bar is a difference of two blurred edges, each integrated over the pixels in closed form.
    """
    u = np.arange(752) - 375.5
    centre = row + slope * u
    line = np.arange(92)[:, None]

    def edge(at):
        low, high = ((line + half - centre - at) / blur for half in (-0.5, 0.5))
        bell = (np.exp(-(high**2) / 2) - np.exp(-(low**2) / 2)) / np.sqrt(2 * np.pi)
        return blur * (high * ndtr(high) - low * ndtr(low) + bell)

    expected = 50 + height * (edge(-half_width) - edge(half_width)) + step * edge(half_width)
    noise = np.sqrt(expected * 255 / FULL_WELL + 0.49)
    fields = np.array([np.round(rng.normal(expected, noise)) for _ in range(n_fields)])
    return fields.astype(np.uint8), np.tile(centre, (n_fields, 1))


def slopes(rows, columns):
    """Slope of an ordinary line through each field's centres."""
    return np.polyfit(columns, rows.T, 1)[0]
