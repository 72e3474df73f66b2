"""What is read of a light field: reordering, fewer views, crops, scaling; and how little is loaded for it."""

import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lfdepth.camera import Camera, CameraOptions
from lfdepth.errors import LightFieldError
from lfdepth.io import read
from lfdepth.io.layout import Layout
from lfdepth.io.scaling import scale_nearest, scale_view
from lfdepth.io.source import Selection, ViewSource, assemble
from lfdepth.lightfield import LightField

KEEP_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
CAMERA = Camera(100, 35, 25, 4.25, width=12, height=10)


def source(views: npt.NDArray[Any], **fields: Any) -> ViewSource:
    return ViewSource(
        grid=(views.shape[0], views.shape[1]),
        read_view=lambda v, u: views[v, u],
        describe=lambda v, u: f"view ({v}, {u})",
        **fields,
    )


def random_views(*shape: int) -> npt.NDArray[Any]:
    return np.random.default_rng(0).integers(0, 256, shape, np.uint8)


@given(
    grid=st.tuples(st.integers(3, 6), st.integers(3, 6)),
    transpose=st.booleans(),
    flip_v=st.booleans(),
    flip_u=st.booleans(),
    data=st.data(),
)
def test_reordering_is_what_numpy_does(
    grid: tuple[int, int], transpose: bool, flip_v: bool, flip_u: bool, data: st.DataObject
) -> None:
    views = random_views(*grid, 2, 3, 1)
    expected = views.swapaxes(0, 1) if transpose else views
    expected = expected[:: -1 if flip_v else 1, :: -1 if flip_u else 1]
    lf = assemble(source(views), Selection(transpose=transpose, flip_v=flip_v, flip_u=flip_u))
    np.testing.assert_array_equal(lf.views, expected)
    fewer = data.draw(st.integers(3, expected.shape[0])), data.draw(st.integers(3, expected.shape[1]))
    chosen = Selection(views=fewer, transpose=transpose, flip_v=flip_v, flip_u=flip_u)
    np.testing.assert_array_equal(
        assemble(source(views), chosen).views, LightField(expected).angular_crop(*fewer).views
    )


def test_truth_goes_when_the_reference_view_does() -> None:
    truth = np.zeros((2, 3), np.float32)
    odd = source(random_views(3, 5, 2, 3, 1), truth=truth, masks={"m": truth > 0})
    even = source(random_views(3, 4, 2, 3, 1), truth=truth, masks={"m": truth > 0})
    assert assemble(odd, Selection(flip_u=True, flip_v=True, transpose=True)).truth is not None
    assert assemble(even, Selection(flip_v=True)).truth is not None
    flipped = assemble(even, Selection(flip_u=True))
    assert flipped.truth is None
    assert flipped.masks == {}


@given(
    x=st.integers(0, 5),
    y=st.integers(0, 4),
    width=st.integers(1, 6),
    height=st.integers(1, 5),
    data=st.data(),
)
def test_crop_while_reading_is_crop_after_reading(
    x: int, y: int, width: int, height: int, data: st.DataObject
) -> None:
    views = random_views(3, 4, 10, 12, 3)
    truth = np.random.default_rng(1).uniform(-1, 1, (10, 12)).astype(np.float32)
    whole = LightField(views, CAMERA, (-1, 1), truth, {"m": truth > 0})
    made = source(views, camera=CAMERA, disparity_range=(-1, 1), truth=truth, masks={"m": truth > 0})
    lf, expected = assemble(made, Selection(crop=(x, y, width, height))), whole.crop(x, y, width, height)
    np.testing.assert_array_equal(lf.views, expected.views)
    assert lf.truth is not None
    assert expected.truth is not None
    np.testing.assert_array_equal(lf.truth, expected.truth)
    np.testing.assert_array_equal(lf.masks["m"], expected.masks["m"])
    assert (lf.camera, lf.disparity_range) == (expected.camera, (-1, 1))


