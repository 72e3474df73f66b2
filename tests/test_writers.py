"""Each written file read back by the library that people use for its format."""

import asyncio
import errno
import json
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR  # type: ignore[import-not-found]
import plyfile  # type: ignore[import-untyped]
import pytest
import tifffile
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import check_writable, read_disparity, read_record, write
from lfdepth.io.ply import triangles
from lfdepth.io.record import Record, as_depth
from lfdepth.lightfield import LightField

KEEP_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
MAP = np.linspace(-1, 1.5, 30, dtype=np.float32).reshape(5, 6)
CAMERA = Camera(100, 0.41, 25, 4.25, width=6, height=5)
SCENE = LightField(np.random.default_rng(0).integers(0, 256, (9, 9, 5, 6, 3), np.uint8), CAMERA)


@dataclass(frozen=True)
class FakeMethod:
    name: str = "fbs"
    step: float = 0.02

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "step": self.step}


@dataclass(frozen=True)
class FakeResult:
    disparity: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]
    range: tuple[float, float] = (-1.0, 2.0)
    runtime: float = 3.5
    method: FakeMethod = FakeMethod()
    sigma: npt.NDArray[np.float32] | None = None


RESULT: Any = FakeResult(MAP, np.linspace(0, 1, 30, dtype=np.float32).reshape(5, 6))
SIGMA = np.linspace(0.01, 0.05, 30, dtype=np.float32).reshape(5, 6)

maps = arrays(
    np.float32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.floats(-1e6, 1e6, width=32)
)


@KEEP_FOLDER
@given(values=maps, ending=st.sampled_from([".tif", ".tiff", ".exr", ".zarr"]))
def test_float_formats_return_what_was_written(
    tmp_path: Path, values: npt.NDArray[np.float32], ending: str
) -> None:
    path = tmp_path / f"karte ä{ending}"
    write(path, values)
    np.testing.assert_array_equal(read_disparity(path), values)
    assert {file.name for file in tmp_path.iterdir()} <= {
        f"karte ä{e}" for e in (".tif", ".tiff", ".exr", ".zarr")
    }


def test_tiff(tmp_path: Path) -> None:
    write(tmp_path / "map.tif", RESULT)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "map.tif"), MAP)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "map.tif")), MAP)
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        assert json.loads(file.pages.first.description) == {
            "quantity": "disparity",
            "unit": "px per view step",
        }


def test_openexr(tmp_path: Path) -> None:
    write(tmp_path / "map.exr", RESULT)
    write(tmp_path / "depth.exr", RESULT, scene=SCENE, quantity="depth")
    with OpenEXR.File(str(tmp_path / "map.exr")) as file:
        np.testing.assert_array_equal(file.channels()["Y"].pixels, MAP)
        np.testing.assert_array_equal(file.channels()["confidence"].pixels, RESULT.confidence)
    with OpenEXR.File(str(tmp_path / "depth.exr")) as file:
        np.testing.assert_allclose(file.channels()["Z"].pixels, CAMERA.disparity_to_depth(MAP), rtol=1e-6)
    with pytest.raises(LightFieldError, match=r"depth\.exr: holds depth, .*\(OpenEXR: channel Y\)"):
        read_disparity(tmp_path / "depth.exr")


