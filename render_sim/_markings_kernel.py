"""Compiled light of markings on the body: plain arrays in; `markings` states the formula.

Columns are cut into strips and lines into cells. In each cell the radiance of every surface is read
from profiles at node columns, interpolated along the mirror line as `_raytrace_kernel` does for the
body itself; how far each marking covers the cell follows from the cell's extent in station and
azimuth. Packed arguments, besides those of `_raytrace_kernel`:

surfaces  [surface, 6], the body's own first, then those that marks refer to
grids     of each surface: samples a line, and on either side of the mirror line
ahead     azimuth of the eye
"""

# mypy: disable-error-code="no-untyped-def"
# numba infers the types when it compiles

import math

import numpy as np
from numba import njit

from render_sim._raytrace_kernel import even, find_nodes, mix, sample, sample_matte
from render_sim._section_kernel import covered, hit, in_model_frame, ray, to_model, turned

__all__ = ["CELLS", "STRIPS", "add_markings"]

CELLS = 8  # a line
STRIPS = 4  # a column


@njit(cache=True, error_model="numpy")
def _read(profile, size, place):
    """Interpolate `size` evenly spaced samples at `place` (cubic); zero beyond their ends."""
    k = math.floor(place)
    if k < 1 or k > size - 3:
        return 0.0
    t = place - k
    a, b, c, d = profile[k - 1], profile[k], profile[k + 1], profile[k + 2]
    # Lagrange's cubic through four neighbours, as a polynomial in t
    third = (d - a) / 6.0 + 0.5 * (b - c)
    second = 0.5 * (a + c) - b
    return b + t * (c - a / 3.0 - 0.5 * b - d / 6.0 + t * (second + t * third))


@njit(cache=True, error_model="numpy")
def _seen(u, v, inner, lens, axes, eye, section, ahead):
    """Return station, and azimuth from that of the eye, `ahead`, of the body at a pixel."""
    dx, dy, dz = ray(u, v, inner, lens, axes)
    px, py, pz = hit(dx, dy, dz, eye, section)
    return px, turned(math.atan2(py, pz) - ahead)


@njit(cache=True, error_model="numpy")
def _first_cell(azimuth, u, v0, low, high, inner, lens, axes, eye, section, ahead):
    """Return the cell in which a column passes an azimuth; seen from the eye it only grows."""
    _, at_low = _seen(u, v0 + low / CELLS, inner, lens, axes, eye, section, ahead)
    _, at_high = _seen(u, v0 + high / CELLS, inner, lens, axes, eye, section, ahead)
    grows = at_high > at_low
    while high - low > 1:
        half = (low + high) // 2
        _, there = _seen(u, v0 + half / CELLS, inner, lens, axes, eye, section, ahead)
        if (there < azimuth) == grows:
            low = half
        else:
            high = half
    return low


@njit(cache=True, error_model="numpy")
def _cells_of(mark, u, v0, low, high, inner, lens, axes, eye, section, ahead):
    """Return the first and last cell, of those from `low` to `high`, that may show a marking."""
    if mark[3] >= 0.5 * math.pi:
        return low, high
    middle = turned(mark[2] - ahead)
    one = _first_cell(middle - mark[3], u, v0, low, high, inner, lens, axes, eye, section, ahead)
    other = _first_cell(middle + mark[3], u, v0, low, high, inner, lens, axes, eye, section, ahead)
    return max(min(one, other) - 1, low), min(max(one, other) + 2, high)


