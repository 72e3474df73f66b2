"""Figures of docs/scale.md: every view, videos, many scenes, fields larger than memory.

    python benchmarks/scale.py views [SCENES...] [--size 192] [--apart]
    python benchmarks/scale.py cost FOLDER
    python benchmarks/scale.py video [--frames 8] [--size 96] [--views 5] [--seeds 3] [--effort fast]
    python benchmarks/scale.py batch [--scenes 40] [--size 256]
    python benchmarks/scale.py tiles SCENES... [--size 256] [--tile 128] [--halos 16 32 48 64]
    python benchmarks/scale.py size [--sides 1024 2048 4096] [--views 9] [--memory 2e9] [--folder scale-size]

`views`: bad pixels of all views of procedural scenes against the truth of each, and whether maps agree.
`cost`: time and memory of the maps of all views of a light field, such as the benchmark's cotton, beside
those of one map. `video`: flicker and errors of maps frame by frame and stabilised, means over scenes.
`batch`: scenes in an hour by one process and by two. `tiles`: how far maps by tiles are
from whole ones, by the halo. `size`: time and memory of maps by tiles as fields grow.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import islice, permutations, product
from pathlib import Path
from typing import Any

import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.scale.tiles import estimate_tiled
from lfdepth.scale.views import consistency
from lfdepth.table import Column, Table

SCENES = ("demo", "bars", "leaves", "sphere", "room", "gloss", "fence", "solids")
BAD = 0.07


def bad(disparity: Any, truth: Any) -> Any:
    """Share of bad pixels in percent, of each map."""
    return 100 * np.mean(np.abs(disparity - truth) > BAD, axis=(-2, -1))


def views(names: list[str], size: int, apart: bool) -> None:
    rows: list[list[Any]] = []
    for name in names:
        lf = scenes.render(name, size=size, views=9)
        truth = scenes.truth_of_views(name, size=size, views=9)
        maps = lfdepth.estimate_views(lf, check=False)
        errors, reference = bad(maps.disparity, truth), float(bad(maps.reference.disparity, lf.truth))
        row: list[Any] = [
            name,
            reference,
            float(errors.mean()),
            float(errors.mean()) / reference,
            float(errors.max()),
        ]
        row += [100 * maps.consistency, 100 * consistency(truth, lf)]
        if apart:
            own = np.empty_like(truth)
            for at in np.ndindex(9, 9):
                own[at] = lfdepth.estimate(lfdepth.from_view(lf, at), check=False, equalise=False).disparity
            row += [float(bad(own, truth).mean()), 100 * consistency(own, lf)]
        rows.append(row)
        print(*row, flush=True)
    values = np.array([row[1:] for row in rows])
    mean = values.mean(axis=0)
    mean[2] = mean[1] / mean[0]
    heads = ["scene", "reference view", "all views", "ratio", "worst view", "hold", "truth holds"]
    heads += ["views apart", "apart hold"] if apart else []
    print(Table.of(heads, [*rows, ["mean", *mean.tolist()]]).to_markdown())


def peak() -> float:
    """Largest memory of this process so far, GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9  # Linux counts in KiB


def in_process(task: Callable[..., Any], *words: Any) -> Any:
    """What a function gives in a process of its own, whose memory is its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(task, *words).result()


def _timed(task: Callable[[], Any]) -> tuple[float, float, Any]:
    """Seconds on the clock, seconds that all threads computed, and what a function gives."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = task()
    return time.perf_counter() - wall, time.process_time() - cpu, found


def _one(folder: Path) -> float:
    lfdepth.estimate(lfdepth.read(folder), check=False)
    return peak()


def _all(folder: Path) -> tuple[Any, Any, Any, float, float, float]:
    lf = lfdepth.read(folder)
    lfdepth.estimate(lf, check=False)  # kernels are loaded here
    before = _timed(lambda: lfdepth.estimate(lf, check=False))
    with tempfile.TemporaryDirectory() as out:
        to = Path(out) / "maps.zarr"
        wall, cpu, maps = _timed(lambda: lfdepth.estimate_views_to(lf, to, check=False))
    after = _timed(lambda: lfdepth.estimate(lf, check=False))
    output = 9 * int(np.prod(lf.shape[:4])) / 1e9
    return before[:2], (wall, cpu), after[:2], peak(), output, maps.consistency