@pytest.mark.parametrize("ending", [".npz", ".zarr", ".exr"])
def test_standard_errors_are_kept(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"map{ending}"
    write(path, replace(RESULT, sigma=SIGMA))
    kept = read_record(path)
    assert kept.sigma is not None
    np.testing.assert_array_equal(kept.sigma, SIGMA)
    write(path, RESULT)
    assert read_record(path).sigma is None


def test_standard_errors_of_depth_are_in_metres() -> None:
    """dZ = Z(D) − Z(D + σ); a point at infinity has none that is finite."""
    disparity = MAP.copy()
    disparity[0, 0] = CAMERA.depth_to_disparity(np.array(np.inf))
    found = as_depth(Record(disparity, sigma=SIGMA), CAMERA)
    expected = CAMERA.disparity_to_depth(disparity) - CAMERA.disparity_to_depth(disparity + SIGMA)
    assert found.sigma is not None
    assert np.isinf(found.sigma[np.isinf(found.values)]).all()
    finite = np.isfinite(found.values)
    np.testing.assert_allclose(found.sigma[finite], expected[finite], rtol=1e-3)


def test_zarr(tmp_path: Path) -> None:
    for _ in range(2):  # the second replaces the first
        write(tmp_path / "map.zarr", RESULT)
    group: Any = zarr.open_group(str(tmp_path / "map.zarr"), mode="r")
    np.testing.assert_array_equal(group["disparity"][:], MAP)
    np.testing.assert_array_equal(group["confidence"][:], RESULT.confidence)
    assert dict(group.attrs)["range"] == [-1, 2]
    assert dict(group.attrs)["runtime"] == 3.5
    assert json.loads(dict(group.attrs)["parameters"]) == {"name": "fbs", "step": 0.02}
    assert [file.name for file in tmp_path.iterdir()] == ["map.zarr"]


def test_zarr_does_not_replace_other_folders(tmp_path: Path) -> None:
    (tmp_path / "photos.zarr").mkdir()
    (tmp_path / "photos.zarr/holiday.jpg").write_text("dear")
    (tmp_path / "file.zarr").write_text("dear")
    for act in (check_writable, lambda path: write(path, MAP)):
        with pytest.raises(LightFieldError, match=r"photos\.zarr: is a folder"):
            act(tmp_path / "photos.zarr")
    with pytest.raises(LightFieldError, match=r"file\.zarr: is a file; expected to write a folder"):
        write(tmp_path / "file.zarr", MAP)
    assert (tmp_path / "photos.zarr/holiday.jpg").read_text() == "dear"
    assert len(list(tmp_path.iterdir())) == 2


def test_interrupted_zarr_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "map.zarr", MAP)

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(zarr.Group, "create_array", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "map.zarr", MAP + 1)
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.zarr"), MAP)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_zarr_that_fails_does_not_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zarr writes on in threads of its own when one of its files could not be written."""
    whole, calls = zarr.storage.LocalStore.set, 0

    async def failing(self: Any, key: str, value: Any) -> None:
        nonlocal calls
        calls += 1
        if key.startswith("LF/") and key != "LF/.zarray":
            if key == "LF/0.0.0.0.0":
                raise OSError(errno.ENOSPC, "No space left on device")
            await asyncio.sleep(0.2)
        await whole(self, key, value)

    monkeypatch.setattr(zarr.storage.LocalStore, "set", failing)
    with pytest.raises(LightFieldError, match="No space left"):
        write(tmp_path / "x.zarr", SCENE)
    assert calls > 3
    time.sleep(0.5)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".pfm", ".npy", ".npz", ".tif", ".exr", ".zarr", ".png"])
