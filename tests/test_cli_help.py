"""Every command's help, and the shells' completion, over the whole tree of commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from glint_aoa.cli._benchmark_command import STUDIES
from glint_aoa.cli._grouped import GROUPS
from glint_aoa.cli.app import app

ROOT = Path(__file__).parents[1]


def tree(command, words=()):
    """Every command and group below one, as the words that call it."""
    yield words
    for name, each in getattr(command, "commands", {}).items():
        yield from tree(each, (*words, name))


COMMANDS = [
    *tree(typer.main.get_command(app)),
    *(("benchmark", name) for name in STUDIES),
]
HEAVY = {"cv2", "h5py", "matplotlib", "numba", "numpy", "pandas", "pint", "scipy", "xarray"}
PROGRAM = """
import sys
sys.argv[0] = "glint-aoa"
from glint_aoa.cli import main
try:
    main()
finally:
    print(*sorted(sys.modules), file=sys.stderr)
"""


@pytest.fixture
def shell(tmp_path):
    """Run the program in a process of its own; returns stdout and the modules that it loaded."""

    def run(*arguments, **variables):
        path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *arguments],
            env={**os.environ, "PYTHONPATH": path, **variables},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        return done.stdout, set(done.stderr.split())

    return run


def completed(shell, words, kind="bash"):
    """What the program answers a shell that asks how a line goes on."""
    out, modules = shell(
        _GLINT_AOA_COMPLETE=f"complete_{kind}",
        COMP_WORDS=words,
        COMP_CWORD=str(len(words.split(" ")) - 1),
        _TYPER_COMPLETE_ARGS=words,
        _TYPER_COMPLETE_FISH_ACTION="get-args",
    )
    assert modules & HEAVY == set()
    return out


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_help_shows_an_example_that_calls_the_command(program, monkeypatch, words):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = program(*words, "--help")
    assert (code, err) == (0, "")
    (example,) = [line for line in out.splitlines() if line.lstrip().startswith("Example: ")]
    assert example.split()[1 : 2 + len(words)] == ["glint-aoa", *words]
    assert max(map(len, out.replace(example, "").splitlines())) <= 80


def test_the_program_without_arguments_shows_its_help(program):
    _, told, _ = program("--help")
    code, out, err = program()
    assert code == 2
    assert (out + err).strip() == told.strip()
    assert "\n  Example: glint-aoa process " in told


def test_the_help_lists_every_command_once_and_whole_under_its_heading(program, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    commands = typer.main.get_command(app).commands
    _, told, _ = program("--help")
    for title, names in GROUPS.items():
        listed = told.partition(f"\n{title}:\n")[2].partition("\n\n")[0].splitlines()
        assert [line.split(None, 1) for line in listed] == [
            [name, commands[name].help.partition("\n")[0]] for name in names
        ]
    assert sorted(commands) == sorted(name for names in GROUPS.values() for name in names)
    assert max(map(len, told.splitlines())) <= 80


def test_help_loads_nothing_heavy(shell):
    out, modules = shell("process", "--help")
    assert "Example: " in out
    assert modules & HEAVY == set()


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("glint-aoa pro", ["process"]),
        ("glint-aoa calibrate ", ["camera", "resect", "sweep", "check"]),
        ("glint-aoa process --se", ["--setup"]),
        ("glint-aoa simulate --renderer ", ["auto", "raytrace", "pyrender"]),
        ("glint-aoa simulate ", ["paper", "demo"]),
        ("glint-aoa benchmark ", [*STUDIES]),
        ("glint-aoa benchmark inertial --ov", ["--overwrite"]),
        ("glint-aoa process run", []),  # nothing: the shell goes on with files
    ],
)
def test_bash_is_told_how_a_line_goes_on(shell, words, answer):
    assert completed(shell, words).split() == answer


def test_zsh_and_fish_are_told_with_the_meaning(shell):
    assert '"process":"Measure angle' in completed(shell, "glint-aoa pro", "zsh")
    assert completed(shell, "glint-aoa pro", "fish").startswith("process\tMeasure angle")


def test_bash_itself_completes(shell, tmp_path):
    program = tmp_path / "glint-aoa"
    program.write_text(f"#!{sys.executable}\n{PROGRAM.replace('print(', 'str(')}")
    program.chmod(0o755)
    script, _ = shell(_GLINT_AOA_COMPLETE="source_bash")
    asked = (
        "COMP_WORDS=(glint-aoa ca); COMP_CWORD=1; _glint_aoa_completion glint-aoa; "
        'echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", f"{script}\n{asked}"],
        env={
            **os.environ,
            "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "calibrate\n", done.stderr
