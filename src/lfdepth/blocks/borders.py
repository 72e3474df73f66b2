"""Paths that go on across the border of a window.

A window of a larger field cuts scanline paths off, and where there is no texture, what paths bring along from
far away is all that a pixel gets. Here the costs of the paths that leave a window for its neighbours are
found, and those that enter it from them are put where its paths begin. In the recursion of semi-global
matching a path begins with the energy of its first pixel. If the costs that a path from outside has there
stand in for it, the path goes on as if it had not been cut off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.base import Array, Engine
from lfdepth.engines.layout import ENERGY_SCALE

Side = Literal["left", "right", "top", "bottom"]
Costs = NDArray[np.float32]
"""Costs (K, N) of the paths at the pixels of a line, above each one's least, in the energy's units."""
Paths = Callable[[Array, Array, NDArray[np.float32], NDArray[np.float32]], Array]
"""`Engine.paths` with its penalties: of signs, shares, weight and guide."""

_REACH = 256
"""Px along which a path is followed to where it leaves: what lies farther back has next to no say."""
_AT_ONCE = 128
"""Paths that are followed at once, for the sake of memory."""
_CUT_OFF = np.float32(1e3)
"""Difference of the guide at which a change of disparity costs nothing."""


@dataclass(eq=False)
class PathBorders:
    """How paths enter a window of a larger field, and how they leave it.

    Attributes
    ----------
    entries
        For each side from which paths enter: the line of this window, counted from 0, on which they begin.
        What lies outside is too near to the border for the views to show what it is.
    exits
        For the neighbour on each side: the line of this window on which paths begin in the neighbour's.
    entering
        For each decision in turn, by the side that paths come from: their costs where they begin. Of
        decisions or sides that are missing nothing is known.
    leaving
        What decisions so far leave to the neighbours, by the side that these are on.
    """

    entries: Mapping[Side, int]
    exits: Mapping[Side, int]
    entering: Sequence[Mapping[Side, Costs]] = ()
    leaving: list[dict[Side, Costs]] = field(default_factory=list)

    @contextmanager
    def open(
        self, signs: Array, weight: NDArray[np.float32], guide: NDArray[np.float32], engine: Engine
    ) -> Iterator[NDArray[np.float32]]:
        """For the time of the context, have paths begin with what enters; yields the guide that they take.

        `signs` (K, H, W) is the engine's, `weight` (H, W) and `guide` (H, W, C) are on the host.
        """
        number = len(self.leaving)
        entering = self.entering[number] if number < len(self.entering) else {}
        lines = [(_line(side, self.entries[side]), costs) for side, costs in entering.items()]
        kept = []
        for line, costs in lines:
            part = (slice(None), *line)
            kept.append((line, np.array(engine.download(signs[part])), weight[line].copy()))
            _put(signs[part], costs.reshape(kept[-1][1].shape), engine)
            weight[line] = 0
        try:
            yield self._cut(guide)
        finally:
            for line, before, own in kept:
                _put(signs[(slice(None), *line)], before, engine)
                weight[line] = own

    def _cut(self, guide: NDArray[np.float32]) -> NDArray[np.float32]:
        """A guide with a channel more, across which nothing gets from outside the entries."""
        outside = np.zeros(guide.shape[:2], guide.dtype)
        for side, at in self.entries.items():
            outside[_beyond(side, at)] = _CUT_OFF
        return np.concatenate([guide, outside[..., None]], axis=2)

    def note(
        self,
        signs: Array,
        shares: Array,
        weight: NDArray[np.float32],
        guide: NDArray[np.float32],
        paths: Paths,
        engine: Engine,
    ) -> None:
        """Find what this decision leaves to the neighbours."""
        self.leaving.append(
            {
                side: _leaving(side, at, signs, shares, weight, guide, paths, engine)
                for side, at in self.exits.items()
            }
        )


def _line(side: Side, at: int) -> tuple[slice, slice]:
    """A line of an image, a column or a row by the side that it is counted for."""
    every, one = slice(None), slice(at, at + 1)
    return (every, one) if side in ("left", "right") else (one, every)


def _put(volume: Array, values: NDArray[np.float32], engine: Engine) -> None:
    """Replace a volume by one on the host."""
    engine.put_where(volume, np.ones(values.shape[1:], np.bool_), engine.upload(values))


def _beyond(side: Side, at: int) -> tuple[slice, slice]:
    """What lies nearer to a side of an image than a line."""
    part = slice(0, at) if side in ("left", "top") else slice(at + 1, None)
    return (slice(None), part) if side in ("left", "right") else (part, slice(None))


def _leaving(
    side: Side,
    at: int,
    signs: Array,
    shares: Array,
    weight: NDArray[np.float32],
    guide: NDArray[np.float32],
    paths: Paths,
    engine: Engine,
) -> Costs:
    """Costs of the paths towards a side on a line.

    Of the four paths that `Engine.paths` adds up, one is wanted. On the last line of a volume that ends
    there, the one from the other side is the energy itself, and so are those along the line if changes cost
    nothing between its pixels; these three are taken off again.
    """
    across = side in ("left", "right")
    forth = side in ("right", "bottom")
    behind = slice(max(at + 1 - _REACH, 0), at + 1) if forth else slice(at, at + _REACH)
    last = -1 if forth else 0
    found = []
    for start in range(0, weight.shape[0 if across else 1], _AT_ONCE):
        some = slice(start, start + _AT_ONCE)

        def total(lines: slice, some: slice = some) -> NDArray[np.float32]:
            rows, columns = window = (some, lines) if across else (lines, some)
            volumes = signs[:, rows, columns], shares[:, rows, columns]
            apart = _apart(guide[window], 0 if across else 1)
            summed = engine.download(paths(*volumes, np.ascontiguousarray(weight[window]), apart))
            return np.asarray(summed[:, last] if across else summed[last], np.float32)  # (N, K)

        energy = total(slice(at, at + 1)) / 4  # of one line, all four paths are energies
        costs = total(behind) - 3 * energy
        costs -= costs.min(axis=1, keepdims=True)
        # Engines count whole units and cut off what is beyond: a little more, so that none gets lost.
        found.append((costs + np.float32(0.25) * (costs > 0)).T / np.float32(ENERGY_SCALE))
    return np.ascontiguousarray(np.concatenate(found, axis=1))


def _apart(guide: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """A guide with a channel more, so that along an axis changes cost nothing."""
    steps = np.indices(guide.shape[:2])[axis] % 2 * (2 * _CUT_OFF)
    return np.concatenate([guide, steps[..., None].astype(guide.dtype)], axis=2)
