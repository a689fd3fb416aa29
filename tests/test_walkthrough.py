"""The tutorial and the how-to pages: each command, file and piece of Python in them is run."""

import contextlib
import io
import re
import shlex
import shutil
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from glint_aoa.cli import main

DOCS = Path(__file__).parents[1] / "docs"
RECIPES = sorted((DOCS / "how-to").glob("*.md"))

FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (?P<add>add to )?(?P<name>[\w.-]+\.toml)\n")
NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def run(command):
    """Run a command of the program as a shell would; return what it prints on stdout."""
    program, *words = shlex.split(command)
    assert program == "glint-aoa"
    arguments = []
    for word in words:
        found = sorted(str(path) for path in Path().glob(word)) if set(word) & set("*[") else [word]
        assert found, f"{word} matches nothing"
        arguments += found
    said, told = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(told),
    ):
        patch.setattr(sys, "argv", [program, *arguments])
        patch.setenv("GLINT_AOA_DEBUG", "")  # which --debug sets, for good
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code, told.getvalue()
    return said.getvalue()


def masked(text):
    """Lines without numbers, whose last digit may differ, and without their spacing."""
    return [" ".join(NUMBER.sub("#", line).split()) for line in text.splitlines()]


def walk(page):
    """Do what a page says, from its first line to its last."""
    printed = ""
    for language, text in FENCE.findall(page.read_text()):
        name = FILE.match(text)
        if language == "toml" and name:
            with Path(name["name"]).open("a" if name["add"] else "w") as file:
                file.write(text)
        elif language == "sh":
            printed = run(text)
        elif language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(compile(text, page.name, "exec"), {})
            printed = out.getvalue()
        elif language == "text":
            missing = [line for line in masked(text) if line not in masked(printed)]
            assert not missing, f"{page.name}: {missing}"
    return printed


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of someone who went through the tutorial, and what it printed last."""
    folder = tmp_path_factory.mktemp("tutorial")
    with pytest.MonkeyPatch.context() as patch, mpl.rc_context():
        patch.chdir(folder)
        printed = walk(DOCS / "tutorial.md")
    return folder, printed


def test_the_tutorial_does_what_it_says(finished):
    _, printed = finished
    error, u95 = (float(each) for each in re.findall(r"\d+\.\d+", printed))
    assert error < 2 * u95
    assert 0 < u95 < 0.001


def test_the_figures_in_the_tutorial_are_those_that_it_prints(finished):
    """Within two of the last digit shown: renderer and seed are fixed."""
    folder, _ = finished
    page = (DOCS / "tutorial.md").read_text()
    for point in ("pitch-01", "pitch-02", "yaw-02"):
        (shown,) = re.findall(rf"^{point} +60/60 +(\S+) +(\S+) +(\S+) +\S+$", page, re.M)[-1:]
        row = (folder / "results" / "log.csv").read_text().splitlines()
        names = row[0].split(",")
        (cells,) = (each.split(",") for each in row[1:] if f",{point}," in each)
        found = dict(zip(names, cells, strict=True))
        wanted = ("mean_angle_deg", "mean_angle_u95_deg", "std_angle_deg")
        for name, text in zip(wanted, shown, strict=True):
            assert float(found[name]) == pytest.approx(float(text), abs=2e-4), name


@pytest.mark.parametrize("page", RECIPES, ids=lambda path: path.stem)
def test_the_recipes_run(page, finished, tmp_path, monkeypatch):
    folder, _ = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True, ignore=lambda _, names: {"*.md"})
    monkeypatch.chdir(tmp_path)
    walk(page)


def test_every_command_of_the_walk_is_marked_as_one():
    """A command that stands alone in a plain fence would not be run."""
    for page in (DOCS / "tutorial.md", *RECIPES):
        plain = re.findall(r"^```\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
        assert not [text for text in plain if text.startswith("glint-aoa")], page.name
