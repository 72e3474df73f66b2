"""Refocusing, seeing through occluders and masks, against geometry that is known exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

import lfdepth
from fields import plane_views, quantise, random_present, texture, two_planes
from lfdepth import scenes
from lfdepth.blocks.occlusion import mask_4d
from lfdepth.blocks.reparam import reparameterise
from lfdepth.errors import LightFieldError
from lfdepth.io.picture import read_picture
from lfdepth.io.pixels import write_picture
from lfdepth.lightfield import LightField
from lfdepth.render.refocus import all_in_focus, foreground_masks, refocus, write_masks
from lfdepth.scenes import rendering
from lfdepth.scenes.suite import SUITE, Stage

Array = NDArray[Any]


def rectangle_before_wall(
    near: float, far: float, grid: tuple[int, int] = (5, 5), size: tuple[int, int] = (48, 64)
) -> LightField:
    views, truth = two_planes(np.random.default_rng(2), grid, size, near, far)
    return LightField(quantise(views[..., None], "float32"), truth=truth.astype(np.float32))


def exact_masks(lf: LightField, near: float) -> NDArray[np.bool_]:
    """Where each view of `rectangle_before_wall` shows the rectangle."""
    rows, columns, height, width, _ = lf.shape
    v = np.arange(rows)[:, None, None, None] - rows // 2
    u = np.arange(columns)[None, :, None, None] - columns // 2
    y, x = np.mgrid[:height, :width].astype(float)
    inside_x = abs(x + near * u - 0.45 * width) < 0.2 * width
    return np.asarray(inside_x & (abs(y + near * v - 0.5 * height) < 0.25 * height))


def truth_of(lf: LightField) -> NDArray[np.float32]:
    assert lf.truth is not None
    return lf.truth


def grown(masks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Masks (V, U, H, W) and the pixels beside them."""
    padded = np.pad(masks, ((0, 0), (0, 0), (1, 1), (1, 1)), "edge")
    height, width = masks.shape[2:]
    shifts = [(y, x) for y in range(3) for x in range(3)]
    return np.asarray(np.any([padded[:, :, y : y + height, x : x + width] for y, x in shifts], axis=0))


def rms(a: Array, b: Array, where: Array | None = None) -> float:
    squared = (a.astype(float) - b.astype(float)) ** 2
    return float(np.sqrt(squared.mean() if where is None else squared[where].mean()))


@given(
    grid=st.sampled_from([(3, 3), (4, 6), (1, 5), (5, 1)]),
    dtype=st.sampled_from(["uint8", "uint16", "float32"]),
    disparity=st.floats(-3, 3),
    grey=st.integers(0, 255),
)
@settings(max_examples=20, deadline=None)
def test_a_constant_picture_stays_constant(
    grid: tuple[int, int], dtype: str, disparity: float, grey: int
) -> None:
    value = {"uint8": grey, "uint16": grey * 257, "float32": grey / 255}[dtype]
    lf = LightField(np.full((*grid, 9, 12, 3), value, dtype))
    picture = refocus(lf, disparity)
    assert picture.dtype == lf.views.dtype
    np.testing.assert_allclose(picture, lf.reference, rtol=1e-6)


@given(
    quarters=st.integers(-6, 6),  # which bilinear weights in 32 parts represent exactly
    grid=st.sampled_from([(3, 3), (5, 4), (1, 5), (5, 1)]),
    seed=st.integers(0, 99),
)
@settings(max_examples=20, deadline=None)
def test_it_is_the_mean_of_the_shifted_views(quarters: int, grid: tuple[int, int], seed: int) -> None:
    disparity = quarters / 4
    views = np.random.default_rng(seed).random((*grid, 14, 16, 1), np.float32)
    inside = slice(5, -5)  # beyond, the shifted views repeat their border, which the mean leaves out
    mean = reparameterise(views, disparity).mean(axis=(0, 1))
    np.testing.assert_allclose(
        refocus(LightField(views), disparity)[inside, inside], mean[inside, inside], atol=1e-6
    )


@pytest.mark.parametrize("grid", [(5, 5), (1, 7), (4, 4)])
@pytest.mark.parametrize("disparity", [-2, 1, 3])
def test_a_plane_in_focus_is_the_reference_view_up_to_its_border(
    disparity: int, grid: tuple[int, int]
) -> None:
    paint = texture(np.random.default_rng(0))
    lf = LightField(quantise(plane_views(paint, disparity, grid, (32, 40))[..., None], "uint16"))
    np.testing.assert_array_equal(refocus(lf, disparity), lf.reference)
    assert refocus(lf, disparity + 2).std() < 0.7 * lf.reference.std()


def test_a_point_is_sharp_at_its_disparity_and_spread_elsewhere() -> None:
    views = np.zeros((5, 5, 31, 31, 1), np.float32)
    for v, u in np.ndindex(5, 5):
        views[v, u, 15 - 2 * (v - 2), 15 - 2 * (u - 2)] = 1  # D = 2
    lf = LightField(views)
    sharp, blurred = refocus(lf, 2)[..., 0], refocus(lf, 0)[..., 0]
    assert sharp[15, 15] == 1
    assert sharp.sum() == 1
    np.testing.assert_allclose(blurred[blurred > 0], np.full(25, 1 / 25), rtol=1e-6)


