"""A live session: which fields make a point, what is lost, and that process measures the same."""

import gc
import re
import threading
from concurrent.futures import Future
from dataclasses import replace

import h5py
import numpy as np
import pytest
from live_fields import (
    Collected,
    Fed,
    angle_deg,
    info_of,
    running,
    setup_of,
    some_fields,
    until,
)

from glint_aoa.errors import InputError, OutputError, RecordingError, SetupError
from glint_aoa.flags import Flag
from glint_aoa.live.schooling import Schooling
from glint_aoa.live.session import PointLength, Session
from glint_aoa.live.sources import Replay
from glint_aoa.process import measure_point
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import open_fields
from glint_aoa.records.recording import resolve_recording


@pytest.fixture(autouse=True)
def _as_compiled(monkeypatch):
    """What has been compiled for one test need not be warmed up for the next."""
    monkeypatch.setattr("glint_aoa.live.schooling.warm_up", lambda _: True)


@pytest.fixture(scope="module")
def fields():
    return some_fields()


def came(session, number):
    until(lambda: session.state().reading is not None and session.state().reading.index >= number)


def test_a_point_is_the_fields_before_the_trigger_and_those_after(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=7, post=5) as session:
        source.feed(*range(20))
        came(session, 19)
        assert session.trigger() == "live-0001"
        assert session.state().point == "live-0001"
        assert not session.state().armed
        with pytest.raises(InputError, match=r"^point live-0001 is being recorded; trigger again"):
            session.trigger()
        source.feed(*range(20, 30))
        came(session, 29)
        until((tmp_path / "live-0001.h5").exists)
        assert session.state().armed
    stack = open_fields(tmp_path / "live-0001.h5")
    np.testing.assert_array_equal(stack.read(0, 99), fields[13:25])
    # The trigger fell after field 19 had come, not a whole field later unless the machine slept.
    assert stack.info.start_s <= -6 / 60
    assert stack.info.rate_hz == 60.0
    assert stack.meta["point"] == "live-0001"
    points = {reading.index: reading.point for reading in session.collected.readings}
    assert [points[k] for k in (19, 20, 24, 25)] == [None, "live-0001", "live-0001", None]
    assert session.collected.closed
    assert source.closed


@pytest.mark.parametrize("first_parity", ["even", "odd"])
def test_a_point_begins_with_the_parity_of_its_first_field(first_parity, tmp_path):
    source = Fed(
        some_fields(interlaced=True), info=info_of(interlaced=True, first_parity=first_parity)
    )
    with running(source, tmp_path, pre=6, post=4) as session:
        source.feed(*range(11))
        came(session, 10)
        session.trigger("a")
        source.feed(*range(11, 20))
        until((tmp_path / "a.h5").exists)
    # Its first field is field 5, of the other parity than field 0.
    other = {"even": "odd", "odd": "even"}[first_parity]
    assert open_fields(tmp_path / "a.h5").info.first_parity == other


def test_a_trigger_soon_after_the_start_takes_what_there_is(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=30, post=4) as session:
        source.feed(0, 1, 2)
        came(session, 2)
        session.trigger("early")
        source.feed(*range(3, 9))
        until((tmp_path / "early.h5").exists)
    np.testing.assert_array_equal(open_fields(tmp_path / "early.h5").read(0, 99), fields[:7])


def test_a_session_that_ends_writes_the_point_as_far_as_it_came(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=5, post=100) as session:
        source.feed(*range(12))
        came(session, 11)
        session.trigger("cut")
        source.feed(12, 13, 14)
        came(session, 14)
        session.stop()
        session.thread.join()
    stack = open_fields(tmp_path / "cut.h5")
    np.testing.assert_array_equal(stack.read(0, 99), fields[7:15])
    assert [each.name for each in tmp_path.iterdir()] == ["cut.h5"]


def test_lost_fields_are_counted_and_stand_in_the_point_as_copies(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=4, post=8) as session:
        source.feed(*range(10))
        came(session, 9)
        session.trigger("gap")
        source.feed(10, 11, 14, 15, *range(17, 24))
        came(session, 23)
        until((tmp_path / "gap.h5").exists)
        assert session.state().lost == 3
        assert session.state().fields == 21
    stack = open_fields(tmp_path / "gap.h5")
    expected = fields[[6, 7, 8, 9, 10, 11, 11, 11, 14, 15, 15, 17]]
    np.testing.assert_array_equal(stack.read(0, 99), expected)
    assert stack.meta["fields_lost"] == "6, 7, 10"
    flagged = {
        reading.index for reading in session.collected.readings if reading.flags & Flag.DROPPED
    }
    assert flagged == {14, 17}
    values = measure_point(stack, setup_of()).values
    repeated = (values["flags"] & int(Flag.REPEATED)) > 0
    assert np.flatnonzero(repeated).tolist() == [6, 7, 10]


