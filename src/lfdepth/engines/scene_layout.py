"""How a procedural scene is laid out for the kernels that render it: kinds, and arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]

PLANE, ELLIPSOID, RIDGE, HOLLOW = range(4)
EVERYWHERE, CONVEX, ELLIPSE, LEAF, GRID = range(5)
MAX_FACETS = 6


class Packed(NamedTuple):
    """A scene as arrays, for the kernels; one row per layer unless said."""

    surface_kind: npt.NDArray[np.int64]
    surface: Float
    shape_kind: npt.NDArray[np.int64]
    shape: Float
    hole_start: npt.NDArray[np.int64]  # layer i has holes hole_start[i] to hole_start[i + 1] - 1
    hole_kind: npt.NDArray[np.int64]
    hole: Float
    hole_box: Float  # as box, one row per hole
    box: Float  # left, top, right, bottom, smallest D, largest D
    texture: npt.NDArray[np.int64]  # index into textures
    affine: Float
    gain: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    ambient: Float
    highlight: Float  # one row per highlight
    textures: npt.NDArray[np.float32]  # (count, n, n, 3)
