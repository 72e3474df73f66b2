"""Estimates remembered by all that they depend on, so that long work resumes where it stopped."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from lfdepth.bench.results import Found
from lfdepth.bench.timing import machine, timed_estimate
from lfdepth.io import write
from lfdepth.io.atomic import atomic
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.methods import Method

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cache:
    """Estimates in a folder: for each an NPZ file with the map, and a JSON file for every run time.

    A map is found again by the hash of the views, of which of them are there, of the disparity range, of the
    method with all its parameters, of the engine, and of the code (`code_digest`). A run time is found again
    by that, the machine and the number of threads; where it is absent, the estimate is made again to take it.
    """

    folder: Path

    def estimate(
        self, lf: LightField, method: Method, *, engine: str = "cpu", threads: int | None = None
    ) -> Found:
        """The estimate and its run time from the folder, or made now and put there.

        Raises
        ------
        LightFieldError
            If the method cannot work with the light field, or the folder cannot be written.
        """
        code = code_digest(type(method).__module__.partition(".")[0])
        name = key(lf, method.name, method.parameters(), engine, code)
        maps = self.folder / f"{name}.npz"
        times = self.folder / f"{name}-{_on_this_machine(threads)}.json"
        found, seconds = _load(maps), _load_time(times)
        if found is None or seconds is None:
            result = timed_estimate(lf, method, engine=engine, threads=threads)
            _write_time(times, result.runtime, threads)
            if found is None:
                write(maps, result)
                found = _load(maps)
            seconds = result.runtime
        else:
            log.info("%s: %s taken from %s", lf.name, method, maps)
        assert found is not None  # it has just been written
        return Found(found.disparity, found.confidence, seconds)


def key(lf: LightField, method: str, parameters: Mapping[str, Any], engine: str, code: str) -> str:
    """Hash of everything that a map depends on; `code` is the digest of the code."""
    words = [
        code,
        engine,
        method,
        json.dumps(dict(parameters), sort_keys=True, default=str),
        lf.disparity_range,
        lf.shape,
        lf.views.dtype.name,
    ]
    digest = hashlib.sha256(repr(words).encode())
    digest.update(np.ascontiguousarray(lf.views).data)
    if lf.present is not None:
        digest.update(np.ascontiguousarray(lf.present).data)
    return digest.hexdigest()[:32]


@cache
def code_digest(package: str = "lfdepth") -> str:
    """Hash of the code of lfdepth, and of another package that a method comes from.

    The versions of numba, which compiles it, and of NumPy are part of it.
    """
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {np.__version__}".encode())
    for name in dict.fromkeys(["lfdepth", package]):
        for file, place in _modules(name):
            digest.update(f"{place}\0".encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _modules(package: str) -> Iterator[tuple[Path, str]]:
    """The files of a package, or the one of a module, with their places in it."""
    home = import_module(package).__file__
    if home is None:  # a namespace, or an interactive session
        return
    if Path(home).name != "__init__.py":
        yield Path(home), package
        return
    folder = Path(home).parent
    for file in sorted(folder.rglob("*.py")):
        yield file, f"{package}/{file.relative_to(folder).as_posix()}"


def _on_this_machine(threads: int | None) -> str:
    """Short name of this machine with so many threads."""
    return hashlib.sha256(f"{machine()}\0{_count(threads)}".encode()).hexdigest()[:12]


def _count(threads: int | None) -> int:
    from lfdepth.engines.cpu.workers import default_threads

    return threads or default_threads()


def _load(file: Path) -> Found | None:
    """The map that a file of the cache holds; None where there is none, or a damaged one."""
    try:
        with np.load(file) as data:
            return Found(data["disparity"], data["confidence"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def _load_time(file: Path) -> float | None:
    try:
        return float(json.loads(file.read_text(encoding="utf-8"))["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_time(file: Path, seconds: float, threads: int | None) -> None:
    facts = {"seconds": seconds, "threads": _count(threads), "machine": machine()}
    with atomic(file) as temporary:
        temporary.write_text(json.dumps(facts) + "\n", encoding="utf-8")
