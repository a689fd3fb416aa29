"""Many points at once on one machine."""

import json
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from batches import N_FIELDS, contents, serial_batch, write_fields
from shared_work import measure_or_die

from glint_aoa.batch import Sizing, open_store, points_in, process_batch
from glint_aoa.batch.point import Split, measure_into, measure_or_split
from glint_aoa.batch.sizing import memory_bytes
from glint_aoa.batch.store import FolderStore, UrlStore
from glint_aoa.errors import InputError, MissingLibraryError, OutputError, RecordingError
from glint_aoa.records.fields import BLOCK_BYTES
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import Fields
from glint_aoa.workers import Workers, processors


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("serial")
    paths, setup = serial_batch(folder, 5)
    return folder, paths, setup


@pytest.fixture(scope="module")
def pair():
    with Workers(2) as workers:
        yield workers


@pytest.fixture
def here():
    """Do the work in this process."""
    with Workers() as workers:
        yield workers


def run(paths, setup, out, pool, measure=measure_into, **how):
    store = open_store(str(out))
    measure = partial(measure, setup=setup, store=store)
    return process_batch(paths, setup, store, pool, measure, **how)


def test_results_are_those_of_a_serial_run_to_the_bit(serial, tmp_path, pair):
    folder, paths, setup = serial
    seen, told = [], []
    result = run(
        paths,
        setup,
        tmp_path / "out",
        pair,
        partial(measure_into, threads=2, block_bytes=2 * 40 * 120),
        progress=seen.append,
        told=lambda name, row: told.append((name, row["n_fields"])),
    )
    assert contents(tmp_path / "out") == contents(folder / "serial")
    assert sorted(seen) == paths
    assert told == [(path.stem, N_FIELDS) for path in paths]
    assert len(result.flags) == 5
    assert result.failures == result.without_fields == result.finished == []


def test_a_point_whose_process_dies_is_tried_once_more_and_then_listed(serial, tmp_path, pair):
    folder, paths, setup = serial
    once, twice = tmp_path / "died", "p3.h5"
    die = partial(measure_or_die, once={"p1.h5": once}, always=twice)
    result = run(paths, setup, tmp_path / "out", pair, die)
    assert once.exists()
    ((path, why),) = result.failures
    assert path == paths[3]
    assert why.startswith(f"{paths[3]}: two processes died while they worked at it")
    expected = contents(folder / "serial")
    lines = expected["log.csv"].splitlines(keepends=True)
    expected["log.csv"] = b"".join(lines[:4] + lines[5:])
    del expected["p3.csv"], expected["p3.nc"]
    assert contents(tmp_path / "out") == expected


def test_points_that_cannot_be_measured_are_listed_in_order(serial, tmp_path, here):
    folder, paths, setup = serial
    (tmp_path / "bad.h5").write_bytes(b"no HDF5")
    missing = tmp_path / "gone.h5"
    result = run([missing, *paths, tmp_path / "bad.h5"], setup, tmp_path / "out", here)
    assert contents(tmp_path / "out") == contents(folder / "serial")
    assert [path.name for path, _ in result.failures] == ["gone.h5", "bad.h5"]
    assert result.failures[0][1] == f"{missing}: no such file; check its name and folder"


def test_what_no_one_foresaw_is_of_its_point_alone(serial, tmp_path, here):
    _, paths, setup = serial

    def measure(path, **how):
        return measure_into(path, **how) if path != paths[0] else {}["key"]

    result = run(paths, setup, tmp_path / "out", here, measure)
    assert len(result.flags) == 4
    assert result.failures == [
        (
            paths[0],
            f"{paths[0]}: an error of the program itself (KeyError: 'key'); measure it alone with "
            "glint-aoa --debug process and report what that prints",
        )
    ]


def test_records_without_fields_are_left_out(serial, tmp_path, here):
    _, paths, setup = serial
    write_point(tmp_path / "record.h5", RecordedPoint())
    result = run([*paths[:1], tmp_path / "record.h5"], setup, tmp_path / "out", here)
    assert result.without_fields == [tmp_path / "record.h5"]
    assert result.failures == []


