"""Cost volumes: from costs to a map, against the oracle and by laws."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

import naive_labels
from lfdepth.blocks.labels import cheapest, neighbour_weights, truncated_linear
from lfdepth.engines import single
from lfdepth.methods.labels import symmetric

PLANES = np.linspace(1.2, -0.8, 11)


def test_the_cheapest_label_wins() -> None:
    """Its disparity, and how much better it is than the next local minimum."""
    volume = np.random.default_rng(1).random((11, 5, 7)).astype(np.float32)
    disparity, confidence = cheapest(volume, PLANES)
    for y, x in np.ndindex(5, 7):
        costs = volume[:, y, x].tolist()
        assert disparity[y, x] == np.float32(PLANES[costs.index(min(costs))])
        expected = 1 - min(costs) / naive_labels.runner_up(costs)
        assert confidence[y, x] == pytest.approx(expected, abs=1e-6)


def test_costs_that_count_down_are_as_sure() -> None:
    """Of scores 4 and 3, the winner is better by a quarter, as it is of costs 3 and 4."""
    scores = np.array([1, 4, 2, 3, 0], np.float32)[:, None, None]
    costs = np.array([5, 3, 6, 4, 7], np.float32)[:, None, None]
    for volume in (-scores, costs):
        assert cheapest(volume, PLANES[:5])[1] == pytest.approx(0.25)
    assert cheapest(np.zeros((5, 1, 1), np.float32), PLANES[:5])[1] == 0


def test_a_parabola_is_found_between_labels() -> None:
    at = np.random.default_rng(2).uniform(-0.7, 1.1, (4, 6))
    volume = ((PLANES[:, None, None] - at) ** 2).astype(np.float32)
    np.testing.assert_allclose(cheapest(volume, PLANES, subplane=True)[0], at, atol=1e-5)
    ends = np.stack([np.arange(11.0), np.arange(11.0)[::-1]], axis=1)[:, None].astype(np.float32)
    assert cheapest(ends, PLANES, subplane=True)[0].tolist() == [[np.float32(1.2), np.float32(-0.8)]]


@pytest.mark.parametrize("sides", [4, 8])
def test_paths_do_not_care_how_the_picture_lies(sides: Literal[4, 8]) -> None:
    """Mirrored and transposed pictures have mirrored and transposed costs."""
    rng = np.random.default_rng(sides)
    host, guide = rng.random((6, 8, 9)).astype(np.float32), rng.random((8, 9, 3))

    def total(volume: naive_labels.Array, image: naive_labels.Array) -> naive_labels.Array:
        out = np.array(volume, order="C")
        weights = neighbour_weights(image, lambda a, b: np.exp(-np.abs(a - b).sum(axis=2)), sides=sides)
        single().line_paths(out, weights, truncated_linear(0.1, 3))
        return out

    upright = total(host, guide)
    np.testing.assert_allclose(total(host[:, :, ::-1], guide[:, ::-1])[:, :, ::-1], upright, rtol=1e-6)
    np.testing.assert_allclose(total(host[:, ::-1], guide[::-1])[:, ::-1], upright, rtol=1e-6)
    turned = total(host.transpose(0, 2, 1), guide.transpose(1, 0, 2)).transpose(0, 2, 1)
    np.testing.assert_allclose(turned, upright, rtol=1e-6)


def test_weights_belong_to_neighbours() -> None:
    guide = np.arange(12.0).reshape(3, 4, 1) ** 2
    weights = neighbour_weights(guide, lambda a, b: (b - a)[..., 0], sides=8)
    for weight, (dy, dx) in zip(weights, ((0, 1), (1, 0), (1, 1), (1, -1)), strict=True):
        for y, x in np.ndindex(3, 4):
            inside = y + dy < 3 and 0 <= x + dx < 4
            assert weight[y, x] == (guide[y + dy, x + dx, 0] - guide[y, x, 0] if inside else 0)


def test_penalties_grow_up_to_the_cut() -> None:
    np.testing.assert_allclose(truncated_linear(0.5, 3), [0, 0.5, 1, 1.5])


def test_a_range_about_zero() -> None:
    assert symmetric((-0.5, 1.25)) == (-1.25, 1.25)
    assert symmetric((-2, 1)) == (-2, 2)
