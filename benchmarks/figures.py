"""The figures of docs/fbs-vis.md, from runs on procedural scenes, and the shares that its text quotes.

    python benchmarks/figures.py [mask] [decisions] [remaining] [--size 384] [--data DIR]

Writes docs/images/fbs-vis-NAME.png and prints the numbers that go with it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lfdepth
from ablation import light_fields, with_textureless
from lfdepth import LightField, scenes
from lfdepth.engines.cpu.engine import CpuEngine
from lfdepth.engines.layout import VISIBILITY_MARGIN, plane_horizon
from lfdepth.io.pixels import write_picture
from lfdepth.pictures import (
    ERROR_LABEL,
    ERROR_LIMIT,
    Bar,
    Cell,
    Line,
    compose,
    error_colours,
    view_colours,
)
from lfdepth.result import Result
from lfdepth.scoring.captions import score_line
from lfdepth.scoring.metrics import badpix, near_boundaries, region
from lfdepth.trace import Trace
from reporting import Cell as TableCell
from reporting import markdown

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images"
METHOD = "fbs-vis"
BAD = 0.07
COLOURS = 32
"""Of the views in a figure."""

Map = NDArray[np.float32]
Pixels = NDArray[np.uint8]


# --- a run that can be looked into


@dataclass(eq=False)
class Watch:
    """What a run's blocks had in hand.

    Of three decisions, that of the first map, one with the votes of all views on all planes, and the last:
    maps (H, W) and shares of views (K, H, W). Of the blocks after the last decision: their maps.
    """

    signs: list[Map] = field(default_factory=list)
    both: list[Map] = field(default_factory=list)
    paths: list[Map] = field(default_factory=list)
    shares: list[Map] = field(default_factory=list)
    later: list[Map] = field(default_factory=list)

    def take(self, trace: Trace, decision: int, first: float, step: float) -> None:
        """Add a decision of a run."""
        signs, joint = (trace.kept[name][decision] for name in ("sign energies", "joint energies"))
        self.signs.append(least(signs, first, step))
        self.both.append(least(joint, first, step))
        self.paths.append(trace.kept["decisions"][decision])
        self.shares.append(trace.kept["shares"][decision])


DECISIONS = ("sign energies", "joint energies", "shares", "decisions")
LATER = ("median", "edges", "refined")


def watched(lf: LightField) -> tuple[Result, Watch]:
    """Estimate with `METHOD`, and once more without visibility for the decision between."""
    watch, trace, everywhere = Watch(), Trace(keep=DECISIONS + LATER), Trace(keep=DECISIONS)
    result = lfdepth.estimate(lf, METHOD, trace=trace)
    lfdepth.estimate(lf, METHOD, trace=everywhere, visibility=False, range=result.range)
    step = step_of(result)
    watch.take(trace, 0, result.range[1], 2 * step)
    watch.take(everywhere, 0, result.range[1], step)
    watch.take(trace, 1, result.range[1], step)
    watch.later = [trace.kept[name][-1] for name in LATER]
    return result, watch


def step_of(result: Result) -> float:
    """Distance between the planes of a result."""
    planes = result.method.planes_for(result.range)
    return float(planes[0] - planes[1])


def least(energy: NDArray[np.floating[Any]], first: float, step: float) -> Map:
    """Disparity (H, W) of the least energy (K, H, W) along the planes, between them by a parabola."""
    best = np.clip(energy.argmin(axis=0), 1, len(energy) - 2)[None]
    before, here, after = (np.take_along_axis(energy, best + i, 0)[0] for i in (-1, 0, 1))
    bend = before + after - 2 * here
    part = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=bend > 0)
    return np.asarray(first - step * (best[0] + np.clip(part, -1, 1)), np.float32)


# --- which block decides which pixel


BLOCKS: dict[str, tuple[int, int, int]] = {
    "signs": (205, 216, 229),
    "photo votes": (102, 166, 30),
    "exact visibility": (27, 120, 160),
    "scanlines, planes": (250, 170, 40),
    "median": (150, 90, 170),
    "depth edges": (214, 40, 40),
    "refinement": (120, 80, 50),
    "edge net": (20, 20, 20),
}
"""Blocks in their order, and their colours."""


def deciders(result: Result, watch: Watch) -> NDArray[np.intp]:
    """For each pixel (H, W) the last block that moved its disparity by over half a plane."""
    stages = [watch.signs[-1], *watch.both[1:], watch.paths[-1], *watch.later, result.disparity]
    least_move = 0.5 * (step_of(result))
    last = np.zeros(result.disparity.shape, np.intp)
    for block in range(1, len(stages)):
        last[np.abs(stages[block] - stages[block - 1]) > least_move] = block
    return last


DECIDED = ("demo", "wedges")
"""Scenes of the figure."""


def decisions(size: int) -> None:
    """Which block decides which pixel, and how well."""
    palette = np.array(list(BLOCKS.values()), np.uint8)
    swatches = [
        Cell(np.full((12, size, 3), colour, np.uint8), name)
        for name, colour in zip(BLOCKS, palette, strict=True)
    ]
    for name in DECIDED:
        lf = scenes.render(name, size=size)
        truth = truth_of(lf)
        result, watch = watched(lf)
        last = deciders(result, watch)
        cells = [
            Cell(few_colours(lf.reference), name),
            Cell(palette[last], "the last block that moved it"),
            Cell(error_colours(result.disparity, truth), "error: red too near, blue too far"),
        ]
        lines = [Line(swatches[first : first + 3]) for first in range(0, len(swatches), 3)]
        save(compose([Line(cells), *lines]), f"decisions-{name}")
        print(_block_table(result, watch, truth, last))


def _block_table(result: Result, watch: Watch, truth: Map, last: NDArray[np.intp]) -> str:
    """Share of each block's pixels, and how many of them are wrong without and with it."""
    inside, rows = region(truth), []
    for block, name in enumerate(BLOCKS):
        mine = inside & (last == block)
        wrong = [badpix(each, truth, BAD, mine) for each in (watch.signs[-1], result.disparity)]
        rows.append([name, f"{100 * mine.sum() / inside.sum():.1f}", *(f"{each:.1f}" for each in wrong)])
    return markdown(["last moved by", "pixels, %", "BadPix 0.07 by signs alone", "BadPix 0.07 at last"], rows)


