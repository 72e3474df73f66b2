"""Oracle of the sign votes' say on faint surfaces: one pixel at a time, straight from the definition."""

from __future__ import annotations

import numpy as np

import fields
import naive_refine

Array = fields.Array


def hidden(disparity: Array, reach: float) -> Array:
    """Whether any nearer surface, by over 0.12 px, lies less than reach·Δ + 7 px away along both axes."""
    out = np.zeros(disparity.shape, bool)
    places = np.argwhere(np.isfinite(disparity))
    for y, x in places:
        away = abs(places - (y, x)).max(axis=1)
        nearer = disparity.ravel() - disparity[y, x]
        out[y, x] = np.any((nearer > 0.12) & (reach * nearer > away - 7))
    return out


def beside_jumps(disparity: Array) -> Array:
    """Up to 2 px beside an edge."""
    once = naive_refine.near_jumps(disparity, 0.15)
    out = np.zeros_like(once)
    for y, x in np.argwhere(once):
        out[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] = True
    return out


def asked(signs: Array, planes: Array, disparity: Array, photo: Array, reach: float) -> tuple[Array, Array]:
    """Step and information: parabolas through three planes 0.28 px apart, their mean with σ = 6 px."""
    step = planes[0] - planes[1]
    span = max(round(0.28 / step), 1)
    own, information = (np.zeros(disparity.shape) for _ in "12")
    silent = hidden(disparity, reach) | beside_jumps(disparity)
    for y, x in np.argwhere(~silent):
        k = int(np.clip(np.argmin(abs(planes - disparity[y, x])), span, len(planes) - 1 - span))
        chosen = [k - span, k, k + span]
        bend, slope, _ = np.polyfit(planes[chosen] - disparity[y, x], signs[chosen, y, x], 2)
        if bend <= 0:
            continue
        own[y, x] = np.clip(-slope / (2 * bend), -0.3, 0.3)
        say = np.clip((0.9 - photo[y, x]) / 0.5, 0, 1)
        information[y, x] = 500 * say * bend / (bend + 0.05)
    total = naive_refine.blurred(information, 6.0)
    mean = naive_refine.blurred(own * information, 6.0) / np.maximum(total, 1e-9)
    return np.where(information > 0, mean, 0), information
