"""Pictures of calibration boards, drawn from the written conventions alone.

Nothing of the program is used: OpenCV undoes the lens for each part of a pixel, and the pattern is
looked up where the ray meets the board, its edges as soft as the part is large. The parts are then
blurred as the lens does and averaged over the pixel's area.
"""

from dataclasses import dataclass

import cv2
import numpy as np

PARTS = (3, 7)  # of a pixel, across and down: nearly square for a field's pixels
CELL = (15, 14)  # parts: the lens is undone at the middle of cells, linear between them
BLACK, WHITE, AROUND = 0.1, 0.9, 0.35


@dataclass(frozen=True)
class Lens:
    """A camera by what a calibration finds; lengths in metres."""

    focal: float = 0.035
    pitch: tuple = (11.7e-6, 27.5e-6)
    sensor: tuple = (752, 240)
    principal: tuple = (380.3, 117.2)
    distortion: tuple = (-0.2, 0.1, 0.001, -0.0008, 0.0)

    @property
    def aspect(self):
        return self.pitch[1] / self.pitch[0]

    @property
    def matrix(self):
        fx, fy = (self.focal / pitch for pitch in self.pitch)
        return np.array([[fx, 0, self.principal[0]], [0, fy, self.principal[1]], [0, 0, 1.0]])

    def project(self, points, rotation, translation):
        """Sensor columns and even-field lines [point, 2] of points on the board [m]."""
        pixels, _ = cv2.projectPoints(
            np.asarray(points, float).reshape(-1, 1, 3),
            np.asarray(rotation, float),
            np.asarray(translation, float),
            self.matrix,
            np.array(self.distortion, float),
        )
        return pixels[:, 0]


def pose(tilt_deg, *, direction_deg=0.0, turn_deg=0.0, distance=1.42, at=(0.0, 0.0), middle=(0, 0)):
    """Rotation vector and translation [m] of a board, tilted about a line in its plane.

    `middle` of the board [m] stands at `distance`, `at` to the side of the optical axis.
    """
    across = np.radians(direction_deg)
    tilt = cv2.Rodrigues(np.radians(tilt_deg) * np.array([np.cos(across), np.sin(across), 0]))[0]
    turned = tilt @ cv2.Rodrigues(np.radians([0.0, 0.0, turn_deg]))[0]
    translation = np.array([*at, distance]) - turned @ np.array([*middle, 0.0])
    return cv2.Rodrigues(turned)[0].ravel(), translation


def views(lens, places, rng, n, *, noise=0.05, tilt_deg=(15, 35), real=None):
    """Boards turned by quarters and tilted to all sides: corners [corner, 2] and pose of each.

    `real` is where the corners are, if not at their `places` [corner, 3].
    """
    view = min(n * pitch for n, pitch in zip(lens.sensor, lens.pitch, strict=True)) / lens.focal
    distance = 1.5 * np.ptp(places[:, 0]) / view
    seen = []
    for k in range(n):
        at = pose(
            rng.uniform(*tilt_deg),
            direction_deg=rng.uniform(0, 360),
            turn_deg=90 * k + rng.uniform(-10, 10),
            distance=distance,
            at=0.12 * view * distance * rng.uniform(-1, 1, 2),
            middle=places[:, :2].mean(axis=0),
        )
        uv = lens.project(places if real is None else real, *at)
        seen.append((uv + noise * rng.standard_normal(uv.shape), at))
    return seen


def chessboard(columns, rows, square):
    """Pattern of `columns` x `rows` inner corners, the first at the origin, on a white sheet."""

    def grey(x, y, soft):
        i, j = x / square, y / square
        black = 0.5 + 0.5 * _ramp(_wave(i), soft / square) * _ramp(_wave(j), soft / square)
        black *= _within(i, j, (-1, columns), (-1, rows))
        return _printed(black, _within(i, j, (-1.6, columns + 0.6), (-1.6, rows + 0.6)))

    return grey


def circles(columns, rows, spacing, radius, *, staggered=False):
    """Black discs on a white sheet, the first at the origin; every other row half way along."""

    def grey(x, y, soft):
        i, j = x / spacing, y / spacing
        if staggered:  # rows are `spacing` apart, discs of a row twice as far
            wide = (-1, 2 * columns)
            near = np.clip(np.rint(j), 0, rows - 1)
            rows_about = (near - 1, near, near + 1)
            away = np.min([_to_disc(i, j, columns, rows, row) for row in rows_about], axis=0)
        else:
            wide = (-1, columns)
            away = np.hypot(
                i - np.clip(np.rint(i), 0, columns - 1), j - np.clip(np.rint(j), 0, rows - 1)
            )
        black = 0.5 + 0.5 * _ramp(radius / spacing - away, soft / spacing)
        return _printed(black, _within(i, j, wide, (-1, rows)))

    return grey


