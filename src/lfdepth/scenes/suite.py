"""The scenes by name.

Layouts are fractions of the picture; widths of bars and detail of textures are pixels, whatever the size.
Layers share a few colours, so that colour alone does not tell foreground from background.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin

import numpy as np
import numpy.typing as npt

from lfdepth.scenes import textures
from lfdepth.scenes.model import (
    Ellipsoid,
    Highlight,
    Layer,
    Paint,
    Plane,
    Scene,
    ellipse,
    grid,
    leaf,
    polygon,
    rectangle,
)

Texture = npt.NDArray[np.float32]

COLOURS = {
    "clay": (150, 105, 80),
    "moss": (92, 110, 66),
    "slate": (88, 100, 116),
    "sand": (172, 152, 118),
    "brick": (140, 76, 64),
    "haze": (112, 132, 148),
    "ivory": (196, 186, 166),
    "soot": (56, 52, 50),
    "olive": (124, 122, 74),
}
"""Muted colours, several of them alike, from which all scenes choose."""
THIN = {"thin": 1}


class Stage:
    """Size, chance and paint of a scene under construction."""

    def __init__(self, height: int, width: int, seed: int) -> None:
        self.height, self.width = height, width
        self.rng = np.random.default_rng([seed, 0])
        self.side = min(height, width)
        # a texture repeats after its size; smaller ones would show it
        self.texture_size = 1 << int(np.clip(np.ceil(np.log2(max(height, width))), 7, 10))

    def x(self, fraction: float) -> float:
        """Column at a fraction of the width."""
        return fraction * (self.width - 1)

    def y(self, fraction: float) -> float:
        """Row at a fraction of the height."""
        return fraction * (self.height - 1)

    def uniform(self, low: float, high: float) -> float:
        """Chance, evenly distributed."""
        return float(self.rng.uniform(low, high))

    def natural(self, *names: str, **options: float) -> Texture:
        """Mottled texture in named colours; options as in `textures.natural`."""
        return textures.natural(self.rng, self.texture_size, [COLOURS[n] for n in names], **options)

    def plain(self, name: str, **options: float) -> Texture:
        """Almost no texture; options as in `textures.plain`."""
        return textures.plain(self.rng, self.texture_size, COLOURS[name], **options)

    def striped(self, *names: str, bands: int = 16, contrast: float = 8.0) -> Texture:
        """Planks in named colours."""
        return textures.striped(self.rng, self.texture_size, [COLOURS[n] for n in names], bands, contrast)

    def paint(self, texture: Texture, tint: float = 0.0, ambient: float = 1.0, scale: float = 1.0) -> Paint:
        """Texture at a place and angle left to chance; `tint` varies each channel's gain by that share."""
        n = texture.shape[0]
        gain = 1 + self.rng.uniform(-tint, tint, 3)
        move = (self.uniform(0, n), self.uniform(0, n), scale, self.uniform(0, 2 * pi))
        return Paint(texture, move, (float(gain[0]), float(gain[1]), float(gain[2])), ambient=ambient)

    def tilted(self, *corners: float) -> Plane:
        """Plane with the given disparities at the top left, top right and bottom left pixel."""
        top_left, top_right, bottom_left = corners
        along_x = (top_right - top_left) / max(1, self.width - 1)
        return Plane(top_left, along_x, (bottom_left - top_left) / max(1, self.height - 1))

    def wall(self, surface: Plane, texture: Texture) -> Layer:
        """Endless background."""
        return Layer(surface, self.paint(texture))

    def bar(
        self, start: tuple[float, float], end: tuple[float, float], width: float, surface: Plane, paint: Paint
    ) -> Layer:
        """Thin straight bar between two points (x, y), `width` px thick."""
        (x0, y0), (x1, y1) = start, end
        length, angle = float(np.hypot(x1 - x0, y1 - y0)), float(np.arctan2(y1 - y0, x1 - x0))
        shape = rectangle((x0 + x1) / 2, (y0 + y1) / 2, length, width, angle)
        return Layer(surface, paint, shape, tags=THIN)

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        disparity: float,
        texture: Texture,
        deep: float = 0.35,
    ) -> list[Layer]:
        """Cuboid from above right: front at `disparity`; top and right side lose `deep` of it."""
        left, right, top, bottom = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        recede = 0.3 * min(width, height)
        fall = min(
            deep, 0.04 * recede
        )  # no steeper, or views far to the left or below see the sides from behind
        side = [
            (right, top),
            (right + recede, top - recede),
            (right + recede, bottom - recede),
            (right, bottom),
        ]
        lid = [(left, top), (left + recede, top - recede), (right + recede, top - recede), (right, top)]
        paint = self.paint(texture)
        return [
            Layer(Plane(disparity), paint, rectangle(x, y, width, height)),
            Layer(Plane(disparity, along_x=-fall / recede, x0=right), self.dimmed(paint, 0.7), polygon(side)),
            Layer(Plane(disparity, along_y=fall / recede, y0=top), self.dimmed(paint, 1.15), polygon(lid)),
        ]

    @staticmethod
    def dimmed(paint: Paint, share: float) -> Paint:
        """Same paint in other light."""
        red, green, blue = paint.gain
        return Paint(
            paint.texture, paint.move, (red * share, green * share, blue * share), paint.offset, paint.ambient
        )

    def leaf(
        self,
        middle: tuple[float, float],
        length: float,
        disparity: float,
        texture: Texture,
        lift: float = 0.4,
    ) -> Layer:
        """Leaf of half length `length` px at any angle, pointed or round, level or rising by up to `lift`."""
        x, y = middle
        shape = leaf if self.rng.random() < 0.6 else ellipse
        tilt = self.uniform(0, lift) / max(length, 12.0) * (self.rng.random() < 0.5)
        turn = self.uniform(0, 2 * pi)
        surface = Plane(disparity, tilt * cos(turn), tilt * sin(turn), x, y)
        outline = shape(x, y, length, length * self.uniform(0.25, 0.55), self.uniform(0, pi))
        paint = self.dimmed(self.paint(texture, tint=0.1), self.uniform(0.65, 1.2))
        return Layer(surface, paint, outline)


