"""Kernels of the decision at depth edges."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.sampling import inside, sample
from lfdepth.engines.layout import DISPARITY_PARTS as PARTS
from lfdepth.engines.layout import JUMP_SHARE

_REACH = 2  # px around a pixel in which the foreground's colour is looked for
_BLUR = np.float32(1.5)  # standard deviation in px of the weights of those pixels
_FRINGE = np.float32(
    0.05
)  # weight of foreground pixels that touch the background: they may be mixed themselves
_JUMP_SHARE = np.float32(JUMP_SHARE)
_FEW_VIEWS = 3
_SAME = np.float32(4)  # grey levels squared per channel: surfaces of one colour cannot be told apart


@nb.njit(**INNER)
def _two_surfaces(disparity, y, x):
    """Largest and smallest disparity among the pixel and its eight neighbours."""
    near = far = disparity[y, x]
    for row in range(y - 1, y + 2):
        for column in range(x - 1, x + 2):
            near, far = max(near, disparity[row, column]), min(far, disparity[row, column])
    return near, far


@nb.njit(**INNER)
def _is_edge(disparity, y, x, change, jump):
    """Whether a change within 3 × 3 pixels is a jump: within 5 × 5, a steep slope changes twice as far."""
    if change < jump:
        return False
    height, width = disparity.shape
    near = far = disparity[y, x]
    for row in range(max(y - 2, 0), min(y + 3, height)):
        for column in range(max(x - 2, 0), min(x + 3, width)):
            near, far = max(near, disparity[row, column]), min(far, disparity[row, column])
    return change >= _JUMP_SHARE * (near - far)


@nb.njit(**INNER)
def _foreground_colour(disparity, reference, scale, y, x, near, far, mean):
    """Weighted mean colour of near pixels around (y, x), into `mean`; returns weight and summed variance."""
    height, width, channels = reference.shape
    middle = np.float32(0.5) * (near + far)
    total, squares = np.float32(0), np.float32(0)
    mean[:] = 0
    for row in range(max(y - _REACH, 1), min(y + _REACH + 1, height - 1)):
        for column in range(max(x - _REACH, 1), min(x + _REACH + 1, width - 1)):
            if abs(disparity[row, column] - near) > np.float32(0.25) * (near - far) or (
                row == y and column == x
            ):
                continue
            distance = np.float32((row - y) ** 2 + (column - x) ** 2)
            weight = np.exp(-distance / (2 * _BLUR * _BLUR))
            if _two_surfaces(disparity, row, column)[1] < middle:
                weight *= _FRINGE
            total += weight
            for c in range(channels):
                level = scale * np.float32(reference[row, column, c])
                mean[c] += weight * level
                squares += weight * level * level
    if total <= 0:
        return total, np.float32(0)
    variance = squares / total
    for c in range(channels):
        mean[c] /= total
        variance -= mean[c] * mean[c]
    return total, max(variance, np.float32(0))


@nb.njit(**INNER)
def _views_behind(views, scale, others, nearest, margin, row_length, y, x, near, far, samples):
    """Colours at the far disparity in the views that see past the near surface; returns their number.

    `others` is (present but for the reference view, offsets) of the views, (V, U) and (V, U, 2).
    """
    rows, columns, height, width = views.shape[:4]
    present, offsets = others
    horizon = (far + np.float32(0.5) * (near - far)) * np.float32(PARTS)
    count = 0
    for v in range(rows):
        for u in range(columns):
            to_y, to_x = y - offsets[v, u, 0] * far, x - offsets[v, u, 1] * far
            if not present[v, u] or not inside(to_y, to_x, height, width):
                continue
            row = (v * columns + u) * height + int(to_y + 0.5)
            if nearest[row * row_length + margin + int(to_x + 0.5)] > horizon:
                continue
            sample(views[v, u], to_y, to_x, scale, samples[count])
            count += 1
    return count


@nb.njit(**INNER)
def _background_colour(samples, count, mean):
    """Mean colour over views, into `mean`; returns the summed squared spread between views."""
    spread = np.float32(0)
    for c in range(mean.size):
        mean[c] = 0
        for i in range(count):
            mean[c] += samples[i, c]
        mean[c] /= np.float32(count)
        deviation = np.float32(0)
        for i in range(count):
            deviation += abs(samples[i, c] - mean[c])
        deviation /= np.float32(count)
        # A normal spread's standard deviation is √(π/2) times its mean deviation.
        spread += np.float32(np.pi / 2) * deviation * deviation
    return spread


@nb.njit(**INNER)
def _agrees(colour, own, threshold):
    """Whether the mean absolute difference of two colours is below a threshold."""
    difference = np.float32(0)
    for c in range(own.size):
        difference += abs(colour[c] - own[c])
    return difference < own.size * threshold


@nb.njit(**INNER)
def _agreement(samples, count, own, threshold):
    """Share of samples whose mean absolute difference to the pixel's colour is below the threshold."""
    agree = 0
    for i in range(count):
        agree += _agrees(samples[i], own, threshold)
    return np.float32(agree) / np.float32(max(count, 1))


