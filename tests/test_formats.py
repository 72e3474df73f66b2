"""Each reader on files that other people's libraries wrote, or laid out by the public description."""

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import imagecodecs
import numpy as np
import numpy.typing as npt
import pytest
import scipy.io
import tifffile
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from lfdepth.errors import LightFieldError
from lfdepth.io import read, write

Views = npt.NDArray[Any]
KEEP_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)


def random_views(*shape: int, dtype: str = "uint8", seed: int = 0) -> Views:
    rng = np.random.default_rng(seed)
    if dtype.endswith(("f4", "f8", "float32", "float64")):
        return rng.random(shape).astype(dtype)
    return rng.integers(0, 2 ** (8 * np.dtype(dtype).itemsize), shape).astype(dtype)


VIEWS = random_views(3, 5, 8, 9, 3)  # 5x3 views of 9x8 px


def write_views(folder: Path, views: Views, name: Callable[[int, int], str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for v, u in np.ndindex(views.shape[:2]):
        save(folder / name(v, u), views[v, u])


def save(path: Path, view: Views) -> None:
    if path.suffix == ".png":
        path.write_bytes(imagecodecs.png_encode(np.ascontiguousarray(view.squeeze())))
    elif path.suffix == ".tif":
        photometric = "rgb" if view.shape[2:] == (3,) else "minisblack"
        tifffile.imwrite(path, view.squeeze(), photometric=photometric)
    else:
        Image.fromarray(view.squeeze()).save(path, lossless=True)


# Folders of views


@pytest.mark.parametrize(
    "name",
    [
        lambda v, u: f"2067_{v:02d}_{u:02d}.png",
        lambda v, u: f"view_v{v:02d}_u{u:02d}.tif",
        lambda v, u: f"view_u{u}_v{v}.bmp",
        lambda v, u: f"col{u + 1:02d} row{v + 1:02d}.webp",
        lambda v, u: f"X{10 * u:03d}-Y{5 * v:03d}.PNG".replace("PNG", "png"),
        lambda v, u: f"Größe {v}x{u}.png",
        lambda v, u: f"out_{v:02d}_{u:02d}_{-381.909271 + 60.5 * v:.6f}_{1103.376221 - 61.2 * u:.6f}.png",
        lambda v, u: f"out_{v:02d}_{u:02d}_{-381.9 + v}_{-776.9 - u}_.png",
    ],
)
def test_names_with_row_and_column(tmp_path: Path, name: Callable[[int, int], str]) -> None:
    write_views(tmp_path / "scene", VIEWS, name)
    lf = read(tmp_path / "scene")
    np.testing.assert_array_equal(lf.views, VIEWS)
    assert (lf.present, lf.camera, lf.disparity_range, lf.name) == (None, None, None, "scene")


def test_running_number_needs_a_grid_unless_square(tmp_path: Path) -> None:
    write_views(tmp_path, VIEWS, lambda v, u: f"IMG_{v * 5 + u + 1001}.png")
    np.testing.assert_array_equal(read(tmp_path, grid=(3, 5)).views, VIEWS)
    with pytest.raises(LightFieldError, match="15 views; expected a square number of views, or a grid"):
        read(tmp_path)
    with pytest.raises(LightFieldError, match="15 views; expected 20 in a grid of 5x4"):
        read(tmp_path, grid=(4, 5))
    for number in range(1010, 1016):
        (tmp_path / f"IMG_{number}.png").unlink()
    np.testing.assert_array_equal(read(tmp_path).views.reshape(9, 8, 9, 3), VIEWS.reshape(15, 8, 9, 3)[:9])


def test_views_numbered_column_first(tmp_path: Path) -> None:
    write_views(tmp_path, VIEWS, lambda v, u: f"{u * 3 + v:04d}.png")
    np.testing.assert_array_equal(read(tmp_path, grid=(5, 3), transpose=True).views, VIEWS)


@pytest.mark.parametrize(("tag", "grid"), [("u", (1, 5)), ("col", (1, 5)), ("v", (5, 1)), ("y", (5, 1))])
def test_one_row_or_column_of_views(tmp_path: Path, tag: str, grid: tuple[int, int]) -> None:
    write_views(tmp_path, VIEWS[:1], lambda _, u: f"{tag}{u}.png")
    lf = read(tmp_path)
    assert lf.shape == (*grid, 8, 9, 3)
    np.testing.assert_array_equal(lf.views.reshape(5, 8, 9, 3), VIEWS[0])


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("ending", ["png", "tif"])
def test_depth_and_channels_of_pictures(tmp_path: Path, dtype: str, channels: int, ending: str) -> None:
    views = random_views(3, 3, 6, 7, channels, dtype=dtype)
    write_views(tmp_path, views, lambda v, u: f"{v}_{u}.{ending}")
    lf = read(tmp_path)
    assert lf.views.dtype == dtype
    np.testing.assert_array_equal(lf.views, views)


def test_jpeg_and_float_tiff(tmp_path: Path) -> None:
    ramp = np.broadcast_to(np.arange(0, 160, 10, dtype=np.uint8)[:, None], (16, 16))
    for v, u in np.ndindex(3, 3):
        Image.fromarray(ramp).save(tmp_path / f"{v}_{u}.jpeg", quality=95)
    assert np.abs(read(tmp_path).views[1, 1, ..., 0].astype(int) - ramp).max() <= 3
    views = random_views(3, 3, 6, 7, 3, dtype="float32")
    write_views(tmp_path / "float", views, lambda v, u: f"{v}_{u}.tif")
    np.testing.assert_array_equal(read(tmp_path / "float").views, views)


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # stored lying on its side
    bright_top = np.zeros((16, 32), np.uint8)
    bright_top[:, :16] = 200
    for v, u in np.ndindex(3, 3):
        Image.fromarray(bright_top).save(tmp_path / f"{v}_{u}.jpg", exif=exif)
    view = read(tmp_path).views[1, 1, ..., 0]
    assert view.shape == (32, 16)
    assert view[:12].min() > 150 > 50 > view[20:].max()


def nine_by_nine(folder: Path, kept: npt.NDArray[np.bool_]) -> Views:
    views = random_views(9, 9, 3, 4, 3)
    write_views(folder, views, lambda v, u: f"input_Cam{v * 9 + u:03d}.png")
    for v, u in np.argwhere(~kept):
        (folder / f"input_Cam{v * 9 + u:03d}.png").unlink()
    return views


CROSS_AND_DIAGONALS = np.array(
    [[v == 4 or u == 4 or abs(v - 4) == abs(u - 4) for u in range(9)] for v in range(9)]
)


def test_cross_and_diagonals_of_a_benchmark_folder(tmp_path: Path) -> None:
    assert CROSS_AND_DIAGONALS.sum() == 33
    views = nine_by_nine(tmp_path, CROSS_AND_DIAGONALS)
    lf = read(tmp_path)
    assert lf.present is not None
    np.testing.assert_array_equal(lf.present, CROSS_AND_DIAGONALS)
    np.testing.assert_array_equal(lf.views[CROSS_AND_DIAGONALS], views[CROSS_AND_DIAGONALS])
    assert not lf.views[~CROSS_AND_DIAGONALS].any()
    inner = read(tmp_path, views=(3, 3))
    assert inner.present is None
    np.testing.assert_array_equal(inner.views, views[3:6, 3:6])


def test_a_missing_view_is_masked_only_where_it_is_meant(tmp_path: Path) -> None:
    kept = np.ones((9, 9), bool)
    kept[2, 3] = False
    views = nine_by_nine(tmp_path, kept)
    with pytest.raises(
        LightFieldError, match=r"1 of 81 views missing, first input_Cam021\.png; .*\(partial\)"
    ):
        read(tmp_path)
    lf = read(tmp_path, partial=True)
    assert lf.present is not None
    np.testing.assert_array_equal(lf.present, kept)
    np.testing.assert_array_equal(lf.views[kept], views[kept])


def test_a_missing_reference_view_is_refused(tmp_path: Path) -> None:
    kept = np.ones((9, 9), bool)
    kept[4, 4] = False
    nine_by_nine(tmp_path, kept)
    with pytest.raises(LightFieldError, match=r"first input_Cam040\.png"):
        read(tmp_path)
    with pytest.raises(LightFieldError, match=r"input_Cam040\.png: the reference view is missing"):
        read(tmp_path, partial=True)


def test_empty_benchmark_folder(tmp_path: Path) -> None:
    for partial in (False, True):
        with pytest.raises(LightFieldError, match=r"9 of 9 views missing|0 views; expected"):
            read(tmp_path, format="benchmark", grid=(3, 3) if partial else None, partial=partial)


PALETTE = Image.fromarray(VIEWS[0, 0]).convert("P")
ALPHA = Image.fromarray(np.zeros((8, 9, 4), np.uint8))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda f: (f / "v1_u2.png").unlink(),
            r"1 of 15 views missing, first row 1, column 2; expected a grid",
        ),
        (
            lambda f: save(f / "v2_u4.png", VIEWS[0, 0, :-1]),
            r"v2_u4\.png: view is 9x7 px, colour, uint8 but .*",
        ),
        (
            lambda f: save(f / "v2_u4.png", VIEWS[0, 0, ..., 0]),
            r"v2_u4\.png: view is 9x8 px, grey, uint8 but .*",
        ),
        (lambda f: PALETTE.save(f / "v1_u2.png"), r"v1_u2\.png: picture of mode P; expected grey or RGB"),
        (lambda f: ALPHA.save(f / "v1_u2.png"), r"v1_u2\.png: alpha is not opaque at 100 % of"),
        (
            lambda f: save(f / "cover.png", VIEWS[0, 0]),
            r"cover\.png: surplus picture; expected names that differ .*--pattern 'v\*_u\*\.png'",
        ),
        (
            lambda f: save(f / "v1_u02.png", VIEWS[0, 0]),
            r"v1_u2\.png: has the same place in the grid as v1_u02",
        ),
        (lambda f: (f / "v1_u2.png").write_bytes(b"\x89PNG"), r"v1_u2\.png: not a readable picture"),
        (
            lambda f: (f / "v1_u2.png").unlink() or (f / "v1_u2.png").symlink_to("v1_u2.png"),
            r"v1_u2\.png: .*links",
        ),
    ],
)
def test_damaged_folders_of_views_are_named(tmp_path: Path, damage: Any, message: str) -> None:
    write_views(tmp_path, VIEWS, lambda v, u: f"v{v}_u{u}.png")
    damage(tmp_path)
    with pytest.raises(LightFieldError, match=message) as caught:
        read(tmp_path)
    assert "\n" not in str(caught.value)


