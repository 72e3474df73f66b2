"""The order of the views, told from the pixels: all eight orders of scenes whose order is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lfdepth
from fields import plane_views, quantise, texture
from lfdepth import scenes
from lfdepth.errors import LightFieldError
from lfdepth.io import read
from lfdepth.io.pixels import write_picture
from lfdepth.lightfield import LightField
from lfdepth.probe.order import AS_STORED, Reordering, check_orientation
from lfdepth.scenes.cameras import Imperfections, spoil

EIGHT = [Reordering(*flags) for flags in product((False, True), repeat=3)]
TELLING = (
    "demo",
    "bars",
    "leaves",
    "sphere",
    "room",
    "noise-3",
    "gloss",
    "fence",
    "range-8",
    "wedges",
    "strips",
)


def disordered(lf: LightField, mends: Reordering) -> LightField:
    """The light field that reading with `mends` puts in order."""

    def undo(grid: np.ndarray) -> np.ndarray:
        grid = grid[:: -1 if mends.flip_v else 1, :: -1 if mends.flip_u else 1]
        return np.ascontiguousarray(grid.swapaxes(0, 1) if mends.transpose else grid)

    present = None if lf.present is None else undo(lf.present)
    return replace(lf, views=undo(lf.views), present=present, truth=None, masks={})


def found(lf: LightField) -> Reordering:
    orientation = check_orientation(lf, threads=2)
    assert orientation.decided
    return orientation.reordering


@pytest.mark.thin(2)
@pytest.mark.parametrize("name", ["cotton", "backgammon"])
def test_all_eight_orders_of_real_scenes(name: str, data_folder: Path) -> None:
    lf = read(data_folder / "hci4d" / name, crop=(130, 130, 192, 192))
    assert [found(disordered(lf, mends)) for mends in EIGHT] == EIGHT


@pytest.mark.slow
def test_all_eight_orders_of_a_lytro_picture(data_folder: Path) -> None:
    lf = read(data_folder / "lytro_bikes_crop_eslf.png")
    assert [found(disordered(lf, mends)) for mends in EIGHT] == EIGHT


@pytest.mark.thin(4)
@pytest.mark.parametrize("name", TELLING)
def test_procedural_scenes(name: str) -> None:
    lf = scenes.render(name, size=128, views=9, seed=1, samples=1)
    assert found(lf) == AS_STORED
    mends = EIGHT[1 + TELLING.index(name) % 7]
    assert found(disordered(lf, mends)) == mends


@pytest.mark.thin(3)
@pytest.mark.parametrize("grid", [(3, 3), (5, 7), (8, 6)])
def test_all_eight_orders_of_other_grids(grid: tuple[int, int]) -> None:
    lf = scenes.render("leaves", size=(96, 128), views=grid, samples=1)
    assert [found(disordered(lf, mends)) for mends in EIGHT] == EIGHT


def test_absent_views_are_not_looked_at() -> None:
    lf = scenes.render("leaves", size=128, views=9, samples=1)
    present = np.zeros((9, 9), np.bool_)
    present[4], present[:, 4] = True, True
    views = np.where(present[:, :, None, None, None], lf.views, 0)
    cross = replace(lf, views=views, present=present)
    assert [found(disordered(cross, mends)) for mends in EIGHT] == EIGHT


@pytest.mark.parametrize(
    "mends",
    [Reordering(), Reordering(flip_u=True), Reordering(transpose=True), Reordering(True, flip_u=True)],
)
def test_one_row_of_views_has_four_orders(mends: Reordering) -> None:
    lf = scenes.render("leaves", size=128, views=9, samples=1)
    row = replace(lf, views=lf.views[4:5])
    assert found(disordered(row, mends)) == mends


@given(st.sampled_from(EIGHT), st.sampled_from(EIGHT))
def test_one_reordering_after_another_is_what_numpy_does(first: Reordering, second: Reordering) -> None:
    def done(order: Reordering, grid: np.ndarray) -> np.ndarray:
        grid = grid.T if order.transpose else grid
        return grid[:: -1 if order.flip_v else 1, :: -1 if order.flip_u else 1]

    grid = np.arange(20).reshape(4, 5)
    np.testing.assert_array_equal(done(second, done(first, grid)), done(first.then(second), grid))


def test_the_message_names_the_options() -> None:
    lf = scenes.render("leaves", size=128, views=5, samples=1)
    assert check_orientation(lf).message == "views are in order"
    assert not check_orientation(lf).wrong
    orientation = check_orientation(disordered(lf, Reordering(transpose=True, flip_u=True)))
    assert orientation.wrong
    assert orientation.message.endswith("; use --transpose --flip-u")


def test_advice_is_for_reading_again() -> None:
    lf = scenes.render("leaves", size=128, views=5, samples=1)
    flipped = disordered(lf, Reordering(flip_u=True))
    orientation = check_orientation(flipped, applied=Reordering(flip_u=True))
    assert orientation.reordering == AS_STORED
    assert orientation.message.endswith("; leave out --flip-u")
    both = check_orientation(flipped, applied=Reordering(flip_v=True))
    assert both.message.endswith("; use --flip-v --flip-u")


def test_without_texture_nothing_is_decided() -> None:
    orientation = check_orientation(LightField(np.full((5, 5, 64, 64, 3), 90, np.uint8)))
    assert not orientation.order_decided
    assert not orientation.wrong
    assert "undecided" in orientation.message


def test_scrambled_views_are_not_put_in_order() -> None:
    lf = scenes.render("leaves", size=128, views=9, samples=1)
    places = np.random.default_rng(0).permutation(81)
    scrambled = lf.views.reshape(81, *lf.shape[2:])[places].reshape(lf.shape)
    assert not check_orientation(replace(lf, views=scrambled)).order_decided


def wall(disparity: float) -> LightField:
    """A wall parallel to the picture: nothing hides anything."""
    paint = texture(np.random.default_rng(0), waves=30)
    return LightField(quantise(plane_views(paint, disparity, (5, 5), (96, 128)), "uint8")[..., None])


def test_without_occlusions_the_sign_is_undecided() -> None:
    orientation = check_orientation(wall(1.5))
    assert orientation.order_decided
    assert not orientation.sign_decided
    assert not orientation.wrong
    assert orientation.message.endswith("if near and far come out swapped, use --flip-v --flip-u")


def test_without_occlusions_rows_and_columns_are_still_compared() -> None:
    orientation = check_orientation(disordered(wall(1.5), Reordering(flip_u=True)))
    assert orientation.wrong
    assert orientation.message.endswith("; use --flip-u, or, if near and far come out swapped, use --flip-v")


def test_a_wall_at_zero_disparity_shows_no_order() -> None:
    assert not check_orientation(wall(0)).order_decided


def test_reading_refuses_views_in_another_order(tmp_path: Path) -> None:
    lf = scenes.render("leaves", size=128, views=5, samples=1)
    np.save(tmp_path / "right.npy", lf.views)
    np.save(tmp_path / "wrong.npy", lf.views[::-1])
    assert lfdepth.read(tmp_path / "right.npy", check=True).shape == lf.shape
    with pytest.raises(
        LightFieldError, match=r"wrong.npy: .*; use --flip-v; in Python read.path, flip_v=True.$"
    ) as error:
        read(tmp_path / "wrong.npy", check=True)
    assert "\n" not in str(error.value)
    assert read(tmp_path / "wrong.npy", check=True, flip_v=True).shape == lf.shape
    with pytest.raises(LightFieldError, match=r"right.npy: .*; leave out --flip-v; in Python read.path.$"):
        read(tmp_path / "right.npy", check=True, flip_v=True)


@pytest.mark.thin(4)
@pytest.mark.parametrize("mends", EIGHT)
def test_reading_names_the_call_that_mends_an_older_hdf5_file(tmp_path: Path, mends: Reordering) -> None:
    """Its columns are taken to run from right to left; whatever they do in a file, the check finds out."""
    views = disordered(scenes.render("demo", size=128, views=5, samples=1), mends).views
    with h5py.File(tmp_path / "lf.h5", "w") as file:
        file["LF"] = views[:, ::-1]
        file.attrs.update(dH=0.02, dV=0.02, focalLength=400.0, shift=0.5)
    if mends == AS_STORED:
        read(tmp_path / "lf.h5", check=True)
        return
    with pytest.raises(LightFieldError, match="views are not in the expected order") as error:
        read(tmp_path / "lf.h5", check=True)
    assert str(error.value).endswith(f"; in Python {mends.call}")
    assert f"use {mends.options}; " in str(error.value)
    options: dict[str, Any] = {name: True for name, needed in vars(mends).items() if needed}
    assert read(tmp_path / "lf.h5", check=True, **options).shape == (5, 5, 128, 128, 3)


def test_reading_warns_if_it_cannot_tell(tmp_path: Path) -> None:
    np.save(tmp_path / "wall.npy", wall(1.5).views)
    with pytest.warns(UserWarning, match=r"wall.npy: .*undecided") as warned:
        read(tmp_path / "wall.npy", check=True)
    assert warned[0].filename == __file__


SPOILED = Imperfections(
    gain=0.1, offset=0.02, white_balance=0.05, falloff=0.6, vignetting=0.7, wandering=0.3, noise=0.002
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cotton", "backgammon"])
def test_all_eight_orders_are_told_where_brightness_differs(name: str, data_folder: Path) -> None:
    lf = spoil(read(data_folder / "hci4d" / name, crop=(130, 130, 192, 192)), SPOILED)
    assert [found(disordered(lf, mends)) for mends in EIGHT] == EIGHT


@pytest.mark.parametrize("mends", EIGHT[::2])
def test_order_is_told_where_brightness_differs(mends: Reordering) -> None:
    lf = scenes.render("leaves", size=128, views=9, seed=1, samples=1)
    assert found(disordered(spoil(lf, SPOILED), mends)) == mends


def wound(lf: LightField) -> LightField:
    views = lf.views.copy()
    views[1::2] = views[1::2, ::-1]
    return replace(lf, views=views, truth=None, masks={})


@pytest.mark.thin(3)
@pytest.mark.parametrize("grid", [(9, 9), (7, 7), (3, 3), (4, 6), (5, 3)])
@pytest.mark.parametrize("name", ["leaves", "room"])
def test_rows_that_run_back_are_told(name: str, grid: tuple[int, int], tmp_path: Path) -> None:
    lf = scenes.render(name, size=96, views=grid, seed=1, samples=1)
    np.save(tmp_path / "wound.npy", wound(lf).views)
    advice = check_orientation(read(tmp_path / "wound.npy"))
    assert advice.wrong
    assert advice.reordering == Reordering(serpentine=True)
    assert "use --serpentine" in advice.message
    assert not check_orientation(read(tmp_path / "wound.npy", serpentine=True)).wrong


@pytest.mark.slow
@pytest.mark.parametrize("mends", EIGHT)
def test_rows_that_run_back_in_a_grid_of_another_order(mends: Reordering, tmp_path: Path) -> None:
    """Whatever options the file was read with, the advice leads to views in order."""
    lf = scenes.render("leaves", size=96, views=(5, 6), seed=1, samples=1)
    np.save(tmp_path / "wound.npy", wound(disordered(lf, mends)).views)
    options: Any
    for options in ({}, {"flip_v": True}, {"transpose": True}, {"serpentine": True, "flip_u": True}):
        got = check_orientation(read(tmp_path / "wound.npy", **options), applied=Reordering(**options))
        assert got.reordering == replace(mends, serpentine=True)
    right: Any = {name: True for name, needed in vars(got.reordering).items() if needed}
    assert read(tmp_path / "wound.npy", check=True, **right).shape == lf.shape


def test_what_wrongly_is_read_as_serpentine_is_told(tmp_path: Path) -> None:
    np.save(tmp_path / "lf.npy", scenes.render("leaves", size=96, views=5, seed=1, samples=1).views)
    with pytest.raises(LightFieldError, match="; leave out --serpentine; in Python"):
        read(tmp_path / "lf.npy", check=True, serpentine=True)


@pytest.mark.parametrize("name", ["leaves", "room"])
def test_nothing_is_advised_that_would_not_help(name: str) -> None:
    """Views that are mixed up, as no reordering and no other grid mends."""
    lf = scenes.render(name, size=96, views=6, seed=1, samples=1)
    mixed = np.random.default_rng(0).permutation(lf.views.reshape(36, *lf.shape[2:])).reshape(lf.shape)
    got = check_orientation(LightField(np.ascontiguousarray(mixed)))
    assert not got.order_decided
    assert not got.wrong
    assert "in no order" in got.message or "undecided" in got.message
    assert not got.options or "use" not in got.message


@pytest.mark.thin(2)
@pytest.mark.parametrize(
    ("taken", "told"),
    [
        ((8, 8), (16, 4)),
        ((8, 8), (64, 1)),
        ((6, 6), (4, 9)),
        ((6, 6), (12, 3)),
        ((6, 6), (2, 18)),
        ((5, 9), (9, 5)),
        ((9, 5), (15, 3)),
        ((7, 7), (1, 49)),
    ],
)
@pytest.mark.parametrize("name", ["leaves", "room", "noise-3", "bars"])
def test_another_grid_is_told(name: str, taken: tuple[int, int], told: tuple[int, int]) -> None:
    lf = scenes.render(name, size=64, views=taken, seed=1, samples=1)
    got = check_orientation(LightField(np.ascontiguousarray(lf.views.reshape(*told, *lf.shape[2:]))))
    assert got.grid == taken
    assert got.wrong
    assert got.options == f"--grid {taken[1]}x{taken[0]}"
    assert f"on another grid than they are read with; use --grid {taken[1]}x{taken[0]}" in got.message
    assert got.call == f"read(path, grid={taken})"


def test_another_grid_that_is_mirrored_is_told(tmp_path: Path) -> None:
    """Columns from right to left, of 6x6 views that are read as 4x9: what is advised reads them in order."""
    lf = scenes.render("leaves", size=96, views=6, seed=1, samples=1)
    np.save(tmp_path / "lf.npy", lf.views[:, ::-1].reshape(9, 4, *lf.shape[2:]))
    with pytest.raises(
        LightFieldError, match=r"use --grid 6x6 --flip-u; in Python read\(path, grid=\(6, 6\)"
    ):
        read(tmp_path / "lf.npy", check=True)
    np.testing.assert_array_equal(
        read(tmp_path / "lf.npy", grid=(6, 6), flip_u=True, check=True).views, lf.views
    )


@pytest.mark.parametrize("told", [(4, 9), (9, 4), (3, 6), (6, 12)])
def test_a_mosaic_that_is_cut_into_other_tiles_is_told(told: tuple[int, int], tmp_path: Path) -> None:
    lf = scenes.render("leaves", size=72, views=6, seed=1, samples=1)
    picture = lf.views.transpose(0, 2, 1, 3, 4).reshape(6 * 72, 6 * 72, 3)
    write_picture(tmp_path / "tiles.png", picture)
    got = check_orientation(read(tmp_path / "tiles.png", format="mosaic", grid=told))
    assert got.grid == (6, 6)
    assert got.options == "--grid 6x6"
