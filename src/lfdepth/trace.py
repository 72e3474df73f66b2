"""Looking inside a run: how far it is, how long each block took, and intermediate arrays."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int, str], None]
"""Called with (steps done, steps in all, what was done last)."""


@dataclass
class Lap:
    """What happened between two steps.

    Attributes
    ----------
    what
        Name of the step.
    wall, cpu
        Seconds on the clock, and seconds that all threads together computed.
    blocks
        Seconds on the clock of each block; of blocks inside one another, the inner one's time is its own.
    """

    what: str
    wall: float
    cpu: float
    blocks: dict[str, float]


@dataclass(eq=False)
class Trace:
    """Records a run: progress, time per block, intermediate results.

    Parameters
    ----------
    progress
        Called after each step with (steps done, steps in all, what was done).
    keep
        Names of intermediate results to keep; a method's page in the docs lists what it offers.

    Attributes
    ----------
    kept : dict of str to list of ndarray
        What was kept, in order.
    laps : list of Lap
        The steps.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> trace = lfdepth.Trace(keep=["votes"])
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> result = lfdepth.estimate(lf, "fbs-sfa", planes=10, trace=trace)
    >>> len(trace.kept["votes"]), trace.kept["votes"][0].shape
    (10, (64, 64))
    >>> seconds = trace.times()  # of each block
    """

    progress: Progress | None = None
    keep: Collection[str] = ()
    kept: dict[str, list[NDArray[Any]]] = field(default_factory=dict, init=False)
    laps: list[Lap] = field(default_factory=list, init=False)
    total: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._running: list[str] = []
        self._spent: dict[str, float] = {}
        self._since = time.perf_counter()
        self._began = time.perf_counter(), time.process_time()

    def steps(self, total: int) -> None:
        """Say how many steps there will be in all, before the first one."""
        self.total = total
        self._began = time.perf_counter(), time.process_time()

    def step(self, what: str) -> None:
        """Say that one more step is done."""
        now = time.perf_counter(), time.process_time()
        wall, cpu = (end - start for end, start in zip(now, self._began, strict=True))
        self.laps.append(Lap(what, wall, cpu, self._spent))
        self._spent, self._began = {}, now
        if self.progress is not None:
            self.progress(len(self.laps), self.total, what)

    @contextmanager
    def block(self, name: str) -> Iterator[None]:
        """Charge the time in the context to a block."""
        self._charge()
        self._running.append(name)
        try:
            yield
        finally:
            self._charge()
            self._running.pop()

    def times(self) -> dict[str, float]:
        """Seconds of each block over the whole run."""
        found = dict(self._spent)
        for lap in self.laps:
            for name, seconds in lap.blocks.items():
                found[name] = found.get(name, 0.0) + seconds
        return found

    def wants(self, name: str) -> bool:
        """Whether an intermediate result is to be kept."""
        return name in self.keep

    def take(self, name: str, array: NDArray[Any] | Callable[[], NDArray[Any]]) -> None:
        """Keep a copy of an intermediate result if it is wanted; what makes it is only called then."""
        if self.wants(name):
            self.kept.setdefault(name, []).append(np.array(array() if callable(array) else array))

    def _charge(self) -> None:
        """Put the time since the last change to the account of the block that was running."""
        now = time.perf_counter()
        if self._running:
            block = self._running[-1]
            self._spent[block] = self._spent.get(block, 0.0) + now - self._since
        self._since = now
