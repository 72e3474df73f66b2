import json
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import check_writable, read, read_disparity, write
from lfdepth.io.atomic import atomic
from lfdepth.lightfield import LightField

CONFIG = """[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = 6
image_resolution_y_px = 5
sensor_size_mm = 35.0

[extrinsics]
num_cams_x = 4
num_cams_y = 3
baseline_mm = 25.0
focus_distance_m = 4.25

[meta]
scene = test
category = 100% test
disp_min = -1.6
disp_max = 1.5
"""
KEEP_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)


def make_folder(folder: Path, *, dtype: str = "uint8", channels: int = 3) -> npt.NDArray[Any]:
    """A benchmark folder with 4x3 views of 6x5 px."""
    folder.mkdir(exist_ok=True)
    views = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (3, 4, 5, 6, channels), dtype=dtype)
    for index, view in enumerate(views.reshape(12, 5, 6, channels)):
        (folder / f"input_Cam{index:03d}.png").write_bytes(imagecodecs.png_encode(view.squeeze()))
    (folder / "parameters.cfg").write_text(CONFIG)
    return views


def pfm_bytes(values: npt.NDArray[Any], byte_order: str = "<", scale: str = "1.0") -> bytes:
    """A PFM by its public description: rows from the bottom up, byte order in the sign of the scale."""
    height, width = values.shape
    sign = "-" if byte_order == "<" else ""
    return (
        f"Pf\n{width} {height}\n{sign}{scale}\n".encode() + values[::-1].astype(f"{byte_order}f4").tobytes()
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_folder(tmp_path / "scene")
    return tmp_path / "scene"


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("channels", [1, 3])
def test_benchmark_folder_with_everything(tmp_path: Path, dtype: str, channels: int) -> None:
    folder = tmp_path / "größe mit leerzeichen"
    views = make_folder(folder, dtype=dtype, channels=channels)
    truth = np.linspace(-1, 1, 30, dtype=np.float32).reshape(5, 6)
    (folder / "gt_disp_lowres.pfm").write_bytes(pfm_bytes(truth))
    Image.fromarray((truth > 0).astype(np.uint8) * 255).save(folder / "mask_smooth_surfaces_lowres.png")
    Image.fromarray(np.zeros((50, 60), np.uint8)).save(folder / "mask_smooth_surfaces_highres.png")
    lf = read(folder)
    assert lf.views.dtype == dtype
    np.testing.assert_array_equal(lf.views, views)
    assert lf.camera == Camera(100, 35, 25, 4.25, width=6, height=5)
    assert lf.disparity_range == (-1.6, 1.5)
    assert lf.truth is not None
    np.testing.assert_array_equal(lf.truth, truth)
    assert list(lf.masks) == ["smooth_surfaces"]
    np.testing.assert_array_equal(lf.masks["smooth_surfaces"], truth > 0)
    assert lf.name == "größe mit leerzeichen"


def test_square_folder_reads_without_parameters(folder: Path) -> None:
    (folder / "parameters.cfg").unlink()
    for index in range(9, 12):
        (folder / f"input_Cam{index:03d}.png").unlink()
    lf = read(folder)
    assert lf.shape == (3, 3, 5, 6, 3)
    assert lf.camera is None
    assert lf.disparity_range is None


def test_real_scenes_obey_the_sign_convention(data_folder: Path) -> None:
    for scene in ("cotton", "backgammon"):
        lf = read(data_folder / "hci4d" / scene)
        assert lf.shape == (9, 9, 512, 512, 3)
        assert lf.truth is not None
        assert warp_error(lf, 1) < 0.5 * warp_error(lf, -1)


def warp_error(lf: LightField, sign: int) -> float:
    """Median difference between the reference view and four views sampled at (x - D·u, y - D·v)."""
    from scipy.ndimage import map_coordinates

    assert lf.truth is not None
    grey = lf.grey().astype(np.float32)
    y, x = np.mgrid[: lf.height, : lf.width]
    differences = []
    for v, u in ((4, 7), (7, 4), (1, 4), (4, 1)):
        shift = sign * lf.truth
        at = np.stack([y - shift * (v - 4), x - shift * (u - 4)])
        differences.append(np.abs(map_coordinates(grey[v, u], at, order=1, mode="nearest") - grey[4, 4]))
    return float(np.mean(differences))


def edit_config(old: str, new: str) -> Any:
    def edit(folder: Path) -> None:
        assert old in CONFIG
        (folder / "parameters.cfg").write_text(CONFIG.replace(old, new))

    return edit


def remove(name: str) -> Any:
    return lambda folder: (folder / name).unlink()


def replace_view(view: npt.NDArray[Any]) -> Any:
    return lambda folder: (folder / "input_Cam007.png").write_bytes(imagecodecs.png_encode(view))


def truncate(folder: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (5, 6, 3), np.uint8)
    data = imagecodecs.png_encode(noise)
    (folder / "input_Cam007.png").write_bytes(data[: len(data) // 2])


def truncate_16_bit(folder: Path) -> None:
    make_folder(folder, dtype="uint16")
    data = (folder / "input_Cam007.png").read_bytes()
    (folder / "input_Cam007.png").write_bytes(data[: len(data) // 2])


def palette(folder: Path) -> None:
    Image.fromarray(np.zeros((5, 6), np.uint8)).convert("P").save(folder / "input_Cam007.png")


def write_truth(data: bytes) -> Any:
    return lambda folder: (folder / "gt_disp_lowres.pfm").write_bytes(data)


MAP = np.arange(30, dtype=np.float32).reshape(5, 6)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            remove("input_Cam003.png"),
            r"scene: 1 of 12 views missing, first input_Cam003\.png; expected a grid of 4x3",
        ),
        (
            remove("input_Cam000.png"),
            r"scene: 1 of 12 views missing, first input_Cam000\.png; expected a grid of 4x3",
        ),
        (
            lambda folder: (folder / "input_Cam012.png").write_bytes(b""),
            r"scene: 1 surplus views, first input_Cam012\.png; expected 12 views",
        ),
        (remove("parameters.cfg"), "scene: 12 views; expected a square number"),
        (
            replace_view(np.zeros((5, 7, 3), np.uint8)),
            r"input_Cam007\.png: view is 7x5 px, colour, uint8 but",
        ),
        (replace_view(np.zeros((5, 6), np.uint8)), r"input_Cam007\.png: view is 6x5 px, grey, uint8 but"),
        (
            replace_view(np.zeros((5, 6, 3), np.uint16)),
            r"input_Cam007\.png: view is 6x5 px, colour, uint16 but",
        ),
        (
            replace_view(np.zeros((5, 6, 4), np.uint8)),
            r"input_Cam007\.png: alpha is not opaque at 100 % of the pixels; expected grey",
        ),
        (
            replace_view(np.zeros((5, 6, 4), np.uint16)),
            r"input_Cam007\.png: alpha is not opaque at 100 % of the pixels; expected grey",
        ),
        (palette, r"input_Cam007\.png: picture of mode P; expected grey or RGB"),
        (truncate, r"input_Cam007\.png: not a readable picture \(.*\); expected a complete image"),
        (truncate_16_bit, r"input_Cam007\.png: not a readable picture \(.*\); expected a complete image"),
        (
            lambda folder: (folder / "input_Cam007.png").write_text("no picture"),
            r"input_Cam007\.png: not a readable picture",
        ),
        (lambda folder: (folder / "parameters.cfg").write_bytes(b"\xff\xfe[["), r"parameters\.cfg: garbled"),
        (edit_config("[intrinsics]", "intrinsics"), r"parameters\.cfg: garbled"),
        (
            edit_config("baseline_mm = 25.0\n", ""),
            r"\[extrinsics\] baseline_mm is missing; expected a number",
        ),
        (edit_config("baseline_mm = 25.0", "baseline_mm = x"), r"\[extrinsics\] baseline_mm is x; expected"),
        (edit_config("baseline_mm = 25.0", "baseline_mm = -2"), r"parameters\.cfg: .*baseline_mm is -2"),
        (edit_config("num_cams_x = 4", "num_cams_x = 4.5"), r"num_cams_x is 4\.5; expected a count"),
        (edit_config("num_cams_x = 4", "num_cams_x = 5"), "3 of 15 views missing, first input_Cam012"),
        (edit_config("num_cams_x = 4", "num_cams_x = 3"), r"3 surplus views, first input_Cam009\.png"),
        (
            edit_config("_x_px = 6", "_x_px = 7"),
            r"input_Cam000\.png: 6x5 px; expected 7x5 as parameters\.cfg",
        ),
        (
            edit_config("disp_min = -1.6", "disp_min = 1.6"),
            r"disp_min to disp_max: found \[1\.6, 1\.5\], expected",
        ),
        (
            edit_config("disp_max = 1.5", "disp_max = inf"),
            r"disp_min to disp_max: found \[-1\.6, inf\], expected",
        ),
        (
            edit_config("disp_max = 1.5", "disp_max = nan"),
            r"disp_min to disp_max: found \[-1\.6, nan\], expected",
        ),
        (write_truth(pfm_bytes(MAP)[:-3]), r"gt_disp_lowres\.pfm: 129 bytes; expected 132 for 6x5 px"),
        (write_truth(pfm_bytes(MAP)[:5]), r"gt_disp_lowres\.pfm: no valid PFM header"),
        (write_truth(pfm_bytes(MAP[1:])), r"scene: truth is float32 \(4, 6\); expected float32 \(5, 6\)"),
    ],
)
def test_damaged_folders_are_named(folder: Path, damage: Any, message: str) -> None:
    damage(folder)
    with pytest.raises(LightFieldError, match=message) as caught:
        read(folder)
    assert "\n" not in str(caught.value)


def test_what_is_no_light_field_is_named(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match="absent: no such file or folder"):
        read(tmp_path / "absent")
    with pytest.raises(LightFieldError, match="not recognised as a light field"):
        read(tmp_path)


maps = arrays(
    np.float32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.floats(-1e6, 1e6, width=32)
)


@KEEP_FOLDER
@given(values=maps, ending=st.sampled_from([".pfm", ".npy", ".npz", ".PFM"]))
def test_float_formats_return_what_was_written(
    tmp_path: Path, values: npt.NDArray[np.float32], ending: str
) -> None:
    path = tmp_path / f"karte ä{ending}"
    write(path, values)
    np.testing.assert_array_equal(read_disparity(path), values)


@KEEP_FOLDER
@given(values=maps)
def test_png_is_exact_to_half_its_scale(tmp_path: Path, values: npt.NDArray[np.float32]) -> None:
    write(tmp_path / "map.png", values)
    header = json.loads((tmp_path / "map.json").read_text())
    assert header["unit"] == "px per view step"
    # Read as somebody else would, by the stored scale alone.
    samples = np.asarray(Image.open(tmp_path / "map.png"))
    assert samples.dtype == np.uint16
    rounding = 0.5 * header["scale"] + 1e-6 * float(np.abs(values).max())
    np.testing.assert_allclose(samples * header["scale"] + header["offset"], values, rtol=0, atol=rounding)
    np.testing.assert_allclose(read_disparity(tmp_path / "map.png"), values, rtol=0, atol=rounding)


@KEEP_FOLDER
@given(values=maps, byte_order=st.sampled_from("<>"), scale=st.sampled_from(["1", "1.000000", "0.5"]))
def test_pfm_of_either_byte_order_is_read(
    tmp_path: Path, values: npt.NDArray[np.float32], byte_order: str, scale: str
) -> None:
    path = tmp_path / "map.pfm"
    path.write_bytes(pfm_bytes(values, byte_order, scale))
    read_back = read_disparity(path)
    assert read_back.dtype == np.dtype("=f4")
    np.testing.assert_array_equal(read_back, values)


def test_written_pfm_is_laid_out_by_its_description(tmp_path: Path) -> None:
    write(tmp_path / "map.pfm", MAP)
    assert (tmp_path / "map.pfm").read_bytes() == b"Pf\n6 5\n-1\n" + MAP[::-1].astype("<f4").tobytes()


@dataclass(frozen=True)
class FakeMethod:
    name: str = "fbs"

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "step": 0.02}


@dataclass(frozen=True)
class FakeResult:
    disparity: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]
    range: tuple[float, float] = (-1.0, 2.0)
    runtime: float = 3.5
    method: FakeMethod = FakeMethod()
    sigma: npt.NDArray[np.float32] | None = None


