"""Estimates remembered by content, so that long work resumes where it stopped."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from lfdepth.engines.cpu.compilation import on_compilation
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.scoring.metrics import Array

if TYPE_CHECKING:
    from lfdepth.methods import Method
    from lfdepth.result import Result
    from lfdepth.trace import Progress

_PIECE = 64  # px, side of the piece on which a method runs before its time is taken


@dataclass(frozen=True, eq=False)
class Found:
    """A disparity map (H, W), its confidence, and the run time in s, where they are known."""

    disparity: Array
    confidence: Array | None = None
    runtime: float | None = None


@dataclass(frozen=True)
class Cache:
    """Estimates in a folder, one NPZ file for each.

    An estimate is found again by the hash of the views, of which of them are there, of the disparity range,
    of the method with all its parameters, and of the version of the package.
    """

    folder: Path

    def estimate(
        self,
        lf: LightField,
        method: Method,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Found:
        """The estimate and its run time from the folder, or made now and put there.

        Raises
        ------
        LightFieldError
            If the method cannot work with the light field, or the folder cannot be written.
        """
        from lfdepth.io import write

        file = self.folder / f"{key(lf, method)}.npz"
        found = _load(file)
        if found is None:
            write(file, timed_estimate(lf, method, threads=threads, progress=progress))
            found = _load(file)
        assert found is not None  # it has just been written
        return found


def _load(file: Path) -> Found | None:
    """What a file of the cache holds; None where there is none, or a damaged one, which is made anew."""
    try:
        with np.load(file) as data:
            return Found(data["disparity"], data["confidence"], float(data["runtime"]))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def key(lf: LightField, method: Method) -> str:
    """Hash of everything that an estimate depends on."""
    from lfdepth import __version__

    parameters = json.dumps([method.name, method.parameters()], sort_keys=True)
    words = [__version__, lf.views.dtype.name, lf.shape, lf.disparity_range, parameters]
    digest = hashlib.sha256(repr(words).encode())
    digest.update(np.ascontiguousarray(lf.views).data)
    if lf.present is not None:
        digest.update(np.ascontiguousarray(lf.present).data)
    return digest.hexdigest()[:32]


def timed_estimate(
    lf: LightField,
    method: Method,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Estimate with a run time in which nothing was compiled.

    Kernels are compiled and loaded on a small piece before. What the piece has no need of may still be
    compiled later; then the run is repeated.
    """
    from lfdepth.estimation import estimate

    _warm_up(lf, method, threads)
    compiled: list[None] = []
    with on_compilation(lambda: compiled.append(None)):
        result = estimate(lf, method, threads=threads, progress=progress)
    return estimate(lf, method, threads=threads, progress=progress) if compiled else result


def _warm_up(lf: LightField, method: Method, threads: int | None) -> None:
    """Compile and load what the method needs, on the middle of the views."""
    from lfdepth.estimation import estimate
    from lfdepth.probe.ranges import find_range

    side = max(_PIECE, 2 * method.halo() + 2)
    width, height = min(lf.width, side), min(lf.height, side)
    piece = lf.crop((lf.width - width) // 2, (lf.height - height) // 2, width, height)
    if lf.disparity_range is None:
        with suppress(LightFieldError):  # the piece may be too small to find a range in
            find_range(piece, threads=threads)
    few: dict[str, Any] = {"planes": 8} if method.has_planes else {}
    if "skip" in method.parameters():
        few["skip"] = 5  # the first J planes run without a mask
    estimate(piece, method, range=lf.disparity_range or (-1.0, 1.0), threads=threads, **few)


def make_folder(folder: Path) -> Path:
    """Make a folder and those above it; LightFieldError where that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LightFieldError(
            f"{folder}: cannot be made ({error.strerror}); expected a writable folder; choose another"
        ) from None
    return folder


def one_line(error: Exception) -> str:
    """Message of an error that a user can act on; others keep the name of their kind and are cut short."""
    text = " ".join(str(error).split())
    return text if isinstance(error, LightFieldError) else f"{type(error).__name__}: {text[:200]}"
