"""OAVC, CAE and OFSY: their equations against the oracles, laws, and what they are to be good at."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fields
import naive
import naive_costs
import naive_labels
import naive_photo
from compared import field, found, mirrored, moved, share_alike, turned
from lfdepth import scenes
from lfdepth.blocks.variation import smooth_surface
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.methods import method
from lfdepth.trace import Trace

Array = fields.Array
METHODS = ("oavc", "cae", "ofsy")


# --- equations


def test_oavc_is_what_its_paper_says() -> None:
    """Thresholds, votes, the bilateral filter, winners, and both medians, each by the oracle."""
    present = np.ones((5, 5), np.bool_)
    present[0, 1] = present[3, 3] = False
    lf = field(1, present=present)
    guide = lf.reference / 255
    drift = naive_costs.differences(lf.views, 0.1, np.full((22, 26), 2.0), 1.0, present, itself=True)
    limits = np.clip(drift, 0.002, 0.005)
    planes = np.linspace(1, -1, 21)
    costs = [naive_costs.differences(lf.views, plane, limits, 1.0, present) for plane in planes]
    smooth = [naive_labels.bilateral(each, guide, 3, 0.1, 3.0, "sum", "disc") for each in costs]
    trace = Trace(keep=("costs", "winners"))
    disparity = found(lf, "oavc", trace=trace)
    assert np.mean(np.abs(trace.kept["costs"][0] - costs) > 1e-4) < 0.002  # a view at its very threshold
    winners = planes[np.argmin(smooth, axis=0)]
    assert share_alike(trace.kept["winners"][0], winners) > 0.98
    expected = trace.kept["winners"][0]
    for radius in (5, 3):
        expected, _ = naive_photo.weighted_median(expected, guide, radius, 0.1, 1e6, None, 1e-4)
    assert share_alike(disparity, expected) > 0.98
    assert len(np.unique(disparity)) > 2


@pytest.mark.thin(2)
@pytest.mark.parametrize("regulariser", ["none", "paths"])
def test_cae_is_what_its_paper_says(regulariser: str) -> None:
    """Entropies, scaled, smoothed with a guide from 0 to 255, and the energy of graph cuts on paths."""
    lf = field(2, grid=(3, 5), size=(14, 17), present=np.array([[1, 1, 0, 1, 1]] * 3, bool) | True)
    planes = np.linspace(1, -1, 11)
    costs = np.array([naive_costs.entropy(lf.views, plane, 10.0, lf.available) for plane in planes])
    costs = (costs - costs.min()) / (costs.max() - costs.min())
    colours = lf.reference.astype(np.float64)
    smoothing = naive.GuidedFilter(colours, 3, 1e-4)
    volume = np.array([smoothing(each) for each in costs])
    disparity = found(lf, "cae", planes=11, regulariser=regulariser)
    if regulariser == "paths":
        volume = 5 * np.rint(225 * (volume - volume.min()) / (volume.max() - volume.min()))
        weights = np.zeros((2, 14, 17))
        across = np.linalg.norm(colours[:, 1:] - colours[:, :-1], axis=2)
        down = np.linalg.norm(colours[1:] - colours[:-1], axis=2)
        weights[0, :, :-1] = 0.005 * (225 - np.rint(225 * across / across.max()))
        weights[1, :-1] = 0.005 * (225 - np.rint(225 * down / down.max()))
        volume = naive_labels.path_sums(volume, weights, 2 * np.arange(11.0))
    assert share_alike(disparity, planes[np.argmin(volume, axis=0)]) > 0.97


def test_the_other_cost_of_cae_is_what_its_paper_says() -> None:
    """Defocus of every label, lent to pixels of the same colour."""
    lf = field(8, grid=(3, 5), size=(14, 17))
    planes = np.linspace(1, -1, 5)
    trace = Trace(keep=("costs",))
    found(lf, "cae", planes=5, cost="defocus", trace=trace)
    expected = naive_costs.adaptive_defocus(lf.views, planes, lf.available)
    np.testing.assert_allclose(trace.kept["costs"][0], expected, rtol=1e-4, atol=1e-5)


def test_adaptive_defocus_finds_two_planes() -> None:
    """Either plane at the label beside it, but beside the jump."""
    lf = field(9, size=(40, 44))
    disparity = found(lf, "cae", cost="defocus")
    near = np.minimum(np.abs(disparity - 0.8), np.abs(disparity + 0.6)) < 0.15
    assert near.mean() > 0.8


@pytest.mark.parametrize("stacks", ["partial", "whole"])
def test_ofsy_is_what_its_paper_says(stacks: str) -> None:
    lf = field(3, size=(16, 20))
    step, reach = 0.1, 3
    wider = 1 - step * np.arange(-reach, 21 + reach)
    v, u = np.mgrid[-2:3, -2:3]
    sides = np.array([(v == 0) & (u < 0), (v == 0) & (u > 0), (u == 0) & (v < 0), (u == 0) & (v > 0)])
    groups, pairs = (
        (sides, [(0, 1), (2, 3)]) if stacks == "partial" else (((v == 0) | (u == 0))[None], [(0, 0)])
    )
    expected = naive_costs.focal_symmetry(lf.views, wider, groups, pairs, reach, 0.05, lf.available)
    trace = Trace(keep=("costs",))
    disparity = found(lf, "ofsy", stacks=stacks, regulariser="none", trace=trace)
    np.testing.assert_allclose(trace.kept["costs"][0], expected, atol=1e-3)
    picked = (np.rint((1 - disparity) / step)).astype(int)
    chosen = np.take_along_axis(expected, picked[None], 0)[0]
    assert (chosen - expected.min(axis=0)).max() < 2e-3


def test_the_surface_of_least_variation() -> None:
    """A noisy plane is made smooth, a jump between two is kept where the weights say so."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:24, :30].astype(np.float64)
    truth = 0.3 * x - 0.2 * y + np.where(x >= 15, 8.0, 0.0)
    edges = np.ones((2, 24, 30))
    edges[0, :, 14] = 0
    noisy = truth + rng.normal(0, 0.5, truth.shape)
    smooth = smooth_surface(noisy, np.full(truth.shape, 0.3), edges, iterations=200)
    assert np.abs(smooth - truth).mean() < 0.3 * np.abs(noisy - truth).mean()
    assert np.abs((smooth[:, 15] - smooth[:, 14]) - 8.3).mean() < 0.4
    plane = 0.3 * x - 0.2 * y
    level = smooth_surface(plane, np.ones(truth.shape), np.ones_like(edges), iterations=400)
    np.testing.assert_allclose(level, plane, atol=0.02)


