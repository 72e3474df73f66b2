"""Two kinds of chart as SVG text, small enough for a page that must stay small: lines, and points.

Text stays text, so that it can be searched and read aloud; every mark has its name as a tooltip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

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


def line_chart(curves: Sequence[Curve], x: Axis, y: Axis, size: tuple[int, int] = (360, 240)) -> str:
    """SVG of some curves."""
    frame = _Frame(x, y, size)
    marks = [
        f'<polyline fill="none" stroke="{curve.colour}" stroke-width="1.6"'
        f' stroke-dasharray="{"4 3" if curve.dashed else "none"}" points="{frame.path(curve)}">'
        f"<title>{escape(curve.name)}</title></polyline>"
        for curve in curves
    ]
    return frame.svg(marks)


def point_chart(points: Sequence[Point], x: Axis, y: Axis, size: tuple[int, int] = (720, 380)) -> str:
    """SVG of some points, each with its name."""
    frame = _Frame(x, y, size)
    marks, names = [], []
    heights = _apart([frame.y(point.y) for point in points])
    for point, label_y in zip(points, heights, strict=True):
        px, py = frame.x(point.x), frame.y(point.y)
        fill = "white" if point.hollow else point.colour
        left = px > size[0] * 0.75  # towards the right edge the name goes to the left
        text_x, anchor = (px - 9, "end") if left else (px + 9, "start")
        marks.append(
            f'<circle cx="{px:.1f}" cy="{py:.1f}" r="5" fill="{fill}" stroke="{point.colour}" '
            'stroke-width="2">'
            f"<title>{escape(point.name)}: {point.x:.3g}, {point.y:.3g}</title></circle>"
        )
        names.append(
            f'<text class="name" x="{text_x:.1f}" y="{label_y + 4:.1f}" text-anchor="{anchor}">'
            f"{escape(point.name)}</text>"
        )
    return frame.svg([*marks, *names])  # names on top, or neighbouring points would cover them


def _apart(heights: Sequence[float], gap: float = 13.0) -> list[float]:
    """Heights moved down where they would otherwise lie on each other."""
    moved = list(heights)
    order = sorted(range(len(moved)), key=lambda i: moved[i])
    for before, after in pairwise(order):
        moved[after] = max(moved[after], moved[before] + gap)
    return moved


class _Frame:
    """Axes and the way from values to px."""

    def __init__(self, x: Axis, y: Axis, size: tuple[int, int]) -> None:
        self.axes, self.size = (x, y), size
        self.width, self.height = size[0] - _LEFT - _RIGHT, size[1] - _TOP - _BOTTOM

    def x(self, value: float) -> float:
        return _LEFT + self.width * self.axes[0].place(value)

    def y(self, value: float) -> float:
        return _TOP + self.height * (1 - self.axes[1].place(value))

    def path(self, curve: Curve) -> str:
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(curve.x, curve.y, strict=True))

    def svg(self, marks: Sequence[str]) -> str:
        width, height = self.size
        return "".join(
            [
                f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img">',
                *self._grid(),
                *marks,
                "</svg>",
            ]
        )

    def _grid(self) -> list[str]:
        right, bottom = _LEFT + self.width, _TOP + self.height
        parts = []
        for value in self.axes[0].ticks():
            px = self.x(value)
            parts.append(f'<path class="grid" d="M{px:.1f} {_TOP}V{bottom}"/>')
            parts.append(f'<text x="{px:.1f}" y="{bottom + 15}" text-anchor="middle">{value:g}</text>')
        for value in self.axes[1].ticks():
            py = self.y(value)
            parts.append(f'<path class="grid" d="M{_LEFT} {py:.1f}H{right}"/>')
            parts.append(f'<text x="{_LEFT - 6}" y="{py + 4:.1f}" text-anchor="end">{value:g}</text>')
        middle_x, middle_y = _LEFT + self.width / 2, _TOP + self.height / 2
        x, y = (escape(axis.label) for axis in self.axes)
        parts.append(f'<text x="{middle_x:.0f}" y="{bottom + 33}" text-anchor="middle">{x}</text>')
        turned = f'transform="translate(13 {middle_y:.0f}) rotate(-90)"'
        parts.append(f'<text {turned} text-anchor="middle">{y}</text>')
        return parts
