"""Kernels for maps of several views: carried, supported by colours, held against each other."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.kernels.sampling import inside, sample
from lfdepth.engines.layout import DISPARITY_PARTS as PARTS

_TURNS = 2  # of the fixed point: where a pixel comes from depends on its disparity, and that on where


@nb.njit(**KERNEL)
def carry_kernel(first_row, last_row, disparity, beside, seen, dv, du, jump, carried, carried_beside):
    """Sharpen rows [first_row, last_row) of what the view at (dv, du) shows of a map, `seen` (H, W).

    A pixel takes the map's value (H, W) between the pixels it comes from, where these are of one surface,
    and what is `beside` (H, W) the nearest of them.
    """
    height, width = disparity.shape
    for y in range(first_row, last_row):
        for x in range(width):
            d = seen[y, x]
            carried[y, x], carried_beside[y, x] = d, np.float32(0)
            if d == -np.inf:
                continue
            for _ in range(_TURNS):
                from_y, from_x = np.float32(y) + dv * d, np.float32(x) + du * d
                if not inside(from_y, from_x, height, width):
                    break
                top, left = min(int(from_y), height - 2), min(int(from_x), width - 2)
                a, b = disparity[top, left], disparity[top, left + 1]
                c, e = disparity[top + 1, left], disparity[top + 1, left + 1]
                if max(a, b, c, e) - min(a, b, c, e) >= jump:
                    break
                fy, fx = np.float32(from_y - top), np.float32(from_x - left)
                upper, lower = a + fx * (b - a), c + fx * (e - c)
                d = upper + fy * (lower - upper)
            carried[y, x] = d
            row = min(max(int(np.floor(y + dv * d + np.float32(0.5))), 0), height - 1)
            column = min(max(int(np.floor(x + du * d + np.float32(0.5))), 0), width - 1)
            carried_beside[y, x] = beside[row, column]


@nb.njit(**INNER)
def _support(views, scale, others, nearest, y, x, d, own, threshold, margin, colour):
    """Mean likeness of what views show of a pixel at one disparity; 0 where fewer than two see it."""
    rows, columns, height, width = views.shape[:4]
    present, offsets = others
    horizon = (d + margin) * np.float32(PARTS)
    total, count = np.float32(0), 0
    for v in range(rows):
        for u in range(columns):
            to_y, to_x = y - offsets[v, u, 0] * d, x - offsets[v, u, 1] * d
            if not present[v, u] or not inside(to_y, to_x, height, width):
                continue
            row = (v * columns + u) * height + int(to_y + 0.5)
            if nearest[row * width + int(to_x + 0.5)] > horizon:
                continue
            sample(views[v, u], to_y, to_x, scale, colour)
            difference = np.float32(0)
            for c in range(own.size):
                difference += abs(colour[c] - own[c])
            share = difference / (own.size * threshold)
            total += np.float32(1) / (np.float32(1) + share * share)
            count += 1
    return total / np.float32(count) if count > 1 else np.float32(0)


@nb.njit(**KERNEL)
def support_kernel(
    first,
    last,
    places,
    candidates,
    views,
    scale,
    reference,
    others,
    nearest,
    thresholds,
    margin,
    support,
):
    """Support (N, K) of candidates at places [first, last) of (N, 2), NaN where there is no candidate."""
    own, colour = np.empty(views.shape[4], np.float32), np.empty(views.shape[4], np.float32)
    for n in range(first, last):
        y, x = places[n, 0], places[n, 1]
        for c in range(own.size):
            own[c] = scale * np.float32(reference[y, x, c])
        for k in range(candidates.shape[1]):
            d = candidates[n, k]
            support[n, k] = np.float32(-1)
            if np.isfinite(d):
                support[n, k] = _support(
                    views, scale, others, nearest, y, x, d, own, thresholds[y, x], margin, colour
                )


@nb.njit(**INNER)
def _held(maps, y, x, d, partners, steps, tolerance):
    """How many maps hold the same where a pixel lands, and how many show something farther there.

    The pixel lands between pixels: the nearest four are asked, and one that agrees is enough.
    """
    height, width = maps.shape[1:]
    agreeing = against = 0
    for i in range(partners.size):
        to_y, to_x = y - steps[i, 0] * d, x - steps[i, 1] * d
        if not inside(to_y, to_x, height, width):
            continue
        top, left = min(int(to_y), height - 2), min(int(to_x), width - 2)
        nearest = np.float32(-np.inf)
        same = False
        for row in range(top, top + 2):
            for column in range(left, left + 2):
                there = maps[partners[i], row, column]
                same |= abs(there - d) <= tolerance
                nearest = max(nearest, there)
        if same:
            agreeing += 1
        elif nearest < d:
            against += 1
    return agreeing, against


@nb.njit(**KERNEL)
def agree_kernel(first_row, last_row, maps, own, partners, steps, tolerance, settled, agreeing, against):
    """Hold map `own` of `maps` (N, H, W) against its `partners`, which stand `steps` (M, 2) from it.

    Where more speak against a pixel than for it, it takes the value, of the pixels around it and of what the
    partners show where it lands, for which most do.
    """
    height, width = maps.shape[1:]
    for y in range(first_row, last_row):
        for x in range(width):
            d = maps[own, y, x]
            yes, no = _held(maps, y, x, d, partners, steps, tolerance)
            best, score = d, yes - no
            if no > yes:
                for row in range(max(y - 1, 0), min(y + 2, height)):
                    for column in range(max(x - 1, 0), min(x + 2, width)):
                        other = maps[own, row, column]
                        if abs(other - d) <= tolerance:
                            continue
                        more, less = _held(maps, y, x, other, partners, steps, tolerance)
                        if more - less > score:
                            best, score, yes, no = other, more - less, more, less
                for i in range(partners.size):
                    to_y, to_x = y - steps[i, 0] * d, x - steps[i, 1] * d
                    if not inside(to_y, to_x, height, width):
                        continue
                    other = maps[partners[i], int(to_y + 0.5), int(to_x + 0.5)]
                    if abs(other - d) <= tolerance:
                        continue
                    more, less = _held(maps, y, x, other, partners, steps, tolerance)
                    if more - less > score:
                        best, score, yes, no = other, more - less, more, less
            settled[y, x], agreeing[y, x], against[y, x] = best, yes, no
