"""Ray casting of packed scenes, a row of samples at a time."""

# numba ships no types for its decorators
# mypy: disallow-untyped-decorators=False
from __future__ import annotations

from math import ceil, exp, floor, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from lfdepth.engines.scene_layout import (
    CONVEX,
    ELLIPSE,
    ELLIPSOID,
    EVERYWHERE,
    LEAF,
    MAX_FACETS,
    PLANE,
    RIDGE,
    Packed,
)

Float32 = npt.NDArray[np.float32]
MISS = -np.inf
# Light from above left, towards the cameras; unit length.
LIGHT = (-0.4, -0.5, 0.768)


@njit(cache=True, nogil=True, inline="always")
def _plane(a: float, b: float, c: float, x: float, y: float, u: float, v: float) -> float:
    """D = a + b·(x + u·D) + c·(y + v·D), solved for D."""
    facing = 1.0 - b * u - c * v
    return (a + b * x + c * y) / facing if facing > 0.0 else MISS


@njit(cache=True, nogil=True)
def _ellipsoid(g: Any, x: float, y: float, u: float, v: float) -> float:
    """Nearest root of the quadric along the ray; the farther one where the far half is wanted."""
    p, pu = (x - g[0]) * g[2], u * g[2]
    q, qv = (y - g[1]) * g[3], v * g[3]
    w, wd = -g[4] * g[5], g[5]
    a = pu * pu + qv * qv + wd * wd
    b = p * pu + q * qv + w * wd
    inside = b * b - a * (p * p + q * q + w * w - 1.0)
    if inside < 0.0:
        return MISS
    d = (-b + g[6] * sqrt(inside)) / a
    return MISS if g[6] < 0.0 and d > g[4] else d


@njit(cache=True, nogil=True)
def _facets(ridge: bool, g: Any, x: float, y: float, u: float, v: float) -> Any:
    """Envelope of planes: along a ray the solid below a plane is a half line, so roots combine alike."""
    best = _plane(g[0], g[1], g[2], x, y, u, v)
    for i in range(3, 3 * MAX_FACETS, 3):
        d = _plane(g[i], g[i + 1], g[i + 2], x, y, u, v)
        best = min(best, d) if ridge else max(best, d)
    return best


@njit(cache=True, nogil=True, inline="always")
def _hit(kind: int, g: Any, x: float, y: float, u: float, v: float) -> Any:
    """Largest D at which the ray of view (u, v) through (x, y) meets the surface; MISS if it does not."""
    if kind == PLANE:
        return _plane(g[0], g[1], g[2], x, y, u, v)
    if kind == ELLIPSOID:
        return _ellipsoid(g, x, y, u, v)
    return _facets(kind == RIDGE, g, x, y, u, v)


@njit(cache=True, nogil=True, inline="always")
def _in_frame(kind: int, s: Any, t: Any, fill: float) -> Any:
    """Whether a point in a shape's own coordinates belongs to it."""
    if kind == ELLIPSE:
        return s * s + t * t <= 1.0
    if kind == LEAF:
        return abs(t) <= 1.0 - s * s
    return s - np.floor(s) < fill or t - np.floor(t) < fill


@njit(cache=True, nogil=True)
def _inside(kind: int, p: Any, x: float, y: float) -> Any:
    """Whether reference point (x, y) belongs to the shape."""
    if kind == EVERYWHERE:
        return True
    if kind == CONVEX:
        least = np.inf
        for i in range(0, 3 * MAX_FACETS, 3):
            least = min(least, p[i] * x + p[i + 1] * y + p[i + 2])
        return least >= 0.0
    return _in_frame(kind, p[0] * x + p[1] * y + p[2], p[3] * x + p[4] * y + p[5], p[6])


@njit(cache=True, nogil=True)
def _span(
    low: float, high: float, disparity_low: float, disparity_high: float, u: float
) -> tuple[float, float]:
    """Bounds of x - D·u over a layer's box, one axis."""
    if u == 0.0:  # 0 times an endless plane's infinite disparity is no number
        return low, high
    shift, other = disparity_low * u, disparity_high * u
    return low - max(shift, other), high - min(shift, other)


@njit(cache=True, nogil=True, inline="always")
def _half_line(offset: float, slope: float, first: float, last: float) -> tuple[float, float]:
    """Part of first..last where offset + slope·i >= 0."""
    if slope > 0.0:
        return max(first, -offset / slope), last
    if slope < 0.0:
        return first, min(last, -offset / slope)
    return (first, last) if offset >= 0.0 else (first, first - 1.0)


