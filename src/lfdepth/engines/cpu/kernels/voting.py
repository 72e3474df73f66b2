"""Row kernels of the disparity sign vote.

A band of rows is swept top to bottom with three interpolated rows of every view in a ring (a few hundred
kilobytes, so it stays in the second-level cache); a row of votes is counted from them. Offsets are flat and
unsigned and levels 16 bits wide throughout: slicing would cost more than a row's arithmetic, signed
offsets a test for negative ones, and wider types half the lanes of a vector.

Away from the occlusion mask's edges every view's mask equals the reference pixel's, drops out of eq. 4
and 5, and the plain count applies. Only blocks of a row that an edge crosses pay for the masked one.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from lfdepth.engines.cpu.compilation import INNER, KERNEL
from lfdepth.engines.cpu.layout import PAD
from lfdepth.engines.layout import GREY_UNIT as UNIT

BLOCK = 32
"""Columns that share the decision between the plain and the masked count."""

_GAP = 2
"""Blocks of plain count between masked ones that are not worth loops of their own."""

_ONE = np.uintp(1)
_LOWEST, _HIGHEST = -32768, 32767


_LINE = 32
"""Values of a cache line."""


@intrinsic
def _prefetch(_context, array, index):
    """Ask for the cache line of `array[index]`; any index will do."""

    def generate(context, builder, signature, arguments):
        data = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data
        address = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [address.type, number, number, number])
        hint = builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
        # For reading, into the second-level cache, data.
        builder.call(hint, [address, number(0), number(2), number(1)])
        return context.get_dummy_value()

    return types.void(array, index), generate


@nb.njit(**KERNEL)
def row_length(width):
    """Length of a row in the ring: the image's width in whole blocks, and a pad on both sides."""
    return (width + BLOCK - 1) // BLOCK * BLOCK + 2 * PAD


@nb.njit(**KERNEL)
def fill_ring(ring, row, data, shape, down, across, weights, present, ahead):
    """Interpolate image row `row` (clamped to the image) of every view into its slot of the ring.

    Levels are stored less 32768. Weights must be 16 bits wide, or the loop is not. `ahead` becomes the offset
    of what the next row will have to read of every view that is there.
    """
    rows, columns, height, width, source_length, margin, _ = shape
    length = row_length(width)
    slot = row % 3
    row = min(max(row, 0), height - 1)
    view = 0
    for v in range(rows):
        for u in range(columns):
            if not present[v, u]:
                continue
            first = (v * height + min(max(row + down[v, u], 0), height - 1)) * columns
            second = (v * height + min(max(row + down[v, u] + 1, 0), height - 1)) * columns
            column = margin - PAD + across[v, u]
            upper = np.uintp((first + u) * source_length + column)
            lower = np.uintp((second + u) * source_length + column)
            start = np.uintp(((slot * rows + v) * columns + u) * length)
            ahead[view] = lower + np.uintp(columns * source_length)
            view += 1
            w00, w01, w10, w11 = weights[v, u, 0], weights[v, u, 1], weights[v, u, 2], weights[v, u, 3]
            for x in range(np.uintp(length)):
                ring[start + x] = np.int16(
                    data[upper + x] * w00
                    + data[upper + _ONE + x] * w01
                    + data[lower + x] * w10
                    + data[lower + _ONE + x] * w11
                    + _LOWEST
                )
            # The shifted view ends with the image: its border repeats for the spatial gradient.
            start += np.uintp(PAD)
            ring[start - _ONE] = ring[start]
            ring[start + np.uintp(width)] = ring[start + np.uintp(width - 1)]


