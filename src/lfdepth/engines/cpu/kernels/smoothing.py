"""Row kernels of the guided filter.

One pass down the image: each row that comes in completes the windows of the row `radius` above it, whose fits
complete the windows of the row another `radius` above. Of images, products and fits only a window's height of
rows is kept, which stays in the second-level cache; memory is read once and written once.

Sums down a column come from blocks of one window's height, counted from the image's first row: every window
is the end of one block and the beginning of the next (van Herk, doi:10.1016/0167-8655(92)90069-C). Nothing is
ever subtracted, so nothing is left behind where nothing was summed, and a row's sums are the same wherever a
band begins.

A row of sums holds all channels side by side, each with `radius` zeros on both sides. Leaf functions take
flat arrays and unsigned offsets: that is what LLVM turns into vector loops.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER, KERNEL

_NONE, _ONE, _TWO = np.uintp(0), np.uintp(1), np.uintp(2)


@nb.njit(**INNER)
def _clear(ring, start, length):
    for x in range(np.uintp(length)):
        ring[start + x] = 0


@nb.njit(**INNER)
def _copy(ring, new, image, start, width):
    for x in range(np.uintp(width)):
        ring[new + x] = image[start + x]


@nb.njit(**INNER)
def _multiply(ring, new, image, start, guide, factor, width):
    for x in range(np.uintp(width)):
        ring[new + x] = image[start + x] * guide[factor + x]


@nb.njit(**INNER)
def _turn_block(ring, height, length):
    """Replace the rows of a full block by the sums from each row to the block's end."""
    for row in range(height - 2, 0, -1):
        here, below = np.uintp(row * length), np.uintp((row + 1) * length)
        for x in range(np.uintp(length)):
            ring[here + x] += ring[below + x]


@nb.njit(**INNER)
def _add_row(sums, ring, new, end, begun, length):
    """Sums of the window that the row at `new` completes: the end of one block, the beginning of the next."""
    for x in range(np.uintp(length)):
        total = begun[x] + ring[new + x]
        begun[x] = total
        sums[x] = total + ring[end + x]


@nb.njit(**INNER)
def _column_sums(sums, ring, begun, row, height, length):
    """Sums over the `height` rows that end at `row`, which has just been put into its place in the ring.

    The ring holds a block, and behind it a row of zeros: the last row of a block needs no other block's end.
    """
    place = row % height
    if place == 0:
        _clear(begun, _NONE, length)
    _add_row(sums, ring, np.uintp(place * length), np.uintp((place + 1) * length), begun, length)
    if place == height - 1:
        _turn_block(ring, height, length)


@nb.njit(**INNER)
def _sum_four(out, row, step, length):
    twice = step + step
    for x in range(np.uintp(length)):
        out[x] = (row[x] + row[x + step]) + (row[x + twice] + row[x + twice + step])


@nb.njit(**INNER)
def _add_one(out, row, first, length):
    for x in range(np.uintp(length)):
        out[x] += row[x + first]


@nb.njit(**INNER)
def _add_two(out, row, first, second, length):
    for x in range(np.uintp(length)):
        out[x] += row[x + first] + row[x + second]


@nb.njit(**INNER)
def _window_sums(sums, scratch, window, length):
    """Replace each value by the sum of the `window` values from it on; `window` is odd.

    Windows are put together from runs of 1, 4, 16 … values (the digits of the window's size to base 4), which
    vectorises and, unlike a running sum along the row, does not drift. All arrays are longer than `length` by
    a window or more.
    """
    run, spare = scratch
    done, step = window % 4, 4
    if step <= window:
        _sum_four(run, sums, _ONE, length)
    if done == 3:
        # Vector loops need a source of their own.
        _copy(spare, _NONE, sums, _NONE, length + 2)
        _add_two(sums, spare, _ONE, _TWO, length)
    while step <= window:
        terms = window // step % 4
        if terms >= 2:
            _add_two(sums, run, np.uintp(done), np.uintp(done + step), length)
        if terms % 2 == 1:
            _add_one(sums, run, np.uintp(done + (terms - 1) * step), length)
        done += terms * step
        if 4 * step <= window:
            _sum_four(spare, run, np.uintp(step), length)
            run, spare = spare, run
        step *= 4


@nb.njit(**INNER)
def _fit_grey(fit, new, sums, length, share, shares, stats, start, width):
    """Linear fits of one row's windows: offset and slope, `length` apart."""
    size, slope = np.uintp(width), new + np.uintp(length)
    second, inverse = np.uintp(length), start + np.uintp(width)
    for x in range(size):
        part = shares[x] * share
        p = sums[x] * part
        a = stats[inverse + x] * (sums[second + x] * part - stats[start + x] * p)
        fit[new + x] = p - a * stats[start + x]
        fit[slope + x] = a


