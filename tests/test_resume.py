"""Going on where an interrupted run stopped."""

import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from glint_aoa.cli.app import app
from glint_aoa.errors import OutputError
from glint_aoa.process import process_point
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.resume import finished_points
from glint_aoa.setup import load_setup
from torture.kills import kill_batch

SETUP = '[camera]\npixel_pitch = ["11.7 um", "27.5 um"]\n[glint]\nnose = "left"\n'


def write_fields(path, seed, meta=None):
    rng = np.random.default_rng(seed)
    light = 10 + 150 * np.exp(-0.5 * ((np.arange(40) - 18.0 - rng.random()) / 1.4) ** 2)
    fields = np.rint(rng.normal(light[:, None], 1.0, (8, 40, 120))).astype(np.uint8)
    info = FieldInfo(rate_hz=60.0, interlaced=False)
    write_point(path, RecordedPoint(fields=fields, info=info, meta=meta or {}))


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """Three points and their results."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "glint-aoa.toml").write_text(SETUP)
    paths = [folder / f"p{number}.h5" for number in range(3)]
    for number, path in enumerate(paths):
        write_fields(path, number)
        process_point(path, load_setup(folder / "glint-aoa.toml"), folder / "out")
    return folder, paths


@pytest.fixture
def results(batch, tmp_path):
    shutil.copytree(batch[0] / "out", tmp_path / "out")
    return tmp_path / "out"


def finished(batch, results):
    folder, paths = batch
    setup = load_setup(folder / "glint-aoa.toml")
    return [path.stem for path in finished_points(paths, setup, results)]


def test_a_point_with_its_files_and_its_row_is_finished(batch, results):
    assert finished(batch, results) == ["p0", "p1", "p2"]
    (results / "p1.nc").unlink()
    assert finished(batch, results) == ["p0", "p2"]
    (results / "p1.nc").touch()
    (results / "p0.csv").unlink()
    assert finished(batch, results) == ["p1", "p2"]


def test_files_without_a_row_are_not_finished(batch, results):
    log = results / "log.csv"
    whole = log.read_bytes()
    lines = whole.splitlines(keepends=True)
    log.write_bytes(b"".join(lines[:2]))
    assert finished(batch, results) == ["p0"]
    log.write_bytes(whole[:-5])  # torn off within the setup's hash
    assert finished(batch, results) == ["p0", "p1"]
    log.write_bytes(whole[:-1])  # only the line's end is missing
    assert finished(batch, results) == ["p0", "p1", "p2"]
    log.write_bytes(lines[0])
    assert finished(batch, results) == []
    log.write_bytes(b"")
    assert finished(batch, results) == []
    log.unlink()
    assert finished(batch, results) == []


def test_nothing_is_finished_where_there_is_nothing(batch, tmp_path):
    assert finished(batch, tmp_path / "nowhere") == []


def test_points_of_one_name_are_counted(batch, tmp_path):
    setup = load_setup(batch[0] / "glint-aoa.toml")
    paths = [tmp_path / f"{name}.h5" for name in ("a", "b")]
    for path in paths:
        write_fields(path, 1, meta={"run": "7", "point": "1\n2"})
    process_point(paths[0], setup, tmp_path / "out")
    assert finished_points(paths, setup, tmp_path / "out") == paths[:1]
    process_point(paths[1], setup, tmp_path / "out", to_log=False)
    assert finished_points(paths, setup, tmp_path / "out") == paths[:1]


def test_a_point_that_cannot_be_opened_is_not_finished(batch, results):
    folder, _ = batch
    setup = load_setup(folder / "glint-aoa.toml")
    assert finished_points([results / "p1.h5"], setup, results) == []


def test_results_of_another_setup_are_refused(batch, results):
    log = results / "log.csv"
    text = log.read_text()
    known = load_setup(batch[0] / "glint-aoa.toml").hash
    log.write_text(text.replace(known, "0" * len(known)))
    message = (
        f"{log}: p0 was measured with another setup; give another --out, or --overwrite to "
        "measure it again"
    )
    with pytest.raises(OutputError, match=re.escape(message)):
        finished(batch, results)


def test_a_table_that_is_no_log_is_refused(batch, results):
    (results / "log.csv").write_text("run,angle\n1,2\n")
    message = f"{results / 'log.csv'}: no log of results, point is missing; give another --out"
    with pytest.raises(OutputError, match=re.escape(message)):
        finished(batch, results)


def test_the_command_measures_what_is_left(batch, results):
    folder, paths = batch
    log = results / "log.csv"
    whole = log.read_bytes()
    log.write_bytes(b"".join(whole.splitlines(keepends=True)[:2]))
    setup = str(folder / "glint-aoa.toml")
    arguments = ["process", *map(str, paths), "--setup", setup, "--out", str(results)]
    done = CliRunner().invoke(app, [*arguments, "--resume"])
    assert done.exit_code == 0
    assert "1 of 3 points were finished before" in done.stderr
    assert log.read_bytes() == whole
    assert "p0 " not in done.stdout
    again = CliRunner().invoke(app, [*arguments, "--resume"])
    assert again.exit_code == 0
    assert "3 of 3 points were finished before" in again.stderr
    assert log.read_bytes() == whole
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2


def test_a_batch_that_is_killed_goes_on_and_loses_nothing(tmp_path):
    found = kill_batch(tmp_path, kills=3, points=3, seed=4)
    assert found.kills == 3
    assert found.holds
    assert found.differing == found.partial == []
