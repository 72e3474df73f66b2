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

from lfdepth.sweep.reparam import PAD, UNIT

BLOCK = 32
"""Columns that share the decision between the plain and the masked count."""

_ONE = np.uintp(1)
_LOWEST, _HIGHEST = -32768, 32767


@nb.njit(nogil=True, cache=True)
def interpolate_row(out, start, source, upper, lower, length, w00, w01, w10, w11):
    """Write interpolated levels, less 32768, to `out[start:start + length]` from two rows of `source`.

    Weights must be 16 bits wide, or the loop is not.
    """
    for x in range(np.uintp(length)):
        out[start + x] = np.int16(
            source[upper + x] * w00
            + source[upper + _ONE + x] * w01
            + source[lower + x] * w10
            + source[lower + _ONE + x] * w11
            + _LOWEST
        )


@nb.njit(nogil=True, cache=True)
def row_length(width):
    """Length of a row in the ring: the image's width in whole blocks, and a pad on both sides."""
    return (width + BLOCK - 1) // BLOCK * BLOCK + 2 * PAD


@nb.njit(nogil=True, cache=True)
def fill_ring(ring, row, data, shape, down, across, weights, present):
    """Interpolate image row `row` (clamped to the image) of every view into its slot of the ring."""
    rows, columns, height, width, source_length, margin = shape
    length = row_length(width)
    slot = row % 3
    row = min(max(row, 0), height - 1)
    for v in range(rows):
        upper = min(max(row + down[v], 0), height - 1)
        lower = min(max(row + down[v] + 1, 0), height - 1)
        for u in range(columns):
            if not present[v, u]:
                continue
            column = margin - PAD + across[u]
            start = np.uintp(((slot * rows + v) * columns + u) * length)
            interpolate_row(
                ring,
                start,
                data,
                np.uintp(((v * height + upper) * columns + u) * source_length + column),
                np.uintp(((v * height + lower) * columns + u) * source_length + column),
                length,
                weights[v, u, 0],
                weights[v, u, 1],
                weights[v, u, 2],
                weights[v, u, 3],
            )
            # The shifted view ends with the image: its border repeats for the spatial gradient.
            start += np.uintp(PAD)
            ring[start - _ONE] = ring[start]
            ring[start + np.uintp(width)] = ring[start + np.uintp(width - 1)]


@nb.njit(nogil=True, cache=True)
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
        int(west != east) + int(north != south),
    )


@nb.njit(nogil=True, cache=True)
def _photo_bounds(low, high, ring, start, tolerance):
    """Levels within `tolerance` of the reference view's row: what "photo" accepts."""
    for x in range(low.size):
        level = np.int32(ring[start + np.uintp(x)])
        low[x] = np.int16(max(level - tolerance, _LOWEST))
        high[x] = np.int16(min(level + tolerance, _HIGHEST))


@nb.njit(nogil=True, cache=True)
def _count_plain(votes, weight, ring, offsets, low, high, first, last):
    """Add one view's central-difference votes to columns [first, last)."""
    here, above, below, west, east, north, south, axes = offsets
    one, axes16 = np.int16(1), np.int16(axes)
    for x in range(np.uintp(first), np.uintp(last)):
        level = ring[here + x]
        inside = (level >= low[x]) & (level <= high[x])
        left, right = ring[here + x - _ONE], ring[here + x + _ONE]
        # Two booleans per gradient instead of a sign: comparisons are all that narrow integers need.
        x_up, x_down = (right > left) & inside, (right < left) & inside
        y_up = (ring[below + x] > ring[above + x]) & inside
        y_down = (ring[below + x] < ring[above + x]) & inside
        u_up, u_down = ring[east + x] > ring[west + x], ring[east + x] < ring[west + x]
        v_up, v_down = ring[south + x] > ring[north + x], ring[south + x] < ring[north + x]
        total = votes[x]
        total = np.int16(total + one) if (x_up & u_up) | (x_down & u_down) else total
        total = np.int16(total - one) if (x_up & u_down) | (x_down & u_up) else total
        total = np.int16(total + one) if (y_up & v_up) | (y_down & v_down) else total
        total = np.int16(total - one) if (y_up & v_down) | (y_down & v_up) else total
        votes[x] = total
        weight[x] = np.int16(weight[x] + axes16) if inside else weight[x]


