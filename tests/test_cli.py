import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic import line_fields

from glint_aoa.cli import _common, main
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, read_truth, write_point

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [99.5, 118]
position = ["0 m", "-56 in", "0 mm"]

[[inertial.mode]]
number = 1
plane = "yaw"
frequency = "9.8 Hz"
radius = "31 in"
"""
IN_PLANE = '[fields]\nrate = "60 Hz"\n'
CAMPAIGN = """
name = "tiny"
start = 2026-01-12T08:00:00
n_fields = 2
duration = "0.5 s"

[[sweep]]
name = "sweep"
first = "-1 deg"
last = "1 deg"
points = 2
"""
RATE_HZ, SECONDS = 200.0, 16.0
COMMANDS = {
    "demo": "glint-aoa demo --out glint-aoa-demo",
    "init": "glint-aoa init --from point-01.h5 --camera 752x240 --set glint.nose=left",
    "doctor": "glint-aoa doctor --folder results",
    "inspect": "glint-aoa inspect point-01.h5 --setup glint-aoa.toml --png point-01.png",
    "process": "glint-aoa process run-01/*.h5 --setup glint-aoa.toml --out results",
    "batch": "glint-aoa batch points --setup glint-aoa.toml --out results --memory 4GB",
    "calibrate": "glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml",
    "calibrate camera": (
        "glint-aoa calibrate camera board-*.png --board chessboard:9x6:30mm -s glint-aoa.toml"
    ),
    "calibrate resect": (
        "glint-aoa calibrate resect targets.csv --measured image.csv --setup glint-aoa.toml"
    ),
    "calibrate sweep": (
        "glint-aoa calibrate sweep sweep-*.h5 --setup glint-aoa.toml --out sweep.toml"
    ),
    "calibrate check": (
        "glint-aoa calibrate check check-*.h5 --setup glint-aoa.toml --sweep sweep.toml"
    ),
    "convert": ('glint-aoa convert clip.avi --channels clip.tdms --offset "12.5 ms" --out points'),
    "correct": "glint-aoa correct point-01.h5 --setup glint-aoa.toml --out corrected",
    "fuse": "glint-aoa fuse point-01.h5 --setup glint-aoa.toml --out fused",
    "benchmark": "glint-aoa benchmark points/*.h5 --setup glint-aoa.toml --out results",
    "benchmark inertial": "glint-aoa benchmark inertial --out results",
    "benchmark figures": (
        "glint-aoa benchmark figures points/*.h5 --setup glint-aoa.toml --out figures"
    ),
    "plan": "glint-aoa plan glint-aoa.toml --out plan",
    "report": "glint-aoa report results --jobs 4",
    "monitor": ("glint-aoa monitor run-01 --setup glint-aoa.toml --live http://127.0.0.1:8765"),
    "simulate": "glint-aoa simulate demo --out points --jobs 2",
    "twist": "glint-aoa twist wind-off.h5 wind-on.h5 --targets targets.csv --reference body",
    "uncertainty": "glint-aoa uncertainty glint-aoa.toml --angles -6,0,6 --out budget",
}

RUN_ALONE = ("demo", "init", "doctor", "benchmark inertial")
"""Commands that need no arguments."""


def channels(rng, angle_deg, shake):
    """A package and one accelerometer on a model that yaws about a point 31 in behind it."""
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    pulse = 2 * np.pi * 9.8
    yaw_rate = shake * pulse * np.cos(pulse * time_s)
    centripetal = 31 * 0.0254 * yaw_rate**2 / 9.80665
    aoa = np.sin(np.radians(angle_deg)) - centripetal + rng.normal(0, 1e-5, time_s.size)
    ay = -31 * 0.0254 * shake * pulse**2 * np.sin(pulse * time_s) + rng.normal(0, 1e-3, time_s.size)
    return AcquisitionRecord(
        "das",
        {
            c.name: c
            for c in (
                Channel("aoa", aoa, RATE_HZ, quantity="aoa_unfiltered", units="g_0"),
                Channel(
                    *("ay_face", ay, RATE_HZ),
                    quantity="acceleration",
                    units="m/s^2",
                    station_m=0.9,
                    axis="+y",
                ),
            )
        },
    )


def record(path, angle_deg, *, run, shake=0.0, dark=False, seed=0):
    rng = np.random.default_rng(seed)
    fields = line_fields(
        rng,
        n_fields=8,
        shape=(40, 200),
        row=20.0,
        slope=np.tan(np.radians(angle_deg)) * 11.7 / 27.5,
        peak=0.0 if dark else 170.0,
    )
    meta = {
        "run": run,
        "point": path.stem,
        "excitation": "yaw sine 9.8 Hz" if shake else "off",
        "nominal_angle_deg": angle_deg,
    }
    write_point(
        path,
        RecordedPoint(
            fields=fields,
            info=FieldInfo(rate_hz=60.0, exposure_s=1e-3, first_line=98, interlaced=False),
            acquisition=channels(rng, angle_deg, shake),
            meta=meta,
        ),
    )


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    """Folder with a sweep of four angles, a run of three points, and what is wrong with others."""
    folder = tmp_path_factory.mktemp("points")
    for number, angle in enumerate((-3.0, -1.0, 1.0, 3.0)):
        record(folder / f"sweep-{number}.h5", angle, run="sweep", seed=number)
    for number, shake in enumerate((0.0, 0.002, 0.0)):
        record(folder / f"run-{number}.h5", 0.0, run="run", shake=shake, seed=10 + number)
    record(folder / "dark.h5", 0.0, run="run", dark=True)
    whole = (folder / "run-0.h5").read_bytes()
    for name, gone in (("no-fields", "fields"), ("no-das", "das"), ("no-meta", "meta")):
        (folder / f"{name}.h5").write_bytes(whole)
        with h5py.File(folder / f"{name}.h5", "a") as file:
            del file[gone]
    (folder / "text.h5").write_text("not HDF5\n")
    (folder / "cut.h5").write_bytes(whole[: len(whole) // 2])
    (folder / "nothing.npy").write_bytes(b"")
    np.save(folder / "empty.npy", np.zeros((0, 40, 200), np.uint8))
    level = line_fields(np.random.default_rng(0), n_fields=4, shape=(40, 200), row=20.0)
    np.save(folder / "line.npy", level)
    (folder / "points.doc").write_text("a letter\n")
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder with a setup, in which the program runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("GLINT_AOA_DEBUG", "")
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    return tmp_path


@pytest.fixture
def glint_aoa(here, monkeypatch, capsys):
    """Run the program as its console script does; returns exit code, stdout and stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["glint-aoa", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return end.value.code or 0, out, err

    return run


def written(folder):
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


# What a newcomer sees.


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_each_command_shows_an_example_on_a_line_of_its_own(glint_aoa, command):
    code, out, err = glint_aoa(*command.split(), "--help")
    assert (code, err) == (0, "")
    assert f"  Example: {COMMANDS[command]}\n" in out


@pytest.mark.parametrize("command", ["", *(name for name in COMMANDS if name not in RUN_ALONE)])
def test_a_command_without_arguments_shows_its_help(glint_aoa, command):
    code, out, err = glint_aoa(*command.split())
    assert code == 2
    assert "Example: " in out + err
    assert "Options:" in out + err


def test_the_version_is_printed(glint_aoa):
    from glint_aoa import __version__

    assert glint_aoa("--version") == (0, f"glint-aoa {__version__}\n", "")


def test_a_command_that_is_none_is_named(glint_aoa):
    code, out, err = glint_aoa("measure")
    assert (code, out) == (2, "")
    assert "No such command 'measure'" in err


# What the commands print and write.


def test_process_prints_the_means_and_writes_the_results(glint_aoa, here, points):
    code, out, err = glint_aoa("process", points / "sweep-0.h5", points / "run-0.h5", "-o", "res")
    assert (code, err) == (0, "")
    assert out.splitlines()[0].split("  ")[0] == "point"
    assert [line.split()[:2] for line in out.splitlines()[1:3]] == [
        ["sweep-0", "8/8"],
        ["run-0", "8/8"],
    ]
    assert float(out.splitlines()[1].split()[2]) == pytest.approx(-3, abs=0.01)
    assert max(map(len, out.splitlines())) <= 90
    assert written(here / "res") == [
        "log.csv",
        "run-0.csv",
        "run-0.nc",
        "sweep-0.csv",
        "sweep-0.nc",
    ]


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["process", "run-0.h5", "-o", "res"], "mean_angle_deg"),
        (["correct", "run-1.h5", "-o", "res"], "mean_bias_deg"),
        (["inspect", "run-0.h5"], "angle_deg"),
        (["calibrate", "sweep", *(f"sweep-{k}.h5" for k in range(4)), "-o", "s.toml"], "degree"),
        (["benchmark", *(f"run-{k}.h5" for k in range(3)), "-o", "res"], "table4"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_json_is_all_that_is_on_stdout(glint_aoa, points, arguments, key):
    arguments = [points / each if each.endswith(".h5") else each for each in arguments]
    code, out, _ = glint_aoa(*arguments, "--json")
    result = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert code == 0
    assert key in (result[0] if isinstance(result, list) else result)


def test_json_has_null_where_nothing_was_measured(glint_aoa, points):
    code, out, _ = glint_aoa("process", points / "dark.h5", "-o", "res", "--json")
    assert code == 0
    assert json.loads(out)[0]["mean_angle_deg"] is None


def test_inspect_says_what_a_recording_holds(glint_aoa, here, points):
    code, out, err = glint_aoa("inspect", points / "run-1.h5", "--png", "field.png")
    said = dict(re.findall(r"^(\S.*?)  +(.*)$", out, re.MULTILINE))
    assert (code, err) == (0, "")
    assert said["fields"] == "8"
    assert said["rate [Hz]"] == "60"
    assert said["glint found"] == "yes"
    assert re.fullmatch(r"[\d.]+ to [\d.]+", said["glint rows"])
    assert said["flags"].startswith("UNCALIBRATED: ")
    assert said["channels"] == "aoa [g_0] 3200 at 200 Hz"
    assert (here / "field.png").read_bytes().startswith(b"\x89PNG")
    before = (here / "field.png").read_bytes()
    code, out, err = glint_aoa("inspect", points / "run-1.h5", "--png", "field.png")
    assert (code, out) == (2, "")
    assert err == (
        "glint-aoa: field.png is there already; give another --out, or --overwrite to replace it\n"
    )
    assert (here / "field.png").read_bytes() == before


def test_inspect_of_a_dark_recording_finds_no_glint(glint_aoa, points):
    code, out, _ = glint_aoa("inspect", points / "dark.h5")
    assert code == 0
    assert re.search(r"^glint found +no$", out, re.MULTILINE)
    assert "nan" not in out


def test_calibrate_sweep_says_how_to_apply_the_calibration(glint_aoa, here, points):
    sweep = [points / f"sweep-{number}.h5" for number in range(4)]
    code, out, _ = glint_aoa("calibrate", "sweep", *sweep, "-o", "cal/sweep.toml")
    assert code == 0
    assert 'To apply it, add to glint-aoa.toml:\n\n[calibration]\nsweep = "cal/sweep.toml"\n' in out
    assert written(here / "cal") == ["sweep.png", "sweep.toml"]
    with (here / "glint-aoa.toml").open("a") as file:
        file.write('[calibration]\nsweep = "cal/sweep.toml"\n')
    code, out, err = glint_aoa("process", points / "sweep-3.h5", "-o", "res")
    assert (code, err) == (0, "")
    assert float(out.splitlines()[1].split()[2]) == pytest.approx(3, abs=0.001)


def with_a_gap(path, to):
    """Copy a point and lose three samples of its package's output."""
    to.write_bytes(path.read_bytes())
    with h5py.File(to, "a") as file:
        file["das/aoa"][5000:5003] = np.nan
    return to


def test_sweep_and_benchmark_bridge_what_correct_bridges(glint_aoa, here, points):
    sweep = [points / f"sweep-{number}.h5" for number in range(4)]
    sweep[1] = with_a_gap(sweep[1], here / "sweep-1.h5")
    assert glint_aoa("calibrate", "sweep", *sweep, "-o", "cal/sweep.toml")[0] == 0
    run = [points / f"run-{number}.h5" for number in range(3)]
    run[1] = with_a_gap(run[1], here / "run-1.h5")
    code, out, _ = glint_aoa("benchmark", *run, "-o", "res")
    assert code == 0
    assert re.search(r"^yaw +inertial corrected +[+-]0\.00", out, re.MULTILINE)


def test_correct_takes_the_bias_out_and_counts_the_rows_flagged(glint_aoa, here, points):
    code, out, err = glint_aoa("correct", points / "run-1.h5", "-o", "res", "--strict")
    name, raw, corrected, bias, _ = out.splitlines()[1].split()
    assert (code, name) == (0, "run-1")
    assert abs(float(raw)) > 0.03
    assert float(corrected) == pytest.approx(0, abs=0.002)
    assert float(bias) == pytest.approx(float(raw) - float(corrected), abs=2e-4)
    assert re.search(r"^run-1: FILTER_SETTLING \(\d+ of 320 rows\): the low-pass", err)
    header = (here / "res/run-1.csv").read_text().partition("\n")[0]
    assert header == "time_s,angle_deg,angle_std_deg,raw_angle_deg,bias_deg,flags"


def without_fields(path, to):
    """Copy a point as a single record of the channels."""
    to.write_bytes(path.read_bytes())
    with h5py.File(to, "a") as file:
        del file["fields"]
        file["meta"].attrs["run_kind"] = "record"
    return to


def test_benchmark_prints_table_4_and_leaves_sweeps_and_single_records_out(glint_aoa, here, points):
    given = [
        *(points / f"run-{k}.h5" for k in range(3)),
        *(points / f"sweep-{k}.h5" for k in (0, 1)),
        without_fields(points / "run-1.h5", here / "single.h5"),
    ]
    code, out, err = glint_aoa("benchmark", *given, "-o", "res")
    assert code == 0
    assert err == "left out: 3 points of a pitch sweep or of no run\n"
    assert re.search(r"^yaw +inertial corrected +[+-]0\.00", out, re.MULTILINE)
    assert "\n\nRepeatability with the shaker off" in out
    assert max(map(len, out.splitlines()[:-1])) <= 100
    assert {"errors.csv", "table4.csv", "repeatability.csv", "errors-against-moment.png"} < set(
        written(here / "res")
    )
    assert "sweep-0.csv" not in written(here / "res")


def test_simulate_writes_a_campaign_that_process_and_inspect_read(glint_aoa, here):
    (here / "tiny.toml").write_text(CAMPAIGN)
    assert glint_aoa("simulate", "tiny.toml", "-o", "sim") == (0, "Wrote 2 points to sim\n", "")
    assert written(here / "sim") == ["sweep-01.h5", "sweep-02.h5"]
    assert read_truth(here / "sim/sweep-02.h5")["pitch_deg"] == pytest.approx(1.0)
    before = (here / "sim/sweep-01.h5").read_bytes()
    assert glint_aoa("simulate", "tiny.toml", "-o", "sim") == (
        2,
        "",
        "glint-aoa: sim/sweep-01.h5 is there already; "
        "give another --out, or --overwrite to replace it\n",
    )
    assert (here / "sim/sweep-01.h5").read_bytes() == before
    assert glint_aoa("inspect", "sim/sweep-01.h5")[0] == 0


def test_a_bar_is_drawn_on_a_terminal_only(monkeypatch, capsys):
    with _common.bar(3) as advance:
        advance(3, "point-01")
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with _common.bar(3) as advance:
        advance(3, "point-01")
    out, err = capsys.readouterr()
    assert out == ""
    assert "point-01" in err


# Fields without a glint are a result.


def test_a_stack_without_a_glint_gives_flagged_rows_with_empty_cells(glint_aoa, here, points):
    code, out, err = glint_aoa("process", points / "dark.h5", "-o", "res")
    assert code == 0
    assert out.splitlines()[1].split() == ["dark", "0/8", "-", "-", "-", "-"]
    assert "dark: NO_GLINT (8 of 8 fields): no glint was found; nothing was measured\n" in err
    assert "dark: FEW_FIELDS: fewer than half of the fields could be used\n" in err
    rows = (here / "res/dark.csv").read_text().splitlines()
    assert len(rows) == 9
    assert all(row.split(",")[3] == "" and int(row.split(",")[-1]) & 1 for row in rows[1:])


@pytest.mark.parametrize(("point", "code"), [("dark", 3), ("run-0", 0)])
def test_strict_tells_flagged_results_by_the_exit_code(glint_aoa, points, point, code):
    assert glint_aoa("process", points / f"{point}.h5", "-o", "res", "--strict")[0] == code


def test_benchmark_names_a_point_without_a_glint(glint_aoa, points):
    given = points / "run-0.h5", points / "dark.h5", points / "run-1.h5", points / "run-2.h5"
    code, _, err = glint_aoa("benchmark", *given, "-o", "res", "--strict")
    assert code == 3
    assert "dark: NO_GLINT: no glint was found; nothing was measured\n" in err


# Bad input: one sentence, exit code 2, and nothing is lost.


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("gone.h5", "no such file; check its name and folder"),
        (
            "",
            "a folder, expected PNG or TIFF pictures in it, .*, found none; give the recording .*",
        ),
        ("nothing.npy", "an empty file; check that the recording was saved"),
        ("text.h5", "not an HDF5 file or damaged (.*); record or copy it again"),
        ("cut.h5", "not an HDF5 file or damaged (.*); record or copy it again"),
        ("empty.npy", "the stack is empty .*; check that the recording was saved"),
        ("points.doc", r"suffix \.doc, expected one of \.h5, .*; convert the recording or .*"),
        ("no-fields.h5", "no dataset /fields, found das, meta; store the fields as .*"),
    ],
)
@pytest.mark.parametrize("command", ["process", "calibrate sweep", "benchmark", "inspect"])
def test_a_recording_that_cannot_be_used_is_one_sentence(
    glint_aoa, here, points, command, name, sentence
):
    path = points / name
    target = {"calibrate sweep": ["-o", "s.toml"], "inspect": []}.get(command, ["-o", "res"])
    code, out, err = glint_aoa(*command.split(), path, *target)
    if (command, name) == ("inspect", "no-fields.h5"):  # an acquisition record is shown as such
        assert (code, err) == (0, "")
        return
    assert (code, out) == (2, "")
    pattern = sentence.replace("(.*)", r"\(.*\)")
    assert re.fullmatch(f"glint-aoa: {re.escape(str(path))}: {pattern}\n", err)
    assert written(here) == ["glint-aoa.toml"]


