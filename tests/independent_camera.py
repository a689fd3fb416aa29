"""Recordings of a straight line, made from the written conventions alone.

Nothing of the program is used: OpenCV projects, h5py writes. What the program reads back is held
against the closed form that the line was drawn from.
"""

from dataclasses import dataclass

import cv2
import h5py
import numpy as np
from scipy.special import ndtr

# Camera axes are x right, y along the optical axis, z up; OpenCV's are x right, y down, z ahead.
TO_OPENCV = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

FULL_WELL = 40000.0
READ_NOISE = 0.7


def turned(axis, angle_deg):
    """Right-handed rotation about "x", "y" or "z"."""
    vector = np.eye(3)["xyz".index(axis)] * np.radians(angle_deg)
    return cv2.Rodrigues(vector)[0]


@dataclass(frozen=True)
class Camera:
    """A camera in the tunnel; lengths in metres, angles in degrees."""

    focal: float = 0.035
    pitch: tuple = (11.7e-6, 27.5e-6)
    sensor: tuple = (752, 240)
    principal: tuple = (375.5, 119.5)
    position: tuple = (0.0, -1.4224, 0.060)
    rotation: tuple = (0.0, 0.0, 0.0)
    distortion: tuple = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def toml(self):
        """Return the section of the setup, in other units than the ones used here."""
        inches = [f"{each / 0.0254:.12g} in" for each in self.position]
        return f"""
[camera]
focal_length = "{self.focal * 1e3:.12g} mm"
pixel_pitch = ["{self.pitch[0] * 1e6:.12g} um", "{self.pitch[1] * 1e6:.12g} um"]
sensor = {list(self.sensor)}
principal_point = {list(self.principal)}
position = {inches}
rotation = {[f"{np.radians(each) * 1e3:.12g} mrad" for each in self.rotation]}
distortion = {list(self.distortion)}
"""

    def pixels(self, points):
        """Project tunnel points [m] to sensor columns and even-field lines."""
        omega, phi, kappa = self.rotation
        to_tunnel = turned("z", kappa) @ turned("y", phi) @ turned("x", omega)
        to_camera = TO_OPENCV @ to_tunnel.T
        matrix = np.array(
            [
                [self.focal / self.pitch[0], 0, self.principal[0]],
                [0, self.focal / self.pitch[1], self.principal[1]],
                [0, 0, 1],
            ]
        )
        pixels, _ = cv2.projectPoints(
            np.asarray(points, float).reshape(-1, 1, 3),
            cv2.Rodrigues(to_camera)[0],
            -to_camera @ np.array(self.position),
            matrix,
            np.array(self.distortion, float),
        )
        return pixels[:, 0, 0], pixels[:, 0, 1]


@dataclass(frozen=True)
class Line:
    """A glint on the vertical plane through (0, y) with a heading; metres and degrees."""

    pitch_deg: float = 0.0
    intercept: float = 0.055
    nose: str = "left"
    y: float = 0.0
    yaw_deg: float = 0.0

    @property
    def toml(self):
        return (
            f'\n[glint]\nnose = "{self.nose}"\ny = "{self.y * 1e3:.12g} mm"\n'
            f'yaw = "{self.yaw_deg:.12g} deg"\n'
        )

    def lines_on(self, camera):
        """Return the sensor line, of an even field, at each sensor column."""
        along = np.linspace(-0.4, 0.4, 8001)
        slope = np.tan(np.radians(self.pitch_deg)) * (1 if self.nose == "right" else -1)
        heading = np.radians(self.yaw_deg)
        points = [
            along * np.cos(heading),
            self.y + along * np.sin(heading),
            self.intercept + slope * along,
        ]
        u, v = camera.pixels(np.stack(points, axis=1))
        columns = np.arange(camera.sensor[0])
        assert u[0] < 0
        assert u[-1] > columns[-1]
        return np.interp(columns, u, v)


@dataclass(frozen=True)
class Window:
    """The part of the sensor that was recorded, and how."""

    first_line: int
    n_lines: int = 92
    first_column: int = 0
    n_columns: int = 752
    interlaced: bool = True
    first_parity: str = "even"

    def parity(self, n_fields):
        first = self.first_parity == "odd"
        return (np.arange(n_fields) + first) % 2 * int(self.interlaced)


@dataclass(frozen=True)
class Film:
    """Fields of a line, and how well any estimator could measure it."""

    fields: np.ndarray
    parity: np.ndarray
    window: Window
    angle_bound_deg: float
    intercept_bound_mm: float
    centre_bound_mm: float


