"""Costs of planes by how sharp the mean of all views is there: constrained adaptive defocus.

Williem, Park, Lee: Robust Light Field Depth Estimation Using Occlusion-Noise Aware Data Costs, PAMI 40(10),
2018, doi:10.1109/TPAMI.2017.2746858.

The mean of all views at a plane is the reference view where the surface is at the plane and every view shows
it. Beside an occluder, where some views do not, a pixel takes the cost of a pixel of its own colour nearby.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.focusing import average
from lfdepth.engines.base import Array, Engine, Float
from lfdepth.lightfield import LightField, unit

_SMALL, _LARGE = 3, 7
"""Radii: of the mean of defocus, and how far such a window and the pixel it serves may reach together."""

_WEIGHT = np.float32(15)
"""Weight of the defocus beside the distance of colours (γ)."""


class Defocus:
    """Mean defocus of planes, which `lend` then lends to pixels of the same colour.

    Parameters
    ----------
    lf
        Light field.
    engine
        Engine.
    """

    def __init__(self, lf: LightField, engine: Engine) -> None:
        self.lf, self.engine = lf, engine
        self.reference = unit(lf.reference, lf.full_scale)

    def mean(self, plane: float) -> Float:
        """Defocus (H, W) at a plane, the mean over 7×7 px, in parts of full scale.

        A pixel's defocus is the distance of its colour in the mean of all views to that in the reference
        view. Views that do not reach a pixel do not count there.
        """
        from scipy.ndimage import uniform_filter

        everywhere = np.full(self.reference.shape[:2], plane, np.float32)
        focused = average(self.lf, everywhere, self.engine)[0] / np.float32(self.lf.full_scale)
        return np.asarray(
            uniform_filter(_length(focused - self.reference), 2 * _SMALL + 1, mode="nearest"), np.float32
        )

    def lend(self, volume: Array) -> None:
        """Replace the defocus a of all planes (K, H, W) by the least ‖I(q) − I(p)‖ + 15·a(q) around p.

        Pixels q are those within 4 px along rows and columns; p itself counts with the least distance of
        colour that another one has.
        """
        size = self.reference.shape[:2]
        closest = np.full(size, np.inf, np.float32)
        blurred = _WEIGHT * self.engine.download(volume)
        lent = np.full_like(blurred, np.inf)
        for here, there in _neighbours(size, _LARGE - _SMALL):
            apart = _length(self.reference[there] - self.reference[here])
            np.minimum(closest[here], apart, out=closest[here])
            for index in range(len(blurred)):
                np.minimum(lent[index][here], blurred[index][there] + apart, out=lent[index][here])
        for index in range(len(blurred)):
            volume[index] = self.engine.upload(np.minimum(lent[index], blurred[index] + closest))


def _length(colours: NDArray[np.float32]) -> Float:
    """Euclidean length of colours (H, W, C)."""
    return np.asarray(np.sqrt(np.einsum("yxc,yxc->yx", colours, colours)), np.float32)


_Part = tuple[slice, slice]


def _neighbours(size: tuple[int, int], reach: int) -> Iterator[tuple[_Part, _Part]]:
    """Where pixels lie that have a neighbour at an offset, and where the neighbours lie, for every offset."""
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            if (down, across) != (0, 0):
                rows, columns = _overlap(size[0], down), _overlap(size[1], across)
                yield (rows[0], columns[0]), (rows[1], columns[1])


def _overlap(length: int, step: int) -> tuple[slice, slice]:
    """Places whose neighbour `step` farther is there, and the neighbours."""
    first, last = max(0, -step), min(length, length - step)
    return slice(first, last), slice(first + step, last + step)
