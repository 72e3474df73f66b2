"""Accuracy of every method on the procedural scenes, and on scenes of the benchmark where there are any.

    python benchmarks/accuracy.py [--data FOLDER] [--scenes demo bars ...] [--size 320] [--methods NAMES]

NAMES of methods, with parameters as in epinet-s:turns=8, or all; by default lfdepth's own without those
that they are compared with.
FOLDER holds scenes of the 4D Light Field Benchmark, one folder each, with low-resolution truth. The published
rows beside them are those of `lfdepth.bench.published`; those marked ^high were taken on high-resolution
truth, and compare only roughly.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import lfdepth
from lfdepth import LightField, scenes
from lfdepth.bench.plan import setting
from lfdepth.bench.published import published_rows
from lfdepth.methods import FAMILY, NAMES
from reporting import Cell, machine_line, markdown, write_json

METRICS = {
    "badpix_0.01": "BadPix 0.01",
    "badpix_0.03": "0.03",
    "badpix_0.07": "0.07",
    "mse_x100": "MSE×100",
    "q25": "Q25",
    "badpix_0.07_boundaries": "0.07 at boundaries",
    "badpix_0.07_textureless": "0.07 textureless",
    "ause_badpix_0.07": "AUSE",
    "runtime": "seconds",
}
"""Headings by metric, in the order of the tables."""

Scores = Mapping[str, float]


def light_fields(chosen: argparse.Namespace) -> Iterator[LightField]:
    """Scenes of the benchmark first, then procedural ones."""
    for folder in sorted(chosen.data.iterdir()) if chosen.data else []:
        if (folder / "parameters.cfg").is_file():
            yield lfdepth.read(folder)
    for name in chosen.scenes:
        yield scenes.render(name, size=chosen.size)


def score(lf: LightField, names: Sequence[str]) -> dict[str, Scores]:
    """Scores of every method; the kernels are compiled before the clock runs."""
    side = min(64, lf.width, lf.height)
    found: dict[str, Scores] = {}
    for name in names:
        method = setting(name).resolve()
        lfdepth.estimate(lf.crop(0, 0, side, side), method)
        found[name] = lfdepth.evaluate(lfdepth.estimate(lf, method), lf).scores
    return found


def rows(found: Mapping[str, Scores]) -> list[list[Cell]]:
    return [[name, *(scores.get(key) for key in METRICS)] for name, scores in found.items()]


def published(scene: str) -> list[list[Cell]]:
    """Published rows for a scene, methods without training first."""
    return [
        [
            row.method
            + (" (trained)" if row.learned else "")
            + (" ^high" * (row.resolution(scene) == "high")),
            *(row.scores.get(key, {}).get(scene) for key in METRICS),
        ]
        for row in sorted(published_rows(), key=lambda row: row.learned)
        if any(scene in row.scores.get(key, {}) for key in METRICS)
    ]


def means(found: Mapping[str, Mapping[str, Scores]], names: Sequence[str]) -> dict[str, Scores]:
    """Mean of every metric over the scenes that have it."""
    out: dict[str, Scores] = {}
    for name in names:
        values = {key: [each[name][key] for each in found.values() if key in each[name]] for key in METRICS}
        out[name] = {key: math.fsum(each) / len(each) for key, each in values.items() if each}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder with scenes of the benchmark")
    parser.add_argument("--scenes", nargs="*", default=list(scenes.NAMES), choices=scenes.NAMES)
    parser.add_argument("--size", type=int, default=320, help="of the procedural scenes")
    parser.add_argument("--methods", nargs="+", default=list(FAMILY))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    if "all" in chosen.methods:
        chosen.methods = list(NAMES)
    header = ["", *METRICS.values()]
    found: dict[str, dict[str, Scores]] = {}
    print(f"BadPix and AUSE in %, Q25 in px/100. {machine_line()}.")
    for lf in light_fields(chosen):
        found[lf.name] = score(lf, chosen.methods)
        print(f"\n### {lf.name}, {lf.width}×{lf.height} px\n")
        print(markdown(header, rows(found[lf.name]) + published(lf.name)), flush=True)
    if len(found) > 1:
        print(f"\n### Means over {len(found)} scenes\n")
        print(markdown(header, rows(means(found, chosen.methods))))
    write_json(chosen.json, {"scenes": found})


if __name__ == "__main__":
    main()
