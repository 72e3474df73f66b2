"""Photo-consistency votes against the oracle, and their laws."""

from __future__ import annotations

import numpy as np
import pytest

import fields
import naive_photo
import naive_vis
from lfdepth.blocks.photo import (
    FEWEST_VIEWS,
    local_thresholds,
    photo_consistency,
    thinned,
)
from lfdepth.engines import engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

Array = fields.Array

GRIDS = [(3, 3), (5, 5), (4, 6), (6, 4), (1, 5), (7, 1)]


@pytest.mark.thin(5)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("grid", GRIDS)
def test_matches_the_oracle(grid: tuple[int, int], channels: int, dtype: str) -> None:
    rng = np.random.default_rng([*grid, channels, len(dtype)])
    for kind in fields.TEXTURES:
        present = fields.random_present(rng, grid) if kind != "noise" else None
        size = (int(rng.integers(5, 20)), int(rng.integers(5, 40)))
        lf = fields.light_field(rng, grid, size, channels, dtype, kind, present)
        thresholds = rng.uniform(0.002, 0.5, size).astype(np.float32)
        for disparity in (0.0, 0.37, float(rng.uniform(-3, 3))):
            expected = naive_photo.photo_consistency(lf.views, disparity, thresholds, present)
            found = photo_consistency(lf, disparity, thresholds=thresholds)
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("width", [1, 31, 32, 33, 63, 64, 65])
def test_matches_the_oracle_at_any_width(width: int) -> None:
    rng = np.random.default_rng(width)
    lf = fields.light_field(rng, (5, 4), (4, width), 3, kind="noise")
    thresholds = rng.uniform(0.05, 0.5, (4, width))
    found = photo_consistency(lf, -1.21, thresholds=thresholds)
    expected = naive_photo.photo_consistency(lf.views, -1.21, thresholds.astype(np.float32))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("height", [1, 2, 31, 32, 33, 70])
def test_matches_the_oracle_at_any_height(height: int, channels: int) -> None:
    rng = np.random.default_rng(height)
    lf = fields.light_field(rng, (4, 5), (height, 9), channels, kind="noise")
    thresholds = rng.uniform(0.05, 0.5, (height, 9)).astype(np.float32)
    expected = naive_photo.photo_consistency(lf.views, 1.37, thresholds)
    for threads in (1, 2, 3):
        with engine(threads=threads) as used:
            found = photo_consistency(lf, 1.37, thresholds=thresholds, engine=used)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("rows", [(0, 40), (3, 38), (35, 36)])
def test_some_rows_are_counted_as_among_all(rows: tuple[int, int], threads: int) -> None:
    rng = np.random.default_rng(13)
    lf = fields.light_field(rng, (5, 5), (40, 33), 3)
    thresholds, out = local_thresholds(lf.reference), np.full((40, 33), -1, np.float32)
    with engine(threads=threads) as used:
        used.photo(used.colour_views(lf, 1.0), -0.45, thresholds, out, rows=rows)
    expected = np.full((40, 33), -1, np.float32)
    expected[slice(*rows)] = photo_consistency(lf, -0.45)[slice(*rows)]
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_extreme_levels_do_not_overflow(dtype: str) -> None:
    """Black against white in every channel is the largest sum of differences, and half of it the bound."""
    rng = np.random.default_rng(3)
    views = rng.integers(0, 2, (3, 3, 8, 40, 3)) * np.iinfo(dtype).max
    lf = LightField(views.astype(dtype))
    for threshold in (0.5, 0.34, 0.33, 1e-6):
        thresholds = np.full((8, 40), threshold, np.float32)
        for disparity in (0.0, 0.5):
            expected = naive_photo.photo_consistency(lf.views, disparity, thresholds)
            np.testing.assert_array_equal(photo_consistency(lf, disparity, thresholds=thresholds), expected)


def test_a_difference_equal_to_the_threshold_does_not_count() -> None:
    views = np.full((3, 3, 4, 5, 3), 100, np.uint8)
    views[0, 0] += 3
    lf = LightField(views)
    exact = np.float32(3 / 255)
    above = np.nextafter(exact, np.float32(1))
    below = np.nextafter(exact, np.float32(0))
    shares = [photo_consistency(lf, 0.0, thresholds=np.full((4, 5), t)) for t in (below, above)]
    np.testing.assert_array_equal(shares[0], np.float32(8 / 9))
    np.testing.assert_array_equal(shares[1], 1)
    # A half of full scale is exact in binary: 127.5 levels, here as words.
    words = np.zeros((3, 3, 4, 5, 1), np.float32)
    words[0, 0] = 0.5
    half = photo_consistency(LightField(words), 0.0, thresholds=np.full((4, 5), 0.5))
    np.testing.assert_array_equal(half, np.float32(8 / 9))


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_thresholds_match_the_oracle(channels: int, dtype: str) -> None:
    rng = np.random.default_rng(channels)
    for size in ((9, 14), (1, 6), (6, 1)):
        lf = fields.light_field(rng, (3, 3), size, channels, dtype)
        for options in ((0.2, 0.003, 0.02), (0.1, 0.002, 0.5), (0.0, 0.01, 0.01)):
            expected = naive_photo.local_thresholds(lf.reference, *options)
            found = local_thresholds(lf.reference, *options)
            np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_thresholds_of_a_ramp() -> None:
    """Truth: three levels per px in one of three channels change the mean by one level per px."""
    ramp = np.zeros((6, 20, 3), np.uint8)
    ramp[..., 1] = 3 * np.arange(20)
    np.testing.assert_allclose(local_thresholds(ramp, 0.25, 1e-4, 0.5), 0.25 / 255, rtol=1e-6)