def test_fields_that_are_written_over_before_they_are_measured_are_lost(fields, tmp_path):
    source, held = Fed(fields), threading.Event()
    with running(source, tmp_path, pre=0, post=1) as session:
        source.feed(0)
        came(session, 0)
        ring = session._pipeline.ring
        measure = session._pipeline.measurer.measure

        def slow(*what, **how):
            held.wait()
            return measure(*what, **how)

        session._pipeline.measurer.measure = slow
        n = 2 * ring.capacity
        source.feed(*range(1, n + 1))
        until(lambda: ring.newest == n)
        held.set()
        came(session, n)
        state = session.state()
    seen = {reading.index for reading in session.collected.readings}
    assert state.lost == n + 1 - len(seen)
    assert state.lost > 0


def test_the_live_angle_is_that_of_process_to_the_bit_where_it_learns_from_the_same(tmp_path):
    fields = some_fields(40, interlaced=True, slope=np.linspace(0.010, 0.012, 40))
    stack = FieldStack.from_array(fields, info_of(interlaced=True, first_parity="even"))
    setup = setup_of()
    collected = Collected()
    source = Replay(stack, name="replay", rate_hz=60.0)
    session = Session(
        source, setup, tmp_path, length=lambda _: PointLength(1, 1), outputs=[collected]
    )
    state = session.run()
    expected = measure_point(stack, setup)
    assert (state.fields, state.lost) == (40, 0)
    for name in ("angle_deg", "intercept_mm", "flags"):
        found = [getattr(reading, name) for reading in collected.readings]
        np.testing.assert_array_equal(found, expected.values[name])
    used = [reading.n_columns for reading in collected.readings]
    np.testing.assert_array_equal(used, expected.values["columns_used"])
    np.testing.assert_allclose(
        [reading.time_s for reading in collected.readings], expected.values["time_s"], rtol=1e-12
    )


def test_a_point_recorded_live_has_process_s_angles(tmp_path):
    source = Fed(some_fields(260), known=False)
    setup = setup_of()
    with running(source, tmp_path, setup=setup, pre=30, post=30, relearn_s=0.0) as session:
        source.feed(*range(128))
        came(session, 127)
        session.trigger("p")
        source.feed(*range(128, 160))
        until((tmp_path / "p.h5").exists)
        mean, std, n = session.state().angle_deg
    result = measure_point(open_fields(tmp_path / "p.h5"), setup)
    live = {reading.index: reading for reading in session.collected.readings}
    difference = [live[98 + k].angle_deg - a for k, a in enumerate(result.values["angle_deg"])]
    u95 = np.array([live[98 + k].u95_deg for k in range(60)])
    # Learnt from other fields: the columns' usual departures carry another noise.
    assert np.abs(difference / u95).max() < 0.5
    assert n == 60
    assert abs(mean - result.log["mean_angle_deg"]) < result.log["mean_angle_u95_deg"]
    assert std == pytest.approx(result.log["std_angle_deg"], rel=0.1)
    # The first second was measured too, once the glint was learnt: no latency is told of it.
    assert sorted(live) == list(range(160))
    assert np.isnan(live[0].latency_ms)


def test_the_stated_interval_holds_the_truth(tmp_path):
    truth = np.linspace(0.005, 0.015, 200)
    source = Fed(some_fields(200, slope=truth))
    with running(source, tmp_path) as session:
        source.feed(*range(200))
        came(session, 199)
    found = session.collected.readings
    off = [abs(reading.angle_deg - angle_deg(truth[reading.index])) for reading in found]
    u95 = np.array([reading.u95_deg for reading in found])
    outside = np.count_nonzero(off > u95)
    assert outside <= 20  # of 200 at 95 %: 10, and 3 standard deviations of that
    assert (np.array(off) < 2.5 * u95).all()


