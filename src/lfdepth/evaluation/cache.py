"""Estimates remembered by content, so that long work resumes where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.evaluation.metrics import Array
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.methods import Method


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
        progress: Callable[[int, int], None] | None = None,
    ) -> Found:
        """The estimate and its run time from the folder, or made now and put there.

        Raises
        ------
        LightFieldError
            If the method cannot work with the light field, or the folder cannot be written.
        """
        from lfdepth.io import write
        from lfdepth.sweep.run import estimate

        file = self.folder / f"{key(lf, method)}.npz"
        found = _load(file)
        if found is None:
            _warm_up(lf, method)
            write(file, estimate(lf, method, threads=threads, progress=progress))
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

    parameters = json.dumps(asdict(method), sort_keys=True, default=str)
    words = [__version__, lf.views.dtype.name, lf.shape, lf.disparity_range, parameters]
    digest = hashlib.sha256(repr(words).encode())
    digest.update(np.ascontiguousarray(lf.views).data)
    if lf.present is not None:
        digest.update(np.ascontiguousarray(lf.present).data)
    return digest.hexdigest()[:32]


def _warm_up(lf: LightField, method: Method) -> None:
    """Compile what the method needs, so that run times are those of the method alone."""
    from lfdepth.sweep.run import estimate

    # More planes than J, since the first J of them run without a mask.
    planes = method.skip + 3
    estimate(lf.crop(0, 0, min(lf.width, 64), min(lf.height, 64)), method, planes=planes, step=None)


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