@njit(cache=True, nogil=True)
def _clip_row(
    p: Any, px: float, py: float, run_x: float, run_y: float, first: float, last: float
) -> tuple[float, float]:
    """Part of first..last where (px + run_x·i, py + run_y·i) lies in a convex polygon."""
    for e in range(0, 3 * MAX_FACETS, 3):
        offset = p[e] * px + p[e + 1] * py + p[e + 2]
        first, last = _half_line(offset, p[e] * run_x + p[e + 1] * run_y, first, last)
    return first, last


@njit(cache=True, nogil=True)
def _fill_run(layer: int, d0: float, run: float, first: int, last: int, depth: Any, index: Any) -> None:
    """Paint samples first..last of a plane: D = d0 + run·i."""
    for i in range(first, last + 1):
        d = d0 + run * i
        if d >= depth[i]:
            depth[i] = d
            index[i] = layer


@njit(cache=True, nogil=True)
def _fill_framed(
    layer: int, kind: int, fill: float, start: Any, run: Any, first: int, last: int, depth: Any, index: Any
) -> None:
    """Paint samples first..last of a plane where they lie in a framed shape; start + run·i = (D, s, t)."""
    d0, s0, t0 = start
    dd, ds, dt = run
    for i in range(first, last + 1):
        d = d0 + dd * i
        if d >= depth[i] and _in_frame(kind, s0 + ds * i, t0 + dt * i, fill):
            depth[i] = d
            index[i] = layer


@njit(cache=True, nogil=True)
def _fill_plane(
    scene: Packed, layer: int, ray: Any, first: float, last: float, depth: Any, index: Any
) -> None:
    """Paint a row of a plane: along the row its disparity and reference point are linear."""
    x0, step, y, u, v = ray
    g, p, kind = scene.surface[layer], scene.shape[layer], scene.shape_kind[layer]
    d0 = _plane(g[0], g[1], g[2], x0, y, u, v)
    if d0 == MISS:
        return
    run = _plane(0.0, g[1], g[2], step, 0.0, u, v)
    px, py, dx, dy = x0 + u * d0, y + v * d0, step + u * run, v * run
    if kind == CONVEX:
        first, last = _clip_row(p, px, py, dx, dy, first, last)
    if first > last:
        return
    begin, end = ceil(first), floor(last)
    if kind <= CONVEX:
        _fill_run(layer, d0, run, begin, end, depth, index)
        return
    start = (d0, p[0] * px + p[1] * py + p[2], p[3] * px + p[4] * py + p[5])
    path = (run, p[0] * dx + p[1] * dy, p[3] * dx + p[4] * dy)
    _fill_framed(layer, kind, p[6], start, path, begin, end, depth, index)


@njit(cache=True, nogil=True)
def _fill(scene: Packed, layer: int, ray: Any, first: int, last: int, depth: Any, index: Any) -> None:
    """Paint samples first..last of any surface in any shape."""
    x0, step, y, u, v = ray
    kind, surface = scene.surface_kind[layer], scene.surface[layer]
    shape_kind, shape = scene.shape_kind[layer], scene.shape[layer]
    for i in range(first, last + 1):
        x = x0 + i * step
        d = _hit(kind, surface, x, y, u, v)
        if d < depth[i] or d == MISS:
            continue
        px, py = x + u * d, y + v * d
        if _inside(shape_kind, shape, px, py):
            depth[i] = d
            index[i] = layer


@njit(cache=True, nogil=True)
def _cut(kind: int, shape: Any, layer: int, ray: Any, first: int, last: int, depth: Any, index: Any) -> None:
    """Take a layer away from samples first..last where it has a hole."""
    x0, step, y, u, v = ray
    for i in range(first, last + 1):
        if index[i] == layer and _inside(kind, shape, x0 + i * step + u * depth[i], y + v * depth[i]):
            depth[i] = MISS
            index[i] = -1


@njit(cache=True, nogil=True)
def _samples_in(box: Any, ray: Any, count: int) -> tuple[float, float]:
    """First and last sample of a row that a box (left, top, right, bottom, least D, most D) can reach."""
    x0, step, y, u, v = ray
    top, bottom = _span(box[1], box[3], box[4], box[5], v)
    if y < top or y > bottom:
        return 0.0, -1.0
    left, right = _span(box[0], box[2], box[4], box[5], u)
    return max(0.0, (left - x0) / step), min(count - 1.0, (right - x0) / step)


