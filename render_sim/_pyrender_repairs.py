"""Imports pyrender 0.1.45 on today's numpy, without a screen, a viewer or X libraries.

Three things are mended: pyrender imports a viewer that needs a window system; its meshes' bounds
use a name that numpy 2 dropped; and PyOpenGL must be told to use EGL before it is first imported.
"""

import contextlib
import os
import sys
import types
import warnings
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from glint_aoa.errors import MissingLibraryError

__all__ = ["egl_context", "import_pyrender"]

_ADVICE = "the pyrender renderer needs OpenGL; install libegl1 and libgl1, or use raytrace"


@cache
def import_pyrender() -> Any:
    """Return the mended pyrender module.

    Raises
    ------
    MissingLibraryError
        If pyrender or the system's OpenGL libraries are missing.
    """
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    try:
        with _without_viewer(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pyrender  # noqa: PLC0415
            import pyrender.platforms.egl  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingLibraryError(f"{error.name} is not installed; pip install pyrender") from None
    except Exception:  # PyOpenGL raises whatever the missing library made it stumble over
        raise MissingLibraryError(_ADVICE) from None
    pyrender.Mesh.bounds = property(_bounds)
    return pyrender


@contextlib.contextmanager
def _without_viewer() -> Iterator[None]:
    """Let ``from .viewer import Viewer`` find an empty class."""
    name = "pyrender.viewer"
    stub = types.ModuleType(name)
    stub.Viewer = type("Viewer", (), {})  # type: ignore[attr-defined]
    before = sys.modules.get(name)
    sys.modules[name] = before or stub
    try:
        yield
    except BaseException:
        if before is None:
            del sys.modules[name]
        raise


def _bounds(mesh: Any) -> Any:
    """Return the least and greatest corner of a mesh [2, 3]."""
    corners = np.array([primitive.bounds for primitive in mesh.primitives])
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


@cache
def egl_context() -> Any:
    """Return the process's one EGL context, made current.

    It is never given back: destroying one takes every other renderer's display with it.

    Raises
    ------
    MissingLibraryError
        If there is no OpenGL on this machine.
    """
    pyrender = import_pyrender()
    try:
        platform = pyrender.platforms.egl.EGLPlatform(1, 1)
        platform.init_context()
    except Exception:
        raise MissingLibraryError(_ADVICE) from None
    return platform