def test_absent_views_do_not_count() -> None:
    rng = np.random.default_rng(0)
    present = random_present(rng, (5, 5))
    views = np.zeros((5, 5, 20, 24, 1), np.uint8)
    views[present] = 90
    lf = LightField(views, present=present)
    surface = rng.uniform(-1, 1, (20, 24)).astype(np.float32)
    assert (refocus(lf, 0.7) == 90).all()
    assert (all_in_focus(lf, surface) == 90).all()
    assert (refocus(lf, -1, without_foreground=0, disparity_map=surface) == 90).all()
    masks = foreground_masks(lf, np.ones_like(surface), 0)
    np.testing.assert_array_equal(masks.any(axis=(2, 3)), present)


@pytest.mark.parametrize("grid", [(5, 5), (4, 6), (1, 7)])
def test_all_in_focus_with_the_exact_map_is_the_reference_view(grid: tuple[int, int]) -> None:
    lf = rectangle_before_wall(near=1, far=-1, grid=grid)
    np.testing.assert_allclose(all_in_focus(lf, truth_of(lf)), lf.reference, atol=1e-6)


def test_all_in_focus_of_a_rendered_scene_has_less_noise_than_the_reference_view() -> None:
    options: dict[str, Any] = {"size": 128, "views": 7, "samples": 2}
    clean, noisy = (scenes.render("demo", noise=noise, **options) for noise in (0.0, 8.0))
    picture = all_in_focus(noisy, truth_of(noisy))
    smooth = ~clean.masks["occlusion_boundary"]
    assert rms(all_in_focus(clean, truth_of(clean)), clean.reference, smooth) < 2.5
    assert rms(picture, clean.reference, smooth) < rms(noisy.reference, clean.reference, smooth) / 3


@pytest.mark.parametrize("grid", [(5, 5), (4, 4), (1, 5), (5, 1)])
def test_masks_are_exact_at_whole_disparities(grid: tuple[int, int]) -> None:
    lf = rectangle_before_wall(near=2, far=-1, grid=grid)
    np.testing.assert_array_equal(foreground_masks(lf, truth_of(lf), 0.5), exact_masks(lf, 2))


def test_masks_at_fractions_are_wrong_by_a_pixel_at_most() -> None:
    lf = rectangle_before_wall(near=0.8, far=-0.6)
    masks, exact = foreground_masks(lf, truth_of(lf), 0), exact_masks(lf, 0.8)
    assert (masks <= grown(exact)).all()
    assert (masks >= ~grown(~exact)).all()


@pytest.mark.parametrize("at", [-1, 0, 2, 3])
def test_masks_of_one_plane_are_those_of_the_paper(at: int) -> None:
    lf = rectangle_before_wall(near=2, far=-1)
    surface = truth_of(lf)
    paper = mask_4d(surface > 0, found_at=2, wanted_at=at, views=(5, 5)) > 0.5
    np.testing.assert_array_equal(foreground_masks(lf, surface, 0, at=at), paper)


def test_masks_of_a_rendered_fence_hold_what_the_fence_changes() -> None:
    """But for pixels that it covers only in part, at its rim."""
    lf, behind = fence_and_what_is_behind(96)
    changed = abs(lf.views.astype(int) - behind.views.astype(int)).max(axis=-1) > 40
    masks = foreground_masks(lf, truth_of(lf), 0.8)
    inner = np.s_[:, :, 8:-8, 8:-8]  # the reference view sees all of the fence that is in there
    assert (changed & ~masks)[inner].sum() < 0.06 * changed[inner].sum()
    assert (changed & ~grown(masks))[inner].sum() < 0.001 * changed[inner].sum()
    assert masks[inner].mean() < 0.4


def test_a_slanted_surface_has_no_gaps_in_views_that_see_it_wider() -> None:
    surface = np.full((20, 60), -1, np.float32)
    surface[5:15, 20:40] = 1 + 0.12 * np.arange(20)
    lf = LightField(np.zeros((9, 9, 20, 60, 1), np.uint8))
    rows = foreground_masks(lf, surface, 0)[4, :, 7]
    starts = np.count_nonzero(np.diff(rows.astype(int), axis=1) == 1, axis=1)
    assert (starts == 1).all()
    assert rows[0].sum() > 25 > 15 > rows[-1].sum()


def fence_and_what_is_behind(size: int) -> tuple[LightField, LightField]:
    scene = SUITE["fence"].build(Stage(size, size, 0))
    behind = replace(scene, layers=scene.layers[:-3])  # without mesh and posts
    both = [rendering.render(s, "fence", (size, size), (7, 7), 0, None, 2).lf for s in (scene, behind)]
    return both[0], both[1]