@nb.njit(**INNER)
def _row_offsets(row, v, u, present, length):
    """Ring offsets of the seven rows one view's votes need, and its number of angular axes.

    Rows: the view's own, above and below; those of the views to the left, right, above and below, the
    view itself standing in for an absent one (a one-sided difference).
    """
    rows, columns = present.shape
    west = u - 1 if u > 0 and present[v, u - 1] else u
    east = u + 1 if u + 1 < columns and present[v, u + 1] else u
    north = v - 1 if v > 0 and present[v - 1, u] else v
    south = v + 1 if v + 1 < rows and present[v + 1, u] else v
    here, above, below = row % 3 * rows, (row - 1) % 3 * rows, (row + 1) % 3 * rows
    return (
        np.uintp(((here + v) * columns + u) * length + PAD),
        np.uintp(((above + v) * columns + u) * length + PAD),
        np.uintp(((below + v) * columns + u) * length + PAD),
        np.uintp(((here + v) * columns + west) * length + PAD),
        np.uintp(((here + v) * columns + east) * length + PAD),
        np.uintp(((here + north) * columns + u) * length + PAD),
        np.uintp(((here + south) * columns + u) * length + PAD),
        np.uintp(int(west != east) + int(north != south)),
    )


@nb.njit(**INNER)
def _photo_bounds(low, high, ring, start, tolerance):
    """Levels within `tolerance` of the reference view's row: what "photo" accepts."""
    for x in range(low.size):
        level = np.int32(ring[start + np.uintp(x)])
        low[x] = np.int16(max(level - tolerance, _LOWEST))
        high[x] = np.int16(min(level + tolerance, _HIGHEST))


@nb.njit(**INNER)
def _count_views(present):
    count = 0
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            count += present[v, u]
    return count


@nb.njit(**INNER)
def _view_offsets(present, length):
    """`_row_offsets` of every view that is there, for rows y with y % 3 = 0, 1 and 2: (3, views, 8)."""
    table = np.empty((3, _count_views(present), 8), np.uintp)
    for row in range(3):
        view = 0
        for v in range(present.shape[0]):
            for u in range(present.shape[1]):
                if present[v, u]:
                    offsets = _row_offsets(row, v, u, present, length)
                    for k in range(8):
                        table[row, view, k] = offsets[k]
                    view += 1
    return table


@nb.njit(**INNER)
def _count_axes(table):
    """Number of votes a pixel has when every view counts."""
    count = 0
    for view in range(table.shape[1]):
        count += np.int64(table[0, view, 7])
    return count


@nb.njit(**INNER)
def _offsets(table, phase, view):
    return (
        table[phase, view, 0],
        table[phase, view, 1],
        table[phase, view, 2],
        table[phase, view, 3],
        table[phase, view, 4],
        table[phase, view, 5],
        table[phase, view, 6],
    )


@nb.njit(**INNER)
def _mask_offsets(present, placing, length, reach):
    """Offset, from the start of row y in the padded mask, at which every view samples it, and its weights."""
    down, across, weights = placing
    count = _count_views(present)
    offsets, kept = np.empty(count, np.uintp), np.empty((count, 4), np.int16)
    view = 0
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            if present[v, u]:
                offsets[view] = (reach + down[v, u]) * length + reach + across[v, u]
                for k in range(4):
                    kept[view, k] = weights[v, u, k]
                view += 1
    return offsets, kept


@nb.njit(**INNER)
def _signum(a, b, one):
    """Sign of a − b. `one` is 1, but not known to LLVM, which would make slower comparisons of the bounds."""
    difference = np.int16(min(max(np.int32(a) - np.int32(b), np.int32(_LOWEST)), np.int32(_HIGHEST)))
    return min(max(difference, np.int16(-one)), one)


@nb.njit(**INNER)
def _count_plain(sums, levels, phase, one, first, last):
    """Count the central-difference votes of all views on columns [first, last).

    Counting keeps the arithmetic units busy, interpolation the memory: what the latter will want is asked for
    meanwhile.
    """
    votes, weight = sums
    ring, table, low, high, data, ahead = levels
    for view in range(table.shape[1]):
        for x in range(first, last, _LINE):
            _prefetch(data, ahead[view] + np.uintp(x))
        here, above, below, west, east, north, south = _offsets(table, phase, view)
        axes = np.int16(table[phase, view, 7])
        for x in range(np.uintp(first), np.uintp(last)):
            level = ring[here + x]
            inside = np.int16(-np.int16((level >= low[x]) & (level <= high[x])))
            along_x = _signum(ring[here + x + _ONE], ring[here + x - _ONE], one)
            along_y = _signum(ring[below + x], ring[above + x], one)
            along_u = _signum(ring[east + x], ring[west + x], one)
            along_v = _signum(ring[south + x], ring[north + x], one)
            total = np.int16(np.int16(along_x * along_u) + np.int16(along_y * along_v))
            votes[x] = np.int16(votes[x] + (total & inside))
            weight[x] = np.int16(weight[x] + (axes & inside))


