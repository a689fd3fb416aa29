"""Many points at once on a Dask cluster, and results in an object store."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial

import pytest
from batches import contents, serial_batch
from extras import needs

from glint_aoa.batch import open_store, process_batch
from glint_aoa.batch.cluster import Cluster
from glint_aoa.batch.point import measure_or_split
from glint_aoa.errors import InputError, MissingLibraryError, OutputError

needs("distributed", "s3fs", "moto")

PART = 2 * 40 * 120  # bytes: of two fields


@contextmanager
def started(*command, **environment):
    """Run a module of a library beside the tests."""
    process = subprocess.Popen(
        [sys.executable, "-m", *map(str, command)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **environment},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_for(condition):
    until = time.monotonic() + 100
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    told = tmp_path_factory.mktemp("scheduler") / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", told)
    with started("distributed.cli.dask_scheduler", *options):
        wait_for(told.exists)
        yield json.loads(told.read_text())["address"]


def worker(address, folder):
    options = ("--no-nanny", "--nthreads", 1, "--no-dashboard", "--local-directory", folder)
    return started("distributed.cli.dask_worker", address, *options)


@pytest.fixture(scope="module")
def a_worker(scheduler, tmp_path_factory):
    folder = tmp_path_factory.mktemp("worker")
    with worker(scheduler, folder):
        yield


@pytest.fixture
def cluster(scheduler, a_worker):
    with Cluster(scheduler) as found:
        wait_for(lambda: len(found._client.nthreads()) == 1)
        yield found


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("serial")
    paths, setup = serial_batch(folder, 6)
    return folder, paths, setup


def run(paths, setup, out, pool, part_bytes=10**9, **how):
    store = open_store(str(out))
    measure = partial(measure_or_split, setup=setup, store=store, part_bytes=part_bytes)
    return process_batch(paths, setup, store, pool, measure, **how)


@pytest.fixture
def bucket(monkeypatch):
    """Give the URL of an empty bucket on a local server."""
    import s3fs

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem.clear_instance_cache()
    with started("moto.server", "-H", "127.0.0.1", "-p", port):
        wait_for(lambda: is_open(port))
        s3fs.S3FileSystem().mkdir("tests")
        yield "s3://tests"
    s3fs.S3FileSystem.clear_instance_cache()


def is_open(port):
    with socket.socket() as knocking:
        return knocking.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.parametrize("part_bytes", [10**9, PART])
def test_results_are_those_of_a_serial_run_to_the_bit(serial, tmp_path, cluster, part_bytes):
    folder, paths, setup = serial
    seen = []
    result = run(paths, setup, tmp_path, cluster, part_bytes, progress=seen.append)
    assert result.failures == []
    assert contents(tmp_path) == contents(folder / "serial")
    assert sorted(seen) == paths


@pytest.mark.parametrize("part_bytes", [10**9, PART])
def test_a_worker_that_is_killed_costs_nothing_but_time(
    serial, tmp_path, scheduler, a_worker, cluster, part_bytes
):
    folder, paths, setup = serial
    others = set(cluster._client.nthreads())
    with worker(scheduler, tmp_path / "dask") as victim:
        wait_for(lambda: len(cluster._client.nthreads()) == 2)
        (its,) = set(cluster._client.nthreads()) - others
        busy = []

        def kill_once(_):
            if not busy:
                busy.append(cluster._client.processing()[its])
                victim.send_signal(signal.SIGKILL)

        result = run(
            paths,
            setup,
            tmp_path / "out",
            cluster,
            part_bytes,
            progress=kill_once,
        )
        assert victim.wait() == -signal.SIGKILL
    assert busy[0]  # it had points to measure
    assert result.failures == []
    assert contents(tmp_path / "out") == contents(folder / "serial")


def test_points_that_fail_are_listed(serial, tmp_path, cluster):
    folder, paths, setup = serial
    bad = tmp_path / "bad.h5"
    bad.write_bytes(b"no HDF5")
    result = run([bad, *paths], setup, tmp_path / "out", cluster)
    assert [path for path, _ in result.failures] == [bad]
    assert result.failures[0][1].startswith(f"{bad}: not an HDF5 file or damaged")
    assert contents(tmp_path / "out") == contents(folder / "serial")


def test_the_command(serial, tmp_path, scheduler, a_worker, program, monkeypatch):
    folder, _, _ = serial
    monkeypatch.chdir(folder)
    given = ["batch", "points", "--scheduler", scheduler]
    code, said, _ = program(*given, "--out", tmp_path)
    assert (code, said) == (0, f"Measured 6 of 6 points; results in {tmp_path}\n")
    assert contents(tmp_path) == contents(folder / "serial")
    code, _, told = program(*given, "--out", tmp_path / "other", "--jobs", 2)
    assert code == 2
    assert told == (
        "glint-aoa: --jobs is of this machine; with --scheduler, give it to the workers "
        "(dask worker --nworkers N --memory-limit SIZE)\n"
    )


def test_results_in_an_object_store_are_those_of_a_folder(serial, tmp_path, bucket):
    import s3fs

    from glint_aoa.workers import Workers

    folder, paths, setup = serial
    with Workers(1, apart=True) as apart:
        run(paths[:2], setup, f"{bucket}/run", apart)
        again = run(paths[:3], setup, f"{bucket}/run", apart)
        rest = run(paths, setup, f"{bucket}/run", apart, resume=True)
    assert [why.partition(" ")[0] for _, why in again.failures] == [
        f"{bucket}/run/p0.csv",
        f"{bucket}/run/p1.csv",
    ]
    assert rest.finished == paths[:3]
    s3fs.S3FileSystem().get("tests/run", str(tmp_path / "run"), recursive=True)
    assert contents(tmp_path / "run") == contents(folder / "serial")
    with pytest.raises(OutputError, match=r"^s3://A_/x: cannot be written \(.*\); check the addr"):
        open_store("s3://A_/x").check()


def test_a_scheduler_that_does_not_answer(program, serial, tmp_path, monkeypatch):
    monkeypatch.setattr("glint_aoa.batch.cluster._ANSWER_S", 0.2)
    folder, _, _ = serial
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    for given in (address, "nonsense"):
        code, said, told = program(
            "batch",
            folder / "points",
            "--setup",
            folder / "glint-aoa.toml",
            "--out",
            tmp_path,
            "--scheduler",
            given,
        )
        assert (code, said) == (2, "")
        assert told == (
            f"glint-aoa: {given}: no Dask scheduler answers there; start one with dask scheduler, "
            "or write its address like tcp://10.0.0.5:8786\n"
        )


def test_the_library_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = (
        "--scheduler needs distributed, which is not installed; "
        'install it with: pip install "glint-aoa[cluster]"'
    )
    with pytest.raises(MissingLibraryError, match=re.escape(message)):
        Cluster("tcp://127.0.0.1:1")


def test_machines_with_another_version_are_refused(scheduler, a_worker, monkeypatch):
    monkeypatch.setattr("glint_aoa.batch.cluster.__version__", "9.9")
    with pytest.raises(InputError, match=r"has glint-aoa .*, and 9\.9 is here; install the same"):
        Cluster(scheduler).__enter__()
