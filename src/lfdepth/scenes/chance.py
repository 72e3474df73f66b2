"""Scenes left to chance, as many as there are numbers: what learned systems are trained on.

A scene has a background (a wall, or a room), and in front of it sheets, balls, boxes, pyramids, leaves, bars,
meshes and combs of wedges, in any number, anywhere within a range of disparities that is left to chance, too.
Scene `number` is the same whoever renders it, and in whatever order.

>>> from lfdepth.scenes.chance import chance_scene, cross, render
>>> sample = render(0, 64, cross(9), samples=2)
>>> sample.views.shape, sample.truth.shape
((33, 64, 64, 3), (64, 64))
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, exp, log, pi, sin

import numpy as np
import numpy.typing as npt

from lfdepth.scenes import textures
from lfdepth.scenes.model import (
    Ellipsoid,
    Facets,
    Highlight,
    Layer,
    Paint,
    Plane,
    Scene,
    Shape,
    ellipse,
    grid,
    leaf,
    pack,
    polygon,
    rectangle,
)

Texture = npt.NDArray[np.float32]
Position = tuple[int, int]
"""(v, u), counted from the reference view."""

SET = 16
"""Scenes that share a set of textures, which take longer to make than a scene."""
_TEXTURE_SIZE = 256
_PLAIN = 2
"""Textures of a set, its first, on which there is hardly anything to see."""
_FARTHEST = 4.0
"""Largest disparity either way, px per view step."""
_STEEPEST = 0.12
"""Largest change of disparity per pixel: at four views from the middle, surfaces still face the camera."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Some views of a scene and its truth.

    Attributes
    ----------
    views
        (N, H, W, 3) uint8, one for each position asked for.
    truth
        (H, W) float32, disparity of the reference view, px per view step.
    """

    views: npt.NDArray[np.uint8]
    truth: npt.NDArray[np.float32]


def cross(across: int) -> list[Position]:
    """Positions (v, u) of the middle row, the middle column and both diagonals, row by row.

    Parameters
    ----------
    across
        Views along an axis, odd.
    """
    reach = across // 2
    offsets = range(-reach, reach + 1)
    return [(v, u) for v in offsets for u in offsets if v == 0 or u == 0 or abs(u) == abs(v)]


def whole(across: int) -> list[Position]:
    """Positions (v, u) of all views, row by row."""
    offsets = range(-(across // 2), across - across // 2)
    return [(v, u) for v in offsets for u in offsets]


def render(number: int, size: int, positions: Sequence[Position], samples: int = 3, seed: int = 0) -> Sample:
    """Render some views of a scene, without noise.

    Parameters
    ----------
    number
        Which scene, not negative.
    size
        Height and width, px.
    positions
        Views (v, u), counted from the reference view.
    samples
        A pixel is the mean over samples × samples points.
    seed
        Which series of scenes.
    """
    from lfdepth.engines.cpu.kernels import scenes as kernels

    packed = pack(chance_scene(number, size, seed))
    views = np.empty((len(positions), size, size, 3), np.uint8)
    for picture, (v, u) in zip(views, positions, strict=True):
        light = kernels.render_view(packed, float(u), float(v), size, size, samples)
        picture[:] = np.rint(np.clip(light, 0, 255))
    truth, _ = kernels.trace(packed, 0.0, 0.0, np.arange(size, dtype=np.float64), size, 0.0, 1.0)
    return Sample(views, truth)


def chance_scene(number: int, size: int, seed: int = 0) -> Scene:
    """Scene `number` of a series, `size` px wide and high."""
    return _Composer(np.random.default_rng([seed, number, 7]), size, _textures(seed, number // SET)).scene()


@lru_cache(maxsize=2)
def _textures(seed: int, number: int) -> tuple[Texture, ...]:
    """Textures of a set of scenes."""
    rng = np.random.default_rng([seed, number, 8])
    n = _TEXTURE_SIZE
    made = [
        textures.plain(rng, n, _colour(rng), rng.uniform(2, 8), rng.uniform(0.1, 1.5)) for _ in range(_PLAIN)
    ]
    made += [_mottled(rng, n) for _ in range(9)]
    made += [
        textures.striped(
            rng, n, [_colour(rng) for _ in range(3)], int(rng.integers(6, 40)), rng.uniform(3, 14)
        )
        for _ in range(2)
    ]
    made += [_printed(rng, made[i + 1]) for i in range(4)]
    return tuple(made)


def _colour(rng: np.random.Generator) -> list[float]:
    """RGB, mostly muted."""
    grey = rng.uniform(35, 215)
    return [float(each) for each in np.clip(grey + rng.normal(0, rng.uniform(3, 45), 3), 25, 230)]


def _mottled(rng: np.random.Generator, n: int) -> Texture:
    return textures.natural(
        rng,
        n,
        [_colour(rng) for _ in range(int(rng.integers(1, 5)))],
        contrast=exp(rng.uniform(log(2.5), log(35))),
        shortest=rng.uniform(2.0, 5.0),
        patch=rng.uniform(12, 90),
        weak=rng.uniform(0.02, 0.5),
        variety=rng.uniform(0.2, 1.0),
    )


def _printed(rng: np.random.Generator, ground: Texture) -> Texture:
    """Discs, bars and boxes with hard edges on a texture: edges of colour where there is none of depth."""
    out = ground.copy()
    n = out.shape[0]
    for _ in range(int(rng.integers(10, 60))):
        across, along = exp(rng.uniform(log(1.5), log(24))), exp(rng.uniform(log(2), log(40)))
        reach = int(np.ceil(np.hypot(across, along))) + 2
        x0, y0, angle = rng.uniform(0, n), rng.uniform(0, n), rng.uniform(0, pi)
        columns, rows = (np.arange(int(z) - reach, int(z) + reach) for z in (x0, y0))
        dx, dy = columns - x0, (rows - y0)[:, None]
        s = np.abs(cos(angle) * dx + sin(angle) * dy) / across
        t = np.abs(cos(angle) * dy - sin(angle) * dx) / along
        inside = 1 - (np.hypot(s, t) if rng.random() < 0.5 else np.maximum(s, t))
        share = (np.clip(inside * min(across, along) + 0.5, 0, 1) * rng.uniform(0.3, 1))[..., None]
        place = np.ix_(rows % n, columns % n)
        out[place] += (share * (_colour(rng) - out[place])).astype(np.float32)
    return out


class _Composer:
    """Chance, size, range and textures of a scene under construction."""

    def __init__(self, rng: np.random.Generator, size: int, made: Sequence[Texture]) -> None:
        self.rng, self.size, self.textures = rng, size, made
        self.span = exp(self.uniform(log(0.9), log(8.0))) if rng.random() < 0.85 else self.uniform(2, 4)
        reach = _FARTHEST - self.span / 2
        middle = float(np.clip(self.rng.normal(0, 0.45), -1, 1)) * reach
        self.far = middle - self.span / 2
        self.plainness = self.uniform(0.2, 0.7) if rng.random() < 0.25 else 0.0

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def depth(self, low: float = 0.1, high: float = 1.0) -> float:
        """A disparity between shares of the range."""
        return self.far + self.uniform(low, high) * self.span

    def place(self) -> tuple[float, float]:
        return self.uniform(-0.05, 1.05) * self.size, self.uniform(-0.05, 1.05) * self.size

    def length(self, low: float, high: float) -> float:
        """A length between shares of the picture's side, small ones as often as large ones, px."""
        return self.size * exp(self.uniform(log(low), log(high)))

    def paint(self, ambient: float = 1.0) -> Paint:
        count = _PLAIN if self.chance(self.plainness) else len(self.textures)
        texture = self.textures[int(self.rng.integers(count))]
        n = texture.shape[0]
        contrast = exp(self.uniform(log(0.45), log(1.5)))
        colour = texture.mean(axis=(0, 1)) + self.rng.normal(0, 18, 3)
        tint = contrast * (1 + self.rng.normal(0, 0.06, 3))
        offset = colour - tint * texture.mean(axis=(0, 1))
        move = (self.uniform(0, n), self.uniform(0, n), exp(self.uniform(log(0.4), log(1.5))))
        gain_, offset_ = (tuple(float(c) for c in values) for values in (tint, offset))
        return Paint(texture, (*move, self.uniform(0, 2 * pi)), gain_, offset_, ambient)  # type: ignore[arg-type]

    def plane(self, disparity: float, x: float, y: float, change: float, across: float) -> Plane:
        """Plane through (x, y, disparity) whose disparity changes by up to `change` over `across` px."""
        if self.chance(0.3):
            return Plane(disparity)
        slope = min(_STEEPEST, self.uniform(0, change) / max(across, 8.0))
        turn = self.uniform(0, 2 * pi)
        return Plane(disparity, slope * cos(turn), slope * sin(turn), x, y)

    def scene(self) -> Scene:
        layers = self._room() if self.chance(0.3) else self._wall()
        things: list[tuple[Callable[[], list[Layer]], float]] = [
            (self._sheet, 3.0),
            (self._ball, 1.5),
            (self._box, 1.5),
            (self._pyramid, 0.7),
            (self._foliage, 0.8),
            (self._bars, 1.2),
            (self._mesh, 0.12),
            (self._comb, 0.6),
            (self._holed, 0.4),
        ]
        weights = np.array([weight for _, weight in things]) * self.rng.gamma(0.7, 1.0, len(things))
        for _ in range(int(self.rng.integers(2, 15))):
            thing = things[int(self.rng.choice(len(things), p=weights / weights.sum()))][0]
            # through holes, only later layers are seen
            layers = thing() + layers if thing == self._holed else layers + thing()
        return Scene(layers, self._highlights(layers) if self.chance(0.15) else [])

    def _wall(self) -> list[Layer]:
        middle = self.size / 2
        change = 0.7 * self.span if self.chance(0.6) else 0.1 * self.span
        return [Layer(self.plane(self.depth(0.05, 0.3), middle, middle, change, self.size), self.paint())]

    def _room(self) -> list[Layer]:
        """Back wall and floor, and often a side wall or a ceiling."""
        back = self.depth(0.0, 0.1)
        corner = self.uniform(0.2, 0.8) * self.size, self.uniform(0.3, 0.8) * self.size
        layers = [Layer(Plane(back), self.paint())]
        slope = min(_STEEPEST, self.uniform(0.5, 1.2) * self.span / (self.size - corner[1]))
        layers.append(Layer(Plane(back, 0.0, slope, 0, corner[1]), self.paint()))
        if self.chance(0.6):
            slope = min(_STEEPEST, self.uniform(0.4, 1.2) * self.span / corner[0])
            layers.append(Layer(Plane(back, -slope, 0.0, corner[0], 0), self.paint()))
        if self.chance(0.3):
            slope = min(_STEEPEST, self.uniform(0.4, 1.0) * self.span / corner[1])
            layers.append(Layer(Plane(back, 0.0, -slope, 0, 0.3 * corner[1]), self.paint()))
        return layers

    def _outline(self, x: float, y: float, low: float, high: float) -> tuple[Shape, float]:
        """A shape about (x, y) and how far it reaches, px."""
        along, across = self.length(low, high), self.length(low, high)
        angle = self.uniform(0, pi) if self.chance(0.7) else 0.0
        kind = int(self.rng.integers(4))
        if kind == 0:
            return rectangle(x, y, 2 * along, 2 * across, angle), max(along, across)
        if kind == 1:
            return ellipse(x, y, along, across, angle), max(along, across)
        if kind == 2:
            return leaf(x, y, along, across, angle), max(along, across)
        turns = np.sort(self.rng.uniform(0, 2 * pi, int(self.rng.integers(3, 7))))
        turns = turns if np.diff([*turns, turns[0] + 2 * pi]).max() < 0.95 * pi else np.arange(3) * 2 * pi / 3
        return polygon([(x + along * cos(t), y + across * sin(t)) for t in turns]), max(along, across)

    def _sheet(self) -> list[Layer]:
        x, y = self.place()
        shape, reach = self._outline(x, y, 0.03, 0.35)
        return [Layer(self.plane(self.depth(), x, y, 0.3 * self.span, 2 * reach), self.paint(), shape)]

    def _holed(self) -> list[Layer]:
        """A large sheet with holes."""
        x, y = self.place()
        surface = self.plane(self.depth(0.4), x, y, 0.3 * self.span, 0.6 * self.size)
        holes = [self._outline(*self.place(), 0.02, 0.15)[0] for _ in range(int(self.rng.integers(2, 12)))]
        shape = rectangle(x, y, self.length(0.4, 1.2), self.length(0.4, 1.2), self.uniform(0, pi))
        return [Layer(surface, self.paint(), shape, holes)]

    def _ball(self) -> list[Layer]:
        x, y = self.place()
        rx = self.length(0.04, 0.3)
        ry = rx if self.chance(0.4) else self.length(0.04, 0.3)
        bulge = min(self.uniform(0.05, 0.4) * self.span, 0.1 * min(rx, ry))
        ball = Ellipsoid(x, y, rx, ry, self.depth(0.1, 0.9), bulge)
        return [Layer(ball, self.paint(self.uniform(0.3, 1.0)))]

    def _box(self) -> list[Layer]:
        """Front, a side and a lid that fall away."""
        (x, y), width, height = self.place(), self.length(0.08, 0.35), self.length(0.08, 0.35)
        disparity, paint = self.depth(0.2), self.paint()
        left, right, top, bottom = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        recede = 0.35 * min(width, height)
        fall = min(self.uniform(0.1, 0.4) * self.span, 0.08 * recede)
        turn = 1 if self.chance(0.5) else -1
        edge = right if turn > 0 else left
        side = [
            (edge, top),
            (edge + turn * recede, top - recede),
            (edge + turn * recede, bottom - recede),
            (edge, bottom),
        ]
        lid = [
            (left, top),
            (left + turn * recede, top - recede),
            (right + turn * recede, top - recede),
            (right, top),
        ]
        return [
            Layer(Plane(disparity), paint, rectangle(x, y, width, height)),
            Layer(
                Plane(disparity, along_x=-turn * fall / recede, x0=edge),
                _dimmed(paint, self.uniform(0.6, 0.9)),
                polygon(side),
            ),
            Layer(
                Plane(disparity, along_y=fall / recede, y0=top),
                _dimmed(paint, self.uniform(1.0, 1.2)),
                polygon(lid),
            ),
        ]

    def _pyramid(self) -> list[Layer]:
        (x, y), reach = self.place(), self.length(0.06, 0.25)
        rise = min(self.uniform(0.1, 0.5) * self.span, 0.1 * reach)
        base, turn = self.depth(0.1, 0.7), self.uniform(0, 2 * pi)
        sides = int(self.rng.integers(3, 6))
        slope = rise / reach
        turns = [turn + 2 * pi * i / sides for i in range(sides)]
        planes = [Plane(base + rise, -slope * cos(t), -slope * sin(t), x, y) for t in turns]
        outline = ellipse(x, y, reach, reach) if self.chance(0.5) else rectangle(x, y, 2 * reach, 2 * reach)
        return [Layer(Facets(planes), self.paint(), outline)]

    def _foliage(self) -> list[Layer]:
        """A cluster of leaves, each at a disparity of its own."""
        x, y = self.place()
        paints = [self.paint() for _ in range(3)]
        wide, low, high = self.length(0.1, 0.5), self.uniform(0.1, 0.5), self.uniform(0.5, 1.0)
        length = self.length(0.02, 0.09)
        layers = []
        for _ in range(int(self.rng.integers(6, 40))):
            at = x + self.uniform(-wide, wide), y + self.uniform(-wide, wide)
            reach = length * self.uniform(0.6, 1.6)
            shape = (leaf if self.chance(0.6) else ellipse)(
                *at, reach, reach * self.uniform(0.25, 0.6), self.uniform(0, pi)
            )
            surface = self.plane(self.depth(low, high), *at, 0.08 * self.span, 2 * reach)
            paint = paints[int(self.rng.integers(3))]
            layers.append(Layer(surface, _dimmed(paint, self.uniform(0.6, 1.2)), shape))
        return layers

    def _bars(self) -> list[Layer]:
        """Thin straight things, side by side or anyhow."""
        count, alike = int(self.rng.integers(1, 7)), self.chance(0.5)
        angle, paint, (x, y) = self.uniform(0, pi), self.paint(), self.place()
        layers = []
        for i in range(count):
            if not alike:
                angle, paint, (x, y) = self.uniform(0, pi), self.paint(), self.place()
            apart = i * self.uniform(0.06, 0.12) * self.size
            at = x - apart * sin(angle), y + apart * cos(angle)
            shape = rectangle(*at, self.length(0.2, 1.5), exp(self.uniform(log(1.2), log(8))), angle)
            surface = self.plane(self.depth(0.3), *at, 0.2 * self.span, self.size)
            layers.append(Layer(surface, paint, shape))
        return layers

    def _mesh(self) -> list[Layer]:
        pitch = max(9.0, self.length(0.06, 0.25))
        wires = grid(*self.place(), pitch, self.uniform(1.3, min(6, 0.4 * pitch)), self.uniform(0, pi))
        return [Layer(self.plane(self.depth(0.5), 0, 0, 0.2 * self.span, self.size), self.paint(), wires)]

    def _comb(self) -> list[Layer]:
        """Wedges side by side, from a few pixels to nothing."""
        (x, y), angle = self.place(), self.uniform(0, 2 * pi) if self.chance(0.6) else pi / 2
        along, pitch = self.length(0.2, 0.9), max(4.0, self.length(0.03, 0.12))
        base, apart, paint = self.depth(0.3), self.uniform(0, 0.15) * self.span, self.paint()
        layers = []
        for i in range(int(self.rng.integers(3, 12))):
            middle = np.array([x - i * pitch * sin(angle), y + i * pitch * cos(angle)])
            across = 0.5 * pitch * self.uniform(0.5, 0.95) * np.array([-sin(angle), cos(angle)])
            tip = middle + along * np.array([cos(angle), sin(angle)])
            ends = [middle - across, middle + across, tip]
            shape = polygon([(float(a), float(b)) for a, b in ends])
            layers.append(Layer(Plane(base - i * apart / 12), paint, shape))
        return layers

    def _highlights(self, layers: Sequence[Layer]) -> list[Highlight]:
        """Blobs of light that move with a disparity of their own."""
        lights = []
        for _ in range(int(self.rng.integers(1, 5))):
            index = int(self.rng.integers(len(layers)))
            wide = self.length(0.01, 0.12)
            shift = self.depth(0.0, 1.0)
            lights.append(
                Highlight(
                    index, *self.place(), wide, wide * self.uniform(0.4, 2.0), shift, self.uniform(20, 150)
                )
            )
        return lights


def _dimmed(paint: Paint, share: float) -> Paint:
    """Same paint in other light."""
    red, green, blue = paint.gain
    r, g, b = paint.offset
    gain, offset = (red * share, green * share, blue * share), (r * share, g * share, b * share)
    return Paint(paint.texture, paint.move, gain, offset, paint.ambient)


__all__ = ["SET", "Position", "Sample", "chance_scene", "cross", "render", "whole"]
