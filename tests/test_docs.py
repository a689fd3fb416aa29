"""What the documents say is what the program does."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import line_fields

from docs import _hooks
from glint_aoa.flags import Flag, describe
from glint_aoa.records.angles import FIELD_COLUMNS, LOG_COLUMNS
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats._beside import Beside
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.setup import InertialFilter, Setup, load_setup
from glint_aoa.setup.section import keys_of
from render_sim.campaign_file import Campaign, Drift, Record, Run, Series, Sweep, load_campaign
from render_sim.disturbance import Knock, LooseMass
from render_sim.instruments import SensorErrors
from render_sim.modes import ModelSystem, VibrationMode, load_model_system, paper_model_system
from render_sim.package import InertialPackage
from render_sim.scene import (
    Air,
    Body,
    Lamp,
    Marking,
    Optics,
    Recorder,
    Scene,
    Sensor,
    Shake,
    Surface,
    load_scene,
    paper_scene,
)

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


GENERATED = {"reference/setup.md", *_hooks.command_pages(), *_hooks.python_pages()}
"""Pages of the site that are made when it is built."""


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL)


SIMULATION = {
    text.split("\n", 1)[0]: text for text in blocks(ROOT / "docs" / "simulation.md", "toml")
}
BESIDE = "# beside a recording\n"
CAMPAIGN = "# my-test.toml\n"  # of the tutorial, which test_walkthrough runs
SETUPS = [
    (path.name, text)
    for path in DOCUMENTS
    for text in blocks(path, "toml")
    if text not in SIMULATION.values() and not text.startswith((BESIDE, CAMPAIGN))
]


@pytest.mark.parametrize(("name", "text"), SETUPS, ids=[name for name, _ in SETUPS])
def test_setups_in_the_documents_are_valid(name, text):
    assert isinstance(Setup.model_validate(tomllib.loads(text)), Setup)


def test_files_names_every_key_of_the_setup():
    text, _ = blocks(ROOT / "docs" / "files.md", "toml")

    def missing(model, where=""):
        for key, field in model.model_fields.items():
            if key == "folder":
                continue
            if not re.search(rf"\b{key}\b", text):
                yield f"{where}{key}"
            inner = field.annotation
            if isinstance(inner, type) and hasattr(inner, "model_fields"):
                yield from missing(inner, f"{where}{key}.")

    assert list(missing(Setup)) == []


def test_files_names_every_key_that_can_be_told_beside_a_recording():
    _, text = blocks(ROOT / "docs" / "files.md", "toml")
    told = Beside.model_validate(tomllib.loads(text))
    assert text.startswith(BESIDE)
    assert told.model_fields_set == set(Beside.model_fields)


def test_the_campaign_of_the_documents_is_valid(tmp_path):
    (tmp_path / "test.toml").write_text(SIMULATION["# campaign"])
    campaign = load_campaign(tmp_path / "test.toml")
    assert len(campaign.points) == 19
    assert campaign.scene == tmp_path / "scene.toml"


def test_the_model_of_the_documents_is_valid(tmp_path):
    (tmp_path / "model.toml").write_text(SIMULATION["# model"])
    model, papers = load_model_system(tmp_path / "model.toml"), paper_model_system()
    assert model.model_copy(update={"mode": ()}) == papers.model_copy(update={"mode": ()})
    assert model.mode[0].radius == papers.modes_in("yaw")[0].radius
    inside = "\n[model]\n" + SIMULATION["# model"].replace("[[mode]]", "[[model.mode]]")
    (tmp_path / "test.toml").write_text(SIMULATION["# campaign"] + inside)
    assert load_campaign(tmp_path / "test.toml").model == model


def test_the_documents_name_every_key_of_a_campaign():
    text = SIMULATION["# campaign"] + SIMULATION["# model"]
    parts = (
        Campaign,
        Drift,
        Sweep,
        Run,
        Series,
        Record,
        LooseMass,
        Knock,
        InertialPackage,
        InertialFilter,
        SensorErrors,
        ModelSystem,
        VibrationMode,
    )
    for part in parts:
        for key in set(keys_of(part)) - {"model"}:
            named = rf"(^|[{{,] ?)\[*(\w+\.)*{key}\b"
            assert re.search(named, text, re.MULTILINE), f"{part.__name__}: {key}"


def test_the_scene_of_the_documents_names_every_key_and_is_the_papers(tmp_path):
    text = SIMULATION["# scene"]
    (tmp_path / "scene.toml").write_text(text)
    scene = load_scene(tmp_path / "scene.toml")
    wrong = {"other_lamps": (), "air": Air(), "recorder": Recorder(), "shake": ()}
    assert replace(scene, **wrong) == paper_scene()
    assert all(getattr(scene, name) != usual for name, usual in wrong.items())
    (tmp_path / "scene.toml").write_text(text + SIMULATION["# markings"])
    assert len(load_scene(tmp_path / "scene.toml").body.markings) == 4
    text += SIMULATION["# markings"]
    for part in (Scene, Air, Body, Lamp, Marking, Optics, Recorder, Sensor, Shake, Surface):
        for key in keys_of(part):
            assert re.search(rf"\b{key}\b", text), f"{part.__name__}: {key}"


def test_files_lists_the_columns_and_flags():
    text = re.sub(r"\s+", " ", (ROOT / "docs" / "files.md").read_text())
    for columns in (FIELD_COLUMNS, LOG_COLUMNS):
        assert ", ".join(columns) in text
    for bit, flag in enumerate(Flag):
        name, meaning = describe(flag)[0].split(": ", 1)
        assert f"| {bit} | {int(flag)} | `{name}` | {meaning} |" in text


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text()):
        if not target.startswith("http"):
            where = (path.parent / target).resolve()
            made = where.with_suffix(".md").as_posix().removeprefix(f"{ROOT.as_posix()}/docs/")
            assert where.exists() or made in GENERATED, target


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    (code,) = blocks(ROOT / "README.md", "python")
    fields = line_fields(np.random.default_rng(1), n_fields=8, slope=0.01)
    info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False)
    write_point(
        tmp_path / "point-01.h5",
        RecordedPoint(
            fields=fields, info=info, fields_time_s=None, acquisition=None, truth={}, meta={}
        ),
    )
    (tmp_path / "glint-aoa.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert re.match(r"0\.57\d+ \+/- 0\.000\d+", capsys.readouterr().out)
    assert (tmp_path / "results" / "point-01.csv").exists()


def test_the_setup_of_the_demo_is_that_of_the_scene():

    setup, scene = load_setup(ROOT / "glint_aoa" / "data" / "paper-test.toml"), paper_scene()
    assert setup.camera == scene.camera
    assert setup.glint.y == pytest.approx(scene.glint_y_m)
    assert setup.glint.nose == scene.nose


def test_the_simulated_modes_are_those_of_the_setup():
    setup, system = (
        load_setup(ROOT / "glint_aoa" / "data" / "paper-test.toml"),
        paper_model_system(),
    )
    surveyed, simulated = (
        sorted((m.number, m.plane, m.frequency, m.radius) for m in modes)
        for modes in (setup.inertial.mode, system.mode)
    )
    assert surveyed == simulated
    assert system.sensor_station == paper_scene().package_station_m
