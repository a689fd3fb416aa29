"""Setup files drawn at random: a valid setup, or one sentence that names the key."""

import argparse
import copy
import datetime
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomli_w
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from glint_aoa.errors import InputError
from glint_aoa.setup import load_setup

__all__ = ["check_setups", "judge", "main"]

FILES = 8_000
_DOCUMENTED = Path(__file__).parents[1] / "docs" / "files.md"

_UNITS = ("m", "mm", "in", "deg", "rad", "Hz", "ms", "K", "g_0", "1/K", "furlong", "m/s^2", "")
_ODD = (
    True, False, 0, 1, -1, 2**63, -(2**40), 0.0, -0.5, 1e-320, 1e308, float("nan"),
    float("inf"), "", " ", "nan m", "inf Hz", "1e999 mm", "-3 mm", "0 Hz", "3", "m", "1 2 mm",
    "__import__('os')", "../../x.toml", "left", "yaw", "+y", [], [[]], {}, [1, 2], ["1 mm"] * 3,
    [0, 0, 0], [1.0] * 5, {"rows": [1, 2]}, datetime.date(2026, 1, 12),
)  # fmt: skip


def whole_setup() -> dict[str, Any]:
    """Return the setup of the documents, which holds every key, but for the calibrations' files."""
    text = _DOCUMENTED.read_text(encoding="utf-8")
    block = re.search(r"```toml\n(\[camera\].*?)```", text, re.DOTALL)
    if block is None:
        raise LookupError(f"{_DOCUMENTED}: no setup file in it")
    content = tomllib.loads(block[1])
    del content["calibration"]
    return content


_values = st.one_of(
    st.sampled_from(_ODD).map(copy.deepcopy),  # what is drawn may be spoilt in its turn
    st.floats(),
    st.integers(-(2**63), 2**63 - 1),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=12),
    st.builds(lambda number, unit: f"{number:g} {unit}", st.floats(), st.sampled_from(_UNITS)),
    st.lists(st.floats() | st.sampled_from(["1 mm", "2 deg", "0.4 Hz"]), max_size=6),
)


@st.composite
def setups(draw: st.DrawFn) -> bytes:
    """Draw a setup file: the documents' one, spoilt in one to three places or in its text."""
    content = copy.deepcopy(_WHOLE)
    for section in draw(st.sets(st.sampled_from(sorted(_WHOLE)), max_size=len(_WHOLE) - 1)):
        del content[section]
    for _ in range(draw(st.integers(1, 3))):
        _spoil(draw, content)
    text = tomli_w.dumps(content).encode()
    if draw(st.integers(0, 9)) == 0:
        place = draw(st.integers(0, len(text)))
        text = text[:place] + draw(st.binary(max_size=6)) + text[place + draw(st.integers(0, 6)) :]
    return text


def _spoil(draw: st.DrawFn, content: dict[str, Any]) -> None:
    places = list(_places(content))
    if not places:
        content[draw(st.sampled_from(["camera", "glint", "lens"]))] = draw(_values)
        return
    owner, key = draw(st.sampled_from(places))
    match draw(st.sampled_from(["value", "value", "value", "rename", "remove", "add"])):
        case "value":
            owner[key] = draw(_values)
        case "rename" if isinstance(key, str):
            owner[draw(st.sampled_from([key + "s", key[:-1], "folder", key.upper()]))] = owner.pop(
                key
            )
        case "add" if isinstance(key, str):
            owner[draw(st.text("abcdefg_ .", min_size=1, max_size=6))] = draw(_values)
        case _:
            del owner[key]


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Every value in a file: what holds it, and under which key or number."""
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in items:
        yield content, key
        if isinstance(value, dict | list):
            yield from _places(value)


_WHOLE = whole_setup()
_KNOWN = {key for _, key in _places(_WHOLE) if isinstance(key, str)}
_KNOWN |= {"calibration", "camera", "pose", "sweep", "first_column"}


def judge(path: Path) -> str | None:
    """Load a setup file; say what is wrong with how it was taken, or None."""
    try:
        load_setup(path)
    except InputError as error:
        text = str(error)
        rest = text.removeprefix(f"{path}: ")
        if rest == text or "\n" in text:
            return f"not a sentence that names the file: {text!r}"
        if rest.startswith(("not a TOML file: ", "the file cannot be read")):
            return None
        words = set(re.findall(r"[A-Za-z_]+", rest))
        return None if words & _KNOWN or rest.startswith("unknown key ") else f"no key: {text!r}"
    except Exception as error:  # whatever it is, it is a failure
        return f"{type(error).__name__}: {error}"
    return None


def check_setups(folder: Path, *, files: int = FILES) -> None:
    """Draw setup files and load them; raise AssertionError at the first that is taken wrongly."""
    path = folder / "glint-aoa.toml"

    @settings(
        max_examples=files,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(text=setups())
    def check(text: bytes) -> None:
        path.write_bytes(text)
        problem = judge(path)
        if problem is not None:
            raise AssertionError(problem)

    check()


def main() -> int:
    """Check so many files; 1 if one is taken wrongly."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.setups", description=__doc__)
    parser.add_argument("--files", type=int, default=FILES)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        try:
            check_setups(Path(folder), files=options.files)
        except AssertionError as error:
            print(f"setup: {error}")
            return 1
    print(f"setup: {options.files} files, each a valid setup or one sentence that names the key")
    return 0


if __name__ == "__main__":
    sys.exit(main())