def sheet_of(picture, size):
    """A printed picture [row, column] of `size` [m], its corner at the origin, on a white sheet."""
    height, width = picture.shape
    margin = 0.05

    def grey(x, y, soft):
        u, v = x / size[0], y / size[1]
        part = 2 * (round(soft / size[0] * width) // 2) + 1
        printed = cv2.remap(
            cv2.blur(picture, (part, part)),
            (u * width - 0.5).astype(np.float32),
            (v * height - 0.5).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=255,
        )
        return _printed(
            1 - printed / 255.0, _within(u, v, (-margin, 1 + margin), (-margin, 1 + margin))
        )

    return grey


def _wave(t):
    """Signed distance to the nearest whole number, its sign changing from one to the next."""
    return np.abs((t + 0.5) % 2 - 1) - 0.5


def _ramp(distance, soft):
    return np.clip(2 * distance / soft, -1, 1)


def _to_disc(i, j, columns, rows, row):
    nearest = np.clip(np.rint((i - row % 2) / 2), 0, columns - 1)
    away = np.hypot(i - 2 * nearest - row % 2, j - row)
    return np.where((row >= 0) & (row < rows), away, np.inf)


def _within(i, j, across, down):
    return (i >= across[0]) & (i <= across[1]) & (j >= down[0]) & (j <= down[1])


def _printed(black, sheet):
    return np.where(sheet, WHITE - (WHITE - BLACK) * black, AROUND)


def photograph(pattern, lens, rotation, translation, rng, *, parity=0, blur=7e-6, noise=0.7):
    """One field [line, column] of the board; `blur` is the lens's sigma on the sensor [m]."""
    columns, lines = lens.sensor
    across, down = PARTS
    x, y = _on_board(lens, rotation, translation, parity)
    soft = float(np.median(np.hypot(np.diff(x, axis=1), np.diff(y, axis=1))))
    grey = pattern(x, y, soft).astype(np.float32)
    sigma = [blur / pitch * parts for pitch, parts in zip(lens.pitch, PARTS, strict=True)]
    grey = cv2.GaussianBlur(grey, (0, 0), sigma[0], sigmaY=sigma[1])
    field = grey.reshape(lines, down, columns, across).mean(axis=(1, 3))
    noisy = 240 * field + noise * rng.standard_normal(field.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def interlaced(pattern, lens, rotation, translation, rng, **how):
    """A full frame: lines 0, 2, 4 ... of the even field, the odd field's between them."""
    fields = [
        photograph(pattern, lens, rotation, translation, rng, parity=p, **how) for p in (0, 1)
    ]
    return np.stack(fields, axis=1).reshape(-1, lens.sensor[0])


def _on_board(lens, rotation, translation, parity):
    """Where the ray of each part of each pixel meets the board [m], as [part line, part column]."""
    fine = [n * parts for n, parts in zip(lens.sensor, PARTS, strict=True)]
    cells = [-(-n // cell) for n, cell in zip(fine, CELL, strict=True)]
    u, v = (
        (np.arange(-1, n + 1) + 0.5) * cell / parts - 0.5
        for n, cell, parts in zip(cells, CELL, PARTS, strict=True)
    )
    grid = np.stack(np.meshgrid(u, v + 0.5 * parity), axis=-1)
    # OpenCV's five rounds are enough: each leaves a hundredth for these lenses
    ideal = cv2.undistortPoints(
        grid.reshape(-1, 1, 2), lens.matrix, np.array(lens.distortion, float)
    ).reshape(-1, 2)
    to_camera = cv2.Rodrigues(np.asarray(rotation, float))[0]
    homography = np.linalg.inv(
        np.column_stack([to_camera[:, 0], to_camera[:, 1], np.asarray(translation, float)])
    )
    rays = np.column_stack([ideal, np.ones(len(ideal))]) @ homography.T
    inner = tuple(slice(cell, cell + n) for n, cell in zip(fine[::-1], CELL[::-1], strict=True))
    return tuple(
        cv2.resize(
            (rays[:, k] / rays[:, 2]).reshape(grid.shape[:2]),
            (u.size * CELL[0], v.size * CELL[1]),
            interpolation=cv2.INTER_LINEAR,
        )[inner].astype(np.float32)
        for k in (0, 1)
    )
