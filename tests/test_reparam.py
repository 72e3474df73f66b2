"""Grey levels and reparameterisation (eq. 1) against the oracle."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fields
import naive
from lfdepth.blocks.reparam import reparameterise
from lfdepth.engines import layout
from lfdepth.engines.layout import grey_levels
from lfdepth.errors import LightFieldError

DISPARITIES = [0.0, 0.25, 0.371, -0.6, 1.0, -2.0, 3.613, -5.27, 40.0]
GRIDS = [(3, 3), (4, 5), (5, 4), (6, 3), (1, 5)]


def test_the_oracle_knows_the_conventions() -> None:
    assert (naive.UNIT, naive.LEVELS) == (layout.GREY_UNIT, layout.GREY_WHITE)


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_grey_levels_are_the_nearest_to_rec_601(dtype: str, channels: int) -> None:
    rng = np.random.default_rng(1)
    top = {"uint8": 256, "uint16": 65536}.get(dtype)
    shape = (60, 70, channels)
    views = rng.integers(0, top, shape).astype(dtype) if top else rng.random(shape, np.float32)
    exact = naive.luma(views) * naive.LEVELS
    found = grey_levels(views).astype(np.float64)
    assert np.abs(found - exact).max() <= 0.5 + 1e-3
    assert (found == np.rint(found)).all()


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_black_and_white_are_the_ends_of_the_levels(dtype: str, channels: int) -> None:
    white = {"uint8": 255, "uint16": 65535}.get(dtype, 1)
    assert (grey_levels(np.zeros((2, 2, channels), dtype)) == 0).all()
    assert (grey_levels(np.full((2, 2, channels), white, dtype)) == naive.LEVELS).all()


@pytest.mark.parametrize("kind", fields.TEXTURES)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_grey_levels_agree_with_the_oracle(kind: str, dtype: str, channels: int) -> None:
    lf = fields.light_field(np.random.default_rng(2), (3, 3), (15, 17), channels, dtype, kind)
    np.testing.assert_array_equal(grey_levels(lf.views), naive.levels(lf.views))


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("disparity", DISPARITIES)
def test_reparameterisation_agrees_with_the_oracle(grid: tuple[int, int], disparity: float) -> None:
    views = np.random.default_rng(3).integers(0, 256, (*grid, 9, 14))
    expected = naive.reparameterise(views, disparity) / naive.UNIT
    for dtype in (np.uint8, np.uint16, np.float32):
        np.testing.assert_array_equal(reparameterise(views.astype(dtype), disparity), expected)


def test_channels_move_together() -> None:
    views = np.random.default_rng(4).random((4, 3, 8, 9, 3), np.float32)
    expected = np.stack([naive.reparameterise(views[..., c], -1.3) / naive.UNIT for c in range(3)], axis=-1)
    np.testing.assert_allclose(reparameterise(views, -1.3), expected, atol=1e-6)


def exact_sample(image: NDArray[Any], x: float, y: float) -> float:
    """Bilinear interpolation at one point, without any rounding of the position."""
    height, width = image.shape
    column, row = int(np.floor(x)), int(np.floor(y))

    def at(i: int, j: int) -> float:
        return float(image[min(max(i, 0), height - 1), min(max(j, 0), width - 1)])

    a, b = x - column, y - row
    upper = (1 - a) * at(row, column) + a * at(row, column + 1)
    lower = (1 - a) * at(row + 1, column) + a * at(row + 1, column + 1)
    return (1 - b) * upper + b * lower


@pytest.mark.parametrize("disparity", [0.3, -1.17, 2.5])
def test_rounding_of_shifts_stays_within_its_bound(disparity: float) -> None:
    """Against eq. 1 itself: a shift is at most 1/(2·UNIT) px off along either axis, and so is a weight."""
    views = np.random.default_rng(5).random((5, 4, 7, 8))
    found = reparameterise(views, disparity)
    bound = 2.5 / naive.UNIT
    for i, j, y, x in np.ndindex(*views.shape):
        exact = exact_sample(views[i, j], x - (j - 2) * disparity, y - (i - 2) * disparity)
        assert abs(found[i, j, y, x] - exact) < bound


def test_a_picture_on_the_plane_falls_into_register() -> None:
    """Truth: a scene on one plane looks the same in all views once it is reparameterised to that plane."""
    paint = fields.texture(np.random.default_rng(6), shortest=12.0)
    views = fields.plane_views(paint, 0.75, (5, 5), (30, 34))
    inner = (..., slice(5, -5), slice(5, -5))
    in_register = reparameterise(views, 0.75)[inner]
    elsewhere = reparameterise(views, 0.25)[inner]
    reference = views[2, 2][inner]
    assert np.abs(in_register - reference).max() < 0.05
    assert np.abs(elsewhere - reference).max() > 0.2


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(LightFieldError, match="views: found shape"):
        reparameterise(np.zeros((3, 3, 4)), 0.0)
    with pytest.raises(LightFieldError, match="disparity: found nan"):
        reparameterise(np.zeros((3, 3, 4, 4)), float("nan"))