# --- why the mask moves with the occluder


SLICE = "wedges"
COLUMN, ROW = 0.547, 0.25
"""Where the slice is, and the pixel in it, as shares of the size: a wall in the gap between two wedges."""
REACH = 18


@dataclass(frozen=True, eq=False)
class Slice:
    """Rows of one column of all views above one another, at the plane of one pixel."""

    lf: LightField
    column: int
    rows: NDArray[np.intp]
    plane: float

    @property
    def steps(self) -> NDArray[np.intp]:
        """Views from the reference view, (V, 1)."""
        count = self.lf.shape[0]
        return np.arange(count)[:, None] - count // 2

    def views(self) -> NDArray[np.float64]:
        """Colours (V, Y, 3), linear between pixels."""
        middle, tall = self.lf.shape[1] // 2, np.arange(self.lf.shape[2])
        at = self.rows - self.steps * self.plane
        column = self.lf.views[:, middle, :, self.column]
        return np.stack(
            [[np.interp(at[v], tall, view[:, c]) for v, view in enumerate(column)] for c in range(3)], axis=-1
        )

    def paper_mask(self, result: Result, smoothed: list[Map]) -> NDArray[np.bool_]:
        """Where the mask from J planes in front excludes a view from the vote of the background, (V, Y)."""
        planes, skip = result.method.planes_for(result.range), result.method.parameters()["skip"]
        index = int(np.abs(planes - self.plane).argmin())
        foreground = smoothed[index - skip][:, self.column] > 0
        at = np.rint(self.rows + self.steps * skip * (planes[0] - planes[1])).astype(np.intp)
        return np.asarray(foreground[at] & ~foreground[self.rows])

    def exact_mask(self, result: Result) -> NDArray[np.bool_]:
        """The same for exact visibility."""
        count, across, height, width = self.lf.shape[:4]
        engine = CpuEngine(threads=1)
        nearest = engine.surfaces_of(result.disparity, engine.views(self.lf))
        data = nearest.data.reshape(count, across, height, width)[:, across // 2, :, self.column]
        at = np.floor(self.rows - self.steps * self.plane + 0.5).astype(np.intp)
        in_front = result.disparity[self.rows, self.column] > self.plane + VISIBILITY_MARGIN
        return np.asarray((data[np.arange(count)[:, None], at] > plane_horizon(self.plane)) & ~in_front)


def mask(size: int) -> None:
    """A slice of the views at the plane of a wall between two wedges: what either mask excludes, profiles."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lf = scenes.render(SLICE, size=size)
    truth = truth_of(lf)
    column, row = round(COLUMN * size), round(ROW * size)
    result, watch = watched(lf)
    trace = Trace(keep=("smoothed",))
    paper = lfdepth.estimate(lf, "fbsocc-sfa", trace=trace)
    smoothed = trace.kept["smoothed"]
    part = Slice(lf, column, np.arange(row - REACH, row + REACH + 1), float(truth[row, column]))
    figure = Figure(figsize=(9.2, 6.6), dpi=110, layout="constrained")
    grid = figure.add_gridspec(4, 2, height_ratios=(1, 1, 1, 2.4))
    panels = [figure.add_subplot(grid[index, :]) for index in range(3)]
    nothing = np.zeros((lf.shape[0], part.rows.size), np.bool_)
    _draw_slice(panels[0], part, row, nothing, "the views, moved to the wall's plane")
    excluded = part.paper_mask(paper, smoothed)
    _draw_slice(panels[1], part, row, excluded, "red: excluded by the paper's mask (fbsocc-sfa)")
    _draw_slice(panels[2], part, row, part.exact_mask(result), "red: excluded by exact visibility (fbs-vis)")
    panels[2].set_xlabel(f"row y of column {column} (dotted: y = {row})")
    left, right = (figure.add_subplot(grid[3, side]) for side in (0, 1))
    _draw_signs(left, paper, np.stack(smoothed)[:, row, column])
    _draw_shares(right, result, watch, row, column)
    for axes in (left, right):
        axes.axvline(part.plane, color="tab:green", linewidth=1)
        axes.set_xlabel("plane, px per view step (green: truth)")
        axes.invert_xaxis()
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    save(np.array(canvas.buffer_rgba())[..., :3], "mask")
    print("truth around the pixel:", truth[row - 8 : row + 9, column].round(2))
    near = near_boundaries(truth)
    for name, found in (("fbsocc-sfa", paper), ("fbs-vis", result)):
        score = badpix(found.disparity, truth, BAD, near)
        print(f"{name}: {found.disparity[row, column]:.2f} there; near edges BadPix 0.07 {score:.1f} %")


def _draw_slice(axes: Any, part: Slice, row: int, excluded: NDArray[np.bool_], title: str) -> None:
    shown = part.views()
    low, high = shown.min(), shown.max()
    shown = (shown - low) * (255 / (high - low))  # contrast for the eye
    shown[excluded] = 0.2 * shown[excluded] + 0.8 * np.array((214, 40, 40))
    half = shown.shape[0] / 2
    extent = (part.rows[0] - 0.5, part.rows[-1] + 0.5, half, -half)
    axes.imshow(shown.astype(np.uint8), extent=extent, aspect="auto", interpolation="nearest")
    axes.axvline(row, color="white", linewidth=1, linestyle=":")
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_ylabel("view v")
    axes.set_yticks([-4, 0, 4])


def _draw_signs(axes: Any, paper: Result, profile: Map) -> None:
    axes.plot(paper.method.planes_for(paper.range), profile, color="tab:grey")
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set_title("sign votes, paper's mask", fontsize=10, loc="left")


def _draw_shares(axes: Any, result: Result, watch: Watch, row: int, column: int) -> None:
    every, seeing = (shares[:, row, column] for shares in watch.shares[1:])
    planes = result.range[1] - (step_of(result)) * np.arange(len(every))
    axes.plot(planes, every, color="tab:grey", label="of all views")
    axes.plot(planes, seeing, color="tab:blue", label="of those that see past")
    axes.set_ylim(0, 1.05)
    axes.set_title("share of views that agree in colour, fbs-vis", fontsize=10, loc="left")
    axes.legend(fontsize=8, frameon=False)


# --- where the remaining error is


SHOWN = ("room", "gloss", "noise-2", "fence")
LEVELS = 0.02
"""Errors are rounded to whole multiples of this before they are drawn, px per view step."""


def remaining(size: int, data: Path | None = None) -> None:
    """Signed errors of some procedural scenes, and where the error of all scenes is."""
    rows = []
    for _, found in light_fields(data, size, None):
        lf = with_textureless(found)
        estimate = lfdepth.estimate(lf, METHOD).disparity
        rows.append(_places(lf, estimate))
        if lf.name in SHOWN:
            _draw_error(lf, estimate)
    header = ["scene", "BadPix 0.07", "≤ 1.5 px from an edge", "≤ 5 px", "textureless", "elsewhere"]
    print(markdown([*header, "elsewhere by > 0.3 px", "MSE×100", "of it ≤ 5 px from an edge, %"], rows))


def _draw_error(lf: LightField, estimate: Map) -> None:
    truth = truth_of(lf)
    rounded = np.rint((estimate - truth) / LEVELS) * LEVELS
    cells = [
        Cell(few_colours(lf.reference), lf.name),
        Cell(error_colours(rounded, np.zeros_like(truth)), score_line(lfdepth.evaluate(estimate, truth))),
    ]
    bar = Bar("RdBu_r", (-ERROR_LIMIT, ERROR_LIMIT), ERROR_LABEL, open_ends=True)
    save(compose([Line(cells, bar)]), f"remaining-{lf.name}")


def _places(lf: LightField, estimate: Map) -> list[TableCell]:
    """Bad pixels by the first place that each is in, as shares of the frame in %, and the MSE."""
    truth = truth_of(lf)
    inside = region(truth)
    error = np.abs(estimate.astype(np.float64) - truth)
    places = [
        near_boundaries(truth, distance=1.5),
        near_boundaries(truth),
        lf.masks.get("textureless", np.zeros_like(inside)),
        np.ones_like(inside),
    ]
    left = inside & (error > BAD)
    parts = [left]
    for place in places:
        parts.append(left & place)
        left = left & ~place
    parts.append(parts[-1] & (error > 0.3))
    row: list[TableCell] = [lf.name]
    row += [f"{100 * part.sum() / inside.sum():.2f}" for part in parts]
    squares = np.where(inside, error**2, 0)
    total = squares.sum()
    return [*row, f"{100 * total / inside.sum():.2f}", f"{100 * squares[places[1]].sum() / total:.0f}"]


def truth_of(lf: LightField) -> Map:
    """The truth that every procedural scene has."""
    assert lf.truth is not None
    return lf.truth


def few_colours(view: NDArray[Any]) -> Pixels:
    """A view's colours with a small palette, so that its texture does not make the file large."""
    from PIL import Image

    picture = Image.fromarray(np.ascontiguousarray(view_colours(view)))
    return np.array(picture.quantize(COLOURS, dither=Image.Dither.NONE).convert("RGB"))


def save(pixels: Pixels, name: str) -> None:
    """Write a figure of the page."""
    path = FOLDER / f"fbs-vis-{name}.png"
    write_picture(path, pixels)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


FIGURES = ("mask", "decisions", "remaining")


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("names", nargs="*", default=list(FIGURES), help=", ".join(FIGURES))
    parser.add_argument("--size", type=int, default=384, help="of the procedural scenes, px")
    parser.add_argument("--data", type=Path, help="folder of benchmark scenes, for the table of `remaining`")
    chosen = parser.parse_args()
    if "mask" in chosen.names:
        mask(chosen.size)
    if "decisions" in chosen.names:
        decisions(chosen.size)
    if "remaining" in chosen.names:
        remaining(chosen.size, chosen.data)


if __name__ == "__main__":
    main()
