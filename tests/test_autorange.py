"""The range that is found, against the truth of rendered and real scenes, and the laws it has to obey."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import lfdepth
from fields import plane_views, quantise, texture, two_planes
from lfdepth import scenes
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.probe.matching import Match
from lfdepth.probe.ranges import find_range
from lfdepth.scenes.stratified import STRATIFIED
from lfdepth.scenes.suite import SUITE

CLOSE = 0.3
"""How far, px per view step, the ends may be from the truth's."""


def off(lf: LightField) -> float:
    """The larger error of the two ends found."""
    assert lf.truth is not None
    low, high = find_range(lf, threads=2)
    return max(abs(low - float(lf.truth.min())), abs(high - float(lf.truth.max())))


def plane(
    disparity: float,
    grid: tuple[int, int] = (5, 5),
    size: tuple[int, int] = (96, 128),
    paint: Callable[..., NDArray[Any]] | None = None,
) -> LightField:
    paint = paint or texture(np.random.default_rng(0), waves=30)
    return LightField(quantise(plane_views(paint, disparity, grid, size), "uint8")[..., None])


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", [*SUITE, *STRATIFIED])
def test_both_ends_are_found_in_the_procedural_scenes(name: str) -> None:
    assert off(scenes.render(name, size=128, views=9, seed=3, samples=2)) < CLOSE


@pytest.mark.thin(3)
@pytest.mark.parametrize("views", [3, 5])
@pytest.mark.parametrize("name", [*SUITE, *STRATIFIED])
def test_both_ends_are_found_with_few_views(name: str, views: int) -> None:
    """One pixel of the outermost of 3×3 views is one px of disparity, and tiny specks blur into the wall."""
    close = 2 * CLOSE if (name, views) == ("specks", 3) else CLOSE
    assert off(scenes.render(name, size=128, views=views, seed=3, samples=2)) < close


@pytest.mark.parametrize(("views", "size", "seed"), [(3, 96, 1), (3, 96, 8), (5, 128, 0), (5, 64, 8)])
def test_periodic_texture_puts_no_surface_far_away(views: int, size: int, seed: int) -> None:
    assert off(scenes.render("strips", size=size, views=views, seed=seed, samples=2)) < CLOSE


@pytest.mark.parametrize("name", ["cotton", "backgammon"])
@pytest.mark.parametrize("views", [3, 5])
def test_both_ends_of_real_scenes_are_found_with_few_views(name: str, views: int, data_folder: Path) -> None:
    assert off(lfdepth.read(data_folder / "hci4d" / name, views=(views, views))) < CLOSE


@pytest.mark.parametrize("name", ["cotton", "backgammon"])
def test_both_ends_are_found_in_real_scenes(name: str, data_folder: Path) -> None:
    assert off(lfdepth.read(data_folder / "hci4d" / name)) < CLOSE


@pytest.mark.slow
def test_it_takes_less_time_than_an_estimate(data_folder: Path) -> None:
    lf = lfdepth.read(data_folder / "hci4d/cotton", crop=(128, 128, 256, 256))
    lfdepth.estimate(lf, range=(-0.1, 0.1), threads=1)  # compiles
    find_range(lf, threads=1)
    started = perf_counter()
    find_range(lf, threads=1)
    assert perf_counter() - started < lfdepth.estimate(lf, threads=1).runtime


@pytest.mark.parametrize("grid", [(3, 3), (4, 4), (3, 9), (8, 6), (1, 9), (9, 1)])
def test_grids_of_other_shapes(grid: tuple[int, int]) -> None:
    views, truth = two_planes(np.random.default_rng(1), grid, (96, 128))
    lf = LightField(quantise(views, "uint8")[..., None], truth=truth.astype(np.float32))
    assert off(lf) < CLOSE


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_sample_types_make_no_difference(dtype: str) -> None:
    views, _ = two_planes(np.random.default_rng(1), (5, 5), (64, 96))
    eight_bit = quantise(views, "uint8")[..., None]
    other = eight_bit.astype(np.uint16) * np.uint16(257)
    if dtype == "float32":
        other = (eight_bit / np.float32(255)).astype(np.float32)
    np.testing.assert_allclose(find_range(LightField(other)), find_range(LightField(eight_bit)), atol=1e-3)


def test_absent_views_are_not_looked_at() -> None:
    views, truth = two_planes(np.random.default_rng(1), (9, 9), (96, 128))
    samples = quantise(views, "uint8")[..., None]
    present = np.zeros((9, 9), np.bool_)
    present[4], present[:, 4] = True, True
    present |= np.eye(9, dtype=np.bool_) | np.eye(9, dtype=np.bool_)[::-1]
    present[0, 0] = False
    rest = np.where(present[:, :, None, None, None], samples, 0)
    lf = LightField(rest, present=present, truth=truth.astype(np.float32))
    assert off(lf) < CLOSE