@dataclass(frozen=True)
class Light:
    """How the line is drawn: a Gaussian across the line, integrated over each pixel."""

    peak: float = 170.0
    black: float = 10.0
    sigma: float = 1.4
    white: int = 255
    scale: float = 1.0

    def mean(self, distance):
        """Grey level at a distance from the line's centre [lines]."""
        share = ndtr((distance + 0.5) / self.sigma) - ndtr((distance - 0.5) / self.sigma)
        top = 2 * ndtr(0.5 / self.sigma) - 1
        return self.scale * (self.black + (self.peak - self.black) * share / top)

    def variance(self, mean):
        """Shot noise, read noise and rounding [grey level squared]."""
        electrons = FULL_WELL / (self.scale * 255)
        return np.maximum(mean, 0) / electrons + (self.scale * READ_NOISE) ** 2 + 1 / 12


def film(camera, line, window, rng, *, n_fields=24, step=20, light=Light(), dtype=np.uint8):
    """Draw a line at rest."""
    columns = slice(window.first_column, window.first_column + window.n_columns)
    centre = line.lines_on(camera)[columns] - window.first_line
    assert centre.min() > 8
    assert centre.max() < window.n_lines - 8
    row = np.arange(window.n_lines)[:, None]
    parity = window.parity(n_fields)
    mean = np.stack([light.mean(row + 0.5 * p - centre) for p in parity])
    noisy = mean + rng.normal(size=mean.shape) * np.sqrt(light.variance(mean))
    fields = np.clip(np.rint(noisy), 0, light.white).astype(dtype)
    bounds = _bounds(camera, line, window, light, centre, step)
    return Film(fields, parity, window, *bounds)


def _bounds(camera, line, window, light, centre, step):
    """Cramer-Rao bounds of one field from every step-th column.

    Of angle [deg], intercept [mm] and one column's centre [mm]. Small-angle propagation; good to
    a few per cent for the cameras here.
    """
    u = np.arange(step // 2, window.n_columns, step)
    row = np.arange(window.n_lines)[:, None]
    tiny = 1e-3
    sides = [light.mean(row - centre[u] + sign * tiny) for sign in (1, -1)]
    mean = light.mean(row - centre[u])
    information = (((sides[0] - sides[1]) / (2 * tiny)) ** 2 / light.variance(mean)).sum(axis=0)
    weight = information.sum()
    middle = (information * u).sum() / weight
    slope_std = 1 / np.sqrt((information * (u - middle) ** 2).sum())
    angle = np.degrees(slope_std) * camera.pitch[1] / camera.pitch[0]
    zero = camera.pixels([[0, line.y, line.intercept]])[0][0] - window.first_column
    lines = np.hypot(1 / np.sqrt(weight), slope_std * (zero - middle))
    line_mm = 1e3 * camera.pitch[1] * (line.y - camera.position[1]) / camera.focal
    return angle, lines * line_mm, line_mm / np.sqrt(information.mean())


def window_about(camera, line, **how):
    """Return a window of 92 lines with the line in its middle."""
    middle = np.mean(line.lines_on(camera))
    return Window(int(np.clip(round(middle) - 46, 0, camera.sensor[1] - 92)), **how)


def attributes(window, *, rate_hz=60.0, exposure_s=1e-3, start_s=0.0):
    """Return the attributes of /fields."""
    return {
        "rate_hz": rate_hz,
        "exposure_s": exposure_s,
        "first_line": window.first_line,
        "first_column": window.first_column,
        "first_parity": window.first_parity,
        "interlaced": window.interlaced,
        "start_s": start_s,
        "trigger_time": "2024-05-31T14:02:11",
    }


def write_h5(path, filmed=None, *, attrs=None, fields_time=None, channels=None, meta=None):
    """Write a recorded point; `channels` maps a name to samples and attributes."""
    with h5py.File(path, "w") as file:
        if filmed is not None:
            stored = file.create_dataset(
                "fields", data=filmed.fields, chunks=(1, *filmed.fields.shape[1:])
            )
            stored.attrs.update(attributes(filmed.window) if attrs is None else attrs)
        if fields_time is not None:
            file["fields_time"] = fields_time
        for name, (samples, said) in (channels or {}).items():
            channel = file.create_dataset(f"das/{name}", data=samples)
            channel.attrs.update(said)
        file.create_group("meta").attrs.update(meta or {"run": "7", "point": "3"})
    return path