@njit(cache=True, nogil=True)
def _trace_row(scene: Packed, ray: Any, depth: Any, index: Any) -> None:
    """Nearest disparity and layer for samples (x0 + i·step, y) of view (u, v); ray = (x0, step, y, u, v)."""
    depth[:] = MISS
    index[:] = -1
    count = depth.shape[0]
    for layer in range(scene.box.shape[0]):
        first, last = _samples_in(scene.box[layer], ray, count)
        if first > last:
            continue
        if scene.surface_kind[layer] == PLANE:
            _fill_plane(scene, layer, ray, first, last, depth, index)
        else:
            _fill(scene, layer, ray, ceil(first), floor(last), depth, index)
        for hole in range(scene.hole_start[layer], scene.hole_start[layer + 1]):
            first, last = _samples_in(scene.hole_box[hole], ray, count)
            if first <= last:
                kind, shape = scene.hole_kind[hole], scene.hole[hole]
                _cut(kind, shape, layer, ray, ceil(first), floor(last), depth, index)


@njit(cache=True, nogil=True, inline="always")
def _weights(t: Any) -> Any:
    """The four values of the uniform cubic B-spline around a knot interval."""
    one, four, sixth = np.float32(1.0), np.float32(4.0), np.float32(1.0 / 6.0)
    three, six = np.float32(3.0), np.float32(6.0)
    r = one - t
    return (
        r * r * r * sixth,
        (four + t * t * (three * t - six)) * sixth,
        (four + r * r * (three * r - six)) * sixth,
        t * t * t * sixth,
    )


@njit(cache=True, nogil=True, inline="always")
def _look_up(textures: Any, k: int, s: float, t: float) -> Any:
    """Colour of periodic bicubic spline k at (s, t)."""
    mask = textures.shape[1] - 1  # sizes are powers of two
    column, row = np.floor(s), np.floor(t)
    a, b, c, d = _weights(np.float32(s - column))
    down = _weights(np.float32(t - row))
    x, y = int(column) - 1, int(row) - 1
    x0, x1, x2, x3 = x & mask, (x + 1) & mask, (x + 2) & mask, (x + 3) & mask
    red = green = blue = np.float32(0.0)
    for j in range(4):
        line = (y + j) & mask
        w = down[j]
        red += w * (
            a * textures[k, line, x0, 0]
            + b * textures[k, line, x1, 0]
            + c * textures[k, line, x2, 0]
            + d * textures[k, line, x3, 0]
        )
        green += w * (
            a * textures[k, line, x0, 1]
            + b * textures[k, line, x1, 1]
            + c * textures[k, line, x2, 1]
            + d * textures[k, line, x3, 1]
        )
        blue += w * (
            a * textures[k, line, x0, 2]
            + b * textures[k, line, x1, 2]
            + c * textures[k, line, x2, 2]
            + d * textures[k, line, x3, 2]
        )
    return red, green, blue


@njit(cache=True, nogil=True)
def _shade_textured(
    scene: Packed,
    layer: int,
    row: tuple[float, float, float],
    ends: tuple[int, int],
    samples: int,
    depth: Any,
    out: Any,
) -> None:
    """Set samples of one layer in a row to the layer's own colour; row = (y, u, v)."""
    y, u, v = row
    x0 = 0.5 / samples - 0.5
    m = scene.affine[layer]
    a, b, c, d, e, f = m[0], m[1], m[2], m[3], m[4], m[5]
    textures, texture = scene.textures, scene.texture[layer]
    step = 1.0 / samples
    gain, offset = scene.gain, scene.offset
    r0, g0, b0 = offset[layer, 0], offset[layer, 1], offset[layer, 2]
    r1, g1, b1 = gain[layer, 0], gain[layer, 1], gain[layer, 2]
    for i in range(ends[0], ends[1]):
        px, py = x0 + i * step + u * depth[i], y + v * depth[i]
        red, green, blue = _look_up(textures, texture, a * px + b * py + c, d * px + e * py + f)
        out[i, 0], out[i, 1], out[i, 2] = r0 + r1 * red, g0 + g1 * green, b0 + b1 * blue


