"""A scene that moves: a tilted wall, things that stand still, and a slanted board that crosses them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import cos, sin

from lfdepth.lightfield import LightField
from lfdepth.scenes.model import Ellipsoid, Layer, Paint, Plane, Scene, rectangle
from lfdepth.scenes.suite import Stage

APPROACH = 0.02
"""By how much the disparity of the board grows for each px that it moves, px per view step."""
NEAREST = 1.6
"""Where it comes no nearer, px per view step."""
_FRAMES_APART = 100_003  # seeds of noise: those of two scenes do not meet


def frames(
    count: int,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    noise: float,
    motion: float,
    cut: int | None,
    samples: int,
) -> Iterator[LightField]:
    """Render one frame after the other, each with noise of its own."""
    from lfdepth.scenes import rendering  # numba loads late

    height, width = size
    for frame in range(count):
        after = cut is not None and frame >= cut
        scene = build(Stage(height, width, seed + after), motion * frame, mirrored=after)
        made = rendering.render(
            scene, f"frame-{frame:04d}", size, views, seed + _FRAMES_APART * (frame + 1), noise, samples
        )
        yield made.lf


def build(stage: Stage, moved: float, *, mirrored: bool = False) -> Scene:
    """The scene with the board `moved` px on its way; mirrored, it comes from the other side."""
    x, y, side = stage.x, stage.y, stage.side
    way = -1 if mirrored else 1
    wall = stage.natural("sand", "haze", "clay")
    cloth, wood = stage.natural("slate", "haze", "ivory"), stage.natural("clay", "slate", "moss", contrast=18)
    layers = [
        stage.wall(stage.tilted(-1.3, -0.6, -1.1), wall),
        *stage.box(x(0.5 + 0.2 * way), y(0.68), 0.26 * side, 0.3 * side, 0.3, cloth),
        Layer(
            Ellipsoid(x(0.5 - 0.1 * way), y(0.3), 0.13 * side, 0.13 * side, -0.5, 0.6),
            stage.paint(cloth, ambient=0.35),
        ),
    ]
    start, lifted = x(0.5 - 0.26 * way), min(0.8 + APPROACH * abs(moved), NEAREST)
    middle = start + way * moved
    surface = Plane(lifted, 0.4 / side, -0.2 / side, middle, y(0.5))
    board = rectangle(middle, y(0.5), 0.24 * side, 0.5 * side, 0.3)
    layers.append(Layer(surface, _moved(stage.paint(wood), way * moved), board))
    return Scene(layers)


def _moved(paint: Paint, right: float) -> Paint:
    """Paint that moves with its surface."""
    dx, dy, scale, angle = paint.move
    return replace(
        paint, move=(dx - right * scale * cos(angle), dy + right * scale * sin(angle), scale, angle)
    )
