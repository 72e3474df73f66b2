"""Fields whose views do not fit in memory: a map tile by tile.

What a whole field decides (range, brightness, noise, and what the method measures) is found once, on a
shrunken copy and on windows, and handed to all tiles. A tile is estimated from the window of all views that
has a say in it: its own pixels, as far around them as views shift and as the method's windows reach (`halo`).
Every tile is a file of its own until all are there, so that the work goes on where it stopped, and any number
of workers can share it.

Paths that make disparities smooth reach farther than any halo where there is no texture. So neighbouring
tiles are compared along their border, of which both have a map. Where they differ, they are done again, and
paths enter them as they left their neighbours (`blocks.borders`), until they agree or that no longer helps.
Then the tiles are put together, one by one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.borders import PathBorders, Side
from lfdepth.engines import engine as start_engine
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import MANIFEST, atomic, atomic_folder, check_target
from lfdepth.io.extras import need, need_tifffile
from lfdepth.io.zarr_store import writing
from lfdepth.lightfield import check_range, grid_offsets
from lfdepth.memory import size_text
from lfdepth.methods import DEFAULT, Method, Problem, Work
from lfdepth.methods import method as named_method
from lfdepth.scale import pools
from lfdepth.scale.jobs import PROVENANCE, Job, at_hand, jobs_for
from lfdepth.scale.locks import Shared, alone
from lfdepth.scale.look import Look
from lfdepth.scale.survey import (
    MEASURED,
    PROBE,
    Probe,
    look_at_field,
    measure_field,
    measured_field,
    origin,
    probe_field,
    process_bytes,
    read_even,
    recall,
)
from lfdepth.scale.windows import (
    LATTICE,
    NEIGHBOURS,
    OPPOSITE,
    Window,
    entry_lines,
    exit_lines,
    seam_between,
    slices,
    widened,
    within,
)
from lfdepth.scale.work import Outcome, check_room, finished, run_alone
from lfdepth.trace import Progress, Trace

HALO = 48
"""Px around a tile, beside the shifts of the views: as far as windows and fits reach (docs/scale.md)."""
SEAM_APART = 0.02
"""Px per view step from which on two tiles say something different."""
MOST_OFF = 0.001
"""Share of a tile's pixels that may be wrong by as much, by what its borders tell, before it is done again;
and of all in the end, before there is a warning."""
ENDINGS = (".zarr", ".tif", ".tiff", ".npy")
"""Formats that are written tile by tile."""
_SMALLEST, _LARGEST, _MULTIPLE = 32, 4096, 32  # px, sides of tiles
_BORDER, _PATHS = "border_", "paths_"
"""What the names of arrays in a tile's file begin with: its map at its borders, and paths that leave it."""
_ROUNDS = 3
"""How often tiles that differ from their neighbours are done again at most."""
_SEAM = 4
"""Px on either side of a border that are told of as apart."""
_BAND = 8
"""Px, width of the bands along a border in which differences are counted."""
_DOUBTFUL = SEAM_APART / 2
"""Px per view step from which on a difference counts for how far it reaches: both tiles may lack the same."""
_ACROSS: tuple[Side, Side] = "right", "bottom"
"""Sides on which every border is met once."""


