"""Oracle of `lfdepth.blocks.edge_net`: pixel by pixel, in loops and double precision."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lfdepth.blocks.edges import EdgeRule
from naive_vis import (
    PARTS,
    Array,
    edge_pixels,
    front_colour,
    full_scale,
    other_views,
    reference,
    samples_at,
    splat,
    surfaces,
    thresholds,
)

JUMP, CLEARLY_NEAR, CLEARLY_FAR = 0.15, 1.0, 2.5


class Seen(NamedTuple):
    """What views show at a pixel: colours in 8-bit levels, variances, None without a front, and counts."""

    front: Array
    back: Array
    front_variance: float | None
    back_variance: float
    counts: list[int]


class Told(NamedTuple):
    """Share of the foreground as far as it is sure, and what the network is told of the pixel alone."""

    share: float
    numbers: list[float]


def edge_colours(disparity: Array, views: Array, present: Array | None = None) -> dict[tuple[int, int], Seen]:
    """For every pixel beside a depth edge."""
    levels = views.astype(np.float64) * (255 / full_scale(views))
    nearest, limits = splat(disparity, (views.shape[0], views.shape[1])), thresholds(views)
    found = {}
    for y, x in np.argwhere(edge_pixels(disparity, EdgeRule(jump=JUMP))).tolist():
        found[y, x] = look(disparity, levels, present, nearest, 255 * float(limits[y, x]), y, x)
    return found


def look(
    disparity: Array, levels: Array, present: Array | None, nearest: Array, limit: float, y: int, x: int
) -> Seen:
    image = reference(levels)
    near, far = surfaces(disparity, y, x)
    behind = {view: (at, colour) for view, at, colour in samples_at(levels, present, y, x, far)}
    ahead = {view: colour for view, _, colour in samples_at(levels, present, y, x, near)}
    past = [
        view
        for view, (at, _) in behind.items()
        if nearest[*view, int(at[0] + 0.5), int(at[1] + 0.5)] <= (near + far) / 2 * PARTS
    ]
    hides = [view for view in behind if view not in past]

    def agree(colour: Array) -> bool:
        return float(np.abs(colour - image[y, x]).mean()) < limit

    front = front_colour(disparity, image, y, x)
    none = np.zeros(levels.shape[-1])
    colours = np.array([behind[view][1] for view in past]) if past else none[None]
    back = colours.mean(axis=0)
    return Seen(
        front[0] if front else none,
        back,
        front[1] if front else None,
        float((np.pi / 2 * np.abs(colours - back).mean(axis=0) ** 2).sum()),
        [
            len(past),
            sum(agree(ahead[view]) for view in past if view in ahead),
            sum(agree(behind[view][1]) for view in past),
            len(hides),
            sum(agree(ahead[view]) for view in hides if view in ahead),
            len(ahead),
        ],
    )


def light(levels: Array, exponent: float) -> Array:
    return np.asarray(255 * (levels / 255) ** exponent)


def slope(level: float, exponent: float) -> float:
    return float(exponent * (max(level, 1) / 255) ** (exponent - 1))


def tell(own: Array, seen: Seen, is_front: bool, others: int, exponent: float) -> Told:
    """In the order of the network's inputs."""
    mine, front, back = (light(each, exponent) for each in (own, seen.front, seen.back))
    front_variance = (seen.front_variance or 0.0) * slope(float(seen.front.mean()), exponent) ** 2
    back_variance = seen.back_variance * slope(float(seen.back.mean()), exponent) ** 2
    floor = 4 / 3 * len(own) * slope(float(own.mean()), exponent) ** 2
    noise = front_variance + back_variance + floor
    apart = max(float(((front - back) ** 2).sum()), 0.01)
    share = float((mine - back) @ (front - back)) / apart
    beside = float(((mine - back - share * (front - back)) ** 2).sum())
    seeing, seeing_near, seeing_far, hidden, hidden_near, shown = seen.counts
    numbers = [
        min(max(share, -1), 2) - 0.5,
        np.log(np.sqrt(apart / noise)),
        min(np.sqrt(beside / apart), 2),
        min(np.sqrt(front_variance / apart), 2),
        min(np.sqrt(back_variance / apart), 2),
        np.log1p(((mine - back) ** 2).sum() / (back_variance + floor)) / 2,
        np.log1p(((mine - front) ** 2).sum() / (front_variance + floor)) / 2,
        np.log1p(max(-share, 0) * np.sqrt(apart / (back_variance + floor))),
        np.log1p(max(share - 1, 0) * np.sqrt(apart / (front_variance + floor))),
        float(seen.front_variance is not None),
        seeing / others,
        hidden / others,
        (seeing_near + hidden_near) / max(shown, 1),
        seeing_near / max(seeing, 1),
        hidden_near / max(hidden, 1),
        seeing_far / max(seeing, 1),
    ]
    sure = apart / (apart + 4 * noise) if seen.front_variance is not None and seeing >= 3 else 0.0
    return Told(sure * min(max(share, -0.2), 1.2) + (1 - sure) * is_front, numbers)


