"""What each ingredient of fbs-vis earns: every one switched off or changed alone, on every scene at hand.

    python benchmarks/ablation.py [--data DIR] [--size 320] [--scenes NAMES] [--variants NAMES] \
[--json FILE | --from FILES] [--write]

DIR holds one folder per scene in the layout of the 4D Light Field Benchmark, with gt_disp_lowres.pfm. The
procedural scenes are rendered at SIZE px. `--write` puts the tables into docs/ablation.md, between its marks;
`--from` takes the figures of earlier `--json` files instead of computing them: runs of a few scenes each may
stand side by side on a machine of many processors.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import lfdepth
from lfdepth import LightField, scenes
from lfdepth.io.atomic import atomic
from lfdepth.scenes.masks import textureless
from reporting import Cell, machine_line, markdown, write_json

METHOD = "fbs-vis"
PAGE = Path(__file__).resolve().parents[1] / "docs" / "ablation.md"
MARKS = ("<!-- table: ablation -->", "<!-- end: ablation -->")

FULL = "fbs-vis"
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    FULL: (METHOD, {}),
    "no photo votes": (METHOD, {"photo_weight": 0.0}),
    "no scanline smoothing": (METHOD, {"slope_penalty": 0.0, "jump_penalty": 0.0}),
    "no fitted planes": (METHOD, {"fit_radius": 0}),
    "no edge decision": (METHOD, {"edge_passes": 0}),
    "no edge net": (METHOD, {"edge_net": False}),
    "no gloss": (METHOD, {"gloss": False}),
    "no faint surfaces": (METHOD, {"faint": False}),
    "no refinement": (METHOD, {"effort": "fast"}),
    "refined twice": (METHOD, {"effort": "best"}),
    "no visibility, no edges": (METHOD, {"visibility": False}),
    "not normalised": (METHOD, {"normalise": False}),
    "grey guide": (METHOD, {"guide": "grey"}),
    "step 0.14": (METHOD, {"step": 0.14}),
    "step 0.035": (METHOD, {"step": 0.035}),
    "windows of 9 px": (METHOD, {"radius": 4, "photo_radius": 4}),
    "ε = 1e-4": (METHOD, {"epsilon": 1e-4}),
    "signs alone (fbs-sfa)": ("fbs-sfa", {"step": 0.07, "radius": 3, "epsilon": 2e-6}),
    "fbsocc-sfa": ("fbsocc-sfa", {}),
}
"""Name of the variant: method and changed options."""

COLUMNS: dict[str, str] = {
    "badpix_0.01": "BadPix 0.01",
    "badpix_0.03": "BadPix 0.03",
    "badpix_0.07": "BadPix 0.07",
    "mse_x100": "MSE×100",
    "q25": "Q25",
    "badpix_0.07_boundaries": "near edges",
    "badpix_0.07_textureless": "textureless",
    "ause_badpix_0.07": "AUSE",
    "runtime": "seconds",
    "cpu": "CPU s",
}
"""Metric: heading. `cpu` is the time that all threads together computed; other work disturbs it less."""

REAL = "Benchmark scenes"
GROUPS: dict[str, tuple[str, ...]] = {
    "Depth edges and thin structures": ("demo", "bars", "leaves", "fence", "wedges"),
    "Weak texture and smooth surfaces": ("sphere", "room", "solids", "strips"),
    "Noise": ("noise-1", "noise-2", "noise-3", "specks"),
    "Gloss": ("gloss",),
    "Ranges 1, 4 and 8 px wide": ("range-1", "range-4", "range-8"),
}
"""The procedural suite by difficulty; scenes that are in none come last."""

FEWEST_PIXELS = 300
"""Textureless areas smaller than this are not scored."""


@dataclass(frozen=True)
class Row:
    """Scores of one variant on one scene, by the keys of `COLUMNS`; those that a scene lacks are absent."""

    scene: str
    group: str
    variant: str
    scores: dict[str, float]


def with_textureless(lf: LightField) -> LightField:
    """The light field with a mask of its textureless areas, from the reference view where it brings none."""
    masks = dict(lf.masks)
    masks.setdefault("textureless", textureless(lf.reference.astype(np.float32) * (255 / lf.full_scale)))
    if np.count_nonzero(masks["textureless"]) < FEWEST_PIXELS:
        del masks["textureless"]
    return replace(lf, masks=masks)


def light_fields(
    data: Path | None, size: int, wanted: Sequence[str] | None
) -> Iterator[tuple[str, LightField]]:
    """Group and light field of every scene, one at a time."""
    folders = sorted(file.parent for file in data.glob("*/gt_disp_lowres.pfm")) if data else []
    for folder in folders:
        if wanted is None or folder.name in wanted:
            yield REAL, lfdepth.read(folder)
    group_of = {name: group for group, names in GROUPS.items() for name in names}
    for name in scenes.NAMES:
        if wanted is None or name in wanted:
            yield group_of.get(name, "Others"), scenes.render(name, size=size)


def measure(lf: LightField, variant: str) -> dict[str, float]:
    """Scores of one variant on one scene."""
    name, options = VARIANTS[variant]
    began = time.process_time()
    result = lfdepth.estimate(lf, name, **options)
    scores = {"cpu": time.process_time() - began, **lfdepth.evaluate(result, lf)}
    return {key: scores[key] for key in COLUMNS if key in scores}


def warm_up(variants: Iterable[str]) -> None:
    """Compile all kernels, so that no time measured holds a compiler's."""
    lf = scenes.render("demo", size=48, samples=1)
    for variant in variants:
        name, options = VARIANTS[variant]
        lfdepth.estimate(lf, name, **options)