def test_a_bad_point_does_not_keep_the_others_from_being_measured(glint_aoa, here, points):
    given = points / "run-0.h5", points / "cut.h5", points / "run-2.h5"
    code, out, err = glint_aoa("process", *given, "-o", "res")
    assert code == 2
    assert [line.split()[0] for line in out.splitlines()[1:3]] == ["run-0", "run-2"]
    assert err.count("\n") == 1
    assert err.startswith(f"glint-aoa: {points / 'cut.h5'}: ")
    log = (here / "res/log.csv").read_text().splitlines()
    assert [line.split(",")[1] for line in log] == ["point", "run-0", "run-2"]
    assert written(here / "res") == ["log.csv", "run-0.csv", "run-0.nc", "run-2.csv", "run-2.nc"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "glint-aoa.toml: no such setup file; give one with --setup"),
        (
            SETUP.replace("focal_length", "focal_lenght"),
            "glint-aoa.toml: unknown key camera.focal_lenght; did you mean focal_length?",
        ),
        (
            SETUP.replace("35 mm", "35 kg"),
            "glint-aoa.toml: camera.focal_length: '35 kg' is not a quantity in m",
        ),
        ("a setup", "glint-aoa.toml: not a TOML file: .*"),
        (
            '[calibration]\nsweep = "gone.toml"\n',
            "gone.toml: no such pitch sweep; make one with glint-aoa calibrate sweep",
        ),
    ],
    ids=["missing", "key", "unit", "not TOML", "sweep missing"],
)
def test_a_setup_that_cannot_be_used_is_named_once(glint_aoa, here, points, text, sentence):
    (here / "glint-aoa.toml").unlink()
    if text is not None:
        (here / "glint-aoa.toml").write_text(text)
    code, out, err = glint_aoa("process", points / "run-0.h5", points / "run-2.h5", "-o", "res")
    assert (code, out) == (2, "")
    assert re.fullmatch(f"glint-aoa: {sentence.replace('?', '[?]')}\n", err)
    assert not (here / "res").exists()


