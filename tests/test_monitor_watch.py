"""A folder of points as it fills, with a clock of our own."""

import os

import h5py
import numpy as np
import pytest

from glint_aoa.monitor.watch import FolderWatch, PointStatus

START = 1_800_000_000.0


class Clock:
    def __init__(self):
        self.seconds = 0.0

    def __call__(self):
        return self.seconds

    def now(self):
        return START + self.seconds


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "points").mkdir()
    return tmp_path / "points"


@pytest.fixture
def watch(folder, clock):
    return FolderWatch(folder, settle_s=1.0, patience_s=10.0, clock=clock, now=clock.now)


def put(path, text="fields", *, at=START):
    path.write_text(text)
    os.utime(path, (at, at))
    return path


def look(watch, clock, seconds=0.0):
    """Let time pass, look, and return what is handed out."""
    clock.seconds += seconds
    watch.scan()
    taken = []
    while (each := watch.take()) is not None:
        taken.append((each[0].name, each[1]))
    return taken


def only(watch):
    (row,) = watch.rows()
    return row


def test_a_recording_is_handed_out_once_when_it_has_settled(folder, watch, clock):
    put(folder / "a.npy")
    assert look(watch, clock) == []
    assert only(watch).status is PointStatus.WAITING
    assert look(watch, clock, 0.9) == []
    assert look(watch, clock, 0.2) == [("a.npy", False)]
    assert only(watch).status is PointStatus.MEASURING
    assert look(watch, clock, 5.0) == []
    watch.measured(folder / "a.npy", {"mean_angle_deg": "2.5"})
    assert look(watch, clock, 5.0) == []
    assert only(watch).status is PointStatus.MEASURED
    assert only(watch).log == {"mean_angle_deg": "2.5"}
    assert watch.path_of("a.npy") == folder / "a.npy"


def test_a_recording_that_was_there_before_is_taken_at_once(folder, watch, clock):
    put(folder / "a.npy", at=START - 60)
    assert look(watch, clock) == [("a.npy", False)]


def test_a_recording_that_grows_is_waited_for(folder, watch, clock):
    for size in range(1, 8):
        put(folder / "a.npy", "x" * size)
        assert look(watch, clock, 0.8) == []
    assert look(watch, clock, 1.0) == [("a.npy", False)]


def test_a_recording_that_changes_is_handed_out_again_and_is_the_newest(folder, watch, clock):
    for name in ("a.npy", "b.npy"):
        put(folder / name, at=START - 60)
    assert look(watch, clock) == [("a.npy", False), ("b.npy", False)]
    for name in ("a.npy", "b.npy"):
        watch.measured(folder / name, {"mean_angle_deg": "2.5"})
    put(folder / "a.npy", "other")
    assert look(watch, clock) == []
    assert look(watch, clock, 1.1) == [("a.npy", True)]
    assert [row.name for row in watch.rows()] == ["b.npy", "a.npy"]


def test_a_measurement_overtaken_by_a_change_is_made_again(folder, watch, clock):
    put(folder / "a.npy", at=START - 60)
    look(watch, clock)
    put(folder / "a.npy", "longer")
    look(watch, clock)
    watch.measured(folder / "a.npy", {"mean_angle_deg": "2.5"})
    assert only(watch).status is PointStatus.WAITING
    assert look(watch, clock, 1.1) == [("a.npy", True)]


def test_a_file_beside_it_belongs_to_a_recording(folder, watch, clock):
    put(folder / "a.raw", at=START - 60)
    assert look(watch, clock) == [("a.raw", False)]
    watch.failed(folder / "a.raw", "a.raw: no shape")
    put(folder / "a.raw.toml")
    assert look(watch, clock) == []
    assert look(watch, clock, 1.1) == [("a.raw", False)]


def test_a_young_file_that_cannot_be_opened_is_tried_again_and_then_given_up(folder, watch, clock):
    put(folder / "a.npy")
    look(watch, clock)
    assert look(watch, clock, 1.1) == [("a.npy", False)]
    watch.failed(folder / "a.npy", "a.npy: damaged", may_heal=True)
    assert only(watch).status is PointStatus.WAITING
    assert only(watch).sentence == "a.npy: damaged"
    assert look(watch, clock, 0.5) == []
    assert look(watch, clock, 2.0) == [("a.npy", False)]
    clock.seconds = 10.1
    watch.failed(folder / "a.npy", "a.npy: damaged", may_heal=True)
    assert only(watch).status is PointStatus.BROKEN
    assert look(watch, clock, 60.0) == []


def test_what_time_does_not_heal_is_given_up_at_once(folder, watch, clock):
    put(folder / "a.npy")
    look(watch, clock)
    look(watch, clock, 1.1)
    watch.failed(folder / "a.npy", "no such sensor")
    assert only(watch).status is PointStatus.BROKEN


