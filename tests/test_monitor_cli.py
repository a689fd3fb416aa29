"""``glint-aoa monitor`` with input that cannot be used: one sentence, exit code 2."""

import socket
import sys

import pytest
from extras import needs

needs("bokeh", "requests")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points").mkdir()
    (tmp_path / "glint-aoa.toml").write_text("")
    return tmp_path / "points"


def test_a_folder_that_is_not_there(folder, program):
    code, _, said = program("monitor", "elsewhere")
    assert code == 2
    assert said == (
        "glint-aoa: elsewhere: no such folder; give the folder that points are recorded to\n"
    )


def test_a_setup_that_is_not_there(folder, program):
    code, _, said = program("monitor", folder, "--setup", "other.toml")
    assert code == 2
    assert said.startswith("glint-aoa: other.toml: no such setup file")


def test_results_that_lead_out_of_the_folder(folder, program):
    (folder / "results").symlink_to(folder.parent)
    code, _, said = program("monitor", folder)
    assert code == 2
    assert said == (
        f"glint-aoa: {folder}/results leads out of {folder}; name the folder with --results\n"
    )


def test_a_log_of_something_else(folder, program):
    (folder / "results").mkdir()
    (folder / "results" / "log.csv").write_text("a,b\n1,2\n")
    code, _, said = program("monitor", folder)
    assert code == 2
    assert said == (
        f"glint-aoa: {folder}/results/log.csv: no log of results; give another --results\n"
    )


def test_a_port_that_is_taken(folder, program):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        code, _, said = program("monitor", folder, "--port", port)
    assert code == 2
    assert said == (
        f"glint-aoa: port {port} of 127.0.0.1 cannot be had (Address already in use); "
        "give another --port\n"
    )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--listen", "nowhere"], "--listen is nowhere; give an IP address of this machine"),
        (["--token", "short"], "--token must be 16 or more letters"),
        (["--live", "8600"], "--live is 8600; give the address of glint-aoa live"),
    ],
)
def test_options_that_cannot_be_used(options, sentence, folder, program):
    code, _, said = program("monitor", folder, *options)
    assert code == 2
    assert said.startswith(f"glint-aoa: {sentence}")


@pytest.mark.parametrize("name", ["bokeh", "requests"])
def test_without_the_extra_it_says_how_to_get_it(name, folder, program, monkeypatch):
    for module in [each for each in sys.modules if each.startswith("glint_aoa.monitor")]:
        monkeypatch.delitem(sys.modules, module)
    for module in [each for each in sys.modules if each.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    code, _, said = program("monitor", folder)
    assert code == 2
    assert said.startswith("glint-aoa: the live page needs ")
    assert said.endswith('run pip install "glint-aoa[monitor]"\n')