@given(scale=st.sampled_from([0.5, 0.25, 1 / 3, 0.4, 0.7, 0.15, 1.0]), dtype=st.sampled_from(["f4", "u2"]))
def test_scaling_moves_a_ramp_to_where_pixels_are(scale: float, dtype: str) -> None:
    y, x = np.mgrid[:40, :61]
    ramp = (3 * x + 5 * y + 10) / 400
    view = (ramp.astype("f4") if dtype == "f4" else np.rint(ramp * 65535).astype("u2"))[..., None]
    small = scale_view(view, scale)[..., 0] / (1 if dtype == "f4" else 65535)
    assert small.shape == (int(40 * scale + 1e-9), int(61 * scale + 1e-9))
    rows, columns = ((np.arange(n) + 0.5) / scale - 0.5 for n in small.shape)
    expected = (3 * columns + 5 * rows[:, None] + 10) / 400
    inner = slice(1, -1) if scale < 1 else slice(None)  # the filter is cut off at the border
    twentieth_of_a_pixel = 0.05 * 5 / 400  # filters sampled at whole pixels have no exact centroid
    np.testing.assert_allclose(small[inner, inner], expected[inner, inner], atol=twentieth_of_a_pixel)


def test_scaling_does_not_overshoot() -> None:
    edge = np.zeros((16, 16, 1), np.float32)
    edge[:, 7:] = 1
    small = scale_view(edge, 0.3)
    assert small.min() == 0
    assert small.max() == 1


def test_scaled_maps_hold_values_that_were_there() -> None:
    whole = np.random.default_rng(0).random((9, 13), dtype=np.float32)
    small = scale_nearest(whole, 0.4)
    assert small.shape == (3, 5)
    assert np.isin(small, whole).all()
    assert small[1, 2] == whole[3, 6]


