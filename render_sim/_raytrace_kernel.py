"""Compiled ray casting: plain arrays in, plain arrays out; `raytrace` explains the method.

Everything happens in the model frame. Packed arguments, besides those of `_section_kernel`:

surface  roughness squared, specular, diffuse, ambient, wall, 1 for GGX
lamp     of each sample: place, area times radiance, direction, exponent of the beam
"""

# mypy: disable-error-code="no-untyped-def"
# numba infers the types when it compiles

import math

import numpy as np
from numba import njit

from render_sim._section_kernel import (
    edges,
    hit,
    in_model_frame,
    is_on,
    is_round,
    misses,
    outward,
    ray,
    to_model,
)

__all__ = [
    "EDGE_STEPS",
    "even",
    "fast_images",
    "find_nodes",
    "fine_image",
    "mix",
    "sample",
    "sample_matte",
]

_FAINTEST = -20.0
_MATTE_SAMPLES = 24, 120  # across the window, of a round body and of one with corners
_CLEAR = 2.0  # lines
EDGE_STEPS = 128


@njit(cache=True, error_model="numpy")
def _faintest(surface):
    """Return the inverse squared cosine from the mirror direction beyond which nothing is seen."""
    return math.inf if surface[5] > 0.0 else 1.0 - _FAINTEST * surface[0]


@njit(cache=True, error_model="numpy")
def _lobe(inverse, size2, surface, sharpness):
    """Return slope distribution times reflectance, but for what all samples share.

    `sharpness` is the inverse of the squared roughness.
    """
    if surface[5] > 0.0:
        lobe = (surface[0] / (surface[0] - 1.0 + inverse)) ** 2
    else:
        lobe = math.exp((1.0 - inverse) * sharpness)
    grazing = 1.0 - 0.5 * math.sqrt(size2)
    square = grazing * grazing
    return lobe * (surface[1] + (1.0 - surface[1]) * square * square * grazing)


@njit(cache=True, error_model="numpy")
def _shade(px, py, pz, eye, lamp, surface, with_specular, section):
    """Return the matte and the specular part of the radiance; the formula of `light`.

    Lamp samples so far from the mirror direction that they add nothing are passed over.
    """
    ny, nz = outward(py, pz, section)
    size = math.sqrt(ny * ny + nz * nz)
    ny, nz = ny / size, nz / size
    vx, vy, vz = eye[0] - px, eye[1] - py, eye[2] - pz
    size = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * size, vy * size, vz * size
    facing_eye = ny * vy + nz * vz
    faintest, sharpness = _faintest(surface), 1.0 / surface[0]
    received, specular = 0.0, 0.0
    for j in range(lamp.shape[0]):
        lx, ly, lz = lamp[j, 0] - px, lamp[j, 1] - py, lamp[j, 2] - pz
        r2 = lx * lx + ly * ly + lz * lz
        size = 1.0 / math.sqrt(r2)
        facing = (ny * ly + nz * lz) * size
        shone = -(lamp[j, 4] * lx + lamp[j, 5] * ly + lamp[j, 6] * lz) * size
        if facing <= 0.0 or shone <= 0.0:
            continue
        shone = shone if lamp[j, 7] == 1.0 else shone ** lamp[j, 7]
        weight = lamp[j, 3] * shone * facing * size * size
        received += weight
        if with_specular:
            size2 = 2.0 + 2.0 * (lx * vx + ly * vy + lz * vz) * size
            total = facing + facing_eye
            if size2 < faintest * total * total:
                over = 1.0 / (total * total)
                inverse = size2 * over
                specular += weight * _lobe(inverse, size2, surface, sharpness) * inverse * over
    return (
        surface[2] * (received / math.pi + surface[3]),
        specular / (math.pi * surface[0]),
    )