def test_depth_is_in_metres(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"depth{ending}"
    write(path, RESULT, scene=SCENE, quantity="depth")
    expected = CAMERA.disparity_to_depth(MAP)
    values, tolerance = read_depth(path), 1e-6 * float(expected.max())
    if ending == ".png":
        header = json.loads((tmp_path / "depth.json").read_text())
        assert (header["quantity"], header["unit"]) == ("depth", "m")
        values = values * header["scale"] + header["offset"]
        tolerance += header["scale"] / 2
    np.testing.assert_allclose(values, expected, rtol=0, atol=tolerance)


def read_depth(path: Path) -> Any:
    """As the usual library of each format does."""
    if path.suffix == ".npz":
        with np.load(path) as archive:
            return archive["depth"]
    if path.suffix == ".exr":
        with OpenEXR.File(str(path)) as file:
            return file.channels()["Z"].pixels
    if path.suffix == ".zarr":
        group: Any = zarr.open_group(str(path), mode="r")
        return group["depth"][:]
    if path.suffix == ".png":
        return np.asarray(Image.open(path))
    if path.suffix == ".tif":
        return tifffile.imread(path)
    return np.load(path) if path.suffix == ".npy" else read_disparity(path)


def test_infinite_depth_needs_a_float_format(tmp_path: Path) -> None:
    far = np.full((5, 6), -100, np.float32)
    write(tmp_path / "depth.npy", far, scene=SCENE, quantity="depth")
    assert np.isinf(np.load(tmp_path / "depth.npy")).all()
    with pytest.raises(LightFieldError, match=r"depth\.png: depth: 30 of 30 values are NaN or infinite"):
        write(tmp_path / "depth.png", far, scene=SCENE, quantity="depth")


def test_depth_png_is_no_disparity(tmp_path: Path) -> None:
    write(tmp_path / "depth.png", MAP, scene=SCENE, quantity="depth")
    with pytest.raises(
        LightFieldError, match=r"depth\.png: depth with scale .*; expected the quantity disparity"
    ):
        read_disparity(tmp_path / "depth.png")


@pytest.mark.parametrize("path", ["map.ply", "map.pfm"])
def test_metres_need_a_camera(tmp_path: Path, path: str) -> None:
    for scene in (None, LightField(SCENE.views)):
        with pytest.raises(
            LightFieldError, match=r"the camera is unknown, but metres need it; give .*baseline_mm"
        ):
            write(tmp_path / path, MAP, scene=scene, quantity="depth")
    with pytest.raises(LightFieldError, match="views are 6x5 px; expected the map's 4x5"):
        write(tmp_path / path, MAP[:, :4], scene=SCENE, quantity="depth")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [1, 3])
def test_point_cloud(tmp_path: Path, dtype: str, channels: int) -> None:
    full = {"uint8": 255, "uint16": 65535, "float32": 1}[dtype]
    views = (np.random.default_rng(0).random((3, 3, 5, 6, channels)) * full).astype(dtype)
    write(tmp_path / "cloud.ply", RESULT, scene=LightField(views, CAMERA))
    cloud = plyfile.PlyData.read(tmp_path / "cloud.ply")
    assert not cloud.text
    vertex = cloud["vertex"]
    points = np.stack([vertex[name] for name in "xyz"], axis=1)
    np.testing.assert_allclose(points, CAMERA.points(MAP).reshape(-1, 3), rtol=1e-5, atol=1e-6)
    colours = np.stack([vertex[name] for name in ("red", "green", "blue")], axis=1)
    expected = np.broadcast_to(views[1, 1].reshape(-1, channels) * (255 / full), (30, 3))
    np.testing.assert_allclose(colours, expected, atol=0.51)
    np.testing.assert_array_equal(vertex["confidence"], RESULT.confidence.ravel())


def test_points_at_infinity_are_left_out(tmp_path: Path) -> None:
    far = MAP / np.float32(10)
    far[2, 3] = -100
    for mesh in (False, True):
        write(tmp_path / "cloud.ply", far, scene=SCENE, mesh=mesh)
        cloud = plyfile.PlyData.read(tmp_path / "cloud.ply")
        assert len(cloud["vertex"].data) == 29
        assert np.isfinite(cloud["vertex"]["z"]).all()
    faces = np.stack(cloud["face"]["vertex_indices"])
    assert faces.max() == 28
    assert len(faces) < 2 * 4 * 5


def test_mesh_of_a_surface_is_whole_and_faces_the_camera(tmp_path: Path) -> None:
    slanted = np.linspace(0, 0.6, 6, dtype=np.float32) + np.zeros((5, 1), np.float32)
    write(tmp_path / "mesh.ply", slanted, scene=SCENE, mesh=True)
    cloud = plyfile.PlyData.read(tmp_path / "mesh.ply")
    points = np.stack([cloud["vertex"][name] for name in "xyz"], axis=1)
    corners = points[np.stack(cloud["face"]["vertex_indices"])]
    assert len(corners) == 2 * 4 * 5
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners[:, 0]) < 0).all()


