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
from dataclasses import asdict, dataclass, field, replace
from math import ceil, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.borders import PathBorders, Side
from lfdepth.blocks.noise import Residual, residual
from lfdepth.engines import engine as start_engine
from lfdepth.errors import LightFieldError
from lfdepth.io import read
from lfdepth.io.atomic import MANIFEST, atomic, atomic_folder, check_target
from lfdepth.io.extras import need, need_tifffile
from lfdepth.io.zarr_store import writing
from lfdepth.lightfield import LightField, check_range, grid_offsets
from lfdepth.memory import size_text
from lfdepth.methods import DEFAULT, Method, Problem, Work
from lfdepth.methods import method as named_method
from lfdepth.methods.base import Measured
from lfdepth.probe.brightness import Equalisation, equalise, measure_brightness
from lfdepth.probe.ranges import find_range
from lfdepth.scale import pools
from lfdepth.scale.jobs import PROVENANCE, Job, at_hand, jobs_for
from lfdepth.scale.locks import Shared, alone
from lfdepth.scale.look import Look, look
from lfdepth.scale.work import Outcome, check_room, finished, run_alone
from lfdepth.trace import Progress, Trace

Window = tuple[int, int, int, int]
"""(x, y, width, height), px."""

HALO = 48
"""Px around a tile, beside the shifts of the views: as far as windows and fits reach (docs/scale.md)."""
SEAM_APART = 0.02
"""Px per view step from which on two tiles say something different."""
MOST_OFF = 0.001
"""Share of a tile's pixels that may be wrong by as much, by what its borders tell, before it is done again;
and of all in the end, before there is a warning."""
ENDINGS = (".zarr", ".tif", ".tiff", ".npy")
"""Formats that are written tile by tile."""
_SHRUNK = 512  # px, the shorter side of what range and brightness are found on
_AT_ONCE = 6  # views that reading holds before they are shrunk, at most
_SAMPLE = 512  # px, side of the window on which noise is measured
_FIVE = 320, 224, 160, 96  # px, sides that five windows may have, on which a method measures what it takes
_SMALLEST, _LARGEST, _MULTIPLE = 32, 4096, 32  # px, sides of tiles
_PROCESS = 350_000_000  # bytes of an interpreter with its libraries and kernels
_HELD = 1.25  # what a process comes to hold, as arrays of many sizes leave gaps, over what one tile takes
_PROBE, _EQUALISATION, _MEASURED = "probe.npz", "equalisation_", "measured.json"
_BORDER, _PATHS = "border_", "paths_"
"""What the names of arrays in a tile's file begin with: its map at its borders, and paths that leave it."""
_ROUNDS = 3
"""How often tiles that differ from their neighbours are done again at most."""
_SEAM = 4
"""Px on either side of a border that are told of as apart."""
_OVERLAP, _BAND = 24, 8
"""Px on either side of a border that are compared, and width of the bands in which they are counted."""
_DOUBTFUL = SEAM_APART / 2
"""Px per view step from which on a difference counts for how far it reaches: both tiles may lack the same."""
_LATTICE = 24
"""Px of which the corner of a window is a multiple, so that fits at every second, eighth or twelfth pixel are
at the same ones in all windows."""
_NEIGHBOURS: dict[Side, tuple[int, int]] = {
    "left": (-1, 0),
    "right": (1, 0),
    "top": (0, -1),
    "bottom": (0, 1),
}
_ACROSS: tuple[Side, Side] = "right", "bottom"
"""Sides on which every border is met once."""
_OPPOSITE: dict[Side, Side] = {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}


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
    seen = _seen(job)
    given = range if range is not None else seen.range
    with Shared(folder) as shared:
        with alone(folder, _PROBE):
            probe = _probe(job, seen, given and check_range(given), memory)
        job = replace(job, settings=settings | {"range": list(probe.range)})
        side = tile or _largest_tile(job, seen, probe, halo, memory)
        tiles = _tiles(job, seen, probe, side, halo)
        if len(tiles) > 1:
            with alone(folder, _MEASURED):
                _measure(job, seen, probe, memory)
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


