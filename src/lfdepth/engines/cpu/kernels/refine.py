"""Kernels of the sub-pixel refinement: spline coefficients, moments over views, evidence."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.runs import RUN, find_breaks, run_length
from lfdepth.engines.layout import DISPARITY_PARTS

PAD = 2
"""Coefficients kept beyond each border, mirrored about the outermost sample."""

MOMENTS = 10
"""Sums over views per pixel: 1, u, v, u², uv, v², I, uI, vI, I²."""

_POLE = np.float32(np.sqrt(3.0) - 2.0)  # of the cubic B-spline's inverse filter
_GAIN = np.float32(6.0)
_START = 12  # samples after which the pole's powers are below a single float's precision
_NOTHING = np.float32(1e-3)  # grey levels²: less information is rounding
_TILE = 16  # pixels that fill a line of the cache: transposed a few rows at a time, it is written once
_LUMA = (np.float32(0.299), np.float32(0.587), np.float32(0.114))


@nb.njit(**INNER)
def _sharpen_rows(image):
    """Inverse of the cubic B-spline along the first axis, in place, borders mirrored (Unser 1999)."""
    count, width = image.shape
    for x in range(width):
        image[0, x] *= _GAIN
    power = _POLE
    for y in range(1, min(_START, count)):
        for x in range(width):
            image[0, x] += power * _GAIN * image[y, x]
        power *= _POLE
    for y in range(1, count):
        for x in range(width):
            image[y, x] = _GAIN * image[y, x] + _POLE * image[y - 1, x]
    last = _POLE / (_POLE * _POLE - np.float32(1))
    for x in range(width):
        image[count - 1, x] = last * (image[count - 1, x] + _POLE * image[count - 2, x])
    for y in range(count - 2, -1, -1):
        for x in range(width):
            image[y, x] = _POLE * (image[y + 1, x] - image[y, x])


@nb.njit(**INNER)
def _grey(view, scale, out):
    """Luma of a view (H, W, C) times `scale`, transposed, into `out` (W, H)."""
    height, width, channels = view.shape
    for first in range(0, height, _TILE):
        last = min(first + _TILE, height)
        for x in range(width):
            for y in range(first, last):
                if channels == 3:
                    level = (
                        _LUMA[0] * np.float32(view[y, x, 0])
                        + _LUMA[1] * np.float32(view[y, x, 1])
                        + _LUMA[2] * np.float32(view[y, x, 2])
                    )
                else:
                    level = np.float32(view[y, x, 0])
                out[x, y] = scale * level


@nb.njit(**INNER)
def _transpose(image, out):
    height, width = out.shape
    for first in range(0, width, _TILE):
        last = min(first + _TILE, width)
        for y in range(height):
            for x in range(first, last):
                out[y, x] = image[x, y]


@nb.njit(**KERNEL)
def spline_kernel(first, last, views, scale, chosen, coefficients):
    """Cubic B-spline coefficients of the luma of chosen views [first, last), padded by `PAD`.

    `chosen` (N, 2) are grid positions, `coefficients` (N, H + 2·PAD, W + 2·PAD).
    """
    height, width = views.shape[2:4]
    across, down = np.empty((width, height), np.float32), np.empty((height, width), np.float32)
    for i in range(first, last):
        _grey(views[chosen[i, 0], chosen[i, 1]], scale, across)
        _sharpen_rows(across)
        _transpose(across, down)
        _sharpen_rows(down)
        out = coefficients[i]
        for y in range(height + 2 * PAD):
            row = abs(y - PAD)
            row = min(row, 2 * (height - 1) - row)
            for x in range(width):
                out[y, x + PAD] = down[row, x]
            for x in range(PAD):
                out[y, x] = down[row, PAD - x]
                out[y, width + PAD + x] = down[row, width - 2 - x]


@nb.njit(**INNER)
def _land(to, at, start, step, disparity, row):
    """Where a row's pixels, from `start` on, land along one axis, into `to` from `at` on."""
    for x in range(np.uintp(start.size)):
        to[at + x] = start[x] - step * disparity[row + x]


@nb.njit(**INNER)
def _outer_weights(to, axis, before, after):
    """Cubic B-spline weights of the first and the last of the four samples about a row's places."""
    sixth = np.float32(1 / 6)
    for x in range(np.uintp(before.size)):
        f = to[axis + x] - np.floor(to[axis + x])
        g = np.float32(1) - f
        before[x] = sixth * g * g * g
        after[x] = sixth * f * f * f


