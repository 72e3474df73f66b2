"""Kernels that fit local planes to the minima of every pixel's own energy.

A row is worked on one neighbour at a time, with a row of running sums per moment; leaf functions take flat
arrays and unsigned offsets, which is what LLVM turns into vector loops. Each writes to one array: with
more, LLVM has too many pairs that might overlap to check, and gives up.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL

_REACH = np.float32(1.5)  # planes that a parabola's vertex may lie from the plane it was looked for at
_FLAT = np.float32(1e-4)  # energy per plane² below which a parabola has no vertex
_MOMENTS = 9


@nb.njit(**KERNEL)
def minima_kernel(first_row, last_row, signs, shares, weight, position, prior, target, strength):
    """Minimum of each pixel's own energy beside `position`, drawn to it by `prior`; and its sharpness.

    A parabola through the energies at the nearest plane and its neighbours has its vertex at `m` and a
    curvature `a`; `target` is (a·m + prior·position) / (a + prior), `strength` a + prior.
    """
    planes, _, width = signs.shape
    for y in range(first_row, last_row):
        for x in range(width):
            near = min(max(int(position[y, x] + np.float32(0.5)), 0), planes - 1)
            target[y, x] = position[y, x]
            strength[y, x] = prior
            if near == 0 or near == planes - 1:
                continue
            scale = weight[y, x] / np.float32(255)
            here = signs[near, y, x] - scale * np.float32(shares[near, y, x])
            before = signs[near - 1, y, x] - scale * np.float32(shares[near - 1, y, x]) - here
            after = signs[near + 1, y, x] - scale * np.float32(shares[near + 1, y, x]) - here
            curvature = np.float32(0.5) * (before + after)
            if curvature <= _FLAT:
                continue
            offset = np.float32(0.25) * (before - after) / curvature
            vertex = np.float32(near) + min(max(offset, -_REACH), _REACH)
            strength[y, x] = curvature + prior
            target[y, x] = (curvature * vertex + prior * position[y, x]) / (curvature + prior)


@nb.njit(**INNER)
def _colour_change(change, guide, here, there, size, channels, plane):
    """Change of colour from pixels to others, summed over the channels, `plane` apart."""
    for x in range(size):
        change[x] = 0
    for c in range(channels):
        own, other = np.uintp(here + c * plane), np.uintp(there + c * plane)
        for x in range(size):
            change[x] += abs(guide[other + x] - guide[own + x])


@nb.njit(**INNER)
def _likeness(change, sharpness):
    """About exp(−t): (1 − t/8)⁸ of the change of colour times `sharpness`, an eighth of the whole."""
    like = max(np.float32(1) - sharpness * change, np.float32(0))
    like *= like
    like *= like
    return like * like


@nb.njit(**INNER)
def _alike(out, change, position, here, there, size, tap):
    """Weights of one neighbour of a row's pixels by distance, colour, and whether it is of their surface.

    `tap` is the weight by distance, the bound on the difference of position, and an eighth of the sharpness.
    """
    weight, gate, sharpness = tap
    for x in range(size):
        like = weight * _likeness(change[x], sharpness)
        out[x] = like if abs(position[there + x] - position[here + x]) <= gate else np.float32(0)


@nb.njit(**INNER)
def _multiply(values, factors, start, size):
    for x in range(size):
        values[x] *= factors[start + x]


@nb.njit(**INNER)
def _move(out, weights, target, there, position, here, size):
    """How far the neighbour's target lies from the pixels, times its weights."""
    for x in range(size):
        out[x] = weights[x] * (target[there + x] - position[here + x])


@nb.njit(**INNER)
def _add(sums, start, values, factor, size):
    for x in range(size):
        sums[start + x] += values[x] * factor


@nb.njit(**INNER)
def _add_neighbour(sums, start, row, weights, moved, dx, dy, size):
    """Add one neighbour, `dx` and `dy` away, of a row's pixels to their nine sums, `row` apart."""
    twice = row + row
    middle, last = start + twice + row, start + twice + twice + twice
    _add(sums, start, weights, np.float32(1), size)
    _add(sums, start + row, weights, dx, size)
    _add(sums, start + twice, weights, dy, size)
    _add(sums, middle, weights, dx * dx, size)
    _add(sums, middle + row, weights, dx * dy, size)
    _add(sums, middle + twice, weights, dy * dy, size)
    _add(sums, last, moved, np.float32(1), size)
    _add(sums, last + row, moved, dx, size)
    _add(sums, last + twice, moved, dy, size)


