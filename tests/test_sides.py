"""SPO, SPO-MO, LF_OCC and OMG: their equations against the oracles, laws, and what they are to be good at."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

import fields
import naive
import naive_sides
from compared import field, found, mirrored, moved, share_alike, turned
from lfdepth import scenes
from lfdepth.blocks import occluders
from lfdepth.blocks.contours import canny, orientations, spread, spread_largest
from lfdepth.blocks.parallelogram import binned
from lfdepth.blocks.smoothing import guide_image
from lfdepth.engines import engine
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.io import read
from lfdepth.io.pfm import read_pfm
from lfdepth.lightfield import LightField
from lfdepth.methods import method
from lfdepth.trace import Trace

Array = fields.Array
METHODS = ("spo", "spo-mo", "lf-occ", "omg")


# --- SPO


@pytest.mark.parametrize("name", ["spo", "spo-mo"])
def test_sides_are_compared_and_directions_joined_as_published(name: str) -> None:
    """Against histograms of whole EPIs; away from edges spo-mo is the mean of four directions."""
    lf = field(1)
    planes, walks = np.linspace(1, -1, 7), [(0, 1), (1, 0), (1, 1), (1, -1)][: 2 if name == "spo" else 4]
    trace = Trace(keep=("costs",))
    options: dict[str, Any] = {"edge_spread": 100.0} if name == "spo-mo" else {}
    found(lf, name, planes=7, trace=trace, **options)
    places = [(0, 3), (5, 25), (11, 12), (15, 7), (21, 20)]
    costs = [
        np.array(
            [[[naive_sides.side_distance(lf.views, at, w, d, 0.8, 64) for at in places]] for d in planes]
        )
        for w in walks
    ]
    expected = -naive_sides.joined(costs, 0.26)
    if name == "spo-mo":
        total = [np.exp(-each.mean(axis=0) / (0.26 * each.max(axis=0))) for each in costs]
        expected /= np.sum(total, axis=0)
    kept = np.array([trace.kept["costs"][0][:, y, x] for y, x in places]).T
    np.testing.assert_allclose(kept, expected[:, 0], rtol=2e-3, atol=2e-3)


def test_spo_smooths_with_a_guide_from_0_to_255_and_takes_the_best() -> None:
    lf = field(2)
    trace = Trace(keep=("costs",))
    disparity = found(lf, "spo", trace=trace)
    smoothing = naive.GuidedFilter(lf.reference.astype(np.float64), 3, 1e-4)
    smooth = [smoothing(each) for each in trace.kept["costs"][0]]
    assert share_alike(disparity, np.linspace(1, -1, 21)[np.argmin(smooth, axis=0)]) > 0.99


def test_bins_are_equally_wide_and_the_same_at_any_depth() -> None:
    levels = np.arange(256)
    expected = levels // 4
    for samples in (
        levels.astype(np.uint8),
        (levels * 257).astype(np.uint16),
        (levels / 255).astype(np.float32),
    ):
        np.testing.assert_array_equal(binned(samples, 64), expected)
    assert binned(np.array([255], np.uint8), 2) == 1
    assert binned(np.array([1.0], np.float32), 256) == 255


def test_views_out_of_line_are_looked_for_where_they_stand() -> None:
    """A row of cameras of which one stands a whole step lower shows the same point a row higher or lower."""
    rng = np.random.default_rng(3)
    paint = fields.texture(rng, shortest=4, longest=9)
    positions = np.zeros((1, 5, 2))
    positions[0, 3, 0] = 1
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))
    views = np.stack([paint(x + u, y + positions[0, u + 2, 0]) for u in range(-2, 3)])
    lf = LightField(fields.quantise(views[None, ..., None], "uint8"), positions=positions)
    inner = (slice(6, -6), slice(8, -8))
    near = np.abs(found(lf, "spo", planes=41, range=(0, 2)) - 1)[inner] < 0.06
    assert near.mean() > 0.97


def test_spo_needs_a_view_in_line() -> None:
    present = np.zeros((3, 3), np.bool_)
    present[1, 1] = present[0, 0] = True
    with pytest.raises(LightFieldError, match="no view is in line with the reference view; expected one"):
        found(field(4, grid=(3, 3), present=present), "spo")


@pytest.mark.parametrize(("scene", "x", "y"), [("cotton", 150, 180), ("backgammon", 40, 60)])
def test_maps_of_spo_are_the_published_ones(data_folder: Path, scene: str, x: int, y: int) -> None:
    """Which lie one label too far: 95 % of the pixels within two labels of them, moved by that label."""
    folder = data_folder / "hci4d" / scene
    published = data_folder / "published_maps" / "SPO" / f"{scene}.pfm"
    if not (folder.is_dir() and published.is_file()):
        pytest.skip(f"real data is absent: {folder}, {published}")
    whole, edge = read(folder), 26
    assert whole.disparity_range is not None
    lf = whole.crop(x - edge, y - edge, 40 + 2 * edge, 40 + 2 * edge)
    label = (whole.disparity_range[1] - whole.disparity_range[0]) / 255
    disparity = estimate(lf, "spo", check=False).disparity[edge:-edge, edge:-edge]
    expected = read_pfm(published)[y : y + 40, x : x + 40] + label
    assert np.mean(np.abs(disparity - expected) < 2.01 * label) > 0.95


# --- edges


@pytest.mark.parametrize("degrees", [0, 25, 45, 70, 90, -30, -45])
def test_a_straight_edge_is_found_where_it_is_and_as_it_runs(degrees: float) -> None:
    y, x = np.mgrid[:41, :45].astype(np.float64)
    angle = math.radians(degrees)
    distance = (x - 22.3) * math.sin(angle) + (y - 20.2) * math.cos(angle)  # rows run down
    edges = canny(0.5 + 0.4 * np.tanh(distance))
    inner = (slice(4, -4), slice(4, -4))
    assert edges[inner].sum() >= 30
    assert np.abs(distance[inner][edges[inner]]).max() < 1
    turned = (orientations(edges)[inner][edges[inner]] - angle) % math.pi
    assert np.degrees(np.minimum(turned, math.pi - turned)).max() < 14
    assert np.degrees(np.median(np.minimum(turned, math.pi - turned))) < 5


def test_edges_follow_two_thresholds() -> None:
    """A weak edge counts where it hangs together with a strong one; an even picture has none."""
    y, x = np.mgrid[:40, :60]
    joined = np.where(y >= 20, np.where(x < 30, 0.6, 0.3), 0.0)
    edges = canny(joined, upper=0.8)
    assert edges[18:22, 45:55].any()
    apart = np.where(y >= 20, np.where(x < 25, 0.6, np.where(x > 35, 0.3, 0.0)), 0.0)
    assert not canny(apart, upper=0.8)[18:22, 45:55].any()
    assert not canny(np.full((9, 9), 0.3)).any()


def test_angles_are_spread() -> None:
    """To the nearest edge, or to all around with the largest winning."""
    angles = np.full((9, 21), np.nan)
    angles[4, 5], angles[4, 11] = 0.2, -0.4
    y, x = np.mgrid[:9, :21]
    one, two = np.hypot(y - 4, x - 5), np.hypot(y - 4, x - 11)
    near = np.where(np.minimum(one, two) <= 4, np.where(one < two, 0.2, -0.4), np.nan)
    apart = one != two
    np.testing.assert_array_equal(spread(angles, 4)[apart], near[apart])
    largest = np.where(one <= 4, 0.2, np.where(two <= 4, -0.4, np.nan))
    largest[4, 11] = -0.4  # edges keep their own
    np.testing.assert_array_equal(spread_largest(angles, 4), largest)


# --- LF_OCC


def test_views_fall_into_halves_as_published() -> None:
    lf = field(5, grid=(9, 9), size=(9, 9))
    angles = np.random.default_rng(5).uniform(-1.5, 1.5, (9, 9))
    angles[0] = np.nan
    groups = occluders.halves(lf, angles).reshape(2, 9, 9, 9, 9)
    assert groups[:, :, :, 0].all()
    for (y, x), angle in np.ndenumerate(angles[1:]):
        for v, u in np.ndindex(9, 9):
            first = naive_sides.in_first_half(angle, v - 4, u - 4)
            assert groups[0, v, u, y + 1, x] == first
            assert groups[1, 8 - v, 8 - u, y + 1, x] == first  # the other half is its mirror image


def test_halves_of_few_views_are_all_views() -> None:
    present = np.ones((3, 3), np.bool_)
    present[0, 1] = False
    groups = occluders.halves(field(6, grid=(3, 3), present=present), np.zeros((22, 26)))
    assert (groups == present.reshape(1, 9, 1, 1)).all()


def test_the_better_half_counts_where_colours_fit_the_sides() -> None:
    rng = np.random.default_rng(7)
    picture = rng.random((6, 7, 3)).astype(np.float32)
    means = rng.normal(0, 0.2, (2, 3, 6, 7)).astype(np.float32)
    deviations, sides = rng.random((2, 6, 7)).astype(np.float32), rng.random((2, 6, 7, 3)).astype(np.float32)
    choose = occluders.choose_half(np.moveaxis(sides[0] - sides[1], 2, 0), picture)
    deviation, distance = choose(means, deviations)
    failed = 0
    for y, x in np.ndindex(6, 7):
        one, two = means[0, :, y, x] + picture[y, x], means[1, :, y, x] + picture[y, x]
        a, b = sides[0, y, x], sides[1, y, x]

        def far(p: Array, q: Array) -> float:
            return float(((p - q) ** 2).sum())

        better = int(deviations[1, y, x] < deviations[0, y, x])
        expected = deviations[better, y, x], np.abs(means[better, :, y, x]).sum()
        if not far(one, a) + far(two, b) < far(one, b) + far(two, a) + 0.05:
            failed += 1
            expected = np.float32(1), np.abs(-1 - picture[y, x]).sum()
        assert deviation[y, x] == expected[0]
        assert distance[y, x] == pytest.approx(expected[1], abs=1e-6)
    assert 3 < failed < 39


def test_the_other_side_of_an_edge_has_the_other_colour() -> None:
    """Of a horizontal edge, bright above: the first half's views look up, where it is bright."""
    views = np.zeros((3, 3, 12, 12, 1), np.uint8)
    views[:, :, :6] = 200
    angles = np.full((12, 12), np.nan)
    angles[5:7] = 0
    contrast = occluders.side_contrast(LightField(views), angles)
    np.testing.assert_allclose(contrast[0, 5:7], 200 / 255, rtol=1e-6)
    assert not contrast[0, :5].any()
    upper = occluders.halves(field(8, grid=(9, 9), size=(12, 12)), angles)[0].reshape(9, 9, 12, 12)
    assert upper[:3, :, 5].all()
    assert not upper[3:, :, 5].any()