@nb.njit(**INNER)
def _inner_weights(to, axis, left, right):
    """The same of the second and the third."""
    for x in range(np.uintp(left.size)):
        f = to[axis + x] - np.floor(to[axis + x])
        g = np.float32(1) - f
        left[x] = np.float32(2 / 3) - np.float32(0.5) * f * f * (np.float32(1) + g)
        right[x] = np.float32(2 / 3) - np.float32(0.5) * g * g * (np.float32(1) + f)


@nb.njit(**INNER)
def _places(places, to, size, stride):
    """Flat places of the upper left coefficients in a view, −1 outside of it; `to` are x and y of a row."""
    width, right, bottom = np.uintp(places.size), np.float32(size[1] - 1), np.float32(size[0] - 1)
    step, pad = np.int32(stride), np.int32(PAD - 1)
    for x in range(width):
        to_x, to_y = to[x], to[width + x]
        inside = (to_x >= 0) & (to_y >= 0) & (to_x <= right) & (to_y <= bottom)
        at = (np.int32(np.floor(to_y)) + pad) * step + np.int32(np.floor(to_x)) + pad
        places[x] = at if inside else np.int32(-1)


@nb.njit(**INNER)
def _nearest_places(nearest, to, places, row_length):
    """Flat places of the nearest pixels; 0 for those outside of the view."""
    width, half, step = np.uintp(places.size), np.float32(0.5), np.int32(row_length)
    for x in range(width):
        at = np.int32(to[width + x] + half) * step + np.int32(to[x] + half)
        nearest[x] = at if places[x] >= 0 else np.int32(0)


@nb.njit(**INNER)
def _look_up(seen, surfaces, start, at):
    for x in range(np.uintp(at.size)):
        seen[x] = surfaces[start + np.uintp(at[x])]


@nb.njit(**INNER)
def _hide(places, seen, disparity, row, margin):
    """Strike out the places of pixels behind something nearer in a view."""
    for x in range(np.uintp(places.size)):
        hidden = np.float32(seen[x]) > (disparity[row + x] + margin) * np.float32(DISPARITY_PARTS)
        places[x] = np.int32(-1) if hidden else places[x]


@nb.njit(**INNER)
def _sample_run(values, weights, coefficients, x, at, length, line):
    """Add one of four lines of samples to pixels from `x` on that lie side by side in a view.

    `weights` are the four across and the four down, one row each.
    """
    one, two, three, width = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(values.size)
    a, b, c, d = x, x + width, x + two * width, x + three * width
    down = x + (line + np.uintp(4)) * width
    for i in range(length):
        values[x + i] += weights[down + i] * (
            weights[a + i] * coefficients[at + i]
            + weights[b + i] * coefficients[at + one + i]
            + weights[c + i] * coefficients[at + two + i]
            + weights[d + i] * coefficients[at + three + i]
        )


@nb.njit(**INNER)
def _sample_each(values, weights, coefficients, first, last, places, start, stride):
    """Samples at the places of single pixels."""
    one, two, three, width = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(values.size)
    for x in range(first, last):
        if places[x] < 0:
            continue
        a, b = weights[x], weights[x + width]
        c, d = weights[x + two * width], weights[x + three * width]
        at, down, value = start + np.uintp(places[x]), x + np.uintp(4) * width, values[x]
        for _ in range(4):
            value += weights[down] * (
                a * coefficients[at]
                + b * coefficients[at + one]
                + c * coefficients[at + two]
                + d * coefficients[at + three]
            )
            at += stride
            down += width
        values[x] = value


@nb.njit(**INNER)
def _sample(values, weights, coefficients, start, stride, places, breaks):
    """Add one view's samples to `values`."""
    find_breaks(breaks, places)
    block, one = np.uintp(0), np.uintp(1)
    while block < breaks.size:
        x = block * np.uintp(RUN)
        if breaks[block] != 0:
            _sample_each(values, weights, coefficients, x, x + np.uintp(RUN), places, start, stride)
            block += one
            continue
        length, at = run_length(breaks, block, places), start + np.uintp(places[x])
        for line in range(np.uintp(4)):
            _sample_run(values, weights, coefficients, x, at + line * stride, length, line)
        block += length // np.uintp(RUN)
    x = np.uintp(breaks.size) * np.uintp(RUN)
    _sample_each(values, weights, coefficients, x, np.uintp(values.size), places, start, stride)


