"""What differences of brightness between the views cost, and what making them equal gives back.

    python benchmarks/cameras.py --scenes cotton leaves --methods fbs-vis

Every scene is spoiled as real cameras would, with half a grey level of noise, and estimated with and without
equalising. "ratio" is BadPix 0.07 beside that of the unspoiled scene with the same noise; "exact" the same
with what was done undone exactly, which leaves the noise that dividing by dark factors raises; "range" is the
larger error of the ends of the range that is found, px per view step.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.lightfield import LightField
from lfdepth.scenes.cameras import Imperfections, spoil, unspoil

DATA = Path(__file__).parents[2] / "shared/data/hci4d"
NOISE = 0.002
CASES = {
    "gain 5 %": Imperfections(gain=0.05),
    "gain 10 %": Imperfections(gain=0.1),
    "offset 2 %": Imperfections(offset=0.02),
    "white balance 5 %": Imperfections(white_balance=0.05),
    "corner views 95 %": Imperfections(falloff=0.95),
    "corner views 80 %": Imperfections(falloff=0.8),
    "corner views 60 %": Imperfections(falloff=0.6),
    "vignetting 70 %": Imperfections(vignetting=0.7),
    "vignetting and gains": Imperfections(gain=0.05, vignetting=0.7),
    "wandering vignetting": Imperfections(vignetting=0.7, wandering=0.5),
    "all together": Imperfections(
        gain=0.1, offset=0.02, white_balance=0.05, falloff=0.6, vignetting=0.7, wandering=0.3
    ),
}


def scene(name: str, size: int, seed: int) -> LightField:
    """A benchmark scene if it is one, else a procedural one."""
    if (DATA / name).is_dir():
        return lfdepth.read(DATA / name)
    return scenes.render(name, size=size, seed=seed, samples=2)


def bad_pixels(lf: LightField, method: str, *, equalise: bool = True) -> float:
    """BadPix 0.07, %, without a border of 15 px."""
    assert lf.truth is not None
    found = lfdepth.estimate(lf, method, equalise=equalise).disparity
    return 100 * float((np.abs(found - lf.truth)[15:-15, 15:-15] > 0.07).mean())


def range_error(lf: LightField) -> float:
    """Larger error of the ends of the range that is found in equalised views."""
    assert lf.truth is not None
    views = lfdepth.equalise(lf, lfdepth.measure_brightness(replace(lf, disparity_range=None)))
    low, high = lfdepth.find_range(views)
    return max(abs(low - float(lf.truth.min())), abs(high - float(lf.truth.max())))


def main() -> None:
    """Print a line per scene, case and method."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=["cotton", "backgammon", "leaves", "demo"])
    parser.add_argument("--methods", nargs="+", default=["fbs-vis"])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--size", type=int, default=192)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--without", action="store_true", help="also estimate without equalising")
    given = parser.parse_args()
    print(
        f"{'scene':12}{'case':22}{'method':12}"
        f"{'clean':>7}{'BadPix':>8}{'ratio':>7}{'exact':>7}{'range':>7}  as it is"
    )
    for name in given.scenes:
        lf = scene(name, given.size, given.seed)
        clean = {
            m: bad_pixels(spoil(lf, Imperfections(noise=NOISE)), m, equalise=False) for m in given.methods
        }
        for case in given.cases:
            spoiled = spoil(lf, replace(CASES[case], noise=NOISE))
            off = range_error(spoiled)
            for method in given.methods:
                bad = bad_pixels(spoiled, method)
                exact = bad_pixels(unspoil(spoiled, CASES[case]), method, equalise=False)
                as_it_is = f"{bad_pixels(spoiled, method, equalise=False):.2f}" if given.without else ""
                print(
                    f"{name:12}{case:22}{method:12}{clean[method]:7.2f}{bad:8.2f}"
                    f"{bad / clean[method]:7.2f}{exact / clean[method]:7.2f}{off:7.2f}  {as_it_is}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