def run(data: Path | None, size: int, wanted: Sequence[str] | None, variants: Sequence[str]) -> Iterator[Row]:
    """Every variant on every scene."""
    warm_up(variants)
    for group, found in light_fields(data, size, wanted):
        lf = with_textureless(found)
        for variant in variants:
            row = Row(lf.name, group, variant, measure(lf, variant))
            print(
                f"{row.scene:12} {variant:24} BadPix 0.07 {row.scores['badpix_0.07']:6.2f}  "
                f"MSE×100 {row.scores['mse_x100']:6.2f}  {row.scores['runtime']:5.1f} s",
                file=sys.stderr,
                flush=True,
            )
            yield row


def _in_order(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def _means(rows: Sequence[Row]) -> dict[str, float]:
    """Mean over scenes of every metric that at least one of them has."""
    found = {key: [row.scores[key] for row in rows if key in row.scores] for key in COLUMNS}
    return {key: float(np.mean(values)) for key, values in found.items() if values}


def _ratio(rows: Mapping[tuple[str, str], Row], variant: str, key: str) -> float | None:
    """Geometric mean over scenes of the ratio to the full method, where that is not zero."""
    logarithms = []
    for (scene, name), row in rows.items():
        if name != variant or (scene, FULL) not in rows:
            continue
        mine, full = row.scores.get(key), rows[scene, FULL].scores.get(key)
        if mine and full:
            logarithms.append(np.log(mine / full))
    return float(np.exp(np.mean(logarithms))) if logarithms else None


def summary(rows: Sequence[Row]) -> str:
    """Table of the ratios to the full method."""
    by_name = {(row.scene, row.variant): row for row in rows}
    variants = _in_order(row.variant for row in rows)
    body = [[name, *(_ratio(by_name, name, key) for key in COLUMNS)] for name in variants]
    return markdown(["variant", *COLUMNS.values()], body)


def group_table(rows: Sequence[Row]) -> str:
    """Table of one group: means over its scenes, then BadPix 0.07 of each scene."""
    variants, names = _in_order(row.variant for row in rows), _in_order(row.scene for row in rows)
    by_name = {(row.scene, row.variant): row.scores["badpix_0.07"] for row in rows}
    body: list[list[Cell]] = []
    for variant in variants:
        means = _means([row for row in rows if row.variant == variant])
        each = [by_name.get((name, variant)) for name in names] if len(names) > 1 else []
        body.append([variant, *(means.get(key) for key in COLUMNS), *each])
    return markdown(["variant", *COLUMNS.values(), *(names if len(names) > 1 else [])], body)


def whole_table(rows: Sequence[Row]) -> str:
    """Every figure."""
    body = [[row.scene, row.variant, *(row.scores.get(key) for key in COLUMNS)] for row in rows]
    return markdown(["scene", "variant", *COLUMNS.values()], body)


def tables(rows: Sequence[Row], origin: str) -> str:
    """All tables, as Markdown."""
    parts = [origin, "## Summary: ratio to fbs-vis, geometric mean over scenes", summary(rows)]
    for group in _in_order(row.group for row in rows):
        mine = [row for row in rows if row.group == group]
        names = _in_order(row.scene for row in mine)
        parts += [f"## {group}", "Means over " + ", ".join(names) + "; last, BadPix 0.07 of each scene."]
        if len(names) == 1:
            parts[-1] = f"{names[0].capitalize()}."
        parts.append(group_table(mine))
    parts += ["<details><summary>Every scene, every figure</summary>", whole_table(rows), "</details>"]
    return "\n\n".join(parts)


def _commit() -> str:
    """Short name of the commit that is checked out, marked where the package differs from it."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], capture_output=True, text=True, check=False, cwd=PAGE.parent.parent
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "src")
    return (git("rev-parse", "--short", "HEAD") or "unknown") + (" with changes" if changed else "")


def _origin(data: Path | None, size: int) -> str:
    option = " --data DIR" if data else ""
    return (
        f"Made by `python benchmarks/ablation.py{option} --size {size} --write` from commit {_commit()}. "
        f"{machine_line()}."
    )


def write_page(text: str) -> None:
    """Put the tables into the page, between its marks."""
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    with atomic(PAGE) as temporary:
        Path(temporary).write_text(
            f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{after}", encoding="utf-8", newline="\n"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder of benchmark scenes")
    parser.add_argument("--size", type=int, default=320, help="of the procedural scenes, px")
    parser.add_argument("--scenes", nargs="+", help="only these")
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--json", type=Path, help="write all figures here")
    parser.add_argument("--from", dest="earlier", nargs="+", type=Path, help="read all figures from these")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/ablation.md")
    chosen = parser.parse_args()
    if chosen.earlier:
        found = [json.loads(path.read_text(encoding="utf-8")) for path in chosen.earlier]
        rows = [Row(**each) for part in found for each in part["rows"]]
        origin = found[0]["origin"]
    else:
        origin = _origin(chosen.data, chosen.size)
        rows = list(run(chosen.data, chosen.size, chosen.scenes, chosen.variants))
        write_json(chosen.json, {"origin": origin, "rows": [asdict(row) for row in rows]})
    text = tables(rows, origin)
    if chosen.write:
        write_page(text)
    else:
        print(text)


if __name__ == "__main__":
    main()
