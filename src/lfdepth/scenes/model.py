"""What a procedural scene is made of: surfaces, shapes, paint, layers.

All of it lives in the space (x, y, D) of the reference view: pixel coordinates (whole at pixel centres)
and disparity in px per view step. View (u, v) sees through its pixel (x', y') along the straight line
``(x' + D·u, y' + D·v, D)``, and the surface point with the largest D on it hides the others. A plane of the
world is a plane of this space and a quadric a quadric, so every intersection below has a closed form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, inf, sin

import numpy as np
import numpy.typing as npt

from lfdepth.engines.scene_layout import (
    CONVEX,
    ELLIPSE,
    ELLIPSOID,
    EVERYWHERE,
    GRID,
    HOLLOW,
    LEAF,
    MAX_FACETS,
    PLANE,
    RIDGE,
    Float,
    Packed,
)

Box = tuple[float, float, float, float]
"""(left, top, right, bottom) in reference pixels."""

_UNBOUNDED: Box = (-inf, -inf, inf, inf)


@dataclass(frozen=True)
class Plane:
    """Surface ``D = disparity + along_x·(x - x0) + along_y·(y - y0)``.

    Parameters
    ----------
    disparity : float
        D at (x0, y0), px per view step.
    along_x, along_y : float
        Change of D per pixel; times the outermost u or v it has to stay below 1, or that view sees the
        plane from behind.
    x0, y0 : float
        Anchor in reference pixels.
    """

    disparity: float
    along_x: float = 0.0
    along_y: float = 0.0
    x0: float = 0.0
    y0: float = 0.0

    kind = PLANE
    box = _UNBOUNDED

    @property
    def coefficients(self) -> tuple[float, float, float]:
        """(a, b, c) of D = a + b·x + c·y."""
        origin = self.disparity - self.along_x * self.x0 - self.along_y * self.y0
        return origin, self.along_x, self.along_y

    @property
    def slanted(self) -> bool:
        """Whether disparity changes over the plane."""
        return bool(self.along_x or self.along_y)

    def parameters(self) -> list[float]:
        """Numbers for the kernel."""
        return list(self.coefficients)

    def disparities(self, box: Box) -> tuple[float, float]:
        """Smallest and largest D over a box."""
        a, b, c = self.coefficients
        if not self.slanted:
            return a, a
        if not np.isfinite(box).all():
            return -inf, inf
        corners = [a + b * x + c * y for x in box[::2] for y in box[1::2]]
        return min(corners), max(corners)


@dataclass(frozen=True)
class Ellipsoid:
    """Surface ``((x - x0)/rx)² + ((y - y0)/ry)² + ((D - disparity)/bulge)² = 1``.

    Parameters
    ----------
    x0, y0, rx, ry : float
        Centre and radii in reference pixels.
    disparity, bulge : float
        D of the centre, and how much the nearest point rises above it.
    far : bool
        The far half instead, as seen in a dent from within.
    """

    x0: float
    y0: float
    rx: float
    ry: float
    disparity: float
    bulge: float
    far: bool = False

    kind = ELLIPSOID
    slanted = False

    @property
    def box(self) -> Box:
        """Bounds in the reference view."""
        return self.x0 - self.rx, self.y0 - self.ry, self.x0 + self.rx, self.y0 + self.ry

    def parameters(self) -> list[float]:
        """Numbers for the kernel."""
        side = -1.0 if self.far else 1.0
        return [self.x0, self.y0, 1 / self.rx, 1 / self.ry, self.disparity, 1 / self.bulge, side]

    def disparities(self, box: Box) -> tuple[float, float]:
        """Smallest and largest D."""
        return self.disparity - self.bulge, self.disparity + self.bulge


@dataclass(frozen=True)
class Facets:
    """The lower (ridge, convex) or upper (hollow, concave) envelope of planes, such as a pyramid or its dent.

    Parameters
    ----------
    planes : sequence of Plane
        At most 6.
    hollow : bool
        Take the largest D of the planes instead of the smallest.
    """

    planes: Sequence[Plane]
    hollow: bool = False

    slanted = False
    box = _UNBOUNDED

    @property
    def kind(self) -> int:
        """Kernel's code."""
        return HOLLOW if self.hollow else RIDGE

    def parameters(self) -> list[float]:
        """Numbers for the kernel: the last plane repeated to the full count changes nothing."""
        padded = [*self.planes, *[self.planes[-1]] * (MAX_FACETS - len(self.planes))]
        return [number for plane in padded for number in plane.coefficients]

    def disparities(self, box: Box) -> tuple[float, float]:
        """Bounds of D over a box."""
        limits = np.array([plane.disparities(box) for plane in self.planes])
        return float(limits[:, 0].min()), float(limits[:, 1].max())


