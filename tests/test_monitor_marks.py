"""What the buttons write without a live session."""

import re

import pytest

from glint_aoa.errors import OutputError
from glint_aoa.monitor.marks import FolderControls
from glint_aoa.records.tables import read_csv


def test_a_trigger_is_an_empty_file_that_is_written_once(tmp_path):
    controls = FolderControls(tmp_path, now=lambda: 1_790_000_000.25)
    assert controls.trigger() == "Trigger written at 14:13:20 UTC"
    assert (tmp_path / "trigger").read_bytes() == b""
    sentence = (
        f"{tmp_path / 'trigger'} is there already: nothing has taken the last trigger; is "
        f"glint-aoa live running with --trigger-file {tmp_path / 'trigger'}?"
    )
    with pytest.raises(OutputError, match=re.escape(sentence)):
        controls.trigger()
    (tmp_path / "trigger").unlink()
    controls.trigger()


def test_marks_are_rows_of_a_table(tmp_path):
    times = iter([1_790_000_000.25, 1_790_000_060.5])
    controls = FolderControls(tmp_path, now=lambda: next(times))
    assert controls.shaker_off() == "Shaker off marked at 14:13:20 UTC"
    controls.shaker_off()
    assert read_csv(tmp_path / "marks.csv") == {
        "time": ["2026-09-21T14:13:20.250+00:00", "2026-09-21T14:14:20.500+00:00"],
        "unix_time_s": ["1790000000.250", "1790000060.500"],
        "mark": ["shaker off", "shaker off"],
    }


def test_neither_button_writes_through_a_link(tmp_path):
    (tmp_path / "points").mkdir()
    controls = FolderControls(tmp_path / "points")
    for name in ("trigger", "marks.csv"):
        (tmp_path / "points" / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="is there already"):
        controls.trigger()
    with pytest.raises(OutputError, match=r"marks\.csv is a link and is not followed"):
        controls.shaker_off()
    assert not (tmp_path / "elsewhere").exists()
