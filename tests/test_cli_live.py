"""``glint-aoa live`` as its users run it: replay, triggers, readings, clean ends."""

import json
import os
import re
import signal
import threading

import pytest
from live_fields import SHAPE, info_of, some_fields, until

from glint_aoa.records.formats import open_fields
from glint_aoa.records.points import RecordedPoint, write_point

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
position = ["0 m", "-56 in", "60 mm"]
"""


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """A recording of six seconds, and a setup beside it."""
    monkeypatch.setattr("glint_aoa.live.schooling.warm_up", lambda _: True)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    write_point(tmp_path / "run.h5", RecordedPoint(fields=some_fields(90), info=info_of()))
    return tmp_path


@pytest.fixture
def later():
    """Do something once something is there, beside the program."""
    threads = []

    def start(there, work):
        def run():
            until(there)
            work()

        threads.append(threading.Thread(target=run))
        threads[-1].start()

    yield start
    for thread in threads:
        thread.join()


def test_a_recording_is_replayed_and_measured(program, recorded):
    code, out, err = program("live", "run.h5", "--no-readings", "--json")
    assert code == 0
    told = json.loads(out)
    assert (told["fields"], told["lost"]) == (90, 0)
    assert told["latency_ms"]["p50"] > 0
    assert re.search(
        r"^90 fields, 0 lost; from arrival to angle \d+\.\d+ ms in the middle", err, re.M
    )
    assert list((recorded / "live").iterdir()) == []


def test_readings_go_to_stdout_as_lines_of_json(recorded, capfd, monkeypatch):
    import sys

    from glint_aoa.cli import main

    monkeypatch.setattr(sys, "argv", ["glint-aoa", "live", "run.h5", "--readings"])
    with capfd.disabled(), (recorded / "out.jsonl").open("wb") as file:
        before = os.dup(1)
        os.dup2(file.fileno(), 1)
        monkeypatch.setattr(sys, "stdout", open(1, "w", closefd=False))  # noqa: SIM115
        try:
            with pytest.raises(SystemExit) as ended:
                main()
        finally:
            os.dup2(before, 1)
            os.close(before)
    assert (ended.value.code or 0) == 0
    readings = [json.loads(line) for line in (recorded / "out.jsonl").read_text().splitlines()]
    assert [each["index"] for each in readings] == list(range(90))
    assert all(each["flags"] == [] for each in readings)


def begun(recorded):
    return (recorded / "live").exists


def test_signals_trigger_and_end(program, recorded, later):
    def trigger_until_there():
        while not (recorded / "live" / "live-0001.h5").exists():
            os.kill(os.getpid(), signal.SIGUSR1)
            threading.Event().wait(0.05)
        os.kill(os.getpid(), signal.SIGTERM)

    keep = [signal.signal(each, signal.SIG_IGN) for each in (signal.SIGUSR1, signal.SIGTERM)]
    try:
        later(begun(recorded), trigger_until_there)
        code, _, err = program("live", "run.h5", "--no-readings", "--pre", "3", "--post", "0.05 s")
    finally:
        for each, handler in zip((signal.SIGUSR1, signal.SIGTERM), keep, strict=True):
            signal.signal(each, handler)
    assert code == 0
    assert "point live-0001: triggered, " in err
    assert "live/live-0001.h5: written, " in err
    assert open_fields(recorded / "live" / "live-0001.h5").shape[1:] == SHAPE
    process = program("process", "live/live-0001.h5", "--out", "results", "--json")
    assert process[0] == 0
    assert json.loads(process[1])[0]["run"] == "live"


def test_a_file_triggers_and_names_the_point(program, recorded, later):
    trigger = recorded / "trigger"

    def write():
        while not (recorded / "live" / "seven.h5").exists():
            trigger.write_text("seven\n")
            threading.Event().wait(0.05)

    later(begun(recorded), write)
    code, _, err = program(
        "live", "run.h5", "--no-readings", "--trigger-file", trigger, "--pre", "2", "--post", "2"
    )
    assert code == 0
    assert "point seven: triggered, " in err
    assert (recorded / "live" / "seven.h5").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run.h5", "--pre", "x"], '--pre x: expected a number of fields, or seconds as "0.5 s"'),
        (["run.h5", "--post", "0"], "--post 0: comes to 0 fields; give at least 1"),
        (
            ["run.h5", "--http", "0", "--listen", "tunnel-pc"],
            "--listen is tunnel-pc; give an IP address of this machine, or 0.0.0.0 for all",
        ),
        (
            ["run.h5", "--udp", "x", "--no-readings"],
            "--udp x: expected HOST:PORT, such as 192.168.0.7:5005",
        ),
        (
            ["97"],
            "camera 97: there is no /dev/video97; list the cameras with ls /dev/video*, or check "
            "the cable",
        ),
        (["run.h5", "--setup", "no.toml"], "no.toml: no such setup file; give one with --setup"),
        (
            ["run.h5", "--out", "run.h5"],
            "run.h5: a file, expected a folder for results; give another --out",
        ),
    ],
)
def test_what_cannot_be_done_ends_in_one_sentence(program, recorded, arguments, expected):
    code, out, err = program("live", *arguments)
    assert code == 2
    assert out == ""
    assert err == f"glint-aoa: {expected}\n"


def test_epics_without_p4p_names_the_extra(program, recorded, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "p4p.nt", None)
    code, _, err = program("live", "run.h5", "--epics", "X", "--no-readings")
    assert code == 2
    assert err.endswith(
        "--epics needs p4p, which is not installed; install it with: "
        'pip install "glint-aoa[epics]"\n'
    )
