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
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.photo import ColourStack, photo_arguments, photo_plane
from lfdepth.blocks.reparam import round_width
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.blocks.visibility import NearestSurfaces
from lfdepth.engines.cpu.energy import store_photo_kernel
from lfdepth.engines.cpu.gloss import high_pass_kernel, label_kernel, probe_kernel
from lfdepth.engines.cpu.visibility import EMPTY
from lfdepth.engines.cpu.workers import Workers

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


def high_passed(stack: ColourStack, box: Box, workers: Workers) -> ColourStack:
    """Present views in a box, less their mean over 7×7 px, plus mid-grey.

    Means repeat the border of the image, and so do columns beyond it; the other columns around the box hold
    what the image has there. Views that are not present are left undefined.
    """
    rows, columns = stack.grid
    height, width = box.bottom - box.top, box.right - box.left
    length = round_width(width) + 2 * stack.margin
    source = stack.data.reshape(rows, columns, stack.size[0], stack.channels, stack.row_length)
    out = np.empty((rows, columns, height, stack.channels, length), source.dtype)
    views = np.argwhere(stack.present)
    workers.rows(
        len(views),
        high_pass_kernel,
        views,
        source,
        stack.margin,
        stack.size[1],
        (box.top, box.left),
        out,
    )
    return replace(stack, data=out.reshape(-1), size=(height, width), row_length=length)