def test_default_thresholds_are_those_of_the_reference_view() -> None:
    lf = fields.light_field(np.random.default_rng(4), (5, 5), (20, 30), 3)
    expected = photo_consistency(lf, 0.3, thresholds=local_thresholds(lf.reference))
    np.testing.assert_array_equal(photo_consistency(lf, 0.3), expected)


@pytest.mark.parametrize("value", [0, 1, 200, 255])
@pytest.mark.parametrize("dtype", fields.DTYPES)
def test_an_even_light_field_agrees_at_every_plane(dtype: str, value: int) -> None:
    views = fields.quantise(np.full((5, 4, 9, 35, 3), value / 255), dtype)
    for disparity in (-2.3, 0.0, 0.41):
        assert (photo_consistency(LightField(views), disparity) == 1).all()


def test_a_brightness_offset_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    views = rng.integers(0, 200, (5, 5, 12, 34, 3), dtype=np.uint8)
    views[..., 0] //= 8
    thresholds = rng.uniform(0.02, 0.4, (12, 34))
    offset = np.array([55, 20, 7], np.uint8)
    first, second = (
        photo_consistency(LightField(v), 0.43, thresholds=thresholds) for v in (views, views + offset)
    )
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(local_thresholds(views[2, 2]), local_thresholds(views[2, 2] + offset))


def test_bytes_and_words_of_the_same_levels_agree() -> None:
    rng = np.random.default_rng(6)
    lf = fields.light_field(rng, (5, 5), (14, 37), 3)
    thresholds = rng.uniform(0.002, 0.1, (14, 37))
    for views in (lf.views.astype(np.uint16) * 257, (lf.views / 255).astype(np.float32)):
        for disparity in (0.31, -1.7):
            np.testing.assert_array_equal(
                photo_consistency(LightField(views), disparity, thresholds=thresholds),
                photo_consistency(lf, disparity, thresholds=thresholds),
            )


def test_threads_change_nothing() -> None:
    lf = fields.light_field(np.random.default_rng(7), (4, 5), (150, 40), 3)
    with engine(threads=3) as three:
        np.testing.assert_array_equal(photo_consistency(lf, 0.7), photo_consistency(lf, 0.7, engine=three))


def test_one_stack_serves_all_planes() -> None:
    lf = fields.light_field(np.random.default_rng(8), (5, 6), (17, 40), 3)
    thresholds, out = local_thresholds(lf.reference), np.empty((17, 40), np.float32)
    with engine(threads=1) as used:
        views = used.colour_views(lf, 2.0)
        for disparity in (-2.0, -0.6, 0.0, 1.33, 2.0):
            used.photo(views, disparity, thresholds, out)
            np.testing.assert_array_equal(out, photo_consistency(lf, disparity))


def test_the_share_peaks_at_the_surface() -> None:
    """Truth: two textured planes; away from the edge all views agree at the pixel's own disparity only."""
    rng = np.random.default_rng(9)
    views, truth = fields.two_planes(rng, (7, 7), (50, 60), near=0.8, far=-0.6)
    lf = LightField(fields.quantise(np.stack([views] * 3, axis=-1), "uint16"))
    planes = np.arange(-1.2, 1.4, 0.1)
    volume = np.stack([photo_consistency(lf, plane) for plane in planes])
    best = planes[volume.argmax(axis=0)]
    inner = (slice(6, -6), slice(6, -6))
    assert np.mean(abs(best - truth)[inner] < 0.15) > 0.93


def test_all_views_agree_at_the_plane_of_a_smooth_picture() -> None:
    """Truth: where bilinear interpolation is nearly exact every view shows the reference view's colour."""
    paint = fields.texture(np.random.default_rng(11), shortest=25.0, longest=60.0)
    views = fields.plane_views(paint, 0.43, (5, 5), (40, 44))
    lf = LightField(fields.quantise(views[..., None], "uint16"))
    inner = (slice(3, -3), slice(3, -3))
    assert np.mean(photo_consistency(lf, 0.43)[inner] == 1) > 0.99
    assert photo_consistency(lf, 1.43)[inner].mean() < 0.4


# Which views vote


