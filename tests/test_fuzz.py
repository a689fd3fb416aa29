"""A fixed sample of the damaged files, and that the harness sees what goes wrong."""

import re

import numpy as np
import pytest
import unruly

from fuzz.families import FAMILIES
from fuzz.mutate import spoilt
from fuzz.run import run_family
from fuzz.setups import check_setups, judge

FILES = 60


@pytest.mark.parametrize("name", FAMILIES)
def test_whole_files_are_read(name, tmp_path):
    for files in FAMILIES[name].seeds(tmp_path):
        FAMILIES[name].read(files[-1])


@pytest.mark.parametrize("name", FAMILIES)
def test_damaged_files_are_read_or_refused(name):
    found = run_family(FAMILIES[name], range(FILES), seed=2)
    assert found.failures == {}
    assert found.read + found.refused == FILES
    assert found.read > 0
    assert found.refused > FILES / 4


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("crashes", "crashed or hung"),
        ("hangs", "TimeoutError: took too long"),
        ("takes_memory", "MemoryError: "),
        ("raises", "ValueError: .*a.bin is bad"),
    ],
)
def test_what_goes_wrong_is_told_of_each_file(name, what):
    found = run_family(unruly.FAMILIES[name], range(4, 6), most_s=0.2)
    assert (found.read, found.refused) == (0, 0)
    assert list(found.failures) == [4, 5]
    assert all(re.fullmatch(what, each) for each in found.failures.values())


def test_what_goes_well_is_counted():
    found = run_family(unruly.FAMILIES["reads"], range(7))
    assert (found.read, found.refused, found.failures) == (7, 0, {})


def test_spoiling_is_repeatable_and_spoils():
    content = bytes(range(256)) * 8
    many = [spoilt(content, np.random.default_rng(k)) for k in range(200)]
    assert many == [spoilt(content, np.random.default_rng(k)) for k in range(200)]
    assert sum(each != content for each in many) > 190
    assert len(set(map(len, many))) > 50
    assert spoilt(b"", np.random.default_rng(0)) is not None


def test_setups_are_valid_or_refused_by_key(tmp_path):
    check_setups(tmp_path, files=150)


def test_a_setup_that_is_refused_without_its_key_is_seen(tmp_path, monkeypatch):
    path = tmp_path / "glint-aoa.toml"
    path.write_text("[glint]\nnoses = 1\n")
    assert judge(path) is None

    def refuse(_):
        raise ValueError("no")

    monkeypatch.setattr("fuzz.setups.load_setup", refuse)
    assert judge(path) == "ValueError: no"