def test_a_file_without_a_rate_asks_for_it_in_the_setup(glint_aoa, here, points):
    (here / "glint-aoa.toml").write_text("")
    code, _, err = glint_aoa("process", points / "line.npy", "-o", "res")
    assert code == 2
    assert "the file does not say its field rate; give fields.rate in the setup\n" in err
    (here / "glint-aoa.toml").write_text(IN_PLANE)
    code, _, err = glint_aoa("process", points / "line.npy", "-o", "res")
    assert code == 0
    assert err == (
        "line: UNCALIBRATED (4 of 4 fields): "
        "no camera in the setup: the angle is that of the image plane\n"
    )


@pytest.mark.parametrize("command", ["process", "correct", "benchmark", "simulate"])
def test_a_file_where_the_results_should_go_is_left_alone(glint_aoa, here, points, command):
    (here / "file").write_text("mine")
    given = "demo" if command == "simulate" else points / "run-0.h5"
    assert glint_aoa(command, given, "-o", "file/res") == (
        2,
        "",
        f"glint-aoa: {here / 'file'}: a file, expected a folder for results; give another --out\n",
    )
    assert (here / "file").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_may_not_be_written_to_is_said_at_once(glint_aoa, here, points):
    (here / "locked").mkdir(mode=0o500)
    assert glint_aoa("process", points / "run-0.h5", "-o", "locked") == (
        2,
        "",
        "glint-aoa: locked: no permission to write there; "
        "give another --out or change its permissions\n",
    )


