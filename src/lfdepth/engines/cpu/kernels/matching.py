"""Row kernels of `lfdepth.probe.matching`."""

# numba ships no types for its decorators
# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Map = npt.NDArray[np.float32]
Index = npt.NDArray[np.int32]
Offsets = npt.NDArray[np.float64]


@njit(cache=True, nogil=True)
def difference_kernel(
    first: int,
    last: int,
    sums: Map,
    reference: Map,
    views: Map,
    down: Offsets,
    across: Offsets,
    sides: Index,
    margin: int,
    limit: float,
) -> None:
    """Per aperture, the sum over its views of |view − reference view|, each at most `limit`.

    `sums` is (H, A, W), so that a row of all apertures lies side by side: all views, and with A = 5 also
    those not to the right of the reference view, not to its left, not below it, not above it. `down` and
    `across` say where view i is sampled relative to the pixel; `sides` (N, 2) is where it lies in the grid.
    """
    height, apertures, width = sums.shape
    one, most = np.float32(1), np.float32(limit)
    difference = np.empty(width, np.float32)
    for y in range(first, last):
        sums[y] = 0
        total, here = sums[y, 0], reference[y]
        for i in range(views.shape[0]):
            whole_y, whole_x = np.floor(down[i]), np.floor(across[i])
            part_y, part_x = np.float32(down[i] - whole_y), np.float32(across[i] - whole_x)
            y0 = min(max(y + int(whole_y), 0), height - 1)
            y1 = min(max(y + int(whole_y) + 1, 0), height - 1)
            x0 = margin + int(whole_x)
            w00, w01 = (one - part_y) * (one - part_x), (one - part_y) * part_x
            w10, w11 = part_y * (one - part_x), part_y * part_x
            # slices, so that no index can be negative: else the loop would not be vectorised
            upper, lower = views[i, y0, x0 : x0 + width + 1], views[i, y1, x0 : x0 + width + 1]
            for x in range(width):
                sample = w00 * upper[x] + w01 * upper[x + 1] + w10 * lower[x] + w11 * lower[x + 1]
                apart = abs(sample - here[x])
                difference[x] = apart if apart < most else most
            for x in range(width):
                total[x] += difference[x]
            if apertures > 1:
                for axis in range(2):
                    if sides[i, axis] != 0:  # first those on one side, turned into all others below
                        side = sums[y, 3 - 2 * axis + (sides[i, axis] < 0)]
                        for x in range(width):
                            side[x] += difference[x]
        for aperture in range(1, apertures):
            for x in range(width):
                sums[y, aperture, x] = total[x] - sums[y, aperture, x]


@njit(cache=True, nogil=True)
def compare_kernel(
    first: int,
    last: int,
    sums: Map,
    weights: Map,
    penalty: Map,
    plane: int,
    apart: int,
    recent: Map,
    farther: Map,
    best: Index,
    costs: Map,
) -> None:
    """Cost of a plane per pixel, and whether it is the best so far.

    The cost is that of the best aperture: its mean difference over 3×3 px (`weights` are one over the number
    of samples), plus `penalty`. `costs` (4, H, W) holds the smallest cost, the costs of the planes before and
    after it, and the smallest among planes more than `apart` away from it (the runner-up). `recent` holds
    the costs of the last `apart + 1` planes, and `farther` the smallest of the planes before those.
    """
    height, width = best.shape
    slots = recent.shape[0]
    cost, rows = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(first, last):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for aperture in range(weights.shape[0]):
            a, b, c = sums[up, aperture], sums[y, aperture], sums[down, aperture]
            for x in range(width):
                rows[x] = a[x] + b[x] + c[x]
            weight, extra = weights[aperture], penalty[aperture]
            for x in range(width):
                mean = (rows[max(x - 1, 0)] + rows[x] + rows[min(x + 1, width - 1)]) * weight + extra
                if aperture == 0 or mean < cost[x]:
                    cost[x] = mean
        oldest, previous = recent[plane % slots, y], recent[(plane - 1) % slots, y]
        for x in range(width):
            if plane >= slots and oldest[x] < farther[y, x]:
                farther[y, x] = oldest[x]
            value, since = cost[x], plane - best[y, x]
            if value < costs[0, y, x]:
                best[y, x] = plane
                costs[0, y, x], costs[1, y, x] = value, previous[x] if plane else value
                costs[2, y, x], costs[3, y, x] = value, farther[y, x]
            elif since == 1:
                costs[2, y, x] = value
            elif since > apart and value < costs[3, y, x]:
                costs[3, y, x] = value
            oldest[x] = value