@njit(cache=True, error_model="numpy")
def fine_image(pose, columns, lines, centre, rotation, inner, lens, lamp, surfaces, section, marks):
    """Cast one ray at every crossing of `columns` and `lines`; radiance [line, column].

    `surfaces` [surface] are the body's own and those that `marks` refer to.
    """
    axes, eye, lamp, _ = in_model_frame(pose, centre, rotation, lamp)
    image = np.empty((lines.size, columns.size))
    for i in range(lines.size):
        for j in range(columns.size):
            dx, dy, dz = ray(columns[j], lines[i], inner, lens, axes)
            if misses(dx, dy, dz, eye, section):
                image[i, j] = surfaces[0, 4]
                continue
            px, py, pz = hit(dx, dy, dz, eye, section)
            surface = surfaces[0]
            for mark in marks:
                if is_on(mark, px, math.atan2(py, pz)):
                    surface = surfaces[int(mark[5])]
            matte, specular = _shade(px, py, pz, eye, lamp, surface, True, section)
            image[i, j] = matte + specular
    return image


@njit(cache=True, error_model="numpy")
def _mirrored(u, v, inner, lens, axes, eye, section, line, along):
    """Return how the mirrored ray passes the lamp's line, seen along it: across and towards."""
    dx, dy, dz = ray(u, v, inner, lens, axes)
    px, py, pz = hit(dx, dy, dz, eye, section)
    ny, nz = outward(py, pz, section)
    twice = 2.0 * (ny * dy + nz * dz) / (ny * ny + nz * nz)
    dy -= twice * ny
    dz -= twice * nz
    lx, ly, lz = line[0] - px, line[1] - py, line[2] - pz
    across = (
        lx * (dy * along[2] - dz * along[1])
        + ly * (dz * along[0] - dx * along[2])
        + lz * (dx * along[1] - dy * along[0])
    )
    parallel = dx * along[0] + dy * along[1] + dz * along[2]
    towards = (
        lx * (dx - parallel * along[0])
        + ly * (dy - parallel * along[1])
        + lz * (dz - parallel * along[2])
    )
    return across, towards


@njit(cache=True, error_model="numpy")
def _mirror_line(u, top, bottom, inner, lens, axes, eye, section, line, along):
    """Return the line of column u that mirrors the lamp; NaN if none does.

    From the upper edge to the middle of the body the mirrored ray sweeps from straight on over the
    top and back to the camera, from there to the lower edge under the body.
    """
    middle = 0.5 * (top + bottom)
    for side in range(2):
        low = top + 1e-6 if side == 0 else middle
        high = middle if side == 0 else bottom - 1e-6
        at_low, _ = _mirrored(u, low, inner, lens, axes, eye, section, line, along)
        at_high, _ = _mirrored(u, high, inner, lens, axes, eye, section, line, along)
        if at_low * at_high > 0.0:
            continue
        for _ in range(34):
            half = 0.5 * (low + high)
            at_half, _ = _mirrored(u, half, inner, lens, axes, eye, section, line, along)
            if at_low * at_half > 0.0:
                low = half
            else:
                high = half
        _, towards = _mirrored(u, low, inner, lens, axes, eye, section, line, along)
        if towards > 0.0:
            return 0.5 * (low + high)
    return math.nan