@nb.njit(nogil=True, cache=True, inline="always")
def _sign(a, b):
    return np.int16(a > b) - np.int16(a < b)


@nb.njit(nogil=True, cache=True)
def _central_signs(xu, yv, ring, offsets, first, last):
    """One view's signs S_xu, S_yv from central differences."""
    here, above, below, west, east, north, south, _ = offsets
    for x in range(np.uintp(first), np.uintp(last)):
        angular_u = _sign(ring[east + x], ring[west + x])
        angular_v = _sign(ring[south + x], ring[north + x])
        xu[x] = np.int16(_sign(ring[here + x + _ONE], ring[here + x - _ONE]) * angular_u)
        yv[x] = np.int16(_sign(ring[below + x], ring[above + x]) * angular_v)


@nb.njit(nogil=True, cache=True)
def _sobel_signs(xu, yv, ring, offsets, first, last):
    """One view's signs S_xu, S_yv from 3×3 Sobel gradients."""
    here, above, below, west, east, north, south, _ = offsets
    for x in range(np.uintp(first), np.uintp(last)):
        nw, ne = np.int32(ring[above + x - _ONE]), np.int32(ring[above + x + _ONE])
        sw, se = np.int32(ring[below + x - _ONE]), np.int32(ring[below + x + _ONE])
        left, right = np.int32(ring[here + x - _ONE]), np.int32(ring[here + x + _ONE])
        up, down = np.int32(ring[above + x]), np.int32(ring[below + x])
        angular_u = _sign(ring[east + x], ring[west + x])
        angular_v = _sign(ring[south + x], ring[north + x])
        xu[x] = np.int16(_sign(ne + 2 * right + se, nw + 2 * left + sw) * angular_u)
        yv[x] = np.int16(_sign(sw + 2 * down + se, nw + 2 * up + ne) * angular_v)


@nb.njit(nogil=True, cache=True)
def _count_weighted(votes, weight, xu, yv, ring, offsets, low, high, signs_agree, share, first, last):
    """Add one view's votes, each times `share` (0…`UNIT`), for columns [first, last)."""
    here, axes = offsets[0], np.int16(offsets[7])
    # With one angular axis there is no second sign to disagree.
    any_signs = not signs_agree or axes < 2
    for x in range(np.uintp(first), np.uintp(last)):
        level = ring[here + x]
        counts = (level >= low[x]) & (level <= high[x]) & (any_signs | (xu[x] == yv[x]))
        part = share[x] if counts else np.int16(0)
        votes[x] += np.int32(np.int16(part * np.int16(xu[x] + yv[x])))
        weight[x] += np.int32(np.int16(part * axes))


@nb.njit(nogil=True, cache=True)
def _count_masked(
    votes, weight, ring, offsets, low, high, mask, own, shifted, length, w00, w01, w10, w11, first, last
):
    """Add one view's central-difference votes, each times its share in the mask (eq. 4-5).

    `own` and `shifted` are the flat offsets of the reference's and the view's row in the mask, whose rows
    are `length` long.
    """
    here, above, below, west, east, north, south, axes = offsets
    axes16, below_mask, zero = np.int16(axes), shifted + np.uintp(length), np.int16(0)
    for x in range(np.uintp(first), np.uintp(last)):
        share = np.int16(
            mask[shifted + x] * w00
            + mask[shifted + _ONE + x] * w01
            + mask[below_mask + x] * w10
            + mask[below_mask + _ONE + x] * w11
        )
        share = share if mask[own + x] != 0 else np.int16(UNIT - share)
        level = ring[here + x]
        share = share if (level >= low[x]) & (level <= high[x]) else zero
        left, right = ring[here + x - _ONE], ring[here + x + _ONE]
        x_up, x_down = right > left, right < left
        y_up, y_down = ring[below + x] > ring[above + x], ring[below + x] < ring[above + x]
        u_up, u_down = ring[east + x] > ring[west + x], ring[east + x] < ring[west + x]
        v_up, v_down = ring[south + x] > ring[north + x], ring[south + x] < ring[north + x]
        total = share if (x_up & u_up) | (x_down & u_down) else zero
        total = np.int16(total - share) if (x_up & u_down) | (x_down & u_up) else total
        total = np.int16(total + share) if (y_up & v_up) | (y_down & v_down) else total
        total = np.int16(total - share) if (y_up & v_down) | (y_down & v_up) else total
        votes[x] = np.int16(votes[x] + total)
        weight[x] = np.int16(weight[x] + share * axes16)


