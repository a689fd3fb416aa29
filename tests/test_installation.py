"""What is installed, from the metadata of distributions that stand on the path."""

import importlib
import sys

import pytest

from glint_aoa import installation
from glint_aoa.installation import LibraryState, library_states, system_libraries

METADATA = """Metadata-Version: 2.1
Name: {name}
Version: {version}
"""


@pytest.fixture
def distributions(tmp_path, monkeypatch):
    """Write the metadata of distributions, by name: version and further lines."""

    def write(**versions):
        for name, (version, *lines) in versions.items():
            folder = tmp_path / f"{name}-{version}.dist-info"
            folder.mkdir()
            text = METADATA.format(name=name.replace("_", "-"), version=version)
            (folder / "METADATA").write_text(text + "".join(f"{line}\n" for line in lines))
        monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
        importlib.invalidate_caches()

    return write


def test_each_requirement_is_looked_at_once_for_each_extra(distributions):
    distributions(
        our_project=(
            "1.0",
            "Requires-Dist: Able_Lib>=2.0",
            "Requires-Dist: oldlib<3,>=2",
            "Requires-Dist: nolib",
            'Requires-Dist: otherlib>=1; python_version < "3"',
            'Requires-Dist: page-lib>=5; extra == "monitor"',
            'Requires-Dist: page-lib>=5; extra == "live"',
            "Provides-Extra: monitor",
            "Provides-Extra: live",
        ),
        able_lib=("2.10rc1",),
        oldlib=("1.9",),
    )
    states = library_states("our-project")
    assert [(each.name, each.version, each.extra, each.is_right) for each in states] == [
        ("Able_Lib", "2.10rc1", None, True),
        ("nolib", None, None, False),
        ("oldlib", "1.9", None, False),
        ("page-lib", None, "live", False),
        ("page-lib", None, "monitor", False),
    ]
    assert [each.problem for each in states] == [
        None,
        'nolib is not installed, wanted is any; pip install "nolib"',
        'oldlib is 1.9, wanted is <3,>=2; pip install "oldlib<3,>=2"',
        'page-lib is not installed, wanted is >=5; pip install "glint-aoa[live]"',
        'page-lib is not installed, wanted is >=5; pip install "glint-aoa[monitor]"',
    ]


def test_a_project_that_is_not_installed_asks_for_nothing():
    assert library_states("no-such-project") == []


@pytest.mark.parametrize(("version", "right"), [("1.26", True), ("1.25.9", False), (None, False)])
def test_the_version_decides(version, right):
    assert LibraryState("numpy", ">=1.26", version).is_right == right


def test_the_system_s_libraries_come_with_their_packages(monkeypatch):
    there = {"EGL": "libEGL.so.1"}
    monkeypatch.setattr(installation.ctypes.util, "find_library", there.get)
    assert [(each.package, each.file) for each in system_libraries()] == [
        ("libegl1", "libEGL.so.1"),
        ("libgl1", None),
    ]
