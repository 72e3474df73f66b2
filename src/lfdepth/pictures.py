"""Pictures of maps: colour-mapped previews, signed errors, comparisons, as PNG.

Text and scale bars are drawn by matplotlib, without its global state; the maps themselves are pasted into the
finished canvas, so no resampling touches them. Maps narrower than 300 px are enlarged by a whole factor.

Colours: viridis for values; for signed errors red = too near, blue = too far; grey where there is no value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.io.pixels import write_picture

Array = NDArray[Any]
Pixels = NDArray[np.uint8]
Range = tuple[float, float]

DISPARITY_LABEL = "disparity (px per view step)"
ERROR_LABEL = "estimate − truth (px per view step)"
ERROR_LIMIT = 0.3
"""Errors in px per view step beyond which the colours no longer change."""

_VALUES, _SIGNED = "viridis", "RdBu_r"
_NO_VALUE = (160, 160, 160)
_NOT_CONCERNED, _WRONG = (190, 208, 228), (214, 40, 40)
_DPI = 128  # a power of two, so that whole pixels survive the way through matplotlib's inches
_MARGIN, _GAP, _BAR = 10, 10, 16  # px
_SMALLEST = 300  # px
_SMALLEST_TEXT, _LARGEST_TEXT = 14, 18  # px


# --- arrays to colours


def disparity_colours(values: Array, range: Range | None = None) -> Pixels:
    """Colours (H, W, 3) uint8 of a map (H, W), from the low (dark) to the high (bright) end of the range."""
    return _colours(values, range or span(values), _VALUES)


def error_colours(estimate: Array, truth: Array, limit: float = ERROR_LIMIT) -> Pixels:
    """Colours (H, W, 3) uint8 of the signed error: red = too near, blue = too far, white = right."""
    _check_alike(estimate, truth)
    return _colours(estimate.astype(np.float64) - truth, (-limit, limit), _SIGNED)


def difference_colours(a: Array, b: Array, truth: Array, limit: float = ERROR_LIMIT) -> Pixels:
    """Colours (H, W, 3) uint8 of ``|a − truth| − |b − truth|``: blue = `a` is better, red = `b` is better."""
    for each in (a, b):
        _check_alike(each, truth)
    wanted = truth.astype(np.float64)
    return _colours(np.abs(a - wanted) - np.abs(b - wanted), (-limit, limit), _SIGNED)


def view_colours(view: Array) -> Pixels:
    """Colours (H, W, 3) uint8 of a view (H, W, C), C = 1 or 3, in uint8, uint16 or float32 up to 1."""
    scale = {"uint8": 1.0, "uint16": 1 / 257}.get(view.dtype.name, 255.0)
    eight_bit = view if view.dtype == np.uint8 else np.rint(view * scale).clip(0, 255).astype(np.uint8)
    return np.broadcast_to(eight_bit, (*view.shape[:2], 3))


def slice_colours(values: Array, where: Array | None = None) -> Pixels:
    """Colours (H, W, 3) uint8 of votes (H, W) from −1 (black) to 1 (white); light blue outside `where`."""
    colours = np.repeat(np.rint((np.clip(values, -1, 1) + 1) * 127.5).astype(np.uint8)[..., None], 3, axis=2)
    if where is not None:
        colours[~where] = _NOT_CONCERNED
    return colours


def decision_colours(foreground: Array, truth: Array | None = None) -> Pixels:
    """Colours (H, W, 3) uint8 of a foreground map (H, W) bool, white on black; errors to the truth in red."""
    colours = slice_colours(np.where(foreground, 1.0, -1.0))
    if truth is not None:
        colours[foreground != truth] = _WRONG
    return colours


def framed(pixels: Pixels, x: int, y: int, width: int, height: int, colour: tuple[int, int, int]) -> Pixels:
    """Copy of a picture with a frame, 2 px thick, around the window whose top left pixel is (x, y)."""
    copy = pixels.copy()
    window = copy[y : y + height, x : x + width]
    for edge in (window[:2], window[-2:], window[:, :2], window[:, -2:]):
        edge[...] = colour
    return copy


def span(*maps: Array) -> Range:
    """Smallest and largest finite value of some maps; a range of 1 around a constant."""
    finite = [each[np.isfinite(each)] for each in maps]
    low = min((float(each.min()) for each in finite if each.size), default=0.0)
    high = max((float(each.max()) for each in finite if each.size), default=0.0)
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def _colours(values: Array, range: Range, name: str) -> Pixels:
    from matplotlib import colormaps

    low, high = range
    if not low < high:
        raise LightFieldError(f"range: {low:g} to {high:g}; expected MIN < MAX; swap or widen the ends")
    scaled = (values.astype(np.float64) - low) / (high - low)
    colours: Pixels = np.array(colormaps[name](scaled, bytes=True)[..., :3])
    colours[~np.isfinite(values)] = _NO_VALUE
    return colours


def _check_alike(estimate: Array, truth: Array) -> None:
    if estimate.shape != truth.shape or truth.ndim != 2:
        raise LightFieldError(
            f"estimate: shape {estimate.shape}; expected {truth.shape} like the truth, (H, W); bring both to "
            "the same size"
        )


# --- pictures of one map


def preview(
    disparity: Array,
    path: Path | str,
    *,
    range: Range | None = None,
    label: str = DISPARITY_LABEL,
    title: str | None = None,
) -> None:
    """Write a colour-mapped map with a scale bar.

    Parameters
    ----------
    disparity : (H, W) array
        Any map; values that are not finite come out grey.
    path : path
        PNG file.
    range : (float, float), optional
        Values at the two ends of the scale; those of the map by default.
    label : str
        Beside the scale bar: quantity and unit.
    title : str, optional

    Raises
    ------
    LightFieldError
        If the map is not two-dimensional, the range empty, or the file cannot be written.
    """
    _check_alike(disparity, disparity)
    range = range or span(disparity)
    cell = Cell(disparity_colours(disparity, range), title or "")
    write_picture(path, compose([Line([cell], Bar(_VALUES, range, label))]))


def error_map(
    disparity: Array,
    truth: Array,
    path: Path | str,
    *,
    limit: float = ERROR_LIMIT,
    title: str | None = None,
    caption: Sequence[str] = (),
) -> None:
    """Write the signed error ``estimate − truth``: red = too near, blue = too far.

    Parameters
    ----------
    disparity, truth : (H, W) array
        Px per view step.
    path : path
        PNG file.
    limit : float
        Errors beyond ± this have the colour of the end of the scale.
    title : str, optional
    caption : sequence of str
        Lines below the picture, such as the scores (`lfdepth.scoring.captions`), above that on the colours.

    Raises
    ------
    LightFieldError
        If the sizes differ or the file cannot be written.
    """
    cell = Cell(error_colours(disparity, truth, limit), title or "")
    legend = "red: too near, blue: too far" + ("" if np.isfinite(disparity).all() else ", grey: no value")
    write_picture(path, compose([Line([cell], _error_bar(limit))], [*caption, legend]))


def difference_map(
    a: Array,
    b: Array,
    truth: Array,
    path: Path | str,
    *,
    names: tuple[str, str] = ("a", "b"),
    limit: float = ERROR_LIMIT,
    title: str | None = None,
) -> None:
    """Write ``|a − truth| − |b − truth|``: blue where `a` is better, red where `b` is (the paper's figure 7).

    Parameters
    ----------
    a, b, truth : (H, W) array
        Px per view step.
    path : path
        PNG file.
    names : (str, str)
        What `a` and `b` are called in the caption.
    limit : float
        Differences beyond ± this have the colour of the end of the scale.
    title : str, optional

    Raises
    ------
    LightFieldError
        If the sizes differ or the file cannot be written.

    References
    ----------
    Figure 7 of Lee et al., IEEE Access 2021, DOI 10.1109/ACCESS.2021.3098819.
    """
    cell = Cell(difference_colours(a, b, truth, limit), title or "")
    bar = Bar(_SIGNED, (-limit, limit), "difference of |error| (px per view step)", open_ends=True)
    caption = [f"blue: {names[0]} is better, red: {names[1]} is better"]
    write_picture(path, compose([Line([cell], bar)], caption))


# --- panels


@dataclass(frozen=True, eq=False)
class PanelRow:
    """One scene of a `panel`.

    Attributes
    ----------
    reference : (H, W, C) array
        The reference view.
    maps : mapping of str to (H, W) array
        Disparity maps by name of the method.
    truth : (H, W) array, optional
        Without it there are no errors to show.
    name : str
        Name of the scene.
    range : (float, float), optional
        Ends of the colour scale; those of the truth, else of the maps, by default.
    captions : mapping of str to str
        What stands above the errors of a method's map, such as its scores (`lfdepth.scoring.captions`).
    """

    reference: Array
    maps: Mapping[str, Array]
    truth: Array | None = None
    name: str = ""
    range: Range | None = None
    captions: Mapping[str, str] = field(default_factory=dict)


def panel(*rows: PanelRow, path: Path | str, limit: float = ERROR_LIMIT) -> None:
    """Write one picture that compares methods: per scene a line of maps and a line of signed errors.

    The first line has the reference view and each method's map, the second the truth and each map's error
    with its caption.

    Parameters
    ----------
    *rows : PanelRow
        The scenes.
    path : path
        PNG file.
    limit : float
        Errors beyond ± this have the colour of the end of the scale.

    Raises
    ------
    LightFieldError
        If there is no scene, sizes differ, or the file cannot be written.
    """
    if not rows:
        raise LightFieldError("panel: no scene; expected at least one PanelRow; give one")
    write_picture(path, compose([line for row in rows for line in _panel_lines(row, limit)]))


def _panel_lines(row: PanelRow, limit: float) -> list[Line]:
    range = row.range or span(*([row.truth] if row.truth is not None else row.maps.values()))
    reference = Cell(view_colours(row.reference), " – ".join(filter(None, [row.name, "reference view"])))
    maps = [Cell(disparity_colours(each, range), name) for name, each in row.maps.items()]
    lines = [Line([reference, *maps], Bar(_VALUES, range, DISPARITY_LABEL))]
    if row.truth is not None:
        errors = [
            Cell(error_colours(each, row.truth, limit), row.captions.get(name, ""))
            for name, each in row.maps.items()
        ]
        truth = Cell(disparity_colours(row.truth, range), "truth")
        lines.append(Line([truth, *errors], _error_bar(limit)))
    return lines


# --- composition: lines of pictures, each line with a scale bar


@dataclass(frozen=True, eq=False)
class Cell:
    """A picture (H, W, 3) uint8 with a title above it."""

    pixels: Pixels
    title: str = ""


@dataclass(frozen=True)
class Bar:
    """A scale bar; with `open_ends`, values beyond its ends have the colours of the ends."""

    colours: str
    range: Range
    label: str
    open_ends: bool = False


@dataclass(frozen=True, eq=False)
class Line:
    """Pictures side by side, and the scale bar at their right."""

    cells: Sequence[Cell]
    bar: Bar | None = None


@dataclass(eq=False)
class _Canvas:
    """A figure in px from the top left corner; pictures are pasted after the text is drawn."""

    width: int
    height: int
    text_size: int
    pasted: list[tuple[Pixels, int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(self.width / _DPI, self.height / _DPI), dpi=_DPI, facecolor="white")

    def paste(self, pixels: Pixels, x: int, y: int) -> None:
        self.pasted.append((pixels, x, y))

    def text(self, x: float, y: float, words: str, **style: Any) -> None:
        size = self.text_size * 72 / _DPI
        self.figure.text(
            x / self.width, 1 - y / self.height, words, va="center", fontsize=size, parse_math=False, **style
        )

    def bar(self, bar: Bar, x: int, y: int, height: int) -> None:
        low, high = bar.range
        self.paste(_bar_pixels(bar, height), x, y)
        for value, words in _ticks(bar):
            self.text(x + _BAR + 6, y + height * (high - value) / (high - low), words)
        centre = x + _bar_width(bar, self.text_size) - self.text_size / 2
        self.text(centre, y + height / 2, bar.label, ha="center", rotation=90)

    def render(self) -> Pixels:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        pixels: Pixels = np.array(canvas.buffer_rgba())[..., :3]
        for picture, x, y in self.pasted:
            pixels[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
        return pixels


def compose(lines: Sequence[Line], caption: Sequence[str] = ()) -> Pixels:
    """Put lines of pictures, one below the other, over a caption: one picture (H, W, 3) uint8."""
    lines = [Line([_enlarged(cell) for cell in line.cells], line.bar) for line in lines]
    narrowest = min(cell.pixels.shape[1] for line in lines for cell in line.cells)
    text_size = min(max(narrowest // 28, _SMALLEST_TEXT), _LARGEST_TEXT)
    leading = text_size * 3 // 2
    width = 2 * _MARGIN + max(_line_width(line, text_size) for line in lines)
    height = _MARGIN + sum(_line_height(line, leading) for line in lines) + leading * len(caption)
    canvas = _Canvas(width, height, text_size)
    y = _MARGIN
    for line in lines:
        _draw_line(canvas, line, y, leading)
        y += _line_height(line, leading)
    for number, words in enumerate(caption):
        canvas.text(_MARGIN, y + leading * (number + 0.5) - 4, words)
    return canvas.render()


def _draw_line(canvas: _Canvas, line: Line, y: int, leading: int) -> None:
    top = y + _title_height(line, leading)
    x = _MARGIN
    for cell in line.cells:
        canvas.text(x, y + leading / 2 - 2, cell.title)
        canvas.paste(cell.pixels, x, top)
        x += cell.pixels.shape[1] + _GAP
    if line.bar:
        canvas.bar(line.bar, x, top, max(cell.pixels.shape[0] for cell in line.cells))


def _line_width(line: Line, text_size: int) -> int:
    pictures = sum(int(cell.pixels.shape[1]) + _GAP for cell in line.cells)
    return pictures + _bar_width(line.bar, text_size) if line.bar else pictures - _GAP


def _bar_width(bar: Bar, text_size: int) -> int:
    """Width of a scale bar with its numbers and its label."""
    digits = max((len(words) for _, words in _ticks(bar)), default=0)
    return _BAR + 6 + int(0.62 * text_size * digits) + 12 + text_size


def _line_height(line: Line, leading: int) -> int:
    return _title_height(line, leading) + max(int(cell.pixels.shape[0]) for cell in line.cells) + _GAP


def _title_height(line: Line, leading: int) -> int:
    return leading if any(cell.title for cell in line.cells) else 0


def _enlarged(cell: Cell) -> Cell:
    factor = max(1, -(-_SMALLEST // int(cell.pixels.shape[1])))
    return Cell(cell.pixels.repeat(factor, axis=0).repeat(factor, axis=1), cell.title)


def _error_bar(limit: float) -> Bar:
    return Bar(_SIGNED, (-limit, limit), ERROR_LABEL, open_ends=True)


def _bar_pixels(bar: Bar, height: int) -> Pixels:
    column = np.linspace(1.0, 0.0, height)[:, None]
    return _colours(np.broadcast_to(column, (height, _BAR)), (0.0, 1.0), bar.colours)


def _ticks(bar: Bar) -> list[tuple[float, str]]:
    from matplotlib.ticker import MaxNLocator

    low, high = bar.range
    ticks = []
    for each in MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high):
        value = round(float(each), 10)  # 3 · 0.1 is not 0.3, and the ends of the range must be found again
        end = {low: "≤ ", high: "≥ "}.get(value, "") if bar.open_ends else ""
        if low <= value <= high:
            ticks.append((value, end + f"{value:g}".replace("-", "−")))
    return ticks
