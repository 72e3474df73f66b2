"""Results of other programs: a folder with maps `SCENE.pfm`, and run times in seconds `SCENE.txt`."""

from __future__ import annotations

from pathlib import Path

from lfdepth.bench.results import Found
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity


def read_external(folder: Path, scene: str) -> Found:
    """Read the map of another program's result for a scene, without its run time.

    Raises
    ------
    LightFieldError
        If there is no map or it cannot be read.
    """
    maps = [folder / "disp_maps" / f"{scene}.pfm", folder / f"{scene}.pfm"]
    found = next((file for file in maps if file.exists()), None)
    if found is None:
        raise LightFieldError(f"{folder}: no {scene}.pfm; expected it there or in disp_maps; add the map")
    return Found(read_disparity(found, finite=False))


def external_runtime(folder: Path, scene: str) -> float:
    """Read the run time, in seconds, of another program's result for a scene.

    Raises
    ------
    LightFieldError
        If there is none, or it is not a number.
    """
    times = [folder / "runtimes" / f"{scene}.txt", folder / f"{scene}.txt"]
    found = next((file for file in times if file.exists()), None)
    if found is None:
        raise LightFieldError(f"{folder}: no {scene}.txt; expected a run time in seconds; add it")
    return read_runtime(found)


def read_runtime(file: Path) -> float:
    """Read a run time in seconds; LightFieldError if it is no positive finite number."""
    text = file.read_text(encoding="utf-8", errors="replace").strip()
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < float("inf"):
        raise LightFieldError(f"{file}: found {text[:40]!r}; expected a run time in seconds; write a number")
    return seconds
