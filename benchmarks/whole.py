"""How long a whole estimate takes, with or without brightness and checks, or by another version.

    python benchmarks/whole.py --scene FOLDER [--rounds 2] [--repeats 3]
    python benchmarks/whole.py --scene FOLDER --against OTHER/src       # the package of another commit

Medians, in the process, after a warm-up; versions run in turn, so that a busy machine slows all of them.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import processes
from reporting import Cell, machine_line, markdown, write_json

VARIANTS = {
    "without brightness and checks": {"equalise": False, "check": False},
    "with brightness": {"check": False},
    "with both, as is the default": {},
}
"""Options of `estimate`, by name."""

_HERE = Path(__file__).resolve().parents[1] / "src"
_PROGRAM = """
import json, sys, time
import lfdepth
scene, method, repeats, variants = sys.argv[1], sys.argv[2], int(sys.argv[3]), json.loads(sys.argv[4])
lf, found = lfdepth.read(scene), {}
for name, options in variants.items():
    times = []
    for _ in range(1 + repeats):
        began = time.perf_counter()
        lfdepth.estimate(lf, method, threads=2, **options)
        times.append(time.perf_counter() - began)
    found[name] = times[1:]
print(json.dumps(found))
"""


def measure(source: Path, scene: Path, method: str, repeats: int, variants: object) -> dict[str, list[float]]:
    """Seconds of each variant with the package in a folder."""
    command = [sys.executable, "-c", _PROGRAM, str(scene), method, str(repeats), json.dumps(variants)]
    path = os.pathsep.join(filter(None, [str(source), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE, check=True)
    found: dict[str, list[float]] = json.loads(done.stdout)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", type=Path, help="the procedural scene demo by default")
    parser.add_argument("--size", type=int, default=512, help="of the procedural scene")
    parser.add_argument("--method", default="fbs-vis")
    parser.add_argument("--against", type=Path, help="folder src of another commit; the default alone is run")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        scene = chosen.scene or processes.render("demo", chosen.size, Path(folder))
        for _ in range(chosen.rounds):
            if chosen.against:
                other = measure(
                    chosen.against, scene, chosen.method, chosen.repeats, {"the other version": {}}
                )
                times.setdefault("the other version", []).extend(other["the other version"])
            for name, each in measure(_HERE, scene, chosen.method, chosen.repeats, VARIANTS).items():
                times.setdefault(name, []).extend(each)
    medians = {name: statistics.median(each) for name, each in times.items()}
    first = next(iter(medians.values()))
    rows: list[list[Cell]] = [[name, median, median / first] for name, median in medians.items()]
    print(f"{machine_line()}.\n")
    print(markdown([f"{chosen.method}, two threads", "seconds", "× the first"], rows))
    write_json(chosen.json, {"seconds": medians})


if __name__ == "__main__":
    main()
