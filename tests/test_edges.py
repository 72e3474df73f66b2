"""Depth edges: the decision pixel by pixel against the oracle, and on scenes worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import fields
import naive_vis
from lfdepth.blocks import edges
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.blocks.median import weighted_median
from lfdepth.engines import engine
from lfdepth.engines.cpu.kernels.edges import _JUMP_SHARE
from lfdepth.engines.cpu.kernels.sampling import sample
from lfdepth.lightfield import LightField

Array = fields.Array

GRIDS = [(3, 3), (5, 5), (4, 6), (1, 5), (7, 1)]


def moved(lf: LightField, disparity: Array, rule: EdgeRule, threads: int = 1) -> Array:
    """One pass over the edges, without the median."""
    with engine(threads=threads) as used:
        return DepthEdges(lf, rule, engine=used).move(disparity)


def settled(lf: LightField, disparity: Array, rule: EdgeRule, threads: int = 1) -> Array:
    with engine(threads=threads) as used:
        return DepthEdges(lf, rule, engine=used).decide(disparity)


def rough_map(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Two surfaces about where `fields.light_field` has them, with wrong edges; exact in single precision."""
    height, width = size
    y, x = np.mgrid[:height, :width]
    wrong = rng.integers(-1, 2, size)
    near = (abs(x + wrong - 0.45 * width) < 0.2 * width) & (abs(y - wrong - 0.5 * height) < 0.25 * height)
    disparity = np.where(near, 0.8, -0.6) + rng.uniform(-0.05, 0.05, size)
    return np.asarray(np.rint(disparity * 64) / 64, np.float32)


def jumps(disparity: Array, rule: EdgeRule | None = None, threads: int = 1) -> Array:
    """Where one pass finds depth edges; the views say nothing."""
    lf = LightField(np.full((3, 3, *disparity.shape, 1), 99, np.uint8))
    with engine(threads=threads) as used:
        edges_of = DepthEdges(lf, rule or EdgeRule(), engine=used)
        edges_of.move(disparity.astype(np.float32))
    return edges_of.found


# Against the oracle


def test_samples_agree_with_the_oracle() -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (6, 7, 3)).astype(np.uint8)
    out = np.empty(3, np.float32)
    for y, x in product((0, 0.25, 2.5, 4.875, 5), (0, 1.125, 5.75, 6)):
        sample(image, y, x, np.float32(1), out)
        expected = naive_vis.bilinear(image, y, x)
        assert expected is not None
        np.testing.assert_allclose(out.astype(np.float64), expected, rtol=1e-6)


@pytest.mark.thin(4)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("grid", GRIDS)
def test_one_pass_agrees_with_the_oracle(grid: tuple[int, int], channels: int, dtype: str) -> None:
    """Two distances may be too close for single precision, in the odd pixel of all."""
    rng = np.random.default_rng([*grid, channels, len(dtype)])
    pixels = wrong = changed = 0
    for rule in (EdgeRule(), EdgeRule(jump=0.02, spread=0.1, inertia=0.5)):
        size = (int(rng.integers(9, 16)), int(rng.choice([11, 24, 31, 32, 33])))
        present = fields.random_present(rng, grid) if dtype != "uint16" else None
        lf = fields.light_field(rng, grid, size, channels, dtype, "scene", present)
        disparity = rough_map(rng, size)
        found, expected = moved(lf, disparity, rule), naive_vis.move_edges(disparity, lf.views, rule, present)
        pixels, wrong = pixels + found.size, wrong + int(np.sum(found != expected))
        changed += int(np.sum(found != disparity))
    assert wrong <= 0.002 * pixels
    assert changed > 0 or dtype != "uint16"


