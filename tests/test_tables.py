"""Result tables: exact text, and what is left after a crash."""

import multiprocessing
import os
import re
import resource
import signal

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.errors import InputError, OutputError
from glint_aoa.records.tables import append_log, read_csv, write_csv, write_netcdf

COLUMNS = ("run", "point", "angle")


def test_csv_is_written_to_the_letter(tmp_path):
    columns = {
        "field": np.arange(3),
        "angle_deg": np.array([1.23456789, np.nan, -0.5]),
        "rms": [0.1, None, np.float32(0.25)],
        "note": ["a", "b,c", ""],
    }
    write_csv(tmp_path / "p.csv", columns, formats={"angle_deg": ".5f"})
    text = (tmp_path / "p.csv").read_bytes()
    assert text == b'field,angle_deg,rms,note\n0,1.23457,0.1,a\n1,,,"b,c"\n2,-0.50000,0.25,\n'
    assert [each.name for each in tmp_path.iterdir()] == ["p.csv"]


def test_csv_columns_must_be_of_one_length_and_the_old_file_stays(tmp_path):
    path = tmp_path / "p.csv"
    write_csv(path, {"a": [1]})
    with pytest.raises(ValueError, match="zip"):
        write_csv(path, {"a": [1, 2], "b": [1]})
    assert path.read_text() == "a\n1\n"
    assert [each.name for each in tmp_path.iterdir()] == ["p.csv"]


@given(
    st.lists(
        st.tuples(
            st.floats(allow_nan=False, width=32),
            st.text(st.characters(exclude_categories=("Cs", "Cc"))),
        )
    )
)
def test_csv_round_trip(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    numbers, texts = [row[0] for row in rows], [row[1] for row in rows]
    write_csv(path, {"x": numbers, "t": texts})
    table = read_csv(path)
    assert table["t"] == texts
    np.testing.assert_allclose([float(x) for x in table["x"]], numbers, rtol=1e-9)


def test_csv_that_cannot_be_written(tmp_path):
    path = tmp_path / "nowhere" / "p.csv"
    message = (
        f"{path}: cannot be written (No such file or directory); "
        "check that the folder exists, its permissions and the free space"
    )
    with pytest.raises(OutputError, match="^" + re.escape(message) + "$"):
        write_csv(path, {"a": [1]})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such table; check its name and folder"),
        (b"", "the table has no header row; write it again"),
        (b"a,b\n1,2,3\n", "row 2 has 3 cells, expected 2 as in the header; correct that row"),
        (b"\xff\xfe\xfa", "not a CSV table ("),
        (b"a,b\n" + b"x" * 200_000, "not a CSV table ("),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, content, message):
    path = tmp_path / "p.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="^" + re.escape(f"{path}: {message}")):
        read_csv(path)


def test_log_starts_with_its_header_and_grows_by_rows(tmp_path):
    path = tmp_path / "log.csv"
    append_log(path, {"run": "1", "point": 2, "angle": np.float64(0.25)}, COLUMNS)
    append_log(path, {"run": "two\nlines", "angle": float("nan")}, COLUMNS)
    assert path.read_text() == "run,point,angle\n1,2,0.25\ntwo lines,,\n"
    assert read_csv(path) == {
        "run": ["1", "two lines"],
        "point": ["2", ""],
        "angle": ["0.25", ""],
    }


def test_log_starts_a_new_line_after_a_torn_one(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("run,point,angle\n1,1,0.5\n1,2")
    append_log(path, {"run": "1", "point": "2", "angle": 0.75}, COLUMNS)
    assert path.read_text() == "run,point,angle\n1,1,0.5\n1,2\n1,2,0.75\n"
    assert read_csv(path)["angle"] == ["0.5", "0.75"]


@pytest.mark.parametrize("torn", ["", "run,po", "run,point,angle"])
def test_log_torn_within_its_header_starts_afresh(tmp_path, torn):
    path = tmp_path / "log.csv"
    path.write_text(torn)
    append_log(path, {"run": "1"}, COLUMNS)
    assert path.read_text() == "run,point,angle\n1,,\n"


def test_log_with_other_columns_is_left_alone(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("a,b\n1,2\n")
    message = "the log has other columns (a,b...); give another folder or move the old log"
    with pytest.raises(OutputError, match="^" + re.escape(f"{path}: {message}") + "$"):
        append_log(path, {"run": "1"}, COLUMNS)
    assert path.read_text() == "a,b\n1,2\n"


def test_log_refuses_an_unknown_column(tmp_path):
    with pytest.raises(ValueError, match="angel is none of the log's columns: run, point, angle"):
        append_log(tmp_path / "log.csv", {"angel": 1}, COLUMNS)


def test_log_in_a_missing_folder(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        append_log(tmp_path / "no" / "log.csv", {"run": 1}, COLUMNS)


def test_log_is_as_before_when_the_disk_takes_part_of_a_row(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    append_log(path, {"run": "1"}, COLUMNS)
    before = path.read_bytes()
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, text: write(fd, text[:3]))
    with pytest.raises(OutputError, match="No space left on device"):
        append_log(path, {"run": "2"}, COLUMNS)
    assert path.read_bytes() == before


def _append_many(path, run):
    for point in range(50):
        append_log(path, {"run": run, "point": point, "angle": "x" * 200}, COLUMNS)


def test_programs_that_share_a_log_do_not_mix_their_lines(tmp_path):
    path = tmp_path / "log.csv"
    context = multiprocessing.get_context("spawn")
    with context.Pool(2) as pool:
        pool.starmap(_append_many, [(path, "a"), (path, "b")])
    table = read_csv(path)
    assert sorted(zip(table["run"], table["point"], strict=True)) == sorted(
        (run, str(point)) for run in "ab" for point in range(50)
    )
    assert set(table["angle"]) == {"x" * 200}


def test_netcdf_round_trip_keeps_units(tmp_path):
    path = tmp_path / "p.nc"
    columns = {"field": np.arange(2), "angle_deg": np.array([1.0, np.nan])}
    attrs = {"setup_hash": "abc", "rate_hz": 60.0, "words": "", "lines_hz": [9.8, 19.5], "no": []}
    for _ in range(2):
        write_netcdf(path, columns, attrs=attrs, column_attrs={"angle_deg": {"units": "deg"}})
    angle = ("field", columns["angle_deg"], {"units": "deg"})
    expected = xr.Dataset({"angle_deg": angle}, {"field": columns["field"]}, attrs)
    with xr.open_dataset(path, engine="h5netcdf") as back:
        xr.testing.assert_identical(back.load(), expected)
    assert [each.name for each in tmp_path.iterdir()] == ["p.nc"]


def test_full_disk_leaves_the_old_table(tmp_path):
    path = tmp_path / "p.csv"
    write_csv(path, {"a": [1]})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OutputError, match="cannot be written \\(File too large\\)"):
            write_csv(path, {"a": list(range(10_000))})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_text() == "a\n1\n"
    assert [each.name for each in tmp_path.iterdir()] == ["p.csv"]


def test_a_long_table_is_written_whole(tmp_path):
    number = np.arange(25_001)
    write_csv(tmp_path / "long.csv", {"number": number, "half": number / 2})
    table = np.genfromtxt(tmp_path / "long.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["number"], number)
    np.testing.assert_array_equal(table["half"], number / 2)