def test_mesh_is_cut_where_one_pixel_hides_the_other(tmp_path: Path) -> None:
    """In the outermost of 9 views (u = 4), neighbours change places from a step of 1/4 px on."""
    for step, whole in ((0.24, True), (0.26, False)):
        edge = np.zeros((5, 6), np.float32)
        edge[:, 3:] = step
        write(tmp_path / "mesh.ply", edge, scene=SCENE, mesh=True)
        faces = np.stack(plyfile.PlyData.read(tmp_path / "mesh.ply")["face"]["vertex_indices"])
        sides = edge.ravel()[faces] > 0
        crossing = sides.any(axis=1) & ~sides.all(axis=1)
        assert crossing.any() == whole
        assert len(faces) == 2 * 4 * (5 if whole else 4)


@given(
    disparity=arrays(np.float32, (4, 5), elements=st.floats(-1, 1, width=16)),
    valid=arrays(np.bool_, (4, 5)),
    step=st.floats(0.01, 3),
)
def test_triangles_are_small_and_of_neighbours(
    disparity: npt.NDArray[np.float32], valid: npt.NDArray[np.bool_], step: float
) -> None:
    faces = triangles(disparity, valid, step)
    pixels = np.argwhere(valid)[faces] if len(faces) else np.empty((0, 3, 2), int)
    assert (np.ptp(pixels, axis=1) == 1).all()
    assert (np.ptp(disparity[valid][faces], axis=1) < step).all()


def test_only_ply_holds_meshes(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match=r"map\.pfm: cannot hold a mesh; expected .* ending in \.ply"):
        write(tmp_path / "map.pfm", MAP, scene=SCENE, mesh=True)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("map.tif", r"not readable|array of shape \(0,\)"),
        ("map.exr", "not readable"),
        ("map.zarr", "not readable|expected an array 'disparity'"),
        ("map.ply", "unknown extension .ply"),
    ],
)
def test_damaged_maps_are_named(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_bytes(b"II*\0 or something else")
    with pytest.raises(LightFieldError, match=message) as caught:
        read_disparity(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_unknown_arrays_in_zarr(tmp_path: Path) -> None:
    write(tmp_path / "map.zarr", MAP, scene=SCENE, quantity="depth")
    with pytest.raises(LightFieldError, match=r"map\.zarr: holds .*depth; expected an array 'disparity'"):
        read_disparity(tmp_path / "map.zarr")
    zarr.create_array(str(tmp_path / "array.zarr"), data=MAP)
    with pytest.raises(LightFieldError, match=r"array\.zarr: holds nothing; expected an array 'disparity'"):
        read_disparity(tmp_path / "array.zarr")


def test_opencv_reads_pfm_png_and_tiff(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    for ending in (".pfm", ".tif", ".png"):
        write(tmp_path / f"map{ending}", MAP)
    for ending in (".pfm", ".tif"):
        values = cv2.imread(str(tmp_path / f"map{ending}"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(values, MAP)
    header = json.loads((tmp_path / "map.json").read_text())
    samples = cv2.imread(str(tmp_path / "map.png"), cv2.IMREAD_UNCHANGED)
    assert samples.dtype == np.uint16
    np.testing.assert_allclose(samples * header["scale"] + header["offset"], MAP, atol=header["scale"])


def test_no_npy_is_cut_off_in_silence(tmp_path: Path) -> None:
    """With room for all but the last bytes, writing fails, and the older file stays.

    NumPy's own writer leaves out what the last block lacks, and reports success.
    """
    resource = pytest.importorskip("resource", reason="limits on the size of files are POSIX")
    path = tmp_path / "map.npy"
    write(path, MAP)
    large = np.zeros((100, 101), np.float32)
    program = (
        "import resource, signal, sys, numpy, lfdepth\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({large.nbytes + 100},) * 2)\n"
        f"lfdepth.write(sys.argv[1], numpy.zeros({large.shape}, numpy.float32))\n"
    )
    assert resource.RLIMIT_FSIZE is not None
    done = subprocess.run([sys.executable, "-c", program, path], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "File too large" in done.stderr
    np.testing.assert_array_equal(read_disparity(path), MAP)
    assert [file.name for file in tmp_path.iterdir()] == ["map.npy"]