@dataclass(frozen=True)
class Recipe:
    """How to build a scene, and what it is for."""

    build: Callable[[Stage], Scene]
    description: str


def _demo(stage: Stage) -> Scene:
    floor, cloth = stage.striped("clay", "sand", "olive"), stage.natural("slate", "haze", "ivory")
    wall = stage.natural("sand", "haze", "clay")
    occluder = stage.natural("clay", "slate", "moss", contrast=18)
    x, y, side = stage.x, stage.y, stage.side
    ground = Plane(-0.9, along_y=2.1 / stage.height, y0=y(0.62))
    layers = [
        stage.wall(stage.tilted(-1.3, -0.5, -1.2), wall),
        Layer(ground, Paint(floor)),
        Layer(
            stage.tilted(-1.3, -0.5, -1.2),
            stage.paint(stage.plain("ivory")),
            rectangle(x(0.78), y(0.24), 0.26 * side, 0.3 * side),
        ),
        *stage.box(x(0.7), y(0.7), 0.24 * side, 0.22 * side, 0.45, cloth),
        Layer(
            Ellipsoid(x(0.48), y(0.6), 0.09 * side, 0.17 * side, 0.0, 0.5), stage.paint(wall, ambient=0.35)
        ),
        Layer(
            Plane(0.9, 0.5 / side, -0.3 / side, x(0.22), y(0.45)),
            stage.paint(occluder),
            rectangle(x(0.22), y(0.45), 0.26 * side, 0.4 * side, 0.35),
        ),
    ]
    metal = stage.natural("slate", "soot", contrast=10)
    for i, width in enumerate((1.5, 2.0, 3.0, 4.5)):
        column = x(0.5 + 0.06 * i)
        ends = (column, y(0.04)), (column + 0.02 * side, y(0.44))
        layers.append(stage.bar(*ends, width, Plane(0.8 + 0.2 * i), stage.paint(metal, tint=0.2)))
    layers.append(stage.bar((x(0.35), y(0.9)), (x(0.95), y(0.52)), 3.0, Plane(1.6), stage.paint(floor)))
    return Scene(layers)


