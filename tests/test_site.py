"""The site: generated pages name all that there is; every page stands in the navigation."""

import re
import tomllib
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import get_type_hints

import pytest
import typer
import yaml
from pydantic import TypeAdapter

from docs import _hooks
from glint_aoa.cli.app import app
from glint_aoa.flags import Flag
from glint_aoa.records.angles import FIELD_COLUMNS
from glint_aoa.records.formats._beside import Beside
from glint_aoa.setup import Setup
from glint_aoa.setup.section import keys_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


class Loader(yaml.SafeLoader):
    """Takes the names of Python's functions, which plugins have, as plain words."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/name:", lambda _, name, __: name)


def site():
    return yaml.load((ROOT / "mkdocs.yml").read_text(), Loader)


def commands(command, name=""):
    inner = getattr(command, "commands", None)
    if inner is None:
        inner = command.studies() if hasattr(command, "studies") else {}
    if name:
        yield name, command
    for key, each in inner.items():
        yield from commands(each, f"{name} {key}".strip())


COMMANDS = dict(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_its_help_on_a_page(name):
    page = _hooks.command_pages()[f"reference/commands/{name.split()[0]}.md"]
    (part,) = re.findall(rf"^#+ glint-aoa {name}\n(.*?)(?=^# |^## |^### |\Z)", page, re.M | re.S)
    for option in COMMANDS[name].params:
        for flag in getattr(option, "opts", []):
            if flag.startswith("-"):
                assert re.search(rf"`[^`]*{flag}\b", part), flag
    if not hasattr(COMMANDS[name], "commands"):
        assert re.search(rf"^```\n.*glint-aoa {name}\b", part, re.M), "no example"
    assert "\b" not in part


def test_the_page_of_the_program_lists_the_commands():
    page = _hooks.command_pages()["reference/commands/index.md"]
    assert set(re.findall(r"\| \[`([\w-]+)`\]", page)) == {name.split()[0] for name in COMMANDS}


def tables(section, where=""):
    for key, kind in keys_of(section).items():
        inner = [
            each
            for each in (kind, *getattr(kind, "__args__", ()))
            if isinstance(each, type) and hasattr(each, "model_fields")
        ]
        for each in inner:
            yield f"{where}{key}", each
            yield from tables(each, f"{where}{key}.")


TABLES = dict(tables(Setup))


def test_the_tables_of_the_setup_are_found():
    assert {"camera", "glint.reference", "inertial.mode", "uncertainty.reflection"} <= set(TABLES)


@pytest.mark.parametrize("table", [*TABLES, "beside"])
def test_every_key_of_the_setup_has_a_row(table):
    title = (
        "Beside a recording" if table == "beside" else rf"`\[{{1,2}}{re.escape(table)}\]{{1,2}}`"
    )
    (part,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", _hooks.setup_page(), re.M | re.S)
    section = Beside if table == "beside" else TABLES[table]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", part, re.M))
    inner = {name.rsplit(".", 1)[1] for name in TABLES if name.startswith(f"{table}.")}
    assert set(rows) == set(keys_of(section)) - inner
    for key, row in rows.items():
        cells = row.split(" | ")
        assert len(cells) == 4, key
        assert cells[0], f"{key} has no type"
        assert cells[3], f"{key} has no meaning"


@pytest.mark.parametrize("table", TABLES)
def test_the_defaults_on_the_page_are_those_of_the_setup(table):
    """Each default, written into a setup, changes nothing."""
    (part,) = re.findall(
        rf"^## `\[{{1,2}}{re.escape(table)}\]{{1,2}}`\n(.*?)(?=^## |\Z)",
        _hooks.setup_page(),
        re.M | re.S,
    )
    fields = TABLES[table].model_fields
    for key, default in re.findall(r"^\| `(\w+)` \| [^|]*\| [^|]*\| `([^`]+)` \|", part, re.M):
        value = tomllib.loads(f"{key} = {default}")[key]
        kind = get_type_hints(TABLES[table], include_extras=True)[key]
        assert TypeAdapter(kind).validate_python(value) == pytest.approx(fields[key].default), key


def test_every_module_of_the_pages_can_be_imported():
    named = re.findall(r"^::: ([\w.]+)$", "\n".join(_hooks.python_pages().values()), re.M)
    assert len(named) == len(set(named))
    for name in named:
        assert find_spec(name) is not None, name
        assert import_module(name).__doc__, name
    assert {"glint_aoa.geometry.collinearity", "calibration.sweep.fit"} <= set(named)


def test_the_glossary_says_where_a_term_is_found():
    rows = re.findall(r"^\| (.*) \|$", (DOCS / "glossary.md").read_text(), re.M)
    places = [cell for row in rows for cell in re.findall(r"`([\w.]+)`", row.split(" | ")[-1])]
    assert len(places) > 50
    columns = set(FIELD_COLUMNS)
    for place in places:
        section, _, key = place.rpartition(".")
        known = place in TABLES or (section in TABLES and key in TABLES[section].model_fields)
        if place.startswith(("glint_aoa", "calibration.")):
            assert find_spec(place) is not None, place
        elif not known and "." in place:
            pytest.fail(f"{place} is no key of the setup")
        elif not known:
            assert place in columns or any(place in each.model_fields for each in TABLES.values())


def test_terms_of_the_glossary_are_in_order():
    text = (DOCS / "glossary.md").read_text()
    for part in text.split("\n## ")[1:]:
        terms = [
            row.split(" |")[0].lower() for row in re.findall(r"^\| ((?!term|-).*)$", part, re.M)
        ]
        assert terms == sorted(terms)


def test_the_flags_in_the_recipes_are_the_program_s():
    text = (DOCS / "how-to" / "diagnose.md").read_text()
    named = set(re.findall(r"`([A-Z_]{4,})`", text))
    assert len(named) > 10
    assert named <= set(Flag.__members__)


def entries(nav):
    for each in nav:
        for value in each.values() if isinstance(each, dict) else [each]:
            yield from entries(value) if isinstance(value, list) else [value]


def test_every_page_stands_in_the_navigation_once():
    named = list(entries(site()["nav"]))
    made = {*_hooks._FOLDERS, "reference/setup.md"}
    stored = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert len(named) == len(set(named))
    assert set(named) == stored | made


@pytest.mark.parametrize(
    ("output", "told"),
    [
        ('<script src="https://cdn.example/x.js"></script>', "https://cdn.example/x.js"),
        ('<link rel="stylesheet" href="//fonts.example/f.css">', "//fonts.example/f.css"),
        ("<img alt=x src=http://example.org/p.png>", "http://example.org/p.png"),
        ('<a href="https://doi.org/10.2514/2.2826">', None),
        ('<script src="assets/bundle.js"></script><img src="field.png">', None),
    ],
)
def test_a_page_that_fetches_something_is_told(output, told, caplog):
    page = SimpleNamespace(file=SimpleNamespace(src_uri="index.md"))
    assert _hooks.on_post_page(output, page=page, config=None) is None
    assert caplog.messages == ([] if told is None else [f"index.md fetches {told}"])


def test_the_settings_fetch_nothing():
    built = site()
    assert built["theme"]["font"] is False
    assert "repo_url" not in built  # the theme would ask its host for stars
    assert not [each for each in built.get("extra_css", []) if "//" in each]
    assert "extra_javascript" not in built
