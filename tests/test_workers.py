"""Work shared among processes."""

import math
import operator

import pytest

from glint_aoa.campaign import compare_points
from glint_aoa.errors import RecordingError
from glint_aoa.records.formats import open_fields
from glint_aoa.setup import load_setup
from glint_aoa.workers import Workers
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
