"""The oracle of photo-consistency votes, their thresholds and the weighted median, in plain NumPy.

It shares no code with `lfdepth.blocks`. Conventions it has to know to compare exactly: levels are whole parts
(1/UNIT) of an 8-bit level, shifts are rounded to 1/UNIT px, bilinear weights are whole parts of UNIT.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNIT = 128

Array = NDArray[Any]


def levels(views: Array) -> Array:
    """Whole parts of an 8-bit level, 0...255·UNIT."""
    white = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}[views.dtype.name]
    return np.asarray(np.rint(views.astype(np.float64) / white * 255 * UNIT), np.int64)


def sample(image: Array, shift_x: float, shift_y: float) -> Array:
    """The image at (x + shift_x, y + shift_y), coordinates clamped to the image, halves rounded up."""
    whole_x, part_x = divmod(int(np.rint(UNIT * shift_x)), UNIT)
    whole_y, part_y = divmod(int(np.rint(UNIT * shift_y)), UNIT)
    both = (2 * part_x * part_y + UNIT) // (2 * UNIT)
    weights = {(0, 1): part_x - both, (1, 0): part_y - both, (1, 1): both}
    weights[0, 0] = UNIT - sum(weights.values())
    total = np.zeros(image.shape, np.int64)
    for (dy, dx), weight in weights.items():
        rows = np.clip(np.arange(image.shape[0]) + whole_y + dy, 0, image.shape[0] - 1)
        columns = np.clip(np.arange(image.shape[1]) + whole_x + dx, 0, image.shape[1] - 1)
        total += weight * image[rows][:, columns]
    return np.asarray(np.floor(total / UNIT + 0.5), np.int64)


def photo_consistency(
    views: Array, disparity: float, thresholds: Array, present: Array | None = None
) -> Array:
    """Share of present views whose mean difference over channels to the reference view is below threshold."""
    rows, columns, height, width, channels = views.shape
    present = np.ones((rows, columns), bool) if present is None else present
    stack = levels(views)
    centre = stack[rows // 2, columns // 2]
    counted = np.zeros((height, width), np.int64)
    for i, j in np.argwhere(present):
        shifted = sample(stack[i, j], -(j - columns // 2) * disparity, -(i - rows // 2) * disparity)
        total = np.abs(shifted - centre).sum(axis=2)
        counted += total < thresholds.astype(np.float64) * (channels * 255 * UNIT)
    return np.asarray(counted.astype(np.float32) / np.float32(present.sum()), np.float32)


def local_thresholds(reference: Array, slope: float, low: float, high: float) -> Array:
    """Slope times the largest difference to a neighbour, pixel by pixel; fractions of full scale."""
    white = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}[reference.dtype.name]
    image = reference.astype(np.float64)
    height, width, channels = image.shape
    out = np.empty((height, width))
    for y, x in np.ndindex(height, width):
        largest = np.zeros(channels)
        for ny, nx in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if 0 <= ny < height and 0 <= nx < width:
                largest = np.maximum(largest, np.abs(image[ny, nx] - image[y, x]))
        out[y, x] = np.clip(slope * largest.sum() / (channels * white), low, high)
    return out


def weighted_median(
    values: Array,
    guide: Array,
    radius: int,
    sigma_colour: float,
    sigma_space: float,
    weight: Array | None = None,
    slack: float = 0.0,
) -> tuple[Array, Array]:
    """Lower weighted median in double precision: with half the total weight less, and more, `slack` of it.

    Where both are equal no rounding of weights by less than `slack` changes the median.
    """
    height, width = values.shape
    weight = np.ones((height, width)) if weight is None else weight.astype(np.float64)
    guide = guide.astype(np.float64)
    bounds = np.empty((2, height, width))
    for y, x in np.ndindex(height, width):
        window = [
            (y + dy, x + dx)
            for dy, dx in product(range(-radius, radius + 1), repeat=2)
            if 0 <= y + dy < height and 0 <= x + dx < width
        ]
        samples = []
        for qy, qx in window:
            colour = ((guide[qy, qx] - guide[y, x]) ** 2).sum() / (2 * sigma_colour**2)
            space = ((qy - y) ** 2 + (qx - x) ** 2) / (2 * sigma_space**2)
            samples.append((values[qy, qx], np.exp(-colour - space) * weight[qy, qx]))
        samples.sort()
        cumulated = np.cumsum([w for _, w in samples])
        for i, half in enumerate((0.5 - slack, 0.5 + slack)):
            bounds[i, y, x] = samples[int(np.argmax(cumulated >= half * cumulated[-1]))][0]
    return bounds[0], bounds[1]
