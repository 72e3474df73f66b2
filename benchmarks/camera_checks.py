"""Which warnings an estimate gives: one at least for every broken light field, none for clean ones.

    python benchmarks/camera_checks.py            # both
    python benchmarks/camera_checks.py --only broken --methods fbs-vis

Broken ones are a rectangle and a disc before a slanted wall, spoiled as real cameras or wrong options would
be, estimated with every mend switched off. Clean ones are the procedural scenes with several seeds, sizes and
grids, and, where they are, the benchmark's scenes and a picture of a plenoptic camera. Exits with 1 if a
broken one is silent or a clean one is not.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lfdepth
from cameras import CASES, NOISE
from lfdepth import scenes
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, grid_offsets
from lfdepth.scenes.cameras import spoil
from lfdepth.scenes.stratified import STRATIFIED
from lfdepth.scenes.suite import SUITE

DATA = Path(__file__).parents[2] / "shared/data"
GRID, SIZE, RANGE = (7, 7), (120, 160), (-1.4, 1.2)
BRIGHTNESS = {
    name: case
    for name, case in CASES.items()
    if name not in ("corner views 80 %", "vignetting 70 %", "vignetting and gains")
} | {"all together": replace(CASES["all together"], white_balance=0.0)}
OTHER_GRIDS = {
    (8, 8): ((64, 1), (1, 64), (16, 4), (4, 16)),
    (6, 6): ((4, 9), (9, 4), (3, 12)),
    (5, 9): ((9, 5), (3, 15)),
    (7, 7): ((49, 1), (1, 49)),
}
CLEAN = ((96, 9, 1), (128, 5, 2), (128, 3, 3), (160, 9, 4))

Array = NDArray[Any]


def waves(seed: int) -> Callable[[Array, Array], Array]:
    """A texture, defined at every real (x, y)."""
    rng = np.random.default_rng(seed)
    angle, phase = rng.uniform(0, 2 * np.pi, (2, 30))
    frequency = 2 * np.pi / np.geomspace(5, 60, 30)

    def value(x: Array, y: Array) -> Array:
        turns = frequency * (np.cos(angle) * x[..., None] + np.sin(angle) * y[..., None]) + phase
        return np.asarray(0.45 + 0.35 * np.tanh(np.sin(turns).sum(axis=-1) / 3))

    return value


def field(
    steps: Array, size: tuple[int, int] = SIZE, near: float = 1.0, far: float = -1.0, seed: int = 0
) -> LightField:
    """Views from cameras at `steps` (V, U, 2) of a disc and a rectangle before a slanted wall."""
    height, width = size
    wall, front = waves(seed), waves(seed + 1)
    y, x = np.mgrid[:height, :width].astype(float)
    slope = 0.4 / height

    def inside(column: Array, row: Array) -> Array:
        disc = (column - 0.35 * width) ** 2 + (row - 0.5 * height) ** 2 < (0.22 * height) ** 2
        return disc | (
            (abs(column - 0.72 * width) < 0.1 * width) & (abs(row - 0.55 * height) < 0.25 * height)
        )

    views = np.empty((*steps.shape[:2], height, width))
    for index in np.ndindex(*steps.shape[:2]):
        down, across = steps[index]
        # row + (far + slope·(row − height/2))·down, solved for the row of the reference view
        row = (y + down * (far - slope * height / 2)) / (1 - slope * down)
        behind = wall(x + (far + slope * (row - height / 2)) * across, row)
        column, line = x + near * across, y + near * down
        views[index] = np.where(inside(column, line), front(column, line), behind)
    truth = np.where(inside(x, y), near, far + slope * (y - height / 2)).astype(np.float32)
    rng = np.random.default_rng(seed)
    noisy = np.clip(views + NOISE * rng.standard_normal(views.shape), 0, 1)
    return LightField(np.rint(255 * noisy).astype(np.uint8)[..., None], truth=truth)


def stored(lf: LightField, views: Array) -> LightField:
    """The light field with other views, without what is known of it."""
    return LightField(np.ascontiguousarray(views), name=lf.name)


def broken() -> Iterator[tuple[str, LightField, tuple[float, float] | None]]:
    """Name, light field, and the range that is given."""
    regular = grid_offsets(GRID)
    rng = np.random.default_rng(1)
    straying = rng.standard_normal((*GRID, 2))
    straying -= straying[GRID[0] // 2, GRID[1] // 2]
    intact = field(regular)
    for name, imperfections in BRIGHTNESS.items():
        spoiled = spoil(intact, replace(imperfections, noise=NOISE))
        yield name, spoiled, RANGE
    for bits in (10, 12):
        partly = (intact.views.astype(np.uint16) * 257) >> (16 - bits)
        yield f"{bits} bits in 16", stored(intact, partly), RANGE
    for aspect in (0.8, 0.5):
        yield f"steps 1:{aspect}", field(regular * [aspect, 1]), RANGE
    for stray in (0.05, 0.15):
        yield f"cameras {100 * stray:.0f} % off", field(regular + stray * straying), RANGE
    wound = intact.views.copy()
    wound[1::2] = wound[1::2, ::-1]
    yield "serpentine", stored(intact, wound), RANGE
    yield "transposed grid", stored(intact, intact.views.swapaxes(0, 1)), RANGE
    yield "mirrored grid", stored(intact, intact.views[:, ::-1]), RANGE
    for taken, grids in OTHER_GRIDS.items():
        views = field(grid_offsets(taken)).views
        for grid in grids:
            name = f"{taken[1]}x{taken[0]} as {grid[1]}x{grid[0]}"
            yield name, stored(intact, views.reshape(*grid, *SIZE, 1)), RANGE
    tiles = views.reshape(*taken, *SIZE).swapaxes(1, 2).reshape(3, 7 * SIZE[0] // 3, 7, SIZE[1])
    yield "tiles 7x7 as 7x3", stored(intact, tiles.swapaxes(1, 2)[..., None]), RANGE
    yield "range cut off above", intact, (-1.4, 0.7)
    yield "range cut off below", intact, (-0.9, 1.2)
    yield "range beside the scene", intact, (2.0, 4.0)
    yield "beyond the limit, 1x5", field(grid_offsets((1, 5)), (96, 160), 52.0, 43.0), None


def clean() -> Iterator[tuple[str, Callable[[], LightField]]]:
    """Name and light field."""
    for size, views, seed in CLEAN:
        for name in (*SUITE, *STRATIFIED):
            yield f"{name} {views}x{views} {size} px", partial(rendered, name, size, views, seed)
    for name in ("leaves", "room", "fence"):
        yield f"{name} 9x1 128 px", partial(row, name)
    for part in (1 / 3, 2 / 3):  # by so much of the picture the front moves from one end to the other
        line = partial(field, grid_offsets((1, 101)), (80, 160), 1.6 * part, -0.2)
        yield f"front over {part:.2f} 101x1", line
    for size, grid in ((64, (1, 9)), (64, (9, 1)), (96, (1, 9)), (64, (1, 5))):
        yield f"field {grid[1]}x{grid[0]} {size} px", partial(field, grid_offsets(grid), (size, size + 16))
    yield "field 7x7", partial(field, grid_offsets(GRID), seed=7)
    for name in ("cotton", "backgammon"):
        if (DATA / "hci4d" / name).is_dir():
            yield name, partial(lfdepth.read, DATA / "hci4d" / name)
    if (DATA / "lytro_bikes_crop_eslf.png").is_file():
        yield "plenoptic picture", partial(lfdepth.read, DATA / "lytro_bikes_crop_eslf.png")


def rendered(name: str, size: int, views: int, seed: int) -> LightField:
    """A procedural scene."""
    return scenes.render(name, size=size, views=views, seed=seed, samples=2)


def row(name: str) -> LightField:
    """A row of views of one."""
    lf = rendered(name, 128, 9, 5)
    return replace(lf, views=lf.views[lf.centre[0]][None])


def warnings(lf: LightField, method: str, **options: Any) -> tuple[str, ...]:
    """What an estimate says: warnings, or why it refuses."""
    try:
        checks = lfdepth.estimate(lf, method, **options).checks
    except LightFieldError as error:
        return (f"refused: {error}",)
    assert checks is not None
    return checks.warnings


def main() -> None:
    """Print a line per light field."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=["broken", "clean"])
    parser.add_argument("--methods", nargs="+", default=["fbs-vis"])
    parser.add_argument(
        "--found", action="store_true", help="clean ones: find the range in the views as well"
    )
    given = parser.parse_args()
    faults = 0
    for method in given.methods:
        for name, lf, range in broken() if given.only != "clean" else ():
            said = warnings(lf, method, range=range, equalise=False)
            faults += not said
            shown = " | ".join(words[:75] for words in said) or "SILENT"
            print(f"broken  {method:10} {name:28}{shown}", flush=True)
        for name, make in clean() if given.only != "broken" else ():
            lf = make()
            said = warnings(replace(lf, disparity_range=None) if given.found else lf, method)
            faults += bool(said)
            print(f"clean   {method:10} {name:28}{' | '.join(said) or 'quiet'}", flush=True)
    print(f"{faults} wrong")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
