"""From views to a map by a trained network: stacks, tiles, turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.learned.forward import Forward, tiles
from lfdepth.learned.lfattnet import VIEWS, lfattnet_arrays, lfattnet_onnx
from lfdepth.learned.shape import EPINETS, EpinetShape
from lfdepth.learned.stacks import Position, stacks
from lfdepth.learned.weights import check_arrays, read_arrays, shipped
from lfdepth.lightfield import LightField, luma

Float = npt.NDArray[np.float32]
Network = Callable[[Float], Float]
"""Takes stacks (4, views, H, W), gives disparity (H - lost, W - lost)."""
Turn = tuple[bool, bool, bool]
"""Mirror rows, mirror columns, transpose (first)."""

TURNS: tuple[Turn, ...] = tuple((bool(g & 1), bool(g & 2), bool(g & 4)) for g in (0, 3, 4, 7, 1, 2, 5, 6))
"""All ways of turning and mirroring a picture."""

_NEAR = 0.7
"""Weight of the nearest of what lies within the field of view, where views are moved to look again."""
_FARTHEST = 4.0
"""Largest disparity either way that networks were trained on, px per view step."""
_SPLINE = 8
"""How far a value has a part in a cubic spline, px."""


def network_of(name: str, weights: str | None) -> Network:
    """The network of a method with weights of a file, or else with those of the package.

    Raises
    ------
    LightFieldError
        If there are no weights, or the file's cannot be used.
    """
    path = Path(weights) if weights is not None else shipped(name)
    if path is None:
        raise LightFieldError(
            f"{name}: found no weights, expected a file; train them with lfdepth train {name}, import the "
            f"authors' with lfdepth weights import {name} FILE.hdf5 and give them with --weights, or use "
            "epinet-s, whose weights come with lfdepth"
        )
    return _loaded(name, path, _changed(path, name))


@lru_cache(maxsize=2)
def _loaded(name: str, path: Path, changed: int) -> Network:
    shape = EPINETS[name]
    if path.suffix.lower() == ".onnx":
        from lfdepth.learned.onnx_running import OnnxNetwork

        return OnnxNetwork(path, (4, shape.views), name)
    arrays = read_arrays(path)
    check_arrays(path, arrays, shape.arrays(), name)
    return Forward(shape, arrays)


def lfattnet_of(weights: str | None) -> Network:
    """LFAttNet with weights of a file, NPZ or ONNX; takes views (81, H, W).

    Raises
    ------
    LightFieldError
        If there are no weights, the file's cannot be used, or onnxruntime is not installed.
    """
    if weights is None:
        raise LightFieldError(
            "lfattnet: found no weights, expected a file; train them with lfdepth train lfattnet and give "
            "them with --weights, or use epinet-s, whose weights come with lfdepth"
        )
    path = Path(weights)
    return _lfattnet(path, _changed(path, "lfattnet"))


@lru_cache(maxsize=1)
def _lfattnet(path: Path, changed: int) -> Network:
    from lfdepth.learned.onnx_running import OnnxNetwork

    leading = (VIEWS * VIEWS,)
    if path.suffix.lower() == ".onnx":
        return OnnxNetwork(path, leading, "lfattnet")
    arrays = read_arrays(path)
    check_arrays(path, arrays, lfattnet_arrays(), "lfattnet")
    return OnnxNetwork(path, leading, "lfattnet", lfattnet_onnx(arrays))


def _changed(path: Path, name: str) -> int:
    """When a file was written last."""
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise LightFieldError(
            f"{path}: cannot be read ({error.strerror}), expected weights of {name}; give another file"
        ) from None


def check_grid(name: str, grid: tuple[int, int], across: int) -> None:
    """Raise LightFieldError unless there are as many views along either axis as a network takes."""
    if grid != (across, across):
        remedy = "use a method that takes any grid, such as fbs-vis"
        if min(grid) >= across:
            remedy = f"take the middle ones with --views {across}x{across}"
        raise LightFieldError(
            f"{name}: found {grid[0]}x{grid[1]} views, expected {across}x{across}; {remedy}"
        )


def stack_views(across: int) -> list[Position]:
    """The views that EPINET looks at, each once."""
    return list(dict.fromkeys(position for stack in stacks(across) for position in stack))


def grey_views(lf: LightField, positions: Sequence[Position]) -> dict[Position, Float]:
    """Views (H, W), grey in 0..1, by position."""
    v, u = lf.centre
    return {
        position: luma(lf.views[v + position[0], u + position[1]]) / np.float32(lf.full_scale)
        for position in positions
    }


def predict_views(
    network: Network, grey: dict[Position, Float], side: int, margin: int, multiple: int
) -> Float:
    """Disparity (H, W) by a network that takes all views (N, h, w), in tiles with `margin` px around them.

    Views are continued beyond their borders by the values there; h and w are multiples of `multiple`.
    """
    height, width = grey[(0, 0)].shape
    views = np.stack([np.pad(grey[place], margin, "edge") for place in sorted(grey)])
    found = np.empty((height, width), np.float32)
    for rows, columns in tiles(height, width, side):
        part = views[:, rows.start : rows.stop + 2 * margin, columns.start : columns.stop + 2 * margin]
        more = [(0, -size % multiple) for size in part.shape[1:]]
        tile = network(np.ascontiguousarray(np.pad(part, [(0, 0), *more], "edge")))
        inner = (
            slice(margin, margin + rows.stop - rows.start),
            slice(margin, margin + columns.stop - columns.start),
        )
        found[rows, columns] = tile[inner]
    return found


def predict(
    network: Network, grey: dict[Position, Float], shape: EpinetShape, turn: Turn, side: int
) -> Float:
    """Disparity (H, W) of views that are turned before and turned back after.

    Views are continued beyond their borders by the values there.
    """
    border = shape.lost // 2
    padded = {place: np.pad(view, border, "edge") for place, view in grey.items()}
    height, width = grey[(0, 0)].shape
    found = np.empty((height, width), np.float32)
    for rows, columns in tiles(height, width, side):
        part = slice(rows.start, rows.stop + 2 * border), slice(columns.start, columns.stop + 2 * border)
        found[rows, columns] = _turn_there_and_back(
            network, {place: view[part] for place, view in padded.items()}, shape, turn
        )
    return found


def _turn_there_and_back(
    network: Network, grey: dict[Position, Float], shape: EpinetShape, turn: Turn
) -> Float:
    """Disparity (H - lost, W - lost) of views (H, W) that are turned before and turned back after."""
    flip_v, flip_u, swap = turn
    turned = [
        np.stack([_turned(grey[_source(place, turn)], turn) for place in stack])
        for stack in stacks(shape.views)
    ]
    found = network(np.stack(turned))
    back = found.T if swap else found
    return np.ascontiguousarray(back[:: -1 if flip_v else 1, :: -1 if flip_u else 1])


def look_again(network: Network, seen: Seen, shape: EpinetShape, turn: Turn, side: int) -> Float:
    """Disparity (H, W) of views that are enlarged, and moved so that what a pixel sees lies near 0.

    A network errs by so many of the pixels that it is given, and the less, the nearer to 0 a disparity is.
    Views that are enlarged `seen.times`, and moved by a whole number of their pixels per view step, show the
    disparity d as times · d minus that number, exactly but for the enlarging.

    Parameters
    ----------
    side
        Side of the tiles that are computed at a time, px of enlarged views.
    seen
        What `enlarged` found.
    """
    times, border = seen.times, shape.lost // 2
    height, width = seen.moves.shape
    found = np.empty((height, width), np.float32)
    for rows, columns in tiles(height, width, max(1, side // times)):
        tile = seen.moves[rows, columns]
        for move in np.unique(tile):
            asked = tile == move
            box = tuple(slice(int(each.min()), int(each.max()) + 1) for each in np.nonzero(asked))
            starts = [
                seen.margin - border + times * (part.start + inner.start)
                for part, inner in zip((rows, columns), box, strict=True)
            ]
            sizes = [times * (inner.stop - inner.start) + 2 * border for inner in box]
            views = {
                (v, u): view[starts[0] - move * v :, starts[1] - move * u :][: sizes[0], : sizes[1]]
                for (v, u), view in seen.views.items()
            }
            moved = _turn_there_and_back(network, views, shape, turn)
            blocks = moved.reshape(moved.shape[0] // times, times, -1, times).swapaxes(1, 2)
            middle = np.median(blocks.reshape(*blocks.shape[:2], -1), axis=2)
            found[rows, columns][asked] = ((middle + move) / times)[asked[box]]
    return found


@dataclass(frozen=True)
class Seen:
    """What is looked at again.

    Attributes
    ----------
    views
        Enlarged views, continued beyond their borders by the values there.
    moves
        (H, W), how far views are moved for each pixel, px of enlarged views per view step.
    times
        How many times views were enlarged.
    margin
        How far they were continued, px of enlarged views.
    """

    views: dict[Position, Float]
    moves: npt.NDArray[np.int64]
    times: int
    margin: int


def seen_field(shape: EpinetShape, times: int) -> int:
    """Field of view of a network in views that are enlarged, px of the views as they were."""
    return (shape.lost + 1) // times


def margin_px(shape: EpinetShape, times: int, farthest: float = _FARTHEST) -> int:
    """How far views are continued before they are enlarged, for moves of up to `farthest` px, px."""
    return ceil(shape.views // 2 * farthest + shape.lost / 2 / times) + _SPLINE


def enlarged(grey: dict[Position, Float], coarse: Float, shape: EpinetShape, times: int) -> Seen:
    """Enlarge views, and find how they are to be moved, by a first map (H, W).

    Of what lies within the field of view, the nearest counts 0.7 and the farthest 0.3: so both are near 0,
    and what hides the other more so.
    """
    from scipy import ndimage  # here, since listing the methods needs no SciPy

    field = seen_field(shape, times)
    near, far = ndimage.maximum_filter(coarse, field), ndimage.minimum_filter(coarse, field)
    wanted = np.clip(_NEAR * near + (1 - _NEAR) * far, -_FARTHEST, _FARTHEST)
    moves = np.rint(times * wanted).astype(np.int64)
    around = margin_px(shape, times, float(np.abs(moves).max(initial=0)) / times)
    views = {
        place: ndimage.zoom(
            np.pad(view, around, "edge"), times, order=3, mode="nearest", grid_mode=True
        ).clip(0, 1)
        for place, view in grey.items()
    }
    return Seen(views, moves, times, around * times)


def _turned(picture: Float, turn: Turn) -> Float:
    """Pixel (i, j) is the old one's (i', j'): exchanged where `swap`, then mirrored."""
    flip_v, flip_u, swap = turn
    mirrored = picture[:: -1 if flip_v else 1, :: -1 if flip_u else 1]
    return mirrored.T if swap else mirrored


