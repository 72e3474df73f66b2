"""Kernels of the sub-pixel refinement: spline coefficients, moments over views, evidence."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.layout import DISPARITY_PARTS

PAD = 2
"""Coefficients kept beyond each border, mirrored about the outermost sample."""

MOMENTS = 10
"""Sums over views per pixel: 1, u, v, u², uv, v², I, uI, vI, I²."""

_POLE = np.float32(np.sqrt(3.0) - 2.0)  # of the cubic B-spline's inverse filter
_GAIN = np.float32(6.0)
_START = 12  # samples after which the pole's powers are below a single float's precision
_NOTHING = np.float32(1e-3)  # grey levels²: less information is rounding
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
    for y in range(height):
        for x in range(width):
            if channels == 3:
                level = (
                    _LUMA[0] * np.float32(view[y, x, 0])
                    + _LUMA[1] * np.float32(view[y, x, 1])
                    + _LUMA[2] * np.float32(view[y, x, 2])
                )
            else:
                level = np.float32(view[y, x, 0])
            out[x, y] = scale * level


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
        for y in range(height):
            for x in range(width):
                down[y, x] = across[x, y]
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
def _weights(fraction, weights):
    """The four cubic B-spline weights of a row of fractions, into `weights` (4, W)."""
    sixth = np.float32(1 / 6)
    for x in range(fraction.size):
        f = fraction[x]
        g = np.float32(1) - f
        weights[0, x] = sixth * g * g * g
        weights[1, x] = np.float32(2 / 3) - np.float32(0.5) * f * f * (np.float32(1) + g)
        weights[2, x] = np.float32(2 / 3) - np.float32(0.5) * g * g * (np.float32(1) + f)
        weights[3, x] = sixth * f * f * f


@nb.njit(**INNER)
def _places(disparity, y, dv, du, size, stride, places, part_x, part_y):
    """Where a row's pixels lie in a view: flat place of the upper left coefficient, or −1, and fractions."""
    height, width = size
    for x in range(width):
        to_x, to_y = np.float32(x) - du * disparity[x], np.float32(y) - dv * disparity[x]
        inside = (
            (to_x >= 0) & (to_y >= 0) & (to_x <= np.float32(width - 1)) & (to_y <= np.float32(height - 1))
        )
        left, top = np.floor(to_x), np.floor(to_y)
        part_x[x], part_y[x] = to_x - left, to_y - top
        at = (np.int32(top) + np.int32(PAD - 1)) * np.int32(stride) + np.int32(left) + np.int32(PAD - 1)
        places[x] = at if inside else np.int32(-1)


@nb.njit(**INNER)
def _hide(disparity, y, dv, du, margin, nearest, start, row_length, places):
    """Strike out the places of pixels behind something nearer in a view."""
    for x in range(disparity.size):
        if places[x] < 0:
            continue
        d = disparity[x]
        to_x = np.int32(np.float32(x) - du * d + np.float32(0.5))
        to_y = np.int32(np.float32(y) - dv * d + np.float32(0.5))
        seen = nearest[np.uintp(start + to_y * row_length + to_x)]
        if np.float32(seen) > (d + margin) * np.float32(DISPARITY_PARTS):
            places[x] = -1


@nb.njit(**INNER)
def _add_view(sums, coefficients, stride, places, across, down, du, dv, origin):
    """Add one view's samples to a row's moments (MOMENTS, W)."""
    one, two, three = np.uintp(1), np.uintp(2), np.uintp(3)
    step = np.uintp(stride)
    for x in range(places.size):
        if places[x] < 0:
            continue
        a, b, c, d = across[0, x], across[1, x], across[2, x], across[3, x]
        at = np.uintp(places[x])
        value = -origin[x]
        for j in range(4):
            value += down[j, x] * (
                a * coefficients[at]
                + b * coefficients[at + one]
                + c * coefficients[at + two]
                + d * coefficients[at + three]
            )
            at += step
        sums[0, x] += np.float32(1)
        sums[1, x] += du
        sums[2, x] += dv
        sums[3, x] += du * du
        sums[4, x] += du * dv
        sums[5, x] += dv * dv
        sums[6, x] += value
        sums[7, x] += du * value
        sums[8, x] += dv * value
        sums[9, x] += value * value


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
    flat = coefficients.reshape(-1)
    index, down_steps, across_steps = standing
    places = np.empty(width, np.int32)
    part_x, part_y = np.empty(width, np.float32), np.empty(width, np.float32)
    across, down = np.empty((4, width), np.float32), np.empty((4, width), np.float32)
    for y in range(first_row, last_row):
        sums = moments[y]
        sums[:] = 0
        for i in range(index.size):
            dv, du = down_steps[i], across_steps[i]
            _places(disparity[y], y, dv, du, (height, width), stride, places, part_x, part_y)
            _hide(disparity[y], y, dv, du, margin, surfaces, index[i] * height * width, width, places)
            _weights(part_x, across)
            _weights(part_y, down)
            view = flat[i * size : (i + 1) * size]
            _add_view(sums, view, stride, places, across, down, du, dv, origin[y])


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
