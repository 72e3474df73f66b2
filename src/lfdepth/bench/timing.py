"""Run times: taken when nothing is left to compile, and told apart by the machine they come from."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from lfdepth.engines.cpu.compilation import on_compilation
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.methods import Method
    from lfdepth.result import Result
    from lfdepth.trace import Progress

log = logging.getLogger(__name__)

_PIECE = 64  # px, shortest side of the piece on which a method runs before its time is taken
_FEW_PLANES = 12
_FRAME = 16  # px of the piece beyond what a window covers


def timed_estimate(
    lf: LightField,
    method: Method,
    *,
    engine: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Estimate with a run time in which nothing was compiled.

    Kernels are compiled and loaded on a small piece before. What the piece has no need of may still be
    compiled later; then the run is repeated.
    """
    from lfdepth.estimation import estimate

    run = partial(estimate, engine=engine, threads=threads)
    _warm_up(lf, method, run)
    compiled: list[None] = []
    with on_compilation(lambda: compiled.append(None)):
        result = run(lf, method, progress=progress)
    if not compiled:
        return result
    log.info("%s: %s again, since kernels were compiled meanwhile", lf.name, method)
    return run(lf, method, progress=progress)


def _warm_up(lf: LightField, method: Method, run: Callable[..., Result]) -> None:
    """Compile and load what the method needs, on the smallest piece of the views that it takes.

    Raises
    ------
    LightFieldError
        If the method cannot work with the whole views either.
    """
    for piece in _pieces(lf, method):
        try:
            _run_on_piece(piece, lf.disparity_range, method, run)
        except LightFieldError:
            if piece.shape == lf.shape:
                raise
        else:
            return


def _pieces(lf: LightField, method: Method) -> Iterator[LightField]:
    """Middles of the views: one that holds the method's windows, then larger ones, last the whole.

    They lie in memory as the whole does: kernels are compiled anew for views that are a window into others.
    """
    side = max(_PIECE, 2 * method.halo() + _FRAME)
    while True:
        width, height = min(lf.width, side), min(lf.height, side)
        piece = lf.crop((lf.width - width) // 2, (lf.height - height) // 2, width, height)
        yield replace(piece, views=piece.views.copy()) if lf.views.flags.c_contiguous else piece
        if (width, height) == (lf.width, lf.height):
            return
        side *= 2


def _run_on_piece(
    piece: LightField, ends: tuple[float, float] | None, method: Method, run: Callable[..., Result]
) -> None:
    from lfdepth.probe.ranges import find_range

    if ends is None:
        with suppress(LightFieldError):  # the piece may be too small to find a range in
            find_range(piece)
    low, high = ends or (-1.0, 1.0)
    planes = method.planes_for((low, high), force=True)
    # The nearest planes will do; what only later ones need is compiled in the run itself.
    low = max(low, high - _FEW_PLANES * float(planes[0] - planes[1]))
    run(piece, method, range=(low, high), force=True)


@cache
def machine() -> str:
    """What a run time depends on beside the code: processor, how many may be used, operating system."""
    from lfdepth.engines.cpu.workers import default_threads

    return f"{processor()}, {default_threads()} processors, {platform.system()} {platform.machine()}"


@cache
def processor() -> str:
    """Name of the processor."""
    file = Path("/proc/cpuinfo")
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def load() -> float | None:
    """Mean number of processes that wanted to compute in the last minute, where the system tells."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