@nb.njit(**INNER)
def _fit_colour(fit, new, sums, length, share, shares, stats, start, width):
    """Linear fits of one row's windows: offset and three slopes, `length` apart.

    `share` and `shares` are one over a window's rows and columns; `stats` are the guide's three means
    and the upper triangle of its inverse covariance.
    """
    size, step = np.uintp(width), np.uintp(length)
    second, third = step + step, step + step + step
    m1, m2 = start + size, start + size + size
    i0 = m2 + size
    i1, i2 = i0 + size, i0 + size + size
    i3 = i2 + size
    i4, i5 = i3 + size, i3 + size + size
    for x in range(size):
        part = shares[x] * share
        p = sums[x] * part
        r = sums[step + x] * part - stats[start + x] * p
        g = sums[second + x] * part - stats[m1 + x] * p
        b = sums[third + x] * part - stats[m2 + x] * p
        a0 = stats[i0 + x] * r + stats[i1 + x] * g + stats[i2 + x] * b
        a1 = stats[i1 + x] * r + stats[i3 + x] * g + stats[i4 + x] * b
        a2 = stats[i2 + x] * r + stats[i4 + x] * g + stats[i5 + x] * b
        fit[new + x] = p - a0 * stats[start + x] - a1 * stats[m1 + x] - a2 * stats[m2 + x]
        fit[new + step + x] = a0
        fit[new + second + x] = a1
        fit[new + third + x] = a2


@nb.njit(**INNER)
def _apply_grey(out, sums, length, share, shares, guide, start, width):
    step = np.uintp(length)
    for x in range(np.uintp(width)):
        out[x] = shares[x] * share * (sums[x] + sums[step + x] * guide[start + x])


@nb.njit(**INNER)
def _apply_colour(out, sums, length, share, shares, guide, start, width):
    """Mean of the fits, applied to one row of the guide."""
    size, step = np.uintp(width), np.uintp(length)
    second, third, g, b = step + step, step + step + step, start + size, start + size + size
    for x in range(size):
        slopes = sums[step + x] * guide[start + x] + sums[second + x] * guide[g + x]
        out[x] = shares[x] * share * (sums[x] + slopes + sums[third + x] * guide[b + x])


@nb.njit(**INNER)
def _bounded_quotient(out, numerator, denominator):
    """Quotient within [−1, 1]; the filter overshoots, so small denominators are kept off zero."""
    for x in range(out.size):
        ratio = numerator[x] / max(denominator[x], np.float32(1e-3))
        out[x] = min(max(ratio, np.float32(-1)), np.float32(1))


@nb.njit(**KERNEL)
def smooth_kernel(
    first_row, last_row, out, numerator, denominator, divide, guide, stats, shares, shape, radius
):
    """Smooth rows [first_row, last_row) of an image, or of two and divide.

    Arrays but `out` are flat. `guide` and `stats` hold the channels of a row side by side, row after row;
    `shares` is one over the number of columns in each pixel's window, which the border cuts.
    """
    height, width, channels = shape
    window, images = 2 * radius + 1, (numerator, denominator)
    count = 2 if divide else 1
    length = width + 2 * radius
    row = (channels + 1) * length
    kept = channels * (channels + 3) // 2
    # Per image, and for products (0) and fits (1).
    rings = np.zeros((2, 2, (window + 1) * row), np.float32)
    begun = np.zeros((2, 2, row), np.float32)
    sums = np.zeros(row + 2 * window, np.float32)
    scratch = (np.zeros_like(sums), np.zeros_like(sums))
    results = np.empty((2, width), np.float32)
    for last in range(first_row - 2 * radius, last_row + 2 * radius):
        middle, y = last - radius, last - 2 * radius
        for i in range(count):
            ring = rings[i, 0]
            start = last % window * row
            if 0 <= last < height:
                at = np.uintp(last * width)
                _copy(ring, np.uintp(start + radius), images[i], at, width)
                for c in range(channels):
                    factor = np.uintp((last * channels + c) * width)
                    place = np.uintp(start + (c + 1) * length + radius)
                    _multiply(ring, place, images[i], at, guide, factor, width)
            else:
                _clear(ring, np.uintp(start), row)
            _column_sums(sums, ring, begun[i, 0], last, window, row)

            ring = rings[i, 1]
            start = middle % window * row
            if max(first_row - radius, 0) <= middle < height:
                _window_sums(sums, scratch, window, row)
                share = np.float32(1.0 / (min(middle + radius + 1, height) - max(middle - radius, 0)))
                place, at = np.uintp(start + radius), np.uintp(middle * kept * width)
                if channels == 1:
                    _fit_grey(ring, place, sums, length, share, shares, stats, at, width)
                else:
                    _fit_colour(ring, place, sums, length, share, shares, stats, at, width)
            else:
                _clear(ring, np.uintp(start), row)
            _column_sums(sums, ring, begun[i, 1], middle, window, row)

            if y >= first_row:
                _window_sums(sums, scratch, window, row)
                share = np.float32(1.0 / (min(y + radius + 1, height) - max(y - radius, 0)))
                at = np.uintp(y * channels * width)
                if channels == 1:
                    _apply_grey(results[i], sums, length, share, shares, guide, at, width)
                else:
                    _apply_colour(results[i], sums, length, share, shares, guide, at, width)
        if y >= first_row and divide:
            _bounded_quotient(out[y], results[0], results[1])
        elif y >= first_row:
            _copy(out[y], _NONE, results[0], _NONE, width)