def test_a_glint_that_is_gone_is_told_and_found_again_elsewhere(tmp_path):
    shown = some_fields(70, row=18.0)
    hidden = np.full((40, *shown.shape[1:]), 10, np.uint8)
    moved = some_fields(100, seed=3, row=45.0)
    source = Fed(np.concatenate([shown, hidden, moved]))
    with running(source, tmp_path) as session:
        source.feed(*range(210))
        came(session, 209)
    flags = np.array([reading.flags for reading in session.collected.readings])
    angles = np.array([reading.angle_deg for reading in session.collected.readings])
    assert ((flags[70:110] & int(Flag.NO_GLINT)) > 0).all()
    assert np.isnan(angles[70:110]).all()
    assert abs(np.median(angles[110:]) - angle_deg(0.011)) < 0.005


def test_a_folder_that_cannot_be_written_to_is_tried_again(fields, tmp_path, monkeypatch):
    written = []

    def full(path, *_, **__):
        written.append(path)
        raise OutputError(f"{path}: cannot be written (No space left on device); make room")

    monkeypatch.setattr("glint_aoa.live.points.write_point", full)
    source = Fed(fields)
    with running(source, tmp_path) as session:
        source.feed(*range(20))
        came(session, 19)
        session.trigger("a")
        source.feed(*range(20, 40))
        came(session, 39)
        until(lambda: bool(written))
        source.feed(*range(40, 60))
        came(session, 59)  # the measurement goes on
        session.stop()
        session.thread.join()
    assert len(written) >= 2
    sentence = f"{tmp_path / 'a.h5'}: cannot be written (No space left on device); make room"
    assert f"{sentence}; it is tried again" in session.told
    assert [str(error) for error in session.errors] == [sentence]


def test_room_made_in_time_saves_the_point(fields, tmp_path, monkeypatch):
    from glint_aoa.live import points

    monkeypatch.setattr(points, "_AGAIN_S", 0.01)
    out = tmp_path / "not yet"
    source = Fed(fields)
    with running(source, out) as session:
        source.feed(*range(20))
        came(session, 19)
        session.trigger("a")
        source.feed(*range(20, 40))
        until(lambda: any("tried again" in text for text in session.told))
        out.mkdir()
        until((out / "a.h5").exists)
    assert session.errors == []
    assert len(open_fields(out / "a.h5")) == 20


@pytest.mark.parametrize("name", ["../a", "", ".a", "a/b", "a b", "x" * 101, "a\n"])
def test_names_that_cannot_be_files_are_refused(name, fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path) as session:
        source.feed(0)
        came(session, 0)
        with pytest.raises(InputError, match=re.escape("a name starts with a letter or digit")):
            session.trigger(name)


def test_a_name_is_used_once(fields, tmp_path):
    (tmp_path / "there.h5").write_bytes(b"precious")
    (tmp_path / "live-0001.h5").write_bytes(b"precious")
    source = Fed(fields)
    with running(source, tmp_path, pre=1, post=1) as session:
        source.feed(0)
        came(session, 0)
        with pytest.raises(InputError, match=r"^point there is in .* already; give another name$"):
            session.trigger("there")
        assert session.trigger() == "live-0002"
        source.feed(1)
        until((tmp_path / "live-0002.h5").exists)
    assert (tmp_path / "there.h5").read_bytes() == b"precious"


def test_no_trigger_before_the_first_field(fields, tmp_path):
    session = Session(Fed(fields), setup_of(), tmp_path, length=lambda _: PointLength(1, 1))
    with pytest.raises(InputError, match=r"^no field comes yet; trigger while the source runs$"):
        session.trigger()
    assert session.state().learning
    assert session.newest_field() is None


def test_shaker_off_is_marked_in_the_point_or_the_next(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=2, post=2) as session:
        source.feed(0, 1)
        came(session, 1)
        session.mark_shaker_off()
        assert session.state().shaker_off
        session.trigger("off")
        source.feed(2, 3)
        until((tmp_path / "off.h5").exists)
        session.trigger("turned")
        assert not session.state().shaker_off
        session.mark_shaker_off()
        source.feed(4, 5)
        until((tmp_path / "turned.h5").exists)
    with h5py.File(tmp_path / "off.h5") as file:
        assert file["meta"].attrs["shaker_off_s"] == 0.0
    with h5py.File(tmp_path / "turned.h5") as file:
        assert file["meta"].attrs["shaker_off_s"] >= 0.0