def test_names_that_say_no_grid(tmp_path: Path) -> None:
    write_views(tmp_path / "three", VIEWS[:, :3], lambda v, u: f"{v}_{u}_{v + u}.png")
    with pytest.raises(LightFieldError, match="names differ in 3 numbers; expected row and column"):
        read(tmp_path / "three")
    write_views(tmp_path / "fine", VIEWS, lambda v, u: f"{v}_{u}.png")
    with pytest.raises(LightFieldError, match="names give a grid of 5x3; expected 3x5 as asked for"):
        read(tmp_path / "fine", grid=(5, 3))


# Arrays


@KEEP_FOLDER
@given(data=st.data())
def test_npy_of_any_size_and_type(tmp_path: Path, data: st.DataObject) -> None:
    grid = data.draw(st.sampled_from([(3, 3), (3, 4), (1, 5), (6, 1), (4, 3)]))
    size = data.draw(st.tuples(st.integers(7, 9), st.integers(7, 9)))
    channels = data.draw(st.sampled_from([1, 3]))
    dtype = data.draw(st.sampled_from(["u1", "<u2", ">u2", "<f4", ">f4", "f8"]))
    views = random_views(*grid, *size, channels, dtype=dtype)
    np.save(tmp_path / "lf.npy", views)
    lf = read(tmp_path / "lf.npy")
    assert lf.views.dtype.name == {"u1": "uint8", "<u2": "uint16", ">u2": "uint16"}.get(dtype, "float32")
    np.testing.assert_array_equal(lf.views, views.astype(lf.views.dtype))


