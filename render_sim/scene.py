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
from glint_aoa.setup.section import (
    Count,
    Metres,
    Number,
    PositiveCount,
    PositiveHertz,
    PositiveMetres,
    Radians,
    quantity,
)

__all__ = [
    "Air",
    "Body",
    "Lamp",
    "Marking",
    "Optics",
    "Recorder",
    "Scene",
    "Sensor",
    "Shake",
    "Surface",
    "load_scene",
    "paper_scene",
]

_NotNegative = Annotated[Number, Field(ge=0)]
_Positive = Annotated[Number, Field(gt=0)]
_Share = Annotated[Number, Field(ge=0, le=1)]
_Time = Annotated[float, quantity("s"), Field(ge=0, allow_inf_nan=False)]
_Length = Annotated[Metres, Field(ge=0)]
_Place = tuple[Metres, Metres, Metres]


class _Keys:
    """A part of a scene file; keys that it does not know are errors."""

    __pydantic_config__ = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class Marking(_Keys):
    """A patch of the body with a surface of its own: a paint stripe, a panel joint, a screw.

    It reaches half its length to either side of its station and half its width to either side of
    its azimuth. It lies in the body's surface: it has no height, and casts no shadow.

    Attributes
    ----------
    station_m : float
        Model x of its middle.
    length_m : float or None
        Extent along the axis; the whole body if None.
    azimuth_rad : float
        Of its middle about the axis: 0 on top, positive towards model +y [rad].
    width_m : float or None
        Extent round the body, as an arc about the axis where the body is thickest; all round if
        None.
    outline : {"rectangle", "ellipse"}
        Whether it fills its length and width or the ellipse within.
    roughness, specular, diffuse : float or None
        As of `Surface`; the body's own if None.
    """

    station_m: Annotated[Metres, Field(alias="station")] = 0.0
    length_m: Annotated[PositiveMetres | None, Field(alias="length")] = None
    azimuth_rad: Annotated[Radians, Field(alias="azimuth")] = 0.0
    width_m: Annotated[PositiveMetres | None, Field(alias="width")] = None
    outline: Literal["rectangle", "ellipse"] = "rectangle"
    roughness: _Positive | None = None
    specular: _Share | None = None
    diffuse: _NotNegative | None = None

    def __post_init__(self) -> None:
        """Refuse an ellipse without both its axes."""
        if self.outline == "ellipse" and None in {self.length_m, self.width_m}:
            raise ValueError("an ellipse needs both length and width")

    def surface_on(self, own: "Surface") -> "Surface":
        """Return its surface on a body whose own is given."""
        told = {name: getattr(self, name) for name in ("roughness", "specular", "diffuse")}
        return replace(own, **{name: each for name, each in told.items() if each is not None})


