"""The setup file that ``glint-aoa init`` writes: nothing in it may drift from the models."""

import re
import tomllib
from typing import get_args, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from glint_aoa.errors import SetupError
from glint_aoa.setup import Setup, load_setup
from glint_aoa.setup.section import FILL_IN, Section, unfilled
from glint_aoa.setup.template import NEEDED, parse_value, set_value, setup_template

KNOWN = {
    "camera": {
        "focal_length": "35 mm",
        "pixel_pitch": ["11.7 um", "27.5 um"],
        "sensor": [752, 240],
        "position": ["0 m", "-56 in", "60 mm"],
    },
    "glint": {"nose": "right"},
}
SECTIONS = {
    "glint.reference",
    "glint.reflection",
    "inertial.channel",
    "inertial.mode",
    "plan.vibration",
    "uncertainty.reflection",
}
"""Sections that stand as comments."""


def keys(section=Setup, where=""):
    """Every key of the setup by its dotted name: its field, and the section it stands in."""
    for key, field in section.model_fields.items():
        if key == "folder":  # of the file itself
            continue
        yield f"{where}{key}", field, section
        for each in (field.annotation, *get_args(field.annotation)):
            if isinstance(each, type) and issubclass(each, Section):
                yield from keys(each, f"{where}{key}.")


FIELDS = {name: (field, section) for name, field, section in keys()}


def comments(text):
    """The optional keys that a file shows: dotted name, value, and whether it is an example."""
    section = ""
    for line in text.splitlines():
        header = re.fullmatch(r"#?\[+([\w.]+)\]+", line)
        key = re.fullmatch(r"#(\w+) = (.*?)(  # example)?", line)
        section = header[1] if header else section
        if key:
            yield f"{section}.{key[1]}", tomllib.loads(f"value = {key[2]}")["value"], bool(key[3])


def names_in(content, where=""):
    """The dotted names of what a file holds, of several sections the first's."""
    for key, value in content.items():
        yield f"{where}{key}"
        inner = value[0] if isinstance(value, list) else value
        if isinstance(inner, dict):
            yield from names_in(inner, f"{where}{key}.")


def test_every_key_has_a_meaning():
    assert [name for name, (field, _) in FIELDS.items() if not field.description] == []


def test_every_number_has_a_unit():
    """A number that only counts says so: [1], but where it is every how many columns."""
    numbers = {
        name: field.description
        for name, (field, _) in FIELDS.items()
        if re.search(r"\b(float|int)\b", str(field.annotation))
    }
    lacking = [name for name, words in numbers.items() if not re.search(r"\[[^\]]+\]", words)]
    assert lacking == ["glint.column_step"]


def test_the_file_names_every_key_once_with_its_meaning():
    text = setup_template(KNOWN)
    shown = [name for name, _, _ in comments(text)]
    assert sorted({*shown, *names_in(tomllib.loads(text))} | SECTIONS) == sorted(FIELDS)
    assert len(shown) == len(set(shown))
    words = " ".join(line.removeprefix("# ") for line in text.splitlines())
    assert [name for name, (field, _) in FIELDS.items() if field.description not in words] == []


def test_a_filled_file_gives_the_values_and_the_defaults(tmp_path):
    (tmp_path / "glint-aoa.toml").write_text(setup_template(KNOWN))
    setup = load_setup(tmp_path / "glint-aoa.toml")
    assert setup == Setup.model_validate({**KNOWN, "folder": tmp_path})


def test_a_new_file_is_refused_until_it_is_filled_in(tmp_path):
    path = tmp_path / "glint-aoa.toml"
    text = setup_template()
    path.write_text(text)
    sentence = (
        f"{path}: fill in camera.focal_length, camera.pixel_pitch, camera.sensor, camera.position "
        'and glint.nose; put a value in place of each "FILL IN"'
    )
    with pytest.raises(SetupError, match=f"^{re.escape(sentence)}$"):
        load_setup(path)
    for name in NEEDED[:-1]:
        section, key = name.split(".")
        text = re.sub(rf"^{key} = .*", f"{key} = {KNOWN[section][key]!r}", text, flags=re.M)
    path.write_text(text)
    sentence = f'{path}: fill in glint.nose; put a value in place of each "FILL IN"'
    with pytest.raises(SetupError, match=f"^{re.escape(sentence)}$"):
        load_setup(path)
    path.write_text(text.replace(f'nose = "{FILL_IN}"', 'nose = "right"'))
    assert load_setup(path) == Setup.model_validate({**KNOWN, "folder": tmp_path})