@pytest.mark.parametrize(
    ("array", "options"),
    [
        (VIEWS[..., 0], {}),  # (V, U, H, W)
        (VIEWS.reshape(15, 8, 9, 3), {"grid": (3, 5)}),
        (VIEWS.reshape(15, 8, 9, 3).transpose(0, 3, 1, 2), {"grid": (3, 5)}),
        (VIEWS[..., 0].reshape(15, 8, 9), {"grid": (3, 5)}),
        (VIEWS.transpose(0, 1, 4, 2, 3), {}),  # (V, U, C, H, W), as of deep learning
        (VIEWS.transpose(2, 3, 4, 0, 1), {}),  # (H, W, C, V, U), as of MATLAB
    ],
)
def test_usual_orders_of_axes(tmp_path: Path, array: Views, options: dict[str, Any]) -> None:
    np.save(tmp_path / "lf.npy", array)
    lf = read(tmp_path / "lf.npy", **options)
    np.testing.assert_array_equal(lf.views, VIEWS[..., : lf.shape[4]])


def test_rows_and_columns_before_views(tmp_path: Path) -> None:
    views = random_views(5, 4, 8, 9, 3)
    np.save(tmp_path / "lf.npy", views.transpose(2, 3, 0, 1, 4))
    np.testing.assert_array_equal(read(tmp_path / "lf.npy").views, views)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (VIEWS[0, 0, ..., 0], r"array of shape \(8, 9\); expected \(V, U, H, W, C\)"),
        (VIEWS[..., [0, 1]], r"array of shape \(3, 5, 8, 9, 2\); expected \(V, U, H, W, C\)"),
        (VIEWS.astype(np.int32) << 10, "samples of type int32 from 0 to 26.*; expected 0 to 65535"),
        (VIEWS.astype(complex), "samples are complex128; expected whole numbers or float"),
        (VIEWS.astype(np.float32) - 99, r"float views span \[.*\]; expected finite values in \[0, 1\]"),
        (VIEWS[:, :, :0], r"views have shape \(3, 5, 0, 9, 3\)|leaves nothing|leaves the views"),
        (VIEWS.reshape(15, 8, 9, 3), "15 views; expected a square number"),
    ],
)
def test_arrays_that_are_no_light_field(tmp_path: Path, array: Views, message: str) -> None:
    np.save(tmp_path / "lf.npy", array)
    with pytest.raises(LightFieldError, match=message):
        read(tmp_path / "lf.npy")