@nb.njit(**INNER)
def _sign(a, b):
    return np.int16(a > b) - np.int16(a < b)


@nb.njit(**INNER)
def _central_signs(xu, yv, ring, table, phase, view):
    """One view's signs S_xu, S_yv from central differences."""
    here, above, below, west, east, north, south = _offsets(table, phase, view)
    for x in range(np.uintp(xu.size)):
        angular_u = _sign(ring[east + x], ring[west + x])
        angular_v = _sign(ring[south + x], ring[north + x])
        xu[x] = np.int16(_sign(ring[here + x + _ONE], ring[here + x - _ONE]) * angular_u)
        yv[x] = np.int16(_sign(ring[below + x], ring[above + x]) * angular_v)


@nb.njit(**INNER)
def _sobel_signs(xu, yv, ring, table, phase, view):
    """One view's signs S_xu, S_yv from 3×3 Sobel gradients."""
    here, above, below, west, east, north, south = _offsets(table, phase, view)
    for x in range(np.uintp(xu.size)):
        nw, ne = np.int32(ring[above + x - _ONE]), np.int32(ring[above + x + _ONE])
        sw, se = np.int32(ring[below + x - _ONE]), np.int32(ring[below + x + _ONE])
        left, right = np.int32(ring[here + x - _ONE]), np.int32(ring[here + x + _ONE])
        up, down = np.int32(ring[above + x]), np.int32(ring[below + x])
        angular_u = _sign(ring[east + x], ring[west + x])
        angular_v = _sign(ring[south + x], ring[north + x])
        xu[x] = np.int16(_sign(ne + 2 * right + se, nw + 2 * left + sw) * angular_u)
        yv[x] = np.int16(_sign(sw + 2 * down + se, nw + 2 * up + ne) * angular_v)


@nb.njit(**INNER)
def _count_weighted(votes, weight, xu, yv, ring, here, axes, low, high, signs_agree, share):
    """Add one view's votes, each times `share` (0…`UNIT`)."""
    # With one angular axis there is no second sign to disagree.
    any_signs = not signs_agree or axes < 2
    for x in range(np.uintp(votes.size)):
        level = ring[here + x]
        counts = (level >= low[x]) & (level <= high[x]) & (any_signs | (xu[x] == yv[x]))
        part = share[x] if counts else np.int16(0)
        votes[x] += np.int32(np.int16(part * np.int16(xu[x] + yv[x])))
        weight[x] += np.int32(np.int16(part * axes))


@nb.njit(**INNER)
def _count_masked(sums, levels, phase, one, masks, y, first, last):
    """Count the central-difference votes of all views, each times its view's share in the mask (eq. 4-5).

    `masks` is (mask, length of its rows, flat offsets at which the reference view and every view sample it
    for row 0, the views' weights).
    """
    votes, weight = sums
    ring, table, low, high, data, ahead = levels
    mask, length, own, sampled, weights = masks
    row = np.uintp(y) * length
    own += row
    for view in range(table.shape[1]):
        for x in range(first, last, _LINE):
            _prefetch(data, ahead[view] + np.uintp(x))
        here, above, below, west, east, north, south = _offsets(table, phase, view)
        axes = np.int16(table[phase, view, 7])
        upper = row + sampled[view]
        lower = upper + length
        w00, w01, w10, w11 = weights[view, 0], weights[view, 1], weights[view, 2], weights[view, 3]
        for x in range(np.uintp(first), np.uintp(last)):
            share = np.int16(
                mask[upper + x] * w00
                + mask[upper + _ONE + x] * w01
                + mask[lower + x] * w10
                + mask[lower + _ONE + x] * w11
            )
            share = share if mask[own + x] != 0 else np.int16(UNIT - share)
            level = ring[here + x]
            share &= np.int16(-np.int16((level >= low[x]) & (level <= high[x])))
            along_x = _signum(ring[here + x + _ONE], ring[here + x - _ONE], one)
            along_y = _signum(ring[below + x], ring[above + x], one)
            along_u = _signum(ring[east + x], ring[west + x], one)
            along_v = _signum(ring[south + x], ring[north + x], one)
            total = np.int16(np.int16(along_x * along_u) + np.int16(along_y * along_v))
            votes[x] = np.int16(votes[x] + np.int16(share * total))
            weight[x] = np.int16(weight[x] + np.int16(share * axes))


