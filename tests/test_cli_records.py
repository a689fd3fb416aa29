"""``correct`` and ``inspect`` on acquisition records of every format."""

import json
import re

import h5py
import nptdms
import numpy as np
import pytest
import pyuff
import scipy.io
from test_formats_uff import data_set

from glint_aoa.flags import Flag

RATE_HZ, SECONDS = 800.0, 24.0
SETUP = """
[[inertial.channel]]
name = "aoa"
quantity = "aoa_unfiltered"
units = "g_0"

[[inertial.channel]]
name = "ay"
quantity = "acceleration"
units = "m/s^2"
axis = "+y"
range = ["-90 m/s^2", "90 m/s^2"]

[[inertial.mode]]
number = 1
plane = "yaw"
frequency = "9.8 Hz"
radius = "31 in"
"""


def vibration():
    """A package at 2 deg on a model that yaws about a point 31 in behind it."""
    rng = np.random.default_rng(4)
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    pulse, radius, shake = 2 * np.pi * 9.8, 31 * 0.0254, 3e-3
    yaw_rate = shake * pulse * np.cos(pulse * time_s)
    aoa = np.sin(np.radians(2.0)) - radius * yaw_rate**2 / 9.80665
    ay = -radius * shake * pulse**2 * np.sin(pulse * time_s)
    noise = rng.normal(size=(2, time_s.size))
    return time_s, {"aoa": aoa + 1e-5 * noise[0], "ay": ay + 1e-3 * noise[1]}


TIME_S, CHANNELS = vibration()


def write_csv(path, channels, time_s):
    table = np.column_stack([time_s, *channels.values()])
    np.savetxt(path, table, "%.12g", ";", header=";".join(["time", *channels]), comments="")


def write_tdms(path, channels, time_s):
    keys = {"wf_increment": 1 / RATE_HZ}
    with nptdms.TdmsWriter(path) as writer:
        for name, samples in channels.items():
            writer.write_segment([nptdms.ChannelObject("das", name, samples, keys)])


def write_uff(path, channels, time_s):
    sets = [
        data_set(samples, x=time_s, rsp_ent_name=name, ordinate_axis_units_lab="NONE")
        for name, samples in channels.items()
    ]
    pyuff.UFF(str(path)).write_sets(sets, "add")


def write_mat(path, channels, time_s):
    scipy.io.savemat(path, {"t": time_s, **channels})


def write_h5(path, channels, time_s):
    with h5py.File(path, "w") as file:
        for name, samples in channels.items():
            file[f"das/{name}"] = samples
            file[f"das/{name}"].attrs["rate_hz"] = RATE_HZ


WRITERS = {"csv": write_csv, "tdms": write_tdms, "uff": write_uff, "mat": write_mat, "h5": write_h5}


