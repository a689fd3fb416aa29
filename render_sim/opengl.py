"""The OpenGL renderer: pyrender, made to write linear radiance in floating point.

A stock pyrender image has 8 bits, a gamma and 4 samples a pixel, which would move the centre of a
narrow glint by hundredths of a line. This one draws into a 32-bit float framebuffer without
multisampling, with a shader of the formula in `render_sim.light`, several fragments a line; they
are integrated over the pixel's response as the built-in renderer's rays are.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from render_sim._pyrender_repairs import egl_context, import_pyrender
from render_sim.bodies import fuselage_mesh
from render_sim.light import lamp_samples
from render_sim.markings import column_blur, extents
from render_sim.mesh_file import read_mesh
from render_sim.motion import rigid
from render_sim.pixel import Blur, exposure_gain, integrate_lines
from render_sim.projection import Pinhole, window_lines
from render_sim.scene import Scene, Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["PyrenderRenderer"]

Floats = NDArray[np.float64]
_SHADERS = Path(__file__).parent
_NEAR_M, _FAR_M = 0.1, 10.0
_STRIPS = 4  # fragments a column, where markings end within columns


class PyrenderRenderer:
    """Draws the body's mesh with OpenGL, off screen.

    Parameters
    ----------
    scene : Scene
        The scene. Any mesh will do; its lens must be free of distortion.
    subsamples : int
        Fragments a line; 8 move the glint's centre by less than 0.0001 line.
    sides : int
        Facets round the built-in body; 512 move the whole glint by 0.0004 line.

    Raises
    ------
    InputError
        If the camera's lens has distortion, or the mesh file cannot be read.
    MissingLibraryError
        If there is no OpenGL on this machine.

    Notes
    -----
    All instances of one process share one OpenGL context. A process that has used it must not
    fork; start workers with ``spawn``.
    """

    name = "pyrender"

    def __init__(self, scene: Scene, *, subsamples: int = 8, sides: int = 512) -> None:
        if any(scene.camera.distortion):
            raise InputError(
                "the pyrender renderer cannot show camera.distortion; use the raytrace renderer"
            )
        pyrender = import_pyrender()
        egl_context().make_current()
        self._scene = scene
        self._subsamples = subsamples
        self._gain = exposure_gain(scene)
        self._blur = Blur.of(scene)
        self._lens = Pinhole.of(scene)
        # markings are as sharp across the columns as across the lines; the glint is not
        self._strips = _STRIPS if scene.body.markings else 1
        self._across = column_blur(scene) if scene.body.markings else Blur()
        width = (scene.sensor.columns + 2 * self._across.margin) * self._strips
        height = (scene.sensor.rows + 2 * self._blur.margin) * subsamples
        parts = _parts(scene, sides)
        shades = _constants(scene, min(each.roughness for _, each in parts))
        self._renderer = _linear_renderer(pyrender, width, height, shades)
        self._stage = pyrender.Scene(bg_color=[scene.surface.wall, 0.0, 0.0, 1.0])
        mesh = pyrender.Mesh.from_trimesh([part for part, _ in parts])
        for primitive, (_, surface) in zip(mesh.primitives, parts, strict=True):
            self._renderer.surfaces[id(primitive)] = _numbers(surface)
        self._body = self._stage.add(mesh)
        self._camera = self._stage.add(
            self._make_camera(pyrender), pose=_camera_pose(self._lens, np.eye(3))
        )
        self._offscreen = pyrender.RenderFlags.OFFSCREEN

    def _make_camera(self, pyrender: Any) -> Any:
        lens, fields = self._lens, self._scene.fields
        return pyrender.IntrinsicsCamera(
            fx=lens.fx * self._strips,
            fy=lens.fy * self._subsamples,
            cx=(lens.u0 - (fields.first_column or 0) + 0.5 + self._across.margin) * self._strips,
            cy=0.0,  # set for each parity
            znear=_NEAR_M,
            zfar=_FAR_M,
        )

    def radiance(self, poses: Floats, *, parity: int = 0, turns: Floats | None = None) -> Floats:
        """Return one image a pose; see `Renderer.radiance`."""
        egl_context().make_current()
        # pyrender counts rows from the image's upper edge, half a line above the first centre
        edge = window_lines(self._scene, parity=parity)[0] - 0.5 - self._blur.margin
        self._camera.camera.cy = (self._lens.v0 - edge) * self._subsamples
        images = []
        for n, pose in enumerate(poses):
            turn = np.eye(3) if turns is None else turns[n]
            self._stage.set_pose(self._camera, _camera_pose(self._lens, turn))
            images.append(self._draw(pose))
        return np.array(images) * self._gain

    def _draw(self, pose: Floats) -> Floats:
        self._stage.set_pose(self._body, pose)
        fine = self._renderer.render(self._stage, self._offscreen)
        image = integrate_lines(fine, subsamples=self._subsamples, blur=self._blur)
        if self._strips == 1:
            return image
        return integrate_lines(image.T, subsamples=self._strips, blur=self._across).T


def _camera_pose(lens: Pinhole, turn: Floats) -> Floats:
    """Return the pose of an OpenGL camera, which looks along its -z with y up."""
    right, ahead, up = (lens.rotation @ turn).T
    return rigid(np.stack([right, up, -ahead], axis=-1), lens.centre_m)


def _parts(scene: Scene, sides: int) -> list[tuple["trimesh.Trimesh", Surface]]:
    """Return the body's meshes and the surface of each."""
    if scene.body.mesh is not None:
        return read_mesh(scene.body, scene.surface)
    return [(fuselage_mesh(scene.body, sides=sides), scene.surface)]


