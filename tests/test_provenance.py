"""Which files a result was made from, and its settings read back."""

import hashlib
import re

import pytest
from report_campaign import SETUP, write_campaign

from glint_aoa.errors import RecordingError, SetupError
from glint_aoa.records.provenance import file_hash, input_hashes
from glint_aoa.setup import Setup, load_setup


def test_hash_of_a_file_is_sha256(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert file_hash(tmp_path / "a") == hashlib.sha256(b"abc").hexdigest()


def test_hash_of_a_folder_is_of_names_and_files(tmp_path):
    for name, data in (("b.png", b"2"), ("a.png", b"1")):
        (tmp_path / name).write_bytes(data)
    (tmp_path / "inner").mkdir()
    lines = "".join(
        f"{hashlib.sha256(data).hexdigest()}  {name}\n"
        for name, data in (("a.png", b"1"), ("b.png", b"2"))
    )
    before = file_hash(tmp_path)
    assert before == hashlib.sha256(lines.encode()).hexdigest()
    (tmp_path / "b.png").rename(tmp_path / "c.png")
    assert file_hash(tmp_path) != before


def test_what_cannot_be_read_is_named(tmp_path):
    with pytest.raises(RecordingError, match=re.escape(
        f"{tmp_path / 'x'}: cannot be read (No such file or directory); check its name and "
        "permissions"
    )):  # fmt: skip
        file_hash(tmp_path / "x")


def test_inputs_are_recording_and_calibrations(tmp_path):
    first, *_ = write_campaign(tmp_path)
    told = input_hashes(first, load_setup(tmp_path / "glint-aoa.toml"))
    assert told == {
        "setup_folder": str(tmp_path),
        "recording_sha256": hashlib.sha256(first.read_bytes()).hexdigest(),
        "calibration_sha256": hashlib.sha256((tmp_path / "sweep.toml").read_bytes()).hexdigest(),
    }


def test_setup_is_read_back_from_results(tmp_path):
    (tmp_path / "glint-aoa.toml").write_text(SETUP)
    setup = load_setup(tmp_path / "glint-aoa.toml")
    again = Setup.of_results(setup.model_dump_json(), tmp_path)
    assert again == setup
    assert again.hash == setup.hash
    assert again.sweep_path == tmp_path / "sweep.toml"


def test_bare_numbers_stay_errors_in_a_setup(tmp_path):
    (tmp_path / "glint-aoa.toml").write_text("[camera]\nfocal_length = 0.035\n")
    with pytest.raises(SetupError, match=r"camera\.focal_length: 0\.035 has no unit"):
        load_setup(tmp_path / "glint-aoa.toml")


def test_a_setup_that_is_none(tmp_path):
    with pytest.raises(SetupError, match=re.escape(
        "the results' attribute setup cannot be read (Invalid JSON"
    )):  # fmt: skip
        Setup.of_results("{", tmp_path)