def test_npz_holds_all_that_is_known(tmp_path: Path) -> None:
    result: Any = FakeResult(MAP, MAP / np.float32(30))
    write(tmp_path / "map.npz", result)
    with np.load(tmp_path / "map.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["disparity"], MAP)
        np.testing.assert_array_equal(archive["confidence"], MAP / np.float32(30))
        np.testing.assert_array_equal(archive["range"], [-1, 2])
        assert archive["runtime"] == 3.5
        assert json.loads(str(archive["parameters"])) == {"name": "fbs", "step": 0.02}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full((3, 4), np.nan, np.float32), "disparity: 12 of 12 values are NaN or infinite"),
        (np.zeros((3, 4, 1), np.float32), r"float32 array of shape \(3, 4, 1\); expected numbers of shape"),
        (np.zeros((0, 4), np.float32), r"shape \(0, 4\)"),
        (np.zeros((3, 4), complex), "complex128 array"),
    ],
)
@pytest.mark.parametrize("ending", [".pfm", ".png", ".npy", ".npz"])
def test_what_is_no_map_is_not_written(
    tmp_path: Path, values: npt.NDArray[Any], message: str, ending: str
) -> None:
    with pytest.raises(LightFieldError, match=message):
        write(tmp_path / f"map{ending}", values)
    assert not list(tmp_path.iterdir())