@pytest.mark.parametrize("command", ["process", "correct"])
def test_results_are_not_replaced_unless_asked_for(glint_aoa, here, points, command):
    point = points / "run-0.h5"
    assert glint_aoa(command, point, "-o", "res")[0] == 0
    (here / "res/run-0.csv").touch()
    before = (here / "res/run-0.csv").read_bytes()
    assert glint_aoa(command, point, "-o", "res") == (
        2,
        "",
        "glint-aoa: res/run-0.csv is there already; "
        "give another --out, or --overwrite to replace it\n",
    )
    assert (here / "res/run-0.csv").read_bytes() == before
    assert glint_aoa(command, point, "-o", "res", "--overwrite")[0] == 0


def test_correct_never_replaces_the_optical_results(glint_aoa, here, points):
    glint_aoa("process", points / "run-0.h5", "-o", "res")
    before = (here / "res/run-0.csv").read_bytes()
    assert glint_aoa("correct", points / "run-0.h5", "-o", "res", "--overwrite") == (
        2,
        "",
        "glint-aoa: res/run-0.csv is there already and holds no correction; give another --out\n",
    )
    assert (here / "res/run-0.csv").read_bytes() == before


@pytest.mark.parametrize("command", ["process", "correct", "benchmark", "calibrate sweep"])
def test_a_point_given_twice_is_refused(glint_aoa, here, points, command):
    target = "s.toml" if command == "calibrate sweep" else "res"
    point = points / "run-0.h5"
    assert glint_aoa(*command.split(), point, point, "-o", target, "--overwrite") == (
        2,
        "",
        f"glint-aoa: {point} is given twice; give each file once\n",
    )
    assert written(here) == ["glint-aoa.toml"]


