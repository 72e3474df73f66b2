"""Sides of depth edges decided by the network: against the oracle, its laws, and what it gains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fields
import lfdepth
import naive_edge_net
from lfdepth import scenes
from lfdepth.blocks import edge_net
from lfdepth.blocks.edge_net import EdgeNet, decide_sides, look_at_edges, measured_exponent
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.engines import engine
from lfdepth.engines.base import EdgeColours
from lfdepth.lightfield import LightField
from test_edges import rough_map

Array = fields.Array


def mixed_field(
    seed: int, grid: tuple[int, int], dtype: str, channels: int
) -> tuple[LightField, Array, Array]:
    """A light field, a map of it with wrong edges, and one before that."""
    rng = np.random.default_rng([seed, *grid])
    size = (int(rng.integers(12, 17)), 24)
    lf = fields.light_field(rng, grid, size, channels, dtype, "scene", fields.random_present(rng, grid))
    return lf, rough_map(rng, size), rough_map(rng, size)


# Against the oracle


@pytest.mark.parametrize("exponent", [1.0, 2.2])
@pytest.mark.parametrize(("grid", "dtype", "channels"), [((5, 5), "uint8", 3), ((3, 4), "float32", 1)])
def test_what_the_network_is_told_agrees_with_the_oracle(
    grid: tuple[int, int], dtype: str, channels: int, exponent: float
) -> None:
    """Nearest splats and agreements may be a matter of the last digit: one pixel in fifty may differ."""
    lf, disparity, before = mixed_field(1, grid, dtype, channels)
    pixels = look_at_edges(lf, disparity, before, exponent=exponent)
    expected = naive_edge_net.features(disparity, before, lf.views, exponent, lf.present)
    assert list(zip(pixels.rows, pixels.columns, strict=True)) == list(expected)
    assert len(expected) > 60
    apart = np.abs(pixels.features - np.array(list(expected.values())))
    assert np.mean(apart.max(axis=1) > 2e-3) < 0.02


@pytest.mark.parametrize("name", ["cpu", "numpy"])
def test_decisions_agree_with_the_oracle(name: str) -> None:
    lf, disparity, before = mixed_field(2, (5, 5), "uint8", 3)
    net = EdgeNet.shipped()
    told = naive_edge_net.features(disparity, before, lf.views, 1.0, lf.present)
    expected = naive_edge_net.decide(list(net.layers), disparity, told)
    with engine(name, threads=2) as used:
        found = decide_sides(lf, disparity, before, engine=used)
    assert np.mean(found != expected) < 0.004
    assert np.mean(expected != disparity) > 0.05


# Laws


def test_what_is_mirrored_or_transposed_is_decided_alike() -> None:
    lf, disparity, before = mixed_field(3, (5, 5), "uint8", 3)
    expected = decide_sides(lf, disparity, before)
    assert np.any(expected != disparity)
    mirrored = LightField(np.ascontiguousarray(lf.views[:, ::-1, :, ::-1]))
    found = decide_sides(mirrored, disparity[:, ::-1].copy(), before[:, ::-1].copy())
    assert np.mean(found[:, ::-1] != expected) < 0.01
    transposed = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))
    found = decide_sides(transposed, disparity.T.copy(), before.T.copy())
    assert np.mean(expected != found.T) < 0.01


def test_a_map_without_edges_stays() -> None:
    lf = fields.scene(4)
    level = np.full((lf.height, lf.width), 0.3, np.float32)
    np.testing.assert_array_equal(decide_sides(lf, level, level), level)


def test_the_threads_change_nothing() -> None:
    lf, disparity, before = mixed_field(5, (5, 5), "uint8", 3)
    one = decide_sides(lf, disparity, before)
    with engine(threads=3) as used:
        np.testing.assert_array_equal(decide_sides(lf, disparity, before, engine=used), one)


# The exponent of light


@pytest.mark.parametrize(("exponent", "noise"), [(1.0, 0.0), (1.0, 2.0), (2.2, 0.0), (2.2, 2.0), (2.4, 1.0)])
def test_the_exponent_is_found_in_mixed_colours(exponent: float, noise: float) -> None:
    """300 pixels that mix two colours by their light; in between there is nothing."""
    rng = np.random.default_rng(6)
    front, back = rng.uniform(20, 235, (2, 300, 3))
    share = rng.uniform(0, 1, (300, 1))
    own = (share * front**exponent + (1 - share) * back**exponent) ** (1 / exponent)
    own = own + rng.normal(0, noise, own.shape)
    shown = EdgeColours(
        *(each.astype(np.float32) for each in (front, back, np.full((300, 2), 3.0), np.full((300, 6), 20.0)))
    )
    assert measured_exponent(own.astype(np.float32), shown) == (1.0 if exponent == 1 else 2.2)


def test_grey_light_fields_are_taken_as_they_are() -> None:
    """Two greys and their mixtures lie on a line whatever the exponent."""
    rng = np.random.default_rng(7)
    front, back = rng.uniform(20, 235, (2, 300, 1)).astype(np.float32)
    own = ((front**2.2 + back**2.2) / 2) ** (1 / 2.2)
    shown = EdgeColours(front, back, np.full((300, 2), 3.0, np.float32), np.full((300, 6), 20.0, np.float32))
    assert measured_exponent(own, shown) == 1


# What it gains


def wrong_sides(disparity: Array, truth: Array) -> tuple[int, int]:
    """Pixels of a map that have the other surface's disparity, and those beside the true edges."""
    jumps = DepthEdges(LightField(np.zeros((3, 3, *truth.shape, 1), np.uint8)), EdgeRule(jump=0.4))
    jumps.move(truth)
    inner = np.zeros(truth.shape, bool)
    inner[8:-8, 8:-8] = True
    beside = jumps.found & inner
    return int(np.sum(beside & (np.abs(disparity - truth) > 0.3))), int(beside.sum())


def test_it_mends_wrong_sides() -> None:
    """Scenes and seeds that it was not trained on; at least an eighth fewer pixels on the wrong side."""
    before = after = 0
    for name, seed in (("demo", 3), ("leaves", 4)):
        lf = scenes.render(name, size=96, views=7, seed=seed)
        assert lf.truth is not None
        plain = lfdepth.estimate(lf, "fbs-vis", edge_net=False).disparity
        before += wrong_sides(plain, lf.truth)[0]
        after += wrong_sides(lfdepth.estimate(lf, "fbs-vis").disparity, lf.truth)[0]
    assert before > 100
    assert after < 0.875 * before


def test_it_leaves_a_true_map_alone() -> None:
    """Of all pixels beside edges, fewer than one in sixty changes."""
    lf = scenes.render("leaves", size=96, views=7, seed=8)
    assert lf.truth is not None
    truth = lf.truth.astype(np.float32)
    wrong, beside = wrong_sides(decide_sides(lf, truth, truth), truth)
    assert beside > 400
    assert wrong < beside / 60


def test_the_weights_are_small_and_finite() -> None:
    layers = EdgeNet.shipped().layers
    assert layers[0][0].shape[0] == 142
    assert sum(matrix.size + offset.size for matrix, offset in layers) == 5121
    assert all(np.isfinite(each).all() for layer in layers for each in layer)
    assert (Path(edge_net.__file__).parent / "edge_net.npz").stat().st_size < 30_000
