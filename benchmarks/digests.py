"""A digest of every method's map on every scene, to tell whether two versions agree bit for bit.

    python benchmarks/digests.py [--data DIR] [--size 160] [--scenes NAMES] [--methods NAMES] [--json FILE]
    python benchmarks/digests.py --against FILE        # the same, and what differs from an earlier --json

DIR holds folders that `lfdepth.read` reads, such as scenes of the 4D Light Field Benchmark; procedural scenes
are rendered at SIZE px. Digests hold on one machine: elsewhere, sums of floats may round otherwise.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import lfdepth
from lfdepth import LightField, scenes
from lfdepth.methods import FAMILY
from reporting import markdown, write_json


def light_fields(data: Path | None, size: int, wanted: list[str] | None) -> Iterator[LightField]:
    """Every scene, one at a time."""
    for folder in sorted(data.iterdir()) if data else []:
        if folder.is_dir() and (wanted is None or folder.name in wanted):
            yield lfdepth.read(folder)
    for name in scenes.NAMES:
        if wanted is None or name in wanted:
            yield scenes.render(name, size=size, samples=1)


def digest(lf: LightField, method: str) -> str:
    """Twelve hexadecimal digits of disparity and confidence."""
    result = lfdepth.estimate(lf, method)
    maps = (np.ascontiguousarray(each, np.float32) for each in (result.disparity, result.confidence))
    return hashlib.sha256(b"".join(each.tobytes() for each in maps)).hexdigest()[:12]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path)
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--scenes", nargs="+")
    parser.add_argument("--methods", nargs="+", default=list(FAMILY))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--against", type=Path, help="digests of another version; status 1 if one differs")
    chosen = parser.parse_args()
    found = {
        lf.name: {method: digest(lf, method) for method in chosen.methods}
        for lf in light_fields(chosen.data, chosen.size, chosen.scenes)
    }
    print(markdown(["scene", *chosen.methods], [[scene, *row.values()] for scene, row in found.items()]))
    write_json(chosen.json, found)
    if chosen.against is None:
        return 0
    earlier = json.loads(chosen.against.read_text(encoding="utf-8"))
    differing = [
        f"{scene} / {method}"
        for scene, row in found.items()
        for method, value in row.items()
        if earlier.get(scene, {}).get(method, value) != value
    ]
    print("\nDiffering: " + (", ".join(differing) or "none"))
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