@given(scale=st.sampled_from([0.5, 0.3, 1 / 3]), crop=st.sampled_from([None, (1, 2, 10, 7)]))
def test_points_stay_where_they_are(scale: float, crop: tuple[int, int, int, int] | None) -> None:
    """A plane's points do not depend on crop and scale: the camera and the truth shrink with the views."""
    depth = 5.0
    truth = np.full((10, 12), CAMERA.depth_to_disparity(depth), np.float32)
    made = source(random_views(3, 3, 10, 12, 3), camera=CAMERA, truth=truth, disparity_range=(-1.0, 2.0))
    lf = assemble(made, Selection(crop=crop, scale=scale))
    assert lf.disparity_range == (-scale, 2 * scale)
    assert lf.camera is not None
    assert lf.truth is not None
    points = lf.camera.points(lf.truth)
    np.testing.assert_allclose(points[..., 2], depth, rtol=1e-5)
    x0, y0 = crop[:2] if crop else (0, 0)
    y, x = np.mgrid[: lf.height, : lf.width]
    seen_at = np.stack([(x + 0.5) / scale - 0.5 + x0, (y + 0.5) / scale - 0.5 + y0], axis=-1)
    expected = (seen_at - CAMERA.principal_point) * CAMERA.pixel_pitch_mm / CAMERA.focal_length_mm * depth
    np.testing.assert_allclose(points[..., :2], expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": (5, 3)}, "5 views asked for along an axis that has 3; expected 1 to 3"),
        ({"views": (0, 3)}, "0 views asked for"),
        ({"views": (1, 1)}, "expected at least two views, with pixels"),
        ({"crop": (0, 0, 13, 4)}, "crop 0 0 13 4 .* leaves the views; expected a window inside 12x10 px"),
        ({"crop": (-1, 0, 3, 4)}, "leaves the views"),
        ({"scale": 0.0}, r"scale is 0\.0; expected a factor above 0 and at most 1"),
        ({"scale": 2.0}, r"scale is 2\.0; expected"),
        ({"scale": float("nan")}, "scale is nan; expected"),
        ({"scale": 0.05}, r"scale 0\.05 leaves nothing of 12x10 px"),
        ({"baseline_mm": 3.0}, "baseline_mm given but not focal_length_mm, sensor_size_mm; expected all"),
        ({"focus_distance_m": 3.0}, "focus_distance_m given but not baseline_mm, focal_length_mm, sensor"),
        (
            {"baseline_mm": -3.0, "focal_length_mm": 5.0, "sensor_size_mm": 8.0},
            r"baseline_mm is -3\.0; expected",
        ),
        ({"grid": (0, 4)}, "grid: 0 rows and 4 columns; expected at least one"),
    ],
)
def test_impossible_selections_are_named(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    np.save(tmp_path / "lf.npy", random_views(3, 4, 10, 12, 3))
    with pytest.raises(LightFieldError, match=message) as caught:
        read(tmp_path / "lf.npy", **options)
    assert "\n" not in str(caught.value)


def test_camera_from_options(tmp_path: Path) -> None:
    np.save(tmp_path / "lf.npy", random_views(3, 4, 10, 12, 3))
    lf = read(
        tmp_path / "lf.npy", baseline_mm=25, focal_length_mm=100, sensor_size_mm=35, focus_distance_m=4.25
    )
    assert lf.camera == CAMERA
    lf = read(tmp_path / "lf.npy", baseline_mm=25, focal_length_mm=100, sensor_size_mm=35)
    assert lf.camera == replace(CAMERA, focus_distance_m=float("inf"))
    assert CameraOptions(baseline_mm=7).apply(CAMERA, 12, 10) == replace(CAMERA, baseline_mm=7)


def test_only_the_selected_views_are_read(tmp_path: Path) -> None:
    """The others are not even pictures."""
    import imagecodecs

    for v, u in np.ndindex(9, 9):
        inner = 3 <= v <= 5 and 3 <= u <= 5
        view = imagecodecs.png_encode(random_views(6, 7, 3)) if inner else b"not a picture"
        (tmp_path / f"{v}_{u}.png").write_bytes(view)
    assert read(tmp_path, views=(3, 3)).shape == (3, 3, 6, 7, 3)


@KEEP_FOLDER
@given(kind=st.sampled_from(["npy", "npz", "h5", "zarr", "tif"]))
def test_memory_is_that_of_the_selection(tmp_path: Path, kind: str) -> None:
    """9x9 views of 160x160 px are 6.2 MB; 3x3 crops of 40x40 px are 43 kB."""
    path = tmp_path / f"lf.{kind}"
    if not path.exists():
        write_stack(path, random_views(9, 9, 160, 160, 3))
    read(path, views=(3, 3), crop=(10, 20, 40, 40))  # import libraries first
    tracemalloc.start()
    lf = read(path, views=(3, 3), crop=(10, 20, 40, 40))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(lf.views, random_views(9, 9, 160, 160, 3)[3:6, 3:6, 20:60, 10:50])
    assert peak < 2e6


def write_stack(path: Path, views: npt.NDArray[Any]) -> None:
    if path.suffix == ".npy":
        np.save(path, views)
    elif path.suffix == ".npz":
        np.savez(path, LF=views)
    elif path.suffix == ".h5":
        import h5py  # type: ignore[import-untyped]

        with h5py.File(path, "w") as file:
            file["LF"] = views
    elif path.suffix == ".zarr":
        import zarr

        zarr.create_array(str(path), data=views, chunks=(1, 1, 160, 160, 3))
    else:
        import tifffile

        tifffile.imwrite(path, views, photometric="rgb")


def test_source_is_closed_whatever_happens() -> None:
    closed = []
    made = source(random_views(3, 3, 4, 5, 1), close=lambda: closed.append(True))
    assemble(made, Selection())
    with pytest.raises(LightFieldError):
        assemble(made, Selection(scale=2))
    assert closed == [True, True]


def test_too_large_for_memory_is_named() -> None:
    def read_view(v: int, u: int) -> npt.NDArray[Any]:
        raise MemoryError

    made = replace(source(random_views(3, 3, 4, 5, 1)), read_view=read_view, name="huge")
    with pytest.raises(LightFieldError, match=r"huge: does not fit in memory; .*read fewer views, a crop"):
        assemble(made, Selection())


@given(v=st.integers(3, 9), u=st.integers(3, 9), data=st.data())
def test_one_absent_view_is_missing_unless_meant(v: int, u: int, data: st.DataObject) -> None:
    present = np.ones((v, u), bool)
    at = data.draw(st.integers(0, v - 1)), data.draw(st.integers(0, u - 1))
    present[at] = False
    with pytest.raises(LightFieldError, match=f"lf: 1 of {v * u} views missing, first here"):
        Layout().checked(present, "lf", "here")
    assert Layout(partial=True).checked(present, "lf", "here") is present
