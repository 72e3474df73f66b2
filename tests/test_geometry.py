"""Where views stand, what checks of a map say, ranges beyond the usual limit: against exact scenes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lfdepth
from fields import quantise, texture
from lfdepth import scenes
from lfdepth.engines import single
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, grid_offsets
from lfdepth.methods.base import Problem, Work
from lfdepth.methods.fbs_vis import FbsVis
from lfdepth.probe.checks import check_map
from lfdepth.probe.geometry import measure_aspect, measure_off_grid, measure_positions
from lfdepth.probe.preparation import Prepared

GRID = (7, 7)
RANGE = (-1.2, 1.2)


def field(
    steps: Any, near: float = 1.0, far: float = -1.0, size: tuple[int, int] = (96, 112), grid: Any = GRID
) -> LightField:
    """A rectangle before a wall, from views that stand `steps` (V, U, 2) from the reference view."""
    rng = np.random.default_rng(5)
    height, width = size
    wall, front = (texture(rng, waves=24, shortest=6, longest=40) for _ in "12")
    y, x = np.mgrid[:height, :width].astype(float)

    def inside(column: Any, row: Any) -> Any:
        return (abs(column - 0.45 * width) < 0.22 * width) & (abs(row - 0.5 * height) < 0.3 * height)

    views = np.empty((*grid, height, width))
    for v, u in np.ndindex(*grid):
        down, across = steps[v, u]
        covered = inside(x + near * across, y + near * down)
        views[v, u] = np.where(
            covered, front(x + near * across, y + near * down), wall(x + far * across, y + far * down)
        )
    truth = np.where(inside(x, y), near, far).astype(np.float32)
    return LightField(quantise(views, "uint8")[..., None], truth=truth)


def jittered(amount: float) -> Any:
    steps = grid_offsets(GRID) + amount * np.random.default_rng(1).standard_normal((*GRID, 2))
    return steps - steps[3, 3]


def bad_pixels(disparity: Any, lf: LightField) -> float:
    assert lf.truth is not None
    return 100 * float((np.abs(disparity - lf.truth)[8:-8, 8:-8] > 0.07).mean())


@pytest.mark.parametrize("aspect", [1.0, 0.8, 0.5, 1.5])
def test_the_ratio_of_steps_is_measured(aspect: float) -> None:
    found = measure_aspect(field(grid_offsets(GRID) * [aspect, 1]), RANGE)
    assert found is not None
    assert abs(found - aspect) < 0.02


@pytest.mark.parametrize("aspect", [0.8, 0.5])
def test_the_ratio_of_steps_is_warned_of_and_used(aspect: float) -> None:
    lf = field(grid_offsets(GRID) * [aspect, 1])
    result = lfdepth.estimate(lf, "fbs-sfa", range=RANGE)
    assert result.checks is not None
    assert any(f"--aspect {aspect:.1f}" in warning for warning in result.checks.warnings)
    told = lfdepth.estimate(lfdepth.with_aspect(lf, aspect), "fbs-sfa", range=RANGE)
    assert bad_pixels(told.disparity, lf) < 4
    assert bad_pixels(result.disparity, lf) > 20
    assert told.checks is not None
    assert not any("vertical steps" in warning for warning in told.checks.warnings)


def test_views_off_the_grid_are_found_and_used() -> None:
    steps = jittered(0.15)
    lf, regular = field(steps), field(grid_offsets(GRID))
    first = lfdepth.estimate(lf, range=RANGE)
    assert first.checks is not None
    assert any("--refine-positions" in warning for warning in first.checks.warnings)
    refined = lfdepth.refine_positions(lf, first.disparity)
    again = lfdepth.estimate(refined, range=RANGE)
    clean = lfdepth.estimate(regular, range=RANGE)
    assert bad_pixels(again.disparity, lf) < 1.3 * bad_pixels(clean.disparity, regular) + 0.1
    assert clean.checks is not None
    assert clean.checks.warnings == ()


def test_positions_are_those_of_the_cameras() -> None:
    steps = jittered(0.05)
    lf = field(steps)
    found, off = measure_positions(lf, np.asarray(lf.truth)), measure_off_grid(lf, np.asarray(lf.truth))
    assert found is not None
    assert np.abs(found - (steps - grid_offsets(GRID))).mean() < 0.018
    assert 0.03 < off < 0.08


def test_a_range_that_cuts_off_the_scene_is_warned_of() -> None:
    result = lfdepth.estimate(field(grid_offsets(GRID)), "fbs-sfa", range=(-0.5, 1.2))
    assert result.checks is not None
    assert any("ends of the range" in warning for warning in result.checks.warnings)


def test_brightness_left_as_it_is_is_warned_of() -> None:
    lf = field(grid_offsets(GRID))
    gain = 1 + 0.1 * np.random.default_rng(0).standard_normal((*GRID, 1, 1, 1))
    gain[3, 3] = 1
    uneven = replace(lf, views=np.rint(np.clip(lf.views * gain, 0, 255)).astype(np.uint8))
    left = lfdepth.estimate(uneven, "fbs-sfa", range=RANGE, equalise=False)
    assert left.checks is not None
    assert "brightness" in left.checks.warnings[0]


@pytest.mark.parametrize(("near", "far"), [(27.0, 22.0), (27.0, 4.0)])
def test_disparities_beyond_the_usual_limit_are_found(near: float, far: float) -> None:
    """The usual limit is 20: there the outermost view moves by a quarter of the picture."""
    steps = grid_offsets((1, 5))
    lf = field(steps, near, far, (96, 160), (1, 5))
    low, high = lfdepth.find_range(lf)
    assert abs(low - far) < 0.3
    assert abs(high - near) < 0.3


def test_disparities_at_the_limit_are_refused() -> None:
    lf = field(grid_offsets((1, 5)), 9.9, 2.0, (96, 160), (1, 5))
    with pytest.raises(LightFieldError, match="reach the search limit of 10 px"):
        lfdepth.find_range(lf, limit=10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size", "views", "seed"),
    [
        ("demo", 128, 9, 3),
        ("demo", 128, 5, 2),
        ("fence", 96, 9, 1),
        ("fence", 128, 3, 3),
        ("bars", 96, 9, 1),
        ("strips", 128, 3, 3),
        ("leaves", 128, 9, 3),
        ("sphere", 128, 9, 3),
        ("noise-1", 128, 9, 3),
        ("range-1", 96, 9, 1),
        ("range-4", 128, 3, 3),
        ("specks", 96, 9, 1),
    ],
)
def test_nothing_is_warned_of_where_nothing_is_wrong(name: str, size: int, views: int, seed: int) -> None:
    lf = scenes.render(name, size=size, views=views, seed=seed, samples=2)
    result = lfdepth.estimate(lf)
    assert result.checks is not None
    assert result.checks.warnings == ()


def test_views_in_another_order_are_warned_of() -> None:
    lf = field(grid_offsets(GRID))
    swapped = replace(lf, views=np.ascontiguousarray(lf.views.transpose(1, 0, 2, 3, 4)))
    result = lfdepth.estimate(swapped, range=RANGE)
    assert result.checks is not None
    assert any("not in the expected order" in warning for warning in result.checks.warnings)


def test_a_ratio_that_is_none() -> None:
    with pytest.raises(LightFieldError, match="aspect: found 0"):
        lfdepth.with_aspect(field(grid_offsets(GRID)), 0)


@pytest.mark.parametrize("part", [1 / 3, 2 / 3])
def test_a_front_that_moves_by_a_large_part_of_the_picture_is_found(part: float) -> None:
    lf = field(grid_offsets((1, 101)), part * 160 / 100, -0.2, (48, 160), (1, 101))
    result = lfdepth.estimate(lf)
    assert abs(result.range[1] - part * 1.6) < 0.02
    assert bad_pixels(result.disparity, lf) < 4
    assert result.checks is not None
    assert result.checks.warnings == ()


def said(lf: LightField, **options: Any) -> str:
    checks = lfdepth.estimate(lf, "fbs-sfa", range=RANGE, **options).checks
    assert checks is not None
    return " | ".join(checks.warnings)


def test_rows_that_run_back_are_warned_of() -> None:
    lf = field(grid_offsets(GRID))
    views = lf.views.copy()
    views[1::2] = views[1::2, ::-1]
    assert "expected order" in said(replace(lf, views=views))


@pytest.mark.parametrize("name", ["demo", "sphere", "solids", "wedges"])
def test_orders_are_warned_of_where_the_range_is_given(name: str) -> None:
    """Then the order is not looked at beforehand."""
    lf = scenes.render(name, size=96, views=9, seed=1, samples=2)
    checks = lfdepth.estimate(replace(lf, views=np.ascontiguousarray(lf.views[:, ::-1])), "fbs").checks
    assert checks is not None
    assert any("not in the expected order" in words for words in checks.warnings)


@pytest.mark.parametrize("bits", [10, 12])
def test_samples_that_fill_part_of_their_type_are_warned_of(bits: int) -> None:
    lf = field(grid_offsets(GRID))
    assert "--white-level" in said(replace(lf, views=(lf.views.astype(np.uint16) * 257) >> (16 - bits)))


@pytest.mark.parametrize("grid", [(49, 1), (1, 49)])
def test_another_number_of_rows_is_warned_of(grid: tuple[int, int]) -> None:
    lf = field(grid_offsets(GRID))
    words = said(LightField(np.ascontiguousarray(lf.views.reshape(*grid, *lf.shape[2:]))))
    assert "another grid than they are read with, of 7 columns and 7 rows" in words
    assert "|" not in words  # all else follows from it


def test_a_range_beside_the_scene_is_said_first() -> None:
    result = lfdepth.estimate(field(grid_offsets(GRID)), "fbs-sfa", range=(2.0, 4.0))
    assert result.checks is not None
    assert "ends of the range" in result.checks.warnings[0]


@pytest.mark.parametrize("grid", [(1, 5), (5, 1)])
def test_a_line_of_views_has_no_tilt_to_find(grid: tuple[int, int]) -> None:
    """Where all views stand in one line, disparities of their own for the points make up for a tilt."""
    size = (64, 80)
    lf = field(grid_offsets(grid), size=size, grid=grid)
    found = measure_positions(lf, np.asarray(lf.truth))
    assert found is not None
    across = found[..., 0 if grid[0] == 1 else 1]
    line = lf.offsets[..., 1 if grid[0] == 1 else 0]
    assert abs(float((across * line).sum())) < 1e-9
    assert np.abs(found).max() < 0.03
    assert measure_off_grid(lf, np.asarray(lf.truth)) < 0.02


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_order_of_views_that_move_by_half_the_picture(mirrored: bool) -> None:
    steps = grid_offsets((1, 5))
    lf = field(steps, 52.0, 43.0, (80, 200), (1, 5))
    views = np.ascontiguousarray(lf.views[:, ::-1]) if mirrored else lf.views
    found = lfdepth.check_orientation(LightField(views))
    assert found.order_decided
    assert found.options == ("--flip-u" if mirrored else "")


def test_a_defective_pixel_is_not_white() -> None:
    """Of 12 bits in 16, one pixel at 65535: the white level is the cause that is named."""
    lf = field(grid_offsets(GRID))
    views = (lf.views.astype(np.uint16) * 257) >> 4
    views[3, 3, 40, 50] = 65535
    words = said(replace(lf, views=views))
    assert "white-level" in words
    assert "contradict" not in words


@pytest.mark.parametrize(("apart", "warned"), [(0.02, True), (0.5, False)])
def test_points_that_no_disparity_explains_are_warned_of(apart: float, warned: bool) -> None:
    """Noise in every view: they disagree everywhere; whether anything stands out, the method says."""
    rng = np.random.default_rng(0)
    lf = LightField(rng.integers(0, 256, (5, 5, 64, 72, 1), np.uint8), disparity_range=(-1.0, 1.0))
    prepared = Prepared(lf, (-1.0, 1.0), range_found=True, equalisation=None)
    flat, low = np.zeros((64, 72), np.float32), np.zeros((64, 72), np.float32)

    def standing_out(points: Any) -> Any:
        return np.full(len(points), apart, np.float32)

    checks = check_map(prepared, flat, low, standing_out=standing_out)
    assert checks.disagreeing > 0.5
    assert checks.undecided == (checks.disagreeing if warned else 0)


def test_how_far_the_best_disparity_stands_out() -> None:
    """Against the shares of the method's last decision, pixel by pixel."""
    lf = field(grid_offsets(GRID), size=(48, 56))
    trace = lfdepth.Trace(keep=["shares"])
    method = FbsVis()
    planes = method.planes_for(RANGE)
    maps = method.run(Problem(lf, RANGE, planes), Work(single(), trace))
    shares, step = trace.kept["shares"][-1], float(planes[0] - planes[1])
    points = np.array([(5, 7), (20, 30), (40, 50), (24, 12)])
    assert maps.standing_out is not None
    for (y, x), told in zip(points, maps.standing_out(points), strict=True):
        profile = shares[:, y, x]
        best = int(profile.argmax())
        others = [share for k, share in enumerate(profile) if abs(k - best) > max(3, round(0.3 / step))]
        assert told == pytest.approx(profile[best] - max(others), abs=1e-6)
