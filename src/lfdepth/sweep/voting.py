"""Disparity signs and their vote (eq. 2-6).

Where the product of a spatial and an angular gradient of the reparameterised light field is positive the
surface lies in front of the plane, where it is negative behind. Only signs enter, so the kernels compare
interpolated levels and count.

Layout of the work: a band of rows is swept top to bottom with three interpolated rows of every view in a
ring (a few hundred kilobytes, so it stays in the second-level cache), and a row of votes is counted from
them. Away from the occlusion mask's edges every view's mask equals the reference pixel's, the mask drops
out of eq. 4 and 5, and the plain count applies; only blocks of a row that the edge crosses pay for the masked one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numba as nb
import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.sweep.parallel import Workers
from lfdepth.sweep.reparam import (
    PAD,
    UNIT,
    ViewStack,
    interpolate_row,
    round_width,
    shifts,
    stack_views,
)

Delta = Literal["photo", "sign", "none"]
Gradient = Literal["central", "sobel"]

DELTAS: tuple[Delta, ...] = ("photo", "sign", "none")
GRADIENTS: tuple[Gradient, ...] = ("central", "sobel")

BLOCK = 32
"""Columns that share the decision between the plain and the masked count."""

_ONE = np.uintp(1)


@dataclass(frozen=True)
class VoteRule:
    """Which votes count.

    Parameters
    ----------
    delta
        The relaxed Lambertian indicator δ of eq. 4-5: "photo" keeps views whose level differs from the
        reference view's by less than `threshold`; "sign" keeps views whose two signs agree; "none" keeps all.
    threshold
        For "photo", as a fraction of full scale, in (0, 1] (τ).
    gradient
        Spatial gradient: "central" differences or 3×3 "sobel". Angular gradients are central differences,
        one-sided at the outermost views and beside absent ones.

    Raises
    ------
    LightFieldError
        For an unknown name or a threshold outside (0, 1].
    """

    delta: Delta = "photo"
    threshold: float = 0.03
    gradient: Gradient = "central"

    def __post_init__(self) -> None:
        if self.delta not in DELTAS:
            raise LightFieldError(f"delta: found {self.delta!r}, expected one of {', '.join(DELTAS)}")
        if self.gradient not in GRADIENTS:
            raise LightFieldError(
                f"gradient: found {self.gradient!r}, expected one of {', '.join(GRADIENTS)}"
            )
        if not 0 < self.threshold <= 1:
            raise LightFieldError(
                f"threshold: found {self.threshold}, expected a fraction of full scale in (0, 1] such as 0.03"
            )


@dataclass(frozen=True, eq=False)
class Mask:
    """A foreground map of the reference view, to be carried to another plane for every view (eq. 7).

    Parameters
    ----------
    foreground
        (H, W) bool: `BW` at the plane where it was found.
    offset
        Disparity of the plane that is voted on, minus that of the plane where the map was found, in px per
        view step (−J·step in the paper's scheme, front to back).
    """

    foreground: NDArray[np.bool_]
    offset: float


def disparity_signs(
    lf: LightField, disparity: float, *, gradient: Gradient = "central"
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Signs `S_xu` and `S_yv` of every view's pixels at one plane (eq. 2 and 3).

    Parameters
    ----------
    lf
        Light field with V, U views.
    disparity
        Plane in px per view step.
    gradient
        Spatial gradient operator, "central" or "sobel".

    Returns
    -------
    Two (V, U, H, W) int8 arrays: +1 nearer than the plane, −1 farther, 0 no evidence.
    """
    stack = stack_views(lf, disparity)
    shape = (*stack.grid, *stack.size)
    signs_xu, signs_yv = np.zeros(shape, np.int8), np.zeros(shape, np.int8)
    rule = VoteRule(delta="none", gradient=gradient)
    _sign_kernel(signs_xu, signs_yv, *_plane_arguments(stack, disparity, rule))
    return signs_xu, signs_yv


def vote(
    lf: LightField,
    disparity: float,
    *,
    rule: VoteRule | None = None,
    mask: Mask | None = None,
    threads: int | None = 1,
) -> NDArray[np.float32]:
    """Vote of all views on one plane: a slice of the initial volume (eq. 4-6).

    Parameters
    ----------
    lf
        Light field.
    disparity
        Plane in px per view step.
    rule
        Which votes count; default `VoteRule()`.
    mask
        Foreground found at an earlier plane. Pixels inside are voted on by views that see foreground, the
        others by views that do not; None votes with all views.
    threads
        Number of threads.

    Returns
    -------
    (H, W) float32 in [−1, 1]: positive where the surface is nearer than the plane; 0 without evidence.

    Raises
    ------
    LightFieldError
        If the mask has another size than the views.
    """
    stack = stack_views(lf, disparity)
    out = np.zeros(stack.size, np.float32)
    with Workers(threads) as workers:
        vote_plane(stack, disparity, rule or VoteRule(), mask, workers, out)
    return out


def vote_plane(
    stack: ViewStack,
    disparity: float,
    rule: VoteRule,
    mask: Mask | None,
    workers: Workers,
    out: NDArray[np.float32],
) -> None:
    """Vote on one plane into `out`; what an engine for other hardware replaces."""
    height, width = stack.size
    arguments = _plane_arguments(stack, disparity, rule)
    if mask is None:
        workers.rows(height, _plain_kernel, out, *arguments)
        return
    if mask.foreground.shape != stack.size:
        raise LightFieldError(
            f"mask: found shape {mask.foreground.shape}, expected {stack.size} like the views; resize the mask"
        )
    plane = shifts(stack.grid, mask.offset)
    reach = plane.reach
    border = ((reach, reach), (reach, reach + round_width(width) - width))
    padded = np.pad(mask.foreground.astype(np.uint8), border, "edge")
    workers.rows(
        height,
        _masked_kernel,
        out,
        padded,
        reach,
        plane.down,
        plane.across,
        plane.weights.astype(np.int16),
        *arguments,
    )


def _plane_arguments(stack: ViewStack, disparity: float, rule: VoteRule) -> tuple[Any, ...]:
    """The arguments that all kernels share, in their order."""
    level = np.int16 if stack.data.dtype == np.uint8 else np.float32
    # The bounds lo < level < hi of "photo" are kept inside the levels' type: all of full scale fits.
    tolerance = (
        rule.threshold * stack.full_scale * UNIT if rule.delta == "photo" else stack.full_scale * UNIT + 1
    )
    plane = shifts(stack.grid, disparity)
    return (
        stack.data,
        (stack.grid[0], stack.grid[1], stack.size[0], stack.size[1], stack.row_length, stack.margin),
        plane.down,
        plane.across,
        plane.weights.astype(level),
        stack.present,
        float(tolerance),
        rule.delta == "sign",
        rule.gradient == "sobel",
    )


@nb.njit(nogil=True, cache=True)
def _fill_ring(ring, row, data, shape, down, across, weights, present):  # type: ignore[no-untyped-def]
    """Interpolate image row `row` (clamped to the image) of every view into its slot of the ring."""
    rows, columns, height, width, row_length, margin = shape
    length = (width + 31) // 32 * 32 + 2 * PAD
    slot = row % 3
    row = min(max(row, 0), height - 1)
    for v in range(rows):
        upper = min(max(row + down[v], 0), height - 1)
        lower = min(max(row + down[v] + 1, 0), height - 1)
        for u in range(columns):
            if not present[v, u]:
                continue
            base = (v * columns + u) * height
            column = margin - PAD + across[u]
            interpolate_row(
                ring,
                np.uintp(((slot * rows + v) * columns + u) * length),
                data,
                np.uintp((base + upper) * row_length + column),
                np.uintp((base + lower) * row_length + column),
                length,
                weights[v, u, 0],
                weights[v, u, 1],
                weights[v, u, 2],
                weights[v, u, 3],
            )
            # Beyond the image its last columns repeat, also for the spatial gradient.
            _repeat_border(ring, np.uintp(((slot * rows + v) * columns + u) * length + PAD), width)


@nb.njit(nogil=True, cache=True, inline="always")
def _repeat_border(ring, start, width):  # type: ignore[no-untyped-def]
    ring[start - _ONE] = ring[start]
    ring[start + np.uintp(width)] = ring[start + np.uintp(width - 1)]


@nb.njit(nogil=True, cache=True)
def _neighbours(v, u, present):  # type: ignore[no-untyped-def]
    """View indices (u−, u+, v−, v+) for angular differences, and the number of axes that have one."""
    rows, columns = present.shape
    left = u - 1 if u > 0 and present[v, u - 1] else u
    right = u + 1 if u + 1 < columns and present[v, u + 1] else u
    above = v - 1 if v > 0 and present[v - 1, u] else v
    below = v + 1 if v + 1 < rows and present[v + 1, u] else v
    return left, right, above, below, int(left != right) + int(above != below)


@nb.njit(nogil=True, cache=True)
def _row_offsets(row, v, u, present, length):  # type: ignore[no-untyped-def]
    """Ring offsets of the rows that one view's votes need, and the number of its angular axes."""
    rows, columns = present.shape
    left, right, above, below, axes = _neighbours(v, u, present)
    slot, previous, following = row % 3, (row - 1) % 3, (row + 1) % 3
    return (
        np.uintp(((slot * rows + v) * columns + u) * length + PAD),
        np.uintp(((previous * rows + v) * columns + u) * length + PAD),
        np.uintp(((following * rows + v) * columns + u) * length + PAD),
        np.uintp(((slot * rows + v) * columns + left) * length + PAD),
        np.uintp(((slot * rows + v) * columns + right) * length + PAD),
        np.uintp(((slot * rows + above) * columns + u) * length + PAD),
        np.uintp(((slot * rows + below) * columns + u) * length + PAD),
        axes,
    )


@nb.njit(nogil=True, cache=True)
def _count_plain(votes, weight, ring, offsets, lo, hi, first, last):  # type: ignore[no-untyped-def]
    """Add one view's central-difference votes to columns [first, last)."""
    here, above, below, left, right, up, down, axes = offsets
    one, axes16 = np.int16(1), np.int16(axes)
    for x in range(np.uintp(first), np.uintp(last)):
        east, west = ring[here + x + _ONE], ring[here + x - _ONE]
        inside = (ring[here + x] > lo[x]) & (ring[here + x] < hi[x])
        # Two booleans per gradient instead of a sign: comparisons are all that narrow integers need.
        x_up, x_down = (east > west) & inside, (east < west) & inside
        y_up = (ring[below + x] > ring[above + x]) & inside
        y_down = (ring[below + x] < ring[above + x]) & inside
        u_up, u_down = ring[right + x] > ring[left + x], ring[right + x] < ring[left + x]
        v_up, v_down = ring[down + x] > ring[up + x], ring[down + x] < ring[up + x]
        total = votes[x]
        total = np.int16(total + one) if (x_up & u_up) | (x_down & u_down) else total
        total = np.int16(total - one) if (x_up & u_down) | (x_down & u_up) else total
        total = np.int16(total + one) if (y_up & v_up) | (y_down & v_down) else total
        total = np.int16(total - one) if (y_up & v_down) | (y_down & v_up) else total
        votes[x] = total
        weight[x] = np.int16(weight[x] + axes16) if inside else weight[x]


@nb.njit(nogil=True, cache=True, inline="always")
def _sign(a, b):  # type: ignore[no-untyped-def]
    return np.int32(a > b) - np.int32(a < b)


@nb.njit(nogil=True, cache=True)
def _view_signs(xu, yv, ring, offsets, sobel, first, last):  # type: ignore[no-untyped-def]
    """One view's signs S_xu, S_yv for columns [first, last), with either spatial gradient."""
    here, above, below, left, right, up, down, _ = offsets
    for x in range(np.uintp(first), np.uintp(last)):
        east, west = np.int64(ring[here + x + _ONE]), np.int64(ring[here + x - _ONE])
        south, north = np.int64(ring[below + x]), np.int64(ring[above + x])
        if sobel:
            # Grey levels times weights are whole numbers, so 64-bit sums are exact for both level types.
            ne, nw = np.int64(ring[above + x + _ONE]), np.int64(ring[above + x - _ONE])
            se, sw = np.int64(ring[below + x + _ONE]), np.int64(ring[below + x - _ONE])
            east, west = 2 * east + ne + se, 2 * west + nw + sw
            south, north = 2 * south + se + sw, 2 * north + ne + nw
        xu[x] = np.int8(_sign(east, west) * _sign(ring[right + x], ring[left + x]))
        yv[x] = np.int8(_sign(south, north) * _sign(ring[down + x], ring[up + x]))


@nb.njit(nogil=True, cache=True)
def _count_weighted(votes, weight, xu, yv, ring, offsets, lo, hi, signs_agree, share, first, last):  # type: ignore[no-untyped-def]
    """Add one view's votes, each times `share` (0...128), for columns [first, last)."""
    here, axes = offsets[0], offsets[7]
    for x in range(np.uintp(first), np.uintp(last)):
        inside = (ring[here + x] > lo[x]) & (ring[here + x] < hi[x])
        if signs_agree and axes == 2:
            inside &= xu[x] == yv[x]
        part = np.int32(share[x]) if inside else np.int32(0)
        votes[x] += part * np.int32(xu[x] + yv[x])
        weight[x] += part * np.int32(axes)


@nb.njit(nogil=True, cache=True)
def _photo_bounds(lo, hi, ring, start, tolerance, limit):  # type: ignore[no-untyped-def]
    """Levels around the reference view's row that "photo" accepts, cut to what the level type can hold."""
    for x in range(lo.size):
        level = float(ring[start + np.uintp(x)])
        lo[x] = lo.dtype.type(max(level - tolerance, -1.0))
        hi[x] = hi.dtype.type(min(level + tolerance, limit))


@nb.njit(nogil=True, cache=True)
def _photo_limits(data, tolerance):  # type: ignore[no-untyped-def]
    # Levels are whole numbers: |difference| < τ is |difference| < ceil(τ).
    full = 255.0 if data.dtype == np.dtype(np.uint8) else 65535.0
    return np.ceil(tolerance), full * UNIT + 1.0


@nb.njit(nogil=True, cache=True)
def _quotient(out, votes, weight):  # type: ignore[no-untyped-def]
    for x in range(out.size):
        out[x] = np.float32(votes[x]) / np.float32(weight[x]) if weight[x] > 0 else np.float32(0)


@nb.njit(nogil=True, cache=True)
def _plain_kernel(
    first_row, last_row, out, data, shape, down, across, weights, present, tolerance, signs_agree, sobel
):  # type: ignore[no-untyped-def]
    """Votes without a mask for rows [first_row, last_row)."""
    rows, columns, height, width, row_length, margin = shape
    length = (width + 31) // 32 * 32 + 2 * PAD
    ring = np.empty(3 * rows * columns * length, weights.dtype)
    lo, hi = np.empty(length, weights.dtype), np.empty(length, weights.dtype)
    tolerance, limit = _photo_limits(data, tolerance)
    votes, weight = np.empty(length - 2 * PAD, np.int16), np.empty(length - 2 * PAD, np.int16)
    votes32, weight32 = np.empty(length - 2 * PAD, np.int32), np.empty(length - 2 * PAD, np.int32)
    xu, yv = np.empty(length, np.int8), np.empty(length, np.int8)
    share = np.full(length, UNIT, np.int16)
    centre = np.uintp((rows // 2 * columns + columns // 2) * length + PAD)
    slot_size = rows * columns * length
    _fill_ring(ring, first_row - 1, data, shape, down, across, weights, present)
    _fill_ring(ring, first_row, data, shape, down, across, weights, present)
    for y in range(first_row, last_row):
        _fill_ring(ring, y + 1, data, shape, down, across, weights, present)
        _photo_bounds(
            lo[: votes.size], hi[: votes.size], ring, centre + np.uintp(y % 3 * slot_size), tolerance, limit
        )
        if sobel or signs_agree:
            votes32[:] = 0
            weight32[:] = 0
            _count_row_weighted(
                votes32,
                weight32,
                xu,
                yv,
                ring,
                y,
                present,
                length,
                lo,
                hi,
                signs_agree,
                sobel,
                share,
                0,
                votes.size,
            )
            _quotient(out[y], votes32, weight32)
        else:
            votes[:] = 0
            weight[:] = 0
            _count_row_plain(votes, weight, ring, y, present, length, lo, hi, 0, votes.size)
            _quotient(out[y], votes, weight)


@nb.njit(nogil=True, cache=True)
def _count_row_plain(votes, weight, ring, y, present, length, lo, hi, first, last):  # type: ignore[no-untyped-def]
    rows, columns = present.shape
    for v in range(rows):
        for u in range(columns):
            if present[v, u]:
                offsets = _row_offsets(y, v, u, present, length)
                _count_plain(votes, weight, ring, offsets, lo, hi, first, last)


@nb.njit(nogil=True, cache=True)
def _count_row_weighted(
    votes, weight, xu, yv, ring, y, present, length, lo, hi, signs_agree, sobel, share, first, last
):  # type: ignore[no-untyped-def]
    rows, columns = present.shape
    for v in range(rows):
        for u in range(columns):
            if present[v, u]:
                offsets = _row_offsets(y, v, u, present, length)
                _view_signs(xu, yv, ring, offsets, sobel, first, last)
                _count_weighted(votes, weight, xu, yv, ring, offsets, lo, hi, signs_agree, share, first, last)


@nb.njit(nogil=True, cache=True)
def _is_mixed(mask, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """Whether a window of the padded mask holds both foreground and background."""
    value = mask[top, left]
    for y in range(top, bottom):
        for x in range(left, right):
            if mask[y, x] != value:
                return True
    return False


@nb.njit(nogil=True, cache=True)
def _mask_share(share, mask, reach, mask_row, mask_column, y, weights, first, last):  # type: ignore[no-untyped-def]
    """Weight of one view's votes (eq. 4-5): its mask where the reference is foreground, else the rest of 128."""
    w00, w01, w10, w11 = weights[0], weights[1], weights[2], weights[3]
    top = mask_row + reach
    for x in range(first, last):
        left = x + reach + mask_column
        foreground = np.int16(
            mask[top, left] * w00
            + mask[top, left + 1] * w01
            + mask[top + 1, left] * w10
            + mask[top + 1, left + 1] * w11
        )
        share[x] = foreground if mask[y + reach, x + reach] else np.int16(UNIT - foreground)


@nb.njit(nogil=True, cache=True)
def _masked_kernel(
    first_row,
    last_row,
    out,
    mask,
    reach,
    mask_down,
    mask_across,
    mask_weights,
    data,
    shape,
    down,
    across,
    weights,
    present,
    tolerance,
    signs_agree,
    sobel,
):  # type: ignore[no-untyped-def]
    """Votes with the 4-D foreground mask carried from an earlier plane, for rows [first_row, last_row)."""
    rows, columns, height, width, row_length, margin = shape
    length = (width + 31) // 32 * 32 + 2 * PAD
    inner = length - 2 * PAD
    ring = np.empty(3 * rows * columns * length, weights.dtype)
    lo, hi = np.empty(length, weights.dtype), np.empty(length, weights.dtype)
    tolerance, limit = _photo_limits(data, tolerance)
    votes, weight = np.empty(inner, np.int16), np.empty(inner, np.int16)
    votes32, weight32 = np.empty(inner, np.int32), np.empty(inner, np.int32)
    xu, yv = np.empty(length, np.int8), np.empty(length, np.int8)
    share = np.empty(length, np.int16)
    centre = np.uintp((rows // 2 * columns + columns // 2) * length + PAD)
    slot_size = rows * columns * length
    _fill_ring(ring, first_row - 1, data, shape, down, across, weights, present)
    _fill_ring(ring, first_row, data, shape, down, across, weights, present)
    for y in range(first_row, last_row):
        _fill_ring(ring, y + 1, data, shape, down, across, weights, present)
        _photo_bounds(lo[:inner], hi[:inner], ring, centre + np.uintp(y % 3 * slot_size), tolerance, limit)
        first = 0
        while first < inner:
            mixed = sobel or signs_agree or _block_is_mixed(mask, reach, y, first)
            last = first + BLOCK
            # Neighbouring blocks of one kind are counted together: long loops suit the vector units.
            while last < inner and (sobel or signs_agree or _block_is_mixed(mask, reach, y, last)) == mixed:
                last += BLOCK
            if mixed:
                votes32[first:last] = 0
                weight32[first:last] = 0
                for v in range(rows):
                    for u in range(columns):
                        if not present[v, u]:
                            continue
                        offsets = _row_offsets(y, v, u, present, length)
                        _mask_share(
                            share,
                            mask,
                            reach,
                            y + mask_down[v],
                            mask_across[u],
                            y,
                            mask_weights[v, u],
                            first,
                            last,
                        )
                        _view_signs(xu, yv, ring, offsets, sobel, first, last)
                        _count_weighted(
                            votes32, weight32, xu, yv, ring, offsets, lo, hi, signs_agree, share, first, last
                        )
                end = min(last, width)
                _quotient(out[y, first:end], votes32[first:end], weight32[first:end])
            else:
                votes[first:last] = 0
                weight[first:last] = 0
                _count_row_plain(votes, weight, ring, y, present, length, lo, hi, first, last)
                end = min(last, width)
                _quotient(out[y, first:end], votes[first:end], weight[first:end])
            first = last


@nb.njit(nogil=True, cache=True)
def _block_is_mixed(mask, reach, y, first):  # type: ignore[no-untyped-def]
    return _is_mixed(mask, y, y + 2 * reach + 1, first, first + BLOCK + 2 * reach)


@nb.njit(nogil=True, cache=True)
def _sign_kernel(
    signs_xu, signs_yv, data, shape, down, across, weights, present, tolerance, signs_agree, sobel
):  # type: ignore[no-untyped-def]
    """All views' signs, row by row."""
    rows, columns, height, width, row_length, margin = shape
    length = (width + 31) // 32 * 32 + 2 * PAD
    ring = np.empty(3 * rows * columns * length, weights.dtype)
    _fill_ring(ring, -1, data, shape, down, across, weights, present)
    _fill_ring(ring, 0, data, shape, down, across, weights, present)
    for y in range(height):
        _fill_ring(ring, y + 1, data, shape, down, across, weights, present)
        for v in range(rows):
            for u in range(columns):
                if present[v, u]:
                    offsets = _row_offsets(y, v, u, present, length)
                    _view_signs(signs_xu[v, u, y], signs_yv[v, u, y], ring, offsets, sobel, 0, width)