def test_it_sees_through_a_fence() -> None:
    lf, behind = fence_and_what_is_behind(128)
    plane = -1.2
    in_focus = abs(truth_of(behind) - plane) < 0.2
    plain = refocus(lf, plane)
    through = refocus(lf, plane, without_foreground=0.8, disparity_map=truth_of(lf))
    result: Any = SimpleNamespace(disparity=truth_of(lf))
    np.testing.assert_array_equal(through, refocus(lf, plane, without_foreground=0.8, disparity_map=result))
    assert rms(plain, behind.reference, in_focus) < rms(lf.reference, behind.reference, in_focus)
    assert rms(through, behind.reference, in_focus) < rms(plain, behind.reference, in_focus) / 2.5


def test_where_all_views_are_covered_it_shows_them() -> None:
    lf = rectangle_before_wall(near=1, far=-1)
    everywhere = np.ones_like(truth_of(lf))
    hidden = refocus(lf, -1, without_foreground=0, disparity_map=everywhere)
    inner = slice(6, -6)  # the map does not say what lies outside the frame
    np.testing.assert_array_equal(hidden[inner, inner], refocus(lf, -1)[inner, inner])


def test_the_number_of_threads_makes_no_difference() -> None:
    lf = rectangle_before_wall(near=0.9, far=-0.3, size=(80, 70))
    surface = truth_of(lf)
    for options in (
        {"disparity": 0.4},
        {"disparity": -0.3, "without_foreground": 0, "disparity_map": surface},
    ):
        one, three = (refocus(lf, threads=threads, **options) for threads in (1, 3))
        np.testing.assert_array_equal(one, three)
    np.testing.assert_array_equal(all_in_focus(lf, surface, threads=1), all_in_focus(lf, surface, threads=3))


def test_what_cannot_be_done_is_said() -> None:
    lf = rectangle_before_wall(near=1, far=-1)
    surface = truth_of(lf)
    with pytest.raises(LightFieldError, match="disparity: found nan"):
        refocus(lf, float("nan"))
    with pytest.raises(LightFieldError, match="disparity_map: found none"):
        refocus(lf, -1, without_foreground=0)
    with pytest.raises(
        LightFieldError, match="without_foreground: found 0, expected at least the focused plane's 1 px"
    ):
        refocus(lf, 1, without_foreground=0, disparity_map=surface)
    with pytest.raises(LightFieldError, match="disparity_map: found 63x48 px, expected 64x48"):
        all_in_focus(lf, surface[:, 1:])
    with pytest.raises(LightFieldError, match="disparity_map: 1 of 3072 values are NaN"):
        foreground_masks(lf, np.where(np.arange(64) + 64 * np.arange(48)[:, None], surface, np.nan), 0)
    with pytest.raises(LightFieldError, match="at: found inf"):
        foreground_masks(lf, surface, 0, at=float("inf"))


def test_masks_are_written_and_read_back(tmp_path: Path) -> None:
    lf = rectangle_before_wall(near=1, far=-1)
    masks = foreground_masks(lf, truth_of(lf), 0)
    folder = tmp_path / "masks of é"
    write_masks(folder, masks, lf)
    write_masks(folder, ~masks, lf)  # replaces them
    assert len(list(folder.glob("*.png"))) == 25
    with Image.open(folder / "mask_v01_u03.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture) > 127, ~masks[1, 3])
    np.testing.assert_array_equal(lfdepth.read(folder).views[..., 0] > 127, ~masks)


def test_no_masks_are_written_for_absent_views(tmp_path: Path) -> None:
    lf = rectangle_before_wall(near=1, far=-1)
    present = np.ones((5, 5), np.bool_)
    present[0, 1] = False
    lf = replace(lf, present=present)
    write_masks(tmp_path / "masks", foreground_masks(lf, truth_of(lf), 0), lf)
    names = {path.name for path in (tmp_path / "masks").glob("*.png")}
    assert len(names) == 24
    assert "mask_v00_u01.png" not in names


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    lf = rectangle_before_wall(near=1, far=-1)
    masks = foreground_masks(lf, truth_of(lf), 0)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/mask_v00_u00.png").touch()
    (tmp_path / "mine/holiday.jpg").touch()
    with pytest.raises(LightFieldError, match="mine: is a folder"):
        write_masks(tmp_path / "mine", masks, lf)
    with pytest.raises(LightFieldError, match=r"masks have shape \(4, 5, 48, 64\)"):
        write_masks(tmp_path / "new", masks[1:], lf)
    assert {path.name for path in tmp_path.iterdir()} == {"mine"}
    assert len(list((tmp_path / "mine").iterdir())) == 2


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_pictures_are_read_back(tmp_path: Path, dtype: str, channels: int) -> None:
    values = np.random.default_rng(0).random((6, 7, channels))
    picture = (
        values.astype(np.float32) if dtype == "float32" else (values * np.iinfo(dtype).max).astype(dtype)
    )
    write_picture(tmp_path / "p.png", picture)
    back = read_picture(tmp_path / "p.png")
    if dtype == "float32":
        np.testing.assert_allclose(back / 65535, picture, atol=0.5 / 65535)
    else:
        np.testing.assert_array_equal(back, picture)
    with pytest.raises(LightFieldError, match=r"p.jpg: pictures are PNG files"):
        write_picture(tmp_path / "p.jpg", picture)