def test_unknown_ending_lists_the_known_ones(tmp_path: Path) -> None:
    known = re.escape("expected one of .pfm, .png, .npy, .npz, .tif, .tiff, .exr, .zarr")
    for path in (tmp_path / "map.exe", tmp_path / "map"):
        with pytest.raises(LightFieldError, match=known):
            check_writable(path)
        with pytest.raises(LightFieldError, match=known):
            write(path, MAP)
        with pytest.raises(LightFieldError, match=known):
            read_disparity(path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("act", [check_writable, lambda path: write(path, MAP)])
def test_unwritable_places_are_named(tmp_path: Path, act: Any) -> None:
    with pytest.raises(LightFieldError, match=r"map\.pfm: folder .*absent does not exist"):
        act(tmp_path / "absent/map.pfm")
    (tmp_path / "folder.pfm").mkdir()
    with pytest.raises(LightFieldError, match=r"folder\.pfm: is a folder"):
        act(tmp_path / "folder.pfm")
    (tmp_path / "loop.pfm").symlink_to("loop.pfm")
    with pytest.raises(LightFieldError, match=r"loop\.pfm: (loop of symbolic links|cannot be written)"):
        act(tmp_path / "loop.pfm")
    if Path("/proc").is_dir():  # not even root may write there
        with pytest.raises(LightFieldError, match=r"/proc/map\.pfm: cannot be written"):
            act("/proc/map.pfm")


def test_checking_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "old.pfm").write_text("old")
    check_writable(tmp_path / "new.pfm")
    check_writable(tmp_path / "old.pfm")
    assert [file.name for file in tmp_path.iterdir()] == ["old.pfm"]
    assert (tmp_path / "old.pfm").read_text() == "old"


