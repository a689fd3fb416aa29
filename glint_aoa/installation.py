"""What is installed: the libraries that this project needs, its extras, and the system's OpenGL."""

import ctypes.util
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution, version

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

__all__ = [
    "LibraryState",
    "SystemLibrary",
    "library_states",
    "system_libraries",
]

_PROJECT = "glint-aoa"
_SYSTEM = {"EGL": "libegl1", "GL": "libgl1"}  # name for the linker, package on Debian


@dataclass(frozen=True)
class LibraryState:
    """A library that is asked for.

    Attributes
    ----------
    name : str
        Its distribution.
    wanted : str
        Versions that will do, such as ``>=1.26``.
    version : str or None
        Version that is installed; None if it is not.
    extra : str or None
        Extra that asks for it; None for what every use needs.
    """

    name: str
    wanted: str
    version: str | None
    extra: str | None = None

    @property
    def is_right(self) -> bool:
        """Whether a version is installed that will do."""
        accepted = Requirement(f"{self.name}{self.wanted}").specifier
        return self.version is not None and accepted.contains(self.version, prereleases=True)

    @property
    def problem(self) -> str | None:
        """What is wrong, and what to do about it; None if nothing is."""
        if self.is_right:
            return None
        found = "is not installed" if self.version is None else f"is {self.version}"
        what = f"{self.name}{self.wanted}" if self.extra is None else f"{_PROJECT}[{self.extra}]"
        return f'{self.name} {found}, wanted is {self.wanted or "any"}; pip install "{what}"'


@dataclass(frozen=True)
class SystemLibrary:
    """A library of the system that only the OpenGL renderer needs.

    Attributes
    ----------
    name : str
        Name for the linker.
    package : str
        Debian's package.
    file : str or None
        File that the linker finds; None if there is none.
    """

    name: str
    package: str
    file: str | None


def library_states(project: str = _PROJECT) -> list[LibraryState]:
    """Return the libraries that an installed distribution asks for, those of all uses first.

    Parameters
    ----------
    project : str, optional
        The distribution.

    Returns
    -------
    list of LibraryState
        Empty where the project runs from a source tree that is not installed.
    """
    try:
        asked = distribution(project).requires or []
    except PackageNotFoundError:
        return []
    found = [each for text in asked for each in _states(Requirement(text), project)]
    return sorted(found, key=lambda each: (each.extra or "", each.name.lower()))


def _states(requirement: Requirement, project: str) -> Iterator[LibraryState]:
    """Yield a requirement's state once for each extra that asks for it, or once if all uses do."""
    name, wanted = requirement.name, str(requirement.specifier)
    if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
        yield LibraryState(name, wanted, _version_of(name))
        return
    for extra in distribution(project).metadata.get_all("Provides-Extra") or []:
        if requirement.marker.evaluate({"extra": extra}):
            yield LibraryState(name, wanted, _version_of(name), extra)


def _version_of(name: str) -> str | None:
    try:
        return version(canonicalize_name(name))
    except PackageNotFoundError:
        return None


def system_libraries() -> list[SystemLibrary]:
    """Return the system's libraries for OpenGL without a screen, and where they are."""
    return [
        SystemLibrary(name, package, ctypes.util.find_library(name))
        for name, package in _SYSTEM.items()
    ]
