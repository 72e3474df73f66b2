from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lfdepth
from fields import quantise, texture
from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.methods import FAMILY


def random_views(*shape: int, dtype: str = "uint8", seed: int = 0) -> npt.NDArray[Any]:
    rng = np.random.default_rng(seed)
    if dtype == "float32":
        return rng.random(shape, dtype=np.float32)
    return rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


@pytest.mark.parametrize("grid", [(3, 3), (4, 6), (5, 4), (9, 9)])
def test_reference_view_is_at_half_the_grid(grid: tuple[int, int]) -> None:
    views = random_views(*grid, 4, 5, 3)
    lf = LightField(views)
    assert lf.shape == (*grid, 4, 5, 3)
    assert (lf.height, lf.width) == (4, 5)
    assert lf.centre == (grid[0] // 2, grid[1] // 2)
    np.testing.assert_array_equal(lf.reference, views[grid[0] // 2, grid[1] // 2])


@pytest.mark.parametrize(("dtype", "full"), [("uint8", 255), ("uint16", 65535), ("float32", 1)])
@pytest.mark.parametrize("channels", [1, 3])
def test_grey_is_rec_601_on_a_scale_of_255(dtype: str, full: float, channels: int) -> None:
    views = random_views(3, 4, 5, 6, channels, dtype=dtype)
    lf = LightField(views)
    assert lf.full_scale == full
    weights = [0.299, 0.587, 0.114] if channels == 3 else [1.0]
    expected = views.astype(np.float64) @ np.array(weights) * 255 / full
    grey = lf.grey()
    assert grey.shape == (3, 4, 5, 6)
    assert grey.dtype == (np.uint8 if dtype == "uint8" else np.float32)
    np.testing.assert_allclose(grey, expected, atol=0.5001 if dtype == "uint8" else 1e-4)


def test_white_is_white_in_grey() -> None:
    assert (LightField(np.full((3, 3, 2, 2, 3), 255, np.uint8)).grey() == 255).all()


def test_epis_are_slices_of_the_central_row_and_column() -> None:
    views = random_views(4, 5, 6, 7, 3)
    lf = LightField(views)
    np.testing.assert_array_equal(lf.epi_horizontal(2), views[2, :, 2, :, :])
    np.testing.assert_array_equal(lf.epi_vertical(6), views[:, 2, :, 6, :])
    with pytest.raises(LightFieldError, match="y = 6; expected 0 to 5"):
        lf.epi_horizontal(6)
    with pytest.raises(LightFieldError, match="x = -1; expected 0 to 6"):
        lf.epi_vertical(-1)


@given(st.data())
def test_angular_crop_keeps_the_reference_view(data: st.DataObject) -> None:
    v, u = data.draw(st.integers(3, 10)), data.draw(st.integers(3, 10))
    fewer = data.draw(st.integers(3, v)), data.draw(st.integers(3, u))
    views = random_views(v, u, 1, 2, 1, seed=v * u)
    present = np.ones((v, u), bool)
    lf = LightField(views, present=present).angular_crop(*fewer)
    assert lf.shape[:2] == fewer
    assert lf.present is not None
    assert lf.present.shape == fewer
    np.testing.assert_array_equal(lf.reference, views[v // 2, u // 2])


def test_crop_takes_the_window_of_everything() -> None:
    views = random_views(3, 3, 8, 9, 3)
    truth = np.arange(72, dtype=np.float32).reshape(8, 9)
    camera = Camera(100, 35, 25, 4, width=9, height=8)
    lf = LightField(views, camera=camera, truth=truth, masks={"high": truth > 30})
    window = lf.crop(2, 1, 5, 4)
    np.testing.assert_array_equal(window.views, views[:, :, 1:5, 2:7])
    assert window.truth is not None
    np.testing.assert_array_equal(window.truth, truth[1:5, 2:7])
    np.testing.assert_array_equal(window.masks["high"], truth[1:5, 2:7] > 30)
    assert window.camera is not None
    np.testing.assert_allclose(window.camera.points(window.truth), camera.points(truth)[1:5, 2:7])


@pytest.mark.parametrize("window", [(0, 0, 10, 1), (-1, 0, 2, 2), (0, 8, 1, 1), (0, 0, 0, 2)])
def test_crop_outside_is_refused(window: tuple[int, int, int, int]) -> None:
    with pytest.raises(LightFieldError, match="leaves the views; expected a window inside 9x8 px"):
        LightField(random_views(3, 3, 8, 9, 1)).crop(*window)


@pytest.mark.parametrize(
    ("dtype", "wider"), [("uint8", "uint16"), ("uint8", "float32"), ("uint16", "float32")]
)
def test_samples_survive_a_wider_type(dtype: str, wider: str) -> None:
    count = 2 ** (8 * np.dtype(dtype).itemsize)
    views = np.resize(np.arange(count), (3, 3, 1, count // 8, 1)).astype(dtype)
    lf = LightField(views)
    wide = lf.with_samples(wider)
    assert wide.views.dtype == wider
    assert float(wide.views.max()) / wide.full_scale == float(views.max()) / lf.full_scale
    np.testing.assert_array_equal(wide.with_samples(dtype).views, views)
    assert lf.with_samples(dtype) is lf


def test_samples_are_rounded_to_a_narrower_type() -> None:
    views = np.array([0, 128, 129, 385, 386, 65535], np.uint16).reshape(1, 6, 1, 1, 1)
    assert LightField(views).with_samples("uint8").views.ravel().tolist() == [0, 0, 1, 1, 2, 255]
    with pytest.raises(LightFieldError, match="samples 'int16'; expected uint8, uint16, float32"):
        LightField(views).with_samples("int16")


def test_angular_crop_beyond_the_grid_is_refused() -> None:
    with pytest.raises(LightFieldError, match="7 views asked for along an axis that has 5"):
        LightField(random_views(5, 9, 2, 2, 1)).angular_crop(7, 3)


GOOD = random_views(3, 4, 5, 6, 3)
MAP = np.zeros((5, 6), np.float32)


DEFAULTS: dict[str, Any] = {"views": GOOD, "name": "cotton"}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"views": GOOD[0]}, r"shape \(4, 5, 6, 3\); expected \(V, U, H, W, C\)"),
        ({"views": GOOD[..., :2]}, "C = 1 or 3"),
        ({"views": GOOD[:1, :1]}, "expected at least two views, with pixels; add views"),
        ({"views": GOOD[:, :, :0]}, "expected at least two views, with pixels; add views"),
        ({"views": GOOD.astype(np.float64)}, "views are float64; expected uint8, uint16 or float32"),
        ({"views": GOOD.astype(np.float32)}, r"float views span \[.*\]; expected finite values in \[0, 1\]"),
        ({"views": np.full((3, 3, 2, 2, 1), np.nan, np.float32)}, "float views span"),
        ({"disparity_range": (1.0, 1.0)}, r"disparity range: found \[1, 1\], expected MIN below MAX"),
        ({"disparity_range": (-1.0, float("inf"))}, r"range: found \[-1, inf\], expected finite"),
        ({"disparity_range": (float("nan"), 1.0)}, r"range: found \[nan, 1\]"),
        ({"truth": MAP[1:]}, r"truth is float32 \(4, 6\); expected float32 \(5, 6\)"),
        ({"truth": MAP.astype(np.float64)}, "truth is float64"),
        (
            {"positions": np.zeros((3, 4, 1))},
            r"positions are float64 \(3, 4, 1\); expected float64 \(3, 4, 2\)",
        ),
        ({"positions": np.ones((3, 4, 2))}, "not 0 for the reference view"),
        ({"masks": {"planes": MAP}}, r"mask 'planes' is float32 \(5, 6\); expected bool"),
        ({"present": np.ones((3, 3), bool)}, r"present is bool \(3, 3\); expected bool \(3, 4\)"),
        ({"present": np.zeros((3, 4), bool)}, r"reference view \(1, 2\) is absent"),
        (
            {"camera": Camera(100, 35, 25, 4, width=6, height=6)},
            "camera is for 6x6 px; expected the views' 6x5",
        ),
    ],
)
def test_bad_light_fields_are_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(LightFieldError, match=message) as caught:
        LightField(**DEFAULTS | fields)
    assert str(caught.value).startswith("cotton: ")
    assert "\n" not in str(caught.value)


def test_views_stand_at_their_positions_for_every_method() -> None:
    """Truth: a plane seen by cameras off the grid, in rows half as far apart as columns."""
    rng = np.random.default_rng(3)
    grid, size, disparity = (5, 5), (40, 44), 0.6
    positions = rng.uniform(-0.2, 0.2, (*grid, 2))
    positions[..., 0] += np.arange(-2, 3)[:, None] * -0.5
    positions -= positions[2, 2]
    paint = texture(rng)
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float64)
    views = np.zeros((*grid, *size, 1))
    for v, u in np.ndindex(*grid):
        down, right = np.array([v - 2, u - 2]) + positions[v, u]
        views[v, u, ..., 0] = paint(x + disparity * right, y + disparity * down)
    samples, ends = quantise(views, "uint8"), (-0.5, 1.5)
    inner = (slice(6, -6), slice(6, -6))
    for name in FAMILY:
        placed = LightField(samples, positions=positions, disparity_range=ends)
        off = np.abs(lfdepth.estimate(placed, name).disparity - disparity)[inner]
        assert np.mean(off > 0.07) < 0.02, name
        blind = lfdepth.estimate(LightField(samples, disparity_range=ends), name).disparity
        assert np.mean(np.abs(blind - disparity)[inner] > 0.07) > 0.3, name
