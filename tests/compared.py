"""What the tests of the compared methods share: quick settings, small light fields, and turns of them."""

from __future__ import annotations

from typing import Any

import numpy as np

import fields
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField

Array = fields.Array

RANGE = (-1.0, 1.0)
QUICK: dict[str, dict[str, Any]] = {
    "spo": {"planes": 21, "radius": 3},
    "spo-mo": {"planes": 21, "radius": 3},
    "cae": {"planes": 21, "radius": 3},
    "lf-occ": {"planes": 21},
    "omg": {"planes": 21},
    "ofsy": {"planes": 21},
    "oavc": {"planes": 21},
}


def field(
    seed: int, grid: tuple[int, int] = (5, 5), size: tuple[int, int] = (22, 26), **rest: Any
) -> LightField:
    rest = {"channels": 3, "kind": "scene", **rest}
    return fields.light_field(np.random.default_rng(seed), grid, size, **rest)


def found(lf: LightField, name: str, **options: Any) -> Array:
    rest = {"range": RANGE, "equalise": False, "check": False, **QUICK[name], **options}
    return estimate(lf, name, **rest).disparity


def share_alike(a: Array, b: Array, tolerance: float = 1e-4) -> float:
    return float(np.mean(np.abs(a - b) <= tolerance))


def turned(lf: LightField) -> LightField:
    return LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))


def mirrored(lf: LightField) -> LightField:
    return LightField(np.ascontiguousarray(lf.views[:, ::-1, :, ::-1]))


def moved(lf: LightField) -> LightField:
    """Every view moved by one pixel for each step from the reference view: all disparities grow by 1."""
    views = np.empty_like(lf.views)
    rows, columns = lf.centre
    for i, j in np.ndindex(*lf.shape[:2]):
        views[i, j] = np.roll(lf.views[i, j], (rows - i, columns - j), (0, 1))
    return LightField(views)