def cross(grid: tuple[int, int]) -> Array:
    present = np.zeros(grid, bool)
    present[grid[0] // 2], present[:, grid[1] // 2] = True, True
    return present


@pytest.mark.parametrize(
    ("grid", "dense", "sparse"),
    [
        ((3, 3), 9, 9),  # too few to leave any out
        ((5, 5), 25, 25),  # a chessboard would leave 13
        ((6, 6), 36, 36),  # 18
        ((7, 7), 25, 25),  # corners would be 9
        ((8, 8), 32, 32),  # 16
        ((9, 9), 41, 25),
        ((15, 15), 113, 49),  # those 7 rows an even number away
        ((17, 17), 145, 81),
        ((1, 9), 9, 9),
        ((1, 49), 25, 25),
        ((1, 51), 51 // 2, 51 // 2),
        ((1, 101), 51, 51),
        ((3, 101), 51 + 2 * 50, 51),
    ],
)
def test_so_many_views_vote(grid: tuple[int, int], dense: int, sparse: int) -> None:
    """Counted by hand: of n views along an axis, those an even number away from n // 2."""
    every = np.ones(grid, bool)
    assert thinned(every, sparse=False).sum() == dense
    assert thinned(every, sparse=True).sum() == sparse


def test_a_chessboard_and_its_corners() -> None:
    every = np.ones((9, 9), bool)
    distance = abs(np.arange(9) - 4)
    expected = (distance[:, None] + distance) % 2 == 0
    np.testing.assert_array_equal(thinned(every, sparse=False), expected)
    rows = np.array([True, False] * 4 + [True])
    np.testing.assert_array_equal(thinned(every, sparse=True), rows[:, None] & rows)


@pytest.mark.parametrize("grid", [(9, 9), (17, 17), (11, 12)])
def test_a_cross_of_views_stays_whole(grid: tuple[int, int]) -> None:
    """A chessboard has fewer than enough of it."""
    present = cross(grid)
    for sparse in (False, True):
        np.testing.assert_array_equal(thinned(present, sparse=sparse), present)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("grid", [(3, 3), (9, 9), (8, 9), (17, 17), (1, 60), (60, 1), (10, 13)])
def test_thinned_views_agree_with_the_oracle_and_keep_what_they_must(
    grid: tuple[int, int], sparse: bool
) -> None:
    rng = np.random.default_rng([*grid, sparse])
    for share in (1.0, 0.8, 0.5, 0.3, 0.05):
        present = rng.random(grid) < share
        present[grid[0] // 2, grid[1] // 2] = True
        before = present.copy()
        found = thinned(present, sparse=sparse)
        np.testing.assert_array_equal(present, before)
        np.testing.assert_array_equal(found, naive_vis.thinned(present, sparse))
        assert found[grid[0] // 2, grid[1] // 2]
        assert not (found & ~present).any()
        assert found.sum() >= min(FEWEST_VIEWS, present.sum())
        np.testing.assert_array_equal(thinned(present.T, sparse=sparse), found.T)
        np.testing.assert_array_equal(thinned(found, sparse=False), found)


def test_thinned_views_find_the_same_surface() -> None:
    """Truth: at the surface's plane all views agree, whichever are asked."""
    paint = fields.texture(np.random.default_rng(12), shortest=25.0, longest=60.0)
    views = fields.plane_views(paint, 0.43, (9, 9), (30, 34))
    every = np.ones((9, 9), bool)
    for sparse in (False, True):
        present = thinned(every, sparse=sparse)
        lf = LightField(fields.quantise(views[..., None], "uint16"), present=present)
        inner = (slice(4, -4), slice(4, -4))
        assert np.mean(photo_consistency(lf, 0.43)[inner] == 1) > 0.99
        assert photo_consistency(lf, 1.43)[inner].mean() < 0.4


def test_bad_arguments_are_refused() -> None:
    lf = fields.light_field(np.random.default_rng(10), (3, 3), (6, 7), 3)
    with pytest.raises(LightFieldError, match="disparity: found nan"):
        photo_consistency(lf, float("nan"))
    with pytest.raises(LightFieldError, match=r"thresholds: found shape \(7, 6\)"):
        photo_consistency(lf, 0.0, thresholds=np.full((7, 6), 0.01))
    for wrong in (0.0, -0.1, 0.51, float("nan")):
        with pytest.raises(LightFieldError, match="thresholds: found values"):
            photo_consistency(lf, 0.0, thresholds=np.full((6, 7), wrong))
    for options in ((-0.1, 0.01, 0.02), (0.2, 0.0, 0.02), (0.2, 0.03, 0.02), (0.2, 0.01, 0.6)):
        with pytest.raises(LightFieldError, match="thresholds: found slope"):
            local_thresholds(lf.reference, *options)
    with pytest.raises(LightFieldError, match="reference: found float64"):
        local_thresholds(lf.reference.astype(np.float64))
