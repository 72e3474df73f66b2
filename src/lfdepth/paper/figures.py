"""The paper's figures of intermediate results, from one window of a light field.

The paper is Lee et al., "Occlusion Handling by Successively Excluding Foregrounds for Light Field Depth
Estimation Based on Foreground-Background Separation", IEEE Access 2021, DOI 10.1109/ACCESS.2021.3098819.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, reference_index
from lfdepth.pictures import (
    DISPARITY_LABEL,
    Bar,
    Cell,
    Line,
    Pixels,
    compose,
    decision_colours,
    disparity_colours,
    framed,
    slice_colours,
    span,
    view_colours,
)
from lfdepth.scoring.metrics import Array

PLAIN, OCCLUSION = "fbs-sfa", "fbsocc-sfa"
"""The two methods that the paper compares; FBS has the volume of the first."""

RED, GREEN = (214, 40, 40), (30, 160, 60)
_JUMP = 0.2  # px per view step between neighbours; as `near_boundaries`
_MARGIN = 24  # px around a window, so that what is shown is not at the border of what is computed
_BEHIND = 0.12  # where, from background to foreground, the plane of a figure lies: fattening grows backwards


@dataclass(frozen=True)
class Window:
    """Part of a view: its top left pixel and its size in px."""

    x: int
    y: int
    width: int
    height: int

    @property
    def rows(self) -> slice:
        """Rows of an array."""
        return slice(self.y, self.y + self.height)

    @property
    def columns(self) -> slice:
        """Columns of an array."""
        return slice(self.x, self.x + self.width)

    def of(self, image: Array) -> Array:
        """The part of an image (H, W, ...)."""
        part: Array = image[self.rows, self.columns]
        return part


def busiest(weights: Array, size: int) -> Window:
    """The square window of `size` px, or less in a small image, with the largest sum of weights (H, W)."""
    height, width = (min(size, n) for n in weights.shape)
    sums = np.pad(weights.astype(np.float64).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    boxes = sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width] + sums[:-height, :-width]
    y, x = np.unravel_index(int(boxes.argmax()), boxes.shape)
    return Window(int(x), int(y), width, height)


def jumps(disparity: Array) -> Array:
    """Height of the jump from each pixel to its right neighbour, where it is a boundary's; else 0."""
    steps = np.abs(np.diff(disparity.astype(np.float64), axis=1, append=disparity[:, -1:]))
    return np.asarray(np.where(steps > _JUMP, steps, 0.0))


@dataclass(frozen=True, eq=False)
class Study:
    """Both methods' volumes in a window around an occlusion boundary.

    Attributes
    ----------
    views : (V, U, h, w, C) array
        Views of the window with a margin.
    inner : Window
        What is shown of it.
    truth : (h, w) array
        Of the shown part.
    planes : (K,) array
        Disparities, front to back.
    initial, smoothed : mapping of str to (K, h, w) array
        Votes `C` and smoothed votes `C̃` of the shown part, by method.
    maps : mapping of str to (h, w) array
        Disparity of the shown part, by method.
    row : int
        Row in the middle half of the shown part in which FBS decides wrongly most often.
    plane : int
        Index of a plane just before the background of the window's occlusion boundaries.
    skip : int
        The paper's J.
    """

    views: Array
    inner: Window
    truth: Array
    planes: Array
    initial: Mapping[str, Array]
    smoothed: Mapping[str, Array]
    maps: Mapping[str, Array]
    row: int
    plane: int
    skip: int

    @property
    def reference(self) -> Array:
        """The shown part of the reference view."""
        return self.inner.of(self.views[reference_index(self.views.shape[:2])])

    @property
    def disparity(self) -> float:
        """Disparity of the plane."""
        return float(self.planes[self.plane])

    def foreground(self, method: str, plane: int | None = None) -> Array:
        """Where a method decides for foreground: `BW` of a plane."""
        return np.asarray(self.smoothed[method][self.plane if plane is None else plane] > 0)


