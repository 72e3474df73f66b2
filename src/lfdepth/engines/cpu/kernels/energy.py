"""Kernels of the joint decoder: energies, scanline paths, minimum, islands at the range's ends."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.layout import ENERGY_CUT
from lfdepth.engines.layout import ENERGY_SCALE as SCALE
from lfdepth.engines.layout import SHARE_LEVELS as _LEVELS

_CUT = np.float32(ENERGY_CUT)
_FAR = np.int16(32000)
_ALIKE = np.float32(2)  # planes within which neighbours belong to one island


@nb.njit(**KERNEL)
def store_signs_kernel(first_row, last_row, step, smoothed, running, lowest, signs):
    """Keep one plane of the sign profile's energy, and its running sum and minimum."""
    half = np.float32(0.5) * step
    for y in range(first_row, last_row):
        for x in range(smoothed.shape[1]):
            value = smoothed[y, x]
            signs[y, x] = running[y, x] + half * value
            total = running[y, x] + step * value
            running[y, x] = total
            lowest[y, x] = min(lowest[y, x], total)


@nb.njit(**KERNEL)
def store_photo_kernel(first_row, last_row, share, levels):
    """Keep one plane of photo-consistency in 1/255."""
    for y in range(first_row, last_row):
        for x in range(share.shape[1]):
            inside = min(max(share[y, x], np.float32(0)), np.float32(1))
            levels[y, x] = np.uint8(inside * np.float32(_LEVELS) + np.float32(0.5))


@nb.njit(**KERNEL)
def energy_kernel(first_row, last_row, signs, shares, weight, energy):
    """Joint energies above the pixel's least, as whole numbers, planes innermost."""
    planes, _, width = signs.shape
    row = np.empty((planes, width), np.float32)
    least = np.empty(width, np.float32)
    for y in range(first_row, last_row):
        least[:] = np.inf
        for k in range(planes):
            for x in range(width):
                value = signs[k, y, x] - weight[y, x] * np.float32(shares[k, y, x]) / np.float32(_LEVELS)
                row[k, x] = value
                least[x] = min(least[x], value)
        for x in range(width):
            for k in range(planes):
                energy[y, x, k] = np.int16(min((row[k, x] - least[x]) * np.float32(SCALE), _CUT))


@nb.njit(**INNER)
def _edge_weight(guide, y, x, other_y, other_x, sharpness, noise):
    change = np.float32(0)
    for c in range(guide.shape[2]):
        change += abs(guide[y, x, c] - guide[other_y, other_x, c])
    return np.exp(-sharpness * max(change - noise, np.float32(0)))


@nb.njit(**INNER)
def _advance(path, spare, energy, total, slope, jump):
    """One step along a path: `path[1:-1]` becomes the cost of reaching each plane here, less its least."""
    count = energy.size
    least = path[1]
    for k in range(2, count + 1):
        least = min(least, path[k])
    ceiling = np.int16(least + jump)
    for k in range(count):
        near = np.int16(min(path[k], path[k + 2]) + slope)
        best = min(min(path[k + 1], near), ceiling)
        spare[k] = np.int16(best - least + energy[k])
    for k in range(count):
        path[k + 1] = spare[k]
        total[k] = np.int16(total[k] + spare[k])


@nb.njit(**INNER)
def _start(path, energy, total):
    path[0] = _FAR
    path[-1] = _FAR
    for k in range(energy.size):
        path[k + 1] = energy[k]
        total[k] = np.int16(total[k] + energy[k])


@nb.njit(**KERNEL)
def horizontal_kernel(first_row, last_row, energy, total, guide, slope, jump, sharpness, noise):
    """Paths from the left and from the right for rows [first_row, last_row)."""
    width, count = energy.shape[1:]
    path, spare = np.empty(count + 2, np.int16), np.empty(count, np.int16)
    for y in range(first_row, last_row):
        for side in range(2):
            for i in range(width):
                x = i if side == 0 else width - 1 - i
                if i == 0:
                    _start(path, energy[y, x], total[y, x])
                    continue
                weight = _edge_weight(guide, y, x, y, x - 1 if side == 0 else x + 1, sharpness, noise)
                _advance(
                    path, spare, energy[y, x], total[y, x], np.int16(slope * weight), np.int16(jump * weight)
                )