@nb.njit(**INNER)
def _solve(out, sums, row, position, here, ridge):
    """The fitted planes' heights at their own pixels, by Cramer's rule."""
    for x in range(row):
        a, b, c = sums[x], sums[row + x], sums[2 * row + x]
        d, e, f = sums[3 * row + x] + ridge, sums[4 * row + x], sums[5 * row + x] + ridge
        first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
        moved = sums[6 * row + x] * first + sums[7 * row + x] * second + sums[8 * row + x] * third
        out[x] = position[here + x] + moved / (a * first + b * second + c * third)


@nb.njit(**KERNEL)
def fit_kernel(
    first_row, last_row, position, target, strength, guide, shape, window, gate, sharpness, ridge, out
):
    """Fit a plane around every pixel of rows [first_row, last_row); arrays but `out` are flat.

    `guide` is laid out (C, H, W). `window` is (radius, spacing): neighbours up to `radius` px away take part,
    `spacing` px apart.
    """
    height, width, channels = shape
    radius, spacing = window
    row = np.uintp(width)
    sums, change = np.empty(_MOMENTS * width, np.float32), np.empty(width, np.float32)
    weights, moved = np.empty_like(change), np.empty_like(change)
    spread = np.float32(-2.0 / (radius * radius))
    eighth = np.float32(sharpness / 8)
    for y in range(first_row, last_row):
        sums[:] = 0
        for dy in range(-radius, radius + 1, spacing):
            if not 0 <= y + dy < height:
                continue
            for dx in range(-radius, radius + 1, spacing):
                first, last = max(0, -dx), min(width, width - dx)
                if last <= first:
                    continue
                size = np.uintp(last - first)
                here, there = np.uintp(y * width + first), np.uintp((y + dy) * width + first + dx)
                _colour_change(change, guide, here, there, size, channels, height * width)
                tap = (np.exp(spread * np.float32(dx * dx + dy * dy)), gate, eighth)
                _alike(weights, change, position, here, there, size, tap)
                _multiply(weights, strength, there, size)
                _move(moved, weights, target, there, position, here, size)
                _add_neighbour(
                    sums, np.uintp(first), row, weights, moved, np.float32(dx), np.float32(dy), size
                )
        _solve(out[y], sums, row, position, np.uintp(y * width), ridge)


@nb.njit(**INNER)
def _add_pair(sums, start, before, after, position, here, step, size, tap):
    """Add what two opposite neighbours, `step` before and after a row's pixels, differ from them."""
    weight, gate, sharpness = tap
    for x in range(size):
        own = position[here + x]
        left, right = position[here + x - step] - own, position[here + x + step] - own
        like = min(_likeness(before[x], sharpness), _likeness(after[x], sharpness))
        sums[start + x] += (
            weight * like * (left + right) if max(abs(left), abs(right)) <= gate else np.float32(0)
        )


@nb.njit(**KERNEL)
def even_kernel(first_row, last_row, position, guide, shape, gate, sharpness, out):
    """Binomial mean over pairs of opposite pixels of 3 × 3, for rows [first_row, last_row).

    Fits that take every other pixel fall into four lattices that know nothing of each other; these weights
    are blind to just that pattern, and leave planes as they are. Arguments as for `fit_kernel`.
    """
    height, width, channels = shape
    sums = np.empty(width, np.float32)
    before, after = np.empty_like(sums), np.empty_like(sums)
    eighth = np.float32(sharpness / 8)
    for y in range(first_row, last_row):
        sums[:] = 0
        for dy in range(2):
            if y - dy < 0 or y + dy >= height:
                continue
            for dx in range(-1, 2):
                if width <= 2 * abs(dx) or (dy == 0 and dx != 1):
                    continue
                step, here, size = dy * width + dx, y * width + abs(dx), np.uintp(width - 2 * abs(dx))
                _colour_change(
                    before, guide, np.uintp(here), np.uintp(here - step), size, channels, height * width
                )
                _colour_change(
                    after, guide, np.uintp(here), np.uintp(here + step), size, channels, height * width
                )
                tap = (np.float32((2 - dy) * (2 - abs(dx)) / 16), gate, eighth)
                start = np.uintp(abs(dx))
                _add_pair(sums, start, before, after, position, np.uintp(here), np.uintp(step), size, tap)
        for x in range(width):
            out[y, x] = position[y * width + x] + sums[x]
