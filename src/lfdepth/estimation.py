"""From a light field to a disparity map: range, planes, checks, and the method's run."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from lfdepth.engines import engine as start_engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, check_range
from lfdepth.memory import available_memory, size_text
from lfdepth.methods import DEFAULT, Method, Problem, Work
from lfdepth.methods import method as named_method
from lfdepth.probe.checks import check_map
from lfdepth.probe.preparation import prepare
from lfdepth.result import Result
from lfdepth.trace import Progress, Trace
from lfdepth.version import __version__

__all__ = ["Result", "estimate"]


def estimate(
    lf: LightField,
    method: str | Method = DEFAULT,
    *,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
    trace: Trace | None = None,
    force: bool = False,
    equalise: bool = True,
    check: bool = True,
    **options: Any,
) -> Result:
    """Estimate the disparity map of the reference view.

    Parameters
    ----------
    lf
        Light field of at least two views, side by side or one above the other.
    method
        Name of a method (`lfdepth.methods.names()`) or a `Method`.
    range
        (min, max) disparity in px per view step; None uses the light field's own, or, if it has none,
        estimates it (`lfdepth.find_range`).
    engine
        Name of an engine (`lfdepth.engines.NAMES`).
    threads
        Number of threads; None uses all processors. The result does not depend on it.
    progress
        Called with (steps done, steps in all, what was done).
    trace
        Records the run: time per block, intermediate results. It has its own `progress`.
    force
        Run even with an extreme number of planes, or if memory seems too small.
    equalise
        Equalise the brightness of the views where it differs (`lfdepth.measure_brightness`).
    check
        Check the map against the views afterwards (`Result.checks`); not included in `Result.runtime`.
    **options
        Parameters of the method, such as `step=0.02`.

    Returns
    -------
    Result

    Raises
    ------
    LightFieldError
        For an unknown method, engine or parameter, input the method cannot work with, or an estimate that
        would not fit in memory.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> result = lfdepth.estimate(lf, effort="fast")
    >>> result.disparity.shape
    (64, 64)
    >>> lfdepth.estimate(lf, "fbs-sfa", step=0.1, range=(-1.6, 2)).planes
    37
    """
    started = time.perf_counter()
    as_read = lf
    chosen = named_method(method, **options)
    chosen.check(lf.shape)
    watched = trace or Trace(progress)
    with start_engine(engine, threads=threads) as used:
        given = range if range is not None else lf.disparity_range
        prepared = prepare(lf, given and check_range(given), equal=equalise, engine=used)
        lf, searched = prepared.lf, prepared.range
        planes = chosen.planes_for(searched, force=force)
        if not force:
            _check_memory(lf, chosen, planes)
        maps = chosen.run(Problem(lf, searched, planes), Work(used, watched))
        runtime = time.perf_counter() - started
        disparity = np.clip(maps.disparity, *searched).astype(np.float32)
        checks = None
        if check:
            checks = check_map(
                prepared,
                disparity,
                maps.confidence,
                as_read=as_read,
                standing_out=maps.standing_out,
                engine=used,
            )
    return Result(
        disparity=disparity,
        confidence=maps.confidence,
        range=searched,
        planes=len(planes) if chosen.has_planes else 0,
        runtime=runtime,
        method=chosen,
        engine=engine,
        version=__version__,
        range_found=prepared.range_found,
        equalisation=prepared.equalisation,
        sigma=maps.sigma,
        checks=checks,
    )


def _check_memory(lf: LightField, method: Method, planes: Any) -> None:
    """Raise LightFieldError where an estimate does not fit in what is free."""
    free = available_memory()
    needed = method.memory(lf.shape, planes, lf.views.itemsize)
    if free is not None and needed > free:
        raise LightFieldError(
            f"{lf.name}: {method.name} with {len(planes)} planes needs {size_text(needed)} beside the views, "
            f"{size_text(free)} are free; expected enough memory; use --crop, --scale, --views or a larger "
            "--step, or --force (force=True in Python) to try anyway"
        )