def _bars(stage: Stage) -> Scene:
    layers = [
        stage.wall(
            stage.tilted(-1.5, -0.5, -1.3), stage.natural("sand", "clay", "slate", "haze", variety=0.6)
        )
    ]
    woods = [stage.natural("clay", "sand", contrast=12), stage.natural("slate", "soot"), stage.plain("haze")]
    x, y = stage.x, stage.y
    widths = np.linspace(1.5, 6.0, 14)[stage.rng.permutation(14)]
    for i, width in enumerate(widths):
        paint = stage.paint(woods[i % 3], tint=0.15)
        along = stage.uniform(-0.4, 0.4) / stage.height
        surface = Plane(0.2 + 1.6 * i / 13, along_y=along * (i % 2), y0=y(0.5))
        if i < 9:
            column, lean = x((i + 0.7) / 9.4), stage.uniform(-0.03, 0.03) * stage.width * (i % 3 == 1)
            ends = (column - lean, y(stage.uniform(0.0, 0.12))), (column + lean, y(stage.uniform(0.88, 1.0)))
        else:
            row = y((i - 8.3) / 5.5)
            ends = (x(-0.2), row), (x(1.2), row + stage.uniform(-0.25, 0.25) * stage.height)
        layers.append(stage.bar(ends[0], ends[1], float(width), surface, paint))
    return Scene(layers)


def _leaves(stage: Stage) -> Scene:
    greens = [
        stage.natural("moss", "olive", contrast=8, variety=0.8),
        stage.natural("olive", "sand", "moss", contrast=14),
        stage.natural("moss", "soot", contrast=6, variety=0.3),
        stage.natural("olive", "brick", contrast=8),
    ]
    wall = stage.natural("moss", "soot", "olive", contrast=14, variety=0.6)
    layers = [stage.wall(Plane(-1.6, 0.2 / stage.width), wall)]
    for i in range(130):
        middle = stage.x(stage.uniform(-0.02, 1.02)), stage.y(stage.uniform(-0.02, 1.02))
        length = stage.side * stage.uniform(0.025, 0.075)
        layers.append(stage.leaf(middle, length, -1.2 + 2.6 * i / 129, greens[i % 4]))
    return Scene(layers)


def _sphere(stage: Stage) -> Scene:
    x, y, side = stage.x, stage.y, stage.side
    wall = stage.natural("ivory", "sand", "haze", "slate")
    return Scene(
        [
            stage.wall(stage.tilted(-1.2, -0.8, -1.0), wall),
            Layer(
                Ellipsoid(x(0.44), y(0.47), 0.3 * side, 0.3 * side, -0.1, 1.6),
                stage.paint(stage.natural("ivory", contrast=3.0, shortest=3.0), ambient=0.45),
            ),
            Layer(
                Ellipsoid(x(0.78), y(0.76), 0.13 * side, 0.13 * side, 0.1, 0.9),
                stage.paint(stage.natural("sand", "haze", contrast=10), ambient=0.5),
            ),
        ]
    )


def _room(stage: Stage) -> Scene:
    x, y, side = stage.x, stage.y, stage.side
    cloth, print_ = (
        stage.natural("brick", "slate", "sand"),
        stage.natural("haze", "clay", "ivory", contrast=20),
    )
    wood = stage.striped("clay", "sand", "olive", bands=32)
    back = stage.tilted(-1.5, -1.0, -1.45)
    floor = Plane(-1.25, along_y=3.0 / (0.42 * stage.height), y0=y(0.58))
    side_wall = Plane(-1.2, along_x=-1.9 / (0.22 * stage.width), x0=x(0.22))
    rug = [(x(0.38), y(0.74)), (x(0.8), y(0.74)), (x(0.98), y(0.97)), (x(0.3), y(0.97))]
    layers = [
        Layer(back, stage.paint(stage.plain("ivory", swing=7.0, grain=0.4))),
        Layer(floor, stage.paint(stage.plain("sand", swing=6.0, grain=0.6))),
        Layer(side_wall, stage.paint(stage.plain("haze", swing=6.0, grain=0.3))),
        Layer(back, stage.paint(print_), rectangle(x(0.6), y(0.24), 0.24 * side, 0.2 * side)),
        Layer(floor, stage.paint(cloth), polygon(rug)),
        *stage.box(x(0.76), y(0.62), 0.18 * side, 0.24 * side, -0.45, wood),
        *stage.box(x(0.5), y(0.72), 0.1 * side, 0.1 * side, 0.1, print_),
        Layer(
            Ellipsoid(x(0.34), y(0.84), 0.08 * side, 0.08 * side, 0.75, 0.5), stage.paint(cloth, ambient=0.4)
        ),
    ]
    post = stage.paint(stage.natural("ivory", "sand", contrast=6))
    layers.append(stage.bar((x(0.9), y(0.1)), (x(0.9), y(0.9)), 4.0, Plane(1.1), post))
    return Scene(layers, noise=0.7)


