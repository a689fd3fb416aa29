"""What all tests share; property tests draw the same examples each time."""

import sys

import hypothesis
import pytest

hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")


@pytest.fixture
def program(monkeypatch, capsys):
    """Run the program as its console script does; returns exit code, stdout and stderr."""
    from glint_aoa.cli import main

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["glint-aoa", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return ended.value.code or 0, said.out, said.err

    return run


@pytest.fixture
def flat(monkeypatch):
    """Render nothing: what campaigns film costs nothing."""
    from campaigns import FlatRenderer

    from render_sim.campaign import _renderer

    monkeypatch.setattr(
        "render_sim.campaign.make_renderer", lambda scene, _: FlatRenderer(scene.sensor.rows)
    )
    _renderer.cache_clear()
    yield
    _renderer.cache_clear()
