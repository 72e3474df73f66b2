"""The same light field with another of its views as the reference view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, grid_offsets


def check_view(lf: LightField, view: tuple[int, int]) -> tuple[int, int]:
    """The place of a view, row and column from 0; LightFieldError where there is none, or it is absent."""
    v, u = view
    rows, columns = lf.shape[:2]
    if not (0 <= v < rows and 0 <= u < columns):
        raise LightFieldError(
            f"{lf.name}: view {v},{u} asked for; expected a row from 0 to {rows - 1} and a column from 0 to "
            f"{columns - 1}; the reference view is {lf.centre[0]},{lf.centre[1]}"
        )
    if not lf.available[v, u]:
        raise LightFieldError(f"{lf.name}: view {v},{u} is absent; expected one that exists; choose another")
    return v, u


def from_view(lf: LightField, view: tuple[int, int]) -> LightField:
    """The light field as seen from another of its views, which becomes the reference view.

    Every method estimates the reference view's map, so that this gives the map of any view. The grid grows
    until the view is in its middle; the views that it gains are absent.

    Parameters
    ----------
    lf
        Light field.
    view
        Row and column of the view in the grid, from 0.

    Returns
    -------
    LightField
        With `2·max(v, V−1−v) + 1` rows of views, and as many columns alike. Truth and masks, which are those
        of the old reference view, are left out.

    Raises
    ------
    LightFieldError
        If there is no such view.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> corner = lfdepth.from_view(lf, (0, 0))
    >>> corner.shape, corner.centre
    ((9, 9, 64, 64, 3), (4, 4))
    >>> bool((corner.reference == lf.views[0, 0]).all())
    True
    """
    v, u = check_view(lf, view)
    if (v, u) == lf.centre:
        return lf
    rows, columns = lf.shape[:2]
    down, across = max(v, rows - 1 - v), max(u, columns - 1 - u)
    grid = (2 * down + 1, 2 * across + 1)
    place = (slice(down - v, down - v + rows), slice(across - u, across - u + columns))
    views = np.zeros((*grid, *lf.shape[2:]), lf.views.dtype)  # pages of absent views are never touched
    views[place] = lf.views
    present = np.zeros(grid, np.bool_)
    present[place] = lf.available
    positions = None
    if lf.positions is not None:
        positions = np.zeros((*grid, 2))
        positions[place] = lf.offsets - lf.offsets[v, u] - grid_offsets(grid)[place]
    return replace(
        lf,
        views=views,
        present=present,
        positions=positions,
        truth=None,
        masks={},
        name=f"{lf.name}, view {v},{u}",
    )
