"""Runs of places that follow one another.

Pixels of one surface mostly land side by side in another view. Where they do they can be read or written
many at a time; single ones are left to loops that look at each place.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import INNER

RUN = 8
"""Pixels of a block, whose places follow one another or do not."""


@nb.njit(**INNER)
def find_breaks(breaks, places):
    """For every whole block of a row's places, 0 where they follow one another, and none is negative."""
    size = np.uintp(RUN)
    for block in range(np.uintp(breaks.size)):
        at = block * size
        first, apart = places[at], np.int32(0)
        for x in range(size):
            apart |= places[at + x] - first - np.int32(x)
        breaks[block] = apart | (first & np.int32(-(2**31)))


@nb.njit(**INNER)
def run_length(breaks, block, places):
    """Number of pixels, from a block without a break on, whose places follow one another."""
    size, last = np.uintp(RUN), np.uintp(breaks.size)
    length, at = size, block * size
    block += np.uintp(1)
    while block < last and breaks[block] == 0 and places[at + length] - places[at] == np.int32(length):
        length += size
        block += np.uintp(1)
    return length
