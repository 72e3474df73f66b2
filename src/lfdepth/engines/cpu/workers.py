"""Threads for kernels.

Kernels release the GIL and each works on a band of rows, so an ordinary thread pool runs them side by side.
No row's result depends on where its band begins, which makes results independent of the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

from lfdepth.errors import LightFieldError


def default_threads() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Workers:
    """A pool that runs `kernel(first_row, last_row, *args)` over the rows of an image.

    Parameters
    ----------
    threads
        Number of threads, at least 1; None takes every processor this process may use.

    Raises
    ------
    LightFieldError
        If `threads` is below 1.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = default_threads() if threads is None else threads
        if self.threads < 1:
            raise LightFieldError(f"threads: found {threads}, expected at least 1")
        # One less: the thread that calls works, too, which saves waking another.
        self._pool = (
            ThreadPoolExecutor(self.threads - 1, thread_name_prefix="lfdepth") if self.threads > 1 else None
        )

    def rows(self, height: int, kernel: Callable[..., Any], *args: Any, first: int = 0) -> None:
        """Run the kernel over rows [first, height) and wait for it."""
        if self._pool is None:
            kernel(first, height, *args)
            return
        own, *others = bands(height - first, self.threads) or [(0, 0)]
        jobs = [self._pool.submit(kernel, first + start, first + end, *args) for start, end in others]
        kernel(first + own[0], first + own[1], *args)
        for job in jobs:
            job.result()

    def each(self, act: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """What a function gives for each item; for NumPy on large arrays, which releases the GIL."""
        given = list(items)
        if self._pool is None:
            return [act(item) for item in given]
        found: list[Any] = [None] * len(given)
        left = iter(range(len(given)))  # threads take turns at it

        def work() -> None:
            for index in left:
                found[index] = act(given[index])

        jobs = [self._pool.submit(work) for _ in range(self.threads - 1)]
        work()
        for job in jobs:
            job.result()
        return found

    def once(self, kernel: Callable[..., Any], *args: Any) -> None:
        """Run a kernel that does not work on rows."""
        kernel(*args)

    def close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


def bands(height: int, count: int) -> list[tuple[int, int]]:
    """Split rows into at most `count` bands, as even as possible; none where there are no rows."""
    count = max(min(count, height), 1)
    return [
        (start, end) for start, end in pairwise(height * i // count for i in range(count + 1)) if start < end
    ]
