"""What processes of their own are given to do in tests; importable there."""

import os
import signal
import time
from pathlib import Path


def process_id(_item):
    return os.getpid()


def pause(seconds):
    time.sleep(seconds)
    return seconds


def fill(n_bytes):
    return len(b"x" * n_bytes)


def die_of(item, victim, marker=None):
    """Kill this process by an item; where a marker is named, only the first time."""
    if item == victim and not (marker and Path(marker).exists()):
        if marker:
            Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def measure_or_die(path, once, always, **how):
    from glint_aoa.batch.point import measure_into

    die_of(path.name, always)
    die_of(path.name, path.name, once.get(path.name, path))
    return measure_into(path, **how)


class ObstinateError(Exception):
    """Cannot be made again from what it says."""

    def __init__(self, one, two):
        super().__init__(f"{one} {two}")


def raise_obstinately(item):
    raise ObstinateError(item, "and more")


def return_a_function(item):
    return lambda: item
