"""Gloss: where highlights wander over a surface, photo votes are counted on high-passed views.

A highlight lies at a disparity of its own, and its smooth brightness, added to the surface's, makes views
differ at the surface's disparity and agree at another: signs and photo votes follow the highlight. The
surface's texture, however, is under it still. A view less its local mean, over 7×7 px, keeps the texture and
loses what is smooth, so that views agree again where the surface is. Everywhere else the subtraction only
makes noise stronger, and wrong disparities more alike: it is done where it raises the share of views that
agree, and the first map says which views see what, as in the second count.

1. A probe with few views, every eighth row and no visibility finds the cells that are worth a look. On most
   light fields there are none.
2. In the boxes around them all votes are counted on high-passed views. A pixel is glossy where their peak
   rises above that of the views' own.
3. The regions of such pixels, tidied, take over the high-passed views' shares.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines.base import Array, ColourViews, Engine
from lfdepth.engines.layout import SHARE_LEVELS

CELL = 8
"""Distance in px of the probed rows, and the side of a cell."""

RISE = 0.1
"""Rise of a pixel's peak, as a share of the views, that makes it glossy."""

WEIGHT = 2.0
"""Of photo votes where signs do not vote."""

_FEWEST_PROBED, _FEWEST_VIEWS = 5, 9
_PROBED_RISE = 0.07  # mean over a window of probed pixels that makes a cell suspect
_WINDOW = (1, 12)  # its radii in probed rows and px
_GAP = 4  # cells; boxes nearer to each other are one
_TILE = 256  # px, largest side of a box that is counted at once: bounds memory
_COARSE = 3  # every so many planes tell whether a box is worth all of them
_AREA, _HOLE, _GROW = 30, 200, 2  # px: least region, largest hole that is filled, growth


class Box(NamedTuple):
    """Pixels [top, bottom) × [left, right)."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def parts(self) -> tuple[slice, slice]:
        """Index of the box's pixels in an (H, W) image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, down: int, across: int, size: tuple[int, int]) -> Box:
        """The box with a margin, within an image of this size."""
        return Box(
            max(self.top - down, 0),
            min(self.bottom + down, size[0]),
            max(self.left - across, 0),
            min(self.right + across, size[1]),
        )

    def inside(self, outer: Box) -> Box:
        """The box, counted from the corner of one that holds it."""
        return Box(
            self.top - outer.top, self.bottom - outer.top, self.left - outer.left, self.right - outer.left
        )


