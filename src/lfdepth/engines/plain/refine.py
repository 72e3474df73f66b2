"""Refinement between planes: splines, sums over the views that see a pixel, Gauss–Newton steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfdepth.engines.base import Bool, Float
from lfdepth.engines.layout import DISPARITY_PARTS
from lfdepth.engines.plain.photo import splat
from lfdepth.lightfield import LightField, luma

_LEAST_INFORMATION = 1e-3
"""Grey levels²: less of it is rounding."""

Exact = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Splines:
    """Spline coefficients by place in the grid, of levels of 8 bits; `reference` (H, W) the levels there."""

    coefficients: dict[tuple[int, int], Exact]
    chosen: Bool
    offsets: NDArray[np.float64]
    reference: Exact


def prepare(lf: LightField, chosen: Bool) -> Splines:
    """Coefficients of interpolating splines, borders mirrored."""
    to_levels = 255 / lf.full_scale
    found = {
        (v, u): ndimage.spline_filter(luma(lf.views[v, u]).astype(np.float64) * to_levels, 3, mode="mirror")
        for v, u in np.argwhere(chosen).tolist()
    }
    return Splines(found, chosen, lf.offsets, luma(lf.reference).astype(np.float64) * to_levels)


def ask(
    views: Splines,
    disparity: Float,
    *,
    margin: float,
    high_pass: float,
    noise_blur: float,
    least_noise: float,
    fewest: int,
    farthest: float,
    halving: float,
    jump: float,
    rims: tuple[float, ...],
    typical: float | None,
) -> tuple[Float, Float, Float, float]:
    """Step, information, what is left of it near depth edges, and views' typical squared difference."""
    mean, along, variance, spreads = _slopes(views, disparity, margin, fewest)
    mean, along_u, along_v = (image - blur(image, high_pass) for image in (mean, *along))
    if typical is None:
        differing = variance[variance > 0]
        typical = float(np.median(differing)) if differing.size else 0.0
    noise = np.maximum(blur(variance, noise_blur), max(typical, least_noise))
    right, below = _derivative(mean, 1), _derivative(mean, 0)
    uu, uv, vv = spreads
    information = right**2 * uu + 2 * right * below * uv + below**2 * vv
    says = information > _LEAST_INFORMATION
    says[:2] = says[-2:] = says[:, :2] = says[:, -2:] = False
    asked = right * along_u + below * along_v
    step = np.clip(np.divide(asked, information, out=np.zeros_like(asked), where=says), -farthest, farthest)
    weight = np.where(says, information / (noise * (1 + (step / halving) ** 2)), 0)
    trusted = weight * _trust(disparity, jump, rims)
    return step.astype(np.float32), weight.astype(np.float32), trusted.astype(np.float32), typical


def blur(image: NDArray[np.floating], deviation: float) -> Exact:
    """Gaussian mean, out to four standard deviations."""
    reach = int(np.ceil(4 * deviation))
    found = ndimage.gaussian_filter(image.astype(np.float64), deviation, mode="nearest", radius=reach)
    return np.asarray(found, np.float64)


def _slopes(
    views: Splines, disparity: Float, margin: float, fewest: int
) -> tuple[Exact, tuple[Exact, Exact], Exact, tuple[Exact, Exact, Exact]]:
    """Mean level, its sums with centred u and v, its variance, and the centred sums of u², uv, v²."""
    size = disparity.shape
    y, x = (at.astype(np.float32) for at in np.mgrid[: size[0], : size[1]])
    nearest = splat(disparity, views.chosen, views.offsets).nearest
    hidden = (disparity + np.float32(margin)) * np.float32(DISPARITY_PARTS)
    sees, steps, levels = [], [], []
    for place, spline in views.coefficients.items():
        down, across = views.offsets[place].astype(np.float32)
        to_y, to_x = y - down * disparity, x - across * disparity
        inside = (to_y >= 0) & (to_x >= 0) & (to_y <= size[0] - 1) & (to_x <= size[1] - 1)
        row, column = (
            np.clip((at + np.float32(0.5)).astype(np.int64), 0, n - 1)
            for at, n in zip((to_y, to_x), size, strict=True)
        )
        sees.append(inside & (nearest[*place, row, column] <= hidden))
        steps.append((float(down), float(across)))
        places = [to_y.astype(np.float64), to_x.astype(np.float64)]
        levels.append(ndimage.map_coordinates(spline, places, order=3, mode="mirror", prefilter=False))
    seen = np.array(sees)
    counted = np.maximum(seen.sum(axis=0), 1)
    enough = seen.sum(axis=0) >= fewest
    v, u = (np.array(part)[:, None, None] for part in zip(*steps, strict=True))
    level = np.array(levels) - views.reference
    mean = (level * seen).sum(axis=0) / counted
    u, v = ((part - (part * seen).sum(axis=0) / counted) * seen for part in (u, v))
    rest = (level - mean) * seen

    def total(a: Exact, b: Exact) -> Exact:
        return np.asarray(np.where(enough, (a * b).sum(axis=0), 0))

    variance = total(rest, rest) / np.maximum(counted - 1, 1)
    spreads = (total(u, u), total(u, v), total(v, v))
    return views.reference + mean, (total(u, rest), total(v, rest)), variance, spreads


def _derivative(image: Exact, axis: int) -> Exact:
    """Of fourth order, from two neighbours on either side."""
    taps = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
    return np.asarray(ndimage.correlate1d(image, taps, axis, mode="nearest"))


def _trust(disparity: Float, jump: float, rims: tuple[float, ...]) -> Exact:
    """What evidence counts near a jump: the rim of the first ring where disparity differs by that per px."""
    out = np.ones(disparity.shape)
    for ring in range(len(rims), 0, -1):
        side = 2 * ring + 1
        frame = np.ones((side, side), np.bool_)
        frame[1:-1, 1:-1] = False
        high = ndimage.maximum_filter(disparity, footprint=frame, mode="constant", cval=-np.inf)
        low = ndimage.minimum_filter(disparity, footprint=frame, mode="constant", cval=np.inf)
        far = np.maximum(high - disparity, disparity - low)
        out[far > np.float32(jump) * np.float32(ring)] = rims[ring - 1]
    return out