def test_wrong_grid_for_an_array_that_has_one(tmp_path: Path) -> None:
    np.save(tmp_path / "lf.npy", VIEWS)
    with pytest.raises(LightFieldError, match="a grid of 5x3; expected 4x4 as asked for"):
        read(tmp_path / "lf.npy", grid=(4, 4))


def test_another_grid_for_an_array_that_has_one(tmp_path: Path) -> None:
    """A count that fits decides: the views are those of the file, row by row."""
    truth = np.random.default_rng(0).normal(0, 1, VIEWS.shape[:4]).astype(np.float32)
    np.savez(tmp_path / "lf.npz", LF=VIEWS, disp=truth)
    lf = read(tmp_path / "lf.npz", grid=(5, 3))
    np.testing.assert_array_equal(lf.views, VIEWS.reshape(5, 3, *VIEWS.shape[2:]))
    np.testing.assert_array_equal(lf.truth, truth.reshape(15, *truth.shape[2:])[2 * 3 + 1])
    write(tmp_path / "own.npz", lf)  # this one states its grid, and masks and cameras in it
    with pytest.raises(LightFieldError, match="a grid of 3x5; expected 5x3 as asked for"):
        read(tmp_path / "own.npz", grid=(3, 5))


@pytest.mark.parametrize("save_npz", [np.savez, np.savez_compressed])
def test_npz(tmp_path: Path, save_npz: Any) -> None:
    save_npz(tmp_path / "one.npz", whatever=VIEWS, range=[0, 1], name="scene")
    np.testing.assert_array_equal(read(tmp_path / "one.npz").views, VIEWS)
    save_npz(tmp_path / "two.npz", depth=VIEWS[..., 0], LF=VIEWS)
    np.testing.assert_array_equal(read(tmp_path / "two.npz").views, VIEWS)
    save_npz(tmp_path / "unclear.npz", a=VIEWS, b=VIEWS)
    with pytest.raises(
        LightFieldError, match=r"holds a \(3, 5, 8, 9, 3\), b \(3, 5, 8, 9, 3\); .*name it LF"
    ):
        read(tmp_path / "unclear.npz")


def test_zip_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    header = (
        b"{'descr': '|u1', 'fortran_order': False, 'shape': (9, 9, 65536, 65536, 3), }".ljust(117) + b"\n"
    )
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("LF.npy", b"\x93NUMPY\x01\x00\x76\x00" + header + bytes(64 << 20))
    assert (tmp_path / "bomb.npz").stat().st_size < 1 << 20
    with pytest.raises(LightFieldError, match=r"bomb\.npz: unpacks to 972\.0 GiB; expected at most 8\.0 GiB"):
        read(tmp_path / "bomb.npz")


def test_picture_bomb_is_refused(tmp_path: Path) -> None:
    size = (200_000).to_bytes(4, "big")
    png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + size + size + b"\x08\x02\0\0\0"
    write_views(tmp_path, VIEWS, lambda v, u: f"{v}_{u}.png")
    (tmp_path / "1_2.png").write_bytes(png)
    with pytest.raises(LightFieldError, match=r"1_2\.png: unpacks to 111\.8 GiB; expected at most"):
        read(tmp_path)