def suspects(
    engine: Engine,
    views: ColourViews,
    thresholds: Array,
    texture: NDArray[np.float32],
    planes: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Cells whose high-passed views agree more often than the views themselves, and their neighbours.

    Parameters
    ----------
    engine
        Engine.
    views
        All views.
    thresholds
        (H, W) colour differences below which two views agree, fractions of full scale; the engine's.
    texture
        (H, W) weight of photo votes in [0, 1]; where there is no texture, high-passed views always agree.
    planes
        (K,) disparities.

    Returns
    -------
    (⌈H / CELL⌉, ⌈W / CELL⌉) bool; none where there are too few views to tell.
    """
    height, width = views.size
    suspect = np.zeros((-(-height // CELL), -(-width // CELL)), np.bool_)
    grid = views.present.shape[0], views.present.shape[1]
    probed = views.present & outermost(grid)
    if np.count_nonzero(views.present) < _FEWEST_VIEWS or np.count_nonzero(probed) < _FEWEST_PROBED:
        return suspect
    probe = engine.subgrid(views, *_outermost(grid))
    rows = np.minimum(np.arange(len(suspect)) * CELL + CELL // 2, height - 1)
    whole = engine.high_passed(probe, Box(0, height, 0, width).parts)
    fine = engine.photo_peaks(whole, planes, thresholds, rows)
    rise = (fine - engine.photo_peaks(probe, planes, thresholds, rows)) * texture[rows]
    for axis, radius in enumerate(_WINDOW):
        rise = _running_mean(rise, radius, axis)
    padded = np.zeros((len(rows), suspect.shape[1] * CELL), np.bool_)
    padded[:, :width] = rise > _PROBED_RISE
    suspect[:] = padded.reshape(len(rows), -1, CELL).any(axis=2)
    return _spread(suspect) if suspect.any() else suspect


def _outermost(grid: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the reference view, and of the grid's sides the corners and middles."""
    return _ends_and_middle(grid[0]), _ends_and_middle(grid[1])


def outermost(grid: tuple[int, int]) -> NDArray[np.bool_]:
    """(V, U), which views `suspects` looks at."""
    looked_at = np.zeros(grid, np.bool_)
    looked_at[_outermost(grid)] = True
    return looked_at


def _ends_and_middle(count: int) -> slice:
    """The reference view's place among `count`, and the farthest that lie as far on either side."""
    middle, reach = count // 2, (count - 1) // 2
    return slice(middle - reach, middle + reach + 1, max(reach, 1))


def touched(shape: tuple[int, ...], part: tuple[slice, slice]) -> NDArray[np.bool_]:
    """Which cells a part of the picture, rows and columns, has pixels in."""
    cells = np.zeros(shape, np.bool_)
    rows, columns = (slice(each.start // CELL, -(-each.stop // CELL)) for each in part)
    cells[rows, columns] = True
    return cells


def boxes(cells: NDArray[np.bool_], size: tuple[int, int]) -> list[Box]:
    """Boxes in px around groups of cells, in an image of this size.

    Boxes nearer to each other than a few cells are one; large ones are divided into tiles.
    """
    labels = _labelled(cells)
    found: list[Box] = []
    for label in range(1, labels.max() + 1):
        y, x = np.nonzero(labels == label)
        found = _joined(found, Box(int(y.min()), int(y.max()) + 1, int(x.min()), int(x.max()) + 1))
    scaled = (Box(*(CELL * side for side in box)).grown(0, 0, size) for box in found)
    return [tile for box in scaled for tile in _tiles(box)]


def _joined(found: list[Box], box: Box) -> list[Box]:
    """Boxes far from each other, and one more, joined with those that are near."""
    for i, other in enumerate(found):
        gap = max(
            max(other.top, box.top) - min(other.bottom, box.bottom),
            max(other.left, box.left) - min(other.right, box.right),
        )
        if gap < _GAP:
            both = Box(
                min(other.top, box.top),
                max(other.bottom, box.bottom),
                min(other.left, box.left),
                max(other.right, box.right),
            )
            return _joined(found[:i] + found[i + 1 :], both)
    return [*found, box]


def _tiles(box: Box) -> Iterable[Box]:
    """A box in parts of about equal size, none of whose sides is too long."""
    y, x = (
        np.linspace(first, last, -(-(last - first) // _TILE) + 1).astype(int).tolist()
        for first, last in ((box.top, box.bottom), (box.left, box.right))
    )
    return (Box(y[i], y[i + 1], x[j], x[j + 1]) for i in range(len(y) - 1) for j in range(len(x) - 1))


@dataclass(frozen=True, eq=False)
class FineCount:
    """Counts photo votes of high-passed views, as the second count does those of the views themselves.

    Attributes
    ----------
    engine
        Engine.
    views
        Views, those that vote being present.
    thresholds
        (H, W) fractions of full scale, of the reference view as it is; on the host.
    smoothing
        Filter for the shares.
    planes
        (K,) disparities.
    surfaces
        Nearest surfaces of the first map, which say what each view sees.
    """

    engine: Engine
    views: ColourViews
    thresholds: NDArray[np.float32]
    smoothing: GuidedFilter
    planes: NDArray[np.float64]
    surfaces: object

    def shares(self, box: Box, own: Array) -> Array | None:
        """Shares (K, h, w) in a box, in 1/255; None where hardly any pixel's rise above the views' `own`."""
        engine, radius = self.engine, self.smoothing.radius
        voting = box.grown(2 * radius, 2 * radius, self.views.size)
        farthest = float(np.abs(self.views.offsets[..., 0]).max())
        reach = int(np.ceil(farthest * np.abs(self.planes).max())) + 2
        source = voting.grown(reach, 0, self.views.size)
        views = engine.high_passed(self.views, source.parts)
        surfaces = engine.surfaces_in(self.surfaces, source.parts)
        guide = np.ascontiguousarray(self.smoothing.guide[voting.parts])
        smoothing = GuidedFilter(guide, radius, self.smoothing.epsilon, engine=engine)
        thresholds = engine.upload(self.thresholds[source.parts])
        rows, inner = voting.inside(source).parts[0], box.inside(voting).parts
        agreeing, share = (engine.empty(size, np.float32) for size in (views.size, guide.shape[:2]))
        levels = engine.empty((len(self.planes), *guide.shape[:2]), np.uint8)
        out = levels[:, *inner]

        def count(indices: Iterable[int]) -> None:
            for k in indices:
                plane, wanted = float(self.planes[k]), (rows.start, rows.stop)
                engine.photo(views, plane, thresholds, agreeing, surfaces=surfaces, rows=wanted)
                smoothing.smooth(agreeing[rows], share)
                engine.store_shares(share, levels[k])

        count(range(0, len(out), _COARSE))
        if np.count_nonzero(_rises(engine, out[::_COARSE], own[::_COARSE])) < _AREA:
            return None
        count(k for k in range(len(out)) if k % _COARSE != 0)
        return out


def replace_shares(count: FineCount, shares: Array, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Put high-passed views' shares in place of those of glossy pixels.

    Parameters
    ----------
    count
        Counts votes of high-passed views.
    shares
        (K, H, W) shares of the views themselves, in 1/255; the engine's, changed in place.
    cells
        `suspects`.

    Returns
    -------
    (H, W) bool, which pixels are glossy.
    """
    size, engine = count.views.size, count.engine
    found = []
    for box in boxes(cells, size):
        fine = count.shares(box, shares[:, *box.parts])
        if fine is not None:
            found.append((box, fine))
    rising, covered = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    for box, fine in found:
        rising[box.parts] = _rises(engine, fine, shares[:, *box.parts])
        covered[box.parts] = True
    glossy = tidied(rising) & covered
    for box, fine in found:
        engine.put_where(shares[:, *box.parts], glossy[box.parts], fine)
    return glossy


def _rises(engine: Engine, fine: Array, own: Array) -> NDArray[np.bool_]:
    """Where the peak over planes of high-passed views lies above that of the views' own."""
    return np.asarray(engine.peak(fine).astype(np.int16) - engine.peak(own) > RISE * SHARE_LEVELS)


def tidied(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Opened by 3×3 px, without small regions, grown, and small holes filled.

    The white core of a highlight is such a hole: its texture is lost, and views agree at the highlight's
    disparity.
    """
    opened = _spread(~_spread(~mask))
    grown = opened & ~_small(opened, _AREA - 1)
    for _ in range(_GROW):
        grown = _spread(grown, corners=False)
    return grown | _small(~grown, _HOLE)


def _spread(mask: NDArray[np.bool_], *, corners: bool = True) -> NDArray[np.bool_]:
    """A mask and its pixels' four neighbours, and the diagonal ones with `corners`."""
    from scipy import ndimage  # loaded only where something glossy was found

    neighbours = ndimage.generate_binary_structure(2, 2 if corners else 1)
    return np.asarray(ndimage.binary_dilation(mask, neighbours))


def _small(mask: NDArray[np.bool_], area: int) -> NDArray[np.bool_]:
    """The regions of a mask that have at most `area` px."""
    labels = _labelled(mask)
    return np.asarray((np.bincount(labels.reshape(-1)) <= area)[labels] & mask)


def _labelled(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Numbers of the regions of a mask (H, W), connected by their sides, from 1 on; 0 outside."""
    from scipy import ndimage

    return np.asarray(ndimage.label(mask)[0], np.int32)


def _running_mean(image: NDArray[np.float32], radius: int, axis: int) -> NDArray[np.float32]:
    """Mean over 2·radius + 1 places along an axis, the border repeated."""
    border = [(0, 0), (0, 0)]
    border[axis] = (radius, radius)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, border, "edge"), 2 * radius + 1, axis)
    return np.asarray(windows.mean(axis=-1), np.float32)