@njit(cache=True, error_model="numpy")
def _cubic(t, weights):
    """Fill `weights` of four neighbours at -1, 0, 1, 2 for a place t in [0, 1] (Lagrange)."""
    weights[0] = -t * (t - 1.0) * (t - 2.0) / 6.0
    weights[1] = (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    weights[2] = -(t + 1.0) * t * (t - 2.0) / 2.0
    weights[3] = (t + 1.0) * t * (t - 1.0) / 6.0


@njit(cache=True, error_model="numpy")
def _covered(offset, edge):
    """Look up the part of a pixel's response beyond an edge `offset` lines before its centre."""
    place = offset * EDGE_STEPS + (edge.size - 1) // 2
    if place <= 0.0:
        return 0.0
    k = int(place)
    if k >= edge.size - 1:
        return 1.0
    return edge[k] + (place - k) * (edge[k + 1] - edge[k])


@njit(cache=True, error_model="numpy")
def find_nodes(nodes, v0, v1, inner, lens, axes, eye, section, line, along):
    """Return mirror line, upper and lower edge at the node columns [node, 3]."""
    found = np.empty((nodes.size, 3))
    for i in range(nodes.size):
        top, bottom = edges(nodes[i], v0, v1, inner, lens, axes, eye, section)
        centre = _mirror_line(nodes[i], top, bottom, inner, lens, axes, eye, section, line, along)
        found[i, 0], found[i, 1], found[i, 2] = centre, top, bottom
    return found


@njit(cache=True, error_model="numpy")
def _mirrored_part(u, v, inner, lens, axes, eye, lamp, section, surface):
    """Return the lamp samples that can add to the glint in column u, whose mirror line is v.

    Along the lamp the lobe falls as it does on the mirror line; off that line only faster.
    """
    dx, dy, dz = ray(u, v, inner, lens, axes)
    px, py, pz = hit(dx, dy, dz, eye, section)
    ny, nz = outward(py, pz, section)
    size = math.sqrt(ny * ny + nz * nz)
    ny, nz = ny / size, nz / size
    chosen = np.empty_like(lamp)
    count = 0
    vx, vy, vz = eye[0] - px, eye[1] - py, eye[2] - pz
    view = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
    for j in range(lamp.shape[0]):
        lx, ly, lz = lamp[j, 0] - px, lamp[j, 1] - py, lamp[j, 2] - pz
        size = 1.0 / math.sqrt(lx * lx + ly * ly + lz * lz)
        hx, hy, hz = lx * size + vx * view, ly * size + vy * view, lz * size + vz * view
        total = ny * hy + nz * hz
        if (hx * hx + hy * hy + hz * hz) < _faintest(surface) * total * total:
            for k in range(8):
                chosen[count, k] = lamp[j, k]
            count += 1
    return chosen[:count]


@njit(cache=True, error_model="numpy")
def sample(nodes, found, offsets, specular, inner, lens, axes, eye, lamp, surface, section):
    """Return one part of the radiance at `offsets` lines from the mirror line [node, offset]."""
    values = np.empty((nodes.size, offsets.size))
    for i in range(nodes.size):
        near = lamp
        if specular:
            near = _mirrored_part(
                nodes[i], found[i, 0], inner, lens, axes, eye, lamp, section, surface
            )
        for k in range(offsets.size):
            v = min(max(found[i, 0] + offsets[k], found[i, 1] + 1e-3), found[i, 2] - 1e-3)
            dx, dy, dz = ray(nodes[i], v, inner, lens, axes)
            px, py, pz = hit(dx, dy, dz, eye, section)
            parts = _shade(px, py, pz, eye, near, surface, specular, section)
            values[i, k] = parts[1] if specular else parts[0]
    return values


@njit(cache=True, error_model="numpy")
def _blurred(values, weights):
    """Integrate each node's profile over the pixel's response, zero beyond its ends."""
    half = weights.size // 2
    n = values.shape[1]
    result = np.zeros_like(values)
    for i in range(values.shape[0]):
        for k in range(n):
            total = 0.0
            for m in range(max(0, k - half), min(n, k + half + 1)):
                total += values[i, m] * weights[m - k + half]
            result[i, k] = total
    return result


@njit(cache=True, error_model="numpy")
def _refined(values, places):
    """Interpolate each node's evenly spaced values at `places` [samples] (cubic)."""
    result = np.empty((values.shape[0], places.size))
    w = np.empty(4)
    for n in range(places.size):
        k = min(max(int(places[n]), 1), values.shape[1] - 3)
        _cubic(places[n] - k, w)
        for i in range(values.shape[0]):
            total = 0.0
            for m in range(4):
                total += w[m] * values[i, k - 1 + m]
            result[i, n] = total
    return result


@njit(cache=True, error_model="numpy")
def mix(values, first, blend, result):
    """Blend four successive nodes' rows of `values` into `result`."""
    a, b, c, d = blend[0], blend[1], blend[2], blend[3]
    for k in range(result.size):
        result[k] = (
            a * values[first, k]
            + b * values[first + 1, k]
            + c * values[first + 2, k]
            + d * values[first + 3, k]
        )


@njit(cache=True, error_model="numpy")
def _fill_matte(pixels, v0, centre, matte, matte_first, w):
    """Read one column's matte profile, evenly spaced about its mirror line, at its pixels."""
    offset = v0 - centre
    k = math.floor(offset - matte_first)
    _cubic(offset - matte_first - k, w)
    a, b, c, d = w[0], w[1], w[2], w[3]
    for row in range(pixels.size):
        n = k + row
        pixels[row] = a * matte[n - 1] + b * matte[n] + c * matte[n + 1] + d * matte[n + 2]


@njit(cache=True, error_model="numpy")
def _add_glint(pixels, v0, centre, glint, per_line, w):
    """Add one column's glint, sampled about its mirror line, to its pixels."""
    sample = (v0 - centre) * per_line + (glint.size - 1) // 2
    k = math.floor(sample)
    _cubic(sample - k, w)
    a, b, c, d = w[0], w[1], w[2], w[3]
    begin = max(0, -((k - 1) // per_line))
    end = min(pixels.size, (glint.size - 3 - k) // per_line + 1)
    for row in range(begin, end):
        n = k + row * per_line
        pixels[row] += a * glint[n - 1] + b * glint[n] + c * glint[n + 1] + d * glint[n + 2]


@njit(cache=True, error_model="numpy")
def _cut_out(pixels, v0, top, bottom, edge, wall):
    """Show the wall beyond the body's upper and lower edge; pixels on an edge show both."""
    rows = pixels.size
    reach = (edge.size // 2) / EDGE_STEPS
    begin = min(max(math.ceil(top - reach - v0), 0), rows)
    end = max(min(math.floor(bottom + reach - v0) + 1, rows), begin)
    for row in range(rows):
        v = v0 + row
        if row < begin or row >= end:
            pixels[row] = wall
        elif v < top + reach or v > bottom - reach:
            part = _covered(v - top, edge) - _covered(v - bottom, edge)
            pixels[row] = part * pixels[row] + (1.0 - part) * wall


@njit(cache=True, error_model="numpy")
def _fill(image, v0, found, bands, per_line, matte, matte_first, blend, first, edge, wall):
    """Interpolate the nodes' profiles along the line, and read them at every pixel's place.

    `found` [lamp, node, 3] and `bands` [lamp, node, sample] are those of `_nodes` and `_blurred`.
    """
    glint, ground = np.empty(bands.shape[2]), np.empty(matte.shape[1])
    place, pixels, w = np.empty(3), np.empty(image.shape[0]), np.empty(4)
    for j in range(image.shape[1]):
        mix(matte, first[j], blend[j], ground)
        mix(found[0], first[j], blend[j], place)
        top, bottom = place[1], place[2]
        _fill_matte(pixels, v0, place[0], ground, matte_first, w)
        for k in range(found.shape[0]):
            mix(found[k], first[j], blend[j], place)
            mix(bands[k], first[j], blend[j], glint)
            if not math.isnan(place[0]):
                _add_glint(pixels, v0, place[0], glint, per_line, w)
        _cut_out(pixels, v0, top, bottom, edge, wall)
        for row in range(pixels.size):
            image[row, j] = pixels[row]


@njit(cache=True, error_model="numpy")
def _is_grazed(found):
    """Say whether the mirror line comes so close to an edge that its profile is cut there."""
    for i in range(found.shape[0]):
        if found[i, 0] - found[i, 1] < _CLEAR or found[i, 2] - found[i, 0] < _CLEAR:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _matte_span(found, v0, rows):
    """Return the first and last whole offset from the mirror line that the window shows."""
    low, high = found[0, 0], found[0, 0]
    for i in range(1, found.shape[0]):
        low, high = min(low, found[i, 0]), max(high, found[i, 0])
    return math.floor(v0 - high) - 2, math.ceil(v0 + rows - low) + 2


@njit(cache=True, error_model="numpy")
def even(first, step, count):
    values = np.empty(count)
    for k in range(count):
        values[k] = first + step * k
    return values


@njit(cache=True, error_model="numpy")
def sample_matte(nodes, found, v0, rows, inner, lens, axes, eye, lamp, surface, section):
    """Return the matte part at the nodes, one value a line, and the first one's offset.

    It is smooth, so that it is cast on a coarse grid about the mirror line `found`.
    """
    low, high = _matte_span(found, v0, rows)
    count = _MATTE_SAMPLES[0] if is_round(section) else _MATTE_SAMPLES[1]
    step = (high - low) / (count - 1)
    coarse = even(low, step, count)
    matte = sample(nodes, found, coarse, False, inner, lens, axes, eye, lamp, surface, section)
    return _refined(matte, even(0.0, 1.0 / step, high - low + 1)), low


@njit(cache=True, error_model="numpy")
def fast_images(
    poses, v0, rows, nodes, blend, first, per_line, half, weights, edge, stations,
    centre, rotations, inner, lens, lamp, lamp_first, lamp_lines, surface, section,
):  # fmt: skip
    """Render one image a pose [image, row, column]; status 0, or why the body does not fit.

    `lamp_first` tells where each lamp's samples begin, and where the last one's end; `lamp_lines`
    [lamp, 3] are points on the lamps' centre lines. Only the first lamp has to be mirrored.
    Status 1: some column does not mirror it; 2: the cylinder ends within the window; 3: another
    lamp is mirrored at the body's very edge.
    """
    images = np.empty((poses.shape[0], rows, blend.shape[0]))
    offsets = even(-half / per_line, 1.0 / per_line, 2 * half + 1)
    n_lamps = lamp_lines.shape[0]
    found = np.empty((n_lamps, nodes.size, 3))
    bands = np.zeros((n_lamps, nodes.size, offsets.size))
    line = np.empty(3)
    for n in range(poses.shape[0]):
        pose = poses[n]
        axes, eye, moved, along = in_model_frame(pose, centre, rotations[n], lamp)
        for k in range(n_lamps):
            x, y, z = lamp_lines[k] - pose[:3, 3]
            to_model(pose, x, y, z, line)
            found[k] = find_nodes(
                nodes, v0, v0 + rows, inner, lens, axes, eye, section, line, along
            )
        for i in range(nodes.size):
            if math.isnan(found[0, i, 0]):
                return images, 1
            dx, dy, dz = ray(nodes[i], found[0, i, 0], inner, lens, axes)
            px, _, _ = hit(dx, dy, dz, eye, section)
            if px < stations[0] or px > stations[1]:
                return images, 2
        for k in range(n_lamps):
            n_lost = np.isnan(found[k, :, 0]).sum()
            if n_lost == nodes.size:
                continue
            if n_lost > 0 or _is_grazed(found[k]):
                return images, 3
            own = moved[lamp_first[k] : lamp_first[k + 1]]
            glint = sample(
                nodes, found[k], offsets, True, inner, lens, axes, eye, own, surface, section
            )
            bands[k] = _blurred(glint, weights)
        fine, low = sample_matte(
            nodes, found[0], v0, rows, inner, lens, axes, eye, moved, surface, section
        )
        _fill(
            images[n], v0, found, bands, per_line, fine, low, blend, first, edge, surface[4],
        )  # fmt: skip
    return images, 0