def test_confidence_compares_local_minima_away_from_the_ends() -> None:
    """Costs 2, 1, 2, 1.5, 2, ...: half as much again; one minimum: its lower neighbour; the ends: none."""
    labels = np.array([[5, 5, 0]], np.int32)
    beside = np.array(
        [[[1.0, 1.0, 1.0]], [[2.0, 1.4, 1.0]], [[2.0, 1.2, 2.0]], [[1.5, 3.0, 1.5]]], np.float32
    )
    largest = np.array([[3.0, 3.0, 3.0]], np.float32)
    found = occluders._confidence(labels, beside, largest, 20)
    np.testing.assert_allclose(found, [[0.5, 0.2, 0]], atol=1e-6)


def test_paths_lower_the_energy_of_the_graph_cut() -> None:
    views = np.full((1, 3, 14, 16, 1), 60, np.uint8)
    views[..., 8:, :] = 180
    lf, rng = LightField(views), np.random.default_rng(9)
    planes = np.linspace(1, -1, 20)
    labels = np.where(np.arange(16) < 8, 4, 13) + rng.integers(-3, 4, (14, 16))
    confidence = rng.uniform(0, 0.5, (14, 16)).astype(np.float32)
    empty = np.zeros((2, 14, 16), np.float32)
    winners = occluders.Winners(labels.astype(np.int32), empty[0], confidence, empty, empty[0])
    occlusions = np.zeros((14, 16), np.bool_)
    occlusions[:, 7] = True
    with engine(threads=1) as used:
        disparity = occluders.regularise(lf, winners, occlusions, planes, subplane=False, engine=used)
    smooth = np.rint((1 - disparity) / (2 / 19)).astype(int)
    weights = occluders._pair_weights(lf, occlusions)
    assert weights[0, :, :5].min() == pytest.approx(50)
    assert weights[0, :, 6:8].max() < 1e-3  # a jump costs nothing at an occlusion
    width = 0.1 * 20 * np.clip(1 - confidence, 0.01, 1)
    before, after = (naive_sides.mrf_energy(each, labels, width, weights, 20) for each in (labels, smooth))
    assert after < 0.5 * before
    assert abs(np.median(smooth[:, 2:6]) - 4) <= 1
    assert abs(np.median(smooth[:, 10:14]) - 13) <= 1