# --- laws


@pytest.mark.parametrize("name", METHODS)
def test_transposed_views_have_a_transposed_map(name: str) -> None:
    lf = field(5)
    assert share_alike(found(turned(lf), name).T, found(lf, name), 0.01) > 0.98


@pytest.mark.parametrize("name", ["oavc", "cae"])
def test_mirrored_views_have_a_mirrored_map(name: str) -> None:
    """Not so for ofsy: as published it compares stacks in one order, near before far, not in the other."""
    lf = field(6)
    assert share_alike(found(mirrored(lf), name)[:, ::-1], found(lf, name), 0.01) > 0.98


@pytest.mark.parametrize("name", METHODS)
def test_views_moved_by_whole_pixels_move_the_map(name: str) -> None:
    lf = field(7, size=(40, 44))
    options: dict[str, Any] = {} if name == "oavc" else {"regulariser": "none"}
    shifted = found(moved(lf), name, range=(0, 2), **(options | ({} if name == "ofsy" else {"planes": 41})))
    inner = (slice(12, -12), slice(12, -12))
    assert share_alike(shifted[inner] - 1, found(lf, name, **options)[inner], 0.01) > 0.95


@pytest.mark.parametrize("name", METHODS)
def test_the_map_depends_on_no_number_of_threads(name: str) -> None:
    lf = field(8, size=(35, 150))
    one, three = (found(lf, name, threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(one, three)


# --- any light field


def test_ofsy_needs_views_on_two_sides() -> None:
    lf = field(10, grid=(2, 2))
    with pytest.raises(LightFieldError, match=r"^views: found 2×2 views, none on opposite sides"):
        found(lf, "ofsy")
    absent = np.ones((3, 3), np.bool_)
    absent[1, 0] = absent[0, 1] = False
    with pytest.raises(LightFieldError, match="none on opposite sides"):
        found(field(10, grid=(3, 3), present=absent), "ofsy")


def test_the_published_labels_are_the_defaults() -> None:
    """75 and 101 labels over ±max|D|, 330 over the range."""
    for name, count, ends in (
        ("oavc", 101, (1.5, -1.5)),
        ("cae", 75, (1.5, -1.5)),
        ("ofsy", 330, (1.2, -1.5)),
    ):
        planes = method(name).planes_for((-1.5, 1.2))
        assert (len(planes), planes[0], planes[-1]) == (count, ends[0], pytest.approx(ends[1]))


# --- what they are good at


def test_partial_stacks_are_better_than_whole_ones_at_occlusions() -> None:
    lf = scenes.render("bars", size=64, views=5)
    assert lf.truth is not None
    edge = lf.masks["occlusion_boundary"][8:-8, 8:-8]
    bad = {}
    for stacks in ("partial", "whole"):
        disparity = estimate(lf, "ofsy", planes=41, stacks=stacks, regulariser="none", check=False).disparity
        bad[stacks] = np.mean((np.abs(disparity - lf.truth) > 0.07)[8:-8, 8:-8][edge])
    assert bad["partial"] < 0.9 * bad["whole"]
