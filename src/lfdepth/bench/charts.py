"""Two kinds of chart as SVG text, small enough for a page that must stay small: lines, and points.

Text stays text, so that it can be searched and read aloud; every mark has its name as a tooltip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from lfdepth.templating import render

if TYPE_CHECKING:
    from markupsafe import Markup

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#444444")
"""Colours that stay apart for colour-blind readers (Okabe and Ito), in the order of the methods."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 10, 40  # px around the plot


@dataclass(frozen=True, eq=False)
class Curve:
    """A line through points; dashed for a reference."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Point:
    """A point with its name beside it; hollow where it was not measured here."""

    name: str
    x: float
    y: float
    colour: str
    hollow: bool = False


@dataclass(frozen=True)
class Axis:
    """An axis from `low` to `high`; a logarithmic one needs `low` > 0."""

    label: str
    low: float
    high: float
    log: bool = False

    def place(self, value: float) -> float:
        """Position of a value, 0 at the low end and 1 at the high end."""
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """Round values on the axis."""
        if self.log:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            steps = (1, 2, 5) if len(decades) < 5 else (1,)
            values = [step * 10.0**power for power in decades for step in steps]
            return [value for value in values if self.low <= value <= self.high]
        step = 10.0 ** math.floor(math.log10((self.high - self.low) / 4))
        step *= next(each for each in (1, 2, 5, 10) if (self.high - self.low) / (step * each) <= 6)
        first = math.ceil(self.low / step)
        return [round(n * step, 10) for n in range(first, math.floor(self.high / step + 1e-9) + 1)]


def line_chart(curves: Sequence[Curve], x: Axis, y: Axis, size: tuple[int, int] = (360, 240)) -> Markup:
    """SVG of some curves."""
    frame = _Frame(x, y, size)
    return render("chart.svg", frame=frame, curves=[(each, frame.path(each)) for each in curves], points=())


def point_chart(points: Sequence[Point], x: Axis, y: Axis, size: tuple[int, int] = (720, 380)) -> Markup:
    """SVG of some points, each with its name."""
    frame = _Frame(x, y, size)
    heights = _apart([frame.y(point.y) for point in points])
    placed = [_Placed.of(point, frame, height) for point, height in zip(points, heights, strict=True)]
    return render("chart.svg", frame=frame, curves=(), points=placed)


@dataclass(frozen=True)
class _Placed:
    """A point at its place, px, and that of its name."""

    point: Point
    x: float
    y: float
    text_x: float
    text_y: float
    anchor: str

    @classmethod
    def of(cls, point: Point, frame: _Frame, label_y: float) -> _Placed:
        x, y = frame.x(point.x), frame.y(point.y)
        left = x > frame.size[0] * 0.75  # towards the right edge the name goes to the left
        text_x, anchor = (x - 9, "end") if left else (x + 9, "start")
        return cls(point, x, y, text_x, label_y + 4, anchor)


def _apart(heights: Sequence[float], gap: float = 13.0) -> list[float]:
    """Heights moved down where they would otherwise lie on each other."""
    moved = list(heights)
    order = sorted(range(len(moved)), key=lambda i: moved[i])
    for before, after in pairwise(order):
        moved[after] = max(moved[after], moved[before] + gap)
    return moved


class _Frame:
    """Axes and the way from values to px."""

    left, top = _LEFT, _TOP

    def __init__(self, x: Axis, y: Axis, size: tuple[int, int]) -> None:
        self.x_axis, self.y_axis, self.size = x, y, size
        self.right, self.bottom = size[0] - _RIGHT, size[1] - _BOTTOM

    def x(self, value: float) -> float:
        return _LEFT + (self.right - _LEFT) * self.x_axis.place(value)

    def y(self, value: float) -> float:
        return _TOP + (self.bottom - _TOP) * (1 - self.y_axis.place(value))

    def path(self, curve: Curve) -> str:
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(curve.x, curve.y, strict=True))

    @property
    def ticks(self) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
        """Texts and places of the ticks of either axis."""
        return (
            [(f"{value:g}", self.x(value)) for value in self.x_axis.ticks()],
            [(f"{value:g}", self.y(value)) for value in self.y_axis.ticks()],
        )
