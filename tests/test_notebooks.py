"""Notebooks as they are stored; ``make notebooks`` runs them and compares what they say."""

import copy
import os
import re
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "notebooks"))

from stored import NOTEBOOKS, clean, code_cells, differences, read, stderr  # noqa: E402

LARGEST = 600_000  # bytes
PLACES = re.compile(r"(?:[A-Za-z]:\\|(?<![\w.<])/)(?:\w+[/\\])+\w+")


def words_of(notebook):
    for cell in notebook.cells:
        yield cell.source
        for output in cell.get("outputs", []):
            yield output.get("text", "")
            for kind, data in output.get("data", {}).items():
                if kind.startswith("text/plain"):
                    yield data


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture
def notebook():
    """A notebook of one cell that printed twice, with what a run leaves in it."""
    cell = nbformat.v4.new_code_cell("print(1.25)", metadata={"execution": {"a": "12:00"}})
    cell.outputs = [
        nbformat.v4.new_output("stream", name="stdout", text="angle 1.2"),
        nbformat.v4.new_output("stream", name="stdout", text="5 deg in 12 fields\n"),
        nbformat.v4.new_output(
            "execute_result", {"text/plain": "<Figure>"}, metadata={"x": 1}, execution_count=7
        ),
    ]
    return nbformat.v4.new_notebook(
        cells=[cell], metadata={"language_info": {"name": "python", "version": "3"}}
    )


def test_there_are_four_that_teach():
    assert {path.stem for path in NOTEBOOKS} == {
        "from-field-to-angle",
        "calibrating-with-a-pitch-sweep",
        "optical-against-inertial",
        "your-own-recording",
    }


def test_is_stored_as_it_ran(path):
    stored = read(path)
    nbformat.validate(stored)
    cells = code_cells(stored)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)
    assert stderr(stored) == ""
    for cell in cells:
        for data in (output.get("data", {}) for output in cell.outputs):
            assert data.get("text/plain", "").startswith("<Figure") == ("image/png" in data)
    assert not any(o.output_type == "error" for cell in cells for o in cell.outputs)


def test_stored_file_is_small_and_says_nothing_of_the_machine(path):
    stored = read(path)
    assert path.stat().st_size < LARGEST
    assert clean(copy.deepcopy(stored)) == stored
    for words in words_of(stored):
        assert PLACES.findall(words.replace("https://", "")) == []
    assert str(Path.home()) + os.sep not in path.read_text(encoding="utf-8")


def test_each_begins_with_a_title_and_ends_with_what_to_take_away(path):
    stored = read(path)
    assert re.match(r"# \w", stored.cells[0].source)
    assert "## What to take away" in stored.cells[-1].source
    assert stored.cells[-1].cell_type == "markdown"


def test_links_lead_somewhere(path):
    for cell in read(path).cells:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", cell.source):
            if cell.cell_type == "markdown" and not target.startswith("http"):
                assert (path.parent / target).exists(), target


def test_clean_takes_out_what_a_run_leaves(notebook):
    cell = clean(notebook).cells[0]
    assert (cell.metadata, cell.execution_count) == ({}, 1)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert [each.get("text") for each in cell.outputs] == ["angle 1.25 deg in 12 fields\n", None]
    assert (cell.outputs[1].metadata, cell.outputs[1].execution_count) == ({}, 1)


@pytest.mark.parametrize(
    ("text", "is_same"),
    [
        ("angle 1.25 deg in 12 fields\n", True),
        ("angle 1.26 deg in 12 fields\n", True),
        ("angle 1.27 deg in 12 fields\n", False),
        ("angle 1.25 deg in 13 fields\n", False),
        ("angles 1.25 deg in 12 fields\n", False),
        ("angle 1.25 deg in 12 fields of 60\n", False),
    ],
)
def test_a_number_may_differ_in_its_last_digit_and_nothing_else(notebook, text, is_same):
    stored = clean(notebook)
    fresh = copy.deepcopy(stored)
    fresh.cells[0].outputs[0].text = text
    found = list(differences(stored, fresh))
    assert bool(found) != is_same
    assert all(each.startswith("cell 1 says\n" + text) for each in found)


def test_another_source_or_a_lost_figure_is_seen(notebook):
    stored = clean(notebook)
    fresh = copy.deepcopy(stored)
    fresh.cells[0].source = "print(2)"
    fresh.cells[0].outputs[1].data["image/png"] = "AAAA"
    assert list(differences(stored, fresh)) == [
        "cell 1 is another",
        "cell 1 shows other kinds of outputs",
    ]
