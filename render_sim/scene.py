"""What stands in the simulated test section: body, lamp, surface, lens, sensor and camera.

Everything is SI and radians in the frames of the project: tunnel X to the right in the image, Y
away from the camera, Z up; model x forward to the nose, z up, its origin at the balance moment
centre.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from glint_aoa.setup import Camera, Fields

__all__ = ["Body", "Lamp", "Optics", "Scene", "Sensor", "Surface", "paper_scene"]


@dataclass(frozen=True)
class Body:
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

    radius_m: float = 0.060
    base_station_m: float = -0.45
    shoulder_station_m: float = 1.0
    nose_station_m: float = 1.25
    mesh: Path | None = None


@dataclass(frozen=True)
class Lamp:
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

    centre_m: tuple[float, float, float] = (0.0, -0.6, 1.5)
    length_m: float = 3.0
    width_m: float = 0.06
    radiance: float = 1.0


@dataclass(frozen=True)
class Surface:
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

    roughness: float = 0.040
    specular: float = 0.6
    diffuse: float = 0.22
    ambient: float = 0.05
    wall: float = 0.006


@dataclass(frozen=True)
class Optics:
    """The lens.

    Attributes
    ----------
    blur_lines : float
        Standard deviation of the Gaussian point spread across the lines [field lines].
    """

    blur_lines: float = 0.5


@dataclass(frozen=True)
class Sensor:
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

    rows: int = 92
    columns: int = 752
    peak_level: float = 170.0
    black_level: float = 10.0
    full_well_e: float = 40_000.0
    read_noise: float = 0.7
    bits: int = 8

    @property
    def top_level(self) -> int:
        """Highest grey level that can be recorded."""
        return (1 << self.bits) - 1


@dataclass(frozen=True)
class Scene:
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
    view_station_m: float = 0.45
    package_station_m: float = 0.9
    glint_y_m: float = -0.049

    def with_window(self, first_line: int, rows: int) -> "Scene":
        """Return the scene recorded through a window of `rows` lines from `first_line` on."""
        return replace(
            self,
            fields=self.fields.model_copy(update={"first_line": first_line}),
            sensor=replace(self.sensor, rows=rows),
        )


def paper_scene() -> Scene:
    """Return the scene of the paper: 752 x 240 interlaced camera at 56 in, 92-line window.

    The body's radius (60 mm) and the lamp (1.5 m above the axis, 0.6 m towards the camera) are not
    in the paper; they put the glint on the shoulder of the fuselage, in the middle of the window.
    A pitch of 5.000 deg shows as a line at 4.942 deg.
    """
    camera = Camera.model_validate(
        {
            "focal_length": "35 mm",
            "pixel_pitch": ["11.7 um", "27.5 um"],
            "sensor": [752, 240],
            "principal_point": [375.5, 119.5],
            "position": ["0 m", "-56 in", "60 mm"],
        }
    )
    fields = Fields.model_validate(
        {
            "rate": "60 Hz",
            "exposure": "1 ms",
            "first_line": 98,
            "first_column": 0,
            "interlaced": True,
            "first_parity": "even",
        }
    )
    return Scene(camera=camera, fields=fields)
