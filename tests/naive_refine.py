"""The oracle of the refinement, in plain loops: splines, moments over views, Gauss–Newton steps, plane fits.

It shares no code with `lfdepth.blocks`, only the numbers that have a name there. Disparities are in px per
view step, maps are (H, W), views (V, U, H, W, C); levels are those of 8 bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

import naive
import naive_vis
from lfdepth.blocks import refine
from lfdepth.blocks.refine import RefineRule
from lfdepth.engines import layout

Array = NDArray[Any]

NOTHING = 1e-3  # grey levels² of information
SPREAD = 2  # of a fitted plane's weights: they fall as exp(−SPREAD · distance² / radius²)


def mirrored(index: int, count: int) -> int:
    """Index of a sample outside, mirrored about the outermost ones."""
    index = abs(index)
    return index if index < count else 2 * (count - 1) - index


def spline_matrix(count: int) -> Array:
    """What a cubic B-spline with given coefficients is worth at its knots, borders mirrored."""
    out = np.zeros((count, count))
    for i, (step, weight) in product(range(count), ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6))):
        out[i, mirrored(i + step, count)] += weight
    return out


def coefficients(image: Array) -> Array:
    """Coefficients of the interpolating spline, by solving for them."""
    rows, columns = (spline_matrix(count) for count in image.shape)
    return np.asarray(np.linalg.solve(columns, np.linalg.solve(rows, image).T).T)


def basis(distance: float) -> float:
    """The cubic B-spline."""
    t = abs(distance)
    if t >= 2:
        return 0.0
    return (2 - t) ** 3 / 6 if t >= 1 else 2 / 3 - t**2 + t**3 / 2


def sampled(spline: Array, y: float, x: float) -> float:
    """The spline at a place inside the image."""
    height, width = spline.shape
    total = 0.0
    for j, i in product(range(int(y) - 1, int(y) + 3), range(int(x) - 1, int(x) + 3)):
        weight = basis(y - j) * basis(x - i)
        if weight > 0:
            total += weight * spline[mirrored(j, height), mirrored(i, width)]
    return total


def grey(views: Array) -> Array:
    """Luma in 8-bit levels."""
    return np.asarray(naive.luma(views) * 255)


def outer(present: Array) -> Array:
    """Views in the outer half along either axis, counted to the nearer end, and the reference view."""
    chosen = present.copy()
    for i, j in np.ndindex(*present.shape):
        far = False
        for index, count in zip((i, j), present.shape, strict=True):
            far |= 2 * abs(index - count // 2) > min(count // 2, count - 1 - count // 2)
        chosen[i, j] &= far or (i, j) == (present.shape[0] // 2, present.shape[1] // 2)
    return np.asarray(chosen)


@dataclass
class Slopes:
    """Mean level, its change with u and v, its variance, and the spreads of u², uv, v²."""

    mean: Array
    along_u: Array
    along_v: Array
    variance: Array
    spreads: Array


def slopes(views: Array, disparity: Array, margin: float, present: Array) -> Slopes:
    """Statistics of the levels that the views show where the map says a pixel is."""
    grid, size = views.shape[:2], disparity.shape
    chosen = outer(present)
    splines = {(i, j): coefficients(grey(views[i, j])) for i, j in np.argwhere(chosen)}
    nearest = naive_vis.splat(disparity, (grid[0], grid[1]))
    reference = grey(views[grid[0] // 2, grid[1] // 2])
    nothing = np.zeros((3, *size))
    out = Slopes(reference.copy(), nothing[0], nothing[1], nothing[2], np.zeros((3, *size)))
    for y, x in np.ndindex(*size):
        d = float(disparity[y, x])
        rows = []
        for (i, j), spline in splines.items():
            v, u = i - grid[0] // 2, j - grid[1] // 2
            to_y, to_x = (
                np.float32(y) - np.float32(v) * np.float32(d),
                np.float32(x) - np.float32(u) * np.float32(d),
            )
            if not (0 <= to_y <= size[0] - 1 and 0 <= to_x <= size[1] - 1):
                continue
            if nearest[i, j, int(to_y + 0.5), int(to_x + 0.5)] > (d + margin) * layout.DISPARITY_PARTS:
                continue
            rows.append((u, v, sampled(spline, float(to_y), float(to_x))))
        if not rows:
            continue
        u, v, level = np.array(rows, float).T
        out.mean[y, x] = level.mean()
        if len(rows) < refine._FEWEST_VIEWS:
            continue
        u, v, level = u - u.mean(), v - v.mean(), level - level.mean()
        out.along_u[y, x], out.along_v[y, x] = u @ level, v @ level
        out.variance[y, x] = level @ level / (len(rows) - 1)
        out.spreads[:, y, x] = u @ u, u @ v, v @ v
    return out


def blurred(image: Array, deviation: float) -> Array:
    """Gaussian mean out to four standard deviations, borders repeated."""
    reach = int(np.ceil(4 * deviation))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    weights /= weights.sum()
    padded = np.pad(image, reach, "edge")
    for axis in (0, 1):
        padded = np.apply_along_axis(lambda line: np.convolve(line, weights, "valid"), axis, padded)
    return padded


def derivative(image: Array, y: int, x: int) -> tuple[float, float]:
    """Slopes in x and y, of fourth order."""
    taps = ((-2, 1), (-1, -8), (1, 8), (2, -1))
    right = sum(weight * image[y, x + step] for step, weight in taps) / 12
    return right, sum(weight * image[y + step, x] for step, weight in taps) / 12


def trust(disparity: Array, y: int, x: int, rule: RefineRule) -> float:
    """What evidence counts this near to a jump."""
    for ring, share in enumerate(rule.rims, 1):
        for j, i in product(range(y - ring, y + ring + 1), range(x - ring, x + ring + 1)):
            inside = 0 <= j < disparity.shape[0] and 0 <= i < disparity.shape[1]
            at_rim = max(abs(j - y), abs(i - x)) == ring
            if inside and at_rim and abs(disparity[j, i] - disparity[y, x]) > rule.jump * ring:
                return share
    return 1.0


def evidence(
    views: Array, disparity: Array, rule: RefineRule, present: Array | None = None
) -> tuple[Array, Array, Array]:
    """Step, weight and trusted weight of every pixel."""
    found = slopes(
        views, disparity, rule.margin, np.ones(views.shape[:2], bool) if present is None else present
    )
    mean, along_u, along_v = (
        image - blurred(image, rule.high_pass) for image in (found.mean, found.along_u, found.along_v)
    )
    differing = found.variance[found.variance > 0]
    least = max(float(np.median(differing)) if differing.size else 0, refine._LEAST_NOISE**2)
    noise = np.maximum(blurred(found.variance, refine._NOISE_BLUR), least)
    step, weight, trusted = (np.zeros(disparity.shape) for _ in "123")
    for y, x in product(range(2, disparity.shape[0] - 2), range(2, disparity.shape[1] - 2)):
        slope = derivative(mean, y, x)
        uu, uv, vv = found.spreads[:, y, x]
        information = slope[0] ** 2 * uu + 2 * slope[0] * slope[1] * uv + slope[1] ** 2 * vv
        if information <= NOTHING:
            continue
        asked = (slope[0] * along_u[y, x] + slope[1] * along_v[y, x]) / information
        step[y, x] = np.clip(asked, -refine._FARTHEST, refine._FARTHEST)
        weight[y, x] = information / (noise[y, x] * (1 + (step[y, x] / rule.halving) ** 2))
        trusted[y, x] = weight[y, x] * trust(disparity, y, x, rule)
    return step, weight, trusted


def fitted(
    disparity: Array,
    target: Array,
    strength: Array,
    guide: Array,
    gate: float,
    window: tuple[int, int],
    ridge: float,
) -> Array:
    """Heights of the planes through the targets around every pixel, by weighted least squares."""
    radius, spacing = window
    taps, out = range(-radius, radius + 1, spacing), disparity.astype(float)
    for y, x in np.ndindex(*disparity.shape):
        moments, moved = np.diag([0.0, ridge, ridge]), np.zeros(3)
        for dy, dx in product(taps, taps):
            q = (y + dy, x + dx)
            inside = 0 <= q[0] < disparity.shape[0] and 0 <= q[1] < disparity.shape[1]
            if not inside or abs(float(disparity[q]) - float(disparity[y, x])) > gate:
                continue
            weight = strength[q] * naive_vis.likeness(naive_vis.colour_change(guide, (y, x), q))
            weight *= np.exp(-SPREAD * (dy**2 + dx**2) / radius**2)
            tap = np.array([1.0, dx, dy])
            moments += weight * np.outer(tap, tap)
            moved += weight * tap * (target[q] - float(disparity[y, x]))
        out[y, x] += np.linalg.solve(moments, moved)[0]
    return out


def near_jumps(disparity: Array, jump: float) -> Array:
    """Pixels with a jump in their 3×3: one whose 3×3 changes by the jump, and by 0.7 of what its 5×5 does."""

    def change(y: int, x: int, reach: int) -> float:
        window = disparity[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        return float(window.max() - window.min())

    out = np.zeros(disparity.shape, bool)
    for y, x in np.ndindex(*disparity.shape):
        if change(y, x, 1) >= jump and change(y, x, 1) >= 0.7 * change(y, x, 2):
            out[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] = True
    return out


def refined(views: Array, disparity: Array, rule: RefineRule, present: Array | None = None) -> Array:
    """The whole block."""
    if min(disparity.shape) < 5:
        return disparity
    guide, found = naive.guide_image(views, "colour"), disparity
    for count in range(rule.rounds):
        step, weight, trusted = evidence(views, found.astype(np.float32), rule, present)
        prior = rule.prior * (2 if count else 1)
        strength = trusted + prior
        target = found + trusted * step / strength
        window, ridge = (rule.wide_radius, rule.wide_spacing), refine._WIDE_RIDGE * rule.wide_spacing**2
        wide = fitted(found, target, strength, guide, rule.gate, window, ridge)
        drawn = np.clip(wide - found, -refine._FARTHEST, refine._FARTHEST)
        target = target + drawn * prior / strength
        window, ridge = (rule.radius, rule.spacing), prior * rule.spacing**2
        close = fitted(found, target, strength, guide, rule.gate, window, ridge)
        even = naive_vis.evened_within(close, guide, rule.gate)
        change = even - found
        asked, heard = blurred(weight * step, refine._HEARING), blurred(weight, refine._HEARING)
        gain = change * (2 * asked - heard * change) * 4 * np.pi * refine._HEARING**2
        found = rims_drawn(np.where(gain < -rule.refusal, found, even), guide, rule)
    return found


def rims_drawn(disparity: Array, guide: Array, rule: RefineRule) -> Array:
    """Pixels near jumps on planes through what lies farther inside, where rims count a hundredth."""
    rims = near_jumps(disparity, rule.rim_jump)
    strength = np.where(rims, 0.01, 1.0)
    window = (rule.rim_radius, 2)
    return np.where(
        rims, fitted(disparity, disparity, strength, guide, rule.rim_gate, window, 1e-3), disparity
    )
