"""Work shared among processes."""

import math
import operator
import os
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from shared_work import die_of, fill, process_id, raise_obstinately, return_a_function

from glint_aoa.campaign import compare_points
from glint_aoa.errors import RecordingError, WorkerDiedError
from glint_aoa.records.formats import open_fields
from glint_aoa.setup import load_setup
from glint_aoa.workers import Workers, _resident_bytes
from render_sim.campaign import Campaign, simulate_campaign

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
[glint]
y = "-49 mm"
nose = "left"
"""


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_their_items(jobs):
    with Workers(jobs) as workers:
        assert list(workers.map(math.sqrt, [9.0, 4.0, 1.0])) == [3.0, 2.0, 1.0]
        assert list(workers.map(operator.neg, range(20))) == [-n for n in range(20)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_wrong_is_told_when_its_turn_comes(jobs, tmp_path):
    (tmp_path / "one.h5").write_bytes(b"no HDF5")
    with Workers(jobs) as workers, pytest.raises(RecordingError, match=r"one\.h5: .*not an HDF5"):
        list(workers.map(open_fields, [tmp_path / "one.h5"]))


def test_points_that_are_shared_give_the_same_files_to_the_bit(tmp_path):
    series = {"kind": "sine", "plane": "yaw", "frequency": "9.8 Hz", "moments": ["900 in*lbf"]}
    run = {"name": "run", "angle": "1 deg", "series": [series]}
    campaign = Campaign.model_validate(
        {"name": "small", "start": "2026-01-12T08:00:00", "n_fields": 12, "run": [run]}
    )
    points = list(simulate_campaign(campaign, tmp_path / "points"))
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    setup = load_setup(tmp_path / "glint-aoa.toml")
    alone = compare_points(points, setup, tmp_path / "alone")
    shared = compare_points(points, setup, tmp_path / "shared", jobs=2)
    assert shared == alone
    files = sorted(path.name for path in (tmp_path / "alone").iterdir())
    assert len(files) == 2 * len(points) + 1
    for name in files:
        ours, theirs = (tmp_path / folder / name for folder in ("shared", "alone"))
        assert ours.read_bytes() == theirs.read_bytes(), name


def pids(**how):
    with Workers(2, **how) as workers:
        return set(workers.map(process_id, range(8)))


def test_as_many_processes_as_memory_allows():
    assert len(pids(memory=1)) == 1
    assert len(pids(memory=10**12)) == len(pids()) == 2
    assert os.getpid() not in pids()


def test_a_process_less_where_they_take_more_than_they_may(monkeypatch):
    monkeypatch.setattr("glint_aoa.workers._SUPPOSED", 1)
    with Workers(2, memory=_resident_bytes() + 500_000_000) as workers:
        for sizes, count in (([1] * 4, 2), ([600_000_000], 2), ([1] * 4, 1)):
            assert list(workers.map(fill, sizes)) == sizes
            assert workers.count == count


def test_one_that_stands_apart_is_another_process():
    with Workers(1) as here, Workers(1, apart=True) as there:
        assert list(here.map(process_id, [0])) == [os.getpid()]
        assert list(there.map(process_id, [0])) != [os.getpid()]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_one_item_is_told_and_the_others_are_done(jobs):
    with Workers(jobs) as workers:
        found = {each.item: each for each in workers.outcomes(math.sqrt, [4.0, -1.0, 9.0])}
    assert [found[item].result for item in (4.0, 9.0)] == [2.0, 3.0]
    assert [found[item].number for item in (4.0, -1.0, 9.0)] == [0, 1, 2]
    with pytest.raises(ValueError, match="math domain error"):
        found[-1.0].get()


def test_an_item_whose_process_dies_is_tried_once_more(tmp_path):
    die = partial(die_of, victim=3, marker=tmp_path / "died")
    with Workers(2) as workers:
        assert list(workers.map(die, range(6))) == list(range(6))
    assert (tmp_path / "died").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_item_that_kills_twice_is_given_up_alone(jobs):
    with Workers(jobs, apart=True) as workers:
        found = {each.item: each for each in workers.outcomes(partial(die_of, victim=2), range(5))}
    assert [found[item].result for item in (0, 1, 3, 4)] == [0, 1, 3, 4]
    message = (
        "two processes died while they worked at it, the second by SIGKILL; if memory ran out, "
        "try it where there is more"
    )
    with pytest.raises(WorkerDiedError, match=re.escape(message)):
        found[2].get()


def test_what_cannot_be_sent_back_is_told():
    with Workers(2) as workers:
        (raised,) = workers.outcomes(raise_obstinately, ["this"])
        (returned,) = workers.outcomes(return_a_function, ["this"])
        assert str(raised.error) == "ObstinateError: this and more"
        assert "return_a_function" in str(returned.error)
        assert list(workers.map(math.sqrt, [4.0])) == [2.0]


def test_processes_end_with_the_one_that_waits_for_them(tmp_path):
    script = (
        "from glint_aoa.workers import Workers; from shared_work import process_id, pause\n"
        "with Workers(2) as w:\n"
        "    print(*set(w.map(process_id, range(8))), flush=True)\n"
        "    list(w.map(pause, [0.1] * 1000))"
    )
    path = os.pathsep.join(sys.path)
    waits = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    with waits:
        theirs = [int(each) for each in waits.stdout.readline().split()]
        waits.kill()
    assert len(theirs) == 2
    until = time.monotonic() + 20
    while any(Path(f"/proc/{pid}").exists() for pid in theirs):
        assert time.monotonic() < until
        time.sleep(0.02)
