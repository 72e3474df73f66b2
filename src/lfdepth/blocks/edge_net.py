"""Pixels beside depth edges given to the nearer or the farther surface by a small network.

Nearly all that is wrong by much in a map lies beside its jumps, on the wrong side of them: it has the
disparity of one surface and belongs to the other. Which one that is, a pixel's own colour tells where it is
near one of the surfaces' (`edges`); more is told by everything together: the colours of the 7×7 pixels
around, each as a share of the way from the background's colour to the foreground's; which of these pixels lie
on which side now, for contours are continuous; the shares of the edge's other mixed pixels, each by its own
two colours; and how many of the views that see past the edge, and of those that do not, agree with the pixel
at either disparity. A network of 5,100 weights, trained on scenes left to chance (benchmarks/edge_net.py),
puts that into one number, the logarithm of the odds that the pixel is the nearer surface's. A pixel changes
sides where that speaks clearly against the side it is on.

Surfaces mix in a pixel by their light, and most pictures hold something like the root of it. What colours of
mixed pixels say of the exponent (S. Lin, J. Gu, S. Yamazaki, H.-Y. Shum: Radiometric calibration from a
single image, CVPR 2004): in light they lie on the line from one surface's colour to the other's, in levels on
a curve, unless surfaces differ in brightness alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.jumps import near_jumps
from lfdepth.blocks.photo import local_thresholds
from lfdepth.engines import single
from lfdepth.engines.base import EdgeColours, Engine
from lfdepth.engines.boxes import local_extremes
from lfdepth.lightfield import LightField

_JUMP = 0.15  # px per view step between neighbours that make an edge
# Logarithms of the odds from which on a pixel changes sides. To leave the front takes more: a round thing's
# rim is darker than its inside, and looks like a mixture with what is dark behind it.
_CLEARLY_NEAR, _CLEARLY_FAR = 1.0, 2.5
_REACH, _INNER = 3, 2  # px around a pixel that are looked at: colours and sides, and the edge's own shares
_CHUNK = 2048  # pixels at a time

AS_THEY_ARE = 1.0  # exponent of light over levels: levels are light
_EXPONENTS = AS_THEY_ARE, 2.2
_STRAIGHTER = 0.78  # of what mixed colours deviate from lines, from which on levels are roots of light
_MIXED = 0.2, 0.8  # shares of the foreground between which a pixel is mixed
_APART = 9.0  # squared distance of the two colours over their variances, for the exponent
_VIEWS, _PIXELS = 8, 50  # that it takes at least to tell it

_ROUNDING = 4 / 3  # variance per channel of what levels differ by for no reason, squared 8-bit levels

Float = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class EdgeNet:
    """Weights of the network: `hidden` layers of (matrix, offsets), each followed by a ramp, and the last.

    Parameters
    ----------
    layers
        For each layer a matrix (inputs, outputs) and offsets (outputs,); the last has one output.
    """

    layers: tuple[tuple[Float, Float], ...]

    @classmethod
    def shipped(cls) -> Self:
        """The weights that come with the package."""
        with np.load(Path(__file__).parent / "edge_net.npz", allow_pickle=False) as arrays:
            count = len(arrays.files) // 2
            return cls(
                tuple(
                    (arrays[f"matrix_{i}"].astype(np.float32), arrays[f"offset_{i}"].astype(np.float32))
                    for i in range(count)
                )
            )

    def odds(self, features: Float) -> Float:
        """Logarithms (N,) of the odds that pixels with features (N, F) are the nearer surface's."""
        values = features
        for i, (matrix, offset) in enumerate(self.layers):
            values = values @ matrix + offset
            if i < len(self.layers) - 1:
                np.maximum(values, 0, out=values)
        return np.asarray(values[:, 0])