def suspects(
    stack: ColourStack,
    thresholds: NDArray[np.float32],
    texture: NDArray[np.float32],
    planes: NDArray[np.float64],
    workers: Workers,
) -> NDArray[np.bool_]:
    """Cells whose high-passed views agree more often than the views themselves, and their neighbours.

    Parameters
    ----------
    stack
        Views.
    thresholds
        (H, W) colour differences below which two views agree, fractions of full scale.
    texture
        (H, W) weight of photo votes in [0, 1]; where there is no texture, high-passed views always agree.
    planes
        (K,) disparities.
    workers
        Threads.

    Returns
    -------
    (⌈H / CELL⌉, ⌈W / CELL⌉) bool; none where there are too few views to tell.
    """
    height, width = stack.size
    suspect = np.zeros((-(-height // CELL), -(-width // CELL)), np.bool_)
    probe = _outermost(stack)
    if np.count_nonzero(stack.present) < _FEWEST_VIEWS or np.count_nonzero(probe.present) < _FEWEST_PROBED:
        return suspect
    rows = np.minimum(np.arange(len(suspect)) * CELL + CELL // 2, height - 1)
    fine = _peaks(high_passed(probe, Box(0, height, 0, width), workers), thresholds, planes, rows, workers)
    rise = (fine - _peaks(probe, thresholds, planes, rows, workers)) * texture[rows]
    for axis, radius in enumerate(_WINDOW):
        rise = _running_mean(rise, radius, axis)
    padded = np.zeros((len(rows), suspect.shape[1] * CELL), np.bool_)
    padded[:, :width] = rise > _PROBED_RISE
    return _spread(np.asarray(padded.reshape(len(rows), -1, CELL).any(axis=2)))


def _outermost(stack: ColourStack) -> ColourStack:
    """The reference view, and of the grid's sides the corners and middles, as far as there are any."""
    down, across = (_ends_and_middle(count) for count in stack.grid)
    present, data = stack.present[down, across], stack.data.reshape(*stack.grid, -1)[down, across].reshape(-1)
    grid, stride = (present.shape[0], present.shape[1]), (down.step, across.step)
    return replace(stack, data=data, grid=grid, stride=stride, present=present)


def _ends_and_middle(count: int) -> slice:
    """The reference view's place among `count`, and the farthest that lie as far on either side."""
    middle, reach = count // 2, (count - 1) // 2
    return slice(middle - reach, middle + reach + 1, max(reach, 1))


def _peaks(
    stack: ColourStack,
    thresholds: NDArray[np.float32],
    planes: NDArray[np.float64],
    rows: NDArray[np.int64],
    workers: Workers,
) -> NDArray[np.float32]:
    """Largest share over planes at the pixels of some rows, (rows, W)."""
    peaks, shares = np.zeros((len(rows), stack.size[1]), np.float32), np.empty(stack.size, np.float32)
    for plane in planes:
        arguments = photo_arguments(stack, float(plane), thresholds)
        workers.rows(len(rows), probe_kernel, rows, peaks, shares, arguments)
    return peaks


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
    stack
        Views, those that vote being present.
    thresholds
        (H, W) fractions of full scale, of the reference view as it is.
    smoothing
        Filter for the shares.
    planes
        (K,) disparities.
    nearest
        Surfaces of the first map, which say what each view sees.
    """

    stack: ColourStack
    thresholds: NDArray[np.float32]
    smoothing: GuidedFilter
    planes: NDArray[np.float64]
    nearest: NearestSurfaces

    def shares(self, box: Box, own: NDArray[np.uint8], workers: Workers) -> NDArray[np.uint8] | None:
        """Shares (K, h, w) in a box, in 1/255; None where hardly any pixel's rise above the views' `own`."""
        voting = box.grown(2 * self.smoothing.radius, 2 * self.smoothing.radius, self.stack.size)
        reach = int(np.ceil(self.stack.grid[0] // 2 * np.abs(self.planes).max())) + 2
        source = voting.grown(reach, 0, self.stack.size)
        views, nearest = high_passed(self.stack, source, workers), _surfaces_in(self.nearest, source)
        guide = np.ascontiguousarray(self.smoothing.guide[voting.parts])
        smoothing = GuidedFilter(guide, self.smoothing.radius, self.smoothing.epsilon)
        thresholds = np.ascontiguousarray(self.thresholds[source.parts])
        rows, inner = voting.inside(source).parts[0], box.inside(voting).parts
        agreeing, share = np.empty(views.size, np.float32), np.empty(guide.shape[:2], np.float32)
        levels, out = np.empty(share.shape, np.uint8), np.empty(own.shape, np.uint8)

        def count(indices: Iterable[int]) -> None:
            for k in indices:
                photo_plane(
                    views,
                    float(self.planes[k]),
                    thresholds,
                    workers,
                    agreeing,
                    nearest,
                    rows=(rows.start, rows.stop),
                )
                smoothing.smooth_plane(agreeing[rows], workers, share)
                workers.rows(len(share), store_photo_kernel, share, levels)
                out[k] = levels[inner]

        count(range(0, len(out), _COARSE))
        if np.count_nonzero(_rises(out[::_COARSE], own[::_COARSE])) < _AREA:
            return None
        count(k for k in range(len(out)) if k % _COARSE != 0)
        return out


def _surfaces_in(nearest: NearestSurfaces, box: Box) -> NearestSurfaces:
    """Nearest surfaces for a box of the image, laid out like `high_passed` views."""
    height = nearest.disparity.shape[0]
    source = nearest.data.reshape(*nearest.grid, height, nearest.row_length)
    length = round_width(box.right - box.left) + 2 * nearest.margin
    data = np.full((*nearest.grid, box.bottom - box.top, length), EMPTY, np.int16)
    columns = source[:, :, box.top : box.bottom, box.left : box.left + length]
    data[..., : columns.shape[-1]] = columns
    rows = nearest.rows.reshape(source.shape[:3])[:, :, box.top : box.bottom].reshape(-1)
    disparity = np.ascontiguousarray(nearest.disparity[box.parts])
    return replace(nearest, data=data.reshape(-1), rows=rows, row_length=length, disparity=disparity)


def replace_shares(
    count: FineCount, photo: NDArray[np.uint8], cells: NDArray[np.bool_], workers: Workers
) -> NDArray[np.bool_]:
    """Put high-passed views' shares in place of those of glossy pixels.

    Parameters
    ----------
    count
        Counts votes of high-passed views.
    photo
        (K, H, W) shares of the views themselves, in 1/255; changed in place.
    cells
        `suspects`.
    workers
        Threads.

    Returns
    -------
    (H, W) bool, which pixels are glossy.
    """
    size = count.stack.size
    found = []
    for box in boxes(cells, size):
        fine = count.shares(box, photo[:, *box.parts], workers)
        if fine is not None:
            found.append((box, fine))
    rising, covered = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    for box, fine in found:
        rising[box.parts] = _rises(fine, photo[:, *box.parts])
        covered[box.parts] = True
    glossy = tidied(rising) & covered
    for box, fine in found:
        here = glossy[box.parts]
        photo[:, *box.parts][:, here] = fine[:, here]
    return glossy


def _rises(fine: NDArray[np.uint8], own: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Where the peak over planes of high-passed views lies above that of the views' own."""
    return np.asarray(fine.max(axis=0).astype(np.int16) - own.max(axis=0) > RISE * 255)


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
    across = mask.copy()
    across[:, 1:] |= mask[:, :-1]
    across[:, :-1] |= mask[:, 1:]
    out, source = across.copy(), across if corners else mask
    out[1:] |= source[:-1]
    out[:-1] |= source[1:]
    return out


def _small(mask: NDArray[np.bool_], area: int) -> NDArray[np.bool_]:
    """The regions of a mask that have at most `area` px."""
    labels = _labelled(mask)
    return np.asarray((np.bincount(labels.reshape(-1)) <= area)[labels] & mask)


def _labelled(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Numbers of the regions of a mask (H, W), from 1 on; 0 outside."""
    padded = np.pad(mask, 1)
    labels = np.zeros(padded.shape, np.int32)
    label_kernel(padded.reshape(-1), padded.shape[1], labels.reshape(-1))
    return labels[1:-1, 1:-1]


def _running_mean(image: NDArray[np.float32], radius: int, axis: int) -> NDArray[np.float32]:
    """Mean over 2·radius + 1 places along an axis, the border repeated."""
    border = [(0, 0), (0, 0)]
    border[axis] = (radius, radius)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, border, "edge"), 2 * radius + 1, axis)
    return np.asarray(windows.mean(axis=-1), np.float32)
