import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError

COTTON = Camera(
    focal_length_mm=100, sensor_size_mm=35, baseline_mm=25, focus_distance_m=4.25, width=512, height=512
)


@given(depth=st.floats(0.1, 1e4), width=st.integers(1, 2000), height=st.integers(1, 2000))
def test_disparity_is_the_benchmarks_formula(depth: float, width: int, height: int) -> None:
    camera = replace(COTTON, width=width, height=height)
    beta = 25 * 100 * max(width, height)
    focus = 4250.0
    expected = (beta * focus / (depth * 1000) - beta) / (focus * 35)
    assert camera.depth_to_disparity(depth) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert camera.disparity_to_depth(expected) == pytest.approx(depth, rel=1e-6)


def test_zero_disparity_is_the_focus_distance() -> None:
    assert COTTON.disparity_to_depth(0) == pytest.approx(4.25)


def test_disparity_beyond_infinity_is_infinitely_far() -> None:
    infinity = float(COTTON.depth_to_disparity(np.inf))
    depth = COTTON.disparity_to_depth([infinity, infinity - 1, infinity + 1e-3, np.nan])
    assert np.isinf(depth[:2]).all()
    assert np.isfinite(depth[2])
    assert np.isnan(depth[3])


def test_parallel_cameras_see_infinity_at_zero() -> None:
    camera = replace(COTTON, focus_distance_m=float("inf"))
    assert camera.depth_to_disparity(np.inf) == 0
    assert camera.disparity_to_depth(0.0) == np.inf


def test_points_project_into_every_view_by_the_sign_convention() -> None:
    camera = replace(COTTON, width=7, height=5)
    disparity = np.random.default_rng(0).uniform(-0.1, 1.5, (5, 7))
    points = camera.points(disparity)
    pixels_per_slope = camera.focal_length_mm / camera.pixel_pitch_mm
    y, x = np.mgrid[:5, :7]
    for u, v in ((0, 0), (1, 0), (-2, 3)):
        seen = points - np.array([u, v, 0]) * camera.baseline_mm / 1000
        # The pictures of a benchmark light field are shifted so that the focus distance has no disparity.
        shift = camera.baseline_mm / 1000 * pixels_per_slope / camera.focus_distance_m
        in_x = seen[..., 0] / seen[..., 2] * pixels_per_slope + 3 + u * shift
        in_y = seen[..., 1] / seen[..., 2] * pixels_per_slope + 2 + v * shift
        np.testing.assert_allclose(in_x, x - disparity * u, atol=1e-9)
        np.testing.assert_allclose(in_y, y - disparity * v, atol=1e-9)


def test_crop_keeps_the_points() -> None:
    camera = replace(COTTON, width=20, height=12)
    disparity = np.random.default_rng(1).uniform(-1, 1, (12, 20))
    window = camera.crop(3, 4, 6, 8).crop(1, 1, 5, 7)
    np.testing.assert_allclose(window.points(disparity[5:12, 4:9]), camera.points(disparity)[5:12, 4:9])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("baseline_mm", 0.0),
        ("focal_length_mm", float("nan")),
        ("sensor_size_mm", -35.0),
        ("focus_distance_m", 0.0),
        ("width", 0),
        ("height", float("inf")),
    ],
)
def test_impossible_cameras_are_named(field: str, value: float) -> None:
    with pytest.raises(LightFieldError, match=f"camera: {field} is {value}; expected a positive"):
        replace(COTTON, **{field: value})  # type: ignore[arg-type]


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(LightFieldError, match="smallest value is -2 m"):
        COTTON.depth_to_disparity([1.0, -2.0])
    with pytest.raises(LightFieldError, match=re.escape("shape is (3, 4)")):
        COTTON.points(np.zeros((3, 4)))


def test_benchmark_depth_map_agrees(data_folder: Path) -> None:
    from lfdepth.io.pfm import read_pfm

    disparity = read_pfm(data_folder / "hci4d/cotton/gt_disp_lowres.pfm")
    depth = read_pfm(data_folder / "hci4d/cotton/gt_depth_lowres.pfm")
    # Both were rendered; at occlusion boundaries each was averaged over the pixel on its own.
    assert np.median(np.abs(COTTON.disparity_to_depth(disparity) - depth)) < 1e-4