@nb.njit(**INNER)
def _all_views(views, scale, others, y, x, disparity, samples):
    """Colours at one disparity in all views but the reference; returns their number."""
    rows, columns, height, width = views.shape[:4]
    present, offsets = others
    count = 0
    for v in range(rows):
        for u in range(columns):
            to_y, to_x = y - offsets[v, u, 0] * disparity, x - offsets[v, u, 1] * disparity
            if not present[v, u] or not inside(to_y, to_x, height, width):
                continue
            sample(views[v, u], to_y, to_x, scale, samples[count])
            count += 1
    return count


@nb.njit(**INNER)
def _squared_distance(a, b):
    total = np.float32(0)
    for c in range(a.size):
        total += (a[c] - b[c]) ** 2
    return total


@nb.njit(**KERNEL)
def edge_kernel(
    first_row,
    last_row,
    disparity,
    views,
    scale,
    reference,
    others,
    nearest,
    margin,
    row_length,
    thresholds,
    jump,
    spread,
    inertia,
    decided,
    at_edge,
):
    """Decide the pixels beside depth edges in rows [first_row, last_row).

    `scale` turns levels into 8-bit ones; `reference` (H, W, C) is the reference view; `others` as for
    `_views_behind`.
    """
    rows, columns, height, width, channels = views.shape
    samples = np.empty((rows * columns, channels), np.float32)
    front, back, own = (
        np.empty(channels, np.float32),
        np.empty(channels, np.float32),
        np.empty(channels, np.float32),
    )
    for y in range(max(first_row, 1), min(last_row, height - 1)):
        for x in range(1, width - 1):
            near, far = _two_surfaces(disparity, y, x)
            if not _is_edge(disparity, y, x, near - far, jump):
                continue
            at_edge[y, x] = True
            weight, front_spread = _foreground_colour(disparity, reference, scale, y, x, near, far, front)
            count = _views_behind(views, scale, others, nearest, margin, row_length, y, x, near, far, samples)
            if weight <= np.float32(1e-6) or count < _FEW_VIEWS:
                continue
            back_spread = _background_colour(samples, count, back)
            apart = _squared_distance(front, back)
            if apart < _SAME * channels:
                continue
            for c in range(channels):
                own[c] = scale * np.float32(reference[y, x, c])
            is_front = disparity[y, x] > np.float32(0.5) * (near + far)
            if is_front:
                count = _all_views(views, scale, others, y, x, near, samples)
            doubt = np.float32(1) + inertia * _agreement(samples, count, own, thresholds[y, x])
            least = spread * spread * apart + np.float32(1)
            to_back = _squared_distance(own, back) * (front_spread + least)
            to_front = _squared_distance(own, front) * (back_spread + least)
            if is_front and to_back * doubt < to_front:
                decided[y, x] = far
            elif not is_front and to_front * doubt <= to_back:
                decided[y, x] = near
