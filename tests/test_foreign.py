"""Views of another scene, mirrored, black or white are found; views of the same scene never are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

import lfdepth
from fields import Array, Texture
from lfdepth import scenes
from lfdepth.lightfield import LightField, grid_offsets


def grain(rng: np.random.Generator) -> Texture:
    """A picture of grains of 1 to 25 px, between whose pixels levels change linearly."""
    noise = rng.standard_normal((200, 200))
    smooth = [gaussian_filter(noise, width) for width in (1.2, 3.0, 9.0, 25.0)]
    picture = sum(
        weight * part / part.std() for weight, part in zip((1.0, 1.2, 1.5, 1.5), smooth, strict=True)
    )
    levels = np.clip(0.5 + 0.16 * picture / np.std(picture), 0.03, 0.97)
    return lambda x, y: np.asarray(map_coordinates(levels, [y + 50, x + 50], order=1, mode="reflect"))


def fine_field(seed: int, grid: tuple[int, int], stray: float) -> LightField:
    """A disc before a wall, of fine grain in colour, from cameras off the grid by that many steps."""
    rng = np.random.default_rng(seed)
    steps = grid_offsets(grid) + stray * rng.standard_normal((*grid, 2))
    y, x = np.mgrid[:80, :104].astype(float)
    views = np.empty((*grid, *y.shape, 3))
    for channel in range(3):
        wall, front = grain(rng), grain(rng)
        for index in np.ndindex(*grid):
            down, across = steps[index] - steps[grid[0] // 2, grid[1] // 2]
            far = 1 + 0.005 * (40 - y)
            disc = (x + across - 45) ** 2 + (y + down - 40) ** 2 < 20**2
            levels = np.where(disc, front(x + across, y + down), wall(x - far * across, y - far * down))
            views[(*index, ..., channel)] = levels
    return LightField(np.rint(255 * views).astype(np.uint8))


@pytest.mark.parametrize(("seed", "grid", "stray"), [(1, (7, 7), 0.05), (3, (7, 7), 0.05), (0, (9, 9), 0.1)])
def test_cameras_off_the_grid_are_not_foreign(seed: int, grid: tuple[int, int], stray: float) -> None:
    found = lfdepth.measure_brightness(fine_field(seed, grid, stray))
    assert found.samples
    assert not found.left_out.any()


def test_outer_views_that_show_less_and_less_are_not_foreign() -> None:
    lf = scenes.render("range-8", size=96, views=13, samples=1)
    assert not lfdepth.measure_brightness(LightField(lf.views)).left_out.any()


def mirrored(view: Array) -> Array:
    """The view, left and right swapped."""
    return view[:, ::-1]


def of_another_scene(view: Array) -> Array:
    """A view of the same size of another scene."""
    return np.asarray(scenes.render("solids", size=view.shape[:2], views=3, samples=1).views[1, 1])


SPOILED: dict[str, Callable[[Array], Any]] = {
    "mirrored": mirrored,
    "upside down": np.flipud,
    "of another scene": of_another_scene,
    "black": np.zeros_like,
    "white": lambda view: np.full_like(view, 255),
    "dim": lambda view: np.rint(0.15 * view),
}


@pytest.mark.parametrize("noise", [0, 6])
@pytest.mark.parametrize("how", SPOILED)
def test_a_view_that_shows_something_else_is_left_out(how: str, noise: float) -> None:
    views = scenes.render("leaves", size=96, views=5, samples=1).views.astype(float)
    views[1, 4] = SPOILED[how](views[1, 4])
    views += noise * np.random.default_rng(0).standard_normal(views.shape)
    found = lfdepth.measure_brightness(LightField(np.rint(np.clip(views, 0, 255)).astype(np.uint8)))
    assert np.argwhere(found.left_out).tolist() == [[1, 4]]
    assert found.message.endswith("1 dark or foreign view ignored")


def test_many_views_out_of_their_place_are_not_foreign() -> None:
    """It is the order that is wrong then, which has a warning of its own."""
    views = scenes.render("leaves", size=96, views=5, samples=1).views.copy()
    views[1::2] = views[1::2, ::-1]
    assert not lfdepth.measure_brightness(LightField(views)).left_out.any()
