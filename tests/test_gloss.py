"""The gloss block against the oracle, its laws, and what it does for glossy and other scenes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import fields
import naive_gloss
import naive_vis
from lfdepth import scenes
from lfdepth.blocks import gloss
from lfdepth.blocks.gloss import Box, FineCount, boxes, suspects, tidied
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines import engine
from lfdepth.engines.cpu.engine import CpuEngine
from lfdepth.engines.cpu.layout import colour_stack
from lfdepth.engines.cpu.workers import Workers
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField

Array = fields.Array

SIZE = 160


@cache
def scene(name: str, views: int = 9) -> LightField:
    return scenes.render(name, size=SIZE, views=views)


def small(name: str) -> LightField:
    """5×5 views of a scene."""
    return scene(name).angular_crop(5, 5)


def bad_pixels(lf: LightField, **options: Any) -> float:
    """Share of the frame, less a border, that "fbs-vis" places more than 0.07 px off."""
    assert lf.truth is not None
    off = abs(estimate(lf, "fbs-vis", **options).disparity - lf.truth)
    return float(np.mean(off[8:-8, 8:-8] > 0.07))


def changed(lf: LightField, **options: Any) -> LightField:
    """The light field with other fields."""
    kept = {"disparity_range": lf.disparity_range, "truth": lf.truth, "present": lf.present}
    return LightField(**{"views": lf.views, **kept, **options})


def window(stack_data: Array, grid: tuple[int, int], height: int, channels: int) -> Array:
    """Flat stack data as (V, U, H, row length, C)."""
    return np.moveaxis(stack_data.reshape(*grid, height, channels, -1), 3, 4)


# Blocks against the oracle


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize(("channels", "disparity"), [(1, 0.1), (3, 1.7)])
def test_high_passed_views_agree_with_the_oracle(dtype: str, channels: int, disparity: float) -> None:
    rng = np.random.default_rng([channels, len(dtype)])
    for kind, size in (("noise", (13, 37)), ("coarse", (5, 4)), ("scene", (20, 70))):
        present = fields.random_present(rng, (3, 4))
        lf = fields.light_field(rng, (3, 4), size, channels, dtype, kind, present)
        expected = colour_stack(Workers(1), LightField(naive_gloss.high_passed(lf.views)), disparity)
        whole = window(expected.data, (3, 4), size[0], channels)
        for box in (Box(0, size[0], 0, size[1]), Box(1, 4, 2, 3), Box(2, size[0], size[1] // 2, size[1])):
            with CpuEngine(threads=2) as used:
                found = used.high_passed(used.colour_views(lf, disparity), box.parts)
            data = window(found.data, (3, 4), box.bottom - box.top, channels)
            columns = box.left + np.arange(data.shape[3])
            inside = columns[columns < whole.shape[3]] - box.left
            np.testing.assert_array_equal(
                data[:, :, :, inside][present], whole[:, :, box.top : box.bottom, box.left + inside][present]
            )


@pytest.mark.thin(3)
@pytest.mark.parametrize(
    ("grid", "dtype"), [((3, 3), "uint8"), ((5, 5), "uint16"), ((4, 6), "float32"), ((9, 3), "uint8")]
)
def test_suspects_agree_with_the_oracle(grid: tuple[int, int], dtype: str) -> None:
    rng = np.random.default_rng([*grid, len(dtype)])
    size = (int(rng.integers(17, 30)), int(rng.integers(90, 130)))
    views = fields.quantise(fields.glossy_plane(rng, grid, size), dtype)
    texture = rng.uniform(0.3, 1, size).astype(np.float32)
    limits, planes = naive_vis.thresholds(views), np.array([1.0, 0.5, 0.0])
    for present in (np.ones(grid, np.bool_), fields.random_present(rng, grid)):
        with engine(threads=2) as used:
            stack = used.colour_views(LightField(views, present=present), 1.0)
            found = suspects(used, stack, limits, texture, planes)
        expected = naive_gloss.suspects(views, limits, texture, planes, present)
        np.testing.assert_array_equal(found, expected)
        if present.all():
            assert found.any()
            assert not found.all()


@pytest.mark.parametrize("box", [Box(0, 24, 0, 40), Box(8, 16, 16, 24), Box(0, 8, 32, 40), Box(23, 24, 0, 1)])
def test_counting_in_a_box_is_counting_high_passed_views_there(box: Box) -> None:
    rng = np.random.default_rng(5)
    grid, size, planes = (5, 3), (24, 40), np.array([0.9, 0.5, 0.1, -0.6])
    views = fields.quantise(fields.glossy_plane(rng, grid, size), "uint8")
    present, limits = fields.random_present(rng, grid), naive_vis.thresholds(views)
    first = (np.where(np.arange(40) < 25, 0.8, -0.4) + rng.uniform(-0.1, 0.1, size)).astype(np.float32)
    smoothing = GuidedFilter(views[2, 1].astype(np.float32) / np.float32(255), 2, 1e-3)
    with engine(threads=2) as used:
        stack = used.colour_views(LightField(views, present=present), 0.9)
        count = FineCount(used, stack, limits, smoothing, planes, used.nearest_surfaces(first, stack))
        nothing = np.zeros((4, box.bottom - box.top, box.right - box.left), np.uint8)
        found = count.shares(box, nothing)
    if nothing[0].size < gloss._AREA:
        assert found is None
        return
    assert found is not None
    filtered = naive_gloss.high_passed(views)
    for k, plane in enumerate(planes):
        share = naive_vis.visible_share(filtered, plane, limits, first, present)
        expected = 255 * np.clip(smoothing(share.astype(np.float32)), 0, 1)
        np.testing.assert_allclose(found[k], expected[box.parts], atol=0.51)


def test_a_box_that_shows_no_rise_is_left_alone() -> None:
    rng = np.random.default_rng(6)
    lf = fields.light_field(rng, (3, 3), (24, 40), 3)
    smoothing, limits = (
        GuidedFilter(lf.reference.astype(np.float32) / np.float32(255), 2),
        naive_vis.thresholds(lf.views),
    )
    with engine(threads=1) as used:
        stack = used.colour_views(lf, 1)
        nearest = used.nearest_surfaces(np.zeros((24, 40), np.float32), stack)
        count = FineCount(used, stack, limits, smoothing, np.array([1.0, 0, -1]), nearest)
        assert count.shares(Box(0, 16, 0, 16), np.full((3, 16, 16), 255, np.uint8)) is None


@pytest.mark.parametrize("seed", range(8))
def test_tidied_masks_agree_with_the_oracle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = fields.random_mask(rng, (40, 47)) & (rng.random((40, 47)) > 0.01 * seed)
    np.testing.assert_array_equal(tidied(mask), naive_gloss.tidied(mask))


@pytest.mark.parametrize("seed", range(4))
def test_boxes_hold_all_suspects_once_and_stay_small(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.random((45, 80)) < (0.001, 0.01, 0.02, 0.3)[seed]
    size = (45 * gloss.CELL - 3, 80 * gloss.CELL - 5)
    held = np.zeros(size, np.int64)
    for box in boxes(cells, size):
        assert 0 < box.bottom - box.top <= gloss._TILE
        assert 0 < box.right - box.left <= gloss._TILE
        held[box.parts] += 1
    suspect = np.kron(cells, np.ones((gloss.CELL, gloss.CELL), np.bool_))[: size[0], : size[1]]
    assert (held[suspect] == 1).all()
    assert held.max() <= 1
    assert boxes(np.zeros_like(cells), size) == []


def test_near_groups_share_a_box_and_far_ones_do_not() -> None:
    cells = np.zeros((9, 40), np.bool_)
    cells[[4, 4, 5], [3, 7, 30]] = True
    near, far = sorted(boxes(cells, (72, 320)), key=lambda box: box.left)
    assert near == Box(32, 40, 24, 64)
    assert far == Box(40, 48, 240, 248)


# Laws


def test_a_shine_that_differs_from_view_to_view_does_not_change_high_passed_votes() -> None:
    rng = np.random.default_rng(8)
    paint = fields.plane_views(fields.texture(rng), 0.5, (5, 5), (30, 40))
    views = np.rint(60 + 100 * paint)[..., None].repeat(3, axis=-1)
    shiny = views + rng.integers(0, 80, (5, 5, 1, 1, 1))
    limits = naive_vis.thresholds(views.astype(np.uint8))
    shares = []
    with engine(threads=1) as used:
        for version in (views, shiny):
            stack = used.colour_views(LightField(version.astype(np.uint8)), 1)
            shares.append(np.empty((30, 40), np.float32))
            used.photo(used.high_passed(stack, Box(0, 30, 0, 40).parts), 0.5, limits, shares[-1])
    np.testing.assert_array_equal(shares[0], shares[1])
    assert shares[0].mean() > 0.8


def test_a_lambertian_surface_has_no_suspects() -> None:
    rng = np.random.default_rng(9)
    paint = fields.plane_views(fields.texture(rng), 0.5, (9, 9), (48, 64))
    views = fields.quantise(paint[..., None].repeat(3, axis=-1), "uint8")
    limits, texture = naive_vis.thresholds(views), np.ones((48, 64), np.float32)
    with engine(threads=2) as used:
        stack = used.colour_views(LightField(views), 1)
        cells = suspects(used, stack, limits, texture, np.linspace(1, -1, 21))
    assert not cells.any()


@pytest.mark.parametrize(
    ("grid", "missing"), [((1, 9), None), ((9, 1), None), ((3, 3), (0, 0)), ((5, 5), "sides")]
)
def test_few_views_have_no_suspects(grid: tuple[int, int], missing: Any) -> None:
    views = fields.quantise(fields.glossy_plane(np.random.default_rng(4), grid, (24, 120)), "uint8")
    present = np.ones(grid, np.bool_)
    if missing == "sides":
        present[::2, ::2] = False
        present[2, 2] = True
    elif missing is not None:
        present[missing] = False
    limits, planes = naive_vis.thresholds(views), np.linspace(1, 0, 9)
    texture = np.ones((24, 120), np.float32)
    with engine(threads=1) as used:
        stack = used.colour_views(LightField(views, present=present), 1)
        assert not suspects(used, stack, limits, texture, planes).any()


# Scenes


def test_gloss_is_decided_by_what_lies_under_it() -> None:
    lf = scene("gloss")
    without = bad_pixels(lf, gloss=False)
    assert without > 0.1  # or the test says nothing
    assert bad_pixels(lf) < 0.5 * without


def test_other_scenes_do_not_change() -> None:
    with_it, without = (estimate(scene("demo"), "fbs-vis", gloss=choice) for choice in (True, False))
    np.testing.assert_array_equal(with_it.disparity, without.disparity)
    np.testing.assert_array_equal(with_it.confidence, without.confidence)


@pytest.mark.thin(2)
@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_sample_types_give_about_the_same(dtype: str) -> None:
    lf = small("gloss")
    views = lf.views.astype(np.uint16) * 257 if dtype == "uint16" else lf.views.astype(np.float32) / 255
    assert abs(bad_pixels(changed(lf, views=views)) - bad_pixels(lf)) < 0.02


def test_threads_change_nothing() -> None:
    one, three = (estimate(small("gloss"), "fbs-vis", threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(one.disparity, three.disparity)
    np.testing.assert_array_equal(one.confidence, three.confidence)


def test_absent_views_have_no_say() -> None:
    lf, present = small("gloss"), np.ones((5, 5), np.bool_)
    present[[0, 0, 2, 4], [0, 3, 3, 4]] = False
    noise = np.random.default_rng(1).integers(0, 256, lf.views.shape).astype(np.uint8)
    views = np.where(present[:, :, None, None, None], lf.views, noise)
    found, expected = (
        estimate(changed(lf, views=choice, present=present), "fbs-vis") for choice in (views, lf.views)
    )
    np.testing.assert_array_equal(found.disparity, expected.disparity)
    assert bad_pixels(changed(lf, present=present)) < 0.5 * bad_pixels(
        changed(lf, present=present), gloss=False
    )


@pytest.mark.thin(3)
@pytest.mark.parametrize("grid", [(5, 5), (9, 5), (4, 8)])
def test_grids_of_other_shapes_gain_too(grid: tuple[int, int]) -> None:
    lf = scene("gloss")
    cropped = changed(lf, views=lf.views[4 - grid[0] // 2 :, 4 - grid[1] // 2 :][: grid[0], : grid[1]])
    assert bad_pixels(cropped) < 0.7 * bad_pixels(cropped, gloss=False)


@pytest.mark.parametrize("grid", [(1, 9), (3, 3)])
def test_small_grids_do_not_lose(grid: tuple[int, int]) -> None:
    cropped = scene("gloss").angular_crop(*grid)
    assert bad_pixels(cropped) <= bad_pixels(cropped, gloss=False) + 0.01


def test_glossy_pixels_are_trusted_no_more_than_others() -> None:
    lf = scene("gloss")
    assert lf.truth is not None
    with_it, without = (estimate(lf, "fbs-vis", gloss=choice) for choice in (True, False))
    glossy = abs(with_it.disparity - without.disparity) > 0.2
    right = abs(with_it.disparity - lf.truth) < 0.07
    assert with_it.confidence[glossy].mean() < with_it.confidence[~glossy].mean()
    assert with_it.confidence[glossy & ~right].mean() < 0.5 * with_it.confidence[glossy & right].mean()


def test_signs_alone_stay_alone() -> None:
    with_it, without = (
        estimate(small("gloss"), "fbs-vis", gloss=choice, photo_weight=0.0) for choice in (True, False)
    )
    np.testing.assert_array_equal(with_it.disparity, without.disparity)