@dataclass(frozen=True)
class Body(_Keys):
    """The fuselage, a tube with a nose about the model's x axis, or a mesh file.

    Attributes
    ----------
    shape : {"ogive-cylinder", "cone-cylinder", "superellipse"}
        A round tube with a tangent-ogive or with a conical nose; or a tube whose section is
        |y / half width|^n + |z / half height|^n = 1, tapered to its tip as the ogive is.
    radius_m : float
        Radius of the cylinder; with a mesh file, the radius that the mirror line is computed for.
    half_width_m, half_height_m : float or None
        Half axes of a superellipse along model y and z; the radius if None.
    exponent : float
        Its exponent n, 2 for an ellipse; the greater, the squarer.
    base_station_m, shoulder_station_m, nose_station_m : float
        Model x of the tube's aft end, of its forward end, and of the nose's tip.
    mesh : Path or None
        An STL, OBJ, GLB or PLY file in the model frame; used instead of the above by the renderer
        that draws meshes.
    mesh_unit_m : float
        Length that the mesh file calls one.
    markings : tuple of Marking
        What is painted on it; the later ones cover the earlier ones.
    """

    shape: Literal["ogive-cylinder", "cone-cylinder", "superellipse"] = "ogive-cylinder"
    radius_m: Annotated[PositiveMetres, Field(alias="radius")] = 0.060
    half_width_m: Annotated[PositiveMetres | None, Field(alias="half_width")] = None
    half_height_m: Annotated[PositiveMetres | None, Field(alias="half_height")] = None
    exponent: Annotated[Number, Field(ge=2, le=6)] = 2.5
    base_station_m: Annotated[Metres, Field(alias="base_station")] = -0.45
    shoulder_station_m: Annotated[Metres, Field(alias="shoulder_station")] = 1.0
    nose_station_m: Annotated[Metres, Field(alias="nose_station")] = 1.25
    mesh: Path | None = None
    mesh_unit_m: Annotated[PositiveMetres, Field(alias="mesh_unit")] = 1.0
    markings: Annotated[tuple[Marking, ...], Field(alias="marking")] = ()

    @property
    def is_round(self) -> bool:
        """Whether a section of it is a circle, as far as its dimensions say."""
        return self.mesh is not None or self.shape != "superellipse"

    @property
    def half_axes_m(self) -> tuple[float, float]:
        """Half width and half height of its tube [m]."""
        if self.is_round:
            return self.radius_m, self.radius_m
        return self.half_width_m or self.radius_m, self.half_height_m or self.radius_m


@dataclass(frozen=True)
class Lamp(_Keys):
    """A rectangular lamp, level and parallel to tunnel X; a spot if it is short.

    Attributes
    ----------
    centre_m : tuple of float
        X, Y, Z of its centre in the tunnel frame.
    length_m, width_m : float
        Extent along X and along Y.
    radiance : float
        Radiance of its surface [arbitrary unit; the exposure is set by `Sensor.peak_level`].
    aim_m : tuple of float or None
        X, Y, Z of what it shines at; straight down if None.
    beam : float
        Its light falls off as the cosine of the angle to its aim to this power: 1 for a matte
        surface, 50 for a narrow spot, 0 for a bulb [-].
    """

    centre_m: Annotated[_Place, Field(alias="centre")] = (0.0, -0.6, 1.5)
    length_m: Annotated[PositiveMetres, Field(alias="length")] = 3.0
    width_m: Annotated[PositiveMetres, Field(alias="width")] = 0.06
    radiance: _Positive = 1.0
    aim_m: Annotated[_Place | None, Field(alias="aim")] = None
    beam: _NotNegative = 1.0


