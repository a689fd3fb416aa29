"""Small points, and what the measurement of one after the other makes of them."""

import numpy as np

from glint_aoa.process import process_point
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import load_setup

SETUP = '[camera]\npixel_pitch = ["11.7 um", "27.5 um"]\n[glint]\nnose = "left"\n'
N_FIELDS, LINES, COLUMNS = 9, 40, 120


def write_fields(path, seed):
    rng = np.random.default_rng(seed)
    light = 10 + 150 * np.exp(-0.5 * ((np.arange(LINES) - 18.0 - rng.random()) / 1.4) ** 2)
    fields = rng.normal(light[:, None], 1.0, (N_FIELDS, LINES, COLUMNS))
    info = FieldInfo(rate_hz=60.0, interlaced=False)
    write_point(path, RecordedPoint(fields=np.rint(fields).astype(np.uint8), info=info))


def serial_batch(folder, n_points):
    """Write points, a setup, and the results of a serial run in ``serial``; return paths, setup."""
    (folder / "points").mkdir()
    (folder / "glint-aoa.toml").write_text(SETUP)
    setup = load_setup(folder / "glint-aoa.toml")
    paths = [folder / "points" / f"p{number}.h5" for number in range(n_points)]
    for number, path in enumerate(paths):
        write_fields(path, number)
        process_point(path, setup, folder / "serial")
    return paths, setup


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.glob("[!.]*")}
