"""The four stacks of views that EPINET looks at, and how they turn with a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Position = tuple[int, int]
"""(v, u), counted from the reference view."""


def stacks(across: int) -> tuple[tuple[Position, ...], ...]:
    """Views (v, u) of each stack, in the order of its channels.

    0 degrees: the middle row, left to right; 90 degrees: the middle column, bottom first; 45 degrees: from
    bottom left to top right; -45 degrees: from top left to bottom right. (EPINET's own order.)

    Parameters
    ----------
    across
        Views along an axis, odd.
    """
    reach = across // 2
    along = range(-reach, reach + 1)
    return (
        tuple((0, i) for i in along),
        tuple((-i, 0) for i in along),
        tuple((-i, i) for i in along),
        tuple((i, i) for i in along),
    )


def stack_indices(across: int, positions: Sequence[Position]) -> npt.NDArray[np.int64]:
    """Where the views of each stack stand in a list of positions, (4, across)."""
    places = {position: i for i, position in enumerate(positions)}
    return np.array([[places[position] for position in stack] for stack in stacks(across)])


def turned(positions: Sequence[Position], flip_v: bool, flip_u: bool, swap: bool) -> npt.NDArray[np.int64]:
    """Which view takes the place of each when a picture is mirrored and transposed, (N,).

    Pixel (i, j) of the new picture is pixel (i', j') of the old one: i and j are exchanged where `swap`, then
    mirrored where `flip_v` and `flip_u`. Positions follow the same rule, so that disparities stay as they
    are.
    """
    places = {position: i for i, position in enumerate(positions)}
    found = []
    for v, u in positions:
        row, column = (u, v) if swap else (v, u)
        found.append(places[(-row if flip_v else row, -column if flip_u else column)])
    return np.array(found)