def cost(folder: Path) -> None:
    one_peak = in_process(_one, folder)
    before, every, after, all_peak, output, share = in_process(_all, folder)
    wall, cpu = ((before[i] + after[i]) / 2 for i in (0, 1))
    print(f"one map {wall:.2f} s ({before[0]:.2f} before, {after[0]:.2f} after), of all threads {cpu:.2f} s;")
    print(f"{one_peak:.2f} GB in all")
    print(
        f"all views {every[0]:.1f} s, {every[0] / wall:.2f} times one map; of all threads {every[1]:.1f} s,"
    )
    print(
        f"{every[1] / cpu:.2f} times; {all_peak:.2f} GB in all, without the maps, which are {output:.2f} GB;"
    )
    print(f"{100 * share:.2f} % of the pixels hold")


def tiles(names: list[str], size: int, tile: int, halos: list[int]) -> None:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            path = Path(name)
            if not path.exists():
                path = Path(folder) / f"{name}.npy"
                lfdepth.write(path, scenes.render(name, size=size, views=9))
            lf = lfdepth.read(path)
            lfdepth.estimate(lf.crop(0, 0, 64, 64), check=False)  # kernels are loaded here
            _, once, result = _timed(partial(lfdepth.estimate, lf, check=False))
            for halo in halos:
                out = Path(folder) / "map.npy"
                by_tiles = partial(estimate_tiled, path, out, tile=tile, halo=halo)
                _, spent, done = _timed(by_tiles)
                apart = np.abs(lfdepth.io.read_disparity(out) - result.disparity)
                row = [path.stem, f"{lf.width}x{lf.height}", done.tiles, halo, done.again, 100 * done.apart]
                rows.append([*row, 100 * float(np.mean(apart > 0.02)), float(apart.max()), spent / once])
                print(*rows[-1], flush=True)
    heads: list[str | Column] = [
        "scene",
        Column("size", unit="px"),
        "tiles",
        Column("halo", unit="px"),
        "done again",
        Column("apart at borders", unit="%"),
        Column("further than 0.02 px off", unit="%"),
    ]
    heads += [Column("furthest", unit="px"), "time of the whole map"]
    print(Table.of(heads, rows).to_markdown())


PIECE = 512


def _made(path: Path, side: int, count: int) -> None:
    """A field of any size, written as Zarr without compression: a scene beside itself, piece by piece."""
    import zarr

    piece = scenes.render("demo", size=PIECE, views=count).views
    making = path.with_suffix(".making")
    shutil.rmtree(making, ignore_errors=True)
    array = zarr.create_array(
        str(making),
        shape=(count, count, side, side, 3),
        chunks=(1, 1, PIECE, PIECE, 3),
        dtype="uint8",
        compressors=None,
        zarr_format=2,
    )
    corners = range(0, side, PIECE)
    for v, u, y, x in product(range(count), range(count), corners, corners):
        array[v, u, y : y + PIECE, x : x + PIECE] = piece[v, u, : side - y, : side - x]
    making.rename(path)


def _tiled(path: Path, out: Path, memory: float, diary: Path) -> dict[str, Any]:
    """What a map by tiles takes; if it was interrupted before, with what it had taken by its last tile."""
    settings: dict[str, Any] = {"range": (-1.4, 1.9), "effort": "fast"}
    lfdepth.estimate(lfdepth.read(path, crop=(0, 0, 64, 64)), **settings)  # loads kernels
    spent = json.loads(diary.read_text()) if diary.exists() else {"wall": 0.0, "cpu": 0.0, "peak": 0.0}
    since = time.perf_counter(), time.process_time()

    def taken() -> dict[str, float]:
        return {
            "wall": spent["wall"] + time.perf_counter() - since[0],
            "cpu": spent["cpu"] + time.process_time() - since[1],
            "peak": max(spent["peak"], peak()),
        }

    def note(done: int, total: int, what: str) -> None:
        now = taken()
        diary.write_text(json.dumps(now))
        print(f"{what} {done} of {total}: {now}", flush=True)

    done = estimate_tiled(path, out, memory=memory, progress=note, **settings)
    facts = {"tile": done.tile, "tiles": done.tiles, "again": done.again, "off": done.off}
    return {**taken(), **facts}