def test_points_whose_results_would_replace_each_other_are_refused(glint_aoa, here, points):
    one, other = points / "run-0.h5", points / "run-0.npy"
    assert glint_aoa("process", one, other, "-o", "res", "--overwrite") == (
        2,
        "",
        f"glint-aoa: {one} and {other} are both called run-0, and so would be their results; "
        "give one of them, or each another --out\n",
    )
    assert glint_aoa("process", "log.h5", "-o", "res") == (
        2,
        "",
        "glint-aoa: log.h5: its results would take the name of log.csv, a table of all points; "
        "rename the file\n",
    )


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("gone.h5", "no such file; check its name and folder"),
        ("no-das.h5", "no group /das.*"),
        ("text.h5", r"not an HDF5 file or damaged \(.*\); record or copy it again"),
    ],
)
def test_correct_names_a_record_that_it_cannot_use(glint_aoa, here, points, name, sentence):
    code, out, err = glint_aoa("correct", points / name, points / "run-1.h5", "-o", "res")
    assert code == 2
    assert out.splitlines()[1].startswith("run-1 ")
    assert re.search(f"^glint-aoa: {re.escape(str(points / name))}: {sentence}$", err, re.MULTILINE)
    assert written(here / "res") == ["run-1.csv"]


def test_correct_without_modes_says_where_to_list_them(glint_aoa, here, points):
    (here / "glint-aoa.toml").write_text("")
    code, out, err = glint_aoa("correct", points / "run-1.h5", "-o", "res", "--method", "modal")
    assert (code, out) == (2, "")
    assert "list each vibration mode as [[inertial.mode]] in the setup" in err


