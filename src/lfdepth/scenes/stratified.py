"""Scenes after the stratified ones of the 4D Light Field Benchmark: each asks one question.

Their masks carry the benchmark's names (Honauer et al. 2016, doi:10.1007/978-3-319-54187-7_2); the scenes
themselves have names of their own, because figures published for the benchmark's are not theirs.
"""

from __future__ import annotations

import numpy as np

from lfdepth.scenes.model import (
    Ellipsoid,
    Facets,
    Layer,
    Paint,
    Plane,
    Scene,
    Shape,
    ellipse,
    polygon,
    rectangle,
)
from lfdepth.scenes.suite import Recipe, Stage, Texture


def _wedges(stage: Stage) -> Scene:
    x, y, height = stage.x, stage.y, stage.height
    split, base, tip = y(0.32), x(0.09), x(0.93)
    sheet = Plane(0.5, along_y=-0.6 / height)
    paint = stage.paint(stage.natural("slate", "haze", weak=0.2, contrast=9))
    layers = [Layer(sheet, paint, _slab(-stage.width, base, -height, 2 * height))]
    walls = (  # the far one goes on behind the near one, or some views would look between them
        (Plane(-1.6, along_y=0.5 / height), stage.natural("moss", "slate"), -height, 2 * height),
        (Plane(-0.9, along_y=0.6 / height), stage.natural("brick", "clay"), split, 2 * height),
    )
    for surface, texture, top, bottom in walls:
        wall = stage.paint(texture)
        between, beside = _slab(-stage.width, tip, top, bottom), _slab(tip, 2 * stage.width, top, bottom)
        layers.append(Layer(surface, wall, between, tags={"foreground_fattening": 1}))
        layers.append(Layer(surface, wall, beside))
    count = max(3, height // 24)
    for i in range(count):
        start, end = height * i / count - 0.5, height * (i + 1) / count - 0.5
        point = tip - x(stage.uniform(0, 0.05)), stage.uniform(start, end)
        outline = polygon([(base - 1, start), (base - 1, end), point])
        layers.append(Layer(sheet, paint, outline, tags={"foreground_thinning": 1}))
    return Scene(layers)


def _slab(left: float, right: float, top: float, bottom: float) -> Shape:
    """Upright rectangle between four edges."""
    return rectangle((left + right) / 2, (top + bottom) / 2, right - left, bottom - top)


def _solids(stage: Stage) -> Scene:
    paints = [
        stage.paint(stage.natural(*names, weak=0.25)) for names in (("sand", "clay"), ("haze", "ivory"))
    ]
    base, radius = -0.1, 0.13 * stage.side
    layers, mouths = [], []
    for i in range(9):
        x, y = stage.x(0.18 + 0.32 * (i % 3)), stage.y(0.18 + 0.32 * (i // 3))
        height = min(0.3 + 0.1 * i, 0.08 * radius)  # no steeper, or far views see pyramids from behind
        round_, hollow = i % 2 == 0, i % 4 >= 2
        outline = ellipse(x, y, radius, radius) if round_ else rectangle(x, y, 2 * radius, 2 * radius)
        if round_:
            surface: Ellipsoid | Facets = Ellipsoid(x, y, radius, radius, base, height, far=hollow)
        else:
            surface = pyramid(x, y, radius, base, -height if hollow else height)
        tag = ("sphere_in" if hollow else "sphere_out") if round_ else "pyramids"
        layers.append(Layer(surface, paints[i % 2], outline, tags={tag: 1}))
        if hollow:
            mouths.append(outline)
    ground = stage.paint(stage.natural("olive", "sand", "slate"))
    return Scene([Layer(Plane(base), ground, holes=mouths, tags={"plane": 1}), *layers])


def pyramid(x: float, y: float, radius: float, base: float, height: float) -> Facets:
    """Square pyramid on a plane of disparity `base`, 2·radius px wide; a pit where the height is negative."""
    slope, apex = height / radius, base + height
    sides = [Plane(apex, along_x=side * slope, x0=x) for side in (-1, 1)]
    sides += [Plane(apex, along_y=side * slope, y0=y) for side in (-1, 1)]
    return Facets(sides, hollow=height < 0)


def _specks(stage: Stage) -> Scene:
    rows = columns = 4
    wall, disc = stage.natural("haze", "slate", weak=0.1), stage.natural("sand", "haze", weak=0.1)
    ground, share = stage.paint(wall), np.empty((stage.height, stage.width), np.float32)
    layers, discs = [], []
    for box in range(rows * columns):
        top, bottom = _part(stage.height, box // columns, rows)
        left, right = _part(stage.width, box % columns, columns)
        share[top:bottom, left:right] = box / (rows * columns - 1)
        outer = _slab(*_reaching(left, right, stage.width), *_reaching(top, bottom, stage.height))
        layers.append(Layer(Plane(-0.6), ground, outer, tags={"background": 1, "boxes": box + 1}))
        places = stage.rng.permutation(9)
        for size in range(8):
            row, column = divmod(int(places[size]), 3)
            x, y = left + (right - left) * (column + 0.5) / 3, top + (bottom - top) * (row + 0.5) / 3
            radius = 0.08 * min(right - left, bottom - top) * 0.7 ** (7 - size)
            tags = {"boxes": box + 1, "dots_by_size": size + 1}
            discs.append(Layer(Plane(0.8), stage.paint(disc), ellipse(x, y, radius, radius), tags=tags))
    return Scene([*layers, *discs], noise=16.0, noise_share=share)


def _part(length: int, index: int, count: int) -> tuple[int, int]:
    """Start and end of one of `count` equal parts."""
    return length * index // count, length * (index + 1) // count


def _reaching(start: float, end: float, length: int) -> tuple[float, float]:
    """Pixel edges of a part; parts at the border go on beyond it, where other views look."""
    return (start - 0.5 if start > 0 else -length), (end - 0.5 if end < length else 2 * length)


def _strips(stage: Stage) -> Scene:
    plain_wall, plain_strip = stage.plain("sand", grain=0.2), stage.plain("clay", grain=0.2)
    zones: tuple[tuple[str, Texture, Texture], ...] = (
        ("high_contrast", stage.natural("ivory", "sand", weak=0.1), stage.natural("soot", "slate", weak=0.1)),
        ("low_contrast", stage.natural("haze", "slate", weak=0.1), stage.natural("haze", "slate", weak=0.1)),
        ("low_texture", plain_wall, plain_strip),
    )
    layers = []
    for i, (zone, wall, strip) in enumerate(zones):
        top, bottom = _reaching(*_part(stage.height, i, len(zones)), stage.height)
        behind = _slab(-stage.width, 2 * stage.width, top, bottom)
        layers.append(Layer(Plane(-0.8), stage.paint(wall), behind, tags={zone: 1}))
        layers += [
            Layer(Plane(disparity), paint, _slab(left, right, top, bottom), tags={zone: 1})
            for left, right, disparity, paint in _row_of_strips(stage, stage.paint(strip))
        ]
    return Scene(layers)


def _row_of_strips(stage: Stage, paint: Paint) -> list[tuple[float, float, float, Paint]]:
    """(left, right, disparity, paint) of stripes that widen and come nearer from left to right."""
    count = 11
    widths = np.geomspace(2.0, max(4.0, 20.0 * stage.width / 512), count)
    gap = (stage.width - widths.sum()) / (count + 1)
    lefts = gap * np.arange(1, count + 1) + np.cumsum(widths) - widths
    return [
        (float(left), float(left + width), 1.6 * i / (count - 1) - 0.6, paint)
        for i, (left, width) in enumerate(zip(lefts, widths, strict=True))
    ]


STRATIFIED = {
    "wedges": Recipe(
        _wedges,
        "After the benchmark's backgammon: wedges of a slanted sheet taper off before two backgrounds "
        "slanted the other way; where does the foreground fatten, where does it thin? D from -1.6 to 0.5.",
    ),
    "solids": Recipe(
        _solids,
        "After the benchmark's pyramids: domes, bowls, pyramids and pits in a level plane; are smooth and "
        "plane surfaces kept smooth and plane? D from -1.1 to 1.0.",
    ),
    "specks": Recipe(
        _specks,
        "After the benchmark's dots: sixteen boxes, each with eight floating discs of 2 to 20 px, under "
        "sensor noise that grows from box to box; which discs are found? D -0.6 and 0.8.",
    ),
    "strips": Recipe(
        _strips,
        "After the benchmark's stripes: upright stripes, 2 to 20 px wide, before a wall, in three zones: "
        "dark on light, alike in colour, and without texture; what do texture and contrast decide at edges? "
        "D from -0.8 to 1.0.",
    ),
}
"""Scenes by name."""
