"""One record in every format comes back the same; first bytes overrule a suffix that lies."""

import re
import subprocess
import sys
import tracemalloc

import h5py
import nptdms
import numpy as np
import pytest
import pyuff
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from test_formats_uff import data_set

from glint_aoa.errors import RecordingError
from glint_aoa.records import acquisition
from glint_aoa.records.acquisition import AcquisitionRecord, Channel, LazySamples
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.formats import ACQUISITION_SUFFIXES, open_acquisition
from glint_aoa.setup import Inertial

RATE_HZ, START_S = 800.0, -0.05
TIME = START_S + np.arange(400) / RATE_HZ
CHANNELS = {"aoa": np.sin(2 * np.pi * TIME), "ay": 10 * np.cos(2 * np.pi * 9.8 * TIME)}
UNITS = {"aoa": "g_0", "ay": "m/s^2"}
SETUP = Inertial(
    channel=[
        {"name": "aoa", "quantity": "aoa_unfiltered", "units": "g_0", "station": "0.9 m"},
        {"name": "ay", "quantity": "acceleration", "units": "m/s^2", "station": "0.9 m",
         "axis": "+y", "range": ["-9 m/s^2", "9 m/s^2"]},
    ]
)  # fmt: skip


def write_csv(path):
    names = ["time [s]", *(f"{name} [{UNITS[name]}]" for name in CHANNELS)]
    table = np.column_stack([TIME, *CHANNELS.values()])
    np.savetxt(path, table, "%.17g", ",", header=",".join(names), comments="")


def write_tdms(path):
    clock = {"wf_increment": 1 / RATE_HZ, "wf_start_offset": START_S}
    with nptdms.TdmsWriter(path) as writer:
        for name, samples in CHANNELS.items():
            keys = {**clock, "unit_string": "g" if name == "aoa" else "m/s^2"}
            writer.write_segment([nptdms.ChannelObject("das", name, samples, keys)])


def write_uff(path):
    sets = [
        data_set(samples, x=TIME, rsp_ent_name=name, ordinate_axis_units_lab=UNITS[name])
        for name, samples in CHANNELS.items()
    ]
    pyuff.UFF(str(path)).write_sets(sets, "add")


def write_mat(path):
    scipy.io.savemat(path, {"t": TIME, **CHANNELS}, format="5")


def write_h5(path):
    with h5py.File(path, "w", track_order=True) as file:
        group = file.create_group("das", track_order=True)
        for name, samples in CHANNELS.items():
            group[name] = samples
            group[name].attrs.update(rate_hz=RATE_HZ, start_s=START_S, units=UNITS[name])


WRITERS = {"csv": write_csv, "tdms": write_tdms, "uff": write_uff, "mat": write_mat, "h5": write_h5}
every = pytest.mark.parametrize("kind", WRITERS)


def assert_is_the_record(record):
    assert list(record.channels) == ["aoa", "ay"]
    for name, samples in CHANNELS.items():
        channel = record[name]
        assert (channel.rate_hz, channel.units) == (RATE_HZ, UNITS[name])
        assert channel.start_s == pytest.approx(START_S)
        np.testing.assert_allclose(channel.samples, samples, atol=2e-10)  # UFF text: 12 digits


@every
def test_every_format_gives_the_same_record(tmp_path, kind):
    path = tmp_path / f"p.{kind}"
    WRITERS[kind](path)
    record = open_acquisition(path, SETUP)
    assert_is_the_record(record)
    ay = record["ay"]
    assert (record.name, ay.axis, ay.station_m, ay.limits) == ("p", "+y", 0.9, (-9.0, 9.0))
    expected = np.abs(CHANNELS["ay"]) >= 9 * (1 - 2**-15)
    np.testing.assert_array_equal(ay.clipped, expected)


@every
@pytest.mark.parametrize("suffix", [".csv", ".h5", ".bin", ""])
def test_the_content_overrules_the_suffix(tmp_path, kind, suffix):
    path = tmp_path / f"p{suffix}"
    WRITERS[kind](path)
    says_nothing_of_itself = kind == "csv" and suffix != ".csv"
    if says_nothing_of_itself:
        with pytest.raises(RecordingError, match=r"not an HDF5 file|suffix, expected|suffix \.bin"):
            open_acquisition(path, SETUP)
        return
    assert_is_the_record(open_acquisition(path, SETUP))


@pytest.mark.parametrize("suffix", ["", ".doc"])
def test_an_unknown_suffix_names_those_that_are_known(tmp_path, suffix):
    path = tmp_path / f"p{suffix}"
    path.write_text("words")
    found = f"suffix {suffix}" if suffix else "no suffix"
    sentence = f"{path}: {found}, expected one of {', '.join(ACQUISITION_SUFFIXES)}; convert"
    with pytest.raises(RecordingError, match="^" + re.escape(sentence)):
        open_acquisition(path)


@pytest.mark.parametrize("suffix", ACQUISITION_SUFFIXES)
def test_missing_and_empty_files_are_one_sentence(tmp_path, suffix):
    path = tmp_path / f"p{suffix}"
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: no such file; check")):
        open_acquisition(path)
    path.touch()
    with pytest.raises(RecordingError, match="^" + re.escape(f"{path}: an empty file; check")):
        open_acquisition(path)