@dataclass(frozen=True)
class Surface(_Keys):
    """How the body reflects, and what surrounds it.

    Attributes
    ----------
    distribution : {"beckmann", "ggx"}
        Of the surface's slopes; GGX has the longer tails of worn metal.
    roughness : float
        Its m: for Beckmann's root mean square slope times sqrt 2; isotropic [-].
    specular : float
        Mirror reflectance at right angles [-].
    diffuse : float
        Lambertian albedo [-].
    ambient : float
        Radiance of the uniform surroundings, seen by the diffuse part [as `Lamp.radiance`].
    wall : float
        Radiance of the far tunnel wall, seen past the body [as `Lamp.radiance`].
    """

    distribution: Literal["beckmann", "ggx"] = "beckmann"
    roughness: _Positive = 0.040
    specular: _Share = 0.6
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
    defocus_m : float
        Radius of the disc on the sensor that a point is spread over out of focus [m].
    f_number : float
        Focal length over the pupil's diameter, for diffraction; 0 for none [-].
    wavelength_m : float
        Wavelength of the light [m].
    vignetting : float
        How far light falls off as the fourth power of the cosine of the angle to the optical axis:
        0 not at all, 1 as it does in a thin lens [-].
    """

    blur_lines: _NotNegative = 0.5
    defocus_m: Annotated[_Length, Field(alias="defocus")] = 0.0
    f_number: _NotNegative = 0.0
    wavelength_m: Annotated[PositiveMetres, Field(alias="wavelength")] = 550e-9
    vignetting: _NotNegative = 0.0


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
class Air(_Keys):
    """What comes between body and lens, and how the light changes in time.

    Attributes
    ----------
    fog : tuple of float
        Share of the light that fog lets through at the first field and at the last; linear between.
    airlight_level : float
        What fully dense fog shines with by itself [grey levels].
    flicker : float
        Half the light's swing over its mean, at twice the mains frequency.
    mains_hz : float
        The mains frequency [Hz].
    """

    fog: tuple[_Share, _Share] = (1.0, 1.0)
    airlight_level: _NotNegative = 30.0
    flicker: _Share = 0.0
    mains_hz: Annotated[PositiveHertz, Field(alias="mains")] = 60.0


@dataclass(frozen=True)
class Shake(_Keys):
    """A vibration of the camera about its perspective centre: one sine.

    Attributes
    ----------
    axis : {"roll", "tilt", "pan"}
        Roll about the optical axis, tilt up, pan to the left in the image.
    amplitude_rad : float
        Half its swing [rad].
    frequency_hz : float
        Its frequency [Hz].
    phase_rad : float
        Its phase at the trigger [rad].
    """

    axis: Literal["roll", "tilt", "pan"]
    amplitude_rad: Annotated[Radians, Field(alias="amplitude")]
    frequency_hz: Annotated[PositiveHertz, Field(alias="frequency")]
    phase_rad: Annotated[Radians, Field(alias="phase")] = 0.0


@dataclass(frozen=True)
class Recorder(_Keys):
    """What camera and recorder do wrong.

    Attributes
    ----------
    gain_drift : float
        Relative change of the gain in a second [1/s].
    black_drift : float
        Change of the black level in a second [grey levels / s].
    line_jitter : float
        Standard deviation of where single lines start [columns].
    line_time_s : float
        From one line's exposure to the next one's, for a rolling shutter [s]; 0 for a global one.
    dead_columns : tuple of int
        Columns of the window that see nothing.
    dropped, repeated : tuple of int
        Exposures, counted from 0, that are not stored, and that are stored twice.
    parity_is_wrong : bool
        Whether the recording states the other parity.
    timestamps : bool
        Whether the true times of the exposures are stored.
    """

    gain_drift: Number = 0.0
    black_drift: Number = 0.0
    line_jitter: _NotNegative = 0.0
    line_time_s: Annotated[_Time, Field(alias="line_time")] = 0.0
    dead_columns: tuple[Count, ...] = ()
    dropped: tuple[Count, ...] = ()
    repeated: tuple[Count, ...] = ()
    parity_is_wrong: bool = False
    timestamps: bool = False


@dataclass(frozen=True)
class Scene(_Keys):
    """A whole test section.

    Attributes
    ----------
    camera : Camera
        Inner orientation, distortion and pose of the camera.
    fields : Fields
        Field rate, exposure, window and parity of the recording.
    body, lamp, surface, air, optics, sensor, recorder
        The parts; see their classes.
    other_lamps : tuple of Lamp
        Lamps besides the one whose glint is measured.
    shake : tuple of Shake
        How the camera vibrates.
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
    other_lamps: Annotated[tuple[Lamp, ...], Field(alias="other_lamp")] = ()
    surface: Surface = Surface()
    optics: Optics = Optics()
    sensor: Sensor = Sensor()
    air: Air = Air()
    recorder: Recorder = Recorder()
    shake: tuple[Shake, ...] = ()
    nose: Literal["left", "right"] = "left"
    view_station_m: Annotated[Metres, Field(alias="view_station")] = 0.45
    package_station_m: Annotated[Metres, Field(alias="package_station")] = 0.9
    glint_y_m: Annotated[Metres, Field(alias="glint_y")] = -0.049

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The body's own surface, then the others that its markings have, each once."""
        marked = (each.surface_on(self.surface) for each in self.body.markings)
        return tuple(dict.fromkeys((self.surface, *marked)))

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
