"""The grid of views: its size from a count, and which of its views are there."""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError


@dataclass(frozen=True)
class Layout:
    """What the caller knows of a grid that its files may not say.

    Parameters
    ----------
    grid : tuple of int, optional
        (V, U), rows and columns of views as they are stored.
    partial : bool
        Absent views are meant, whatever pattern they form.
    pattern : str, optional
        Which files of a folder are views, such as ``"shot_*.png"`` or ``"*/000.png"``.
    axes : str, optional
        Order of the axes of an array, such as ``"WHUV"``: V, U, H, W, C, or N for a running number of views.
    """

    grid: tuple[int, int] | None = None
    partial: bool = False
    pattern: str | None = None
    axes: str | None = None

    def of_count(self, count: int, what: str) -> tuple[int, int]:
        """Grid of views that are only numbered: as asked for, else a square.

        Raises
        ------
        LightFieldError
            If no grid was given and `count` is no square.
        """
        side = isqrt(count) if count else -1
        grid = self.grid or (side, side)
        if grid[0] * grid[1] == count or (self.grid and self.partial):
            return grid
        if self.grid:
            raise LightFieldError(
                f"{what}: {count} views; expected {grid[0] * grid[1]} in a grid of {size(grid)}; "
                "change the grid, or, if views are missing on purpose, say so (partial)"
            )
        raise LightFieldError(
            f"{what}: {count} views; expected a square number of views, or a grid; give its columns x rows "
            "(--grid)"
        )

    def checked(self, present: npt.NDArray[np.bool_], what: str, first: str) -> npt.NDArray[np.bool_] | None:
        """Which views are there: None for all of them.

        Some may be absent if the caller says so, or if those left lie symmetrically about the reference view
        (the centre cross, the diagonals), which no failed copy leaves.

        Raises
        ------
        LightFieldError
            If views are absent and it is not meant; `first` names one of them.
        """
        if present.size and present.all():
            return None
        if present.any() and (self.partial or _symmetric(present)):
            return present
        raise LightFieldError(
            f"{what}: {np.count_nonzero(~present)} of {present.size} views missing, first {first}; "
            f"expected a grid of {size(present.shape)}; add them, or, if they are missing on purpose, say so "
            "(partial)"
        )


def _symmetric(present: npt.NDArray[np.bool_]) -> bool:
    """Whether each absent view has an absent mirror image about the reference view, which is there."""
    v, u = present.shape
    # The first row and column of an even grid have no mirror image: a view absent there is missing.
    mirrored = np.pad(present, ((0, 1 - v % 2), (0, 1 - u % 2)), constant_values=True)
    return bool(present[v // 2, u // 2]) and np.array_equal(mirrored, mirrored[::-1, ::-1])


def size(grid: tuple[int, ...]) -> str:
    """Columns x rows, as people write it."""
    return f"{grid[1]}x{grid[0]}"
