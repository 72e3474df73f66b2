"""All compared methods on any light field."""

from __future__ import annotations

import numpy as np
import pytest

import fields
from compared import QUICK, RANGE
from lfdepth.estimation import estimate
from lfdepth.methods import COMPARED


@pytest.mark.thin(2)
@pytest.mark.parametrize("name", COMPARED)
@pytest.mark.parametrize(
    ("grid", "size", "dtype", "channels"),
    [
        ((3, 3), (20, 21), "uint16", 1),
        pytest.param((4, 5), (24, 20), "float32", 3, marks=pytest.mark.slow),
        ((1, 5), (18, 40), "uint8", 3),
    ],
)
def test_any_grid_size_and_depth(
    name: str, grid: tuple[int, int], size: tuple[int, int], dtype: str, channels: int
) -> None:
    """Most pixels of two planes are at one of them, and progress and confidence are what they say."""
    lf = fields.light_field(np.random.default_rng(9), grid, size, channels, dtype)
    seen: list[tuple[int, int]] = []
    result = estimate(
        lf, name, range=RANGE, progress=lambda done, total, _: seen.append((done, total)), **QUICK[name]
    )
    assert seen == [(done + 1, seen[-1][1]) for done in range(seen[-1][1])]
    assert 0 <= result.confidence.min() <= result.confidence.max() <= 1
    assert result.confidence.std() > 0.01
    near = np.minimum(np.abs(result.disparity - 0.8), np.abs(result.disparity + 0.6)) < 0.15
    assert near.mean() > 0.5