def test_without_a_view_in_line_with_the_reference_view_it_says_so() -> None:
    present = np.zeros((5, 5), np.bool_)
    present[2, 2] = present[0, 1] = True
    lf = LightField(np.zeros((5, 5, 40, 40, 1), np.uint8), present=present)
    with pytest.raises(LightFieldError, match="no view in line with the reference view"):
        find_range(lf)


@pytest.mark.parametrize("disparity", [-11.3, 0.0, 6.6])
def test_one_plane_anywhere_gives_a_narrow_range_around_it(disparity: float) -> None:
    low, high = find_range(plane(disparity))
    assert disparity - CLOSE < low < disparity + 0.05
    assert disparity - 0.05 < high < disparity + CLOSE
    assert low < high


def test_a_wall_that_is_seen_only_through_gaps_is_in_the_range() -> None:
    rng = np.random.default_rng(0)
    wall, mesh = (texture(rng, shortest=3, longest=9) for _ in "12")
    v, u = np.arange(7)[:, None, None, None] - 3, np.arange(7)[None, :, None, None] - 3
    y, x = np.mgrid[:128, :128].astype(float)
    column, row = x + 1.5 * u, y + 1.5 * v
    gaps = (column % 16 > 7) & (row % 16 > 7)
    views = np.where(gaps, wall(x - 1.5 * u, y - 1.5 * v), mesh(column, row))
    low, high = find_range(LightField(quantise(views[..., None], "uint8")))
    assert abs(low + 1.5) < CLOSE
    assert abs(high - 1.5) < CLOSE


def test_calming_averages_what_agrees_and_nothing_else() -> None:
    disparity = np.array([[0, 0.1, 5], [0.2, 0.1, 5.1], [9, 9, 9]], np.float32)
    costs = np.ones_like(disparity), np.full_like(disparity, 9)
    costs[1][2] = 1  # the last row is uncertain
    calmed = Match(disparity, *costs).calmed(0.15).disparity
    np.testing.assert_allclose(calmed[2], 9)
    np.testing.assert_allclose(calmed[:2, 2], 5.05, rtol=1e-6)
    np.testing.assert_allclose(calmed[0, 0], (0 + 0.1 + 0.1) / 3, rtol=1e-6)
    np.testing.assert_allclose(calmed[1, 1], (0 + 0.1 + 0.1 + 0.2) / 4, rtol=1e-6)


def test_the_limit_is_kept() -> None:
    with pytest.raises(LightFieldError, match="agree on no disparity within 2 px"):
        find_range(plane(6.6), limit=2)


def test_periodic_texture_is_taken_for_what_is_closest_to_zero_disparity() -> None:
    def stripes(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(0.5 + 0.2 * np.sin(2 * np.pi * x / 9) + 0.2 * np.sin(2 * np.pi * y / 9))

    low, high = find_range(plane(1.2, paint=stripes))
    assert 1.2 - CLOSE < low < high < 1.2 + CLOSE


def test_reversing_both_axes_of_the_grid_negates_the_range() -> None:
    lf = scenes.render("demo", size=128, views=5, samples=1)
    reversed_ = replace(lf, views=np.ascontiguousarray(lf.views[::-1, ::-1]), truth=None, masks={})
    low, high = find_range(lf)
    np.testing.assert_allclose(find_range(reversed_), (-high, -low), atol=0.02)


def test_transposing_grid_and_pictures_keeps_the_range() -> None:
    lf = scenes.render("demo", size=(96, 128), views=(5, 7), samples=1)
    transposed = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))
    np.testing.assert_allclose(find_range(transposed), find_range(lf), atol=0.02)


def test_the_number_of_threads_makes_no_difference() -> None:
    lf = scenes.render("demo", size=128, views=5, samples=1)
    assert find_range(lf, threads=1) == find_range(lf, threads=3)


def test_without_texture_it_says_so() -> None:
    lf = LightField(np.full((5, 5, 64, 64, 3), 90, np.uint8), name="wall")
    with pytest.raises(
        LightFieldError, match=r"^wall: views agree on no disparity .*--range MIN MAX"
    ) as error:
        find_range(lf)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_that_are_none(limit: float) -> None:
    with pytest.raises(LightFieldError, match="limit: found"):
        find_range(plane(0), limit=limit)


@pytest.mark.parametrize(("grid", "near"), [((5, 5), 28.0), ((7, 7), 18.0), ((1, 9), 15.0)])
def test_what_only_inner_views_show_is_not_cut_off(grid: tuple[int, int], near: float) -> None:
    """The front moves by more than half the picture in the outer views; the wall does not."""
    views, _ = two_planes(np.random.default_rng(3), grid, (80, 96), near, 1.0)
    lf = LightField(quantise(views[..., None], "uint8"))
    with pytest.raises(LightFieldError, match="disparities reach the search limit"):
        find_range(lf)
    wall, _ = two_planes(np.random.default_rng(3), grid, (80, 96), 2.0, 1.0)
    low, high = find_range(LightField(quantise(wall[..., None], "uint8")))
    assert 0.7 < low < 1.0
    assert 2.0 < high < 2.3