@njit(cache=True, error_model="numpy")
def _sampled(nodes, found, grids, surfaces, rows, v0, lamp, lamp_first, inner, lens, axes, eye,
             section):  # fmt: skip
    """Return what every surface sends, at the nodes: its glints, and light on matte white.

    Glints [surface, lamp, node, sample] lie about the lamps' mirror lines on each surface's grid;
    the light [node, line] about the first mirror line, one value a line from `low` on.
    """
    most = 2 * grids[:, 1].max() + 1
    glints = np.zeros((surfaces.shape[0], found.shape[0], nodes.size, most))
    for k in range(surfaces.shape[0]):
        per_line, half = grids[k]
        offsets = even(-half / per_line, 1.0 / per_line, 2 * half + 1)
        for j in range(found.shape[0]):
            if math.isnan(found[j, 0, 0]):
                continue
            own = lamp[lamp_first[j] : lamp_first[j + 1]]
            glints[k, j, :, : offsets.size] = sample(
                nodes, found[j], offsets, True, inner, lens, axes, eye, own, surfaces[k], section
            )
    white = surfaces[0].copy()
    white[2] = 1.0
    light, low = sample_matte(
        nodes, found[0], v0, rows, inner, lens, axes, eye, lamp, white, section
    )
    return glints, light, low


@njit(cache=True, error_model="numpy")
def _radiance(k, v0, low, high, profiles, light, light_low, places, grids, surfaces, radiance):
    """Fill `radiance` [surface, cell] with what surface k sends from the cells of a strip."""
    per_line, half = grids[k, 0], grids[k, 1]
    for i in range(low, high):
        v = v0 + (i + 0.5) / CELLS
        radiance[k, i] = surfaces[k, 2] * _read(light, light.size, v - places[0] - light_low)
    for j in range(profiles.shape[1]):
        if math.isnan(places[j]):
            continue
        profile = profiles[k, j]
        for i in range(low, high):
            v = v0 + (i + 0.5) / CELLS
            radiance[k, i] += _read(profile, 2 * half + 1, (v - places[j]) * per_line + half)


@njit(cache=True, error_model="numpy")
def _settled(mark, x0, x1, azimuth0, azimuth1, broad):
    """Return 1 if all cells between two places are on a marking, 0 if none is, else -1."""
    reach, turn = 0.5 * abs(x1 - x0) + broad, 0.5 * abs(azimuth1 - azimuth0)
    x = abs(0.5 * (x0 + x1) - mark[0])
    away = abs(turned(0.5 * (azimuth0 + azimuth1) - mark[2]))
    if x - reach > mark[1] or away - turn > mark[3]:
        return 0
    inside = mark[4] == 0.0 and x + reach < mark[1] and away + turn < mark[3]
    return 1 if inside else -1


@njit(cache=True, error_model="numpy")
def _changed(u, broad, v0, low, high, marks, live, radiance, inner, lens, axes, eye, section,
             ahead, delta):  # fmt: skip
    """Fill `delta` with what the markings change in the cells of a strip from `low` to `high`.

    `broad` is the strip's extent in station. Lines within which no marking ends are settled at
    once.
    """
    x, azimuth = _seen(u, v0 + low / CELLS, inner, lens, axes, eye, section, ahead)
    for begin in range(low, high, CELLS):
        end = min(begin + CELLS, high)
        x1, azimuth1 = _seen(u, v0 + end / CELLS, inner, lens, axes, eye, section, ahead)
        delta[begin:end] = 0.0
        for m in range(marks.shape[0]):
            if not live[m]:
                continue
            k = int(marks[m, 5])
            state = _settled(marks[m], x, x1, azimuth + ahead, azimuth1 + ahead, broad)
            if state == 1:
                for i in range(begin, end):
                    delta[i] = radiance[k, i] - radiance[0, i]
            elif state == -1:
                _partly_changed(u, broad, v0, begin, end, marks[m], radiance[k], radiance[0],
                                inner, lens, axes, eye, section, ahead, delta)  # fmt: skip
        x, azimuth = x1, azimuth1