@pytest.mark.parametrize("size", [(3, 3), (4, 9), (15, 33), (30, 31)])
def test_edges_are_where_the_oracle_finds_them(size: tuple[int, int]) -> None:
    """Two slanted surfaces of all slopes, with steps of all heights between them; in sixty-fourths, exact."""
    rng = np.random.default_rng(size)
    shares = []
    for slope in (0.02, 0.1, 0.3):
        y, x = np.mgrid[: size[0], : size[1]]
        tilts, near = rng.uniform(-slope, slope, (2, 2)), fields.random_mask(rng, size)
        disparity = np.where(near, rng.uniform(0, 0.5), 0) + rng.uniform(-0.02, 0.02, size)
        for i, side in enumerate((near, ~near)):
            disparity += side * (tilts[i, 0] * x + tilts[i, 1] * y)
        disparity = np.asarray(np.rint(disparity * 64) / 64, np.float32)
        for rule in (EdgeRule(), EdgeRule(jump=0.047)):
            found = jumps(disparity, rule)
            np.testing.assert_array_equal(found, naive_vis.edge_pixels(disparity, rule))
            np.testing.assert_array_equal(jumps(disparity, rule, threads=3), found)
            shares.append(found.mean())
    assert max(size) < 15 or 0 < np.mean(shares) < 0.9


@pytest.mark.parametrize("passes", [0, 1, 3, 5])
def test_settled_maps_agree_with_the_oracle(passes: int) -> None:
    rng = np.random.default_rng(passes)
    lf = fields.light_field(rng, (5, 5), (16, 22), 3)
    disparity, rule = rough_map(rng, (16, 22)), EdgeRule(passes=passes)
    expected, at_edge = naive_vis.settle(disparity, lf.views, rule)
    depth_edges = DepthEdges(lf, rule)
    found = depth_edges.decide(disparity)
    assert np.mean(found != expected) < 0.01
    trust = depth_edges.lower_confidence(np.ones((16, 22), np.float32), found)
    assert np.mean(np.abs(trust - naive_vis.trust(found, at_edge)) > 1e-5) < 0.01
    assert at_edge.any() == (passes > 0)


# By hand


def edge_scene(mixed: float) -> LightField:
    """A dark bar at disparity 1, columns 10 to 13, before a bright wall at 0; column 14 mixes the two.

    The reference view's column 14 is `mixed` parts of the bar. In view u the bar is at 10 − u to 13 − u, so
    views with u > 0 see the wall's own colour at column 14, and so do those with u < −1 beyond the bar's end.
    """
    views = np.full((5, 5, 16, 24, 3), 200.0)
    bar = np.array([40.0, 50.0, 60.0])
    for u in range(-2, 3):
        views[:, u + 2, :, 10 - u : 14 - u] = bar
        views[:, u + 2, :, 14 - u] = mixed * bar + (1 - mixed) * 200
    return LightField(np.rint(views).astype(np.uint8))


def edge_map(fat: int) -> Array:
    """The bar, `fat` columns too wide on its right."""
    disparity = np.zeros((16, 24), np.float32)
    disparity[:, 10 : 14 + fat] = 1
    return disparity


INNER = slice(4, -4)  # rows whose windows and views lie inside


@pytest.mark.parametrize(("mixed", "bar_keeps_it"), [(0.0, False), (0.2, False), (0.85, True), (1.0, True)])
def test_a_mixed_pixel_goes_to_the_colour_it_is_nearer_to(mixed: float, bar_keeps_it: bool) -> None:
    """In the rough map it is the bar's, and it moves with the bar, so all views agree with that.

    Worked out: both surfaces are even, so either spread is the least one, and the pixel's distances are
    (1 − m)·d to the bar and m·d to the wall. It leaves the bar if m²·(1 + inertia) < (1 − m)², for an inertia
    of 3 if m < 1/3.
    """
    lf = edge_scene(mixed)
    found = moved(lf, edge_map(fat=1), EdgeRule(inertia=3.0))
    np.testing.assert_array_equal(found[INNER, 14], 1.0 if bar_keeps_it else 0.0)
    np.testing.assert_array_equal(found[INNER, 11:14], 1)
    np.testing.assert_array_equal(found[INNER, 16:], 0)


@pytest.mark.parametrize("inertia", [0.0, 1.0, 3.0, 8.0])
def test_the_pixel_changes_sides_where_worked_out(inertia: float) -> None:
    """m²·(1 + inertia) < (1 − m)²: below m = 1 / (1 + √(1 + inertia)) the bar loses its fringe."""
    turn = 1 / (1 + np.sqrt(1 + inertia))
    for mixed in (turn - 0.04, turn + 0.04):
        found = moved(edge_scene(mixed), edge_map(fat=1), EdgeRule(inertia=inertia))
        np.testing.assert_array_equal(found[INNER, 14], 0.0 if mixed < turn else 1.0)


