"""The metrics a second time, in plain loops straight from their definitions: the oracle of the tests."""

import math
from collections.abc import Callable, Iterator
from typing import Any

Map = Any  # (H, W) array, read one pixel at a time
Camera = Any


def pixels(truth: Map, mask: Map | None, border: int) -> Iterator[tuple[int, int]]:
    height, width = truth.shape
    for y in range(height):
        for x in range(width):
            inside = border <= y < height - border and border <= x < width - border
            if inside and math.isfinite(truth[y, x]) and (mask is None or mask[y, x]):
                yield y, x


def errors(estimate: Map, truth: Map, mask: Map | None, border: int) -> list[float]:
    return [float(estimate[p]) - float(truth[p]) for p in pixels(truth, mask, border)]


def share(flags: list[bool]) -> float:
    return 100 * sum(flags) / len(flags)


def enlarge(estimate: Map, height: int, width: int) -> list[list[float]]:
    h, w = estimate.shape
    return [
        [
            estimate[
                math.floor(y * (h - 1) / (height - 1) + 0.5),
                math.floor(x * (w - 1) / (width - 1) + 0.5),
            ]
            for x in range(width)
        ]
        for y in range(height)
    ]


def badpix(estimate: Map, truth: Map, threshold: float, mask: Map | None, border: int) -> float:
    return share([math.isnan(e) or abs(e) > threshold for e in errors(estimate, truth, mask, border)])


def mse(estimate: Map, truth: Map, mask: Map | None, border: int) -> float:
    finite = [e for e in errors(estimate, truth, mask, border) if math.isfinite(e)]
    return 100 * sum(e * e for e in finite) / len(finite)


def q25(estimate: Map, truth: Map, mask: Map | None, border: int) -> float:
    ranked = sorted(
        math.inf if math.isnan(e) else 100 * abs(e) for e in errors(estimate, truth, mask, border)
    )
    return ranked[int(len(ranked) / 4)]


def fine_fattening(estimate: Map, truth: Map, mask: Map, border: int) -> float:
    return share([math.isnan(e) or -e < -0.15 for e in errors(estimate, truth, mask, border)])


def fine_thinning(estimate: Map, truth: Map, mask: Map, border: int) -> float:
    return share([math.isnan(e) or -e > 0.15 for e in errors(estimate, truth, mask, border)])


def _scharr(image: Callable[[int, int], float], y: int, x: int, height: int, width: int, axis: int) -> float:
    if y in (0, height - 1) or x in (0, width - 1):
        return 0.0
    total = 0.0
    for k, weight in ((-1, 3), (0, 10), (1, 3)):
        if axis == 0:
            total += weight / 16 * (image(y - 1, x + k) - image(y + 1, x + k))
        else:
            total += weight / 16 * (image(y + k, x - 1) - image(y + k, x + 1))
    return total


def bumpiness(estimate: Map, truth: Map, mask: Map, border: int) -> float:
    height, width = truth.shape

    def error(y: int, x: int) -> float:
        return float(estimate[y, x]) - float(truth[y, x])

    def first(axis: int) -> Callable[[int, int], float]:
        return lambda y, x: _scharr(error, y, x, height, width, axis)

    values = []
    for y, x in pixels(truth, mask, border):
        squares = [_scharr(first(a), y, x, height, width, b) ** 2 for a in (0, 1) for b in (0, 1)]
        norm = math.sqrt(sum(squares))
        values.append(0.05 if math.isnan(norm) else min(norm, 0.05))
    return 100 * sum(values) / len(values)


def _point(disparity: Map, y: int, x: int, camera: Camera) -> list[float]:
    height, width = disparity.shape
    y, x = y % height, x % width
    beta = camera.baseline_mm * camera.focal_length_mm * max(width, height)
    focus = camera.focus_distance_m * 1000
    z = beta * focus / (float(disparity[y, x]) * focus * camera.sensor_size_mm + beta) / 1000
    half = 0.5 * camera.sensor_size_mm * z / camera.focal_length_mm
    return [x / (width - 1) * half, y / (height - 1) * half, z]


def _normal(disparity: Map, y: int, x: int, camera: Camera) -> list[float]:
    def tangent(horizontal: bool) -> list[float]:
        total = [0.0, 0.0, 0.0]
        for k, weight in ((-1, 3), (0, 10), (1, 3)):
            for side in (-1, 1):
                dy, dx = (k, side) if horizontal else (side, k)
                point = _point(disparity, y + dy, x + dx, camera)
                total = [t + side * weight / 64 * p for t, p in zip(total, point, strict=True)]
        return total

    a, b = tangent(True), tangent(False)
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def angle_error(estimate: Map, truth: Map, mask: Map, camera: Camera, border: int) -> float:
    angles = []
    for y, x in pixels(truth, mask, border):
        m, n = _normal(estimate, y, x, camera), _normal(truth, y, x, camera)
        dot = sum(p * q for p, q in zip(m, n, strict=True))
        cosine = dot / math.sqrt(sum(p * p for p in m)) / math.sqrt(sum(q * q for q in n))
        angles.append(math.degrees(math.acos(max(-1.0, min(1.0, cosine)))))
    angles.sort()
    middle = len(angles) // 2
    return angles[middle] if len(angles) % 2 else (angles[middle - 1] + angles[middle]) / 2


def backgammon_fattening(estimate: Map, truth: Map, mask: Map, border: int, column: int) -> float:
    return share(
        [
            not estimate[y, x] <= (float(truth[y, column]) + float(truth[y, x])) / 2
            for y, x in pixels(truth, mask, border)
        ]
    )


def backgammon_thinning(estimate: Map, truth: Map, mask: Map, border: int, column: int) -> float:
    return share(
        [
            not estimate[y, x] >= (float(truth[y, column]) + float(truth[y, x])) / 2
            for y, x in pixels(truth, mask, border)
        ]
    )


def missed_dots(estimate: Map, truth: Map, boxes: Map, sizes: Map) -> float:
    missed = []
    for box in {int(b) for b in boxes.ravel()} - {0}:
        for size in range(1, 9):
            dot = (boxes == box) & (sizes == size)
            if dot.any():
                missed.append(badpix(estimate, truth, 0.4, dot, border=0) >= 50)
    return share(missed)


def near_boundaries(truth: Map, jump: float, distance: float) -> set[tuple[int, int]]:
    height, width = truth.shape
    edges = set()
    for y in range(height):
        for x in range(width):
            for other in ((y + 1, x), (y, x + 1)):
                if other[0] < height and other[1] < width and abs(truth[other] - truth[y, x]) > jump:
                    edges |= {(y, x), other}
    return {
        (y, x)
        for y in range(height)
        for x in range(width)
        if any(math.hypot(y - v, x - u) <= distance for v, u in edges)
    }


def ause_badpix(
    estimate: Map, truth: Map, confidence: Map, threshold: float, steps: int, border: int
) -> float:
    """For confidences that all differ."""
    where = list(pixels(truth, None, border))
    bad = {p: 0.0 if abs(float(estimate[p]) - float(truth[p])) <= threshold else 100.0 for p in where}
    trusted = sorted(where, key=lambda p: -confidence[p])
    ideal = sorted(where, key=lambda p: bad[p])
    area = 0.0
    for step in range(steps):
        kept = round((1 - step / steps) * len(where))
        area += sum(bad[p] for p in trusted[:kept]) / kept - sum(bad[p] for p in ideal[:kept]) / kept
    return area / steps