@nb.njit(**KERNEL)
def vertical_kernel(first_column, last_column, energy, total, guide, slope, jump, sharpness, noise):
    """Paths from above and from below for columns [first_column, last_column)."""
    height, _, count = energy.shape
    paths = np.empty((last_column - first_column, count + 2), np.int16)
    spare = np.empty(count, np.int16)
    for side in range(2):
        for i in range(height):
            y = i if side == 0 else height - 1 - i
            for x in range(first_column, last_column):
                path = paths[x - first_column]
                if i == 0:
                    _start(path, energy[y, x], total[y, x])
                    continue
                weight = _edge_weight(guide, y, x, y - 1 if side == 0 else y + 1, x, sharpness, noise)
                _advance(
                    path, spare, energy[y, x], total[y, x], np.int16(slope * weight), np.int16(jump * weight)
                )


@nb.njit(**KERNEL)
def decode_kernel(first_row, last_row, total, position):
    """Plane of least total, between planes by a parabola."""
    width, count = total.shape[1:]
    for y in range(first_row, last_row):
        for x in range(width):
            best = 0
            for k in range(1, count):
                if total[y, x, k] < total[y, x, best]:
                    best = k
            offset = np.float32(0)
            if 0 < best < count - 1:
                before = np.float32(total[y, x, best - 1]) - np.float32(total[y, x, best])
                after = np.float32(total[y, x, best + 1]) - np.float32(total[y, x, best])
                if before + after > 0:
                    offset = np.float32(0.5) * (before - after) / (before + after)
            position[y, x] = np.float32(best) + offset


@nb.njit(**INNER)
def _neighbour(pixel, side, height, width):
    """Pixel above, below, left or right of a pixel, counted row by row; −1 outside."""
    y, x = pixel // width + (-1, 1, 0, 0)[side], pixel % width + (0, 0, -1, 1)[side]
    return y * width + x if 0 <= y < height and 0 <= x < width else -1


@nb.njit(**INNER)
def _grow(flat, seen, island, height, width):
    """Grow an island from its first pixel over alike neighbours until it fills `island`; returns its size."""
    size, done = 1, 0
    while done < size < island.size:
        for side in range(4):
            other = _neighbour(island[done], side, height, width)
            if other < 0 or seen[other] or abs(flat[other] - flat[island[done]]) > _ALIKE:
                continue
            seen[other] = True
            island[size] = other
            size += 1
            if size == island.size:
                break
        done += 1
    return size


@nb.njit(**INNER)
def _middle(values, count):
    """Median of the first few values, the lower one of two; sorts them."""
    for i in range(1, count):
        value, j = values[i], i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return values[(count - 1) // 2]


@nb.njit(**KERNEL)
def fill_islands_kernel(position, planes, largest):
    """Fill islands of at most `largest` pixels at the first or last plane by the median around them.

    Least at the end of the range, an energy has no minimum inside it; a glint, which moves through the views
    as no surface does, often looks so.
    """
    height, width = position.shape
    flat = position.reshape(-1)
    seen = np.zeros(flat.size, np.bool_)
    island, shore = np.empty(largest + 1, np.int64), np.empty(4 * largest, np.float32)
    for start in range(flat.size):
        if seen[start] or 0 < flat[start] < planes - 1:
            continue
        seen[start] = True
        island[0] = start
        size = _grow(flat, seen, island, height, width)
        if size > largest:
            seen[island[:size]] = False  # or what is left of a large one would look small
            continue
        count = 0
        for i in range(size):
            for side in range(4):
                other = _neighbour(island[i], side, height, width)
                if other >= 0 and abs(flat[other] - flat[island[i]]) > _ALIKE:
                    shore[count] = flat[other]
                    count += 1
        if count > 0:
            fill = _middle(shore, count)
            for i in range(size):
                flat[island[i]] = fill
