"""The oracle: equations 1-7 and algorithms 1-2 in plain NumPy, as the paper writes them.

Slow and simple; it shares no code with `lfdepth`. Two things are not the paper's but conventions of the
sweep that the oracle has to know to compare bit for bit: views are rounded to whole grey levels 0...LEVELS,
and shifts to 1/UNIT px with bilinear weights in whole parts of UNIT. Interpolated levels are therefore
whole numbers (in 1/UNIT of a level), and all signs and counts are exact.

Light fields are passed as views (V, U, H, W, C) and `present` (V, U); u and v count from (V // 2, U // 2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNIT = 32
LEVELS = 2040

Array = NDArray[Any]
Smooth = Callable[[Array], Array]


def full_scale(views: Array) -> float:
    return {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}[views.dtype.name]


def luma(views: Array) -> Array:
    """Rec. 601 luma, float64, in [0, 1]; (..., C) to (...)."""
    weights = [1.0] if views.shape[-1] == 1 else [0.299, 0.587, 0.114]
    return np.asarray(views.astype(np.float64) @ np.array(weights) / full_scale(views))


def levels(views: Array) -> Array:
    """Grey levels, whole numbers 0...LEVELS; (..., C) to (...) int64."""
    return np.asarray(np.rint(luma(views) * LEVELS), np.int64)


# Reparameterisation (eq. 1, algorithm 2)


def weights(shift_x: float, shift_y: float) -> tuple[int, int, dict[tuple[int, int], int]]:
    """Whole pixels (x, y) of a shift, and the weights, parts of UNIT, of the four neighbours (dy, dx)."""
    whole_x, part_x = divmod(int(np.rint(UNIT * shift_x)), UNIT)
    whole_y, part_y = divmod(int(np.rint(UNIT * shift_y)), UNIT)
    both = (part_x * part_y + UNIT // 2) // UNIT
    neighbours = {
        (0, 0): UNIT - part_x - part_y + both,
        (0, 1): part_x - both,
        (1, 0): part_y - both,
        (1, 1): both,
    }
    return whole_x, whole_y, neighbours


def sample(image: Array, shift_x: float, shift_y: float) -> Array:
    """UNIT times the image at (x + shift_x, y + shift_y), coordinates clamped to the image."""
    height, width = image.shape[:2]
    whole_x, whole_y, neighbours = weights(shift_x, shift_y)
    out: Array = np.zeros(image.shape, np.int64 if image.dtype.kind in "iub" else np.float64)
    for (dy, dx), weight in neighbours.items():
        rows = np.clip(np.arange(height) + whole_y + dy, 0, height - 1)
        columns = np.clip(np.arange(width) + whole_x + dx, 0, width - 1)
        out += weight * image[rows][:, columns].astype(out.dtype)
    return out


def offsets(count: int) -> range:
    """View indices as the paper counts them, from the reference view."""
    return range(-(count // 2), count - count // 2)


def reparameterise(views: Array, disparity: float) -> Array:
    """Eq. 1 with d = −D, times UNIT: L_D(x, y, u, v) = L_0(x − u·D, y − v·D, u, v)."""
    rows, columns = views.shape[:2]
    return np.stack(
        [
            np.stack(
                [sample(views[i, j], -u * disparity, -v * disparity) for j, u in enumerate(offsets(columns))]
            )
            for i, v in enumerate(offsets(rows))
        ]
    )


def mask_4d(mask: Array, delta: float, grid: tuple[int, int]) -> Array:
    """Algorithm 2, times UNIT: the mask in every view, reparameterised by the distance of two planes."""
    return reparameterise(np.broadcast_to(mask.astype(np.int64), (*grid, *mask.shape)), delta)


# Disparity signs and their vote (eq. 2-6)


def spatial_gradient(image: Array, operator: str) -> tuple[Array, Array]:
    """Gradient along x and y, up to a positive factor; the border repeats."""
    p = np.pad(image, 1, "edge")
    height, width = image.shape

    def at(dy: int, dx: int) -> Array:
        return p[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]

    if operator == "central":
        return at(0, 1) - at(0, -1), at(1, 0) - at(-1, 0)
    kernel = {-1: 1, 0: 2, 1: 1}
    along_x = sum(w * (at(i, 1) - at(i, -1)) for i, w in kernel.items())
    along_y = sum(w * (at(1, i) - at(-1, i)) for i, w in kernel.items())
    return np.asarray(along_x), np.asarray(along_y)


def angular_gradient(shifted: Array, present: Array, i: int, j: int) -> tuple[Array | None, Array | None]:
    """Gradient of view (i, j) along u and v, up to a positive factor; None along an axis without neighbour.

    Central difference; one-sided beside the grid's border and beside absent views.
    """

    def along(before: tuple[int, int], after: tuple[int, int]) -> Array | None:
        known = [
            view
            if min(view) >= 0 and view[0] < present.shape[0] and view[1] < present.shape[1] and present[view]
            else (i, j)
            for view in (before, after)
        ]
        return None if known[0] == known[1] else shifted[known[1]] - shifted[known[0]]

    return along((i, j - 1), (i, j + 1)), along((i - 1, j), (i + 1, j))


def view_signs(shifted: Array, present: Array, i: int, j: int, operator: str) -> tuple[Array, Array, int]:
    """S_xu, S_yv of a view (eq. 2, 3), and how many angular axes it has."""
    along_x, along_y = spatial_gradient(shifted[i, j], operator)
    along_u, along_v = angular_gradient(shifted, present, i, j)
    nothing = np.zeros_like(along_x)
    xu = nothing if along_u is None else np.sign(along_x * along_u)
    yv = nothing if along_v is None else np.sign(along_y * along_v)
    return xu, yv, (along_u is not None) + (along_v is not None)


def signs(
    views: Array, disparity: float, present: Array | None = None, operator: str = "central"
) -> tuple[Array, Array]:
    """S_xu and S_yv of all views (V, U, H, W); 0 for absent ones."""
    present = np.ones(views.shape[:2], bool) if present is None else present
    shifted = reparameterise(levels(views), disparity)
    xu, yv = np.zeros_like(shifted), np.zeros_like(shifted)
    for i, j in np.argwhere(present):
        xu[i, j], yv[i, j], _ = view_signs(shifted, present, i, j, operator)
    return xu, yv


def count(
    views: Array,
    disparity: float,
    *,
    present: Array | None = None,
    delta: str = "photo",
    threshold: float = 0.03,
    gradient: str = "central",
    foreground: Array | None = None,
    offset: float = 0.0,
) -> tuple[Array, Array, int]:
    """Numerator and denominator of eq. 4 and 5, times UNIT, and the denominator if every vote counted.

    `foreground` is BW of an earlier plane, `offset` the disparity of this plane minus that plane's. F is the
    foreground's 4-D mask; without a mask F = 0.
    """
    rows, columns, height, width = views.shape[:4]
    present = np.ones((rows, columns), bool) if present is None else present
    reference = np.zeros((height, width), bool) if foreground is None else foreground.astype(bool)
    masks = mask_4d(reference, offset, (rows, columns))
    shifted = reparameterise(levels(views), disparity)
    centre = shifted[rows // 2, columns // 2]
    total, weight = np.zeros((height, width), np.int64), np.zeros((height, width), np.int64)
    possible = 0
    for i, j in np.argwhere(present):
        xu, yv, axes = view_signs(shifted, present, i, j, gradient)
        counts = np.ones((height, width), bool)
        if delta == "photo":
            counts = np.abs(shifted[i, j] - centre) < threshold * LEVELS * UNIT
        if delta == "sign" and axes == 2:
            counts = xu == yv
        share = np.where(reference, masks[i, j], UNIT - masks[i, j]) * counts
        total += share * (xu + yv)
        weight += share * axes
        possible += axes
    return total, weight, possible * UNIT


def quotient(total: Array, weight: Array) -> Array:
    """Eq. 4-6 from their sums; no evidence is 0."""
    return np.asarray(np.where(weight > 0, total / np.where(weight > 0, weight, 1), 0.0))


def vote(views: Array, disparity: float, **options: Any) -> Array:
    """A slice of the initial volume (eq. 4-6); options as for `count`."""
    total, weight, _ = count(views, disparity, **options)
    return quotient(total, weight)


# Guided filter (He, Sun, Tang, TPAMI 2013)


def box_mean(image: Array, radius: int) -> Array:
    """Mean over windows cut at the border, value by value."""
    height, width = image.shape
    return np.array(
        [
            [
                image[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1].mean()
                for x in range(width)
            ]
            for y in range(height)
        ]
    )


class GuidedFilter:
    """Edge-preserving filter with guide (H, W, C), float64; the guide's statistics are kept."""

    def __init__(self, guide: Array, radius: int, epsilon: float) -> None:
        self.guide, self.radius = guide.astype(np.float64), radius
        channels = range(guide.shape[2])
        self.mean = self._means(self.guide)
        square = [[self._mean(self.guide[..., a] * self.guide[..., b]) for a in channels] for b in channels]
        covariance: Array = np.moveaxis(np.array(square), (0, 1), (2, 3))
        covariance -= self.mean[..., :, None] * self.mean[..., None, :]
        self.inverse = np.linalg.inv(covariance + epsilon * np.eye(guide.shape[2]))

    def __call__(self, image: Array) -> Array:
        image = image.astype(np.float64)
        mean = self._mean(image)
        covariance = self._means(self.guide * image[..., None]) - self.mean * mean[..., None]
        slope = np.einsum("yxab,yxb->yxa", self.inverse, covariance)
        intercept = mean - (slope * self.mean).sum(axis=-1)
        return np.asarray((self._means(slope) * self.guide).sum(axis=-1) + self._mean(intercept))

    def _mean(self, image: Array) -> Array:
        """`box_mean` by sums over shifted images, which is faster and as plain."""
        r, (height, width) = self.radius, image.shape
        total, count = np.zeros((height, width)), np.zeros((height, width))
        padded, ones = np.pad(image, r), np.pad(np.ones_like(image), r)
        for dy in range(2 * r + 1):
            for dx in range(2 * r + 1):
                total += padded[dy : dy + height, dx : dx + width]
                count += ones[dy : dy + height, dx : dx + width]
        return total / count

    def _means(self, images: Array) -> Array:
        return np.stack([self._mean(images[..., c]) for c in range(images.shape[2])], axis=-1)