def older_benchmark_file(path: Path, shift: float = 0.5) -> tuple[Views, Views]:
    """A file in the layout of Wanner et al. 2013: columns of views run from right to left."""
    views, depth = random_views(5, 5, 6, 8, 3), random_views(5, 5, 6, 8, dtype="float32") + np.float32(2)
    with h5py.File(path, "w") as file:
        file["LF"] = views[:, ::-1]
        file["GT_DEPTH"] = depth[:, ::-1]
        file.attrs.update(
            {"dH": [0.02], "dV": [0.02], "focalLength": [400.0], "shift": [shift], "inner": [0.8]}
        )
    return views, depth


def test_hdf5_of_the_older_benchmark(tmp_path: Path) -> None:
    views, depth = older_benchmark_file(tmp_path / "buddha.h5")
    window = read(tmp_path / "buddha.h5", crop=(1, 2, 4, 3), views=(3, 3))
    np.testing.assert_array_equal(window.views, views[1:4, 1:4, 2:5, 1:5])
    lf = read(tmp_path / "buddha.h5")
    np.testing.assert_array_equal(lf.views, views)
    assert lf.truth is not None
    np.testing.assert_allclose(lf.truth, 0.02 * 400 / depth[2, 2] - 0.5, rtol=1e-6)
    assert lf.camera is not None
    np.testing.assert_allclose(lf.camera.disparity_to_depth(lf.truth), depth[2, 2], rtol=1e-5)
    x = lf.camera.points(lf.truth)[3, 7, 0]
    assert x == pytest.approx((7 - 3.5) * depth[2, 2, 3, 7] / 400, rel=1e-5)


def test_hdf5_without_geometry(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "lf.h5", "w") as file:
        file.create_dataset("group/data", data=VIEWS, chunks=True, compression="gzip")
        file["note"] = "text"
    lf = read(tmp_path / "lf.h5")
    np.testing.assert_array_equal(lf.views, VIEWS)
    assert (lf.camera, lf.truth) == (None, None)


