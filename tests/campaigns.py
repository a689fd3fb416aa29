"""Campaign files of a few short points, and a renderer that costs nothing."""

import numpy as np

SMALL = """
name = "small"
start = 2026-01-12T08:00:00
n_fields = 2
duration = "0.5 s"

[drift]
run = "0.003 deg"
within_run = "0.0015 deg"

[[sweep]]
name = "sweep"
first = "-1 deg"
last = "1 deg"
points = 3

[[run]]
name = "yaw"
angle = "4.3 deg"
[[run.series]]
kind = "sine"
plane = "yaw"
frequency = "9.8 Hz"
moments = ["3000 in*lbf"]
"""


RECORD = """
[[record]]
name = "stop"
angle = "-0.3 deg"
yaw = "2 deg"
duration = "1 s"
n_fields = 3
window = [133, 20]
[record.excitation]
kind = "sine"
plane = "yaw"
frequency = "9.8 Hz"
moments = ["2000 in*lbf"]
shaker_off = "0.4 s"
"""


class FlatRenderer:
    """A renderer without a picture: fields cost nothing, and their noise is still seeded."""

    name = "flat"

    def __init__(self, rows=92):
        self.rows = rows

    def radiance(self, poses, *, parity=0):
        return np.full((len(poses), self.rows, 752), 50.0)


LOOSE = """
[record.loose]
plane = "yaw"
mass = "5 kg"
station = "0.12 m"
travel = "0.5 mm"
bracket = "0.1 mm"
band = ["9 Hz", "10.5 Hz"]
"""
