"""Fields of a straight Gaussian line, integrated over each pixel: the truth in closed form."""

import numpy as np
from scipy.special import ndtr

FULL_WELL = 40_000.0


def line_fields(
    rng=None,
    *,
    n_fields=60,
    shape=(92, 752),
    slope=0.0,
    row=40.0,
    sigma=1.4,
    peak=170.0,
    black=10.0,
    read_noise=0.7,
    interlaced=False,
    white=255,
    dtype=np.uint8,
):
    """Return fields whose line's centre at column u is `row` + `slope` * (u - middle).

    `row` and `slope` may be arrays over fields. Without `rng` there is no noise and the grey
    levels are rounded only. Odd fields of an interlaced stack see the line half a line higher up.
    """
    lines, columns = shape
    u = np.arange(columns) - (columns - 1) / 2
    row = np.broadcast_to(np.asarray(row, float), n_fields)
    slope = np.broadcast_to(np.asarray(slope, float), n_fields)
    fields = np.empty((n_fields, lines, columns), dtype)
    edges = np.arange(lines + 1)[:, None] - 0.5
    for k in range(n_fields):
        centre = row[k] + slope[k] * u - 0.5 * (k % 2) * interlaced
        share = np.diff(ndtr((edges - centre) / sigma), axis=0)
        image = black + peak * np.sqrt(2 * np.pi) * sigma * share
        if rng is not None:
            electrons_per_grey = FULL_WELL / white
            image = rng.poisson(image * electrons_per_grey) / electrons_per_grey
            image = image + rng.normal(0, read_noise, image.shape)
        fields[k] = np.clip(np.round(image), 0, white)
    return fields
