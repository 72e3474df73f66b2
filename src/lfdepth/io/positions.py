"""Where cameras stand: positions from a table, and how far they lie off the regular grid."""

from __future__ import annotations

import csv
from math import isfinite
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.layout import size
from lfdepth.io.limits import read_text
from lfdepth.lightfield import reference_index

Array = npt.NDArray[np.float64]

TABLE = "positions.csv"
"""Table of positions that is read on its own beside the pictures of a folder."""

SAME_STEPS = 0.01
"""Steps along the two axes that differ by less are the same."""

# Closer than this share of a view step, a grid is regular: 0.01 px at a disparity of 10 px.
_REGULAR = 1e-3
# Further off, a camera is nearer to another one's place: views are in another order.
_IN_PLACE = 0.75
_COLUMNS = ("v", "u", "y", "x")


def read_positions(path: Path, grid: tuple[int, int]) -> Array:
    """Read a table of camera positions.

    Parameters
    ----------
    path : Path
        CSV with a line `v,u,y,x` for each view: row and column of the grid from 0, as it is stored, and the
        camera's position downwards and to the right, in any unit. A first line may name the columns, in any
        order.
    grid : tuple of int
        (V, U).

    Returns
    -------
    ndarray, shape (V, U, 2)
        float64; NaN for views that the table does not have.

    Raises
    ------
    LightFieldError
        If the table is missing or garbled, names a view outside the grid or one twice.
    """
    positions = np.full((*grid, 2), np.nan)
    for number, (v, u, y, x) in _rows(path):
        if not (v.is_integer() and u.is_integer() and 0 <= v < grid[0] and 0 <= u < grid[1]):
            raise LightFieldError(
                f"{path}: line {number} is about view ({v:g}, {u:g}); expected rows 0 to {grid[0] - 1} and "
                f"columns 0 to {grid[1] - 1} of a grid of {size(grid)}; fix the table or the grid"
            )
        if not np.isnan(positions[int(v), int(u), 0]):
            raise LightFieldError(
                f"{path}: line {number} is about view ({v:g}, {u:g}) again; expected one line per view; "
                "remove one"
            )
        positions[int(v), int(u)] = y, x
    return positions


def off_the_grid(positions: Array, present: npt.NDArray[np.bool_] | None, what: str) -> Array | None:
    """How far each view lies from its place in the regular grid that fits the positions best.

    The grid is the one with the least squared distances: one origin, one step along rows and one along
    columns. Which of the two coordinates runs along which is found out from them.

    Parameters
    ----------
    positions : ndarray, shape (V, U, 2)
        In any unit; NaN where a view is absent.
    present : ndarray, shape (V, U), optional
        Which views exist.
    what : str
        Name for messages.

    Returns
    -------
    ndarray, shape (V, U, 2), or None
        (down, right) in view steps, counted from the reference view; 0 for absent views. None for a regular
        grid.

    Raises
    ------
    LightFieldError
        If a view has no position, views of different places have the same, or cameras stand so far off that
        the views' order is wrong.
    """
    there = np.ones(positions.shape[:2], bool) if present is None else present
    lacking = there & ~np.isfinite(positions).all(axis=-1)
    if lacking.any():
        v, u = np.argwhere(lacking)[0]
        raise LightFieldError(
            f"{what}: {np.count_nonzero(lacking)} views have no position, first view ({v}, {u}); "
            "expected one for each view; add them to the table"
        )
    fits = [_fit(positions[..., order], there) for order in ([0, 1], [1, 0])]
    known = [fit for fit in fits if fit is not None]
    if not known:
        raise LightFieldError(
            f"{what}: camera positions do not advance from view to view; expected a step along rows and "
            "along columns; fix the positions"
        )
    offsets = min(known, key=lambda fit: float(np.abs(fit).max()))
    offsets -= offsets[reference_index(positions.shape[:2])]
    offsets[~there] = 0
    furthest = float(np.abs(offsets).max())
    if furthest > _IN_PLACE:
        raise LightFieldError(
            f"{what}: cameras are up to {furthest:.2g} view steps away from their place in the grid; "
            f"expected less than {_IN_PLACE:g}; {_remedy(positions, there)}"
        )
    return None if furthest < _REGULAR else offsets


def step_ratio(positions: Array, present: npt.NDArray[np.bool_] | None) -> float | None:
    """Step down over step to the right of the grid that fits best; None for a single row or column."""
    there = np.ones(positions.shape[:2], bool) if present is None else present
    if 1 in positions.shape[:2] or not np.isfinite(positions[there]).all():
        return None
    places = np.indices(positions.shape[:2]).astype(float)
    down, right = (
        max(abs(_step(places[axis][there], positions[there][:, i]) or 0.0) for i in (0, 1)) for axis in (0, 1)
    )
    return down / right if right else None


def _remedy(positions: Array, there: npt.NDArray[np.bool_]) -> str:
    """What puts views in order whose cameras stand far off their places, if it is known."""
    back = positions.copy()
    back[1::2] = back[1::2, ::-1]
    fits = [_fit(back[..., order], there) for order in ([0, 1], [1, 0])]
    if there.all() and any(fit is not None and np.abs(fit).max() < _IN_PLACE for fit in fits):
        return "read every second row backwards (--serpentine)"
    return "fix the order of the views, or the table of positions"


def _fit(positions: Array, there: npt.NDArray[np.bool_]) -> Array | None:
    """Distances from the best grid in its steps; None where views along an axis have no step between them."""
    places = np.indices(positions.shape[:2]).astype(float)
    spread = float(np.ptp(positions[there], axis=0).max())
    steps = [_step(places[axis][there], positions[there][:, axis]) for axis in (0, 1)]
    if any(
        step is not None and not abs(step) * positions.shape[i] > 1e-3 * spread
        for i, step in enumerate(steps)
    ):
        return None
    offsets = np.empty(positions.shape)
    for axis, (step, other) in enumerate(zip(steps, steps[::-1], strict=True)):
        # A single row has no step downwards: what its cameras stray across it counts in steps along it.
        unit = step if step is not None else abs(other or 1.0)
        grid = (step or 0.0) * places[axis]
        origin = np.mean((positions[..., axis] - grid)[there])
        offsets[..., axis] = (positions[..., axis] - origin - grid) / unit
    return offsets


def _step(places: Array, positions: Array) -> float | None:
    """Least-squares step from one place to the next; None where all are in one place."""
    from_mean = places - places.mean()
    squares = float(from_mean @ from_mean)
    return float(from_mean @ positions) / squares if squares else None


def _rows(path: Path) -> list[tuple[int, tuple[float, float, float, float]]]:
    """Number of the line, and v, u, y, x."""
    try:
        lines = read_text(path).removeprefix("\ufeff").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise LightFieldError(
            f"{path}: {reason}; expected a table with v,u,y,x of each view; check the path"
        ) from None
    table = [(n, [cell.strip() for cell in row]) for n, row in enumerate(csv.reader(lines), 1) if any(row)]
    order = [0, 1, 2, 3]
    if table and (names := [name.lower() for name in table[0][1]]) and set(_COLUMNS) <= set(names):
        order = [names.index(name) for name in _COLUMNS]
        table = table[1:]
    found = []
    for number, row in table:
        try:
            v, u, y, x = (float(row[at]) for at in order)
            if not all(map(isfinite, (v, u, y, x))):
                raise ValueError
        except (ValueError, IndexError):
            raise LightFieldError(
                f"{path}: line {number} is {','.join(row)[:60]!r}; expected four numbers v,u,y,x, "
                "separated by commas; fix the line"
            ) from None
        found.append((number, (v, u, y, x)))
    return found