def test_damaged_hdf5_is_named(tmp_path: Path) -> None:
    older_benchmark_file(tmp_path / "whole.h5")
    data = (tmp_path / "whole.h5").read_bytes()
    (tmp_path / "half.h5").write_bytes(data[: len(data) // 2])
    with pytest.raises(
        LightFieldError, match=r"half\.h5: not readable \(.*truncated.*\); expected a complete"
    ):
        read(tmp_path / "half.h5")
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file["depth"] = np.zeros((4, 5))
    with pytest.raises(LightFieldError, match=r"empty\.h5: holds depth \(4, 5\); expected one light field"):
        read(tmp_path / "empty.h5")


def write_mat_7_3(path: Path, name: str, array: Views) -> None:
    """A MATLAB 7.3 file: HDF5 behind a 512-byte header, axes in MATLAB's (opposite) order."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file[name] = np.ascontiguousarray(array.T)
        file[name].attrs["MATLAB_class"] = np.bytes_(str(array.dtype))
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sat Jan 1 00:00:00 2022 HDF5 schema 1.00 ."
    with path.open("r+b") as out:
        out.write(header.ljust(116) + bytes(8) + b"\x00\x02IM")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_mat_of_the_light_field_toolbox(tmp_path: Path, version: str) -> None:
    weighted = random_views(3, 5, 8, 9, 4, dtype="uint16")  # RGB and weight
    path = tmp_path / "IMG__Decoded.mat"
    if version == "5":
        scipy.io.savemat(path, {"LF": weighted, "LensletGridModel": {"HSpacing": 1.0}}, do_compression=True)
    else:
        write_mat_7_3(path, "LF", weighted)
    np.testing.assert_array_equal(read(path).views, weighted[..., :3])


def test_mat_with_a_struct_and_doubles(tmp_path: Path) -> None:
    views = random_views(3, 5, 8, 9, 3, dtype="float64")
    scipy.io.savemat(tmp_path / "a.mat", {"scene": {"LF": views, "f": 0.1}})
    np.testing.assert_array_equal(read(tmp_path / "a.mat").views, views.astype(np.float32))
    scipy.io.savemat(tmp_path / "b.mat", {"im": views.transpose(2, 3, 4, 0, 1)})
    np.testing.assert_array_equal(read(tmp_path / "b.mat").views, views.astype(np.float32))


def test_mat_without_a_light_field(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"disparity": np.zeros((4, 5)), "name": "x"})
    with pytest.raises(LightFieldError, match=r"a\.mat: holds disparity \(4, 5\); expected one light field"):
        read(tmp_path / "a.mat")
    write_mat_7_3(tmp_path / "b.mat", "disparity", np.zeros((4, 5)))
    with pytest.raises(LightFieldError, match=r"b\.mat: holds disparity \(4, 5\); expected one light field"):
        read(tmp_path / "b.mat")
    scipy.io.savemat(tmp_path / "c.mat", {"LF": VIEWS})
    (tmp_path / "c.mat").write_bytes((tmp_path / "c.mat").read_bytes()[:1000])
    with pytest.raises(LightFieldError, match=r"c\.mat: not readable"):
        read(tmp_path / "c.mat")


@pytest.mark.parametrize("version", [2, 3])
def test_zarr(tmp_path: Path, version: Any) -> None:
    zarr.create_array(str(tmp_path / "array.zarr"), data=VIEWS, zarr_format=version)
    np.testing.assert_array_equal(read(tmp_path / "array.zarr").views, VIEWS)
    group = zarr.open_group(str(tmp_path / "group.zarr"), mode="w", zarr_format=version)
    group.create_array("LF", data=VIEWS, chunks=(1, 1, 8, 9, 3))
    group.create_array("depth", data=VIEWS[..., 0])
    np.testing.assert_array_equal(read(tmp_path / "group.zarr").views, VIEWS)
    marker = next((tmp_path / "array.zarr").glob("[.z]*ar*"))
    marker.write_text("{")
    with pytest.raises(LightFieldError, match=r"array\.zarr: (not readable|holds)"):
        read(tmp_path / "array.zarr")


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [1, 3])
def test_multi_page_tiff(tmp_path: Path, dtype: str, channels: int) -> None:
    views = random_views(3, 5, 8, 9, channels, dtype=dtype)
    photometric = "rgb" if channels == 3 else "minisblack"
    pages = views.reshape(15, 8, 9, channels).squeeze()
    tifffile.imwrite(tmp_path / "pages.tif", pages, photometric=photometric, metadata=None)
    np.testing.assert_array_equal(read(tmp_path / "pages.tif", grid=(3, 5)).views, views)
    with pytest.raises(LightFieldError, match="15 views; expected a square number"):
        read(tmp_path / "pages.tif")
    tifffile.imwrite(tmp_path / "shaped.tif", views.squeeze(), photometric=photometric)
    np.testing.assert_array_equal(read(tmp_path / "shaped.tif").views, views)


def test_tiff_that_pillow_wrote(tmp_path: Path) -> None:
    first, *others = (Image.fromarray(view) for view in VIEWS.reshape(15, 8, 9, 3))
    first.save(tmp_path / "pages.tif", save_all=True, append_images=others, compression="tiff_lzw")
    np.testing.assert_array_equal(read(tmp_path / "pages.tif", grid=(3, 5)).views, VIEWS)


def test_damaged_tiff_is_named(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "one.tif", VIEWS[0, 0])
    with pytest.raises(LightFieldError, match=r"one\.tif: a single page; expected one page per view"):
        read(tmp_path / "one.tif")
    tifffile.imwrite(tmp_path / "half.tif", VIEWS.reshape(15, 8, 9, 3), photometric="rgb")
    data = (tmp_path / "half.tif").read_bytes()
    (tmp_path / "half.tif").write_bytes(data[: len(data) // 2])
    with pytest.raises(LightFieldError, match=r"half\.tif: (not readable|a single page; .*copy it again)"):
        read(tmp_path / "half.tif", grid=(3, 5))


# Pictures that hold all views


def test_quilt(tmp_path: Path) -> None:
    quilt = Image.new("RGB", (9 * 3, 8 * 5))
    views = VIEWS.reshape(15, 8, 9, 3)
    for number, view in enumerate(views):  # from the bottom left, to the right, then up
        quilt.paste(Image.fromarray(view), (9 * (number % 3), 8 * (4 - number // 3)))
    quilt.save(tmp_path / "Große Blume_qs3x5a0.75.png")
    lf = read(tmp_path / "Große Blume_qs3x5a0.75.png")
    assert lf.shape == (1, 15, 8, 9, 3)
    np.testing.assert_array_equal(lf.views[0], views)
    shutil.copy(tmp_path / "Große Blume_qs3x5a0.75.png", tmp_path / "plain.png")
    np.testing.assert_array_equal(read(tmp_path / "plain.png", format="quilt", grid=(5, 3)).views[0], views)
    with pytest.raises(LightFieldError, match="the name states no tiles; expected NAME_qsCxRaA"):
        read(tmp_path / "plain.png", format="quilt")
    quilt.save(tmp_path / "flower_qs28x5a0.75.png")
    with pytest.raises(LightFieldError, match="27x40 px; expected at least one pixel for each of 28x5 tiles"):
        read(tmp_path / "flower_qs28x5a0.75.png")


def eslf_picture(views: Views) -> Views:
    """ESLF by its description: view (i, j) is every 14th pixel from (i, j)."""
    v, u, h, w, c = views.shape
    picture = np.empty((v * h, u * w, c), views.dtype)
    for i, j in np.ndindex(v, u):
        picture[i::v, j::u] = views[i, j]
    return picture


def lytro_views() -> Views:
    views = random_views(14, 14, 5, 6, 3) // 2 + 100
    distance = np.hypot(*(np.mgrid[:14, :14] - 6.5))
    views[distance > 6.8] //= 20
    return views.astype(np.uint8)


@pytest.mark.parametrize("name", ["IMG_7_eslf.png", "IMG_7.png"])
def test_eslf(tmp_path: Path, name: str) -> None:
    views = lytro_views()
    save(tmp_path / name, eslf_picture(views))
    lf = read(tmp_path / name)
    assert lf.present is None
    np.testing.assert_array_equal(lf.views, views[3:12, 3:12])
    lf = read(tmp_path / name, views=(13, 13))
    assert lf.present is not None
    bright = views.mean(axis=(2, 3, 4)) > 50
    np.testing.assert_array_equal(lf.present, bright[1:, 1:])
    assert not lf.present[0, 12]
    assert not lf.views[~lf.present].any()


def test_eslf_with_alpha(tmp_path: Path) -> None:
    views = lytro_views()
    picture = eslf_picture(views)
    save(tmp_path / "IMG_eslf.png", np.dstack([picture, np.full_like(picture[..., :1], 255)]))
    np.testing.assert_array_equal(read(tmp_path / "IMG_eslf.png").views, views[3:12, 3:12])


def test_eslf_of_another_grid(tmp_path: Path) -> None:
    save(tmp_path / "x.png", eslf_picture(VIEWS // 2 + 100))
    np.testing.assert_array_equal(
        read(tmp_path / "x.png", format="eslf", grid=(3, 5)).views, VIEWS // 2 + 100
    )
    with pytest.raises(LightFieldError, match="45x24 px; expected multiples of 14x14 interleaved views"):
        read(tmp_path / "x.png", format="eslf")
    with pytest.raises(LightFieldError, match="not recognised as a light field"):
        read(tmp_path / "x.png")


def test_real_lytro_picture(data_folder: Path) -> None:
    path = data_folder / "lytro_bikes_crop_eslf.png"
    lf = read(path)
    picture = imagecodecs.png_decode(path.read_bytes())
    assert lf.shape == (9, 9, 208, 288, 3)
    assert lf.present is None
    np.testing.assert_array_equal(lf.reference, picture[7::14, 7::14])
    np.testing.assert_array_equal(lf.views[0, 8], picture[3::14, 11::14])


@pytest.mark.parametrize("name", ["IMG_0001.lfp", "IMG_0001.LFR", "renamed.bin"])
def test_raw_lytro_pictures_are_recognised(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\x89LFP\r\n\x1a\n" + bytes(100))
    with pytest.raises(LightFieldError, match=r"raw Lytro picture; .*PlenoptiCam .*Light Field Toolbox"):
        read(tmp_path / name)


# Finding the format


def test_unknown_paths_and_formats(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no light field")
    with pytest.raises(
        LightFieldError, match="not recognised as a light field; expected one of zarr, benchmark"
    ):
        read(tmp_path / "notes.txt")
    with pytest.raises(LightFieldError, match="format 'jpeg2000': unknown; expected one of zarr, benchmark"):
        read(tmp_path, format="jpeg2000")
    with pytest.raises(LightFieldError, match="absent: no such file"):
        read(tmp_path / "absent", format="npy")
    (tmp_path / "loop.npy").symlink_to("loop.npy")
    with pytest.raises(LightFieldError, match=r"loop\.npy: Too many levels of symbolic links"):
        read(tmp_path / "loop.npy")
    with pytest.raises(LightFieldError, match=r"notes\.txt: not readable"):
        read(tmp_path / "notes.txt", format="npy")


@pytest.mark.parametrize(
    "name", ["zarr", "benchmark", "folder", "npy", "npz", "mat", "hdf5", "quilt", "eslf", "tiff"]
)
def test_wrong_format_is_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "x_qs2x2a1.bin").write_bytes(b"nothing of the kind" * 30)
    (tmp_path / "folder").mkdir()
    for path in tmp_path.iterdir():
        with pytest.raises(LightFieldError) as caught:
            read(path, format=name)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_missing_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    older_benchmark_file(tmp_path / "buddha.h5")

    def absent(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("lfdepth.io.extras.import_module", absent)
    with pytest.raises(LightFieldError, match=r'needs the package h5py.*pip install "lfdepth\[hdf5\]"'):
        read(tmp_path / "buddha.h5")


# Pictures that are easily taken for others


@pytest.mark.parametrize(
    ("mode", "ending", "message"),
    [
        ("P", "png", "picture of mode P"),
        ("P", "bmp", "picture of mode P"),
        ("P", "tif", "picture of mode PALETTE with 8 bits"),
        ("1", "tif", "picture of mode .* with 1 bits"),
        ("CMYK", "jpg", "picture of mode CMYK"),
        ("CMYK", "tif", r"picture of mode with shape \(8, 9, 4\)"),
    ],
)
def test_pictures_that_are_neither_grey_nor_rgb(tmp_path: Path, mode: str, ending: str, message: str) -> None:
    for v, u in np.ndindex(3, 3):
        Image.fromarray(VIEWS[v, u]).convert(mode).save(tmp_path / f"v{v}_u{u}.{ending}")
    with pytest.raises(
        LightFieldError, match=rf"v1_u1\.{ending}: {message}.*; expected grey or RGB"
    ) as error:
        read(tmp_path)
    assert "\n" not in str(error.value)


def test_tiff_whose_samples_mean_something_else(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "pages.tif", random_views(9, 8, 9, dtype="uint16"), photometric="miniswhite")
    with pytest.raises(LightFieldError, match=r"pages\.tif: page of MINISWHITE with 16 bits; expected grey"):
        read(tmp_path / "pages.tif")


def test_notes_that_are_a_bomb_are_not_unpacked(tmp_path: Path) -> None:
    header = b"{'descr': '<U500000000', 'fortran_order': False, 'shape': (), }".ljust(117) + b"\n"
    np.savez(tmp_path / "lf.npz", LF=VIEWS)
    with zipfile.ZipFile(tmp_path / "lf.npz", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("lfdepth.npy", b"\x93NUMPY\x01\x00\x76\x00" + header)
    np.testing.assert_array_equal(read(tmp_path / "lf.npz").views, VIEWS)


def test_names_with_spaces_and_other_letters(tmp_path: Path) -> None:
    folder = tmp_path / "Lichtfeld ä 光場"
    write_views(folder, VIEWS, lambda v, u: f"Ansicht ß 景 {v} {u}.png")
    np.testing.assert_array_equal(read(folder).views, VIEWS)
    for name in (
        "ein Feld 光.npz",
        "ein Feld 光.npy",
        "ein Feld 光.h5",
        "ein Feld 光.mat",
        "ein Feld 光.tif",
    ):
        path = tmp_path / name
        if path.suffix == ".npz":
            np.savez(path, LF=VIEWS)
        elif path.suffix == ".npy":
            np.save(path, VIEWS)
        elif path.suffix == ".mat":
            scipy.io.savemat(path, {"LF": VIEWS})
        elif path.suffix == ".tif":
            tifffile.imwrite(path, VIEWS, photometric="rgb")
        else:
            with h5py.File(path, "w") as file:
                file["LF"] = VIEWS
        np.testing.assert_array_equal(read(path).views, VIEWS)


def test_loops_of_links(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(LightFieldError, match="loop: Too many levels of symbolic links; expected a light"):
        read(tmp_path / "loop")
    write_views(tmp_path / "scene", VIEWS, lambda v, u: f"{v}_{u}.png")
    (tmp_path / "scene/around").symlink_to("..")  # a folder in itself does no harm
    np.testing.assert_array_equal(read(tmp_path / "scene").views, VIEWS)