@nb.njit(nogil=True, cache=True)
def _flush(total, part, first, last):
    """Move 16-bit sums to 32-bit ones: a row of views cannot overflow 16 bits, a whole grid could."""
    for x in range(np.uintp(first), np.uintp(last)):
        total[x] += part[x]
        part[x] = 0


@nb.njit(nogil=True, cache=True)
def _scale(out, total, factor):
    for x in range(out.size):
        out[x] = np.float32(total[x]) * factor


@nb.njit(nogil=True, cache=True)
def _plain_row(out, evidence, factor, votes, weight, ring, y, present, low, high, first, last):
    """Votes of all views on columns [first, last) of row y."""
    votes[first:last] = 0
    weight[first:last] = 0
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            if present[v, u]:
                offsets = _row_offsets(y, v, u, present, low.size + 2 * PAD)
                _count_plain(votes, weight, ring, offsets, low, high, first, last)
    last = min(last, out.size)
    _scale(out[first:last], votes[first:last], factor)
    _scale(evidence[first:last], weight[first:last], factor)


@nb.njit(nogil=True, cache=True)
def _masked_row(
    out, evidence, factor, sums, parts, ring, y, present, low, high, mask, length, reach, placing, first, last
):
    """Votes of all views on columns [first, last) of row y, with the mask."""
    down, across, weights = placing
    (votes, weight), (row_votes, row_weight) = sums, parts
    votes[first:last] = 0
    weight[first:last] = 0
    row_votes[first:last] = 0
    row_weight[first:last] = 0
    own = np.uintp((y + reach) * length + reach)
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            if not present[v, u]:
                continue
            _count_masked(
                row_votes,
                row_weight,
                ring,
                _row_offsets(y, v, u, present, low.size + 2 * PAD),
                low,
                high,
                mask,
                own,
                np.uintp((y + reach + down[v]) * length + reach + across[u]),
                length,
                weights[v, u, 0],
                weights[v, u, 1],
                weights[v, u, 2],
                weights[v, u, 3],
                first,
                last,
            )
        _flush(votes, row_votes, first, last)
        _flush(weight, row_weight, first, last)
    last = min(last, out.size)
    _scale(out[first:last], votes[first:last], factor / np.float32(UNIT))
    _scale(evidence[first:last], weight[first:last], factor / np.float32(UNIT))


@nb.njit(nogil=True, cache=True)
def _general_row(
    out,
    evidence,
    factor,
    votes,
    weight,
    scratch,
    ring,
    y,
    present,
    low,
    high,
    options,
    mask,
    length,
    reach,
    placing,
):
    """Votes of all views on row y, with any options and a mask or none."""
    sobel, signs_agree, masked = options
    xu, yv, share = scratch
    down, across, weights = placing
    inner = low.size
    votes[:] = 0
    weight[:] = 0
    share[:] = UNIT
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            if not present[v, u]:
                continue
            offsets = _row_offsets(y, v, u, present, inner + 2 * PAD)
            if sobel:
                _sobel_signs(xu, yv, ring, offsets, 0, inner)
            else:
                _central_signs(xu, yv, ring, offsets, 0, inner)
            if masked:
                start = (y + reach + down[v]) * length + reach + across[u]
                _mask_share(share, mask, (y + reach) * length + reach, start, length, weights[v, u])
            _count_weighted(votes, weight, xu, yv, ring, offsets, low, high, signs_agree, share, 0, inner)
    _scale(out, votes, factor / np.float32(UNIT))
    _scale(evidence, weight, factor / np.float32(UNIT))


@nb.njit(nogil=True, cache=True)
def _mask_share(share, mask, own, shifted, length, weights):
    """Weight of one view's votes (eq. 4-5): its mask where the reference is foreground, else the rest."""
    for x in range(share.size):
        at = shifted + x
        foreground = np.int16(
            mask[at] * weights[0]
            + mask[at + 1] * weights[1]
            + mask[at + length] * weights[2]
            + mask[at + length + 1] * weights[3]
        )
        share[x] = foreground if mask[own + x] != 0 else np.int16(UNIT - foreground)


