"""What a renderer is, and how one is made."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError, MissingLibraryError
from render_sim.scene import Scene

__all__ = ["Renderer", "make_renderer", "opengl_missing"]

Floats = NDArray[np.float64]


class Renderer(Protocol):
    """Anything that makes noiseless images of one scene."""

    @property
    def name(self) -> str:
        """Its name, as `make_renderer` knows it."""
        ...

    def radiance(self, poses: Floats, *, parity: int = 0, turns: Floats | None = None) -> Floats:
        """Return one image a pose, integrated over pixels, lens blur included.

        Parameters
        ----------
        poses : ndarray
            Poses, model to tunnel [image, 4, 4] [m].
        parity : int
            0 for even fields, 1 for odd ones, whose lines lie half a line lower.
        turns : ndarray, optional
            How the camera is turned about its perspective centre in each image, from its own axes
            (x right, y along the optical axis, z up) to those it has in the scene [image, 3, 3].

        Returns
        -------
        ndarray
            Linear light in grey levels above black [image, row, column].
        """
        ...


def make_renderer(scene: Scene, name: Literal["auto", "raytrace", "pyrender"] = "auto") -> Renderer:
    """Make a renderer for a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    name : {"auto", "raytrace", "pyrender"}
        ``raytrace`` casts rays at a cylinder and needs no OpenGL; ``pyrender`` draws any mesh.
        ``auto`` takes the first, unless the body is a mesh file.

    Raises
    ------
    InputError
        If there is no renderer of that name, or it cannot show this scene.
    MissingLibraryError
        If ``pyrender`` is asked for and there is no OpenGL on this machine.
    """
    if name == "auto":
        name = "raytrace" if scene.body.mesh is None else "pyrender"
    if name == "raytrace":
        from render_sim.raytrace import RaytraceRenderer  # noqa: PLC0415  numba is slow to import

        return RaytraceRenderer(scene)
    if name == "pyrender":
        from render_sim.opengl import PyrenderRenderer  # noqa: PLC0415  OpenGL may be missing

        return PyrenderRenderer(scene)
    raise InputError(f"unknown renderer {name!r}; choose auto, raytrace or pyrender")


def opengl_missing() -> str | None:
    """Say in one sentence what the OpenGL renderer lacks on this machine; None if it works."""
    from render_sim._pyrender_repairs import egl_context  # noqa: PLC0415  loads OpenGL

    try:
        egl_context()
    except MissingLibraryError as error:
        return str(error)
    return None