def test_only_recordings_count(folder, watch, clock):
    for name in ("a.txt", ".hidden.npy", "log.csv", "marks.csv", "trigger", "film.cihx", "a.nc"):
        put(folder / name, at=START - 60)
    (folder / "results").mkdir()
    put(folder / "results" / "b.npy", at=START - 60)
    (folder / "pictures").mkdir()
    put(folder / "pictures" / "0001.png", at=START - 60)
    os.utime(folder / "pictures", (START - 60, START - 60))
    assert look(watch, clock) == [("pictures", False)]


def test_a_record_without_fields_is_no_point(folder, watch, clock):
    with h5py.File(folder / "a.h5", "w") as file:
        file["das/moment"] = np.zeros(4)
    put(folder / "a.npy", at=START - 60)
    os.utime(folder / "a.h5", (START - 90, START - 90))
    assert look(watch, clock) == [("a.npy", False)]
    assert [row.name for row in watch.rows()] == ["a.npy"]


@pytest.mark.parametrize("name", ["a.npy", "a.npy.toml", "a.tdms"])
def test_a_link_that_leads_out_of_the_folder_is_not_followed(name, folder, watch, clock):
    outside = put(folder.parent / "secret", at=START - 60)
    put(folder / "a.npy", at=START - 60)
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(outside)
    clock.seconds = max(0.0, (folder / name).lstat().st_mtime - START) + 5.0
    assert look(watch, clock) == []
    assert look(watch, clock, 5.0) == []
    assert only(watch).status is PointStatus.BROKEN
    assert only(watch).sentence == (
        f"{name} leads out of the folder and is not followed; copy it here"
    )


def test_pictures_that_lead_out_of_the_folder_are_not_followed(folder, watch, clock):
    outside = put(folder.parent / "secret.png")
    (folder / "film").mkdir()
    (folder / "film" / "0001.png").symlink_to(outside)
    clock.seconds = max(0.0, (folder / "film").stat().st_mtime - START) + 5.0
    assert look(watch, clock) == []
    assert only(watch).sentence == (
        "0001.png leads out of the folder and is not followed; copy it here"
    )


def test_two_recordings_cannot_have_the_same_results(folder, watch, clock):
    put(folder / "a.npy", at=START - 60)
    put(folder / "a.tif", at=START - 50)
    assert look(watch, clock) == [("a.npy", False)]
    assert [row.sentence for row in watch.rows()] == [
        "",
        "a.npy and a.tif would have results of the same name; rename one",
    ]


def test_a_recording_cannot_have_the_name_of_a_table(folder, watch, clock):
    put(folder / "log.npy", at=START - 60)
    assert look(watch, clock) == []
    assert only(watch).sentence == "log.csv is a table; rename the recording"


def test_points_stay_when_their_files_go(folder, watch, clock):
    for name in ("a.npy", "b.npy"):
        put(folder / name, at=START - 60)
    look(watch, clock)
    watch.measured(folder / "a.npy", {"mean_angle_deg": "2.5"})
    for name in ("a.npy", "b.npy"):
        (folder / name).unlink()
    look(watch, clock)
    assert [row.name for row in watch.rows()] == ["a.npy"]


@pytest.mark.parametrize("may_heal", [True, False])
def test_a_point_whose_file_goes_while_it_is_measured_is_forgotten(may_heal, folder, watch, clock):
    for name in ("a.npy", "b.npy"):
        put(folder / name, at=START - 60)
    look(watch, clock)
    for name in ("a.npy", "b.npy"):
        (folder / name).unlink()
    look(watch, clock)
    watch.measured(folder / "a.npy", {"mean_angle_deg": "2.5"})
    watch.failed(folder / "b.npy", "it has gone", may_heal=may_heal)
    assert watch.rows() == []


def test_a_link_that_leads_round_in_a_circle_is_left_to_whoever_opens_it(folder, watch, clock):
    (folder / "a.npy").symlink_to("a.npy")
    clock.seconds = max(0.0, (folder / "a.npy").lstat().st_mtime - START) + 5.0
    assert look(watch, clock) == [("a.npy", False)]


def test_a_folder_that_goes_away_is_told_until_it_is_back(folder, watch, clock):
    folder.rmdir()
    look(watch, clock)
    assert watch.problem == (
        f"{folder}: cannot be read (No such file or directory); is it still there?"
    )
    folder.mkdir()
    look(watch, clock)
    assert watch.problem == ""


def test_the_version_grows_with_each_change_only(folder, watch, clock):
    put(folder / "a.npy", at=START - 60)
    look(watch, clock)
    before = watch.version
    look(watch, clock, 1.0)
    assert watch.version == before
    watch.measured(folder / "a.npy", {})
    assert watch.version > before
