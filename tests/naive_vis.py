"""The oracle of the default method's own parts, in plain loops: visibility, energies, paths, edges, noise.

It shares no code with `lfdepth` and none of its numbers. Disparities are in px per
view step, maps are (H, W), volumes (K, H, W) front to back, views (V, U, H, W, C).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

import naive
import naive_gloss
import naive_photo
from lfdepth.blocks.edges import EdgeRule
from lfdepth.blocks.energy import JointRule
from lfdepth.methods.fbs_vis import FbsVis

Array = NDArray[Any]

# Numbers that the method keeps inside its formulas, written down here once more: one that is changed in the
# package alone makes the two disagree.
FEWEST_VIEWS = 25  # that thinning leaves
PARTS, NOTHING = 1000, -32768  # of a px per view step in which splats are kept; where nothing is known
JUMP = 0.25  # px per view step from which neighbours are of two surfaces
MARGIN = 0.2  # px per view step by which a surface has to be nearer to hide a plane
ENERGY, SHARES = 2000, 255  # whole energies per unit; parts that shares are kept in
ALIKE, LARGEST_ISLAND = 2.0, 2  # planes within which neighbours are one island; its largest size in px
FLAT, VERTEX_REACH = 1e-4, 1.5  # curvature below which a parabola has no vertex; planes it may be away
FIT_GATE, FIT_PRIOR, FIT_RIDGE, FIT_SHARPNESS, FIT_SPACING = 0.175, 2.0, 4.0, 10.0, 2
FRONT_REACH, FRONT_BLUR, FRINGE = 2, 1.5, 0.05  # px, px, weight of what touches the background
FEW_VIEWS, SAME_COLOUR, JUMP_SHARE = 3, 4.0, 0.7
MEDIAN = (1, 0.05, 2.0)  # radius in px, standard deviations of colour and space
SURE_PASSES, LATE, EDGE_TRUST, UNSTEADY = 2, 3.0, 0.3, 0.15
SAMPLES, CONTRAST_WINDOW, GREY, FEW = 800, 4, 1.4, 1.8
CONTRAST = (0.01, 0.25)  # of photo-consistency over planes, where its weight rises from 0 to 1
TEXTURE = (0.55, 0.8)  # the same for local contrast over the residual level
TEXTURE_SLOPE = 0.2  # px
RESIDUAL_QUANTILE, NOISE_QUANTILE = 0.25, 0.05
FEWEST_SEEING = 0.1  # of all views
INSIDE = 0.25  # of a jump, within which a pixel's disparity is the nearer surface's
THRESHOLDS = (0.2, 0.003, 0.02)
HIGHEST_THRESHOLD = 0.1  # that noise can raise the lower bound to
GLOSSY_WEIGHT = 2.0  # of photo-consistency where signs have no say
STEADY = 2  # px around a pixel within which a map that changes fast costs trust
SPREAD = 2  # of a fitted plane's weights: they fall as exp(−SPREAD · distance² / radius²)
FEWEST_PLANES_SLOPE = 1.5  # planes within which a neighbour is of one surface, however coarse the step


def full_scale(views: Array) -> float:
    return {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}[views.dtype.name]


def reference(views: Array) -> Array:
    return np.asarray(views[views.shape[0] // 2, views.shape[1] // 2])


def thresholds(views: Array, noise_level: float = 0.0) -> Array:
    """Of photo-consistency, fractions of full scale; in single precision, as differences may equal them.

    Their lower bound rises by as much as noise exceeds twice its usual value.
    """
    slope, low, high = THRESHOLDS
    if noise_level > 2 * low:
        low = min(noise_level - low, HIGHEST_THRESHOLD)
    return np.asarray(naive_photo.local_thresholds(reference(views), slope, low, max(low, high)), np.float32)


def ramp(values: Array, low: float, high: float) -> Array:
    return np.asarray(np.clip((values - low) / (high - low), 0, 1))


def other_views(views: Array, present: Array | None) -> Iterator[tuple[int, int]]:
    """Indices of the present views but the reference view, row by row."""
    rows, columns = views.shape[:2]
    for i, j in product(range(rows), range(columns)):
        if (i, j) != (rows // 2, columns // 2) and (present is None or present[i, j]):
            yield i, j


def bilinear(image: Array, y: float, x: float) -> Array | None:
    """Colour of an image (H, W, C) at (y, x), or None outside."""
    height, width = image.shape[:2]
    if not (0 <= y <= height - 1 and 0 <= x <= width - 1):
        return None
    top, left = int(np.floor(y)), int(np.floor(x))
    bottom, right = min(top + 1, height - 1), min(left + 1, width - 1)
    fy, fx = y - top, x - left
    upper = (1 - fx) * image[top, left].astype(float) + fx * image[top, right]
    lower = (1 - fx) * image[bottom, left].astype(float) + fx * image[bottom, right]
    return np.asarray((1 - fy) * upper + fy * lower)


# Views that vote


def thinned(present: Array, sparse: bool) -> Array:
    """A chessboard of the views, or with `sparse` every other row and column, if enough of them are left."""
    rows, columns = present.shape
    chessboard, corners = np.zeros_like(present), np.zeros_like(present)
    for i, j in np.argwhere(present):
        down, across = abs(i - rows // 2), abs(j - columns // 2)
        chessboard[i, j] = (down + across) % 2 == 0
        corners[i, j] = down % 2 == 0 and across % 2 == 0
    if sparse and corners.sum() >= FEWEST_VIEWS:
        return corners
    return chessboard if chessboard.sum() >= FEWEST_VIEWS else present


def voting(views: Array, present: Array | None, sparse: bool = False) -> Array:
    """The views that vote on colours."""
    return thinned(np.ones(views.shape[:2], bool) if present is None else present, sparse)


# Exact visibility


def splat(disparity: Array, grid: tuple[int, int]) -> Array:
    """Nearest surface at every pixel of every view (V, U, H, W), whole parts; EMPTY where none is known.

    Neighbours of one surface that land two pixels apart leave the farther one's level between them.
    """
    height, width = disparity.shape
    nearest = np.full((*grid, height, width), NOTHING, np.int64)

    def place(i: int, j: int, y: int, x: int) -> tuple[int, int]:
        d = float(disparity[y, x])
        to_x, to_y = x - (j - grid[1] // 2) * d + 0.5, y - (i - grid[0] // 2) * d + 0.5
        return int(np.floor(to_y)), int(np.floor(to_x))

    def put(i: int, j: int, at: tuple[int, int], parts: int) -> None:
        if 0 <= at[0] < height and 0 <= at[1] < width:
            nearest[i, j, at[0], at[1]] = max(nearest[i, j, at[0], at[1]], parts)

    for i, j, y, x in product(range(grid[0]), range(grid[1]), range(height), range(width)):
        at, parts = place(i, j, y, x), int(float(disparity[y, x]) * PARTS)
        put(i, j, at, parts)
        for axis, before in enumerate(((y - 1, x), (y, x - 1))):
            if min(before) < 0:
                continue
            level = int(float(disparity[before]) * PARTS)
            if at[axis] - place(i, j, *before)[axis] == 2 and abs(parts - level) < JUMP * PARTS:
                put(i, j, (at[0] - (axis == 0), at[1] - (axis == 1)), min(parts, level))
    return nearest


def sees(disparity: Array, plane: float, grid: tuple[int, int]) -> Array:
    """Whether view (i, j) counts at a plane for a pixel of the reference view, (V, U, H, W).

    It does if nothing nearer than the plane lies where the plane shows the pixel, or if the pixel itself is
    in front of the plane. Beside the image nothing is known.
    """
    height, width = disparity.shape
    nearest = splat(disparity, grid)
    out = np.ones((*grid, height, width), bool)
    for i, j, y, x in product(range(grid[0]), range(grid[1]), range(height), range(width)):
        at_x = x + int(np.floor(-(j - grid[1] // 2) * plane + 0.5))
        at_y = y + int(np.floor(-(i - grid[0] // 2) * plane + 0.5))
        if disparity[y, x] <= plane + MARGIN and 0 <= at_x < width and 0 <= at_y < height:
            level = nearest[i, j, at_y, at_x]
            out[i, j, y, x] = level <= round((plane + MARGIN) * PARTS)
    return out


def visible_share(
    views: Array, plane: float, threshold: Array, disparity: Array, present: Array | None = None
) -> Array:
    """Share of the views that see a plane that show the reference view's colour there."""
    rows, columns, height, width, channels = views.shape
    present = np.ones((rows, columns), bool) if present is None else present
    stack = naive_photo.levels(views)
    seeing = sees(disparity, plane, (rows, columns))
    counted, seen = np.zeros((height, width)), np.zeros((height, width))
    for i, j in np.argwhere(present):
        shifted = naive_photo.sample(stack[i, j], -(j - columns // 2) * plane, -(i - rows // 2) * plane)
        apart = np.abs(shifted - reference(stack)).sum(axis=2)
        agrees = apart < threshold.astype(np.float64) * (channels * 255 * naive_photo.UNIT)
        counted += agrees & seeing[i, j]
        seen += seeing[i, j]
    return np.asarray(counted / np.maximum(seen, FEWEST_SEEING * present.sum()))


# The joint energy, its paths and its minimum


def sign_energy(smoothed: Array, step: float) -> Array:
    """step · (Σ_{i<k} C̃_i + C̃_k / 2) of a profile or volume along its first axis."""
    profile = smoothed.astype(np.float64)
    return np.asarray(step * (np.cumsum(profile, axis=0) - profile / 2))


def joint_energy(signs: Array, share: Array, weight: Array) -> Array:
    """Energies (H, W, K) above the pixel's least, real numbers."""
    energy = np.moveaxis(signs - weight * share, 0, -1)
    return np.asarray(energy - energy.min(axis=-1, keepdims=True))


def kept(share: Array) -> Array:
    """Shares of views as whole parts."""
    return np.asarray(np.rint(np.clip(share, 0, 1) * SHARES), np.int64)


def whole(energy: Array) -> Array:
    """Energies as whole numbers, cut at 2 units."""
    return np.asarray(np.minimum(energy * ENERGY, 2 * ENERGY), np.int64)


def colour_change(guide: Array, a: tuple[int, int], b: tuple[int, int]) -> float:
    return float(np.abs(guide[a].astype(float) - guide[b]).sum())


def edge_weight(
    guide: Array, a: tuple[int, int], b: tuple[int, int], sharpness: float, noise: float
) -> float:
    return float(np.exp(-sharpness * max(colour_change(guide, a, b) - noise, 0)))


def walk(energies: list[Array], penalties: list[tuple[int, int]]) -> list[Array]:
    """Costs of the best paths along a line of pixels to each plane, less the best of the pixel before.

    `penalties[i]` is (slope, jump) between pixels i and i + 1.
    """
    costs = [energies[0]]
    for energy, (slope, jump) in zip(energies[1:], penalties, strict=True):
        before = costs[-1]
        least, planes = int(before.min()), len(before)
        here = []
        for k in range(planes):
            near = [int(before[n]) + slope for n in (k - 1, k + 1) if 0 <= n < planes]
            here.append(int(energy[k]) + min(int(before[k]), *near, least + jump) - least)
        costs.append(np.array(here))
    return costs


def four_paths(
    energy: Array, guide: Array, slope: float, jump: float, sharpness: float, noise: float = 0.0
) -> Array:
    """Semi-global matching (Hirschmüller 2008): whole costs (H, W, K), summed over paths from four sides."""
    height, width = energy.shape[:2]
    total = np.zeros(energy.shape, np.int64)
    rows = [[(y, x) for x in range(width)] for y in range(height)]
    columns = [[(y, x) for y in range(height)] for x in range(width)]
    for line in rows + columns:
        for path in (line, line[::-1]):
            steps = zip(path[1:], path[:-1], strict=True)
            weights = [edge_weight(guide, a, b, sharpness, noise) for a, b in steps]
            costs = walk([energy[p] for p in path], [(int(slope * w), int(jump * w)) for w in weights])
            for p, cost in zip(path, costs, strict=True):
                total[p] += cost
    return total


def parabola(total: Array) -> Array:
    """Position of each pixel's least value along the last axis, between places by a parabola."""
    best: Array = total.argmin(axis=-1)
    position = best.astype(np.float64)
    for p in np.ndindex(*best.shape):
        k = int(best[p])
        if 0 < k < total.shape[-1] - 1:
            left, middle, right = (float(total[p][n]) for n in (k - 1, k, k + 1))
            curvature = left - 2 * middle + right
            position[p] += (left - right) / (2 * curvature) if curvature > 0 else 0
    return position


# Islands at the ends of the range


def beside(p: tuple[int, int], size: tuple[int, ...]) -> list[tuple[int, int]]:
    """The pixels above, below, left and right of a pixel."""
    y, x = p
    around = [(y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)]
    return [(a, b) for a, b in around if 0 <= a < size[0] and 0 <= b < size[1]]


def alike(position: Array, p: tuple[int, int], q: tuple[int, int]) -> bool:
    return abs(float(position[p]) - float(position[q])) <= ALIKE


def fill_islands(position: Array, planes: int, largest: int) -> Array:
    """Give islands at the first or last plane, row by row, the (lower) median of their shore."""
    out, filled = position.copy(), set[tuple[int, int]]()
    for start in np.ndindex(*position.shape):
        if start in filled or 0 < out[start] < planes - 1:
            continue
        island = [start]
        for p in island:  # which grows
            for q in beside(p, out.shape):
                if q not in island and q not in filled and alike(out, p, q):
                    island.append(q)
        if len(island) > largest:
            continue
        shore = [out[q] for p in island for q in beside(p, out.shape) if not alike(out, p, q)]
        filled.update(island)
        for p in island:
            out[p] = sorted(shore)[(len(shore) - 1) // 2] if shore else out[p]
    return out


# Planes fitted to the pixels' own energies


def own_minimum(energy: Array, position: float, prior: float) -> tuple[float, float]:
    """Place and sharpness of the minimum of energies (K,) beside a position, which draws it to itself."""
    near = min(max(int(np.floor(position + 0.5)), 0), len(energy) - 1)
    if near in (0, len(energy) - 1):
        return position, prior
    # The parabola a·(k − near)² + b·(k − near) + c through the three energies.
    a = (energy[near - 1] - 2 * energy[near] + energy[near + 1]) / 2
    b = (energy[near + 1] - energy[near - 1]) / 2
    if a <= FLAT:
        return position, prior
    reach = VERTEX_REACH
    vertex = near + np.clip(-b / (2 * a), -reach, reach)
    return float((a * vertex + prior * position) / (a + prior)), float(a + prior)


def likeness(change: float) -> float:
    """About exp(−sharpness · change)."""
    return float(max(1 - FIT_SHARPNESS / 8 * change, 0) ** 8)


def fit_plane(
    position: Array,
    target: Array,
    strength: Array,
    guide: Array,
    step: float,
    radius: int,
    p: tuple[int, int],
) -> float:
    """Height at pixel p of the plane through the targets around it, by weighted least squares."""
    gate = max(FIT_GATE / step, FEWEST_PLANES_SLOPE)
    ridge = FIT_RIDGE * step**2 * FIT_SPACING**2
    taps = range(-radius, radius + 1, FIT_SPACING)
    moments, moved = np.diag([0.0, ridge, ridge]), np.zeros(3)
    for dy, dx in product(taps, taps):
        q = (p[0] + dy, p[1] + dx)
        inside = 0 <= q[0] < position.shape[0] and 0 <= q[1] < position.shape[1]
        if not inside or abs(float(position[q]) - float(position[p])) > gate:
            continue
        weight = float(strength[q]) * likeness(colour_change(guide, p, q))
        weight *= np.exp(-SPREAD * (dy**2 + dx**2) / radius**2)
        tap = np.array([1.0, dx, dy])
        moments += weight * np.outer(tap, tap)
        moved += weight * tap * (float(target[q]) - float(position[p]))
    return float(position[p] + np.linalg.solve(moments, moved)[0])


def fit_surfaces(position: Array, energy: Array, guide: Array, step: float, radius: int) -> Array:
    """Places between planes; energies are (H, W, K)."""
    prior = FIT_PRIOR * step**2
    target, strength, out = (np.empty(position.shape) for _ in "123")
    for p in np.ndindex(*position.shape):
        target[p], strength[p] = own_minimum(energy[p], float(position[p]), prior)
    for p in np.ndindex(*position.shape):
        out[p] = fit_plane(position, target, strength, guide, step, radius, (p[0], p[1]))
    return evened(out, guide, step)


def evened(position: Array, guide: Array, step: float) -> Array:
    """The same of places between planes."""
    return evened_within(position, guide, max(FIT_GATE / step, FEWEST_PLANES_SLOPE))


def evened_within(position: Array, guide: Array, gate: float) -> Array:
    """Binomial mean of 3 × 3 pixels; of pairs of opposite neighbours, either both take part or none does."""
    out = position.copy()
    for y, x in np.ndindex(*position.shape):
        for dy, dx, weight in ((0, 1, 2), (1, 0, 2), (1, 1, 1), (1, -1, 1)):
            pair = ((y - dy, x - dx), (y + dy, x + dx))
            if any(not (0 <= a < position.shape[0] and 0 <= b < position.shape[1]) for a, b in pair):
                continue
            moves = [float(position[q] - position[y, x]) for q in pair]
            if max(map(abs, moves)) <= gate:
                like = min(likeness(colour_change(guide, (y, x), q)) for q in pair)
                out[y, x] += weight * like * sum(moves) / 16
    return out


@dataclass(frozen=True)
class Decoded:
    disparity: Array
    confidence: Array


def decode(
    plane: Array,
    smoothed: Array,
    share: Array,
    views: Array,
    level: float,
    guide: Array,
    rule: JointRule,
    stride: int,
    present: Array | None = None,
    glossy: Array | None = None,
) -> Decoded:
    """The joint decoder on every `stride`-th plane; `smoothed` and `share` are (K, H, W).

    `level` is the views' residual level; `glossy` (H, W) are pixels whose signs have no say.
    """
    step = float(plane[0] - plane[1])
    silent = np.zeros(share.shape[1:], bool) if glossy is None else glossy
    share = kept(share[::stride]) / SHARES
    contrast = share.max(axis=0) - share.mean(axis=0)
    weight = rule.photo_weight * ramp(contrast, *CONTRAST) * texture_weight(views, level, present)
    weight = np.where(silent, GLOSSY_WEIGHT * weight, weight)
    energy = joint_energy(np.where(silent, 0, sign_energy(smoothed, step)[::stride]), share, weight)
    slope, jump = rule.slope_penalty * stride * ENERGY, rule.jump_penalty * ENERGY
    dead_zone = level * guide.shape[2]
    total = four_paths(whole(energy), guide, slope, jump, rule.edge_sharpness, dead_zone)
    position = fill_islands(parabola(total), len(share), LARGEST_ISLAND)
    if stride == 1 and rule.fit_radius > 0:
        position = fit_surfaces(position, energy, guide, step, rule.fit_radius)
    fit = np.where(silent, contrast, naive.confidence(smoothed))
    return Decoded(plane[0] - step * stride * position, np.sqrt(fit * np.clip(contrast, 0, 1)))


# Depth edges


def surfaces(disparity: Array, y: int, x: int) -> tuple[float, float]:
    """Nearest and farthest disparity of the 3 × 3 pixels."""
    window = disparity[y - 1 : y + 2, x - 1 : x + 2].astype(np.float64)
    return float(window.max()), float(window.min())


def front_colour(disparity: Array, image: Array, y: int, x: int) -> tuple[Array, float] | None:
    """Weighted mean colour of the nearer surface's pixels around (y, x), and its variance over channels."""
    height, width = disparity.shape
    near, far = surfaces(disparity, y, x)
    reach, blur = FRONT_REACH, FRONT_BLUR
    found = []
    for row, column in product(range(y - reach, y + reach + 1), range(x - reach, x + reach + 1)):
        inside = 1 <= row < height - 1 and 1 <= column < width - 1 and (row, column) != (y, x)
        if not inside or abs(float(disparity[row, column]) - near) > INSIDE * (near - far):
            continue
        weight = float(np.exp(-((row - y) ** 2 + (column - x) ** 2) / (2 * blur**2)))
        if surfaces(disparity, row, column)[1] < (near + far) / 2:
            weight *= FRINGE
        found.append((weight, image[row, column].astype(np.float64)))
    if not found:
        return None
    weights = np.array([weight for weight, _ in found])
    colours = np.array([colour for _, colour in found])
    mean = weights @ colours / weights.sum()
    return mean, float((weights @ (colours - mean) ** 2 / weights.sum()).sum())


def samples_at(
    views: Array, present: Array | None, y: int, x: int, disparity: float
) -> Iterator[tuple[tuple[int, int], tuple[float, float], Array]]:
    """View, place (y, x) in it and colour there of a pixel at a disparity, in other views that hold it."""
    for i, j in other_views(views, present):
        at = (y - (i - views.shape[0] // 2) * disparity, x - (j - views.shape[1] // 2) * disparity)
        colour = bilinear(views[i, j], *at)
        if colour is not None:
            yield (i, j), at, colour


def back_samples(
    views: Array, present: Array | None, nearest: Array, y: int, x: int, near: float, far: float
) -> list[Array]:
    """Colours at the far disparity where nothing nearer than halfway was splatted."""
    horizon = (near + far) / 2 * PARTS
    return [
        colour
        for (i, j), at, colour in samples_at(views, present, y, x, far)
        if nearest[i, j, int(at[0] + 0.5), int(at[1] + 0.5)] <= horizon
    ]


def decide_edge(
    disparity: Array,
    levels: Array,
    present: Array | None,
    nearest: Array,
    threshold: Array,
    rule: EdgeRule,
    y: int,
    x: int,
) -> float:
    """The pixel's disparity after one pass; `levels` are views in 8-bit levels."""
    here = float(disparity[y, x])
    near, far = surfaces(disparity, y, x)
    image, channels = reference(levels), levels.shape[-1]
    behind = back_samples(levels, present, nearest, y, x, near, far)
    front = front_colour(disparity, image, y, x)
    if front is None or len(behind) < FEW_VIEWS:
        return here
    front_mean, front_variance = front
    back_mean = np.mean(behind, axis=0)
    # A normal spread's standard deviation is √(π/2) times its mean deviation.
    back_variance = float((np.pi / 2 * np.mean(np.abs(behind - back_mean), axis=0) ** 2).sum())
    apart = float(((front_mean - back_mean) ** 2).sum())
    if apart < SAME_COLOUR * channels:
        return here
    own = image[y, x].astype(np.float64)
    is_front = here > (near + far) / 2
    mine = [c for _, _, c in samples_at(levels, present, y, x, near)] if is_front else behind
    agree = [float(np.abs(c - own).sum()) < channels * 255 * float(threshold[y, x]) for c in mine]
    doubt = 1 + rule.inertia * (sum(agree) / max(len(agree), 1))
    least = rule.spread**2 * apart + 1
    to_back = float(((own - back_mean) ** 2).sum()) / (back_variance + least)
    to_front = float(((own - front_mean) ** 2).sum()) / (front_variance + least)
    if is_front:
        return far if to_back * doubt < to_front else here
    return near if to_front * doubt <= to_back else here


def edge_pixels(disparity: Array, rule: EdgeRule) -> Array:
    """Pixels beside a depth edge (H, W): a jump, which does not go on changing two pixels away."""
    found = np.zeros(disparity.shape, bool)
    for y, x in product(range(1, disparity.shape[0] - 1), range(1, disparity.shape[1] - 1)):
        near, far = surfaces(disparity, y, x)
        wide = disparity[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
        share = JUMP_SHARE * (float(wide.max()) - float(wide.min()))
        found[y, x] = near - far >= max(rule.jump, share)
    return found


def move_edges(disparity: Array, views: Array, rule: EdgeRule, present: Array | None = None) -> Array:
    """One pass over the depth edges."""
    levels = views.astype(np.float64) * (255 / full_scale(views))
    nearest, limits = splat(disparity, (views.shape[0], views.shape[1])), thresholds(views)
    out = disparity.copy()
    for y, x in np.argwhere(edge_pixels(disparity, rule)):
        out[y, x] = decide_edge(disparity, levels, present, nearest, limits, rule, int(y), int(x))
    return out


def settle(
    disparity: Array, views: Array, rule: EdgeRule, present: Array | None = None
) -> tuple[Array, Array]:
    """Median and passes over the edges: the map, and where an edge was found."""
    guide = reference(views) / full_scale(views)
    settled, _ = naive_photo.weighted_median(disparity, guide, *MEDIAN)
    found = np.zeros(disparity.shape, bool)
    for count in range(rule.passes):
        late = LATE if count >= SURE_PASSES else 1
        found |= edge_pixels(settled, rule)
        settled = move_edges(settled, views, replace(rule, inertia=late * rule.inertia), present)
    return settled, found


def trust(disparity: Array, at_edge: Array) -> Array:
    """Factor of the confidence: less at depth edges, and where the map changes fast within two pixels."""
    out = np.empty(disparity.shape)
    for y, x in np.ndindex(*disparity.shape):
        window = disparity[max(y - STEADY, 0) : y + STEADY + 1, max(x - STEADY, 0) : x + STEADY + 1]
        unsteady = float(window.max() - window.min()) / UNSTEADY
        out[y, x] = (EDGE_TRUST if at_edge[y, x] else 1) / np.sqrt(1 + unsteady**2)
    return out


# Noise


def residuals(views: Array, plane: Array, places: list[tuple[int, int]], present: Array | None) -> Array:
    """Least mean absolute difference over planes, pixel by pixel, fractions of full scale; inf where none."""
    out = []
    for y, x in places:
        own = reference(views)[y, x].astype(np.float64)
        by_plane = []
        for disparity in plane:
            colours = [c for _, _, c in samples_at(views, present, y, x, float(disparity))]
            by_plane.append(np.mean(np.abs(colours - own)) if colours else np.inf)
        out.append(min(by_plane))
    return np.array(out) / full_scale(views)


def residual(views: Array, plane: Array, present: Array | None = None) -> tuple[float, float]:
    """Low quantiles of the residuals on a regular grid of about so many pixels, every other plane."""
    height, width = views.shape[2:4]
    spacing = max(int(np.sqrt(height * width / SAMPLES)), 1)
    places = list(
        product(range(spacing // 2, height, spacing), range(spacing // 2, width, spacing)),
    )
    found = residuals(views, plane[::2], places, present)
    level, least = np.quantile(found[np.isfinite(found)], [RESIDUAL_QUANTILE, NOISE_QUANTILE])
    return float(level), float(least)


def texture_weight(views: Array, level: float, present: Array | None = None) -> Array:
    """Where the mean contrast over a window is above the residual level."""
    others = len(list(other_views(views, present)))
    change = naive_photo.local_thresholds(reference(views), TEXTURE_SLOPE, 1e-6, 0.5)
    level = max(level, 1e-6) * (GREY * (1 + FEW / max(others, 1)) if views.shape[-1] == 1 else 1)
    return ramp(naive.box_mean(change, CONTRAST_WINDOW) / level, *TEXTURE)


# Gloss


def suspects(views: Array, limits: Array, texture: Array, plane: Array, present: Array | None) -> Array:
    """Cells that are worth a look, by the views that any count looks at."""
    available = np.ones(views.shape[:2], bool) if present is None else present
    held = thinned(available, sparse=False) | naive_gloss.probed(available)
    return naive_gloss.suspects(views, limits, texture, plane, held)


# All of it


def estimate(
    views: Array, disparity_range: tuple[float, float], method: FbsVis, present: Array | None = None
) -> Decoded:
    """The whole method "fbs-vis", but for refinement."""
    assert method.step is not None
    plane = naive.planes(disparity_range, method.step)
    guide = naive.guide_image(views, method.guide)
    smooth = naive.GuidedFilter(guide, method.radius, method.epsilon)
    _, smoothed = naive.algorithm_1(
        views,
        plane,
        None,
        smooth,
        normalise=method.normalise,
        present=present,
        delta=method.delta,
        threshold=method.threshold,
        gradient=method.gradient,
    )
    rule = JointRule(
        photo_weight=method.photo_weight,
        slope_penalty=method.slope_penalty,
        jump_penalty=method.jump_penalty,
        fit_radius=method.fit_radius,
    )
    edge_rule = EdgeRule(passes=method.edge_passes)
    smooth = naive.GuidedFilter(guide, method.photo_radius, method.epsilon)
    level, noise_level = residual(views, plane, present)
    limits = thresholds(views, noise_level)
    stride = 2 if len(plane) >= 6 else 1
    some, more = voting(views, present, stride > 1), voting(views, present)
    share = np.stack([smooth(naive_photo.photo_consistency(views, d, limits, some)) for d in plane])
    first = decode(plane, smoothed, share, views, level, guide, rule, stride, present)
    rough, _ = settle(first.disparity, views, EdgeRule(passes=min(method.edge_passes, 1)), present)
    share = np.stack([smooth(visible_share(views, d, limits, rough, more)) for d in plane])
    glossy = np.zeros(guide.shape[:2], bool)
    if method.gloss and method.photo_weight > 0:
        cells = suspects(views, limits, texture_weight(views, level, present), plane, present)
        if cells.any():
            filtered = naive_gloss.high_passed(views)
            fine = np.stack([smooth(visible_share(filtered, d, limits, rough, more)) for d in plane])
            glossy = naive_gloss.glossy(kept(share), kept(fine), cells)
            share = np.where(glossy, fine, share)
    second = decode(plane, smoothed, share, views, level, guide, rule, 1, present, glossy)
    settled, found = settle(second.disparity, views, edge_rule, present)
    return Decoded(np.clip(settled, *disparity_range), trust(settled, found) * second.confidence)