@pytest.mark.parametrize(
    ("unit", "known"),
    [("g", "g_0"), ("G", "g_0"), ("Volts", "V"), ("m/s²", "m/s^2"), ("in-lbs", "lbf*in"),
     ("°C", "degC"), ("(mm)", "mm"), ("NONE", None), ("parsnip", "parsnip")],
)  # fmt: skip
def test_units_of_acquisition_systems(tmp_path, unit, known):
    path = tmp_path / "p.tdms"
    with nptdms.TdmsWriter(path) as writer:
        keys = {"wf_increment": 1.0, "unit_string": unit}
        writer.write_segment([nptdms.ChannelObject("g", "x", np.arange(3.0), keys)])
    channel = open_acquisition(path)["x"]
    assert channel.units == known
    if known == "parsnip":
        with pytest.raises(
            RecordingError, match="channel x: 'parsnip' is not a unit that is known"
        ):
            channel.values("V")


@settings(max_examples=60)
@given(data=st.data(), kind=st.sampled_from(sorted(WRITERS)))
def test_mutated_files_give_a_record_or_our_own_error(tmp_path_factory, data, kind):
    path = tmp_path_factory.mktemp("fuzz") / f"p.{kind}"
    WRITERS[kind](path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, min(len(content), 4000) - 1))] = data.draw(
            st.integers(0, 255)
        )
    path.write_bytes(content[: data.draw(st.integers(len(content) // 2, len(content)))])
    complaints = []
    try:
        record = open_acquisition(path, SETUP)
        assert all(len(channel.samples[0:10]) for channel in record.channels.values())
    except RecordingError as error:
        complaints.append(str(error))
    assert all(complaint.startswith(f"{path}: ") for complaint in complaints)


# Long records


def test_a_long_point_is_read_stretch_by_stretch(tmp_path):
    """Eight hours of two channels, of which a segment takes its own memory and no more."""
    size = 8 * 3600 * 800
    path = tmp_path / "long.h5"
    samples = np.zeros(size, np.int16)
    samples[size // 2 : size // 2 + 1000] = np.arange(1000)
    with h5py.File(path, "w") as file:
        for name, quantity in (("aoa", "aoa_unfiltered"), ("ay", "acceleration")):
            data = file.create_dataset(
                f"das/{name}", data=samples, chunks=(1 << 16,), compression=1
            )
            data.attrs.update(rate_hz=800.0, quantity=quantity, units="g_0", scale=1e-4)
    tracemalloc.start()
    try:
        record = prepared(open_acquisition(path))
        part = record.segment(size // 2 + 10, size // 2 + 20)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert isinstance(record["ay"].samples, LazySamples)
    assert part["ay"].samples.tolist() == list(range(10, 20))
    assert part["ay"].start_s == pytest.approx(4 * 3600 + 10 / 800)
    assert peak < 4 << 20


def test_counting_goes_block_by_block(monkeypatch):
    monkeypatch.setattr(acquisition, "BLOCK", 7)
    taken = []

    def read(start, stop):
        taken.append(stop - start)
        return np.arange(start, stop)

    lazy = Channel("ay", LazySamples(30, np.dtype(int), read), 800.0, limits=(0.0, 25.0))
    clipped = [start + int(k) for start, b in lazy.blocks() for k in np.flatnonzero(b.clipped)]
    assert clipped == [0, 25, 26, 27, 28, 29]
    assert max(taken) == 7


def test_lazy_samples_are_like_an_array():
    samples = LazySamples(5, np.dtype(np.int16), lambda a, b: np.arange(a, b, dtype=np.int16))
    assert (len(samples), samples.size, samples.ndim, samples.shape) == (5, 5, 1, (5,))
    assert samples[1:-1].tolist() == [1, 2, 3]
    assert samples[4:2].tolist() == []
    np.testing.assert_array_equal(np.asarray(samples, np.float64), np.arange(5.0))
    with pytest.raises(IndexError, match=re.escape("a step of 2; read every sample and thin")):
        samples[::2]
    with pytest.raises(ValueError, match="cannot be had without a copy"):
        np.asarray(samples, copy=False)


def test_segments_put_together_are_the_record():
    rng = np.random.default_rng(2)
    channels = {
        "aoa": Channel("aoa", rng.normal(size=100), 800.0, -1.0, "aoa_unfiltered"),
        "warm": Channel("warm", np.arange(13.0), 100.0, -1.0, "temperature"),
        "late": Channel("late", np.arange(3.0), 100.0, 5.0, "temperature"),
    }
    record = AcquisitionRecord("p", channels, {"run": 3})
    parts = [record.segment(start, start + 17) for start in range(0, 100, 17)]
    for name in ("aoa", "warm"):
        joined = np.concatenate([part[name].samples for part in parts if name in part.channels])
        np.testing.assert_array_equal(joined, channels[name].samples)
        times = np.concatenate([part[name].time_s for part in parts if name in part.channels])
        np.testing.assert_allclose(times, channels[name].time_s, atol=1e-12)
    assert all("late" not in part.channels and part.meta == {"run": 3} for part in parts)
    with pytest.raises(RecordingError, match=r"^p: no channels; check that they were recorded$"):
        AcquisitionRecord("p", {}).package_clock()


def test_libraries_of_single_formats_load_when_they_are_used():
    code = (
        "import sys, glint_aoa.records.formats; "
        "print([m for m in ('nptdms', 'pyuff', 'pandas', 'scipy.io') if m in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