@njit(cache=True, nogil=True)
def _shade_lambert(
    g: Any,
    ambient: float,
    row: tuple[float, float, float],
    ends: tuple[int, int],
    samples: int,
    depth: Any,
    out: Any,
) -> None:
    """Darken samples of an ellipsoid by Lambert's law, as if it were a sphere."""
    y, u, v = row
    for i in range(ends[0], ends[1]):
        x = (i + 0.5) / samples - 0.5
        p, q = (x + u * depth[i] - g[0]) * g[2], (y + v * depth[i] - g[1]) * g[3]
        facing = LIGHT[0] * p + LIGHT[1] * q + LIGHT[2] * (depth[i] - g[4]) * g[5]
        light = np.float32(ambient + (1.0 - ambient) * max(0.0, facing))
        for c in range(3):
            out[i, c] *= light


@njit(cache=True, nogil=True)
def _add_glare(
    lobe: Any, row: tuple[float, float, float], ends: tuple[int, int], samples: int, out: Any
) -> None:
    """Add a highlight, which moves with the disparity of its virtual image."""
    y, u, v = row
    q = (y + lobe[5] * v - lobe[2]) * lobe[4]
    if abs(q) > 6.0:  # nothing left of it, and exp is slow
        return
    for i in range(ends[0], ends[1]):
        p = ((i + 0.5) / samples - 0.5 + lobe[5] * u - lobe[1]) * lobe[3]
        glare = np.float32(lobe[6] * exp(-0.5 * (p * p + q * q)))
        for c in range(3):
            out[i, c] += glare


@njit(cache=True, nogil=True)
def _shade_row(
    scene: Packed, row: tuple[float, float, float], samples: int, depth: Any, index: Any, out: Any
) -> None:
    """Colours of a row of samples, run by run of the same layer."""
    start, count = 0, depth.shape[0]
    while start < count:
        layer, end = index[start], start + 1
        while end < count and index[end] == layer:
            end += 1
        ends = (start, end)
        start = end
        if layer < 0:
            out[ends[0] : end] = 0.0
            continue
        _shade_textured(scene, layer, row, ends, samples, depth, out)
        if scene.ambient[layer] < 1.0:
            _shade_lambert(scene.surface[layer], scene.ambient[layer], row, ends, samples, depth, out)
        for lobe in range(scene.highlight.shape[0]):
            if scene.highlight[lobe, 0] == layer:
                _add_glare(scene.highlight[lobe], row, ends, samples, out)


@njit(cache=True, nogil=True)
def _add_samples(colours: Any, samples: int, out: Any) -> None:
    """Add a row of samples to the pixels they lie in."""
    for x in range(out.shape[0]):
        for i in range(x * samples, (x + 1) * samples):
            for c in range(3):
                out[x, c] += colours[i, c]


@njit(cache=True, nogil=True)
def render_view(scene: Packed, u: float, v: float, height: int, width: int, samples: int) -> Float32:
    """Picture (height, width, 3), grey levels 0..255 not yet clipped, of view (u, v).

    A pixel is the mean over samples × samples points, as a sensor integrates light.
    """
    out = np.zeros((height, width, 3), np.float32)
    depth = np.empty(width * samples)
    index = np.empty(width * samples, np.int64)
    colours = np.empty((width * samples, 3), np.float32)
    x0 = 0.5 / samples - 0.5
    for y in range(height):
        for j in range(samples):
            row = y + x0 + j / samples
            _trace_row(scene, (x0, 1.0 / samples, row, u, v), depth, index)
            _shade_row(scene, (row, u, v), samples, depth, index, colours)
            _add_samples(colours, samples, out[y])
    out *= np.float32(1.0 / (samples * samples))
    return out


@njit(cache=True, nogil=True)
def trace(
    scene: Packed, u: float, v: float, rows: Any, width: int, x0: float, step: float
) -> tuple[Float32, Any]:
    """Disparity and layer index of view (u, v) at (x0 + i·step, rows[j]), one ray per point."""
    disparity = np.empty((rows.size, width), np.float32)
    layers = np.empty((rows.size, width), np.int16)
    depth = np.empty(width)
    index = np.empty(width, np.int64)
    for j in range(rows.size):
        _trace_row(scene, (x0, step, rows[j], u, v), depth, index)
        disparity[j] = depth
        layers[j] = index
    return disparity, layers
