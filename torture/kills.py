"""Kill a batch of points at random moments, start it again, and see that nothing is lost.

Each time the batch comes to its end its results are held against those of an undisturbed run, to
the bit, and it starts from nothing again.
"""

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point

__all__ = ["Kills", "kill_batch", "main"]

POINTS, FIELDS = 40, 12
KILLS, SEED = 200, 1
_LINES, _COLUMNS = 60, 240
_LONGEST = 0.3  # of the undisturbed run: how long a start may go on

_SETUP = """
[camera]
pixel_pitch = ["11.7 um", "27.5 um"]
[fields]
rate = "60 Hz"
[glint]
nose = "left"
"""


@dataclass
class Kills:
    """What came of it.

    Attributes
    ----------
    kills : int
        How often the batch was killed.
    batches : int
        How often it came to its end.
    differing : list of str
        Files that were not those of the undisturbed run at an end.
    partial : list of str
        Files that were not whole after a kill: neither absent nor those of the undisturbed run.
    """

    kills: int
    batches: int
    differing: list[str]
    partial: list[str]

    @property
    def holds(self) -> bool:
        """Whether nothing was lost, doubled or taken for whole."""
        return self.batches > 0 and not self.differing and not self.partial


def kill_batch(
    folder: Path,
    *,
    kills: int = KILLS,
    points: int = POINTS,
    seed: int = SEED,
    command: str = "process",
) -> Kills:
    """Kill a batch so many times, and go on until it has come to its end.

    Parameters
    ----------
    folder : Path
        For points and results.
    kills : int
        How often.
    points : int
        How many points the batch has.
    seed : int
        Of the points and of the moments.
    command : {"process", "batch"}
        What measures them: one process, or two and the one that waits, which is killed.
    """
    _write_points(folder, points, seed)
    began = time.monotonic()
    _start(folder, "whole", "process").wait()
    usual_s = time.monotonic() - began
    expected = _files(folder / "whole")
    chance = random.Random(seed)
    outcome = Kills(0, 0, [], [])
    while outcome.kills < kills or outcome.batches == 0:
        process = _start(folder, "out", command)
        try:
            status = process.wait(
                chance.uniform(0.0, _LONGEST * usual_s) if outcome.kills < kills else None
            )
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            outcome.kills += 1
            outcome.partial += _partial(_files(folder / "out"), expected)
            continue
        found = _files(folder / "out")
        outcome.differing += [
            name for name in expected | found if found.get(name) != expected.get(name)
        ]
        outcome.differing += [] if status == 0 else [f"exit code {status}"]
        outcome.batches += 1
        shutil.rmtree(folder / "out")
    return outcome


def _partial(found: dict[str, bytes], expected: dict[str, bytes]) -> list[str]:
    """Name files that are not what they will be; the log may stop between rows."""
    return [
        name
        for name, content in found.items()
        if not (
            expected[name].startswith(content) and content.endswith(b"\n")
            if name == "log.csv"
            else content == expected[name]
        )
    ]


def _files(folder: Path) -> dict[str, bytes]:
    """Return the files that a user sees; what is being written has a hidden name."""
    return {path.name: path.read_bytes() for path in folder.glob("[!.]*")}


def _start(folder: Path, out: str, command: str) -> "subprocess.Popen[bytes]":
    points = folder / "points"
    given = [points, "--jobs", "2"] if command == "batch" else sorted(points.iterdir())
    what = [command, *given, "--setup", folder / "glint-aoa.toml", "--out", folder / out]
    program = "from glint_aoa.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, what), "--resume"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _write_points(folder: Path, count: int, seed: int) -> None:
    (folder / "points").mkdir(parents=True)
    (folder / "glint-aoa.toml").write_text(_SETUP)
    rng = np.random.default_rng(seed)
    line, column = np.mgrid[:_LINES, :_COLUMNS]
    for number in range(count):
        row = 30 + rng.uniform(-4, 4) + rng.uniform(-0.02, 0.02) * (column - _COLUMNS / 2)
        light = 10 + 150 * np.exp(-0.5 * ((line - row) / 1.4) ** 2)
        fields = np.clip(np.rint(rng.normal(light, 1.0, (FIELDS, _LINES, _COLUMNS))), 0, 255)
        info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False)
        point = RecordedPoint(fields=fields.astype(np.uint8), info=info)
        write_point(folder / "points" / f"point-{number + 1:02d}.h5", point)


def main() -> int:
    """Print what came of it; 1 if anything was lost."""
    parser = argparse.ArgumentParser(prog="python -m torture.kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=KILLS)
    parser.add_argument("--points", type=int, default=POINTS, help="in the batch")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--command", choices=("process", "batch"), default="process")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = kill_batch(
            Path(folder),
            kills=options.kills,
            points=options.points,
            seed=options.seed,
            command=options.command,
        )
    print(f"{found.kills} kills, {found.batches} batches of {options.points} points came to an end")
    for what, names in (("differ at the end", found.differing), ("cut short", found.partial)):
        print(f"files that {what}: {', '.join(sorted(set(names))) or 'none'}")
    return 0 if found.holds else 1


if __name__ == "__main__":
    sys.exit(main())
