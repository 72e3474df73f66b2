"""The scenes that are trained on at a step: a window that moves over a series, so that none comes back."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self

import numpy as np
import torch

from lfdepth.learned.stacks import Position
from lfdepth.scenes.chance import Sample, render

VALIDATION_SERIES = 1
"""Series of scenes that nothing is ever trained on."""
_FIRST_SERIES = 2


class Window:
    """Scenes on a device, the oldest of which is replaced every so many steps by the next of the series.

    Which scenes there are at a step depends on the step alone. The next ones are rendered ahead by threads.

    Parameters
    ----------
    seed
        Which series.
    positions
        Views (v, u) that are needed.
    count
        Scenes at a time.
    size
        Height and width of a scene, px.
    pace
        Steps for which a scene is the newest.
    device
        Where the scenes lie.
    threads
        Number of threads that render.
    """

    def __init__(
        self,
        seed: int,
        positions: Sequence[Position],
        *,
        count: int,
        size: int,
        pace: int,
        device: torch.device,
        threads: int,
    ) -> None:
        self._seed, self._positions, self._size = seed, positions, size
        self._count, self._pace = count, pace
        self.views = torch.empty((count, len(positions), size, size, 3), dtype=torch.uint8, device=device)
        self.truth = torch.empty((count, size, size), device=device)
        self._held: list[int] = [-1] * count
        self._pool = ThreadPoolExecutor(threads)
        self._ahead: dict[int, Future[Sample]] = {}
        self._threads = threads

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def at(self, step: int) -> None:
        """Hold the scenes of a step, counted from 0."""
        first = step // self._pace
        wanted = range(first, first + self._count)
        for number in range(first, first + self._count + self._threads):
            if number not in self._ahead and self._held[number % self._count] != number:
                self._ahead[number] = self._pool.submit(self._render, number)
        for number in wanted:
            place = number % self._count
            if self._held[place] != number:
                sample = self._ahead.pop(number).result()
                self.views[place] = torch.as_tensor(sample.views)
                self.truth[place] = torch.as_tensor(sample.truth)
                self._held[place] = number

    def _render(self, number: int) -> Sample:
        return render(number, self._size, self._positions, seed=_FIRST_SERIES + self._seed)


def validation_scenes(
    positions: Sequence[Position], count: int, size: int, device: torch.device
) -> tuple[torch.Tensor, torch.Tensor]:
    """Views (count, N, H, W, 3) and truth (count, H, W) of scenes that nothing is trained on."""
    samples = [render(number, size, positions, seed=VALIDATION_SERIES) for number in range(count)]
    views = torch.as_tensor(np.stack([each.views for each in samples]), device=device)
    return views, torch.as_tensor(np.stack([each.truth for each in samples]), device=device)