@njit(cache=True, error_model="numpy")
def _partly_changed(u, broad, v0, low, high, mark, there, own, inner, lens, axes, eye, section,
                    ahead, delta):  # fmt: skip
    """Blend one marking into the cells of a strip, as far as it covers them."""
    x, azimuth = _seen(u, v0 + low / CELLS, inner, lens, axes, eye, section, ahead)
    for i in range(low, high):
        x1, azimuth1 = _seen(u, v0 + (i + 1) / CELLS, inner, lens, axes, eye, section, ahead)
        middle, tall = 0.5 * (azimuth + azimuth1) + ahead, abs(azimuth1 - azimuth)
        share = covered(mark, 0.5 * (x + x1), broad, middle, tall)
        delta[i] += share * (there[i] - own[i] - delta[i])
        x, azimuth = x1, azimuth1


@njit(cache=True, error_model="numpy")
def _alive(marks, u, broad, top, bottom, inner, lens, axes, eye, section, ahead, live):
    """Say of each marking whether it may cross a strip, by its station.

    A strip sees an arc of the body, which bends no farther from its chord than it does halfway.
    """
    x0, _ = _seen(u, top, inner, lens, axes, eye, section, ahead)
    x, _ = _seen(u, 0.5 * (top + bottom), inner, lens, axes, eye, section, ahead)
    x1, _ = _seen(u, bottom, inner, lens, axes, eye, section, ahead)
    reach = broad + 1.2 * abs(x - 0.5 * (x0 + x1))
    first, last = min(x0, x1) - reach, max(x0, x1) + reach
    for m in range(marks.shape[0]):
        live[m] = first <= marks[m, 0] + marks[m, 1] and last >= marks[m, 0] - marks[m, 1]