@pytest.mark.parametrize("exception", [KeyboardInterrupt, RuntimeError])
def test_interrupted_writing_leaves_the_old_file(tmp_path: Path, exception: type[BaseException]) -> None:
    path = tmp_path / "map.pfm"
    path.write_text("old")

    def interrupted() -> None:
        with atomic(path) as temporary:
            temporary.write_text("half")
            raise exception

    with pytest.raises(exception):
        interrupted()
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


@pytest.mark.parametrize("ending", [".pfm", ".npy", ".npz", ".png"])
def test_full_disk_is_named_and_leaves_nothing(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    opened = os.open

    def linked_to_full_disk(name: Any, flags: int, mode: int = 0o777) -> int:
        Path(name).symlink_to("/dev/full")  # every write there fails as on a full disk
        return opened("/dev/null", os.O_WRONLY)

    monkeypatch.setattr(os, "open", linked_to_full_disk)
    with pytest.raises(
        LightFieldError, match=rf"map\{ending}: cannot be written \(No space left on device\)"
    ):
        write(tmp_path / f"map{ending}", np.zeros((300, 300), np.float32) + MAP[0, 1])
    assert not list(tmp_path.iterdir())


def test_written_file_has_usual_permissions_and_follows_links(tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    (tmp_path / "link.pfm").symlink_to("real.pfm")
    write(tmp_path / "link.pfm", MAP)
    assert (tmp_path / "link.pfm").is_symlink()
    real = tmp_path / "real.pfm"
    assert stat.S_IMODE(real.stat().st_mode) == stat.S_IMODE((tmp_path / "usual").stat().st_mode)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("map.pfm", pfm_bytes(MAP)[:-1], "131 bytes; expected 132 for 6x5 px; the file is truncated"),
        ("map.pfm", pfm_bytes(MAP) + b"x", "133 bytes; expected 132 for 6x5 px; the file is damaged"),
        ("map.pfm", b"", "no valid PFM header"),
        ("map.pfm", b"Pf\n6 x\n-1\n", "no valid PFM header"),
        ("map.pfm", b"Pf\n-6 5\n-1\n", "no valid PFM header"),
        ("map.pfm", b"Pf\n6 5\nnan\n", "no valid PFM header"),
        ("map.pfm", b"PF\n1 1\n-1\n" + bytes(12), "colour PFM; expected a grey PFM"),
        ("map.pfm", pfm_bytes(MAP + np.float32(np.nan)), "30 of 30 values are NaN"),
        ("map.npy", b"\x93NUMPY", "not readable .* expected a complete file"),
        ("map.npy", b"", "not readable .* expected a complete file"),
        ("map.npz", b"PK\x03\x04", "not readable .* expected a complete file"),
        ("map.png", b"", "not a readable picture"),
    ],
)
def test_damaged_maps_are_named(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(LightFieldError, match=rf"{re.escape(name)}: .*{message}") as caught:
        read_disparity(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_other_arrays_are_no_maps(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "stack.npy", np.zeros((2, 3, 4)))
    np.savez(tmp_path / "other.npz", depth=MAP)
    with pytest.raises(LightFieldError, match=r"objects\.npy: not readable"):
        read_disparity(tmp_path / "objects.npy")
    with pytest.raises(LightFieldError, match=r"stack\.npy: float64 array of shape \(2, 3, 4\)"):
        read_disparity(tmp_path / "stack.npy")
    with pytest.raises(LightFieldError, match=r"other\.npz: holds depth; expected an array 'disparity'"):
        read_disparity(tmp_path / "other.npz")
    with pytest.raises(LightFieldError, match=r"absent\.npy: no such file"):
        read_disparity(tmp_path / "absent.npy")


def test_nan_is_read_where_asked(tmp_path: Path) -> None:
    (tmp_path / "map.pfm").write_bytes(pfm_bytes(MAP + np.float32(np.nan)))
    assert np.isnan(read_disparity(tmp_path / "map.pfm", finite=False)).all()


def without_text(png: Path) -> None:
    """Store the pixels of a PNG again, as programs do that keep nothing else."""
    png.write_bytes(imagecodecs.png_encode(imagecodecs.png_decode(png.read_bytes())))


def test_png_without_its_scale_is_named(tmp_path: Path) -> None:
    write(tmp_path / "map.png", MAP)
    without_text(tmp_path / "map.png")
    for text in (
        "{",
        "[]",
        '{"scale": 0, "offset": 1}',
        '{"scale": 1}',
        '{"quantity": "depth", "scale": 1, "offset": 0}',
    ):
        (tmp_path / "map.json").write_text(text)
        with pytest.raises(
            LightFieldError, match=r"map\.json: .*; expected the quantity disparity, its scale > 0"
        ):
            read_disparity(tmp_path / "map.png")
    (tmp_path / "map.json").unlink()
    with pytest.raises(LightFieldError, match=r"map\.json: missing"):
        read_disparity(tmp_path / "map.png")
    Image.fromarray(np.zeros((3, 4, 3), np.uint8)).save(tmp_path / "map.png")
    with pytest.raises(LightFieldError, match="uint8 picture with 3 channels; expected a 16-bit grey map"):
        read_disparity(tmp_path / "map.png")