def test_chains_of_edges_are_occlusions_where_a_tenth_of_their_pixels_is() -> None:
    edges = np.zeros((30, 40), np.bool_)
    edges[5, 5:35] = edges[15, 5:35] = edges[25, 5:35] = True
    spreads = np.full((2, 30, 40), 0.1, np.float32)
    apart = np.zeros((30, 40), np.float32)
    for row, count in ((5, 6), (15, 2), (25, 1)):
        spreads[1, row, 10 : 10 + count], apart[row, 10 : 10 + count] = 0.001, 0.5
    empty = np.zeros((30, 40), np.float32)
    winners = occluders.Winners(empty.astype(np.int32), empty, empty, spreads, apart)
    marked = occluders.occlusion_chains(winners, ndimage.binary_dilation(edges, iterations=2), edges)
    np.testing.assert_array_equal(marked[5], edges[5])
    assert not marked[[15, 25]].any()


# --- OMG


@pytest.mark.slow
def test_omg_is_lf_occ_without_edges() -> None:
    """Where no pixel is near an edge the views are all of them for both, and so are the labels."""
    lf = field(10)
    planes = np.linspace(1, -1, 21)
    nowhere = np.full((22, 26), np.nan)
    with engine(threads=1) as used:
        both = [
            occluders.find_winners(
                lf,
                planes,
                groups,
                choose,
                window=2,
                sigma_colour=0.01,
                subplane=False,
                engine=used,
                trace=Trace(),
            )
            for groups, choose in (
                (
                    occluders.halves(lf, nowhere),
                    occluders.choose_half(occluders.side_contrast(lf, nowhere), guide_image(lf, "colour")),
                ),
                (
                    occluders.consistent_groups(
                        lf, nowhere > 0, clusters=5, alike=0.05, rounds=10, scale=2.0, engine=used
                    ),
                    occluders.choose_first(0.02),
                ),
            )
        ]
    for key in ("labels", "disparity", "confidence", "spreads"):
        np.testing.assert_array_equal(getattr(both[0], key), getattr(both[1], key))
    assert len(np.unique(both[0].labels)) > 5