@njit(cache=True, error_model="numpy")
def _clip(delta, v0, low, high, top, bottom):
    """Leave of the cells from `low` to `high` the part that lies on the body."""
    for i in range(low, high):
        seen = min(v0 + (i + 1) / CELLS, bottom) - max(v0 + i / CELLS, top)
        delta[i] *= min(max(seen * CELLS, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _spread(image, delta, low, high, strip, line_weights, column_weights):
    """Add one strip's cells to the pixels, by the pixels' response."""
    span, reach = line_weights.size, column_weights.size
    first_row = max((low - span) // CELLS + 1, 0)
    last_row = min((high - 1) // CELLS + 1, image.shape[0])
    first_column = max((strip - reach) // STRIPS + 1, 0)
    last_column = min(strip // STRIPS + 1, image.shape[1])
    for row in range(first_row, last_row):
        total = 0.0
        for i in range(max(low, row * CELLS), min(high, row * CELLS + span)):
            total += line_weights[i - row * CELLS] * delta[i]
        for column in range(first_column, last_column):
            image[row, column] += column_weights[strip - column * STRIPS] * total


@njit(cache=True, error_model="numpy")
def _strip_places(found, first, blend, places):
    """Fill `places` with a strip's mirror lines, its upper and its lower edge."""
    node = np.empty(3)
    for j in range(found.shape[0] - 1, -1, -1):
        mix(found[j], first, blend, node)
        places[j] = node[0]
    places[-2], places[-1] = node[1], node[2]


@njit(cache=True, error_model="numpy")
def _crossed(strips, found, first, blend, marks, inner, lens, axes, eye, section, ahead):
    """Return of each strip the mirror lines and edges, its extent in station, who crosses it."""
    places = np.empty((strips.size, found.shape[0] + 2))
    broad, live = np.empty(strips.size), np.zeros((strips.size, marks.shape[0]), np.bool_)
    for s in range(strips.size):
        _strip_places(found, first[s], blend[s], places[s])
        top, bottom = places[s, -2] + 1e-6, places[s, -1] - 1e-6
        glint, side, wide = places[s, 0], strips[s] + 0.5 / STRIPS, 1.0 / STRIPS
        x0, _ = _seen(side - wide, glint, inner, lens, axes, eye, section, ahead)
        x1, _ = _seen(side, glint, inner, lens, axes, eye, section, ahead)
        broad[s] = abs(x1 - x0)
        _alive(marks, strips[s], broad[s], top, bottom, inner, lens, axes, eye, section, ahead,
               live[s])  # fmt: skip
    return places, broad, live


@njit(cache=True, error_model="numpy")
def _mark_image(image, v0, margin, nodes, strips, blend, first, line_weights, column_weights,
                marks, surfaces, grids, found, lamp, lamp_first, inner, lens, axes, eye, section,
                ahead):  # fmt: skip
    """Add to one image what its markings change; `strips` are their middles [column]."""
    places, broad, live = _crossed(
        strips, found, first, blend, marks, inner, lens, axes, eye, section, ahead
    )
    crossed = np.array([s for s in range(strips.size) if live[s].any()])
    if crossed.size == 0:
        return
    low_node, high_node = first[crossed].min(), first[crossed].max() + 4
    around = margin + 2  # lines beyond the window, for its pixels' response
    glints, light, light_low = _sampled(
        nodes[low_node:high_node], found[:, low_node:high_node], grids, surfaces,
        image.shape[0] + 2 * around, v0 - around, lamp, lamp_first, inner, lens, axes, eye, section,
    )  # fmt: skip
    n_cells, begin = (image.shape[0] + 2 * margin) * CELLS, v0 - 0.5 - margin
    delta, radiance = np.empty(n_cells), np.empty((surfaces.shape[0], n_cells))
    profiles = np.empty((surfaces.shape[0], found.shape[0], glints.shape[3]))
    ground = np.empty(light.shape[1])
    for s in crossed:
        top, bottom = places[s, -2], places[s, -1]
        low = max(math.floor((top - begin) * CELLS), 0)
        high = min(math.ceil((bottom - begin) * CELLS), n_cells)
        start, end = high, low
        for m in range(marks.shape[0]):
            if live[s, m] and low < high:
                one, other = _cells_of(
                    marks[m], strips[s], begin, low, high, inner, lens, axes, eye, section, ahead
                )
                start, end = min(start, one), max(end, other)
        if start >= end:
            continue
        node = first[s] - low_node
        mix(light, node, blend[s], ground)
        for k in range(surfaces.shape[0]):
            for j in range(found.shape[0]):
                mix(glints[k, j], node, blend[s], profiles[k, j])
            _radiance(k, begin, start, end, profiles, ground, light_low, places[s], grids,
                      surfaces, radiance)  # fmt: skip
        _changed(strips[s], broad[s], begin, start, end, marks, live[s], radiance, inner, lens,
                 axes, eye, section, ahead, delta)  # fmt: skip
        _clip(delta, begin, start, end, top, bottom)
        _spread(image, delta, start, end, s, line_weights, column_weights)


@njit(cache=True, error_model="numpy")
def add_markings(
    images, poses, v0, margin, nodes, strips, blend, first, line_weights, column_weights, marks,
    surfaces, grids, centre, rotations, inner, lens, lamp, lamp_first, lamp_lines, section,
):  # fmt: skip
    """Add to images of a bare body, one a pose, what its markings change.

    `strips` are the middles of the columns' strips, `blend` and `first` interpolate between nodes
    there; `line_weights` and `column_weights` are a pixel's response to the cells and strips from
    `margin` lines before it on, and as many as there are in columns.
    """
    line = np.empty(3)
    found = np.empty((lamp_lines.shape[0], nodes.size, 3))
    rows = images.shape[1]
    for n in range(poses.shape[0]):
        pose = poses[n]
        axes, eye, moved, along = in_model_frame(pose, centre, rotations[n], lamp)
        ahead = math.atan2(eye[1], eye[2])
        for j in range(lamp_lines.shape[0]):
            x, y, z = lamp_lines[j] - pose[:3, 3]
            to_model(pose, x, y, z, line)
            found[j] = find_nodes(
                nodes, v0, v0 + rows, inner, lens, axes, eye, section, line, along
            )
        _mark_image(images[n], v0, margin, nodes, strips, blend, first, line_weights,
                    column_weights, marks, surfaces, grids, found, moved, lamp_first, inner, lens,
                    axes, eye, section, ahead)  # fmt: skip