@nb.njit(**INNER)
def _negative(out, image, row):
    for x in range(np.uintp(out.size)):
        out[x] = -image[row + x]


@nb.njit(**INNER)
def _see(seeing, values, places):
    """1 where a pixel has a place, 0 elsewhere; values elsewhere become 0, too."""
    for x in range(np.uintp(places.size)):
        seeing[x] = np.float32(1) if places[x] >= 0 else np.float32(0)
        values[x] = values[x] if places[x] >= 0 else np.float32(0)


@nb.njit(**INNER)
def _add(sums, start, values, factor):
    for x in range(np.uintp(values.size)):
        sums[start + x] += factor * values[x]


@nb.njit(**INNER)
def _add_squares(sums, start, values):
    for x in range(np.uintp(values.size)):
        sums[start + x] += values[x] * values[x]


@nb.njit(**INNER)
def _add_view(sums, start, seeing, values, du, dv):
    """Add one view's values to a row's moments, one after the other from `start` on."""
    one, size = np.float32(1), np.uintp(values.size)
    for factor in (one, du, dv, du * du, du * dv, dv * dv):
        _add(sums, start, seeing, factor)
        start += size
    for factor in (one, du, dv):
        _add(sums, start, values, factor)
        start += size
    _add_squares(sums, start, values)


