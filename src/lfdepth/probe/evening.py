"""Shrunk views made as bright as the reference view, before anything is known of how they are ordered."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfdepth.probe.matching import Match, Order, Probe

Array = NDArray[np.float64]

# Pixels that are compared, at most and at least; rounds of fitting; error of a pixel, grey levels.
_PIXELS, _FEWEST, _ROUNDS, _ERROR = 3000, 60, 4, 2.0
# Standard deviation of the levels below which gain and offset are not told apart; what a factor may be.
_FAINT = 5.0
_LEAST, _MOST = 0.1, 10.0


@dataclass(frozen=True, eq=False)
class Shades:
    """How bright views are beside the reference view.

    Attributes
    ----------
    terms
        (N, 4) factors of 1, x, y and x² + y², where x and y go from −1 to 1 over the picture.
    lines
        (N, 2) gain and offset, in grey levels, of what is left once these are divided out.
    """

    terms: Array
    lines: Array

    def evened(self, probe: Probe) -> Probe:
        """The same views, as bright as the reference view."""
        height, width = probe.reference.shape
        y = np.linspace(-1, 1, height)[:, None]
        x = (np.arange(-probe.margin, width + probe.margin) / max(width - 1, 1) * 2 - 1)[None].clip(-1, 1)
        views = np.empty_like(probe.views)
        for view, terms, (gain, offset), evened in zip(
            probe.views, self.terms, self.lines, views, strict=True
        ):
            factor = terms[0] + terms[1] * x + terms[2] * y + terms[3] * (x * x + y * y)
            np.divide(view, np.clip(factor, _LEAST, _MOST).astype(np.float32), out=evened)
            evened -= np.float32(offset)
            evened /= np.float32(gain)
        return replace(probe, views=views)


def measure_shades(probe: Probe, found: Match, order: Order) -> Shades:
    """Compare grey views with the reference view where both show the same surface.

    Parameters
    ----------
    probe
        Grey views.
    found
        What was found in the same views, shrunk alike, by local contrast.
    order
        How the grid is taken.
    """
    height, width = probe.reference.shape
    places = np.argwhere(found.coherent(0.5 * probe.unit, 3))
    places = places[:: max(1, -(-len(places) // _PIXELS))]
    at = tuple(places.T)
    level, moved = probe.reference[at].astype(np.float64), found.disparity[at] / probe.shrink
    terms, lines = np.tile([1.0, 0, 0, 0], (len(probe.views), 1)), np.tile([1.0, 0], (len(probe.views), 1))
    for view, (step, picture) in enumerate(zip(probe.ordered(order), probe.views, strict=True)):
        target = np.rint(places - moved[:, None] * step).astype(np.intp)
        inside = ((target >= 0) & (target < [height, width])).all(axis=1)
        if np.count_nonzero(inside) < _FEWEST:
            continue
        y, x = target[inside].T
        shown = picture[y, x + probe.margin].astype(np.float64)
        x, y = 2 * x / max(width - 1, 1) - 1, 2 * y / max(height - 1, 1) - 1
        terms[view], lines[view] = _fitted(x, y, level[inside], shown)
    return Shades(terms, lines)


def _fitted(x: Array, y: Array, level: Array, shown: Array) -> tuple[Array, tuple[float, float]]:
    """Terms by robust least squares, then gain and offset from deviations, which noise changes alike."""
    shape = np.stack([np.ones_like(x), x, y, x * x + y * y], axis=1)
    design = shape * level[:, None]
    # as much weight as that of 2 % of the pixels says that nothing differs over the picture
    prior = np.diag([1e-9, 1, 1, 1]) * float((level**2).sum()) * 0.02
    weight = np.ones_like(level)
    for _ in range(_ROUNDS):
        weighted = design * weight[:, None]
        terms = np.linalg.solve(weighted.T @ design + prior, weighted.T @ shown)
        rest = shown / np.clip(shape @ terms, _LEAST, _MOST)
        (mean, spread), (own, usual) = (_moments(values, weight) for values in (rest, level))
        gain = float(np.clip(spread / max(usual, 1e-6), _LEAST, _MOST)) if usual > _FAINT else 1.0
        error = np.abs(rest - mean - gain * (level - own))
        scale = max(1.5 * float(np.median(error)), _ERROR)
        weight = 1 / (1 + (error / (2 * scale)) ** 2) ** 2
    return np.asarray(terms, np.float64), (gain, mean - gain * own)


def _moments(values: Array, weight: Array) -> tuple[float, float]:
    """Weighted mean and standard deviation."""
    mean = float((weight * values).sum() / weight.sum())
    return mean, float(np.sqrt((weight * (values - mean) ** 2).sum() / weight.sum()))