def test_a_bar_too_thin_is_widened() -> None:
    """Column 13 is the bar's colour; given to the wall, no view agrees, and the bar gets it back."""
    found = moved(edge_scene(0.0), edge_map(fat=-1), EdgeRule())
    np.testing.assert_array_equal(found[INNER, 13], 1)
    np.testing.assert_array_equal(found[INNER, 15:], 0)


def test_each_pass_moves_an_edge_by_a_pixel() -> None:
    """The bar is two columns too fat; its own colour is within reach of the outermost."""
    lf, found = edge_scene(0.0), edge_map(fat=2)
    for fat in (1, 0, 0):
        found = moved(lf, found, EdgeRule())
        np.testing.assert_array_equal(found[6:-6, 11:], edge_map(fat)[6:-6, 11:])


def test_surfaces_of_one_colour_stay_as_they_are() -> None:
    lf = LightField(np.full((5, 5, 16, 24, 3), 120, np.uint8))
    disparity = edge_map(fat=2)
    np.testing.assert_array_equal(moved(lf, disparity, EdgeRule()), disparity)


def test_jumps_below_the_least_are_no_edges() -> None:
    lf = edge_scene(0.0)
    disparity = edge_map(fat=1)
    np.testing.assert_array_equal(moved(lf, disparity, EdgeRule(jump=1.01)), disparity)
    assert (moved(lf, disparity, EdgeRule(jump=0.99)) != disparity).any()


@pytest.mark.parametrize("slope", [0.08, 0.2, 1.0])
@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (1, 1), (-1, 0.5)])
def test_a_steep_slope_is_no_edge(slope: float, direction: tuple[float, float]) -> None:
    """It changes half as far within 3 × 3 pixels as within 5 × 5, however steep it is."""
    y, x = np.mgrid[:14, :18]
    disparity = slope * (direction[0] * x + direction[1] * y)
    assert naive_vis.surfaces(disparity, 7, 8)[0] - naive_vis.surfaces(disparity, 7, 8)[1] > EdgeRule().jump
    assert not jumps(disparity).any()


@pytest.mark.parametrize("jump", [0.16, 0.4, 1.5])
def test_a_step_is_an_edge_on_either_side(jump: float) -> None:
    across = np.broadcast_to(np.where(np.arange(18) < 8, jump, 0.0), (14, 18))
    expected = np.zeros((14, 18), bool)
    expected[1:-1, 7:9] = True
    np.testing.assert_array_equal(jumps(across), expected)
    np.testing.assert_array_equal(jumps(across.T), expected.T)
    assert not jumps(np.broadcast_to(np.where(np.arange(18) < 8, 0.14, 0.0), (14, 18))).any()


@pytest.mark.parametrize("slope", [0.03, 0.05, 0.1])
def test_a_step_between_slanted_surfaces_is_an_edge_from_where_worked_out(slope: float) -> None:
    """Slope g and a step s: 2g + s within 3 pixels, 4g + s within 5, so s ≥ (4·0.7 − 2)/(1 − 0.7)·g."""
    share = float(_JUMP_SHARE)
    turn = (4 * share - 2) / (1 - share)
    x = np.arange(20)
    for times, is_edge in ((0.9 * turn, False), (1.1 * turn, True), (8.0, True)):
        line = slope * x + times * slope * (x >= 10)
        disparity = np.broadcast_to(line, (12, 20))
        expected = np.zeros((12, 20), bool)
        expected[1:-1, 9:11] = is_edge
        np.testing.assert_array_equal(jumps(disparity, EdgeRule(jump=0.05)), expected)
        np.testing.assert_array_equal(jumps(-disparity.T, EdgeRule(jump=0.05)), expected.T)


def test_late_passes_are_surer() -> None:
    """The third and later ones, by a factor."""
    rng = np.random.default_rng(9)
    lf = fields.light_field(rng, (5, 5), (40, 47), 3)
    disparity, rule = rough_map(rng, (40, 47)), EdgeRule(inertia=1.0)
    once = settled(lf, disparity, replace(rule, passes=1))
    second = moved(lf, once, rule)
    np.testing.assert_array_equal(settled(lf, disparity, replace(rule, passes=2)), second)
    third = moved(lf, second, replace(rule, inertia=edges._LATE))
    np.testing.assert_array_equal(settled(lf, disparity, replace(rule, passes=3)), third)
    assert (third != moved(lf, second, rule)).any()
    assert (third != second).sum() < (second != once).sum()