def test_results_that_are_there_are_kept_or_replaced(serial, tmp_path, here):
    folder, paths, setup = serial
    out = tmp_path / "out"
    run(paths[:2], setup, out, here)
    (out / "p1.nc").write_bytes(b"")
    result = run(paths[:3], setup, out, here)
    assert [why for _, why in result.failures] == [
        f"{out / name} is there already; give another --out, or --overwrite to replace it"
        for name in ("p0.csv", "p1.csv")
    ]
    assert (out / "p1.nc").read_bytes() == b""
    result = run(paths[:2], setup, out, here, overwrite=True)
    assert result.failures == []
    assert (out / "p1.nc").read_bytes() == (folder / "serial" / "p1.nc").read_bytes()


def test_a_batch_goes_on_where_it_stopped(serial, tmp_path, here):
    folder, paths, setup = serial
    run(paths[:3], setup, tmp_path / "out", here)
    log = tmp_path / "out" / "log.csv"
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:3]))
    result = run(paths, setup, tmp_path / "out", here, resume=True)
    assert result.finished == paths[:2]
    assert len(result.flags) == 3
    assert contents(tmp_path / "out") == contents(folder / "serial")


def test_a_batch_that_is_killed_goes_on_and_loses_nothing(serial, tmp_path, pair):
    folder, paths, setup = serial
    log = tmp_path / "out" / "log.csv"
    what = ["batch", folder / "points", "--setup", folder / "glint-aoa.toml", "--out", log.parent]
    program = "from glint_aoa.cli import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", program, *map(str, what), "--jobs", "1"], stdout=subprocess.DEVNULL
    ) as batch:
        while not log.exists() or log.read_bytes().count(b"\n") < 2:
            assert batch.poll() is None
            time.sleep(0.005)
        batch.kill()
    result = run(paths, setup, tmp_path / "out", pair, resume=True)
    assert result.finished[:1] == paths[:1]
    assert contents(tmp_path / "out") == contents(folder / "serial")