def guide_image(views: Array, kind: str) -> Array:
    """The reference view in [0, 1]: its channels for "colour", its grey levels for "grey"."""
    reference = views[views.shape[0] // 2, views.shape[1] // 2]
    if kind == "colour":
        return np.asarray(reference.astype(np.float64) / full_scale(views))
    return np.asarray(levels(reference)[..., None] / LEVELS)


# From profile to disparity


def planes(disparity_range: tuple[float, float], step: float) -> Array:
    """Front to back, from the upper end to the first plane at or below the lower end."""
    low, high = disparity_range
    found = [high]
    while found[-1] > low + 1e-9 * step and len(found) < 10_000:
        found.append(high - step * len(found))
    return np.array(found)


def accumulate(volume: Array, plane: Array) -> Array:
    """FBS: D_min + step·(Σ BW − ½), within the planes."""
    count = (volume > 0).sum(axis=0)
    disparity = plane[-1] + (plane[0] - plane[1]) * (count - 0.5)
    return np.asarray(np.clip(disparity, plane[-1], plane[0]))


def step_errors(profile: Array) -> Array:
    """L1 distances of a profile (K,) to the steps that turn from −1 to +1 before plane 0, 1, ... K."""
    count = len(profile)
    steps = [np.where(np.arange(count) < turn, -1.0, 1.0) for turn in range(count + 1)]
    return np.array([np.abs(profile - step).sum() for step in steps])


def running_sums(profile: Array) -> Array:
    """Sums of the first 0, 1, ... K values of a profile (K,)."""
    return np.array([profile[:count].sum() for count in range(len(profile) + 1)])


def sign_step(volume: Array, plane: Array, subplane: bool = True) -> Array:
    """Sign function approximation, pixel by pixel: the first minimum of the sum front to back.

    Between the last plane in front of the surface and the first behind it, the disparity is where the line
    through their values crosses zero, or halfway; beyond the planes it is the end of the range.
    """
    step = plane[0] - plane[1]
    out = np.zeros(volume.shape[1:])
    for y, x in np.ndindex(*out.shape):
        profile = volume[:, y, x].astype(np.float64)
        turn = int(np.argmin(running_sums(profile)))
        if turn in (0, len(plane)):
            out[y, x] = plane[0] if turn == 0 else plane[-1]
            continue
        before, after = profile[turn - 1], profile[turn]
        part = before / (before - after) if subplane else 0.5
        out[y, x] = plane[turn - 1] - step * part
    return out


def confidence(volume: Array) -> Array:
    """How well one step fits, (Σ C̃ − 2·min Σ_{k≤c} C̃_k)/K: 1 for a perfect step, 0 without evidence."""
    running = np.concatenate([np.zeros((1, *volume.shape[1:])), np.cumsum(volume.astype(np.float64), axis=0)])
    return np.asarray(np.clip((running[-1] - 2 * running.min(axis=0)) / len(volume), 0, 1))


# Algorithm 1


def normalised(smooth: Smooth, total: Array, weight: Array) -> Array:
    """Not the paper's: sums and evidence, both at most 1, smoothed apart and divided, within [−1, 1].

    The filter overshoots, so a small denominator is kept off zero.
    """
    return np.asarray(np.clip(smooth(total) / np.maximum(smooth(weight), 1e-3), -1, 1))


def algorithm_1(
    views: Array,
    plane: Array,
    skip: int | None,
    smooth: Smooth,
    *,
    normalise: bool = False,
    **rule: Any,
) -> tuple[Array, Array]:
    """Initial and smoothed volume (K, H, W), chain by chain as the paper writes it.

    `skip` is J; None is the sweep without an occlusion rule (FBS, FBS-SFA), in which F stays 0. `smooth` is
    the guided filter; `rule` the options of `count`.
    """
    planes_in_all, size = len(plane), views.shape[2:4]
    initial, smoothed = np.zeros((planes_in_all, *size)), np.zeros((planes_in_all, *size))
    for first in range(skip or 1):
        k, foreground = first, None
        while k < planes_in_all:
            offset = 0.0 if skip is None else -skip * (plane[0] - plane[1])
            total, weight, possible = count(views, plane[k], foreground=foreground, offset=offset, **rule)
            initial[k] = quotient(total, weight)
            smoothed[k] = (
                normalised(smooth, total / possible, weight / possible) if normalise else smooth(initial[k])
            )
            foreground = None if skip is None else smoothed[k] > 0
            k += skip or 1
    return initial, smoothed


def estimate(
    views: Array,
    disparity_range: tuple[float, float],
    *,
    occlusion: bool,
    decoder: str,
    step: float,
    skip: int,
    radius: int,
    epsilon: float,
    guide: str = "colour",
    subplane: bool = True,
    **options: Any,
) -> tuple[Array, Array]:
    """The whole method: disparity (H, W), limited to the range, and the smoothed volume (K, H, W)."""
    plane = planes(disparity_range, step)
    smooth = GuidedFilter(guide_image(views, guide), radius, epsilon)
    _, smoothed = algorithm_1(views, plane, skip if occlusion else None, smooth, **options)
    found = accumulate(smoothed, plane) if decoder == "accumulate" else sign_step(smoothed, plane, subplane)
    return np.clip(found, *disparity_range), smoothed