@nb.njit(**INNER)
def _clear(sums, value):
    votes, weight = sums
    for x in range(votes.size):
        votes[x] = value
        weight[x] = value


@nb.njit(**INNER)
def _scale(out, total, factor, first, last):
    for x in range(np.uintp(first), np.uintp(last)):
        out[x] = np.float32(total[x]) * factor


@nb.njit(**INNER)
def _count_general(sums, scratch, levels, phase, options, masks, y):
    """Sums of all views' votes and weights on row y, in 1/UNIT, with any options and a mask or none."""
    sobel, signs_agree, masked = options
    votes, weight = sums
    ring, table, low, high, _, _ = levels
    xu, yv, share = scratch
    _clear(sums, 0)
    _clear((share, share), UNIT)
    for view in range(table.shape[1]):
        if sobel:
            _sobel_signs(xu, yv, ring, table, phase, view)
        else:
            _central_signs(xu, yv, ring, table, phase, view)
        if masked:
            _mask_share(share, masks, y, view)
        here, axes = table[phase, view, 0], np.int16(table[phase, view, 7])
        _count_weighted(votes, weight, xu, yv, ring, here, axes, low, high, signs_agree, share)


@nb.njit(**INNER)
def _mask_share(share, masks, y, view):
    """Weight of one view's votes (eq. 4-5): its mask where the reference is foreground, else the rest."""
    mask, length, own, sampled, weights = masks
    row = np.uintp(y) * length
    own += row
    upper = row + sampled[view]
    lower = upper + length
    for x in range(np.uintp(share.size)):
        foreground = np.int16(
            mask[upper + x] * weights[view, 0]
            + mask[upper + _ONE + x] * weights[view, 1]
            + mask[lower + x] * weights[view, 2]
            + mask[lower + _ONE + x] * weights[view, 3]
        )
        share[x] = foreground if mask[own + x] != 0 else np.int16(UNIT - foreground)


@nb.njit(**INNER)
def _add_mask_row(count, mask, start, sign):
    for x in range(np.uintp(count.size)):
        count[x] = np.int16(count[x] + mask[np.uintp(start) + x] * sign)


@nb.njit(**INNER)
def _all_equal(row, value, first, last):
    different = 0
    for x in range(np.uintp(first), np.uintp(last)):
        different |= row[x] ^ value
    return different == 0


@nb.njit(**INNER)
def _mark_mixed(mixed, count, reach):
    """Mark the blocks of a row in which the views' masks can differ from the reference's.

    `count` is the number of foreground pixels within `reach` rows. Small gaps are marked, too: the masked
    count holds everywhere, and long loops suit the vector units.
    """
    latest = -_GAP - 2
    for block in range(mixed.size):
        first, last = block * BLOCK, (block + 1) * BLOCK + 2 * reach
        none, full = np.int16(0), np.int16(2 * reach + 1)
        mixed[block] = not (_all_equal(count, none, first, last) or _all_equal(count, full, first, last))
        if mixed[block]:
            if block - latest <= _GAP + 1:
                for between in range(latest + 1, block):
                    mixed[between] = True
            latest = block