def test_fewer_passes_replace_the_rules() -> None:
    rng = np.random.default_rng(10)
    lf = fields.light_field(rng, (3, 3), (20, 25), 3)
    disparity = rough_map(rng, (20, 25))
    for passes in (0, 1, 2, 7):
        expected = settled(lf, disparity, EdgeRule(passes=min(passes, 3)))
        found = DepthEdges(lf, EdgeRule(passes=3)).decide(disparity, passes=passes)
        np.testing.assert_array_equal(found, expected)


def test_too_few_views_decide_nothing() -> None:
    present = np.zeros((5, 5), bool)
    present[2, 2:4] = True
    lf = LightField(edge_scene(0.0).views, present=present)
    np.testing.assert_array_equal(moved(lf, edge_map(fat=1), EdgeRule()), edge_map(fat=1))


def test_no_pass_is_the_median_alone() -> None:
    rng = np.random.default_rng(2)
    lf = fields.light_field(rng, (3, 3), (15, 20), 3)
    disparity = rough_map(rng, (15, 20))
    radius, colour, space = naive_vis.MEDIAN
    expected = weighted_median(
        disparity, lf.reference / 255, radius=radius, sigma_colour=colour, sigma_space=space
    )
    np.testing.assert_array_equal(settled(lf, disparity, EdgeRule(passes=0)), expected)


# Laws


def test_threads_change_nothing() -> None:
    rng = np.random.default_rng(3)
    lf = fields.light_field(rng, (5, 4), (60, 41), 3)
    disparity = rough_map(rng, (60, 41))
    one = settled(lf, disparity, EdgeRule())
    for threads in (2, 3, 5):
        np.testing.assert_array_equal(settled(lf, disparity, EdgeRule(), threads), one)


def test_transposing_the_views_transposes_the_decisions() -> None:
    """Sums over views run in another order; that may decide a tie."""
    rng = np.random.default_rng(4)
    lf = fields.light_field(rng, (5, 4), (40, 47), 3)
    disparity = rough_map(rng, (40, 47))
    turned = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))
    found = moved(turned, np.ascontiguousarray(disparity.T), EdgeRule())
    expected = moved(lf, disparity, EdgeRule()).T
    assert np.mean(found != expected) < 0.002
    assert (expected != disparity.T).any()


def test_only_pixels_beside_edges_change_and_only_to_a_neighbours_disparity() -> None:
    rng = np.random.default_rng(5)
    lf = fields.light_field(rng, (5, 5), (30, 40), 3)
    disparity, rule = rough_map(rng, (30, 40)), EdgeRule()
    found = moved(lf, disparity, rule)
    changed = np.argwhere(found != disparity)
    assert len(changed) > 10
    for y, x in changed:
        window = disparity[y - 1 : y + 2, x - 1 : x + 2]
        assert window.max() - window.min() >= rule.jump
        assert found[y, x] in (window.max(), window.min())


def test_decisions_bring_a_fat_foreground_closer_to_the_truth() -> None:
    rng = np.random.default_rng(6)
    views, truth = fields.two_planes(rng, (7, 7), (60, 70))
    lf = LightField(fields.quantise(np.stack([views, views**0.7, views**1.6], axis=-1), "uint8"))
    fat = np.max([np.roll(truth, shift, (0, 1)) for shift in product((-1, 0, 1), repeat=2)], axis=0)
    before = np.mean(fat != truth)
    after = np.mean(np.abs(settled(lf, fat.astype(np.float32), EdgeRule()) - truth) > 0.1)
    assert after < 0.5 * before


def test_the_map_given_is_left_alone() -> None:
    lf, disparity = edge_scene(0.0), edge_map(fat=1)
    disparity.setflags(write=False)
    settled(lf, disparity, EdgeRule())
    np.testing.assert_array_equal(disparity, edge_map(fat=1))
