"""What an EPINET looks like: its layers by name, with sizes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Weights = dict[str, npt.NDArray[np.float32]]
"""Arrays by name, such as "merged.3.first.weight"."""

EPSILON = 1e-3
"""Added to variances in batch normalisation, as Keras does."""


@dataclass(frozen=True)
class EpinetShape:
    """Sizes of an EPINET (Shin et al., CVPR 2018).

    Four streams, one for each stack of views, of `stream_blocks` blocks of `filters` channels; joined,
    `merged_blocks` blocks of four times as many. A block is conv, ReLU, conv, batch normalisation, ReLU. At
    the end conv, ReLU, and conv to one channel. All convolutions are 2x2, with bias, without padding.

    Attributes
    ----------
    filters
        Channels of a stream.
    merged_blocks
        Blocks after the streams are joined.
    stream_blocks
        Blocks of a stream.
    views
        Views along an axis, odd.
    """

    filters: int = 70
    merged_blocks: int = 7
    stream_blocks: int = 3
    views: int = 9

    @property
    def lost(self) -> int:
        """By how much the map is smaller than the views, px; the field of view is one more."""
        return 2 * (self.stream_blocks + self.merged_blocks) + 2

    def blocks(self) -> Iterator[tuple[str, int, int]]:
        """Name, channels in, channels out of every block."""
        for stream in range(4):
            for i in range(self.stream_blocks):
                yield f"stream{stream}.{i}", self.views if i == 0 else self.filters, self.filters
        joined = 4 * self.filters
        for i in range(self.merged_blocks):
            yield f"merged.{i}", joined, joined

    def arrays(self) -> dict[str, tuple[int, ...]]:
        """Shapes of all weights by name; convolutions are (out, in, 2, 2)."""
        found: dict[str, tuple[int, ...]] = {}
        for name, inside, outside in self.blocks():
            found[f"{name}.first.weight"], found[f"{name}.first.bias"] = (outside, inside, 2, 2), (outside,)
            found[f"{name}.second.weight"], found[f"{name}.second.bias"] = (
                (outside, outside, 2, 2),
                (outside,),
            )
            for part in ("weight", "bias", "running_mean", "running_var"):
                found[f"{name}.norm.{part}"] = (outside,)
        joined = 4 * self.filters
        found["last.first.weight"], found["last.first.bias"] = (joined, joined, 2, 2), (joined,)
        found["last.second.weight"], found["last.second.bias"] = (1, joined, 2, 2), (1,)
        return found


EPINETS = {"epinet": EpinetShape(), "epinet-s": EpinetShape(filters=30)}
"""By the name of the method."""