def study(lf: LightField, *, size: int = 120, threads: int | None = None, **options: Any) -> Study:
    """Run both methods in the window of `size` px with the most and highest occlusion boundaries.

    Options are parameters of the methods, such as ``preset="paper-synthetic"``.

    Raises
    ------
    LightFieldError
        If the light field has no truth, or its truth no boundary.
    """
    from lfdepth.estimation import estimate
    from lfdepth.methods import method
    from lfdepth.trace import Trace

    if lf.truth is None or not jumps(lf.truth).any():
        raise LightFieldError(
            f"{lf.name}: no truth with occlusion boundaries; expected one; choose another scene"
        )
    # The busiest window of half the size lies in the middle of what is shown.
    window = _widened(busiest(jumps(lf.truth), size // 2), size // 4, lf)
    outer = _widened(window, _MARGIN, lf)
    inner = Window(window.x - outer.x, window.y - outer.y, window.width, window.height)
    part = lf.crop(outer.x, outer.y, outer.width, outer.height)
    chosen = {name: method(name, **options) for name in (PLAIN, OCCLUSION)}
    traces = {name: Trace(keep=("votes", "smoothed")) for name in chosen}
    results = {
        name: estimate(part, each, trace=traces[name], threads=threads) for name, each in chosen.items()
    }
    planes = chosen[PLAIN].planes_for(results[PLAIN].range)
    truth = window.of(lf.truth)

    def kept(what: str) -> dict[str, Array]:
        return {
            name: np.stack([inner.of(each) for each in trace.kept[what]]) for name, trace in traces.items()
        }

    smoothed = kept("smoothed")
    return Study(
        views=part.views,
        inner=inner,
        truth=truth,
        planes=planes,
        initial=kept("votes"),
        smoothed=smoothed,
        maps={name: inner.of(each.disparity) for name, each in results.items()},
        row=_telling_row(smoothed[PLAIN], truth, planes),
        plane=_telling_plane(truth, planes),
        skip=chosen[OCCLUSION].parameters()["skip"],
    )


def _widened(window: Window, margin: int, lf: LightField) -> Window:
    """The window with a margin, as far as the views reach."""
    x, y = max(0, window.x - margin), max(0, window.y - margin)
    right = min(lf.width, window.x + window.width + margin)
    bottom = min(lf.height, window.y + window.height + margin)
    return Window(x, y, right - x, bottom - y)


def _telling_plane(truth: Array, planes: Array) -> int:
    """Index of a plane between the two sides of the typical jump, near its background."""
    y, x = jumps(truth).nonzero()
    sides = np.sort([truth[y, x], truth[y, x + 1]], axis=0)
    low, high = np.median(sides, axis=1)
    return int(np.abs(planes - (low + _BEHIND * (high - low))).argmin())


def _telling_row(smoothed: Array, truth: Array, planes: Array) -> int:
    """Row, in the middle half, with the most wrong decisions over all planes."""
    wrong = (smoothed > 0) != (truth > planes[:, None, None])
    quarter = len(truth) // 4
    return quarter + int(wrong.sum(axis=(0, 2))[quarter : -quarter or None].argmax())


# --- figures


def figure2(found: Study) -> Pixels:
    """Foreground fattening: slices of the volume along x and disparity, and along x and y, and the maps.

    White: foreground, black: background, red: where a method decides otherwise than the truth.
    """
    wanted = found.truth > found.planes[:, None, None]
    decided = {
        "truth": wanted,
        "FBS": found.smoothed[PLAIN] > 0,
        "FBSOCC": found.smoothed[OCCLUSION] > 0,
    }
    stretch = max(1, found.truth.shape[1] // len(found.planes))
    along = [
        Cell(
            decision_colours(each[:, found.row], wanted[:, found.row]).repeat(stretch, 0), f"{name}, x and D"
        )
        for name, each in decided.items()
    ]
    across = [
        Cell(_lined(decision_colours(each[found.plane], wanted[found.plane]), found.row), f"{name}, x and y")
        for name, each in decided.items()
    ]
    range = span(found.truth)
    maps = {"truth": found.truth, "FBS": found.maps[PLAIN], "FBSOCC": found.maps[OCCLUSION]}
    disparity = [Cell(disparity_colours(each, range), f"{name}, disparity") for name, each in maps.items()]
    caption = [
        f"Slices of the volume: along the green row, nearest plane on top; D = {_signed(found.disparity)}.",
        "White: foreground, black: background, red: not as in the truth.",
    ]
    bar = Bar("viridis", range, DISPARITY_LABEL)
    return compose([Line(along), Line(across), Line(disparity, bar)], caption)


def _lined(pixels: Pixels, row: int) -> Pixels:
    return framed(pixels, 0, max(0, row - 1), pixels.shape[1], 2, GREEN)


def figure4(found: Study) -> Pixels:
    """One plane through the blocks, without and with the rule against occlusion."""
    before = found.foreground(OCCLUSION, max(0, found.plane - found.skip))
    wanted = found.truth > found.disparity
    votes = found.initial[OCCLUSION][found.plane]
    plain = [
        Cell(view_colours(found.reference), "reference view"),
        Cell(decision_colours(wanted), "truth: foreground"),
        Cell(slice_colours(found.initial[PLAIN][found.plane]), "FBS: votes C"),
        *_smoothed_and_decided(found, PLAIN, "FBS", wanted),
    ]
    occlusion = [
        Cell(decision_colours(before), f"BW of plane k − {found.skip}"),
        Cell(slice_colours(votes, before), "FBSOCC: C of foreground"),
        Cell(slice_colours(votes, ~before), "FBSOCC: C of background"),
        *_smoothed_and_decided(found, OCCLUSION, "FBSOCC", wanted),
    ]
    caption = [
        f"Plane k at D = {_signed(found.disparity)}. Votes: white +1 (nearer than the plane) to black −1 "
        "(farther); "
        "light blue: not concerned; red: not as in the truth."
    ]
    return compose([Line(plain), Line(occlusion)], caption)


def _smoothed_and_decided(found: Study, method: str, name: str, wanted: Array) -> list[Cell]:
    decided = found.foreground(method)
    wrong = 100 * float((decided != wanted).mean())
    return [
        Cell(slice_colours(found.smoothed[method][found.plane]), f"{name}: smoothed"),
        Cell(decision_colours(decided, wanted), f"{name}: decided ({wrong:.1f} % wrong)"),
    ]


def figure5(found: Study) -> Pixels:
    """The 4-D mask: foreground of plane k − J carried to plane k, over views reparameterised to plane k."""
    from lfdepth.blocks.occlusion import mask_4d
    from lfdepth.blocks.reparam import reparameterise

    earlier = max(0, found.plane - found.skip)
    row, column = reference_index(found.views.shape[:2])
    whole = np.zeros(found.views.shape[2:4], np.float32)
    whole[found.inner.rows, found.inner.columns] = found.foreground(OCCLUSION, earlier)
    masks = mask_4d(
        whole, found_at=float(found.planes[earlier]), wanted_at=found.disparity, views=found.views.shape[:2]
    )
    shifted = reparameterise(found.views, found.disparity)
    scale = {"uint8": 1.0, "uint16": 1 / 257}.get(found.views.dtype.name, 255.0)
    lines = []
    for v, u in ((row, column), (0, 0)):  # centre and corner
        view = np.rint(shifted[v, u] * scale).astype(np.uint8)
        place = f"u = {u - column}, v = {v - row}".replace("-", "−")
        cells = [
            (view_colours(found.views[v, u]), f"view {place}"),
            (view_colours(view), "the same at plane k"),
            (slice_colours(2 * masks[v, u] - 1), f"mask of plane k − {found.skip} at plane k"),
            (_overlaid(view, masks[v, u]), "both"),
        ]
        lines.append(Line([Cell(found.inner.of(pixels), title) for pixels, title in cells]))
    caption = [
        f"Plane k at D = {_signed(found.disparity)}. Both: the mask in red, the view in green and blue, "
        "as the paper's figure 5."
    ]
    return compose(lines, caption)


def _overlaid(view: Pixels, mask: Array) -> Pixels:
    grey = np.rint(view.astype(np.float64).mean(axis=2)).astype(np.uint8)
    red = np.rint(255 * mask).astype(np.uint8)
    return np.stack([red, grey, grey], axis=-1)


def figure8(
    reference: Array,
    maps: Mapping[str, Array],
    range: tuple[float, float],
    *,
    apart: tuple[str, str] = (PLAIN, OCCLUSION),
    size: int = 64,
) -> Pixels:
    """Maps of a real scene without truth, and two windows enlarged: those where two maps differ most.

    Parameters
    ----------
    reference : (H, W, C) array
    maps : mapping of str to (H, W) array
        Disparity maps by method.
    range : (float, float)
        Ends of the colour scale.
    apart : (str, str)
        The methods whose maps are compared to choose the windows.
    size : int
        Side of the windows in px.
    """
    first, second = (maps[name].astype(np.float64) for name in apart)
    windows = _apart(np.abs(first - second), size)
    pictures = {"reference view": view_colours(reference)}
    pictures |= {name: disparity_colours(each, range) for name, each in maps.items()}
    bar = Bar("viridis", range, DISPARITY_LABEL)
    whole = [Cell(_marked(pixels, windows), name) for name, pixels in pictures.items()]
    factor = max(1, reference.shape[1] // size)
    lines = [Line(whole, bar)]
    for window, colour in zip(windows, ("red", "green"), strict=True):
        parts = [window.of(pixels).repeat(factor, 0).repeat(factor, 1) for pixels in pictures.values()]
        lines.append(
            Line([Cell(part, f"{colour}: {name}") for part, name in zip(parts, pictures, strict=True)])
        )
    return compose(lines, [f"Red and green: windows in which {apart[0]} and {apart[1]} differ most."])


def _apart(weights: Array, size: int) -> list[Window]:
    """Two windows that do not overlap."""
    first = busiest(weights, size)
    rest = weights.copy()
    rest[
        max(0, first.y - size) : first.y + 2 * size,
        max(0, first.x - size) : first.x + 2 * size,
    ] = 0
    return [first, busiest(rest, size)]


def _marked(pixels: Pixels, windows: Sequence[Window]) -> Pixels:
    for window, colour in zip(windows, (RED, GREEN), strict=False):
        pixels = framed(pixels, window.x, window.y, window.width, window.height, colour)
    return pixels


def range_of(lf: LightField, maps: Mapping[str, Array]) -> tuple[float, float]:
    """Ends of a colour scale: the truth's, else those of the maps without their outermost hundredths."""
    if lf.truth is not None:
        return span(lf.truth)
    values = np.concatenate([each[np.isfinite(each)] for each in maps.values()])
    low, high = np.percentile(values, [1, 99])
    return (float(low), float(high)) if low < high else span(values)


def _signed(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")