@nb.njit(**KERNEL)
def moments_kernel(first_row, last_row, disparity, coefficients, standing, surfaces, margin, origin, moments):
    """Moments over the views that see each pixel of rows [first_row, last_row), into `moments`.

    `standing` is (index in the grid, view steps down, across) of every view that has `coefficients`;
    `surfaces` are the nearest at each of its pixels, flat (V·U, H, W). `moments` is (H, MOMENTS, W). Levels
    count from `origin` (H, W), the reference view's, so that sums of squares keep their precision.
    """
    height, width = disparity.shape
    stride = width + 2 * PAD
    size = coefficients.shape[1] * stride
    samples, depths, levels = coefficients.reshape(-1), disparity.reshape(-1), origin.reshape(-1)
    sums = moments.reshape(-1)
    index, down_steps, across_steps = standing
    none, one_row = np.uintp(0), np.uintp(width)
    columns, line = np.arange(width).astype(np.float32), np.empty(width, np.float32)
    places, at = np.empty(width, np.int32), np.empty(width, np.int32)
    breaks, seen = np.empty(width // RUN, np.int32), np.empty(width, surfaces.dtype)
    to, weights = np.empty(2 * width, np.float32), np.empty((8, width), np.float32)
    seeing, values = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(first_row, last_row):
        moments[y] = 0
        line[:] = y
        row = np.uintp(y * width)
        for i in range(index.size):
            dv, du = down_steps[i], across_steps[i]
            _land(to, none, columns, du, depths, row)
            _land(to, one_row, line, dv, depths, row)
            _places(places, to, (height, width), stride)
            _nearest_places(at, to, places, width)
            _look_up(seen, surfaces, np.uintp(index[i] * height * width), at)
            _hide(places, seen, depths, row, margin)
            for axis in range(2):
                from_, row_of = np.uintp(axis * width), 4 * axis
                _outer_weights(to, from_, weights[row_of], weights[row_of + 3])
                _inner_weights(to, from_, weights[row_of + 1], weights[row_of + 2])
            _negative(values, levels, row)
            place = np.uintp(i * size)
            _sample(values, weights.reshape(-1), samples, place, np.uintp(stride), places, breaks)
            _see(seeing, values, places)
            _add_view(sums, np.uintp(y * MOMENTS * width), seeing, values, du, dv)


@nb.njit(**KERNEL)
def slopes_kernel(first_row, last_row, moments, origin, fewest, maps, spreads):
    """What the moments of rows [first_row, last_row) say, into `maps` (4, H, W) and `spreads` (3, H, W).

    `maps`: mean level; sums of the levels times u and v, each counted from its mean over the views that see
    the pixel; variance of the levels over these views. `spreads`: the centred sums of u², uv, v². Pixels that
    fewer than `fewest` views see get none of it.
    """
    for y in range(first_row, last_row):
        s = moments[y]
        for x in range(origin.shape[1]):
            n = s[0, x]
            seen = n >= fewest
            share = np.float32(1) / max(n, np.float32(1))
            mean, u, v = s[6, x] * share, s[1, x] * share, s[2, x] * share
            maps[0, y, x] = origin[y, x] + mean
            maps[1, y, x] = s[7, x] - s[1, x] * mean if seen else np.float32(0)
            maps[2, y, x] = s[8, x] - s[2, x] * mean if seen else np.float32(0)
            rest = max(s[9, x] - s[6, x] * mean, np.float32(0))
            maps[3, y, x] = rest / max(n - np.float32(1), np.float32(1)) if seen else np.float32(0)
            spreads[0, y, x] = s[3, x] - s[1, x] * u if seen else np.float32(0)
            spreads[1, y, x] = s[4, x] - s[1, x] * v if seen else np.float32(0)
            spreads[2, y, x] = s[5, x] - s[2, x] * v if seen else np.float32(0)


@nb.njit(**KERNEL)
def blur_kernel(first_row, last_row, image, taps, less, out):
    """Separable mean of rows [first_row, last_row) with `taps`, or with `less` the rest; borders repeat."""
    height, width = image.shape
    reach = taps.size // 2
    row, mean = np.empty(width + 2 * reach, np.float32), np.empty(width, np.float32)
    for y in range(first_row, last_row):
        inner = row[reach : reach + width]
        inner[:] = 0
        for j in range(taps.size):
            line, tap = image[min(max(y + j - reach, 0), height - 1)], taps[j]
            for x in range(width):
                inner[x] += tap * line[x]
        row[:reach] = inner[0]
        row[reach + width :] = inner[width - 1]
        mean[:] = 0
        for j in range(taps.size):
            shifted, tap = row[j : j + width], taps[j]
            for x in range(width):
                mean[x] += tap * shifted[x]
        for x in range(width):
            out[y, x] = image[y, x] - mean[x] if less else mean[x]


@nb.njit(**INNER)
def _slope(before2, before, after, after2):
    """Derivative of fourth order from four neighbours."""
    return (np.float32(8) * (after - before) - (after2 - before2)) * np.float32(1 / 12)


@nb.njit(**INNER)
def _trust(disparity, y, x, rims, jump):
    """Trust in a pixel near a jump of disparity: `rims[k]` where the first is k + 1 px away, else 1."""
    height, width = disparity.shape
    own = disparity[y, x]
    for ring in range(1, rims.size + 1):
        far = jump * np.float32(ring)
        for row in range(max(y - ring, 0), min(y + ring + 1, height)):
            step = 1 if abs(row - y) == ring else 2 * ring
            for column in range(x - ring, x + ring + 1, step):
                if 0 <= column < width and abs(disparity[row, column] - own) > far:
                    return rims[ring - 1]
    return np.float32(1)


@nb.njit(**KERNEL)
def evidence_kernel(first_row, last_row, fine, spreads, noise, disparity, rule, rims, step, weight, trusted):
    """What the views ask for at each pixel of rows [first_row, last_row), one Gauss–Newton step.

    `fine` (3, H, W) are the high-passed mean level and its angular sums, `noise` (H, W) the variance of one
    view's level. `rule` is (farthest step, step at which evidence counts half, jump of disparity per px);
    `trusted` is the `weight` of a `step` less what it loses near jumps, by `rims`.
    """
    height, width = disparity.shape
    farthest, halving, jump = rule
    mean, along_u, along_v = fine[0], fine[1], fine[2]
    for y in range(first_row, last_row):
        for x in range(width):
            step[y, x] = weight[y, x] = trusted[y, x] = 0
            if min(x, y) < 2 or x >= width - 2 or y >= height - 2:
                continue
            right = _slope(mean[y, x - 2], mean[y, x - 1], mean[y, x + 1], mean[y, x + 2])
            below = _slope(mean[y - 2, x], mean[y - 1, x], mean[y + 1, x], mean[y + 2, x])
            information = (
                right * right * spreads[0, y, x]
                + np.float32(2) * right * below * spreads[1, y, x]
                + below * below * spreads[2, y, x]
            )
            if information <= _NOTHING:
                continue
            asked = (right * along_u[y, x] + below * along_v[y, x]) / information
            asked = min(max(asked, -farthest), farthest)
            part = asked / halving
            step[y, x] = asked
            weight[y, x] = information / (noise[y, x] * (np.float32(1) + part * part))
            trusted[y, x] = weight[y, x] * _trust(disparity, y, x, rims, jump)