@nb.njit(**KERNEL)
def vote_kernel(
    first_row,
    last_row,
    out,
    evidence,
    mask,
    reach,
    placing,
    data,
    shape,
    down,
    across,
    weights,
    present,
    tolerance,
    options,
    one,
):
    """Sum of votes and number of votes that count (`evidence`), both as shares of all possible votes.

    Rows [first_row, last_row) of one plane.

    `mask` is flat, of an image padded by `reach` (and to whole blocks); `placing` samples it per view: whole
    pixels down and across, and bilinear weights. `options` is (sobel, signs_agree, masked). `one` is 1, see
    `_signum`.
    """
    rows, columns, _, width = shape[:4]
    reference = shape[6]
    length = row_length(width)
    inner = length - 2 * PAD
    mask_length = inner + 2 * reach
    sobel, signs_agree, masked = options
    table = _view_offsets(present, length)
    possible = max(_count_axes(table), 1)
    # Numbers of votes, and of shares of votes, have to fit 16 bits.
    general = sobel or signs_agree or possible * (UNIT if masked else 1) > _HIGHEST
    share = np.float32(1 / (possible * UNIT))
    ring = np.empty(3 * rows * columns * length, np.int16)
    low, high = np.empty(inner, np.int16), np.empty(inner, np.int16)
    sums = (np.empty(inner, np.int16), np.empty(inner, np.int16))
    large_sums = (np.empty(inner, np.int32), np.empty(inner, np.int32))
    scratch = (np.empty(inner, np.int16), np.empty(inner, np.int16), np.empty(inner, np.int16))
    mixed = np.zeros(inner // BLOCK, np.bool_)
    count = np.zeros(mask_length if masked else 0, np.int16)
    sampled, kept = _mask_offsets(present, placing, mask_length, reach)
    masks = (mask, np.uintp(mask_length), np.uintp(reach * mask_length + reach), sampled, kept)
    levels = (ring, table, low, high, data, np.empty(table.shape[1], np.uintp))
    if masked:
        for row in range(first_row, first_row + 2 * reach):
            _add_mask_row(count, mask, row * mask_length, 1)
    fill_ring(ring, first_row - 1, data, shape, down, across, weights, present, levels[5])
    fill_ring(ring, first_row, data, shape, down, across, weights, present, levels[5])
    for y in range(first_row, last_row):
        fill_ring(ring, y + 1, data, shape, down, across, weights, present, levels[5])
        phase = y % 3
        centre = (phase * rows * columns + reference) * length + PAD
        _photo_bounds(low, high, ring, np.uintp(centre), tolerance)
        if general:
            _count_general(large_sums, scratch, levels, phase, options, masks, y)
            _scale(out[y], large_sums[0], share, 0, width)
            _scale(evidence[y], large_sums[1], share, 0, width)
            continue
        if masked:
            _add_mask_row(count, mask, (y + 2 * reach) * mask_length, 1)
            _mark_mixed(mixed, count, reach)
            _add_mask_row(count, mask, y * mask_length, -1)
        _clear(sums, 0)
        last = 0
        while last < inner:
            first, last = last, last + BLOCK
            while last < inner and mixed[last // BLOCK] == mixed[first // BLOCK]:
                last += BLOCK
            factor = np.float32(1 / possible)
            if mixed[first // BLOCK]:
                factor = share
                _count_masked(sums, levels, phase, one, masks, y, first, last)
            else:
                _count_plain(sums, levels, phase, one, first, last)
            _scale(out[y], sums[0], factor, first, min(last, width))
            _scale(evidence[y], sums[1], factor, first, min(last, width))


@nb.njit(**KERNEL)
def sign_kernel(first_row, last_row, signs_xu, signs_yv, data, shape, down, across, weights, present, sobel):
    """Signs of all views, each (V, U, H, W), for rows [first_row, last_row)."""
    rows, columns, _, width = shape[:4]
    length = row_length(width)
    ring = np.empty(3 * rows * columns * length, np.int16)
    xu, yv = np.empty(width, np.int16), np.empty(width, np.int16)
    table = _view_offsets(present, length)
    ahead = np.empty(table.shape[1], np.uintp)
    fill_ring(ring, first_row - 1, data, shape, down, across, weights, present, ahead)
    fill_ring(ring, first_row, data, shape, down, across, weights, present, ahead)
    for y in range(first_row, last_row):
        fill_ring(ring, y + 1, data, shape, down, across, weights, present, ahead)
        view = 0
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                if sobel:
                    _sobel_signs(xu, yv, ring, table, y % 3, view)
                else:
                    _central_signs(xu, yv, ring, table, y % 3, view)
                signs_xu[v, u, y] = xu
                signs_yv[v, u, y] = yv
                view += 1