@dataclass(frozen=True, eq=False)
class EdgePixels:
    """N pixels beside the depth edges of a map.

    Attributes
    ----------
    rows, columns
        (N,) places.
    near, far
        (N,) disparities of the two surfaces that meet there, px per view step.
    front
        (N,) which of them are on the nearer side.
    features
        (N, F) what the network is told.
    exponent
        Of light over levels.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    near: Float
    far: Float
    front: NDArray[np.bool_]
    features: Float
    exponent: float


def decide_sides(
    lf: LightField,
    disparity: Float,
    before: Float,
    *,
    net: EdgeNet | None = None,
    exponent: float | None = None,
    engine: Engine | None = None,
) -> Float:
    """Let pixels beside depth edges change to the other surface where the network clearly says so.

    Parameters
    ----------
    lf
        Light field.
    disparity
        (H, W) map, px per view step.
    before
        (H, W) what the map was before any of its depth edges were decided.
    net
        Weights; by default those that come with the package.
    exponent
        Of light over levels; measured if it is None.
    engine
        Engine; by default the processor's, on one thread.

    Returns
    -------
    (H, W) float32, px per view step.
    """
    pixels = look_at_edges(lf, disparity, before, exponent=exponent, engine=engine)
    odds = (net or EdgeNet.shipped()).odds(pixels.features)
    leaves, joins = pixels.front & (odds < -_CLEARLY_FAR), ~pixels.front & (odds > _CLEARLY_NEAR)
    changes = leaves | joins
    decided = disparity.copy()
    decided[pixels.rows[changes], pixels.columns[changes]] = np.where(leaves, pixels.far, pixels.near)[
        changes
    ]
    return decided


def look_at_edges(
    lf: LightField,
    disparity: Float,
    before: Float,
    *,
    exponent: float | None = None,
    engine: Engine | None = None,
) -> EdgePixels:
    """What the network is told of the pixels beside the depth edges of a map (H, W).

    `before` is as for `decide_sides`; `exponent` of light over levels is measured if it is None.
    """
    disparity = np.ascontiguousarray(disparity, np.float32)
    used = engine or single()
    places, near, far, shown = _edge_colours(lf, disparity, used)
    rows, columns = places.T
    levels = _levels(lf)
    power = measured_exponent(levels[rows, columns], shown) if exponent is None else exponent
    light, shown = _light(levels, power), _in_light(shown, power)
    front = disparity[rows, columns] > (near + far) / 2
    others = max(int(lf.available.sum()) - 1, 1)
    own = levels[rows, columns]
    scalars, shares = _tell_pixels(
        light[rows, columns], _slope(own.mean(axis=1), power), shown, front, others
    )
    gap = near - far
    past = np.clip((before[rows, columns] - far) / gap, -0.5, 1.5)
    told = np.column_stack([np.log(gap), *scalars, front, past]).astype(np.float32)
    own_shares = np.full(disparity.shape, np.nan, np.float32)
    own_shares[rows, columns] = shares
    sides = _Sides(disparity, light, own_shares, near, far, shown, places)
    around = used.each(sides.around, [slice(at, at + _CHUNK) for at in range(0, len(rows), _CHUNK)])
    width = 2 * (2 * _REACH + 1) ** 2 + (2 * _INNER + 1) ** 2
    patches = np.concatenate(around) if around else np.zeros((0, width), np.float32)
    return EdgePixels(rows, columns, near, far, front, np.hstack([told, patches]), power)


def mixed_deviations(lf: LightField, disparity: Float, *, engine: Engine | None = None) -> tuple[Float, ...]:
    """`deviations` of the pixels beside the depth edges of a map (H, W)."""
    disparity = np.ascontiguousarray(disparity, np.float32)
    places, _, _, shown = _edge_colours(lf, disparity, engine or single())
    return deviations(_levels(lf)[tuple(places.T)], shown)


def _edge_colours(
    lf: LightField, disparity: Float, engine: Engine
) -> tuple[NDArray[np.int64], Float, Float, EdgeColours]:
    """Pixels (N, 2) beside depth edges, the disparities (N,) that meet there, and both surfaces' colours."""
    at_edge = near_jumps(disparity, _JUMP, 1)
    at_edge[[0, -1], :] = at_edge[:, [0, -1]] = False
    places = np.argwhere(at_edge)
    near, far = (each[tuple(places.T)] for each in local_extremes(disparity, 1))
    views = engine.views(lf)
    shown = engine.edge_colours(
        views,
        disparity,
        places,
        np.stack([near, far], axis=1),
        engine.surfaces_of(disparity, views),
        local_thresholds(lf.reference) * np.float32(255),
    )
    return places, near, far, shown


