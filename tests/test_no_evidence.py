"""Squares without texture: nothing tells their disparity, and the confidence says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import lfdepth
from fields import quantise, texture
from lfdepth.lightfield import LightField

NEAR, SIZE, SQUARE = 3.0, (96, 144), 24


@pytest.fixture(scope="module")
def board() -> LightField:
    """A chequer board at close range; its left half carries a texture besides."""
    rng = np.random.default_rng(0)
    paint = texture(rng, waves=24, shortest=4, longest=14)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)

    def square(place: Any) -> Any:
        """A square wave whose edges are a pixel wide."""
        turn = (place / SQUARE) % 2
        edge = np.minimum(np.minimum(turn, 2 - turn), abs(turn - 1)) * SQUARE
        return np.where(turn < 1, 1, -1) * np.clip(2 * edge, 0, 1)

    views = np.empty((5, 5, *SIZE))
    for v, u in np.ndindex(5, 5):
        column, row = x + NEAR * (u - 2), y + NEAR * (v - 2)
        squares = 0.45 + 0.3 * square(column + 7) * square(row + 5)
        views[v, u] = squares + np.where(column < 72, 0.3 * (paint(column, row) - 0.5), 0)
    views += 0.002 * rng.standard_normal(views.shape)
    return LightField(quantise(np.clip(views, 0, 1), "uint8")[..., None])


@pytest.mark.parametrize(
    ("method", "searched"),
    [("fbs-vis", (-1.0, 4.0)), ("fbs-vis", (2.0, 3.5)), ("fbs-sfa", (2.0, 3.5)), ("fbs", (2.0, 3.5))],
)
def test_what_is_off_the_board_has_no_confidence(
    board: LightField, method: str, searched: tuple[float, float]
) -> None:
    result = lfdepth.estimate(board, method, range=searched)
    inner = np.zeros(SIZE, np.bool_)
    inner[8:-8, 8:-8] = True
    off = inner & (np.abs(result.disparity - NEAR) > 0.2)
    textured = np.zeros(SIZE, np.bool_)
    textured[12:-12, 12:60] = True
    assert off[textured].mean() < 0.02
    assert np.median(result.confidence[textured]) > 0.5
    assert off.any()
    assert result.confidence[off].max() < 0.2


def test_nothing_lies_at_an_end_because_nothing_was_seen(board: LightField) -> None:
    for searched in ((-1.0, 4.0), (2.0, 3.5)):
        disparity = lfdepth.estimate(board, range=searched).disparity[8:-8, 8:-8]
        at_ends = (disparity < searched[0] + 0.05) | (disparity > searched[1] - 0.05)
        assert at_ends.mean() < 0.005
