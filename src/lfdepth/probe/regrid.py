"""The grid that views were taken on, where they are read with another one.

Views that are numbered row by row differ little from one to the next, and much from the end of a row to the
start of the next: that shows how long rows are. Where all views are tiles of one picture and its number of
rows or columns is wrong, tiles are cut across; the picture is like itself one true tile further on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.boxes import box_mean
from lfdepth.lightfield import LightField, luma
from lfdepth.probe.matching import LIMIT, local_contrast, shrink_to

# Shorter side of the views that are compared, px, and how many of them are.
_SIDE, _MOST = 96, 128
# Ends of rows: by which factor nearly all of them differ more than nearly all other neighbours do.
_FURTHER, _NEARLY_ALL = 1.1, 0.9
# Tiles: at least so many px wide and high; lines of the picture that are compared; radius of their means.
_SMALLEST, _LINES, _AROUND = 24, 128, 8
# By which factor a picture has to be more like itself one tile further on than it is at other distances, and
# than it is one of the tiles further on that it was read with.
_MORE_ALIKE, _BETTER = 0.8, 0.95


def in_other_rows(lf: LightField) -> LightField | None:
    """The same views in rows of another length, if they show that they were taken so."""
    count = lf.shape[0] * lf.shape[1]
    if count < 4 or not lf.available.all():
        return None
    views = lf.views.reshape(1, count, *lf.shape[2:])
    length = _row_length(_steps(LightField(views)), count)
    if length is None or length == lf.shape[1]:
        return None
    return LightField(lf.views.reshape(count // length, length, *lf.shape[2:]), name=lf.name)


def in_other_tiles(lf: LightField) -> LightField | None:
    """The views of a picture that is cut into another number of tiles, if it shows how they lie."""
    v, u, height, width, channels = lf.shape
    if not lf.available.all():
        return None
    rows, columns = _tiles(lf.views.transpose(1, 0, 3, 2, 4)), _tiles(lf.views)
    if (rows, columns) == (v, u) or rows * columns < 2:
        return None
    picture = lf.views.transpose(0, 2, 1, 3, 4).reshape(v * height, u * width, channels)
    tiles = picture.reshape(rows, v * height // rows, columns, u * width // columns, channels)
    return LightField(np.ascontiguousarray(tiles.transpose(0, 2, 1, 3, 4)), name=lf.name)


def _steps(row: LightField) -> NDArray[np.float64]:
    """How much each of a row of views differs from the next."""
    shrink = shrink_to(row, _SIDE)
    first = local_contrast(row, (0, 0), shrink)
    found = []
    for u in range(1, min(row.shape[1], _MOST)):
        second = local_contrast(row, (0, u), shrink)
        found.append(float(np.minimum(np.abs(first - second), LIMIT).mean()))
        first = second
    return np.array(found)


def _row_length(steps: NDArray[np.float64], count: int) -> int | None:
    """After how many views rows end, if they do anywhere."""
    number = np.arange(1, len(steps) + 1)
    for length in range(2, count // 2 + 1):
        ends = number % length == 0
        if count % length or not ends.any():
            continue
        if np.quantile(steps[ends], 1 - _NEARLY_ALL) > _FURTHER * np.quantile(steps[~ends], _NEARLY_ALL):
            return length
    return None


def _tiles(views: NDArray[Any]) -> int:
    """How many columns of tiles are like the next in the picture of all views; as told if none are."""
    rows, told, height, tile, channels = map(int, views.shape)
    line = np.arange(0, rows * height, max(1, rows * height // _LINES))
    width = told * tile
    grey = luma(views[line // height, :, line % height].reshape(len(line), width, channels))
    detail = grey - box_mean(np.ascontiguousarray(grey, np.float32), _AROUND, np.float32)
    counts = [n for n in range(2, width // _SMALLEST + 1) if width % n == 0]
    if not counts:
        return told
    apart = {n: float(np.abs(detail[:, width // n :] - detail[:, : -(width // n)]).mean()) for n in counts}
    best = min(counts, key=apart.__getitem__)
    alike = apart[best] < _MORE_ALIKE * float(np.median(list(apart.values())))
    return best if alike and apart[best] < _BETTER * apart.get(told, np.inf) else told