def test_a_part_that_is_not_filled_in_is_named():
    content = {"camera": {"position": ["0 m", FILL_IN, FILL_IN]}, "inertial": {"mode": [{}]}}
    assert unfilled(content) == ["camera.position"]


def test_the_values_in_comments_are_the_defaults_or_examples_of_what_has_none():
    for name, value, is_example in comments(setup_template()):
        field, section = FIELDS[name]
        kind = get_type_hints(section, include_extras=True)[name.rsplit(".", 1)[-1]]
        meant = TypeAdapter(kind).validate_python(value)
        assert is_example == (field.is_required() or field.default in (None, ())), name
        if not is_example:
            assert meant == field.default, name


def test_all_optional_lines_together_are_a_setup():
    text = re.sub(r"^#(?=\w+ = |\[)", "", setup_template(KNOWN), flags=re.MULTILINE)
    content = tomllib.loads(text)
    assert set(names_in(content)) == set(FIELDS)
    setup = Setup.model_validate(content)
    assert setup.glint.reference.rows == (80, 92)
    assert setup.inertial.mode[0].radius == pytest.approx(31 * 0.0254)


def test_what_a_calibration_gives_is_not_asked_for():
    text = setup_template({"calibration": {"camera": "camera.toml", "pose": "pose.toml"}})
    assert unfilled(tomllib.loads(text)) == ["camera.sensor", "glint.nose"]


def test_several_sections_of_a_kind_are_written_one_after_the_other(tmp_path):
    modes = [
        {"number": n, "plane": plane, "frequency": f"{hz} Hz", "radius": f"{radius} in"}
        for n, plane, hz, radius in ((1, "yaw", 9.8, 31.0), (2, "pitch", 9.2, 30.2))
    ]
    values = {**KNOWN, "inertial": {"mode": modes, "filter": {"order": 4}}}
    (tmp_path / "setup.toml").write_text(setup_template(values))
    setup = load_setup(tmp_path / "setup.toml")
    assert setup == Setup.model_validate({**values, "folder": tmp_path})
    assert setup.inertial.filter.order == 4


lengths = st.floats(-1e3, 1e3).map(lambda x: f"{x!r} mm")
some = st.fixed_dictionaries(
    {},
    optional={
        "glint": st.fixed_dictionaries(
            {"nose": st.sampled_from(["left", "right"])},
            optional={
                "y": lengths,
                "column_step": st.integers(1, 99),
                "half_width": st.floats(0.1, 100),
                "search_window": st.tuples(st.integers(0, 50), st.integers(51, 99)).map(list),
                "vibration": st.lists(st.sampled_from(["9.8 Hz", "20 Hz"]), max_size=3),
            },
        ),
        "fields": st.fixed_dictionaries(
            {}, optional={"interlaced": st.booleans(), "first_parity": st.just("odd")}
        ),
        "calibration": st.just({"sweep": 'a "quoted"\\ name\twith é.toml'}),
        "uncertainty": st.fixed_dictionaries({}, optional={"y": st.just("1 mm")}),
    },
)


@given(some)
def test_whatever_is_given_comes_back(values):
    text = setup_template(values, needed=())
    assert Setup.model_validate(tomllib.loads(text)) == Setup.model_validate(values)
    said = {key: value for key, value in tomllib.loads(text).items() if key in values}
    assert said == values


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"glint": {"nsoe": "left"}}, "unknown key glint.nsoe; did you mean nose?"),
        (
            {"camera": {"focal_length": "35 kg"}},
            "camera.focal_length: '35 kg' is not a quantity in m",
        ),
        ({"inertial": {"mode": [{"number": 1}]}}, "inertial.mode[0].plane: missing"),
        (
            {"uncertainty": {"reflection": {}}},
            "uncertainty.reflection is given without glint.reflection; describe body and lamp "
            "there, or take [uncertainty.reflection] out",
        ),
    ],
)
def test_what_no_setup_can_say_is_refused_though_others_are_not_known_yet(values, sentence):
    with pytest.raises(SetupError, match=f"^{re.escape(sentence)}$"):
        setup_template(values)


def test_a_value_is_read_as_toml_or_else_as_a_string():
    assert [parse_value(text) for text in ("20", "[0, 92]", "true", "35 mm", '"a b"')] == [
        *(20, [0, 92], True, "35 mm", "a b")
    ]


def test_a_key_below_a_value_is_refused():
    values = {"glint": 3}
    sentence = "glint.nose: glint has a value already; give it once, or key by key"
    with pytest.raises(SetupError, match=f"^{re.escape(sentence)}$"):
        set_value(values, "glint.nose", "left")