def _mixed(stage: Stage, near: float, far: float, noise: float = 0.0) -> Scene:
    """A little of everything between two disparities, both of which occur."""
    x, y, side = stage.x, stage.y, stage.side

    def d(share: float) -> float:
        return far + share * (near - far)

    wall, ground = stage.natural("haze", "slate", "sand", "ivory"), stage.striped("olive", "clay", "sand")
    cloth, green = (
        stage.natural("sand", "brick", "slate"),
        stage.natural("moss", "olive", "haze", contrast=12),
    )
    layers = [
        stage.wall(stage.tilted(d(0.0), d(0.12), d(0.0)), wall),
        Layer(Plane(d(0.05), along_y=(d(0.75) - d(0.05)) / (0.45 * stage.height), y0=y(0.58)), Paint(ground)),
        Layer(
            stage.tilted(d(0.0), d(0.12), d(0.0)),
            stage.paint(stage.plain("haze")),
            rectangle(x(0.4), y(0.2), 0.3 * side, 0.24 * side),
        ),
        Layer(
            Ellipsoid(x(0.3), y(0.56), 0.15 * side, 0.17 * side, d(0.25), d(0.5) - d(0.25)),
            stage.paint(wall, ambient=0.45),
        ),
        *stage.box(x(0.66), y(0.66), 0.24 * side, 0.2 * side, d(0.6), cloth, deep=d(0.1) - far),
    ]
    for i in range(14):
        middle = x(0.86 + 0.12 * stage.uniform(-1, 1)), y(0.3 + 0.24 * stage.uniform(-1, 1))
        layers.append(
            stage.leaf(
                middle, side * stage.uniform(0.04, 0.08), d(0.4 + 0.033 * i), green, lift=d(0.08) - far
            )
        )
    for i, width in enumerate((2.0, 3.0, 5.0)):
        column = x(0.52 + 0.05 * i)
        layers.append(
            stage.bar(
                (column, y(0.05)),
                (column - 0.08 * side, y(0.5)),
                width,
                Plane(d(0.5 + 0.1 * i)),
                stage.paint(cloth, tint=0.2),
            )
        )
    near_sheet = Layer(
        Plane(near), stage.paint(green), rectangle(x(0.1), y(0.83), 0.3 * side, 0.16 * side, -0.3)
    )
    return Scene([*layers, near_sheet], noise=noise)


def _gloss(stage: Stage) -> Scene:
    x, y, side = stage.x, stage.y, stage.side
    board, glaze = (
        stage.natural("clay", "brick", "olive"),
        stage.natural("slate", "haze", contrast=6, weak=0.6),
    )
    slab = Plane(-0.7, 0.5 / stage.width, 1.8 / stage.height, x(0.5), y(0.5))
    layers = [
        stage.wall(Plane(-1.2, along_x=0.3 / stage.width), stage.natural("sand", "olive", "haze")),
        Layer(
            slab, stage.paint(board), rectangle(x(0.5), y(0.62), 0.9 * stage.width, 0.72 * stage.height, 0.06)
        ),
        Layer(
            Ellipsoid(x(0.32), y(0.4), 0.17 * side, 0.17 * side, 0.2, 0.9), stage.paint(glaze, ambient=0.3)
        ),
        Layer(Ellipsoid(x(0.73), y(0.5), 0.1 * side, 0.26 * side, 0.3, 0.6), stage.paint(board, ambient=0.3)),
    ]
    lights = [
        Highlight(1, x(0.55), y(0.82), 0.1 * side, 0.05 * side, -1.1, 110),
        Highlight(1, x(0.2), y(0.78), 0.035 * side, 0.03 * side, -0.9, 150),
        Highlight(2, x(0.26), y(0.32), 0.035 * side, 0.03 * side, 0.45, 170),
        Highlight(2, x(0.38), y(0.48), 0.09 * side, 0.09 * side, 0.3, 45),
        Highlight(3, x(0.7), y(0.44), 0.018 * side, 0.09 * side, 0.4, 130),
    ]
    return Scene(layers, lights)


