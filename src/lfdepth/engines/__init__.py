"""Engines: what blocks call to have the work done. `lfdepth.engines.base` says what each of them promises."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

_HOMES = {
    "cpu": ("lfdepth.engines.cpu.engine", "CpuEngine"),
    "numpy": ("lfdepth.engines.plain.engine", "NumpyEngine"),
}

NAMES: tuple[str, ...] = tuple(_HOMES)
"""Names of the engines, the default first."""

SUMMARIES = {
    "cpu": "Compiled kernels on all processor cores (the default).",
    "numpy": "Plain NumPy: slow, written to be read and compared against.",
}
"""One sentence about each."""


def engine(name: str = "cpu", *, threads: int | None = None) -> Engine:
    """Start an engine; a context manager, or `close` it.

    Parameters
    ----------
    name
        One of `NAMES`.
    threads
        Number of threads; None uses all processors. The numpy engine has one.

    Raises
    ------
    LightFieldError
        For an unknown name, or a number of threads below 1.
    """
    if name not in _HOMES:
        raise LightFieldError(f"engine: found {name!r}, expected one of {', '.join(NAMES)}; choose one")
    home, kind = _HOMES[name]
    started: Any = getattr(import_module(home), kind)(threads)
    return started  # type: ignore[no-any-return]


@contextmanager
def using(given: Engine | None, *, threads: int | None = None) -> Iterator[Engine]:
    """The given engine, or for want of one the default engine, for the time of the context."""
    if given is not None:
        yield given
        return
    with engine(threads=threads) as started:
        yield started


@cache
def single() -> Engine:
    """The default engine on one thread, for single blocks."""
    return engine(threads=1)