# --- what is found once


@dataclass(frozen=True, eq=False)
class _Probe:
    """What all tiles are told: range, brightness, noise, and the value of white."""

    range: tuple[float, float]
    equalisation: Equalisation | None
    noise: Residual
    white: float | None


def _seen(job: Job) -> Look:
    """Shape, samples and range of a scene; LightFieldError for what tiles cannot do."""
    if job.reading.get("scale", 1) != 1:
        raise LightFieldError("scale: found with tiles; expected whole views; leave it out, or --memory")
    with at_hand(job.scene) as path:
        return look(path, job.reading)


def _origin(job: Job) -> tuple[int, int]:
    x, y = (job.reading.get("crop") or (0, 0))[:2]
    return int(x), int(y)


def _read_window(job: Job, window: Window, path: Path, white: float | None, scale: float = 1.0) -> LightField:
    """A window of all views."""
    x, y = _origin(job)
    crop = (window[0] + x, window[1] + y, *window[2:])
    return read(path, **{**job.reading, "crop": crop, "white_level": white, "scale": scale})


def _probe(job: Job, seen: Look, given: tuple[float, float] | None, memory: float) -> _Probe:
    """Range and brightness of the shrunken field, and of windows what they tell; remembered in a file."""
    file = Path(job.folder) / _PROBE
    wanted = json.dumps(job.provenance() | {"range": given}, sort_keys=True, default=str)
    if (found := _remembered(file, wanted)) is not None:
        return found
    with at_hand(job.scene) as path, start_engine(job.settings["engine"], threads=job.threads) as engine:
        small, scale = _shrunken(job, seen, path, memory)
        near = given and (given[0] * scale, given[1] * scale)
        equal = measure_brightness(small, range=near, engine=engine) if job.settings["equalise"] else None
        if given is None:
            even = small if equal is None else equalise(small, equal)
            low, high = find_range(even, engine=engine)
            given = low / scale, high / scale
        chosen, first = job.chosen(), _Probe(given, equal, Residual(0.0, 0.0), seen.white)
        planes, size = chosen.planes_for(given), seen.shape[2:4]
        middle = _even_window(job, _around((size[0] // 2, size[1] // 2), size, _SAMPLE), path, first, size)
        probe = replace(first, noise=residual(middle, planes, engine=engine))
    _remember(file, probe, wanted)
    return probe


def _measure(job: Job, seen: Look, probe: _Probe, memory: float) -> None:
    """Remember in a file what the method takes from the whole field."""
    file = Path(job.folder) / _MEASURED
    if file.exists():
        return
    chosen = job.chosen()
    planes = chosen.planes_for(probe.range)
    with at_hand(job.scene) as path, start_engine(job.settings["engine"], threads=job.threads) as engine:
        samples = (
            Problem(_even_window(job, window, path, probe, seen.shape[2:4]), probe.range, planes, probe.noise)
            for window in _samples(job, seen, probe, memory)
        )
        measured = chosen.measure(samples, Work(engine, Trace()))
    with atomic(file) as temporary:
        temporary.write_text(json.dumps(measured and asdict(measured)), encoding="utf-8")


def _measured(folder: Path) -> Measured | None:
    """What the method takes from the whole field, where there is more than one tile."""
    file = folder / _MEASURED
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    return found and Measured(found["exponent"], tuple(found["typical"]))


def _even_window(job: Job, window: Window, path: Path, probe: _Probe, size: tuple[int, int]) -> LightField:
    """A window of all views of (H, W) px, as bright as each other."""
    lf = _read_window(job, window, path, probe.white)
    if probe.equalisation is None:
        return lf
    return equalise(lf, probe.equalisation, part=_slices(window), size=size)


def _samples(job: Job, seen: Look, probe: _Probe, memory: float) -> list[Window]:
    """Windows that stand for a field: all of it, or five spread over it, as small as the memory asks for."""
    height, width = size = seen.shape[2], seen.shape[3]
    sides = [side for side in (_SAMPLE, *_FIVE) if _bytes(job, seen, probe, side) <= memory]
    side = sides[0] if sides else _FIVE[-1]
    if side >= max(size):
        return [_around((height // 2, width // 2), size, side)]
    side = min(side, _FIVE[0])
    places = [(1, 1), (1, 3), (2, 2), (3, 1), (3, 3)]
    windows = [_around((height * down // 4, width * across // 4), size, side) for down, across in places]
    return list(dict.fromkeys(windows))


def _shrunken(job: Job, seen: Look, path: Path, memory: float) -> tuple[LightField, float]:
    """The whole field at a size that a first look needs, put together from bands of rows; its scale."""
    height, width = seen.shape[2:4]
    factor = max(1, min(height, width) // _SHRUNK)
    # Views shrink one by one as they are read: no more are there in full than threads read.
    row_bytes = _AT_ONCE * width * (seen.shape[4] * seen.itemsize + 8)
    rows = max(int(memory / 4 / row_bytes) // factor * factor, factor)
    bands = [
        _read_window(
            job, (0, y, width, min(rows, height // factor * factor - y)), path, seen.white, 1 / factor
        )
        for y in range(0, height // factor * factor, rows)
    ]
    views = np.concatenate([band.views for band in bands], axis=2)
    return replace(bands[0], views=views, camera=None, truth=None, masks={}, disparity_range=None), 1 / factor


def _around(place: tuple[int, int], size: tuple[int, int], side: int) -> Window:
    """A window around a place (y, x), moved into the picture of (H, W) px."""
    height, width = (min(side, each) for each in size)
    top, left = (
        min(max(at - length // 2, 0), each - length)
        for at, length, each in zip(place, (height, width), size, strict=True)
    )
    return left, top, width, height


def _remember(file: Path, probe: _Probe, made_of: str) -> None:
    arrays = {} if probe.equalisation is None else probe.equalisation.arrays()
    with atomic(file) as temporary:
        np.savez(
            temporary,
            allow_pickle=False,
            made_of=np.asarray(made_of),
            ends=np.asarray(probe.range),
            noise=np.asarray(probe.noise),
            white=np.asarray(np.nan if probe.white is None else probe.white),
            **{f"{_EQUALISATION}{key}": value for key, value in arrays.items()},
        )


def _remembered(file: Path, made_of: str | None) -> _Probe | None:
    """What was found before; None where nothing was, or of something else."""
    if not file.exists():
        return None
    with np.load(file) as found:
        if made_of is not None and str(found["made_of"]) != made_of:
            raise LightFieldError(
                f"{file.parent}: has tiles of other settings; expected the same; remove it, or choose "
                "another name for the map"
            )
        parts = {
            key.removeprefix(_EQUALISATION): found[key]
            for key in found.files
            if key.startswith(_EQUALISATION)
        }
        equal = Equalisation.of_arrays(parts) if parts else None
        low, high = found["ends"].tolist()
        white, noise = float(found["white"]), Residual(*found["noise"].tolist())
        return _Probe((low, high), equal, noise, None if np.isnan(white) else white)


# --- tiles


def _tiles(job: Job, seen: Look, probe: _Probe, side: int, halo: int) -> list[TileJob]:
    """Tiles of a side, row by row."""
    shift = _shift(seen, probe)
    height, width = seen.shape[2:4]
    cores = {
        (x // side, y // side): (x, y, min(side, width - x), min(side, height - y))
        for y in range(0, height, side)
        for x in range(0, width, side)
    }
    windows = {place: _window(core, halo + shift, (height, width)) for place, core in cores.items()}
    # Nearer to a window's border, views do not show what a pixel is, and paths had better not begin.
    margin = min(shift + job.chosen().halo(), halo + shift - 1)
    entries = {place: _entries(window, margin, (height, width)) for place, window in windows.items()}
    common = {name: getattr(job, name) for name in Job.__dataclass_fields__}
    tiles = []
    for place, core in cores.items():
        beside = {
            name: other
            for name, (right, down) in _NEIGHBOURS.items()
            if (other := (place[0] + right, place[1] + down)) in cores
        }
        tiles.append(
            TileJob(
                **common,
                core=core,
                window=windows[place],
                origin=_origin(job),
                whole=(height, width),
                seams={
                    name: _seam(name, core, windows[place], windows[other]) for name, other in beside.items()
                },
                entries=entries[place],
                exits=_exits(windows[place], {name: (windows[o], entries[o]) for name, o in beside.items()}),
            )
        )
    return tiles


def _window(core: Window, around: int, size: tuple[int, int]) -> Window:
    """A tile with what is around it, as far as there is a picture."""
    x, y, width, height = core
    left, top = (max(at - around, 0) // _LATTICE * _LATTICE for at in (x, y))
    right, bottom = min(x + width + around, size[1]), min(y + height + around, size[0])
    return left, top, right - left, bottom - top


def _entries(window: Window, margin: int, size: tuple[int, int]) -> dict[Side, int]:
    """Lines of a window on which paths begin, on the sides on which the picture goes on."""
    x, y, width, height = window
    lines: dict[Side, tuple[bool, int]] = {
        "left": (x > 0, margin),
        "right": (x + width < size[1], width - 1 - margin),
        "top": (y > 0, margin),
        "bottom": (y + height < size[0], height - 1 - margin),
    }
    return {side: line for side, (cut, line) in lines.items() if cut and margin >= 0}


def _exits(window: Window, beside: Mapping[Side, tuple[Window, Mapping[Side, int]]]) -> dict[Side, int]:
    """Lines of a window on which paths begin in the windows of the neighbours, where they lie in it."""
    found: dict[Side, int] = {}
    for side, (other, entries) in beside.items():
        axis = 0 if side in ("left", "right") else 1
        begins = entries.get(_OPPOSITE[side])
        if begins is None:
            continue
        at = begins + other[axis] - window[axis]
        if 0 <= at < window[2 + axis]:
            found[side] = at
    return found


def _seam(side: Side, core: Window, window: Window, other: Window) -> Window:
    """Pixels at the border of a tile on a side, as far as its window and the neighbour's have them."""
    x, y, width, height = core
    strips: dict[Side, Window] = {
        "left": (x - _OVERLAP, y, 2 * _OVERLAP, height),
        "right": (x + width - _OVERLAP, y, 2 * _OVERLAP, height),
        "top": (x, y - _OVERLAP, width, 2 * _OVERLAP),
        "bottom": (x, y + height - _OVERLAP, width, 2 * _OVERLAP),
    }
    return _common(strips[side], _common(window, other))


def _common(one: Window, other: Window) -> Window:
    """What two windows have in common."""
    left, top = max(one[0], other[0]), max(one[1], other[1])
    right, bottom = (min(one[i] + one[i + 2], other[i] + other[i + 2]) for i in (0, 1))
    return left, top, max(right - left, 0), max(bottom - top, 0)


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
            right, down = _NEIGHBOURS[side]
            other = places[column + right, row + down]
            with np.load(job.target) as one, np.load(other.target) as two:
                difference = np.abs(one[f"{_BORDER}{side}"] - two[f"{_BORDER}{_OPPOSITE[side]}"])
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
            right, down = _NEIGHBOURS[side]
            other = places.get((column + right, row + down))
            if other is not None and _leaves(other, _OPPOSITE[side]):
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


def _shift(seen: Look, probe: _Probe) -> int:
    """Px by which the outermost views are shifted at most."""
    farthest = float(np.abs(grid_offsets((seen.shape[0], seen.shape[1]))).max()) + 0.5
    return ceil(max(abs(end) for end in probe.range) * farthest)


def _bytes(job: Job, seen: Look, probe: _Probe, side: int) -> int:
    """Memory of a process that estimates a window of a side."""
    height, width = (min(side, size) for size in seen.shape[2:4])
    shape = (*seen.shape[:2], height, width, seen.shape[4])
    uneven = probe.equalisation is not None and probe.equalisation.needed
    itemsize = max(seen.itemsize, 2) if uneven else seen.itemsize
    views = prod(shape) * (itemsize + (seen.itemsize if uneven else 0))
    chosen = job.chosen()
    return _PROCESS + int(_HELD * (views + chosen.memory(shape, chosen.planes_for(probe.range), itemsize)))


def _largest_tile(job: Job, seen: Look, probe: _Probe, halo: int, memory: float) -> int:
    """Side of the largest tile that the memory allows."""
    around = 2 * (halo + _shift(seen, probe)) + _LATTICE - 1
    needed = _bytes(job, seen, probe, _SMALLEST + around)
    if needed > memory:
        raise LightFieldError(
            f"memory: {size_text(memory)} for {job.scene}; expected at least {size_text(needed)}, which the "
            f"smallest tile of {_SMALLEST} px takes with what is around it; allow more, or use --views"
        )
    sides = np.arange(_SMALLEST, _LARGEST + 1, _MULTIPLE)
    fits = [int(side) for side in sides if _bytes(job, seen, probe, int(side) + around) <= memory]
    return fits[-1]


def run_tile(job: Job) -> Outcome:
    """Do a tile, unless it has been done."""
    return run_alone(job, _done)


def _done(job: Job) -> Outcome:
    assert isinstance(job, TileJob)
    started = time.perf_counter()
    probe = _remembered(Path(job.folder) / _PROBE, None)
    assert probe is not None  # or there would be no tiles
    with at_hand(job.scene) as path:
        lf = _even_window(job, job.window, path, probe, job.whole)
    chosen = job.chosen()
    chosen.check(lf.shape)
    planes = chosen.planes_for(probe.range)
    check_room(job, chosen.memory(lf.shape, planes, lf.views.itemsize))
    borders = PathBorders({side: job.entries[side] for side in job.sources}, job.exits, _entering(job))
    with start_engine(job.settings["engine"], threads=job.threads) as engine:
        measured = _measured(Path(job.folder))
        problem = Problem(lf, probe.range, planes, probe.noise, measured, borders)
        maps = chosen.run(problem, Work(engine, Trace()))
    disparity = np.clip(maps.disparity, *probe.range).astype(np.float32)
    inner = _slices(_within(job.core, job.window))
    arrays = {"disparity": disparity[inner], "confidence": maps.confidence[inner]}
    if maps.sigma is not None:
        arrays["sigma"] = maps.sigma[inner]
    for side, seam in job.seams.items():
        arrays[f"{_BORDER}{side}"] = disparity[_slices(_within(seam, job.window))]
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
            while (key := f"{_PATHS}{number}_{_OPPOSITE[side]}") in source.files:
                if number == len(found):
                    found.append({})
                found[number][side] = source[key]
                number += 1
    return found


def _within(window: Window, outer: Window) -> Window:
    """A window as counted in another one."""
    return window[0] - outer[0], window[1] - outer[1], window[2], window[3]


def _slices(window: Window) -> tuple[slice, slice]:
    x, y, width, height = window
    return slice(y, y + height), slice(x, x + width)


# --- the map


def _put_together(out: Path, tiles: list[TileJob], seen: Look, probe: _Probe, method: Method) -> None:
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
            kept[_slices(job.core)] = found["disparity"]
        kept.flush()
        del kept


def _write_zarr(
    out: Path, tiles: list[TileJob], size: tuple[int, int], probe: _Probe, method: Method
) -> None:
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
                    arrays[name][_slices(job.core)] = found[name]
        parameters = json.dumps(method.as_dict())
        group.attrs.update({"unit": "px per view step", "range": list(probe.range), "parameters": parameters})


def _found(tiles: list[TileJob]) -> Iterator[tuple[TileJob, Mapping[str, NDArray[Any]]]]:
    """Each tile and what was found there."""
    for job in tiles:
        with np.load(job.target) as found:
            yield job, found