def test_views_that_an_occluder_covers_are_left_out() -> None:
    """A dark bar right of the pixel hides it from views on the right, as many steps away as the bar is px."""
    views = np.full((9, 9, 20, 30, 1), 200, np.uint8)
    views[:, :, :, 16:] = 20
    candidates = np.zeros((20, 30), np.bool_)
    candidates[10, 13] = True
    with engine(threads=1) as used:
        groups = occluders.consistent_groups(
            LightField(views), candidates, clusters=3, alike=0.05, rounds=10, scale=1.0, engine=used
        )
    kept = groups[0, :, 10, 13].reshape(9, 9)
    np.testing.assert_array_equal(kept, np.tile(np.arange(-4, 5) < 3, (9, 1)))
    assert groups[1].all()
    assert groups[0, :, 0].all()


@pytest.mark.thin(3)
@pytest.mark.parametrize("scene", ["bars", "fence", "leaves"])
def test_omg_has_fewer_bad_pixels_near_edges_than_lf_occ(scene: str) -> None:
    lf = scenes.render(scene, size=96)
    assert lf.truth is not None
    edge = lf.masks["occlusion_boundary"][8:-8, 8:-8]
    bad = {}
    for name in ("lf-occ", "omg"):
        disparity = estimate(lf, name, planes=48, regulariser="none", check=False).disparity
        bad[name] = np.mean((np.abs(disparity - lf.truth) > 0.07)[8:-8, 8:-8][edge])
    assert bad["omg"] < bad["lf-occ"]


