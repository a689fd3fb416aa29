"""Readers that do what no reader may."""

import os
import time

from fuzz.families import Family


def seeds(folder):
    (folder / "a.bin").write_bytes(bytes(64))
    return [[folder / "a.bin"]]


def crashes(_):
    os.abort()


def hangs(_):
    time.sleep(60)


def takes_memory(_):
    return bytearray(2 << 30)


def raises(path):
    raise ValueError(f"{path} is bad")


def reads(path):
    return path.read_bytes()


FAMILIES = {
    each.__name__: Family(seeds, each) for each in (crashes, hangs, takes_memory, raises, reads)
}