def test_correct_needs_no_setup_file_to_say_what_a_method_lacks(glint_aoa, here, points):
    (here / "glint-aoa.toml").unlink()
    assert glint_aoa("correct", points / "run-1.h5", "-o", "corrected", "--method", "modal") == (
        2,
        "",
        "glint-aoa: run-1: the modal correction lacks modes: list each vibration mode as "
        "[[inertial.mode]] in the setup\n",
    )
    code, out, _ = glint_aoa("correct", points / "run-1.h5", "-o", "corrected")
    assert code == 0
    assert "chosen automatically" in out


@pytest.mark.parametrize("option", ["--gain-std", "--misalignment-std"])
def test_correct_refuses_an_uncertainty_that_is_none(glint_aoa, points, option):
    assert glint_aoa("correct", points / "run-1.h5", "-o", "res", option, "-1") == (
        2,
        "",
        f"glint-aoa: {option} is -1; give an uncertainty of zero or more\n",
    )


def test_correct_is_as_certain_as_the_gains(glint_aoa, points):
    def std(*options):
        code, out, _ = glint_aoa(
            "correct", points / "run-1.h5", "-o", "res", "--json", "--overwrite", *options
        )
        assert code == 0
        return json.loads(out)[0]["mean_angle_std_deg"]

    assert std("--method", "modal", "--gain-std", "5") > std("--method", "modal")