def test_parts_of_a_stack_are_joined_to_the_same_bits(serial, tmp_path):
    folder, paths, setup = serial
    store = FolderStore(tmp_path / "out")
    whole = measure_or_split(paths[0], setup=setup, store=store)
    split = measure_or_split(paths[0], setup=setup, store=store, part_bytes=2 * 40 * 120)
    assert isinstance(split, Split)
    assert len(split.parts) == 5
    (tmp_path / "out" / "p0.nc").unlink()
    learnt = split.first()
    backwards = [part(learnt) for part in reversed(split.parts)]
    assert split.last(learnt, backwards[::-1]) == whole
    for name in ("p0.nc", "p0.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (folder / "serial" / name).read_bytes()


def test_results_at_a_url_are_those_of_a_folder(serial, tmp_path, pair):
    folder, paths, setup = serial
    url = (tmp_path / "out").as_uri()
    assert run(paths[:3], setup, url, pair).failures == []
    assert run(paths, setup, f"{url}/", pair, resume=True).finished == paths[:3]
    assert contents(tmp_path / "out") == contents(folder / "serial")
    other = setup.model_copy(update={"folder": folder, "fields": Fields(rate="50 Hz")})
    message = f"{url}/log.csv: p0 was measured with another setup; give another --out, or"
    with pytest.raises(OutputError, match=re.escape(message)):
        run(paths, other, url, pair, resume=True)


def test_places_that_cannot_be_written_to_are_refused(tmp_path, monkeypatch):
    with pytest.raises(OutputError, match=r"^nosuch://a: .*nosuch.*; give another --out$"):
        open_store("nosuch://a").check()
    (tmp_path / "file").touch()
    url = (tmp_path / "file").as_uri()
    with pytest.raises(OutputError, match=rf"^{url}: cannot be written \(.*\); check the address"):
        open_store(url).check()
    monkeypatch.setitem(sys.modules, "fsspec", None)
    message = (
        's3://a/b: results at a URL need fsspec; install it with: pip install "glint-aoa[cluster]"'
    )
    with pytest.raises(MissingLibraryError, match=re.escape(message)):
        UrlStore("s3://a/b").names()


def test_the_points_of_a_folder(tmp_path):
    for name in (
        "b.h5",
        "a.mraw",
        "a.cihx",
        "lone.cih",
        "log.csv",
        "glint-aoa.toml",
        ".hidden.h5",
        "run/c.npy",
        "run/pictures/1.png",
        "run/pictures/2.png",
        "run/mixed/1.tif",
        "run/mixed/notes.txt",
        ".trash/d.h5",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    names = ["a.mraw", "b.h5", "lone.cih", "run/c.npy", "run/mixed/1.tif", "run/pictures"]
    assert points_in(tmp_path) == [tmp_path / name for name in names]


def test_folders_without_points_are_refused(tmp_path):
    with pytest.raises(
        RecordingError, match=re.escape("no recording in it, expected files of .h5, ")
    ):
        points_in(tmp_path)
    message = f"{tmp_path / 'x'}: no such folder; give the folder that holds the points"
    with pytest.raises(RecordingError, match=re.escape(message)):
        points_in(tmp_path / "x")


def test_memory_in_words():
    assert memory_bytes("4GB") == 4 * 10**9
    assert memory_bytes("512 MiB") == 2**29
    for words in ("lots", "4", "-1 GB", "0 GB", "4 m"):
        message = f"--memory {words}: no amount of memory; write it like 4GB or 512MiB"
        with pytest.raises(InputError, match=re.escape(message)):
            memory_bytes(words)


def test_the_machine_is_divided_among_the_points():
    sizing = Sizing.of_machine(100, jobs=3, memory=48_000_000)
    threads = max(1, processors() // 3)
    assert (sizing.jobs, sizing.memory, sizing.threads) == (3, 48_000_000, threads)
    assert sizing.block_bytes == 1_000_000 // (threads + 1)
    assert Sizing.of_machine(1).jobs == 1
    assert Sizing.of_machine(1).threads == processors()
    assert Sizing.of_machine(10**6).jobs == processors()
    assert Sizing.of_machine(10**6, memory=10**12).block_bytes == BLOCK_BYTES


def test_the_command(serial, tmp_path, program):
    folder, paths, _ = serial
    points = tmp_path / "points"
    points.mkdir()
    for path in paths:
        (points / path.name).hardlink_to(path)
    (points / "p3-bad.h5").write_bytes(b"no HDF5")
    given = [points, "--setup", folder / "glint-aoa.toml", "--out", tmp_path / "out"]
    code, said, told = program("batch", *given, "--memory", "1MB", "--jobs", "2")
    assert code == 2
    assert said == f"Measured 5 of 6 points; results in {tmp_path / 'out'}\n"
    assert told.splitlines()[-1].startswith(f"glint-aoa: {points / 'p3-bad.h5'}: not an HDF5 file")
    assert "flagged: UNCALIBRATED (5 of 5 points): " in told
    program("process", *sorted(points.iterdir()), *given[1:-1], tmp_path / "serial")
    assert contents(tmp_path / "out") == contents(tmp_path / "serial")
    (points / "p3-bad.h5").unlink()
    code, said, told = program("batch", *given, "--resume", "--json", "--strict")
    assert code == 0
    assert json.loads(said) == {"points": [], "failed": [], "without_fields": []}
    assert "5 of 5 were finished before" in told


CAMPAIGN = """
name = "small"
start = "2026-01-12T08:00:00"
[[run]]
name = "run"
angle = "1 deg"
[[run.series]]
kind = "sine"
plane = "yaw"
frequency = "9.8 Hz"
moments = ["900 in*lbf"]
"""


def test_a_campaign_names_its_points_in_order(serial, tmp_path, program):
    folder, _, _ = serial
    (tmp_path / "test.toml").write_text(CAMPAIGN)
    write_fields(tmp_path / "run-02.h5", 1)
    given = ["--setup", folder / "glint-aoa.toml", "--out", tmp_path / "out"]
    code, said, told = program(
        "batch", tmp_path / "test.toml", "--points", tmp_path, "--jobs", "1", *given
    )
    assert code == 2
    assert said.startswith("Measured 1 of 3 points")
    assert [Path(line.split(": ")[1]).name for line in told.splitlines()[-2:]] == [
        "run-01.h5",
        "run-03.h5",
    ]
    code, _, told = program("batch", tmp_path / "test.toml", *given)
    assert code == 2
    message = f"{tmp_path / 'test.toml'}: a campaign; say with --points where its points are"
    assert told == f"glint-aoa: {message}\n"
