"""What stands in the simulated test section: body, lamp, surface, lens, sensor and camera.

Everything is SI and radians in the frames of the project: tunnel X to the right in the image, Y
away from the camera, Z up; model x forward to the nose, z up, its origin at the balance moment
centre. A scene file holds the same as TOML, quantities with their units: the keys are the names of
the attributes, without the unit that these may end in.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from glint_aoa.setup import Camera, Fields, load_section
from glint_aoa.setup.section import Metres, Number, PositiveCount, PositiveMetres

__all__ = ["Body", "Lamp", "Optics", "Scene", "Sensor", "Surface", "load_scene", "paper_scene"]

_NotNegative = Annotated[Number, Field(ge=0)]
_Positive = Annotated[Number, Field(gt=0)]
_Place = tuple[Metres, Metres, Metres]


class _Keys:
    """A part of a scene file; keys that it does not know are errors."""

    __pydantic_config__ = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class Body(_Keys):
    """The fuselage: a tangent-ogive nose on a cylinder about the model's x axis, or a mesh file.

    Attributes
    ----------
    radius_m : float
        Radius of the cylinder; with a mesh file, the radius that the mirror line is computed for.
    base_station_m, shoulder_station_m, nose_station_m : float
        Model x of the cylinder's aft end, of its forward end, and of the nose's tip.
    mesh : Path or None
        A file that trimesh reads, in metres and the model frame; used instead of the above by the
        renderer that draws meshes.
    """

    radius_m: Annotated[PositiveMetres, Field(alias="radius")] = 0.060
    base_station_m: Annotated[Metres, Field(alias="base_station")] = -0.45
    shoulder_station_m: Annotated[Metres, Field(alias="shoulder_station")] = 1.0
    nose_station_m: Annotated[Metres, Field(alias="nose_station")] = 1.25
    mesh: Path | None = None


@dataclass(frozen=True)
class Lamp(_Keys):
    """A long rectangular lamp parallel to tunnel X that shines straight down.

    Attributes
    ----------
    centre_m : tuple of float
        X, Y, Z of its centre in the tunnel frame.
    length_m, width_m : float
        Extent along X and along Y.
    radiance : float
        Radiance of its surface [arbitrary unit; the exposure is set by `Sensor.peak_level`].
    """

    centre_m: Annotated[_Place, Field(alias="centre")] = (0.0, -0.6, 1.5)
    length_m: Annotated[PositiveMetres, Field(alias="length")] = 3.0
    width_m: Annotated[PositiveMetres, Field(alias="width")] = 0.06
    radiance: _Positive = 1.0


@dataclass(frozen=True)
class Surface(_Keys):
    """How the body reflects, and what surrounds it.

    Attributes
    ----------
    roughness : float
        Beckmann's m, root mean square slope times sqrt 2; isotropic [-].
    specular : float
        Mirror reflectance of the metal [-].
    diffuse : float
        Lambertian albedo [-].
    ambient : float
        Radiance of the uniform surroundings, seen by the diffuse part [as `Lamp.radiance`].
    wall : float
        Radiance of the far tunnel wall, seen past the body [as `Lamp.radiance`].
    """

    roughness: _Positive = 0.040
    specular: _NotNegative = 0.6
    diffuse: _NotNegative = 0.22
    ambient: _NotNegative = 0.05
    wall: _NotNegative = 0.006


@dataclass(frozen=True)
class Optics(_Keys):
    """The lens.

    Attributes
    ----------
    blur_lines : float
        Standard deviation of the Gaussian point spread across the lines [field lines].
    """

    blur_lines: _NotNegative = 0.5


@dataclass(frozen=True)
class Sensor(_Keys):
    """The recorded window and how the sensor turns light into grey levels.

    Attributes
    ----------
    rows, columns : int
        Size of the recorded window [field lines, pixels].
    peak_level : float
        Grey level, black included, of the brightest pixel of the static glint at zero pitch.
    black_level : float
        Grey level without light.
    full_well_e : float
        Electrons at the top of the scale; sets the shot noise.
    read_noise : float
        Standard deviation of the read noise [grey levels].
    bits : int
        Bits of a grey level, 8 to 16.
    """

    rows: PositiveCount = 92
    columns: PositiveCount = 752
    peak_level: _Positive = 170.0
    black_level: _NotNegative = 10.0
    full_well_e: _Positive = 40_000.0
    read_noise: _NotNegative = 0.7
    bits: Annotated[PositiveCount, Field(ge=8, le=16)] = 8

    @property
    def top_level(self) -> int:
        """Highest grey level that can be recorded."""
        return (1 << self.bits) - 1


@dataclass(frozen=True)
class Scene(_Keys):
    """A whole test section.

    Attributes
    ----------
    camera : Camera
        Inner orientation, distortion and pose of the camera.
    fields : Fields
        Field rate, exposure, window and parity of the recording.
    body, lamp, surface, optics, sensor
        The parts; see their classes.
    nose : {"left", "right"}
        Where the nose points in the image.
    view_station_m : float
        Model x of the point of the axis that the support keeps at the tunnel's origin.
    package_station_m : float
        Model x of the inertial package.
    glint_y_m : float
        Tunnel Y that the glint is taken to have when it is measured.
    """

    camera: Camera
    fields: Fields
    body: Body = Body()
    lamp: Lamp = Lamp()
    surface: Surface = Surface()
    optics: Optics = Optics()
    sensor: Sensor = Sensor()
    nose: Literal["left", "right"] = "left"
    view_station_m: Annotated[Metres, Field(alias="view_station")] = 0.45
    package_station_m: Annotated[Metres, Field(alias="package_station")] = 0.9
    glint_y_m: Annotated[Metres, Field(alias="glint_y")] = -0.049

    def with_window(self, first_line: int, rows: int) -> "Scene":
        """Return the scene recorded through a window of `rows` lines from `first_line` on."""
        return replace(
            self,
            fields=self.fields.model_copy(update={"first_line": first_line}),
            sensor=replace(self.sensor, rows=rows),
        )


def load_scene(path: Path) -> Scene:
    """Read a scene file; raise SetupError if it cannot be used."""
    scene = load_section(path, Scene)
    mesh = scene.body.mesh
    return (
        scene if mesh is None else replace(scene, body=replace(scene.body, mesh=path.parent / mesh))
    )


@lru_cache(maxsize=1)
def paper_scene() -> Scene:
    """Return the scene of the paper: 752 x 240 interlaced camera at 56 in, 92-line window."""
    with as_file(files("render_sim") / "data" / "scene.toml") as path:
        return load_scene(path)
