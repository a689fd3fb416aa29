"""What this machine has, and how fast it measures."""

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from glint_aoa.optical.measure import measure_prepared
from glint_aoa.optical.prepare import prepare
from glint_aoa.records.fields import FieldInfo, FieldStack
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup

__all__ = ["Machine", "Speed", "field_rate", "look_at_machine"]

_LINES, _COLUMNS = 240, 752
_N_FIELDS = 120
_SLOPE = 0.004  # field lines a column
_BLACK, _PEAK, _SIGMA, _NOISE = 10.0, 160.0, 1.4, 0.8  # grey levels; width in field lines
_SIGMAS = 5.0  # of the mean, that it may be off


@dataclass(frozen=True)
class Machine:
    """What this machine has for a measurement.

    Attributes
    ----------
    processors : int
        Processors that this process may use.
    memory_bytes, free_bytes : int or None
        Memory, and what of it is free [bytes]; None where the system does not say.
    folder : Path
        Folder that was looked at.
    is_writable : bool
        Whether a file can be written there.
    disk_free_bytes : int
        Room on its disk [bytes].
    """

    processors: int
    memory_bytes: int | None
    free_bytes: int | None
    folder: Path
    is_writable: bool
    disk_free_bytes: int


@dataclass(frozen=True)
class Speed:
    """How fast fields in memory are measured.

    Attributes
    ----------
    fields_per_s : float
        Fields measured in a second of the clock [1/s].
    learning_s : float
        What is learnt of each point before: the glint's profile, the camera's noise [s].
    lines, columns : int
        Their size [pixels].
    error_deg, std_deg : float
        Mean angle less the true one, and its stated standard deviation, 1 sigma [deg].
    """

    fields_per_s: float
    learning_s: float
    lines: int
    columns: int
    error_deg: float
    std_deg: float

    @property
    def is_right(self) -> bool:
        """Whether the angle is the true one within 5 of its standard deviations."""
        return bool(abs(self.error_deg) <= _SIGMAS * self.std_deg)


def look_at_machine(folder: Path) -> Machine:
    """Look at processors and memory, and at the disk of a folder.

    Parameters
    ----------
    folder : Path
        Where results may go; a file is written to it, and removed.

    Returns
    -------
    Machine
        What was found.
    """
    disk = os.statvfs(folder)
    return Machine(
        processors=len(os.sched_getaffinity(0)),
        memory_bytes=_memory("SC_PHYS_PAGES"),
        free_bytes=_memory("SC_AVPHYS_PAGES"),
        folder=folder.resolve(),
        is_writable=_can_write(folder),
        disk_free_bytes=disk.f_bavail * disk.f_frsize,
    )


def _memory(name: str) -> int | None:
    try:
        pages = os.sysconf(name)
    except (ValueError, OSError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") if pages > 0 else None


def _can_write(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"glint")
    except OSError:
        return False
    return True


def field_rate(*, seconds: float = 2.0, n_fields: int = _N_FIELDS) -> Speed:
    """Measure synthetic fields of 752 x 240 pixels for a while, and check their angle.

    Timed is the measurement of fields in memory, in as many threads as there are processors;
    what is learnt once a point stands beside it. Reading and writing files is not in it.

    Parameters
    ----------
    seconds : float, optional
        How long to measure [s]; the stack is measured once in any case, and once before, since
        the first use may compile.
    n_fields : int, optional
        Fields in the stack.

    Returns
    -------
    Speed
        The rate, and how far the mean angle was off.
    """
    stack = FieldStack.from_array(_fields(n_fields), FieldInfo(rate_hz=60.0, interlaced=False))
    setup = Setup()
    recording = resolve_recording(stack, setup)
    with threadpool_limits(limits=1, user_api="blas"):
        angles = measure_prepared(stack, prepare(stack, setup, recording))
        start = time.perf_counter()
        how = prepare(stack, setup, recording)
        learnt = time.perf_counter()
        count = 0
        while not count or time.perf_counter() - learnt < seconds:
            angles = measure_prepared(stack, how)
            count += n_fields
        rate = count / (time.perf_counter() - learnt)
    std = float(np.sqrt(np.mean(angles.angle_std**2) / n_fields))
    return Speed(
        fields_per_s=rate,
        learning_s=learnt - start,
        lines=_LINES,
        columns=_COLUMNS,
        error_deg=float(np.degrees(angles.angle.mean())) - _angle_deg(),
        std_deg=float(np.degrees(std)),
    )


def _angle_deg() -> float:
    """Return the angle in the image plane, square pixels, nose to the left [deg]."""
    return float(np.degrees(np.arctan(_SLOPE)))


def _fields(n_fields: int) -> NDArray[np.uint8]:
    """Return noisy fields [field, line, column] of a straight Gaussian line.

    It falls to the right, as the glint of a nose-up model with its nose to the left does.
    """
    rng = np.random.default_rng(0)
    centre = _LINES / 2 + _SLOPE * (np.arange(_COLUMNS) - (_COLUMNS - 1) / 2)
    edges = np.arange(_LINES + 1)[:, None] - 0.5
    share = np.diff(ndtr((edges - centre) / _SIGMA), axis=0)
    expected = (_BLACK + _PEAK * np.sqrt(2 * np.pi) * _SIGMA * share).astype(np.float32)
    fields = np.empty((n_fields, *expected.shape), np.uint8)
    for field in fields:
        noise = rng.standard_normal(expected.shape, np.float32)
        field[:] = np.clip(np.round(expected + np.float32(_NOISE) * noise), 0, 255)
    return fields
