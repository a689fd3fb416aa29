"""Jobs for a measuring process that end badly; by name, so that another process can call them."""

import os


def measure(path, setup, results, *, again):
    """Measure nothing; what the file is called says how it goes."""
    if path.stem == "dies":
        os._exit(1)
    if path.stem == "errs":
        raise TypeError("no such thing")
    return {"point": path.stem, "again": str(again)}


def gather(path, setup, results):
    return f"details of {path.stem}"