def _source(position: Position, turn: Turn) -> Position:
    """The view that takes a place, as `stacks.turned` has it."""
    flip_v, flip_u, swap = turn
    v, u = position[::-1] if swap else position
    return (-v if flip_v else v, -u if flip_u else u)


def confidence(grey: dict[Position, Float], disparity: Float, across: int) -> Float:
    """How well four inner views agree with the reference view at a map's disparities, (H, W) in 0..1.

    exp(−d / (c + 1/255)), where d is the lower median of the differences, and c how much a pixel differs from
    its neighbours.
    """
    reference = grey[(0, 0)]
    height, width = reference.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    reach = min(2, across // 2)
    differences = []
    for v, u in ((0, -reach), (0, reach), (-reach, 0), (reach, 0)):
        y, x = rows - disparity * np.float32(v), columns - disparity * np.float32(u)
        differences.append(np.abs(_sampled(grey[(v, u)], y, x) - reference))
    contrast = sum(np.abs(np.gradient(reference, axis=axis)) for axis in (0, 1))
    typical = np.sort(np.stack(differences), axis=0)[1]  # two of four views may be hidden
    return np.asarray(np.exp(-typical / (contrast + np.float32(1 / 255))), np.float32)


def _sampled(picture: Float, y: Float, x: Float) -> Float:
    """Bilinear samples of a picture, continued beyond its borders."""
    height, width = picture.shape
    y, x = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
    top, left = np.minimum(y.astype(int), height - 2), np.minimum(x.astype(int), width - 2)
    down, right = y - top, x - left
    upper = picture[top, left] * (1 - right) + picture[top, left + 1] * right
    lower = picture[top + 1, left] * (1 - right) + picture[top + 1, left + 1] * right
    return np.asarray(upper * (1 - down) + lower * down, np.float32)
