"""EPINET (Shin et al., CVPR 2018): convolutions over four stacks of views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.choosing import REACH, choose
from lfdepth.learned.running import (
    TURNS,
    Turn,
    check_grid,
    confidence,
    enlarged,
    grey_views,
    look_again,
    margin_px,
    network_of,
    predict,
    seen_field,
    stack_views,
)
from lfdepth.learned.shape import EPINETS, EpinetShape
from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Switch, Text, Whole
from lfdepth.trace import Trace

Map = NDArray[np.float32]

_DISAGREEMENT = np.float32(0.05)
"""Deviation between turned maps, px per view step, at which confidence is halved."""

Turns = Annotated[
    int, Whole("Take the mean over so many ways of turning and mirroring the views.", ge=1, le=8)
]
Enlarge = Annotated[
    int,
    Whole(
        "Look again at views enlarged so many times, moved so that disparities lie near 0; 1: look once.",
        ge=1,
        le=3,
    ),
]
Choose = Annotated[
    bool,
    Switch(
        "Let the views choose among the maps of all looks and turns at every pixel, and smooth the choice, "
        "instead of taking the mean."
    ),
]


@dataclass(frozen=True, kw_only=True)
class Epinet(Method):
    """Four streams of convolutions look at the middle row, the middle column and the diagonals of 9x9 views.

    The field of view is 23 px, so disparities beyond 4 px per view step are out of reach.
    docs/learned.md says how it is trained.
    """

    info: ClassVar = MethodInfo(
        name="epinet",
        summary="EPINET, a network over four stacks of views; needs weights (docs/learned.md).",
        reference="10.1109/CVPR.2018.00499",
    )

    weights: Annotated[
        str | None,
        Text(
            "File of weights, .npz as lfdepth train writes it or .onnx.",
            without="those of the package, if any",
        ),
    ] = None
    turns: Turns = 4
    enlarge: Enlarge = 1
    choose: Choose = False
    tile: Annotated[
        int,
        Whole("Side of the tiles that are computed at a time.", ge=16, le=2048, unit="px"),
    ] = 256

    @property
    def sizes(self) -> EpinetShape:
        """Sizes of the network."""
        return EPINETS[self.info.name]

    def check(self, shape: Shape) -> None:
        """It takes nine views along either axis, and weights that fit."""
        check_grid(self.name, (shape[0], shape[1]), self.sizes.views)
        network_of(self.name, self.weights)

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Grey views of the stacks, once more enlarged or in colour, and three layers of a tile."""
        side, channels = self.tile + self.sizes.lost, 4 * self.sizes.filters
        views, size = 4 * self.sizes.views, shape[2] * shape[3]
        larger = 0
        if self.enlarge > 1:
            around = 2 * margin_px(self.sizes, self.enlarge)
            larger = self.enlarge**2 * (shape[2] + around) * (shape[3] + around)
        colours = shape[4] * views * size if self.choose else 0
        samples = views * size + max((views + 4) * larger, colours)
        return 4 * (samples + 3 * channels * side * side)

    def halo(self) -> int:
        """Half of the field of view, of what is looked at to move views, and of what the choice looks at."""
        again = seen_field(self.sizes, self.enlarge) // 2 if self.enlarge > 1 else 0
        return self.sizes.lost // 2 + again + (REACH if self.choose else 0)

    def run(self, problem: Problem, work: Work) -> Maps:
        """Views to stacks, tiles through the network, once more on enlarged views, and one map of all.

        The second look takes half as many turns, as it takes several times as long.
        """
        lf, trace = problem.lf, work.trace
        again = TURNS[: (self.turns + 1) // 2] if self.enlarge > 1 else ()
        trace.steps(self.turns + len(again) + self.choose)
        with trace.block("preparation"):
            network = network_of(self.name, self.weights)
            grey = grey_views(lf, stack_views(self.sizes.views))
        first = _every(
            TURNS[: self.turns], lambda turn: predict(network, grey, self.sizes, turn, self.tile), trace
        )
        found = _with_mean(first)
        if again:
            with trace.block("preparation"):
                seen = enlarged(grey, found[-1], self.sizes, self.enlarge)
            second = _every(again, lambda turn: look_again(network, seen, self.sizes, turn, self.tile), trace)
            found = found + _with_mean(second)
            del seen  # larger than what the choice needs
        disparity = found[-1]
        if self.choose:
            with trace.block("choice"):
                disparity = choose(lf, found, list(grey), engine=work.engine)
            trace.step("choice")
        with trace.block("confidence"):
            sure = confidence(grey, disparity, self.sizes.views)
            spread = np.std(first, axis=0, dtype=np.float32)
        return Maps(disparity, np.asarray(sure / (1 + spread / _DISAGREEMENT), np.float32))


def _every(turns: Sequence[Turn], look: Callable[[Turn], Map], trace: Trace) -> list[Map]:
    """What a look finds with views turned in each of several ways."""
    found = []
    for turn in turns:
        with trace.block("network"):
            found.append(look(turn))
        trace.step("network")
    return found


def _with_mean(maps: list[Map]) -> list[Map]:
    """Some maps, and last their mean; one alone is its own."""
    return [*maps, np.asarray(np.mean(maps, axis=0), np.float32)] if len(maps) > 1 else maps


@dataclass(frozen=True, kw_only=True)
class EpinetS(Epinet):
    """EPINET with 30 filters instead of 70; its weights come with the package.

    The field of view is 23 px, so disparities beyond 4 px per view step are out of reach.
    docs/learned.md says how it was trained.
    """

    info: ClassVar = MethodInfo(
        name="epinet-s",
        summary="EPINET with 30 filters, trained on procedural scenes alone (docs/learned.md).",
        reference="docs/learned.md",
    )

    turns: Turns = 2
    enlarge: Enlarge = 2
    choose: Choose = True
