"""Exact visibility: splatted maps and the votes of the views that see a plane, by hand, laws and truth.

Shares are compared with the oracle on every engine in `test_engines`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fields
import naive_vis
from lfdepth.blocks.photo import local_thresholds, photo_consistency
from lfdepth.engines import engine, single
from lfdepth.engines.layout import DISPARITY_PARTS as PARTS
from lfdepth.engines.layout import UNKNOWN_SURFACE as EMPTY
from lfdepth.engines.layout import VISIBILITY_MARGIN as MARGIN
from lfdepth.lightfield import LightField

Array = fields.Array

GRIDS = [(3, 3), (5, 5), (4, 6), (1, 5), (7, 1)]


def random_map(rng: np.random.Generator, size: tuple[int, int], reach: float = 2.0) -> Array:
    """Two uneven surfaces with ragged edges; sixty-fourths are exact in either precision."""
    near = fields.random_mask(rng, size)
    disparity = np.where(near, reach / 2, -reach / 2) + rng.uniform(-reach / 2, reach / 2, size)
    return np.asarray(np.rint(disparity * 64) / 64, np.float32)


def every(grid: tuple[int, int]) -> Array:
    return np.ones(grid, bool)


def splatted(disparity: Array, grid: tuple[int, int], threads: int = 1) -> Array:
    """Nearest surfaces (V, U, H, W) of the cpu engine."""
    lf = LightField(np.zeros((*grid, *disparity.shape, 1), np.uint8))
    with engine("cpu", threads=threads) as used:
        nearest = used.surfaces_of(disparity, used.views(lf))
    views = nearest.data.reshape(*grid, *disparity.shape)
    np.testing.assert_array_equal(nearest.rows.reshape(views.shape[:3]), views.max(axis=-1))
    return np.asarray(views)


def share(
    lf: LightField, plane: float, disparity: Array, threads: int = 1, thresholds: Array | None = None
) -> Array:
    """Photo-consistency at a plane in the views that see past a map."""
    out = np.empty(disparity.shape, np.float32)
    limits = local_thresholds(lf.reference) if thresholds is None else thresholds
    with engine(threads=threads) as used:
        views = used.colour_views(lf, max(abs(plane), 2.0))
        used.photo(views, plane, limits, out, surfaces=used.nearest_surfaces(disparity, views))
    return out


@pytest.mark.parametrize("grid", GRIDS)
def test_splats_agree_with_the_oracle(grid: tuple[int, int]) -> None:
    disparity = random_map(np.random.default_rng([*grid, 0]), (13, 18))
    np.testing.assert_array_equal(splatted(disparity, grid), naive_vis.splat(disparity, grid))


@pytest.mark.parametrize("threads", [1, 3])
def test_absent_views_and_memory_used_before_leave_the_others_splats(threads: int) -> None:
    """What the memory held is no matter, nor what it holds of views that are absent."""
    rng = np.random.default_rng(11)
    for grid in GRIDS:
        present, disparity = fields.random_present(rng, grid), random_map(rng, (9, 14))
        lf = LightField(np.zeros((*grid, 9, 14, 1), np.uint8), present=present)
        with engine(threads=threads) as used:
            views = used.colour_views(lf, 0.0)
            fresh = used.nearest_surfaces(disparity, views)
            before = rng.integers(-32768, 32767, fresh.data.size).astype(np.int16)
            again = used.nearest_surfaces(disparity, views, replace(fresh, data=before))
        assert again.data is before
        expected = naive_vis.splat(disparity, grid)
        for data in (fresh.data, again.data):
            held = data.reshape(*grid, 9, -1)[present]
            np.testing.assert_array_equal(held[..., 2:16], expected[present])
            assert (held[..., :2] == EMPTY).all()
            assert (held[..., 16:] == EMPTY).all()


def test_a_bar_hides_the_wall_where_worked_out_by_hand() -> None:
    """A bar at disparity 2 in columns 5 to 7, a wall at 0: view u has it in columns 5 − 2u to 7 − 2u."""
    disparity = np.zeros((4, 12), np.float32)
    disparity[:, 5:8] = 2
    found = splatted(disparity, (3, 3))
    bar, wall, nothing = 2 * PARTS, 0, EMPTY
    # What the bar uncovers in view u = ±1, columns 7 and 6 or 5 and 6, no pixel of the reference view shows.
    by_hand = {
        -1: [wall] * 5 + [nothing] * 2 + [bar] * 3 + [wall] * 2,
        0: [wall] * 5 + [bar] * 3 + [wall] * 4,
        1: [wall] * 3 + [bar] * 3 + [nothing] * 2 + [wall] * 4,
    }
    for v in (-1, 0, 1):
        for u, columns in by_hand.items():
            # In view v the bar moves by 2v rows; where it leaves, nothing is known of what is behind it.
            for y in range(4):
                bars_row = 0 <= y + 2 * v < 4
                expected = columns if bars_row else [wall] * 5 + [nothing] * 3 + [wall] * 4
                np.testing.assert_array_equal(found[v + 1, u + 1, y], expected, f"{v} {u} {y}")


def test_the_nearest_surface_wins() -> None:
    disparity = np.array(
        [[0, 1, 2, 3, 0, 0]], np.float32
    )  # in view u = 1, all of the first four land at x = 0
    np.testing.assert_array_equal(splatted(disparity, (1, 3))[0, 2, 0], [3000, EMPTY, EMPTY, EMPTY, 0, 0])


@pytest.mark.parametrize("plane", [-0.6, 0.0, 0.5])
@pytest.mark.parametrize("nearer", [0.9, 1.1])
def test_a_surface_hides_a_plane_from_the_margin_on(plane: float, nearer: float) -> None:
    """And pixels in front of it keep their votes, from the same margin on."""
    lf = fields.light_field(np.random.default_rng(12), (7, 7), (8, 20), 3)  # far enough to move a pixel
    disparity = np.full((8, 20), plane, np.float32)
    disparity[:, 8:12] = plane + nearer * MARGIN
    found, blind = share(lf, plane, disparity), photo_consistency(lf, plane)
    np.testing.assert_array_equal(found[:, 8:12], blind[:, 8:12])
    assert (found == blind).all() == (nearer < 1)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(34, 12), (67, 9), (1, 33)])
def test_visible_shares_of_tall_views_agree_with_the_oracle(size: tuple[int, int], channels: int) -> None:
    """Rows where nothing is in front beside rows where something is."""
    rng = np.random.default_rng([*size, channels])
    lf = fields.light_field(rng, (3, 3), size, channels)
    disparity = np.full(size, -0.75, np.float32)
    disparity[size[0] // 3 : size[0] // 2 + 1, 3:7] = 1.25
    thresholds = rng.uniform(0.02, 0.3, size).astype(np.float32)
    for plane in (-0.8, 0.33, 1.2, 1.7):
        expected = naive_vis.visible_share(lf.views, plane, thresholds, disparity)
        for threads in (1, 3):
            found = share(lf, plane, disparity, threads, thresholds)
            np.testing.assert_allclose(found, expected, rtol=1e-6)


def two_layers() -> tuple[LightField, Array]:
    """A dark bar at disparity 1 before a bright, even wall at 0, and the exact map."""
    views = np.full((5, 5, 14, 20, 3), 200, np.uint8)
    disparity = np.zeros((14, 20), np.float32)
    disparity[:, 9:12] = 1
    for u in range(-2, 3):
        views[:, u + 2, :, 9 - u : 12 - u] = 30
    return LightField(views), disparity


def test_an_occluder_hides_the_wall_in_the_views_worked_out_by_hand() -> None:
    """At the wall's plane view u shows the bar at columns 9 − u to 11 − u.

    There the wall's pixels lose that view: columns 7 and 8 lose views on one side, 12 and 13 on the other.
    With exact visibility these views do not count, and all others agree. What lies above and below the map,
    and moves into other views, is unknown.
    """
    lf, disparity = two_layers()
    wall = disparity == 0
    wall[:2], wall[-2:] = False, False
    blind = photo_consistency(lf, 0.0)
    lost = np.zeros(20)  # of the five columns of views
    lost[[7, 13]], lost[[8, 12]] = 1, 2
    np.testing.assert_allclose(blind[wall], np.broadcast_to(1 - lost / 5, wall.shape)[wall], rtol=1e-6)
    np.testing.assert_array_equal(share(lf, 0.0, disparity)[wall], 1)
    seen = naive_vis.sees(disparity, 0.0, (5, 5))
    np.testing.assert_array_equal(5 - seen[2].sum(axis=0)[wall], np.broadcast_to(lost, wall.shape)[wall])


def test_a_surface_goes_on_voting_behind_itself() -> None:
    """A pixel in front of a plane keeps all views, or the plane would look right to it."""
    lf, disparity = two_layers()
    bar = disparity == 1
    np.testing.assert_array_equal(share(lf, 0.0, disparity)[bar], photo_consistency(lf, 0.0)[bar])


def test_a_flat_map_hides_nothing() -> None:
    rng = np.random.default_rng(5)
    lf = fields.light_field(rng, (4, 5), (18, 40), 3)
    flat = np.full((18, 40), 0.25, np.float32)
    for plane in (-1.0, 0.25, 0.3, 1.5):
        np.testing.assert_array_equal(share(lf, plane, flat), photo_consistency(lf, plane))


def test_few_views_are_not_enough() -> None:
    """Where hardly any view sees a plane, the share is of a part of all views, not of those alone."""
    lf, disparity = two_layers()
    hidden = disparity.copy()
    hidden[:] = 1
    hidden[7, 10] = 0  # a hole in a wall at 1: only the reference view sees through it
    found = share(lf, 0.0, hidden, thresholds=np.full((14, 20), 0.5, np.float32))
    assert found[7, 10] == pytest.approx(1 / (25 * naive_vis.FEWEST_SEEING))


def test_threads_change_nothing() -> None:
    rng = np.random.default_rng(6)
    lf = fields.light_field(rng, (4, 5), (70, 40), 3)
    disparity = random_map(rng, (70, 40))
    one, votes = splatted(disparity, (4, 5)), share(lf, 0.4, disparity)
    for threads in (2, 3, 5):
        np.testing.assert_array_equal(splatted(disparity, (4, 5), threads), one)
        np.testing.assert_array_equal(share(lf, 0.4, disparity, threads), votes)


def test_transposing_the_views_transposes_splats() -> None:
    disparity = random_map(np.random.default_rng(7), (30, 37))
    turned = np.ascontiguousarray(disparity.T)
    np.testing.assert_array_equal(splatted(turned, (4, 5)), splatted(disparity, (5, 4)).transpose(1, 0, 3, 2))


@pytest.mark.parametrize("plane", [-0.75, 0.5])
def test_transposing_the_views_transposes_shares(plane: float) -> None:
    rng = np.random.default_rng(7)
    lf = fields.light_field(rng, (5, 4), (30, 37), 3)
    disparity = random_map(rng, (30, 37))
    moved = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))
    found = share(moved, plane, np.ascontiguousarray(disparity.T))
    np.testing.assert_array_equal(found, share(lf, plane, disparity).T)


@pytest.mark.parametrize("disparity", [-30.0, 35.0, -35.0])
def test_a_flat_map_hides_nothing_however_far(disparity: float) -> None:
    rng = np.random.default_rng(9)
    lf = fields.light_field(rng, (3, 3), (18, 100), 3)
    flat = np.full((18, 100), disparity, np.float32)
    for plane in (disparity - 0.5, disparity, disparity + 0.5):
        np.testing.assert_array_equal(share(lf, plane, flat), photo_consistency(lf, plane))


@pytest.mark.parametrize("pixels", [-2, 1])
def test_moving_the_views_moves_what_they_see(pixels: int) -> None:
    """Views shifted by k per step: at plane D + k they show a map raised by k as they did at D."""
    rng = np.random.default_rng(8)
    lf = fields.light_field(rng, (3, 5), (30, 40), 3)
    disparity = random_map(rng, (30, 40), 1.0)
    moved = np.empty_like(lf.views)
    for i, j in np.ndindex(3, 5):
        moved[i, j] = np.roll(lf.views[i, j], (-pixels * (i - 1), -pixels * (j - 2)), (0, 1))
    found = share(LightField(moved), 0.25 + pixels, disparity + np.float32(pixels))
    inner = (slice(10, -10), slice(10, -10))
    np.testing.assert_array_equal(found[inner], share(lf, 0.25, disparity)[inner])


def test_a_surface_that_is_wider_in_a_view_has_no_gaps_there() -> None:
    """By hand: a slope of 0.2 px per px is twice as wide five steps to the left; a jump stays open."""
    disparity = (0.2 * np.arange(8, dtype=np.float32))[None]
    seen = single().seen(disparity, (0.0, -5.0))
    np.testing.assert_allclose(seen[0], np.repeat([0, 0.2, 0.4, 0.6], 2), atol=1e-6)
    torn = np.array([[0, 0, 0, 0.4, 0.4, 0.4, 0.4, 0.4]], np.float32)
    open_between = single().seen(torn, (0.0, -5.0))
    np.testing.assert_array_equal(np.isinf(open_between[0]), [0, 0, 0, 1, 1, 0, 0, 0])
