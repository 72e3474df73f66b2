"""Time per plane of every method, split into its blocks, beside one plane in plain NumPy and one copy.

    python benchmarks/speed.py [--size 512] [--views 9] [--planes 40] [--threads 1 2] [--json speed.json]

Figures are medians over the planes after warm-up, in milliseconds of the clock on the wall; of methods that
do not decide plane by plane, means. `least` is the plane that took least, and `CPU` what all threads together
spent computing: other work on the machine disturbs these less.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import lfdepth
from lfdepth import LightField, scenes
from lfdepth.engines.cpu.workers import default_threads
from lfdepth.methods import FAMILY
from lfdepth.trace import Lap, Trace
from reporting import Cell, machine_line, markdown, write_json

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
import naive

BLOCKS = ("voting", "smoothing", "decoding")
"""Columns of the table; what a method calls otherwise counts as decoding, but for its preparation."""

SKIPPED = 8
"""First planes, which carry the preparation and may have no mask yet."""


@dataclass(frozen=True)
class Timing:
    """Times of a method in ms per plane, and of the whole estimate in s.

    Medians over the planes, but means for a method that does not decide plane by plane; `least` is the plane
    that took least.
    """

    method: str
    threads: int
    planes: int
    plane: float
    least: float
    voting: float
    smoothing: float
    decoding: float
    cpu: float
    total: float


def time_method(lf: LightField, name: str, threads: int, planes: int) -> Timing:
    """Times of one estimate, after an estimate on few planes to warm up."""
    lfdepth.estimate(lf, name, planes=SKIPPED, threads=threads)
    trace = Trace()
    result = lfdepth.estimate(lf, name, planes=planes, threads=threads, trace=trace)
    steady = trace.laps[SKIPPED:planes]
    # A method whose steps are its planes decides plane by plane.
    streaming = len(trace.laps) == planes

    def each(seconds: list[float]) -> float:
        """Milliseconds per plane: the median, or all of it by the number of planes."""
        if streaming:
            return 1e3 * statistics.median(seconds[SKIPPED:planes])
        return 1e3 * sum(seconds) / planes

    return Timing(
        name,
        threads,
        planes,
        plane=each([lap.wall for lap in trace.laps]),
        least=1e3 * min(lap.wall for lap in steady),
        **{block: each([_spent(lap, block) for lap in trace.laps]) for block in BLOCKS},
        cpu=each([lap.cpu for lap in trace.laps]),
        total=result.runtime,
    )


def _spent(lap: Lap, block: str) -> float:
    """Seconds of a step that a column of the table takes."""
    if block != "decoding":
        return lap.blocks.get(block, 0.0)
    return sum(seconds for name, seconds in lap.blocks.items() if name not in (*BLOCKS[:2], "preparation"))


def time_oracle(lf: LightField) -> dict[str, float]:
    """Milliseconds of one plane in plain NumPy (`tests/naive.py`), grey views given."""
    grey = lf.grey()[..., None]
    smooth = naive.GuidedFilter(naive.guide_image(lf.views, "colour"), 4, 1e-4)
    began = time.perf_counter()
    votes, evidence, possible = naive.count(grey, 0.37)
    voted = time.perf_counter()
    naive.normalised(smooth, votes / possible, evidence / possible)
    done = time.perf_counter()
    return {"voting": 1e3 * (voted - began), "smoothing": 1e3 * (done - voted), "plane": 1e3 * (done - began)}


def time_copy(lf: LightField) -> float:
    """Milliseconds for copying the grey light field as float32 once; median of 9."""
    source = lf.grey().astype(np.float32)
    target = np.zeros_like(source)

    def once() -> float:
        began = time.perf_counter()
        np.copyto(target, source)
        return 1e3 * (time.perf_counter() - began)

    return statistics.median(once() for _ in range(9))


def rows(timings: list[Timing], copy: float) -> list[list[Cell]]:
    plane = {(each.method, each.threads): each.plane for each in timings}
    return [
        [
            each.method,
            each.threads,
            each.plane,
            each.least,
            each.voting,
            each.smoothing,
            each.decoding,
            each.cpu,
            each.plane / copy,
            each.plane / plane["fbs-sfa", each.threads],
            each.planes,
            each.total,
        ]
        for each in timings
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="demo", choices=scenes.NAMES)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--views", type=int, default=9)
    parser.add_argument("--planes", type=int, default=40)
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, default_threads()}))
    parser.add_argument("--methods", nargs="+", default=list(FAMILY))
    parser.add_argument("--no-oracle", action="store_true", help="leave the plain-NumPy plane out")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    lf = scenes.render(chosen.scene, size=chosen.size, views=chosen.views, samples=1)
    copy = time_copy(lf)
    wanted = list(dict.fromkeys(["fbs-sfa", *chosen.methods]))
    timings = [time_method(lf, name, n, chosen.planes) for n in chosen.threads for name in wanted]
    oracle = None if chosen.no_oracle else time_oracle(lf)
    v, u, height, width, _ = lf.shape
    print(f"{chosen.scene}, {v}×{u} views of {width}×{height} px, colour. {machine_line()}.\n")
    header = ["method", "threads", "plane (ms)", "least", "voting", "smoothing", "decoding", "CPU (ms)"]
    header += ["× copy", "× fbs-sfa", "planes", "in all (s)"]
    print(markdown(header, rows(timings, copy)))
    print(f"\nCopy of the grey views as float32: {copy:.1f} ms.")
    if oracle is not None:
        best = min(each.plane for each in timings if each.method == "fbs-sfa")
        print(
            f"One plane in plain NumPy: {oracle['plane']:.0f} ms (voting {oracle['voting']:.0f}, smoothing "
            f"{oracle['smoothing']:.0f}), {oracle['plane'] / best:.0f} times fbs-sfa's."
        )
    write_json(
        chosen.json, {"copy_ms": copy, "oracle_ms": oracle, "methods": [asdict(each) for each in timings]}
    )


if __name__ == "__main__":
    main()