Surface = Plane | Ellipsoid | Facets


@dataclass(frozen=True)
class Shape:
    """Where a layer exists, as a set of reference pixels with exact (not pixelated) outline."""

    kind: int
    numbers: tuple[float, ...]
    box: Box = _UNBOUNDED

    def parameters(self) -> list[float]:
        """Numbers for the kernel."""
        return list(self.numbers)


EVERYWHERE_SHAPE = Shape(EVERYWHERE, ())


def polygon(points: Sequence[tuple[float, float]]) -> Shape:
    """Convex polygon with at most six corners (x, y), in either turning sense."""
    corners = np.asarray(points, dtype=np.float64)
    centre = corners.mean(axis=0)
    edges = []
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = np.array([y0 - y1, x1 - x0, x0 * y1 - x1 * y0])
        edges.extend(edge * np.sign(edge @ [*centre, 1.0]))
    edges.extend([0.0, 0.0, 1.0] * (MAX_FACETS - len(corners)))  # true everywhere
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Shape(
        CONVEX, tuple(map(float, edges)), (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    )


def rectangle(x0: float, y0: float, width: float, height: float, angle: float = 0.0) -> Shape:
    """Rectangle about (x0, y0), turned by an angle in radians."""
    along, across = _axes(width / 2, height / 2, angle)
    middle = np.array([x0, y0])
    corners = [middle + i * along + j * across for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return polygon([(float(x), float(y)) for x, y in corners])


def ellipse(x0: float, y0: float, rx: float, ry: float, angle: float = 0.0) -> Shape:
    """Ellipse about (x0, y0) with semi-axes rx, ry, turned by an angle in radians."""
    return Shape(ELLIPSE, _frame(x0, y0, rx, ry, angle), _framed_box(x0, y0, rx, ry, angle))


def leaf(x0: float, y0: float, rx: float, ry: float, angle: float = 0.0) -> Shape:
    """Pointed leaf about (x0, y0): half length rx, half width ry, between two parabolas."""
    return Shape(LEAF, _frame(x0, y0, rx, ry, angle), _framed_box(x0, y0, rx, ry, angle))


def grid(x0: float, y0: float, pitch: float, width: float, angle: float = 0.0) -> Shape:
    """Endless wire mesh: two families of bars, `width` px thick, every `pitch` px."""
    fill = width / pitch
    return Shape(GRID, (*_frame(x0, y0, pitch, pitch, angle), fill, fill))


def _axes(rx: float, ry: float, angle: float) -> tuple[Float, Float]:
    return np.array([rx * cos(angle), rx * sin(angle)]), np.array([-ry * sin(angle), ry * cos(angle)])


def _frame(x0: float, y0: float, rx: float, ry: float, angle: float) -> tuple[float, ...]:
    """Affine map of pixels to the shape's own unit coordinates (s, t)."""
    c, s = cos(angle), sin(angle)
    return c / rx, s / rx, -(c * x0 + s * y0) / rx, -s / ry, c / ry, (s * x0 - c * y0) / ry


def _framed_box(x0: float, y0: float, rx: float, ry: float, angle: float) -> Box:
    along, across = _axes(rx, ry, angle)
    reach = np.abs(along) + np.abs(across)
    return x0 - float(reach[0]), y0 - float(reach[1]), x0 + float(reach[0]), y0 + float(reach[1])


@dataclass(frozen=True, eq=False)
class Paint:
    """Colour of a surface point: a texture looked up at an affine map of its reference pixel, then scaled.

    Parameters
    ----------
    texture : ndarray, shape (n, n, 3), float32
        Control values, grey levels 0..255, of a periodic uniform cubic B-spline with knots 1 px apart;
        n a power of two. The spline, not its samples, is the texture: twice differentiable, so every view
        evaluates the same function and none is interpolated from another.
    move : tuple of float
        (shift x, shift y, scale, angle): texture coordinates are the pixel, turned, scaled, shifted.
    gain, offset : tuple of float
        Per channel, colour = offset + gain·texture.
    ambient : float
        1: no shading; below: share of light that reaches an ellipsoid's shaded side.
    """

    texture: npt.NDArray[np.float32]
    move: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 0.0)
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ambient: float = 1.0

    def affine(self) -> list[float]:
        """Rows of the map from (x, y, 1) to texture coordinates."""
        dx, dy, scale, angle = self.move
        c, s = scale * cos(angle), scale * sin(angle)
        return [c, s, dx, -s, c, dy]


@dataclass(frozen=True, eq=False)
class Layer:
    """A painted surface cut to a shape.

    Parameters
    ----------
    surface, shape, paint
        Geometry, outline and colour.
    holes : sequence of Shape
        Where the surface is missing; only later layers are seen through them.
    tags : mapping of str to int
        Masks in which its visible pixels count, such as "thin", and their label there, 1 to 255.
    """

    surface: Surface
    paint: Paint
    shape: Shape = EVERYWHERE_SHAPE
    holes: Sequence[Shape] = ()
    tags: Mapping[str, int] = field(default_factory=dict)

    @property
    def box(self) -> Box:
        """Bounds in the reference view."""
        a, b = self.surface.box, self.shape.box
        return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


@dataclass(frozen=True)
class Highlight:
    """A mirror image of a lamp on a layer: a white Gaussian blob that moves with its own disparity.

    Parameters
    ----------
    layer : int
        Index of the shiny layer.
    x0, y0, rx, ry : float
        Centre in the reference view and standard deviations, px.
    disparity : float
        Disparity of the virtual image; behind a convex mirror's surface, so usually smaller than the layer's.
    strength : float
        Grey levels added at the centre.
    """

    layer: int
    x0: float
    y0: float
    rx: float
    ry: float
    disparity: float
    strength: float


@dataclass(frozen=True, eq=False)
class Scene:
    """Layers in drawing order (a later one wins where disparities are equal), highlights and sensor noise.

    `noise` is in grey levels at mid grey; `noise_share` (H, W), where given, is the share that a pixel gets.
    """

    layers: Sequence[Layer]
    highlights: Sequence[Highlight] = ()
    noise: float = 0.0
    noise_share: npt.NDArray[np.float32] | None = None


def pack(scene: Scene) -> Packed:
    """Lay a scene out as arrays."""
    layers = scene.layers
    textures: list[npt.NDArray[np.float32]] = []
    for layer in layers:
        if not any(layer.paint.texture is known for known in textures):
            textures.append(layer.paint.texture)
    holes = [hole for layer in layers for hole in layer.holes]
    lobes = [[h.layer, h.x0, h.y0, 1 / h.rx, 1 / h.ry, h.disparity, h.strength] for h in scene.highlights]
    return Packed(
        surface_kind=np.array([layer.surface.kind for layer in layers]),
        surface=_rows([layer.surface.parameters() for layer in layers], 3 * MAX_FACETS),
        shape_kind=np.array([layer.shape.kind for layer in layers]),
        shape=_rows([layer.shape.parameters() for layer in layers], 3 * MAX_FACETS),
        hole_start=np.cumsum([0, *[len(layer.holes) for layer in layers]]),
        hole_kind=np.array([hole.kind for hole in holes], dtype=np.int64),
        hole=_rows([hole.parameters() for hole in holes], 3 * MAX_FACETS),
        hole_box=_rows([_bounds(layer.surface, hole.box) for layer in layers for hole in layer.holes], 6),
        box=_rows([_bounds(layer.surface, layer.box) for layer in layers], 6),
        texture=np.array(
            [next(i for i, t in enumerate(textures) if t is layer.paint.texture) for layer in layers]
        ),
        affine=_rows([layer.paint.affine() for layer in layers], 6),
        gain=np.array([layer.paint.gain for layer in layers], dtype=np.float32),
        offset=np.array([layer.paint.offset for layer in layers], dtype=np.float32),
        ambient=np.array([layer.paint.ambient for layer in layers]),
        highlight=_rows(lobes, 7),
        textures=np.stack(textures),
    )


def _bounds(surface: Surface, box: Box) -> list[float]:
    """A box in (x, y) and the disparities that the surface has over it."""
    return [*box, *surface.disparities(box)]


def _rows(rows: Sequence[Sequence[float]], width: int) -> Float:
    """Rows of unequal length as one array, padded with zeros."""
    table = np.zeros((len(rows), width))
    for target, row in zip(table, rows, strict=True):
        target[: len(row)] = row
    return table