@pytest.mark.parametrize("rate", ["-1", "0", "nan", "1e9"])
def test_correct_refuses_a_rate_that_is_none(glint_aoa, points, rate):
    assert glint_aoa("correct", points / "run-1.h5", "-o", "res", "--rate", rate) == (
        2,
        "",
        f"glint-aoa: --rate is {float(rate):g}; give rows a second, above 0 and at most 100000\n",
    )


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (["sweep-0"], "a pitch sweep needs at least 3 points at different angles, got 1; measure"),
        (
            ["sweep-0", "sweep-1", "dark"],
            "dark.h5: no field could be measured; leave the point out",
        ),
        (["sweep-0", "sweep-1", "no-das"], "no-das.h5: no group /das"),
    ],
)
def test_a_sweep_that_cannot_be_fitted_writes_nothing(glint_aoa, here, points, names, sentence):
    given = [points / f"{name}.h5" for name in names]
    code, out, err = glint_aoa("calibrate", "sweep", *given, "-o", "sweep.toml")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert sentence in err
    assert written(here) == ["glint-aoa.toml"]


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        (
            "there.toml",
            "there.png is there already; give another --out, or --overwrite to replace it",
        ),
        ("sweep.png", "sweep.png: a calibration is a TOML file; end its name with .toml"),
        (
            "glint-aoa.toml",
            "glint-aoa.toml is the setup itself; give the calibration another name",
        ),
    ],
)
def test_where_a_sweep_goes_is_looked_at_before_it_is_measured(
    glint_aoa, here, points, out, sentence
):
    (here / "there.png").write_text("mine")
    options = [] if out.startswith("there") else ["--overwrite"]
    given = [points / f"sweep-{number}.h5" for number in range(3)]
    code, stdout, err = glint_aoa("calibrate", "sweep", *given, "-o", out, *options)
    assert (code, stdout, err) == (2, "", f"glint-aoa: {sentence}\n")
    assert written(here) == ["glint-aoa.toml", "there.png"]
    assert (here / "glint-aoa.toml").read_text() == SETUP


def test_benchmark_needs_points_of_runs(glint_aoa, here, points):
    single = without_fields(points / "run-1.h5", here / "single.h5")
    code, _, err = glint_aoa("benchmark", single, "-o", "res")
    assert code == 2
    assert err.endswith("all points are single records; give the points of runs at one angle\n")


def test_correct_needs_no_fields(glint_aoa, here, points):
    single = without_fields(points / "run-1.h5", here / "single.h5")
    code, out, _ = glint_aoa("correct", single, "-o", "res")
    assert code == 0
    assert float(out.splitlines()[1].split()[2]) == pytest.approx(0, abs=0.002)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (
            ["run-0", "run-1"],
            "run run: the last point must have the shaker off, point run-1 has yaw sine 9.8 Hz; "
            "add that point or leave the run out",
        ),
        (
            ["run-0"],
            "run run: one point only, a run starts and ends with the shaker off; "
            "add its other points or leave the run out",
        ),
        (
            ["sweep-0", "sweep-1"],
            "all points are of a pitch sweep (sweep: its nominal angle changes); "
            "give the points of runs at one angle",
        ),
        (["run-0", "run-1", "no-das"], "no-das.h5: no group /das"),
        (["run-0", "run-1", "no-meta"], "no-meta.h5: /meta does not say run, point, excitation; "),
    ],
)
def test_benchmark_looks_at_all_points_before_it_measures_one(
    glint_aoa, here, points, names, sentence
):
    given = [points / f"{name}.h5" for name in names]
    code, out, err = glint_aoa("benchmark", *given, "-o", "res")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert sentence in err
    assert not (here / "res").exists()