def size(sides: list[int], count: int, memory: float, folder: Path) -> None:
    """Rows that are in the folder are not measured again, and what was interrupted goes on."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for side in sides:
        name = f"{side}-{count}-{memory:g}"
        row = folder / f"{name}.json"
        if not row.exists():
            path, out, diary = (folder / f"{name}{ending}" for ending in (".zarr", "-map.zarr", ".diary"))
            if not path.exists():
                in_process(_made, path, side, count)
            print(f"{side} px: written", flush=True)
            row.write_text(json.dumps(in_process(_tiled, path, out, memory, diary)))
            shutil.rmtree(path)
            shutil.rmtree(out)
            diary.unlink()
        found, area = json.loads(row.read_text()), side**2 / 1e6
        stored = count * count * side * side * 3 / 1e9
        several = [found["wall"], found["wall"] / area, found["cpu"] / area, found["peak"]]
        rows.append((side, stored, found["tile"], found["tiles"], found["again"], *several))
        print(*rows[-1], flush=True)
    heads: list[str | Column] = [
        Column("side", unit="px"),
        Column("views", unit="GB"),
        Column("tile", unit="px"),
    ]
    heads += ["tiles", "done again", Column("time", unit="s"), Column("a megapixel", unit="s")]
    heads += [Column("processor time of one", unit="s"), Column("peak memory", unit="GB")]
    print(f"{count}x{count} views, at most {memory / 1e9:g} GB")
    print(Table.of(heads, rows).to_markdown())


def _batch(paths: list[str], out: Path, workers: int) -> tuple[float, float]:
    """Seconds on the clock, and seconds that this process and its children computed."""
    started, kinds = time.perf_counter(), (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    done = lfdepth.estimate_many(paths, "fbs-vis", out, workers=workers, threads=1, effort="fast")
    assert not done.failures
    used = [resource.getrusage(kind) for kind in kinds]
    return time.perf_counter() - started, sum(each.ru_utime + each.ru_stime for each in used)


def _scenes(folder: Path, count: int, size: int) -> list[str]:
    """Light fields, all different: few are rendered, and their channels exchanged, as that is faster."""
    paths = []
    colours = list(permutations(range(3)))
    rendered: dict[int, Any] = {}
    for number, (seed, order) in enumerate(islice(product(range(count), colours), count)):
        if seed not in rendered:
            rendered = {seed: scenes.render("bars", size=size, views=9, seed=seed)}
        lf = rendered[seed]
        paths.append(str(folder / f"s{number:03d}.npz"))
        lfdepth.write(paths[-1], replace(lf, views=np.ascontiguousarray(lf.views[..., order])))
    return paths


def batch(count: int, size: int) -> None:
    """One process and two, in turn with half of the scenes: one, two, two, one.

    So both meet what changes in the machine's load. Each turn starts its processes, which load kernels.
    """
    with tempfile.TemporaryDirectory() as folder:
        paths = _scenes(Path(folder), count, size)
        halves = [paths[: count // 2], paths[count // 2 :]]
        totals = {1: np.zeros(2), 2: np.zeros(2)}
        for turn, (workers, half) in enumerate(((1, 0), (2, 0), (2, 1), (1, 1))):
            totals[workers] += in_process(_batch, halves[half], Path(folder) / f"out{turn}", workers)
            print(f"{workers} at work on {len(halves[half])} scenes: {totals[workers]}", flush=True)
    rows = [(f"{n}", wall, 3600 * count / wall, cpu / count) for n, (wall, cpu) in totals.items()]
    heads: list[str | Column] = ["processes", Column("time", unit="s"), "scenes in an hour"]
    print(Table.of([*heads, Column("processor time of a scene", unit="s")], rows).to_markdown())
    print(f"{totals[1][0] / totals[2][0]:.2f} times as many by two", end=", ")
    print(f"{2 * totals[1][1] / totals[2][1]:.2f} by processor time, with two that nobody else uses")


def _video(kind: dict[str, Any], effort: str) -> list[float]:
    """Flicker, bad pixels, error, that where the truth changed, and flicker over cuts, too.

    Each apart and stabilised. Flicker counts where the truth stays, from a frame to the next of its scene.
    """
    frames = list(scenes.video(**kind))
    low = min(lf.disparity_range[0] for lf in frames if lf.disparity_range)
    high = max(lf.disparity_range[1] for lf in frames if lf.disparity_range)
    truth = np.stack([lf.truth for lf in frames if lf.truth is not None])
    rests = np.diff(truth, axis=0) == 0
    same = np.arange(1, len(truth)) != kind.get("cut")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.npy"
        np.save(path, np.stack([lf.views for lf in frames]))
        for stabilise in (False, True):
            out = Path(folder) / f"maps-{stabilise}"
            lfdepth.estimate_video(path, out, stabilise=stabilise, range=(low, high), effort=effort)
            maps = np.stack([lfdepth.io.read_disparity(each) for each in sorted(out.glob("*.npz"))])
            error = np.abs(maps - truth)
            moved, change = error[1:][~rests], np.abs(np.diff(maps, axis=0))
            found.append(
                [
                    float(change[same][rests[same]].mean()),
                    float(bad(maps, truth).mean()),
                    float(error.mean()),
                    float(moved.mean()) if moved.size else float("nan"),
                    float(change[rests].mean()),
                ]
            )
    return [value for pair in zip(*found, strict=True) for value in pair]


def video(count: int, size: int, grid: int, seeds: int, effort: str) -> None:
    kinds: dict[str, dict[str, Any]] = {
        "nothing moves": {"motion": 0},
        "the board moves": {"motion": 3},
        "and a cut": {"motion": 3, "cut": count // 2},
    }
    heads: list[str | Column] = [Column("scene", words=True), "flicker", "stabilised", "ratio"]
    heads += ["BadPix 0.07", "stabilised", "error", "stabilised", "error where it moved", "stabilised"]
    rows = []
    for name, kind in kinds.items():
        common = {"frames": count, "size": size, "views": grid, "noise": 4.0, **kind}
        every = np.mean([_video({**common, "seed": 10 * seed}, effort) for seed in range(seeds)], axis=0)
        rows.append((name, *every[:2], every[1] / every[0], *every[2:8]))
        print(*rows[-1], flush=True)
    print(Table.of(heads, rows).to_markdown())
    print(f"with the change over the cut: {every[8]:.4f} and {every[9]:.4f}, {every[9] / every[8]:.3f} times")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    each = commands.add_parser("views")
    each.add_argument("scenes", nargs="*", default=list(SCENES))
    each.add_argument("--size", type=int, default=192)
    each.add_argument("--apart", action="store_true")
    each = commands.add_parser("cost")
    each.add_argument("folder", type=Path)
    each = commands.add_parser("batch")
    each.add_argument("--scenes", type=int, default=40)
    each.add_argument("--size", type=int, default=256)
    each = commands.add_parser("tiles")
    each.add_argument("scenes", nargs="+")
    each.add_argument("--size", type=int, default=256)
    each.add_argument("--tile", type=int, default=128)
    each.add_argument("--halos", type=int, nargs="+", default=[16, 32, 48, 64])
    each = commands.add_parser("video")
    each.add_argument("--frames", type=int, default=8)
    each.add_argument("--size", type=int, default=96)
    each.add_argument("--views", type=int, default=5)
    each.add_argument("--seeds", type=int, default=3)
    each.add_argument("--effort", default="fast")
    each = commands.add_parser("size")
    each.add_argument("--sides", type=int, nargs="+", default=[1024, 2048, 4096])
    each.add_argument("--views", type=int, default=9)
    each.add_argument("--memory", type=float, default=2e9)
    each.add_argument("--folder", type=Path, default=Path("scale-size"), help="for what is resumed")
    chosen = parser.parse_args()
    if chosen.command == "views":
        views(chosen.scenes, chosen.size, chosen.apart)
    elif chosen.command == "cost":
        cost(chosen.folder)
    elif chosen.command == "tiles":
        tiles(chosen.scenes, chosen.size, chosen.tile, chosen.halos)
    elif chosen.command == "video":
        video(chosen.frames, chosen.size, chosen.views, chosen.seeds, chosen.effort)
    elif chosen.command == "size":
        size(chosen.sides, chosen.views, chosen.memory, chosen.folder)
    else:
        batch(chosen.scenes, chosen.size)
