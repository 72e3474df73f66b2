"""The page docs/comparison.md: all methods over procedural scenes and those of the benchmark that are there.

    python benchmarks/comparison.py [--data FOLDER] [--scenes suite] [--size 192] [--methods all]

FOLDER holds scenes of the 4D Light Field Benchmark, one folder each. Writes the page, pictures of where each
method fails, and the chart of time against error. Estimates are remembered in --cache, so that an interrupted
run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from lfdepth import scenes
from lfdepth.bench.charts import COLOURS, Axis, Point, point_chart
from lfdepth.bench.plan import SceneSpec
from lfdepth.bench.results import Bench, SceneResult
from lfdepth.bench.run import bench
from lfdepth.methods import LEARNED, NAMES, WITHOUT_WEIGHTS
from lfdepth.paper.experiments import SUBSTITUTED
from lfdepth.pictures import PanelRow, panel
from lfdepth.scoring.captions import score_line
from lfdepth.table import Table
from reporting import Cell, machine_line

DOCS = Path(__file__).resolve().parents[1] / "docs"
METRICS = {
    "badpix_0.07": "BadPix 0.07",
    "badpix_0.03": "0.03",
    "badpix_0.01": "0.01",
    "mse_x100": "MSE×100",
    "badpix_0.07_boundaries": "0.07 at boundaries",
    "badpix_0.07_textureless": "0.07 textureless",
    "ause_badpix_0.07": "AUSE",
}
PICTURED = ("bars", "leaves", "fence")
"""Scenes of which pictures are shown: rendered ones, as the benchmark's licence is not this repository's."""

WIDEST = 1600
"""Width of pictures in px."""


def specs(data: Path | None, names: Sequence[str], size: int) -> Iterator[SceneSpec]:
    """Scenes of the benchmark first, then procedural ones."""
    for folder in sorted(data.iterdir()) if data else []:
        if (folder / "parameters.cfg").is_file():
            yield SceneSpec(folder, folder.name)
    for name in names:
        yield SceneSpec(scenes.render(name, size=size), name)


def starred(name: str) -> str:
    return f"{name} *" if name in SUBSTITUTED else name


def mean(found: Sequence[SceneResult], name: str, key: str) -> float | None:
    """Mean of a score, or of the run time, over the scenes that have it."""
    entries = [scene.entries[name] for scene in found if name in scene.entries]
    if key == "runtime":
        values = [each.found.runtime for each in entries]
    else:
        values = [each.scores.get(key) for each in entries if each.scores]
    known = [each for each in values if each is not None]
    return float(np.mean(known)) if known else None


def scores_table(found: Sequence[SceneResult], names: Sequence[str]) -> str:
    rows: list[list[Cell]] = [
        [starred(name), *(mean(found, name, key) for key in (*METRICS, "runtime"))] for name in names
    ]
    return Table.of(["method", *METRICS.values(), "seconds"], rows).to_markdown()


def scene_table(found: Sequence[SceneResult], names: Sequence[str], key: str) -> str:
    """One score of every method on every scene."""
    rows: list[list[Cell]] = [[scene.name, *(mean([scene], name, key) for name in names)] for scene in found]
    return Table.of(["scene", *names], rows).to_markdown()


def chart(found: Sequence[SceneResult], names: Sequence[str]) -> str:
    """SVG of the mean time against the mean error."""
    points = []
    for index, name in enumerate(names):
        seconds, bad = mean(found, name, "runtime"), mean(found, name, "badpix_0.07")
        if seconds is not None and bad is not None:
            points.append(Point(name, seconds, bad, COLOURS[index % len(COLOURS)]))
    low, high = min(point.x for point in points) / 1.5, max(point.x for point in points) * 1.5
    top = max(point.y for point in points) * 1.1
    drawn = str(point_chart(points, Axis("seconds", low, high, log=True), Axis("BadPix 0.07 (%)", 0, top)))
    return drawn if "xmlns" in drawn else drawn.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)


def picture(scene: SceneResult, names: Sequence[str]) -> str:
    """Write the maps and signed errors of a scene; the picture's name."""
    entries = {name: scene.entries[name] for name in names if name in scene.entries}
    maps = {name: each.found.disparity for name, each in entries.items()}
    captions = {name: score_line(each.scores) for name, each in entries.items() if each.scores}
    name = f"comparison-{scene.name}.webp"
    half = len(maps) // 2 + 1
    lines = [dict(list(maps.items())[part]) for part in (slice(half), slice(half, None))]
    rows = [
        PanelRow(scene.reference, part, scene.truth, scene.name, None, captions) for part in lines if part
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.png"
        panel(*rows, path=path)
        with Image.open(path) as whole:
            shown = whole.convert("RGB")
    shown.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    shown.save(DOCS / "images" / name, quality=85)
    return name


def page(result: Bench, names: Sequence[str], command: str) -> str:
    """The page's text."""
    real = [scene for scene in result.scenes if scene.name not in scenes.NAMES]
    suite = [scene for scene in result.scenes if scene.name in scenes.NAMES]
    lines = [
        "# All methods compared",
        "",
        f"Made by `{command}`. {machine_line()}.",
        "BadPix and AUSE in %; lower is better everywhere. [Compared methods](compared-methods.md) says how",
        "each works and what of it is ours; those marked * have steps that are not the original's:",
        "",
        *(f"- {name}: {what}." for name, what in SUBSTITUTED.items() if name in names),
        "",
    ]
    for title, found in (("Scenes of the 4D Light Field Benchmark", real), ("Procedural scenes", suite)):
        if found:
            height, width = found[0].reference.shape[:2]
            lines += [f"## {title}", "", f"Means over {len(found)} scenes of {width}×{height} px.", ""]
            lines += [scores_table(found, names), "", "BadPix 0.07 by scene:", ""]
            lines += [scene_table(found, names, "badpix_0.07"), ""]
    (DOCS / "images" / "comparison-time.svg").write_text(chart(result.scenes, names), encoding="utf-8")
    lines += ["## Time against error", "", "![Time against error](images/comparison-time.svg)", ""]
    lines += ["## Where each fails", "", "Maps and signed errors: blue too far, red too near.", ""]
    for scene in result.scenes:
        if scene.name in PICTURED:
            lines += [f"![{scene.name}](images/{picture(scene, names)})", ""]
    lines += [f"- failed: {failure}" for failure in result.failures]
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder with scenes of the benchmark")
    parser.add_argument("--scenes", nargs="*", default=["suite"])
    parser.add_argument("--size", type=int, default=192, help="of the procedural scenes")
    parser.add_argument("--methods", nargs="+", default=["all"])
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "lfdepth-comparison")
    chosen = parser.parse_args()
    every = [*NAMES, *(name for name in LEARNED if name not in WITHOUT_WEIGHTS)]
    names = every if "all" in chosen.methods else chosen.methods
    wanted = [name for each in chosen.scenes for name in (scenes.NAMES if each == "suite" else (each,))]
    found = bench(
        list(specs(chosen.data, wanted, chosen.size)),
        names,
        chosen.cache,
        published=False,
        progress=lambda done, total, what: print(f"{done}/{total} {what}", flush=True),
    )
    command = f"python benchmarks/comparison.py --scenes {' '.join(chosen.scenes)} --size {chosen.size}"
    command += " --data FOLDER" * bool(chosen.data)
    (DOCS / "comparison.md").write_text(page(found, names, command), encoding="utf-8")


if __name__ == "__main__":
    main()