def test_benchmark_does_not_start_where_a_result_is_in_its_way(glint_aoa, here, points):
    (here / "res").mkdir()
    given = [points / f"run-{number}.h5" for number in range(3)]
    for name in ("table4.csv", "run-2.nc"):
        (here / "res" / name).write_text("mine")
        code, _, err = glint_aoa("benchmark", *given, "-o", "res")
        assert (code, err) == (
            2,
            f"glint-aoa: res/{name} is there already; "
            "give another --out, or --overwrite to replace it\n",
        )
        assert written(here / "res") == [name]
        (here / "res" / name).unlink()


def test_demo_does_not_replace_a_setup_that_it_finds(glint_aoa, here):
    assert glint_aoa("demo", "--out", ".") == (
        2,
        "",
        "glint-aoa: glint-aoa.toml is there already; "
        "give another --out, or --overwrite to replace it\n",
    )
    assert (here / "glint-aoa.toml").read_text() == SETUP


@pytest.mark.parametrize(
    ("campaign", "sentence"),
    [
        ("test", "no campaign is called test; choose paper, demo or a TOML file"),
        ("glint-aoa.toml", "glint-aoa.toml: unknown key camera; .*"),
        ("gone.toml", "gone.toml: no such file.*"),
    ],
)
def test_simulate_names_a_campaign_that_it_cannot_use(glint_aoa, here, campaign, sentence):
    code, out, err = glint_aoa("simulate", campaign, "-o", "sim")
    assert (code, out) == (2, "")
    assert re.fullmatch(f"glint-aoa: {sentence}\n", err)
    assert not (here / "sim").exists()


# How errors of the program and interrupts end.


def test_an_error_of_the_program_is_one_sentence_without_debug(glint_aoa, points, monkeypatch):
    from glint_aoa import process

    def broken(*_, **__):
        raise ZeroDivisionError("of the test")

    monkeypatch.setattr(process, "process_point", broken)
    code, out, err = glint_aoa("process", points / "run-0.h5", "-o", "res")
    assert (code, out) == (1, "")
    assert err == (
        "glint-aoa: an error of the program itself (ZeroDivisionError: of the test); "
        "run it again with --debug and report what it prints\n"
    )


@pytest.mark.usefixtures("here")
def test_debug_lets_the_error_through(monkeypatch):
    from glint_aoa.errors import RecordingError

    monkeypatch.setattr(sys, "argv", ["glint-aoa", "--debug", "inspect", "gone.h5"])
    with pytest.raises(RecordingError, match=re.escape("gone.h5: no such file")):
        main()


PROGRAM = [sys.executable, "-c", "from glint_aoa.cli import main; main()"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


# A shell's background job ignores interrupts, and so would what the tests start in one.
INTERRUPTIBLE = [
    sys.executable,
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from glint_aoa.cli import main; main()",
]


def test_an_interrupt_keeps_what_was_written(here, points):
    many = [here / f"copy-{number:03d}.h5" for number in range(80)]
    for path in many:
        path.symlink_to(points / "run-0.h5")
    running = subprocess.Popen(
        [*INTERRUPTIBLE, "process", *map(str, many), "-o", "res"],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + 60
    while not (here / "res/copy-001.csv").exists() and time.monotonic() < end:
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out) == (130, "")
    assert err.strip() == "glint-aoa: stopped; what was written before is whole"
    rows = (here / "res/log.csv").read_text().splitlines()
    assert rows
    assert all(row.count(",") == rows[0].count(",") for row in rows)
    assert not [name for name in written(here / "res") if name.endswith(".part")]


def test_an_interrupt_in_a_callback_is_not_lost():
    swallowed = (
        "import signal, time, typer, weakref; from glint_aoa.cli import app as program\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell may ignore it
        "class Thing: pass\n"
        "def swallow(_): raise KeyboardInterrupt\n"
        "def work():\n"
        "    thing = Thing(); reference = weakref.ref(thing, swallow); del thing\n"
        "    for _ in range(600): time.sleep(0.1)\n"
        "    print('worked on')\n"
        "program.app = typer.Typer(); program.app.command()(work); program.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", swallowed],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.strip() == "glint-aoa: stopped; what was written before is whole"


def test_the_program_runs_as_a_process_of_its_own(here):
    done = subprocess.run(
        [*PROGRAM, "inspect", "gone.h5"],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "glint-aoa: gone.h5: no such file; check its name and folder\n"
