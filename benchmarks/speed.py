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
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import lfdepth.blocks.energy as joint
import lfdepth.estimation as sweep
from lfdepth import LightField, scenes
from lfdepth.blocks.decode import Accumulate, SignStep
from lfdepth.blocks.edges import DepthEdges
from lfdepth.blocks.energy import JointEnergy
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines.cpu.workers import default_threads
from lfdepth.methods import NAMES, method
from reporting import Cell, machine_line, markdown, write_json

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
import naive

BLOCKS: dict[str, list[tuple[Any, str]]] = {
    "voting": [(sweep, "vote_plane"), (joint, "photo_plane")],
    "smoothing": [(GuidedFilter, "smooth_quotient"), (GuidedFilter, "smooth_plane")],
    "decoding": [
        (SignStep, "update"),
        (Accumulate, "update"),
        (JointEnergy, "update"),
        (JointEnergy, "decide"),
        (DepthEdges, "settle"),
    ],
}
"""Functions by block, where the sweep looks them up."""


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


class Stopwatch:
    """Time of each block on each plane; of blocks inside one another the inner one's time is its own."""

    def __init__(self) -> None:
        self.planes: list[dict[str, float]] = []
        self._spent = dict.fromkeys(("wall", "cpu", *BLOCKS), 0.0)
        self._running: list[str] = []
        self._since = time.perf_counter()
        self._began = (time.perf_counter(), time.process_time())

    def plane_done(self, _done: int = 0, _total: int = 0) -> None:
        """Close the account of a plane; a progress callback."""
        now = (time.perf_counter(), time.process_time())
        self._spent["wall"], self._spent["cpu"] = now[0] - self._began[0], now[1] - self._began[1]
        self.planes.append(self._spent)
        self._spent, self._began = dict.fromkeys(self._spent, 0.0), now

    @contextmanager
    def attached(self) -> Iterator[None]:
        """Wrap the blocks' functions for the time being."""
        with ExitStack() as stack:
            for block, places in BLOCKS.items():
                for owner, name in places:
                    stack.enter_context(patch.object(owner, name, self._timed(block, getattr(owner, name))))
            yield

    def _timed(self, block: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **options: Any) -> Any:
            self._charge()
            self._running.append(block)
            try:
                return function(*args, **options)
            finally:
                self._charge()
                self._running.pop()

        return timed

    def _charge(self) -> None:
        """Put the time since the last change to the account of the block that was running."""
        now = time.perf_counter()
        if self._running:
            self._spent[self._running[-1]] += now - self._since
        self._since = now


def time_method(lf: LightField, name: str, threads: int, planes: int) -> Timing:
    """Times of one estimate, after an estimate on few planes to warm up."""
    skip = method(name).skip
    sweep.estimate(lf, name, planes=skip + 2, threads=threads)
    watch = Stopwatch()
    with watch.attached():
        result = sweep.estimate(lf, name, planes=planes, threads=threads, progress=watch.plane_done)
    watch.plane_done()
    # The first planes carry the preparation and have no mask yet; the last account is what follows them all.
    steady = watch.planes[skip + 1 : -1]

    def each(key: str) -> float:
        if len(watch.planes) == planes + 1 and method(name).decoder != "joint":
            return 1e3 * statistics.median(plane[key] for plane in steady)
        return 1e3 * sum(plane[key] for plane in watch.planes) / planes

    blocks = {block: each(block) for block in BLOCKS}
    least = 1e3 * min(plane["wall"] for plane in steady)
    return Timing(name, threads, planes, each("wall"), least, **blocks, cpu=each("cpu"), total=result.runtime)


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
    parser.add_argument("--methods", nargs="+", default=list(NAMES))
    parser.add_argument("--no-oracle", action="store_true", help="leave the plain-NumPy plane out")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    lf = scenes.render(chosen.scene, size=chosen.size, views=chosen.views, samples=1)
    copy = time_copy(lf)
    names = list(dict.fromkeys(["fbs-sfa", *chosen.methods]))
    timings = [time_method(lf, name, n, chosen.planes) for n in chosen.threads for name in names]
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