def _constants(scene: Scene, roughness: float) -> dict[str, str]:
    """Return the numbers that stand in the fragment shader, as GLSL text."""
    samples = lamp_samples(scene, roughness=roughness)
    marks = extents(scene)
    count = len(marks)
    paints = [[*_numbers(scene.surfaces[int(each[5])]), each[4]] for each in marks]
    nothing = np.zeros((1, 4))  # no array may be empty
    return {
        "LAMP_COUNT": str(len(samples)),
        "LAMP_SAMPLES": _vectors(samples[:, :4]),
        "LAMP_BEAMS": _vectors(samples[:, 4:]),
        "GGX": str(scene.surface.distribution == "ggx").lower(),
        "AMBIENT_PART": f"{scene.surface.ambient:.9e}",
        "MARK_COUNT": str(count),
        "MARK_EXTENTS": _vectors(marks[:, :4] if count else nothing),
        "MARK_PAINTS": _vectors(np.array(paints) if count else nothing),
    }


def _numbers(surface: Surface) -> Floats:
    """Return a surface as the shader reads it."""
    return np.array([surface.roughness**2, surface.specular, surface.diffuse])


def _vectors(values: Floats) -> str:
    return ", ".join(f"vec4({', '.join(f'{x:.9e}' for x in each)})" for each in values)


def _linear_renderer(pyrender: Any, width: int, height: int, constants: dict[str, str]) -> Any:
    """Return a pyrender renderer that draws radiance into one float framebuffer."""
    from OpenGL import GL  # noqa: PLC0415
    from pyrender.shader_program import ShaderProgramCache  # noqa: PLC0415

    class LinearRenderer(pyrender.Renderer):  # type: ignore[misc]
        _main_fb: int | None

        def __init__(self) -> None:
            super().__init__(width, height)
            self.surfaces: dict[int, Floats] = {}  # by the primitive's id
            self._program_cache = ShaderProgramCache(shader_dir=str(_SHADERS))

        def _get_primitive_program(self, *_: Any) -> Any:
            program = self._program_cache.get_program(
                "glint.vert.glsl", "glint.frag.glsl", defines=constants
            )
            if not program._in_context():
                program._add_to_context()
            return program

        def _bind_and_draw_primitive(
            self, primitive: Any, pose: Any, program: Any, flags: Any
        ) -> None:
            program.set_uniform("own_surface", self.surfaces[id(primitive)])
            super()._bind_and_draw_primitive(primitive, pose, program, flags)

        def _bind_lighting(self, *_: Any) -> None:
            """Leave pyrender's lights alone: the lamp stands in the shader."""

        def _configure_main_framebuffer(self) -> None:
            if self._main_fb is not None:
                return
            self._main_cb, self._main_db = GL.glGenRenderbuffers(2)
            self._main_fb = self._main_fb_ms = GL.glGenFramebuffers(1)
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
            for buffer, kind, place in (
                (self._main_cb, GL.GL_RGBA32F, GL.GL_COLOR_ATTACHMENT0),
                (self._main_db, GL.GL_DEPTH_COMPONENT24, GL.GL_DEPTH_ATTACHMENT),
            ):
                GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, width, height)
                GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, buffer)
            self._main_fb_dims = (width, height)

        def _delete_main_framebuffer(self) -> None:
            if self._main_fb is not None:
                GL.glDeleteFramebuffers(1, [self._main_fb])
                GL.glDeleteRenderbuffers(2, [self._main_cb, self._main_db])
            self._main_fb = self._main_fb_ms = self._main_cb = self._main_db = None

        def _read_main_framebuffer(self, *_: Any) -> NDArray[np.float32]:
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
            pixels = GL.glReadPixels(0, 0, width, height, GL.GL_RED, GL.GL_FLOAT)
            image = np.frombuffer(pixels, dtype=np.float32).reshape(height, width)
            return image[::-1]  # OpenGL's first row is the lowest

    return LinearRenderer()