def _fence(stage: Stage) -> Scene:
    x, y, side = stage.x, stage.y, stage.side
    metal, wood = stage.natural("slate", "haze", contrast=8), stage.striped("clay", "olive", "soot")
    shrub, ground = stage.natural("moss", "olive", contrast=14), stage.natural("olive", "sand", "moss")
    layers = [
        stage.wall(stage.tilted(-1.5, -1.1, -1.5), stage.natural("haze", "slate", "brick", "sand")),
        Layer(Plane(-1.2, along_y=1.9 / (0.45 * stage.height), y0=y(0.55)), stage.paint(ground)),
        *stage.box(x(0.65), y(0.56), 0.3 * side, 0.24 * side, -0.5, wood),
    ]
    for i in range(24):
        middle = x(stage.uniform(0.02, 0.4)), y(stage.uniform(0.35, 0.75))
        layers.append(
            stage.leaf(middle, side * stage.uniform(0.03, 0.07), -0.9 + 1.3 * i / 23, shrub, lift=0.2)
        )
    mesh = grid(x(0.5), y(0.5), max(14.0, 0.09 * side), 2.5, pi / 4)
    layers.append(Layer(Plane(1.2, along_x=0.4 / stage.width), stage.paint(metal), mesh, tags=THIN))
    for column in (0.06, 0.94):
        post = rectangle(x(column), y(0.5), 0.035 * side, 2.0 * stage.height)
        layers.append(Layer(Plane(1.7), stage.paint(wood), post))
    return Scene(layers)


_MIXED = "Slanted wall and ground, a textureless patch, a ball, a box, leaves, bars, a sheet in front"
_NOISE = {"noise-1": 2.0, "noise-2": 5.0, "noise-3": 10.0}
_SPANS = {"range-1": 1, "range-4": 4, "range-8": 8}

SUITE = {
    "demo": Recipe(
        _demo,
        "Slanted planes, an occluder in front, thin bars, a textureless patch, a box, a vase; "
        "D from -1.3 to 1.6.",
    ),
    "bars": Recipe(
        _bars,
        "Fourteen bars, 1.5 to 6 px wide, upright, level and oblique, at D 0.2 to 1.8 "
        "before a wall slanted from -1.5 to -0.3.",
    ),
    "leaves": Recipe(
        _leaves,
        "130 leaves, pointed or round, at random angles and depths, half of them slanted; "
        "D from -1.6 to 1.6.",
    ),
    "sphere": Recipe(
        _sphere,
        "A large smooth sphere of low contrast, a small mottled one, a slanted wall behind; "
        "D from -1.2 to 1.5.",
    ),
    "room": Recipe(
        _room,
        "A corner of a room: floor, back wall and side wall are slanted and almost without texture; in it a "
        "carpet, a picture, two boxes, a ball and a lamp post. A little sensor noise. D from -1.4 to 1.7.",
    ),
    **{
        name: Recipe(
            partial(_mixed, near=1.7, far=-1.5, noise=noise),
            f"{_MIXED}; shot and read noise, {noise:g} grey levels at mid grey; D from -1.5 to 1.7.",
        )
        for name, noise in _NOISE.items()
    },
    "gloss": Recipe(
        _gloss,
        "Blobs of light that move with disparities of their own over a slanted textured board, a ball and a "
        "vase; truth is the surface's; D from -1.2 to 1.1.",
    ),
    **{
        name: Recipe(
            partial(_mixed, near=span / 2, far=-span / 2), f"{_MIXED}; D from {-span / 2:g} to {span / 2:g}."
        )
        for name, span in _SPANS.items()
    },
    "fence": Recipe(
        _fence,
        "A mesh of wires 2.5 px thick and posts at D 1.2 to 1.7 before slanted ground, a wall, a box "
        "and shrubs; D from -1.5.",
    ),
}
"""Scenes by name."""