def _levels(lf: LightField) -> Float:
    """The reference view from 0 to 255."""
    return np.asarray(lf.reference.astype(np.float32) * np.float32(255 / lf.full_scale))


def measured_exponent(own: Float, shown: EdgeColours) -> float:
    """Exponent of light over levels, by which mixed pixels (N, C) lie best on lines between two colours."""
    return straightest([deviations(own, shown)])


def deviations(own: Float, shown: EdgeColours) -> tuple[Float, ...]:
    """For either exponent, how far its mixed pixels of some (N, C) lie from the line between two colours."""
    found = []
    for exponent in _EXPONENTS:
        seen = _in_light(shown, exponent)
        light = _light(own, exponent)
        share, apart, beside = _shares(light, seen)
        mixed = (share > _MIXED[0]) & (share < _MIXED[1])
        mixed &= (seen.spreads[:, 0] >= 0) & (shown.counts[:, 0] >= _VIEWS)
        mixed &= apart > _APART * seen.spreads.sum(axis=1) + 1
        found.append((beside / apart)[mixed])
    return tuple(found)


def straightest(pieces: Sequence[tuple[Float, ...]]) -> float:
    """Exponent of light over levels that the `deviations` in all pieces of a light field speak for."""
    every = [np.concatenate(each) for each in zip(*pieces, strict=True)]
    linear, root = (float(np.median(each)) if each.size > _PIXELS else 0.0 for each in every)
    return _EXPONENTS[1] if 0 < root < _STRAIGHTER * linear else _EXPONENTS[0]


def _light(levels: Float, exponent: float) -> Float:
    """Light of levels, both from 0 to 255."""
    if exponent == 1:
        return levels
    return np.asarray(255 * np.clip(levels / 255, 0, 1) ** exponent, np.float32)


def _slope(levels: Float, exponent: float) -> Float:
    """How fast light rises with levels."""
    return np.asarray(exponent * np.clip(levels / 255, 1 / 255, 1) ** (exponent - 1), np.float32)


def _in_light(shown: EdgeColours, exponent: float) -> EdgeColours:
    """Colours and their variances in light."""
    front, back, spreads, counts = shown
    slopes = np.stack([_slope(each.mean(axis=1), exponent) for each in (front, back)], axis=1)
    return EdgeColours(_light(front, exponent), _light(back, exponent), spreads * slopes**2, counts)


def _shares(own: Float, shown: EdgeColours) -> tuple[Float, Float, Float]:
    """Share of the foreground in colours (N, C), squared distances of the two surfaces and from the line."""
    way = shown.front - shown.back
    apart = np.maximum((way**2).sum(axis=1), np.float32(0.01))
    share = ((own - shown.back) * way).sum(axis=1) / apart
    beside = ((own - shown.back - share[:, None] * way) ** 2).sum(axis=1)
    return share, apart, beside


