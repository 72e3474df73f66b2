"""Windows of a picture: tiles, what lies around them, and where two of them meet."""

from __future__ import annotations

from collections.abc import Mapping

from lfdepth.blocks.borders import Side

Window = tuple[int, int, int, int]
"""(x, y, width, height), px."""

LATTICE = 24
"""Px of which the corner of a window is a multiple, so that fits at every second, eighth or twelfth pixel are
at the same ones in all windows."""
OVERLAP = 24
"""Px on either side of a border on which two tiles are compared."""
NEIGHBOURS: dict[Side, tuple[int, int]] = {
    "left": (-1, 0),
    "right": (1, 0),
    "top": (0, -1),
    "bottom": (0, 1),
}
"""Steps (right, down) to the tile on each side."""
OPPOSITE: dict[Side, Side] = {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}


def widened(core: Window, around: int, size: tuple[int, int]) -> Window:
    """A tile with what is around it, as far as there is a picture."""
    x, y, width, height = core
    left, top = (max(at - around, 0) // LATTICE * LATTICE for at in (x, y))
    right, bottom = min(x + width + around, size[1]), min(y + height + around, size[0])
    return left, top, right - left, bottom - top


def entry_lines(window: Window, margin: int, size: tuple[int, int]) -> dict[Side, int]:
    """Lines of a window on which paths begin, on the sides on which the picture goes on."""
    x, y, width, height = window
    lines: dict[Side, tuple[bool, int]] = {
        "left": (x > 0, margin),
        "right": (x + width < size[1], width - 1 - margin),
        "top": (y > 0, margin),
        "bottom": (y + height < size[0], height - 1 - margin),
    }
    return {side: line for side, (cut, line) in lines.items() if cut and margin >= 0}


def exit_lines(window: Window, beside: Mapping[Side, tuple[Window, Mapping[Side, int]]]) -> dict[Side, int]:
    """Lines of a window on which paths begin in the windows of the neighbours, where they lie in it."""
    found: dict[Side, int] = {}
    for side, (other, entries) in beside.items():
        axis = 0 if side in ("left", "right") else 1
        begins = entries.get(OPPOSITE[side])
        if begins is None:
            continue
        at = begins + other[axis] - window[axis]
        if 0 <= at < window[2 + axis]:
            found[side] = at
    return found


def seam_between(side: Side, core: Window, window: Window, other: Window) -> Window:
    """Pixels at the border of a tile on a side, as far as its window and the neighbour's have them."""
    x, y, width, height = core
    strips: dict[Side, Window] = {
        "left": (x - OVERLAP, y, 2 * OVERLAP, height),
        "right": (x + width - OVERLAP, y, 2 * OVERLAP, height),
        "top": (x, y - OVERLAP, width, 2 * OVERLAP),
        "bottom": (x, y + height - OVERLAP, width, 2 * OVERLAP),
    }
    return _common(strips[side], _common(window, other))


def _common(one: Window, other: Window) -> Window:
    """What two windows have in common."""
    left, top = max(one[0], other[0]), max(one[1], other[1])
    right, bottom = (min(one[i] + one[i + 2], other[i] + other[i + 2]) for i in (0, 1))
    return left, top, max(right - left, 0), max(bottom - top, 0)


def within(window: Window, outer: Window) -> Window:
    """A window as counted in another one."""
    return window[0] - outer[0], window[1] - outer[1], window[2], window[3]


def slices(window: Window) -> tuple[slice, slice]:
    """Rows and columns of a window, to index an array with."""
    x, y, width, height = window
    return slice(y, y + height), slice(x, x + width)


def window_around(place: tuple[int, int], size: tuple[int, int], side: int) -> Window:
    """A window around a place (y, x), moved into the picture of (H, W) px."""
    height, width = (min(side, each) for each in size)
    top, left = (
        min(max(at - length // 2, 0), each - length)
        for at, length, each in zip(place, (height, width), size, strict=True)
    )
    return left, top, width, height