@dataclass(frozen=True)
class TileJob(Job):
    """One tile of a map.

    Attributes
    ----------
    core
        Its pixels, in the map.
    window
        The pixels of the views that it is estimated from, in the map.
    origin
        (x, y) of the map in the views as they are stored.
    whole
        (H, W) of the map.
    seams
        For each side with a neighbour: the pixels, in the map, by which the two are compared.
    entries, exits
        As `blocks.borders.PathBorders` has them, lines counted in the window.
    round
        How often it was done before.
    sources
        For each side on which paths enter: the file, in the folder, of the neighbour that they left.
    """

    core: Window = (0, 0, 0, 0)
    window: Window = (0, 0, 0, 0)
    origin: tuple[int, int] = (0, 0)
    whole: tuple[int, int] = (0, 0)
    seams: Mapping[Side, Window] = field(default_factory=dict)
    entries: Mapping[Side, int] = field(default_factory=dict)
    exits: Mapping[Side, int] = field(default_factory=dict)
    round: int = 0
    sources: Mapping[Side, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """By its place, and how often it was done before."""
        again = f"-again{self.round}" if self.round else ""
        return f"tile-y{self.core[1]:06d}-x{self.core[0]:06d}{again}"

    def provenance(self) -> dict[str, Any]:
        """Beside what a scene has, its place, and where paths come from."""
        place = {"core": list(self.core), "window": list(self.window), "sources": dict(self.sources)}
        return super().provenance() | place


@dataclass(frozen=True)
class Tiled:
    """What was done.

    Attributes
    ----------
    output
        The map.
    shape
        (V, U, H, W, C) of the field.
    range
        (min, max) disparity that was searched, px per view step.
    tile
        Side of the tiles, px.
    halo
        Px around each that it was estimated from.
    tiles, there
        How many there are, and how many of them had been done before.
    again
        How many were done again with what their neighbours had found; one that was done again twice counts
        twice.
    apart
        Share of the pixels within 4 px of a border between tiles on which the two differ by more than 0.02
        px per view step.
    off
        Share of the map's pixels that may be further than 0.02 px per view step from the map of the whole, by
        how far into either tile they differ.
    seconds
        For all of it.
    """

    output: Path
    shape: tuple[int, int, int, int, int]
    range: tuple[float, float]
    tile: int
    halo: int
    tiles: int
    there: int
    again: int
    apart: float
    off: float
    seconds: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be known of the map, and what to do about it."""
        if self.off <= MOST_OFF:
            return ()
        return (
            f"seams: about {100 * self.off:.2g} % of the pixels may be more than {SEAM_APART} px off the map "
            f"of the whole, as tiles differ on {100 * self.apart:.2g} % at their borders; expected at most "
            f"{100 * MOST_OFF:g} %; allow more memory, for larger tiles, or a halo of more than {self.halo} "
            "px, or estimate the map as a whole",
        )


def estimate_tiled(
    scene: str | Path,
    out: str | Path,
    method: str | Method = DEFAULT,
    *,
    memory: float = 2e9,
    tile: int | None = None,
    halo: int = HALO,
    client: Any = None,
    scheduler: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    equalise: bool = True,
    reading: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Tiled:
    """Estimate the disparity map of a light field by tiles, so that its views need not fit in memory.

    Parameters
    ----------
    scene
        Path of the light field. Of Zarr, HDF5, NPY and TIFF that is not compressed, windows are read; of
        other formats whole views, a few at a time.
    out
        Map to write: `.zarr` (disparity, confidence, sigma), `.tif` or `.npy` (disparity). Until it is whole,
        its tiles are in `NAME.tiles` beside it; after a break the same call goes on with these.
    method
        Name of a method, or a `Method`.
    memory
        Bytes that a process may take.
    tile
        Side of the tiles, px; by default the largest that the memory allows.
    halo
        Px around a tile that it is estimated from, beside the shifts of the views.
    client, scheduler, workers
        Who does the tiles, as for `lfdepth.estimate_many`; by default this process.
    threads
        Of each estimate; by default all processors in this process, and one in each of several workers.
    range, engine, equalise, progress, **options
        As for `lfdepth.estimate`; progress counts tiles.
    reading
        How the scene is read: arguments of `lfdepth.read`.

    Returns
    -------
    Tiled

    Raises
    ------
    LightFieldError
        If the map cannot be written, the memory does not suffice for the smallest tile, tiles of other
        settings are there, or a tile fails; those that are finished stay.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> folder = Path(tempfile.mkdtemp())
    >>> lfdepth.write(folder / "bars.npy", scenes.render("bars", size=64, views=3))
    >>> done = lfdepth.estimate_tiled(
    ...     folder / "bars.npy", folder / "map.npy", "fbs", planes=8, range=(-1.5, 2), tile=48, halo=8
    ... )
    >>> done.tiles, lfdepth.io.read_disparity(done.output).shape
    (4, (64, 64))
    """
    started = time.perf_counter()
    if client is None and scheduler is None and workers is None:
        workers = 1
    if threads is None and workers != 1:
        threads = 1  # each worker's: there are more of them
    out = Path(out)
    if halo < 0:
        raise LightFieldError(f"halo: found {halo}, expected 0 px or more; {HALO} is the default")
    pools.check_who(client, scheduler, workers)
    check_tiled_writable(out)
    if scheduler is not None:
        pools.connect(scheduler).close()  # before anything takes long
    chosen = named_method(method, **options)
    settings: dict[str, Any] = {"engine": engine, "equalise": equalise}
    folder = out.with_name(f"{out.name}.tiles")
    job = jobs_for([scene], folder, chosen, reading=reading or {}, settings=settings, threads=threads)[0]
    seen = look_at_field(job)
    given = range if range is not None else seen.range
    with Shared(folder) as shared:
        with alone(folder, PROBE):
            probe = probe_field(job, seen, given and check_range(given), memory)
        job = replace(job, settings=settings | {"range": list(probe.range)})
        side = tile or _largest_tile(job, seen, probe, halo, memory)
        tiles = _tiles(job, seen, probe, side, halo)
        if len(tiles) > 1:
            with alone(folder, MEASURED):
                measure_field(job, seen, probe, memory)
        there = sum(each.is_done() for each in tiles)
        total, again = len(tiles), 0
        todo: Sequence[TileJob] = tiles
        while todo:
            left = [each for each in todo if not each.is_done()]
            for count, outcome in enumerate(pools.done_by(left, client, scheduler, workers, run_tile), 1):
                if outcome.status == "failed":
                    raise LightFieldError(outcome.message)
                if progress is not None:
                    progress(total - len(left) + count, total, "tile")
            seams = _compared(tiles)
            todo = _again(tiles, seams.spoilt)
            total, again = total + len(todo), again + len(todo)
            redone = {each.core: each for each in todo}
            tiles = [redone.get(each.core, each) for each in tiles]
        _put_together(out, tiles, seen, probe, chosen)
        shared.finish()
    return Tiled(
        output=out,
        shape=seen.shape,
        range=probe.range,
        tile=side,
        halo=halo,
        tiles=len(tiles),
        there=there,
        again=again,
        apart=seams.apart,
        off=sum(seams.spoilt.values()) / prod(seen.shape[2:4]),
        seconds=time.perf_counter() - started,
    )


def check_tiled_writable(out: Path) -> None:
    """Raise LightFieldError, before long work, if no map can be written there tile by tile."""
    ending = out.suffix.lower()
    if ending not in ENDINGS:
        raise LightFieldError(
            f"{out}: cannot be written tile by tile; expected a name ending in {', '.join(ENDINGS)}; choose "
            "one of these"
        )
    if ending == ".zarr":
        need("zarr", "zarr", out)
    if ending in (".tif", ".tiff"):
        need_tifffile(out)
    check_target(out, folder=ending == ".zarr")


# --- tiles


def _tiles(job: Job, seen: Look, probe: Probe, side: int, halo: int) -> list[TileJob]:
    """Tiles of a side, row by row."""
    shift = _shift(seen, probe)
    height, width = seen.shape[2:4]
    cores = {
        (x // side, y // side): (x, y, min(side, width - x), min(side, height - y))
        for y in range(0, height, side)
        for x in range(0, width, side)
    }
    windows = {place: widened(core, halo + shift, (height, width)) for place, core in cores.items()}
    # Nearer to a window's border, views do not show what a pixel is, and paths had better not begin.
    margin = min(shift + job.chosen().halo(), halo + shift - 1)
    entries = {place: entry_lines(window, margin, (height, width)) for place, window in windows.items()}
    common = {name: getattr(job, name) for name in Job.__dataclass_fields__}
    tiles = []
    for place, core in cores.items():
        beside = {
            name: other
            for name, (right, down) in NEIGHBOURS.items()
            if (other := (place[0] + right, place[1] + down)) in cores
        }
        tiles.append(
            TileJob(
                **common,
                core=core,
                window=windows[place],
                origin=origin(job),
                whole=(height, width),
                seams={
                    name: seam_between(name, core, windows[place], windows[other])
                    for name, other in beside.items()
                },
                entries=entries[place],
                exits=exit_lines(
                    windows[place], {name: (windows[o], entries[o]) for name, o in beside.items()}
                ),
            )
        )
    return tiles


@dataclass(frozen=True)
class _Seams:
    """How tiles differ at their borders.

    `apart` is `Tiled.apart`; `spoilt` the pixels of each tile, by its core, that this may have made wrong.
    """

    apart: float
    spoilt: Mapping[Window, float]


def _compared(tiles: Sequence[TileJob]) -> _Seams:
    """Compare all tiles with their neighbours."""
    places = _places(tiles)
    spoilt = {job.core: 0.0 for job in tiles}
    pixels = apart = 0
    for (column, row), job in places.items():
        for axis, side in enumerate(_ACROSS):
            if side not in job.seams:
                continue
            right, down = NEIGHBOURS[side]
            other = places[column + right, row + down]
            with np.load(job.target) as one, np.load(other.target) as two:
                difference = np.abs(one[f"{_BORDER}{side}"] - two[f"{_BORDER}{OPPOSITE[side]}"])
            lines = difference.T if axis == 0 else difference
            begin = job.seams[side][axis] - other.core[axis]  # of the lines, counted from the border
            near = lines[max(-_SEAM - begin, 0) : _SEAM - begin] > SEAM_APART
            pixels, apart = pixels + near.size, apart + int(near.sum())
            counts = (lines > _DOUBTFUL).sum(axis=1)
            spoilt[job.core] += _spoilt(counts, begin, job.core[2 + axis])
            spoilt[other.core] += _spoilt(counts[::-1], -begin - len(counts), other.core[2 + axis])
    return _Seams(apart / max(pixels, 1), spoilt)


def _spoilt(counts: NDArray[np.int64], begin: int, depth: int) -> float:
    """How many pixels of a tile may be wrong on the side of a border.

    A tile's errors fade from its window's border, which is beyond the tile's, towards its inside. So it is
    wrong no more often than tiles differ there, nor than they differ anywhere farther out. What is left at
    the innermost lines goes on to the middle.

    Parameters
    ----------
    counts
        Pixels that differ on lines along the border, from the inside of the tile outwards.
    begin
        Place of the first line, counted from the border; negative inside the tile.
    depth
        Px across the tile.
    """
    bands = (np.arange(len(counts)) + begin) // _BAND
    means = {band: float(counts[bands == band].mean()) for band in np.unique(bands).tolist()}
    inside = sum(band < 0 for band in means)
    fading = np.minimum.accumulate(list(means.values())[::-1])[::-1][:inside]
    if not inside:
        return 0.0
    return float(_BAND * fading.sum() + max(depth / 2 - _BAND * inside, 0) * fading[0])


def _again(tiles: Sequence[TileJob], spoilt: Mapping[Window, float]) -> list[TileJob]:
    """The tiles that are spoilt, to be done again with the paths of their neighbours, if that may help."""
    places = _places(tiles)
    found = []
    for (column, row), job in places.items():
        if spoilt[job.core] <= MOST_OFF * prod(job.core[2:]) or job.round == _ROUNDS:
            continue
        sources: dict[Side, str] = {}
        for side in job.entries:
            right, down = NEIGHBOURS[side]
            other = places.get((column + right, row + down))
            if other is not None and _leaves(other, OPPOSITE[side]):
                sources[side] = other.target.name
        if sources and sources != job.sources:
            found.append(replace(job, round=job.round + 1, sources=sources))
    return found


def _places(tiles: Sequence[TileJob]) -> dict[tuple[int, int], TileJob]:
    """Tiles by column and row."""
    columns, rows = (sorted({each.core[axis] for each in tiles}) for axis in (0, 1))
    return {(columns.index(each.core[0]), rows.index(each.core[1])): each for each in tiles}


def _leaves(job: TileJob, side: Side) -> bool:
    """Whether a tile has noted the paths that leave it on a side."""
    with np.load(job.target) as found:
        return f"{_PATHS}0_{side}" in found.files


def _shift(seen: Look, probe: Probe) -> int:
    """Px by which the outermost views are shifted at most."""
    farthest = float(np.abs(grid_offsets((seen.shape[0], seen.shape[1]))).max()) + 0.5
    return ceil(max(abs(end) for end in probe.range) * farthest)


def _largest_tile(job: Job, seen: Look, probe: Probe, halo: int, memory: float) -> int:
    """Side of the largest tile that the memory allows."""
    around = 2 * (halo + _shift(seen, probe)) + LATTICE - 1
    needed = process_bytes(job, seen, probe, _SMALLEST + around)
    if needed > memory:
        raise LightFieldError(
            f"memory: {size_text(memory)} for {job.scene}; expected at least {size_text(needed)}, which the "
            f"smallest tile of {_SMALLEST} px takes with what is around it; allow more, or use --views"
        )
    sides = np.arange(_SMALLEST, _LARGEST + 1, _MULTIPLE)
    fits = [int(side) for side in sides if process_bytes(job, seen, probe, int(side) + around) <= memory]
    return fits[-1]


def run_tile(job: Job) -> Outcome:
    """Do a tile, unless it has been done."""
    return run_alone(job, _done)


def _done(job: Job) -> Outcome:
    assert isinstance(job, TileJob)
    started = time.perf_counter()
    probe = recall(Path(job.folder) / PROBE, None)
    assert probe is not None  # or there would be no tiles
    with at_hand(job.scene) as path:
        lf = read_even(job, job.window, path, probe, job.whole)
    chosen = job.chosen()
    chosen.check(lf.shape)
    planes = chosen.planes_for(probe.range)
    check_room(job, chosen.memory(lf.shape, planes, lf.views.itemsize))
    borders = PathBorders({side: job.entries[side] for side in job.sources}, job.exits, _entering(job))
    with start_engine(job.settings["engine"], threads=job.threads) as engine:
        measured = measured_field(Path(job.folder))
        problem = Problem(lf, probe.range, planes, probe.noise, measured, borders)
        maps = chosen.run(problem, Work(engine, Trace()))
    disparity = np.clip(maps.disparity, *probe.range).astype(np.float32)
    inner = slices(within(job.core, job.window))
    arrays = {"disparity": disparity[inner], "confidence": maps.confidence[inner]}
    if maps.sigma is not None:
        arrays["sigma"] = maps.sigma[inner]
    for side, seam in job.seams.items():
        arrays[f"{_BORDER}{side}"] = disparity[slices(within(seam, job.window))]
    for number, leaving in enumerate(borders.leaving):
        arrays |= {f"{_PATHS}{number}_{side}": costs for side, costs in leaving.items()}
    with atomic(job.target) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays, **{PROVENANCE: job.stamp()})
    return finished(job, lf, probe.range, started)


def _entering(job: TileJob) -> list[dict[Side, NDArray[np.float32]]]:
    """Costs of the paths that enter a tile, for each decision, as its neighbours left them."""
    found: list[dict[Side, NDArray[np.float32]]] = []
    for side, name in job.sources.items():
        with np.load(Path(job.folder) / name) as source:
            number = 0
            while (key := f"{_PATHS}{number}_{OPPOSITE[side]}") in source.files:
                if number == len(found):
                    found.append({})
                found[number][side] = source[key]
                number += 1
    return found


# --- the map


def _put_together(out: Path, tiles: list[TileJob], seen: Look, probe: Probe, method: Method) -> None:
    """Write the map, tile by tile."""
    size = (seen.shape[2], seen.shape[3])
    if out.suffix.lower() == ".zarr":
        _write_zarr(out, tiles, size, probe, method)
        return
    with atomic(out) as temporary:
        if out.suffix.lower() == ".npy":
            kept: Any = np.lib.format.open_memmap(temporary, "w+", np.float32, size)
        else:
            facts = json.dumps({"quantity": "disparity", "unit": "px per view step"})
            options = {"description": facts, "metadata": None, "bigtiff": prod(size) > 1 << 29}
            kept = need_tifffile(out).memmap(temporary, shape=size, dtype=np.float32, **options)
        for job, found in _found(tiles):
            kept[slices(job.core)] = found["disparity"]
        kept.flush()
        del kept


def _write_zarr(out: Path, tiles: list[TileJob], size: tuple[int, int], probe: Probe, method: Method) -> None:
    """A group with chunks as large as tiles."""
    zarr = need("zarr", "zarr", out)
    side = tiles[0].core[2:][::-1]
    with (
        atomic_folder(out, manifest=f"disparity/{MANIFEST}") as temporary,
        writing(zarr, temporary) as store,
    ):
        group = zarr.open_group(store, mode="w", zarr_format=2)
        arrays: dict[str, Any] = {}
        for job, found in _found(tiles):
            for name in ("disparity", "confidence", "sigma"):
                if name in found:
                    if name not in arrays:
                        arrays[name] = group.create_array(name, shape=size, chunks=side, dtype=np.float32)
                    arrays[name][slices(job.core)] = found[name]
        parameters = json.dumps(method.as_dict())
        group.attrs.update({"unit": "px per view step", "range": list(probe.range), "parameters": parameters})


def _found(tiles: list[TileJob]) -> Iterator[tuple[TileJob, Mapping[str, NDArray[Any]]]]:
    """Each tile and what was found there."""
    for job in tiles:
        with np.load(job.target) as found:
            yield job, found