def _tell_pixels(
    own: Float, slope: Float, shown: EdgeColours, front: NDArray[np.bool_], others: int
) -> tuple[list[Float], Float]:
    """Numbers about each pixel, (N,) each, and its share of the foreground, the side where that is unsure."""
    share, apart, beside = _shares(own, shown)
    has_front = shown.spreads[:, 0] >= 0
    floor = np.float32(_ROUNDING * own.shape[1]) * slope**2
    front_spread, back_spread = np.maximum(shown.spreads, 0).T
    noise = front_spread + back_spread + floor
    seeing, seeing_near, seeing_far, hidden, hidden_near, shown_near = shown.counts.T
    to_back = ((own - shown.back) ** 2).sum(axis=1) / (back_spread + floor)
    to_front = ((own - shown.front) ** 2).sum(axis=1) / (front_spread + floor)
    way = np.sqrt(apart)
    numbers = [
        np.clip(share, -1, 2) - np.float32(0.5),
        0.5 * np.log(apart / noise),
        np.minimum(np.sqrt(beside / apart), 2),
        np.minimum(np.sqrt(front_spread / apart), 2),
        np.minimum(np.sqrt(back_spread / apart), 2),
        0.5 * np.log1p(to_back),
        0.5 * np.log1p(to_front),
        np.log1p(np.maximum(-share, 0) * way / np.sqrt(back_spread + floor)),
        np.log1p(np.maximum(share - 1, 0) * way / np.sqrt(front_spread + floor)),
        has_front,
        seeing / others,
        hidden / others,
        (seeing_near + hidden_near) / np.maximum(shown_near, 1),
        seeing_near / np.maximum(seeing, 1),
        hidden_near / np.maximum(hidden, 1),
        seeing_far / np.maximum(seeing, 1),
    ]
    sure = np.where(has_front & (seeing >= 3), apart / (apart + 4 * noise), 0)
    side = front.astype(np.float32)
    return numbers, np.asarray(side + sure * (np.clip(share, -0.2, 1.2) - side), np.float32)


@dataclass(frozen=True, eq=False)
class _Sides:
    """What lies around pixels beside edges, in terms of the two surfaces that meet there.

    `shares` (H, W) are the edge's own shares of the foreground, NaN elsewhere.
    """

    disparity: Float
    light: Float
    shares: Float
    near: Float
    far: Float
    shown: EdgeColours
    places: NDArray[np.int64]

    def around(self, chosen: slice) -> Float:
        """Colours' shares and sides within 7×7 px and the edge's own shares within 5×5, (n, 123).

        Counted from one half; turned so that the nearer surface lies to the right, and rather there than
        below: what is mirrored or transposed is decided alike.
        """
        height, width = self.disparity.shape
        steps = np.arange(-_REACH, _REACH + 1)
        rows = np.clip(self.places[chosen, :1] + steps, 0, height - 1)[:, :, None]
        columns = np.clip(self.places[chosen, 1:] + steps, 0, width - 1)[:, None, :]
        back, way = self.shown.back[chosen], (self.shown.front - self.shown.back)[chosen]
        apart = np.maximum((way**2).sum(axis=1), np.float32(0.01))[:, None, None]
        colours = self.light[rows, columns] - back[:, None, None]
        colour = np.clip(np.einsum("nyxc,nc->nyx", colours, way) / apart, -0.5, 1.5) - np.float32(0.5)
        near, far = (each[chosen, None, None] for each in (self.near, self.far))
        side = np.clip((self.disparity[rows, columns] - far) / (near - far), -0.5, 1.5) - np.float32(0.5)
        mixed = self.shares[rows, columns] - np.float32(0.5)
        mixed = np.where(np.isnan(mixed), np.clip(side, -0.5, 0.5), mixed)
        whole = np.stack([colour, side, mixed], axis=1)
        down, across = (side * steps[:, None]).sum(axis=(1, 2)), (side * steps).sum(axis=(1, 2))
        whole = np.where((down < 0)[:, None, None, None], whole[:, :, ::-1], whole)
        whole = np.where((across < 0)[:, None, None, None], whole[..., ::-1], whole)
        whole = np.where((np.abs(down) > np.abs(across))[:, None, None, None], whole.swapaxes(2, 3), whole)
        inner = slice(_REACH - _INNER, _REACH + _INNER + 1)
        parts = whole[:, :2], whole[:, 2:, inner, inner]
        return np.hstack([each.reshape(len(whole), -1) for each in parts]).astype(np.float32)