def test_the_shaker_is_off_from_the_first_mark_on(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=1, post=2) as session:
        source.feed(0)
        came(session, 0)
        session.mark_shaker_off()
        session.trigger("a")
        session.mark_shaker_off()
        source.feed(1, 2)
        until((tmp_path / "a.h5").exists)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["meta"].attrs["shaker_off_s"] == 0.0


def test_a_lesson_waits_for_the_end_of_the_point(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=1, post=4) as session:
        source.feed(0)
        came(session, 0)
        pipeline = session._pipeline
        schooling = Schooling(
            source,
            setup_of(),
            resolve_recording(source.stack, setup_of()),
            teacher=None,
            relearn_s=0.0,
            sweep=None,
            temperature_k=None,
            tell=print,
        )
        before = pipeline.measurer.learnt
        schooling._lesson = Future()
        schooling._lesson.set_result(replace(before, found=True))
        schooling.attend(pipeline, busy=True)
        assert pipeline.measurer.learnt is before
        schooling.attend(pipeline, busy=False)
        assert pipeline.measurer.learnt is not before


def test_a_trigger_at_the_very_end_is_written_or_refused(fields, tmp_path, monkeypatch):
    """The end comes while a trigger is at work: its point is waited for."""
    from glint_aoa.live import recorders

    source, at_work, may = Fed(fields), threading.Event(), threading.Event()
    free_name = recorders.free_name

    def slowly(*what):
        at_work.set()
        may.wait()
        return free_name(*what)

    monkeypatch.setattr(recorders, "free_name", slowly)
    with running(source, tmp_path, pre=3, post=5) as session:
        source.feed(*range(8))
        came(session, 7)
        trigger = threading.Thread(target=session.trigger)
        trigger.start()
        at_work.wait()
        source.end()
        until(session._pipeline.ended.is_set)
        assert session.thread.is_alive()
        may.set()
        trigger.join()
        session.thread.join()
    assert len(open_fields(tmp_path / "live-0001.h5")) == 3


def test_a_source_that_breaks_off_says_so_and_the_point_is_saved(fields, tmp_path):
    source = Fed(fields)
    with running(source, tmp_path, pre=3, post=50) as session:
        source.feed(*range(10))
        came(session, 9)
        session.trigger("a")
        source.end(RecordingError("camera 0: gives no more pictures; check its cable"))
        session.thread.join()
    assert str(session.errors[0]) == "camera 0: gives no more pictures; check its cable"
    assert len(open_fields(tmp_path / "a.h5")) == 3


def test_what_was_kept_from_the_collector_is_given_back(fields, tmp_path):
    with running(Fed(fields), tmp_path) as session:
        until(lambda: gc.get_freeze_count() > 0)
        session.stop()
        session.thread.join()
    assert gc.get_freeze_count() == 0


def test_source_and_setup_that_differ_are_refused(fields, tmp_path):
    source = Fed(fields)
    setup = setup_of(fields={"rate": "50 Hz"})
    session = Session(source, setup, tmp_path, length=lambda _: PointLength(1, 1))
    with pytest.raises(SetupError, match=r"the file says rate 60\.0, the setup fields\.rate 50\.0"):
        session.run()
    assert source.closed


@pytest.mark.parametrize(
    ("pre", "post", "expected"),
    [
        (80_000, 1, "--pre: a ring of 80240 fields takes 1.9 GB of memory; give fewer fields"),
        (1, 80_200, "--post: a point of 80201 fields takes 1.9 GB of memory; give fewer fields"),
    ],
)
def test_what_is_beyond_memory_is_refused(pre, post, expected, fields, tmp_path, monkeypatch):
    monkeypatch.setattr("glint_aoa.live.session._MOST_BYTES", 1_923_000_000)
    session = Session(Fed(fields), setup_of(), tmp_path, length=lambda _: PointLength(pre, post))
    with pytest.raises(InputError, match=f"^{re.escape(expected)}$"):
        session.run()


def test_what_is_learnt_from_must_show_the_same_window(fields, tmp_path):
    teacher = FieldStack.from_array(fields[:, :50], info_of())
    session = Session(
        Fed(fields), setup_of(), tmp_path, length=lambda _: PointLength(1, 1), teacher=teacher
    )
    with pytest.raises(RecordingError, match=r"learn from a recording of the same window$"):
        session.run()