def features(
    disparity: Array, before: Array, views: Array, exponent: float, present: Array | None = None
) -> dict[tuple[int, int], Array]:
    """All inputs of the network for every pixel beside a depth edge."""
    image = reference(views.astype(np.float64) * (255 / full_scale(views)))
    seen = edge_colours(disparity, views, present)
    others = sum(1 for _ in other_views(views, present))
    told, sides = {}, {}
    for (y, x), each in seen.items():
        sides[y, x] = surfaces(disparity, y, x)
        is_front = float(disparity[y, x]) > sum(sides[y, x]) / 2
        told[y, x] = tell(image[y, x], each, is_front, others, exponent)
    out = {}
    for (y, x), each in seen.items():
        near, far = sides[y, x]
        front, back = light(each.front, exponent), light(each.back, exponent)
        colour, side, mixed = np.zeros((7, 7)), np.zeros((7, 7)), np.zeros((7, 7))
        for i, j in np.ndindex(7, 7):
            at = min(max(y + i - 3, 0), len(image) - 1), min(max(x + j - 3, 0), image.shape[1] - 1)
            way = front - back
            share = float((light(image[at], exponent) - back) @ way) / max(float(way @ way), 0.01)
            colour[i, j] = float(np.clip(share, -0.5, 1.5)) - 0.5
            side[i, j] = float(np.clip((float(disparity[at]) - far) / (near - far), -0.5, 1.5)) - 0.5
            mixed[i, j] = told[at].share - 0.5 if at in told else float(np.clip(side[i, j], -0.5, 0.5))
        parts = [turned(patch, side) for patch in (colour, side, mixed)]
        past = min(max((float(before[y, x]) - far) / (near - far), -0.5), 1.5)
        head = [np.log(near - far), *told[y, x].numbers, float(disparity[y, x] > (near + far) / 2), past]
        out[y, x] = np.concatenate([head, parts[0].ravel(), parts[1].ravel(), parts[2][1:6, 1:6].ravel()])
    return out


def turned(patch: Array, side: Array) -> Array:
    """Mirrored and transposed so that the nearer surface lies to the right, and rather there than below."""
    down = sum((i - 3) * side[i, j] for i, j in np.ndindex(7, 7))
    across = sum((j - 3) * side[i, j] for i, j in np.ndindex(7, 7))
    patch = patch[::-1] if down < 0 else patch
    patch = patch[:, ::-1] if across < 0 else patch
    return patch.T if abs(down) > abs(across) else patch


def odds(weights: list[tuple[Array, Array]], inputs: Array) -> float:
    values = inputs
    for i, (matrix, offset) in enumerate(weights):
        values = np.array([offset[k] + values @ matrix[:, k] for k in range(len(offset))], np.float64)
        values = values if i == len(weights) - 1 else np.maximum(values, 0)
    return float(values[0])


def decide(weights: list[tuple[Array, Array]], disparity: Array, told: dict[tuple[int, int], Array]) -> Array:
    """The map with the pixels that change sides."""
    out = disparity.copy()
    for (y, x), inputs in told.items():
        near, far = surfaces(disparity, y, x)
        log_odds, is_front = odds(weights, inputs), float(disparity[y, x]) > (near + far) / 2
        if is_front and log_odds < -CLEARLY_FAR:
            out[y, x] = far
        elif not is_front and log_odds > CLEARLY_NEAR:
            out[y, x] = near
    return out