@pytest.fixture
def program(program, monkeypatch, tmp_path):
    """Run the command line beside a setup file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    return program


def corrected(path):
    return np.genfromtxt(path, delimiter=",", names=True)


@pytest.mark.parametrize("kind", WRITERS)
def test_correct_takes_every_format(program, tmp_path, kind):
    WRITERS[kind](tmp_path / f"p.{kind}", CHANNELS, TIME_S)
    code, _, err = program("correct", f"p.{kind}", "-o", "out")
    assert code == 0, err
    rows = corrected(tmp_path / "out" / "p.csv")
    settled = (rows["flags"].astype(int) & Flag.FILTER_SETTLING) == 0
    assert np.abs(rows["raw_angle_deg"][settled] - 2.0).max() > 0.05
    assert np.abs(rows["angle_deg"][settled] - 2.0).max() < 2e-3


def corrected_with_a_gap(program, tmp_path, name):
    samples = CHANNELS[name].copy()
    samples[round(12 * RATE_HZ) : round(12 * RATE_HZ) + 3] = np.nan
    write_csv(tmp_path / "gap.csv", {**CHANNELS, name: samples}, TIME_S)
    code, _, err = program("correct", "gap.csv", "-o", "out")
    assert code == 0, err
    return corrected(tmp_path / "out" / "gap.csv")


@pytest.mark.parametrize("name", CHANNELS)
def test_correct_bridges_a_short_gap(program, tmp_path, name):
    rows = corrected_with_a_gap(program, tmp_path, name)
    settled = (rows["flags"].astype(int) & Flag.FILTER_SETTLING) == 0
    assert np.abs(rows["angle_deg"][settled] - 2.0).max() < 2e-3


@pytest.mark.parametrize("name", CHANNELS)
def test_correct_flags_where_it_bridged(program, tmp_path, name):
    rows = corrected_with_a_gap(program, tmp_path, name)
    bridged = (rows["flags"].astype(int) & Flag.GAP) > 0
    assert bridged[np.abs(rows["time_s"] - 12.0) < 0.1].all()
    assert not bridged[(rows["time_s"] < 6) | (rows["time_s"] > 18)].any()


def test_correct_brings_two_clocks_together(program, tmp_path):
    """The accelerometer of another system: 1000 samples a second, an eighth of a sample late."""
    late = (np.arange(int(SECONDS * 1000)) + 0.125) / 1000
    pulse, radius, shake = 2 * np.pi * 9.8, 31 * 0.0254, 3e-3
    ay = -radius * shake * pulse**2 * np.sin(pulse * late)
    with nptdms.TdmsWriter(tmp_path / "p.tdms") as writer:
        for name, samples, keys in (
            ("aoa", CHANNELS["aoa"], {"wf_increment": 1 / RATE_HZ}),
            ("ay", ay, {"wf_increment": 1e-3, "wf_start_offset": late[0]}),
        ):
            writer.write_segment([nptdms.ChannelObject("das", name, samples, keys)])
    code, _, err = program("correct", "p.tdms", "-o", "out")
    assert code == 0, err
    rows = corrected(tmp_path / "out" / "p.csv")
    settled = (rows["flags"].astype(int) & Flag.FILTER_SETTLING) == 0
    assert np.abs(rows["angle_deg"][settled] - 2.0).max() < 2e-3


def test_correct_refuses_a_long_gap_by_name(program, tmp_path):
    samples = CHANNELS["ay"].copy()
    samples[8000:8800] = np.nan
    write_csv(tmp_path / "p.csv", {**CHANNELS, "ay": samples}, TIME_S)
    code, out, err = program("correct", "p.csv", "-o", "out")
    assert (code, out) == (2, "")
    assert err == (
        "glint-aoa: p: channel ay has no samples from 10.000 s to 11.000 s; gaps are bridged up to "
        "0.01 s, cut the record to a stretch without it\n"
    )


@pytest.mark.parametrize("kind", WRITERS)
def test_inspect_shows_the_channels_of_every_format(program, tmp_path, kind):
    samples = CHANNELS["ay"].copy()
    samples[100:102] = 95.0
    if kind != "uff":  # text of a universal file cannot say that a number is missing
        samples[500:504] = np.nan
    WRITERS[kind](tmp_path / f"p.{kind}", {**CHANNELS, "ay": samples}, TIME_S)
    code, out, err = program("inspect", f"p.{kind}", "--setup", "glint-aoa.toml")
    assert (code, err) == (0, "")
    lines = [line.strip() for line in out.splitlines()]
    assert re.fullmatch(r"channels +aoa \[g_0\] 19200 at 800 Hz", lines[1])
    missing = "" if kind == "uff" else ", 4 missing (up to 0.005 s on end)"
    assert lines[2] == f"ay [m/s^2] 19200 at 800 Hz, 2 clipped{missing}"
    code, out, _ = program("inspect", f"p.{kind}", "--setup", "glint-aoa.toml", "--json")
    ay = json.loads(out)["channels"][1]
    assert (ay["name"], ay["axis"], ay["range"], ay["clipped"]) == ("ay", "+y", [-90.0, 90.0], 2)


def test_inspect_has_no_picture_of_a_record_without_fields(program, tmp_path):
    write_tdms(tmp_path / "p.tdms", CHANNELS, TIME_S)
    code, out, err = program("inspect", "p.tdms", "--png", "p.png")
    assert (code, out) == (2, "")
    assert err == "glint-aoa: p.tdms: no fields to show; leave out --png\n"
