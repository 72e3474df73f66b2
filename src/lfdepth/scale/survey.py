"""What a whole field tells its tiles: found once, on a shrunken copy and on windows, and kept in files."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from math import prod
from pathlib import Path

import numpy as np

from lfdepth.blocks.noise import Residual, residual
from lfdepth.engines import engine as start_engine
from lfdepth.errors import LightFieldError
from lfdepth.io import read
from lfdepth.io.atomic import atomic
from lfdepth.lightfield import LightField
from lfdepth.methods import Problem, Work
from lfdepth.methods.base import Measured
from lfdepth.probe.brightness import Equalisation, equalise, measure_brightness
from lfdepth.probe.ranges import find_range
from lfdepth.scale.jobs import Job, at_hand
from lfdepth.scale.look import Look, look
from lfdepth.scale.windows import Window, slices, window_around
from lfdepth.trace import Trace

PROBE, MEASURED = "probe.npz", "measured.json"
"""Files in the folder of the tiles."""
_EQUALISATION = "equalisation_"
_SHRUNK = 512  # px, the shorter side of what range and brightness are found on
_AT_ONCE = 6  # views that reading holds before they are shrunk, at most
_SAMPLE = 512  # px, side of the window on which noise is measured
_FIVE = 320, 224, 160, 96  # px, sides that five windows may have, on which a method measures what it takes
_PROCESS = 350_000_000  # bytes of an interpreter with its libraries and kernels
_HELD = 1.25  # what a process comes to hold, as arrays of many sizes leave gaps, over what one tile takes


@dataclass(frozen=True, eq=False)
class Probe:
    """What all tiles are told: range, brightness, noise, and the value of white."""

    range: tuple[float, float]
    equalisation: Equalisation | None
    noise: Residual
    white: float | None


def look_at_field(job: Job) -> Look:
    """Shape, samples and range of a scene; LightFieldError for what tiles cannot do."""
    if job.reading.get("scale", 1) != 1:
        raise LightFieldError("scale: found with tiles; expected whole views; leave it out, or --memory")
    with at_hand(job.scene) as path:
        return look(path, job.reading)


def origin(job: Job) -> tuple[int, int]:
    """(x, y) of the field in the views as they are stored."""
    x, y = (job.reading.get("crop") or (0, 0))[:2]
    return int(x), int(y)


def _read_window(job: Job, window: Window, path: Path, white: float | None, scale: float = 1.0) -> LightField:
    """A window of all views."""
    x, y = origin(job)
    crop = (window[0] + x, window[1] + y, *window[2:])
    return read(path, **{**job.reading, "crop": crop, "white_level": white, "scale": scale})


def probe_field(job: Job, seen: Look, given: tuple[float, float] | None, memory: float) -> Probe:
    """Range and brightness of the shrunken field, and of windows what they tell; remembered in a file."""
    file = Path(job.folder) / PROBE
    wanted = json.dumps(job.provenance() | {"range": given}, sort_keys=True, default=str)
    if (found := recall(file, wanted)) is not None:
        return found
    with at_hand(job.scene) as path, start_engine(job.settings["engine"], threads=job.threads) as engine:
        small, scale = _shrunken(job, seen, path, memory)
        near = given and (given[0] * scale, given[1] * scale)
        equal = measure_brightness(small, range=near, engine=engine) if job.settings["equalise"] else None
        if given is None:
            even = small if equal is None else equalise(small, equal)
            low, high = find_range(even, engine=engine)
            given = low / scale, high / scale
        chosen, first = job.chosen(), Probe(given, equal, Residual(0.0, 0.0), seen.white)
        planes, size = chosen.planes_for(given), seen.shape[2:4]
        middle = read_even(job, window_around((size[0] // 2, size[1] // 2), size, _SAMPLE), path, first, size)
        probe = replace(first, noise=residual(middle, planes, engine=engine))
    _remember(file, probe, wanted)
    return probe


def measure_field(job: Job, seen: Look, probe: Probe, memory: float) -> None:
    """Remember in a file what the method takes from the whole field."""
    file = Path(job.folder) / MEASURED
    if file.exists():
        return
    chosen = job.chosen()
    planes = chosen.planes_for(probe.range)
    with at_hand(job.scene) as path, start_engine(job.settings["engine"], threads=job.threads) as engine:
        samples = (
            Problem(read_even(job, window, path, probe, seen.shape[2:4]), probe.range, planes, probe.noise)
            for window in sample_windows(job, seen, probe, memory)
        )
        measured = chosen.measure(samples, Work(engine, Trace()))
    with atomic(file) as temporary:
        temporary.write_text(json.dumps(measured and asdict(measured)), encoding="utf-8")


def measured_field(folder: Path) -> Measured | None:
    """What the method takes from the whole field, where there is more than one tile."""
    file = folder / MEASURED
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    return found and Measured(found["exponent"], tuple(found["typical"]))


def read_even(job: Job, window: Window, path: Path, probe: Probe, size: tuple[int, int]) -> LightField:
    """A window of all views of (H, W) px, as bright as each other."""
    lf = _read_window(job, window, path, probe.white)
    if probe.equalisation is None:
        return lf
    return equalise(lf, probe.equalisation, part=slices(window), size=size)


def sample_windows(job: Job, seen: Look, probe: Probe, memory: float) -> list[Window]:
    """Windows that stand for a field: all of it, or five spread over it, as small as the memory asks for."""
    height, width = size = seen.shape[2], seen.shape[3]
    sides = [side for side in (_SAMPLE, *_FIVE) if process_bytes(job, seen, probe, side) <= memory]
    side = sides[0] if sides else _FIVE[-1]
    if side >= max(size):
        return [window_around((height // 2, width // 2), size, side)]
    side = min(side, _FIVE[0])
    places = [(1, 1), (1, 3), (2, 2), (3, 1), (3, 3)]
    windows = [
        window_around((height * down // 4, width * across // 4), size, side) for down, across in places
    ]
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


def _remember(file: Path, probe: Probe, made_of: str) -> None:
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


def recall(file: Path, made_of: str | None) -> Probe | None:
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
        return Probe((low, high), equal, noise, None if np.isnan(white) else white)


def process_bytes(job: Job, seen: Look, probe: Probe, side: int) -> int:
    """Memory of a process that estimates a window of a side."""
    height, width = (min(side, size) for size in seen.shape[2:4])
    shape = (*seen.shape[:2], height, width, seen.shape[4])
    uneven = probe.equalisation is not None and probe.equalisation.needed
    itemsize = max(seen.itemsize, 2) if uneven else seen.itemsize
    views = prod(shape) * (itemsize + (seen.itemsize if uneven else 0))
    chosen = job.chosen()
    return _PROCESS + int(_HELD * (views + chosen.memory(shape, chosen.planes_for(probe.range), itemsize)))