@nb.njit(nogil=True, cache=True)
def _is_mixed(mask, length, reach, y, first):
    """Whether the views' masks can differ from the reference's in the block that starts at column `first`."""
    if reach > BLOCK:  # looking costs more than it saves
        return True
    total = 0
    for row in range(y, y + 2 * reach + 1):
        for x in range(row * length + first, row * length + first + BLOCK + 2 * reach):
            total += mask[x]
    return total != 0 and total != (2 * reach + 1) * (BLOCK + 2 * reach)


@nb.njit(nogil=True, cache=True)
def _axes(present):
    """Number of votes a pixel has when every view counts."""
    total = 0
    for v in range(present.shape[0]):
        for u in range(present.shape[1]):
            if present[v, u]:
                total += _row_offsets(0, v, u, present, 1)[7]
    return total


@nb.njit(nogil=True, cache=True)
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
):
    """Sum of votes and number of votes that count (`evidence`), both as shares of all possible votes.

    Rows [first_row, last_row) of one plane.

    `mask` is flat, of an image padded by `reach` (and to whole blocks); `placing` samples it per view: whole
    pixels down and across, and bilinear weights. `options` is (sobel, signs_agree, masked).
    """
    rows, columns, _, width = shape[:4]
    length = row_length(width)
    inner = length - 2 * PAD
    mask_length = inner + 2 * reach
    sobel, signs_agree, masked = options
    possible = _axes(present)
    factor = np.float32(1.0 / max(possible, 1))
    # More votes than 16 bits count, or more shares of votes in one row of views.
    many = possible > _HIGHEST or 2 * columns * UNIT > _HIGHEST
    ring = np.empty(3 * rows * columns * length, np.int16)
    low, high = np.empty(inner, np.int16), np.empty(inner, np.int16)
    parts = (np.empty(inner, np.int16), np.empty(inner, np.int16))
    sums = (np.empty(inner, np.int32), np.empty(inner, np.int32))
    scratch = (np.empty(inner, np.int16), np.empty(inner, np.int16), np.empty(inner, np.int16))
    fill_ring(ring, first_row - 1, data, shape, down, across, weights, present)
    fill_ring(ring, first_row, data, shape, down, across, weights, present)
    for y in range(first_row, last_row):
        fill_ring(ring, y + 1, data, shape, down, across, weights, present)
        centre = ((y % 3 * rows + rows // 2) * columns + columns // 2) * length + PAD
        _photo_bounds(low, high, ring, np.uintp(centre), tolerance)
        if sobel or signs_agree or many:
            _general_row(
                out[y],
                evidence[y],
                factor,
                sums[0],
                sums[1],
                scratch,
                ring,
                y,
                present,
                low,
                high,
                options,
                mask,
                mask_length,
                reach,
                placing,
            )
            continue
        last = 0
        while last < inner:
            first, last = last, last + BLOCK
            mixed = masked and _is_mixed(mask, mask_length, reach, y, first)
            # Neighbouring blocks of one kind are counted together: long loops suit the vector units.
            while last < inner and mixed == (masked and _is_mixed(mask, mask_length, reach, y, last)):
                last += BLOCK
            if mixed:
                _masked_row(
                    out[y],
                    evidence[y],
                    factor,
                    sums,
                    parts,
                    ring,
                    y,
                    present,
                    low,
                    high,
                    mask,
                    mask_length,
                    reach,
                    placing,
                    first,
                    last,
                )
            else:
                _plain_row(
                    out[y], evidence[y], factor, parts[0], parts[1], ring, y, present, low, high, first, last
                )


@nb.njit(nogil=True, cache=True)
def sign_kernel(first_row, last_row, signs_xu, signs_yv, data, shape, down, across, weights, present, sobel):
    """Signs of all views, each (V, U, H, W), for rows [first_row, last_row)."""
    rows, columns, _, width = shape[:4]
    length = row_length(width)
    ring = np.empty(3 * rows * columns * length, np.int16)
    xu, yv = np.empty(width, np.int16), np.empty(width, np.int16)
    fill_ring(ring, first_row - 1, data, shape, down, across, weights, present)
    fill_ring(ring, first_row, data, shape, down, across, weights, present)
    for y in range(first_row, last_row):
        fill_ring(ring, y + 1, data, shape, down, across, weights, present)
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                offsets = _row_offsets(y, v, u, present, length)
                if sobel:
                    _sobel_signs(xu, yv, ring, offsets, 0, width)
                else:
                    _central_signs(xu, yv, ring, offsets, 0, width)
                signs_xu[v, u, y] = xu
                signs_yv[v, u, y] = yv