@pytest.mark.thin(2)
@pytest.mark.parametrize("scene", ["bars", "fence"])
def test_spo_mo_is_no_worse_than_spo_near_jumps(scene: str) -> None:
    lf = scenes.render(scene, size=96)
    assert lf.truth is not None
    steps = ndimage.maximum_filter(lf.truth, 3) - ndimage.minimum_filter(lf.truth, 3)
    near = ndimage.binary_dilation(steps > 0.2, iterations=4)[8:-8, 8:-8]
    bad = {}
    for name in ("spo", "spo-mo"):
        disparity = estimate(lf, name, planes=48, check=False).disparity
        bad[name] = np.mean((np.abs(disparity - lf.truth) > 0.07)[8:-8, 8:-8][near])
    assert bad["spo-mo"] <= bad["spo"]


# --- laws, and any light field


LAWFUL: dict[str, dict[str, Any]] = {
    "spo": {},
    "spo-mo": {"edge_radius": 0},
    "lf-occ": {"regulariser": "none", "edge_radius": 0},
    "omg": {"regulariser": "none"},
}
"""Of several edges around a pixel another one may decide in the mirror: the largest angle, or one as near."""


@pytest.mark.parametrize("name", METHODS)
def test_transposed_and_mirrored_views_have_such_maps(name: str) -> None:
    lf = field(11)
    expected = found(lf, name, **LAWFUL[name])
    assert share_alike(found(turned(lf), name, **LAWFUL[name]).T, expected, 0.01) > 0.97
    assert share_alike(found(mirrored(lf), name, **LAWFUL[name])[:, ::-1], expected, 0.01) > 0.97


@pytest.mark.parametrize("name", METHODS)
def test_views_moved_by_whole_pixels_move_the_map(name: str) -> None:
    lf = field(12, size=(44, 48))
    shifted = found(moved(lf), name, range=(0, 2), **LAWFUL[name])
    inner = (slice(15, -15), slice(15, -15))
    assert share_alike(shifted[inner] - 1, found(lf, name, **LAWFUL[name])[inner], 0.01) > 0.97


@pytest.mark.parametrize("name", METHODS)
def test_the_map_depends_on_no_number_of_threads(name: str) -> None:
    lf = field(13, size=(35, 60))
    one, three = (found(lf, name, threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(one, three)


def test_the_published_labels_are_the_defaults() -> None:
    for name, count in (("spo", 256), ("spo-mo", 256), ("lf-occ", 256), ("omg", 100)):
        planes = method(name).planes_for((-1.5, 1.2))
        assert (len(planes), planes[0], planes[-1]) == (count, pytest.approx(1.2), pytest.approx(-1.5))
