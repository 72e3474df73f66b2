"""Light fields in every format that they are written in: read back by lfdepth, and by the usual libraries."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import imagecodecs
import numpy as np
import pytest
import scipy.io
import tifffile
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from fields import random_present
from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import check_light_field_writable, check_writable, read, read_disparity, write
from lfdepth.lightfield import LightField

KEEP_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
CONTAINERS = ("npz", "h5", "zarr", "mat")
NAMES = (*(f"lf.{ending}" for ending in (*CONTAINERS, "npy", "tif")), "lf")


@st.composite
def light_fields(draw: st.DrawFn, grids: tuple[tuple[int, int], ...] = ()) -> LightField:
    """Any size, sample type and knowledge; also sizes that could be taken for other orders of axes."""
    grid = draw(st.sampled_from(grids or ((3, 3), (4, 3), (1, 5), (6, 1), (9, 9))))
    size = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    channels, dtype = draw(st.sampled_from([1, 3])), draw(st.sampled_from(["uint8", "uint16", "float32"]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    views = rng.random((*grid, *size, channels)).astype(np.float32)
    if dtype != "float32":
        views = (views * np.iinfo(dtype).max).astype(dtype)
    present = random_present(rng, grid) if draw(st.booleans()) else None
    if present is not None:
        views[~present] = 0
        present = None if present.all() else present
    lf = LightField(views, present=present)
    if draw(st.booleans()):
        focus = draw(st.sampled_from([inf, 4.25, 1 / 3]))
        centre = draw(st.sampled_from([None, (0.1 + 0.2, -7.0)]))
        lf = replace(lf, camera=Camera(100 / 3, 36, 0.1, focus, size[1], size[0], centre))
    if draw(st.booleans()):
        lf = replace(lf, disparity_range=(-1 / 3, 0.1 + 0.2))
    if draw(st.booleans()):
        truth = rng.normal(0, 1, size).astype(np.float32)
        lf = replace(lf, truth=truth, masks={"flat": truth > 0, "Rand ä": truth < 1})
    return lf


def assert_same(found: LightField, lf: LightField, *, maps: bool = True) -> None:
    assert found.views.dtype == lf.views.dtype
    np.testing.assert_array_equal(found.views, lf.views)
    assert (found.camera, found.disparity_range) == (lf.camera, lf.disparity_range)
    assert (found.present is None) == (lf.present is None)
    if lf.present is not None:
        np.testing.assert_array_equal(found.present, lf.present)
    assert (found.truth is None) == (lf.truth is None or not maps)
    assert set(found.masks) == (set(lf.masks) if maps else set())
    if found.truth is not None:
        np.testing.assert_array_equal(found.truth, lf.truth)
    for name, mask in found.masks.items():
        np.testing.assert_array_equal(mask, lf.masks[name])


@KEEP_FOLDER
@given(lf=light_fields(), name=st.sampled_from(NAMES))
def test_every_format_returns_what_was_written(tmp_path: Path, lf: LightField, name: str) -> None:
    if name == "lf.tif" and lf.width == 1:
        with pytest.raises(LightFieldError, match="views 1 px wide; expected at least 2 px"):
            write(tmp_path / name, lf)
        return
    write(tmp_path / name, lf)
    assert_same(read(tmp_path / name), lf, maps=name.endswith((*CONTAINERS, "lf")))
    assert not [entry.name for entry in tmp_path.iterdir() if entry.name.startswith(".")]


@KEEP_FOLDER
@given(lf=light_fields(grids=((1, 6), (1, 5))), tiles=st.sampled_from(["1x1", "2x3", "3x2", "6x1", "5x1"]))
def test_quilt(tmp_path: Path, lf: LightField, tiles: str) -> None:
    path = tmp_path / f"flower_qs{tiles}a0.75.png"
    columns, rows = map(int, tiles.split("x"))
    if lf.views.dtype == np.float32 or columns * rows != lf.shape[1]:
        with pytest.raises(LightFieldError, match=r"float views|expected a single row of them"):
            write(path, lf)
        return
    write(path, lf)
    assert_same(read(path), lf, maps=False)
    picture = imagecodecs.png_decode(path.read_bytes()).reshape(rows * lf.height, columns * lf.width, -1)
    np.testing.assert_array_equal(picture[-lf.height :, : lf.width], lf.views[0, 0])  # bottom left
    np.testing.assert_array_equal(picture[: lf.height, -lf.width :], lf.views[0, -1])  # top right


@KEEP_FOLDER
@given(lf=light_fields())
def test_benchmark_folder(tmp_path: Path, lf: LightField) -> None:
    path = tmp_path / "scene"
    if lf.views.dtype == np.float32 or lf.camera is None or lf.disparity_range is None:
        with pytest.raises(LightFieldError, match=r"float views|unknown, but parameters\.cfg needs it"):
            write(path, lf, format="benchmark")
        return
    lf = replace(lf, masks={name.replace(" ", "_"): mask for name, mask in lf.masks.items()})
    write(path, lf, format="benchmark")
    assert_same(read(path, partial=True), lf)
    assert (path / "input_Cam000.png").exists() == (lf.present is None or bool(lf.present[0, 0]))


# --- as others read it

VIEWS = np.random.default_rng(0).integers(0, 65536, (3, 5, 8, 9, 3)).astype(np.uint16)
KNOWN = LightField(
    VIEWS,
    Camera(100, 35, 25, 4.25, 9, 8),
    (-1.5, 1.25),
    np.linspace(-1, 1, 72, dtype=np.float32).reshape(8, 9),
    {"planes": np.arange(72).reshape(8, 9) % 2 == 0},
)


def read_npz(path: Path) -> Any:
    with np.load(path) as archive:
        np.testing.assert_array_equal(archive["truth"], KNOWN.truth)
        np.testing.assert_array_equal(archive["mask_planes"], KNOWN.masks["planes"])
        return archive["LF"]


def read_hdf5(path: Path) -> Any:
    with h5py.File(path) as file:
        assert json.loads(file["lfdepth"][()])["disparity_range"] == [-1.5, 1.25]
        return file["LF"][:]


def read_zarr(path: Path) -> Any:
    group: Any = zarr.open_group(str(path), mode="r")
    assert group["LF"].chunks == (1, 1, 8, 9, 3)
    return group["LF"][:]


@pytest.mark.parametrize(
    ("name", "usual"),
    [
        ("x.npz", read_npz),
        ("x.npy", np.load),
        ("x.h5", read_hdf5),
        ("x.hdf5", read_hdf5),
        ("x.zarr", read_zarr),
        ("x.mat", lambda path: scipy.io.loadmat(path)["LF"]),
        ("x.tif", tifffile.imread),
    ],
)
def test_usual_libraries_read_it(tmp_path: Path, name: str, usual: Callable[[Path], Any]) -> None:
    write(tmp_path / name, KNOWN)
    np.testing.assert_array_equal(usual(tmp_path / name), VIEWS)


def test_folder_of_views_as_others_read_it(tmp_path: Path) -> None:
    write(tmp_path / "scene", KNOWN)
    views = {f"view_v{v:02d}_u{u:02d}.png" for v in range(3) for u in range(5)}
    names = {entry.name for entry in (tmp_path / "scene").iterdir()}
    assert names == views | {"lightfield.json", "truth.pfm", "masks", ".lfdepth.json"}
    for v, u in np.ndindex(3, 5):
        picture = imagecodecs.png_decode((tmp_path / f"scene/view_v{v:02d}_u{u:02d}.png").read_bytes())
        np.testing.assert_array_equal(picture, VIEWS[v, u])
    np.testing.assert_array_equal(
        np.asarray(Image.open(tmp_path / "scene/masks/planes.png")) == 255, KNOWN.masks["planes"]
    )
    (tmp_path / "scene/lightfield.json").unlink()
    np.testing.assert_array_equal(read(tmp_path / "scene").views, VIEWS)  # names say it all


def test_tiff_of_views_in_pillow(tmp_path: Path) -> None:
    eight_bit = replace(KNOWN, views=(VIEWS // 256).astype(np.uint8))
    write(tmp_path / "x.tif", eight_bit)
    with Image.open(tmp_path / "x.tif") as file:
        for number in range(15):
            file.seek(number)
            np.testing.assert_array_equal(np.asarray(file), eight_bit.views.reshape(15, 8, 9, 3)[number])


def test_real_lytro_picture_becomes_a_folder_of_views(tmp_path: Path, data_folder: Path) -> None:
    source = data_folder / "lytro_bikes_crop_eslf.png"
    lf = read(source, views=(13, 13), crop=(10, 20, 64, 48))
    assert lf.present is not None  # corners are dark
    for name in ("bikes", "bikes.npz", "bikes.h5"):
        write(tmp_path / name, lf)
        assert_same(read(tmp_path / name), lf)


# --- only what is asked for is read


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_of_any_order_in_memory(tmp_path: Path, save: Callable[..., None]) -> None:
    save(tmp_path / "x.npz", other=np.zeros(3), LF=np.asfortranarray(VIEWS), empty=np.zeros((0, 4)))
    np.testing.assert_array_equal(read(tmp_path / "x.npz").views, VIEWS)
    window = read(tmp_path / "x.npz", views=(3, 3), crop=(2, 3, 4, 5))
    np.testing.assert_array_equal(window.views, VIEWS[:, 1:4, 3:8, 2:6])


def test_an_array_that_its_header_makes_larger_than_it_is(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", LF=VIEWS)
    with zipfile.ZipFile(tmp_path / "x.npz") as archive:
        data = archive.read("LF.npy").replace(b"(3, 5, 8, 9, 3)", b"(9, 9, 8, 9, 3)")
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("LF.npy", data)
    with pytest.raises(LightFieldError, match=r"x\.npz: not readable"):
        read(tmp_path / "x.npz")


# --- what cannot be done


def test_arguments_that_are_for_the_other_kind(tmp_path: Path) -> None:
    truth = np.zeros((8, 9), np.float32)
    for options in ({"mesh": True}, {"quantity": "depth"}, {"scene": KNOWN}):
        with pytest.raises(LightFieldError, match="expected these only with a map"):
            write(tmp_path / "x.npz", KNOWN, **options)
    with pytest.raises(LightFieldError, match="expected that only with a light field"):
        write(tmp_path / "x.npz", truth, format="npz")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("x.jpg", {}, r"x\.jpg: unknown extension \.jpg for a light field; expected .*, or a folder"),
        ("x", {"format": "eslf"}, r"format 'eslf': not written; expected one of folder, benchmark, npz"),
        ("x.npz", {"format": "zarr"}, r"x\.npz: ending \.npz for the format zarr; expected \.zarr; rename"),
        ("x.png", {}, r"x\.png: 5x3 views; .*--views 5x1 .* call it x_qs5x1a1\.125\.png"),
        ("x_qs3x5a1.png", {}, r"expected a single row of them"),
    ],
)
def test_what_cannot_be_written(tmp_path: Path, name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(LightFieldError, match=message) as error:
        write(tmp_path / name, KNOWN, **options)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [*NAMES, "row_qs5x1a1.png"])
@pytest.mark.parametrize("exception", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_interrupted_writing_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, exception: BaseException | type[BaseException]
) -> None:
    lf = replace(KNOWN, views=VIEWS[:1]) if "qs" in name else KNOWN
    write(tmp_path / name, lf)
    before = {entry: entry.read_bytes() for entry in sorted(tmp_path.rglob("*")) if entry.is_file()}

    for act in ("replace", "rename"):
        original = getattr(Path, act)

        def interrupted(self: Path, target: Path, original: Any = original) -> Any:
            if self.parent == tmp_path:  # zarr moves its own files about
                raise exception
            return original(self, target)

        monkeypatch.setattr(Path, act, interrupted)
    monkeypatch.setattr("lfdepth.io.atomic._exchange", lambda first, second: interrupted(first, second))
    with pytest.raises((KeyboardInterrupt, LightFieldError)):
        write(tmp_path / name, replace(lf, views=lf.views // 2))
    assert {entry: entry.read_bytes() for entry in sorted(tmp_path.rglob("*")) if entry.is_file()} == before


def test_folders_of_something_else_are_left_alone(tmp_path: Path) -> None:
    for number, format in enumerate(("folder", "benchmark")):
        folder = tmp_path / str(number)
        for _ in range(2):  # its own are replaced
            write(folder, KNOWN, format=format)
        (folder / "notes.txt").write_text("dear")
        for act in (check_light_field_writable, lambda path, format: write(path, KNOWN, format=format)):
            with pytest.raises(LightFieldError, match="is a folder with other content"):
                act(folder, format)
        assert (folder / "notes.txt").read_text() == "dear"
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/view_v00_u00.png").write_bytes(b"dear")
    with pytest.raises(LightFieldError, match="is a folder with other content"):
        write(tmp_path / "photos", KNOWN)


def test_a_map_and_a_light_field_do_not_take_each_others_json(tmp_path: Path) -> None:
    assert KNOWN.truth is not None
    write(tmp_path / "x.npy", KNOWN)
    for act in (check_writable, lambda path: write(path, KNOWN.truth)):
        with pytest.raises(LightFieldError, match=r"x\.json: belongs to a light field"):
            act(tmp_path / "x.png")
    write(tmp_path / "y.png", KNOWN.truth)
    with pytest.raises(
        LightFieldError, match=r"y\.json: already holds something else, .* what y\.npy cannot hold"
    ):
        write(tmp_path / "y.npy", KNOWN)
    np.testing.assert_allclose(read_disparity(tmp_path / "y.png"), KNOWN.truth, atol=1e-4)
    assert_same(read(tmp_path / "x.npy"), KNOWN, maps=False)
    assert {entry.name for entry in tmp_path.iterdir()} == {"x.npy", "x.json", "y.png", "y.json"}


def test_names_of_masks_stay_in_the_folder(tmp_path: Path) -> None:
    lf = replace(KNOWN, masks={"../../evil": KNOWN.masks["planes"]})
    for format in ("folder", "benchmark"):
        with pytest.raises(LightFieldError, match=r"mask '../../evil'; expected a name of letters"):
            write(tmp_path / "scene", lf, format=format)
    assert not list(tmp_path.iterdir())


def test_mat_beyond_its_size_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lfdepth.io.matlab._MOST", 1000)
    with pytest.raises(LightFieldError, match=r"x\.mat: views take .*; write HDF5 \(\.h5\)"):
        write(tmp_path / "x.mat", KNOWN)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"lfdepth": "light field", "shape": [3, 5]}', r"x\.json: garbled"),
        ('{"lfdepth": "light field", "shape": [3, 5, 8, 9, 3], "present": ["1"]}', r"x\.json: garbled"),
        ('{"lfdepth": "light field", "shape": [3, 5, 8, 9, 3], "camera": {}}', r"x\.json: garbled"),
        (
            '{"lfdepth": "light field", "shape": [3, 5, 8, 9, 3], "disparity_range": [2, 1]}',
            r"x\.json: garbled \(disparity_range: found \[2, 1\]",
        ),
        ('{"lfdepth": "light field", "shape": [5, 3, 8, 9, 3]}', r"array of shape .* as stated in the notes"),
    ],
)
def test_garbled_notes_are_named(tmp_path: Path, text: str, message: str) -> None:
    np.save(tmp_path / "x.npy", VIEWS)
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(LightFieldError, match=message) as error:
        read(tmp_path / "x.npy")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"scale": 1}', "\x00"])
def test_json_of_something_else_is_not_looked_at(tmp_path: Path, text: str) -> None:
    np.save(tmp_path / "x.npy", VIEWS)
    (tmp_path / "x.json").write_text(text)
    np.testing.assert_array_equal(read(tmp_path / "x.npy").views, VIEWS)


def test_views_that_went_missing_after_writing_are_named(tmp_path: Path) -> None:
    write(tmp_path / "scene", KNOWN)
    (tmp_path / "scene/view_v00_u03.png").unlink()
    with pytest.raises(LightFieldError, match="1 of 15 views missing, first row 0, column 3"):
        read(tmp_path / "scene")
    present = read(tmp_path / "scene", partial=True).present
    assert present is not None
    assert np.argwhere(~present).tolist() == [[0, 3]]
    write(tmp_path / "extra", KNOWN)
    Image.fromarray(np.zeros((8, 9), np.uint8)).save(tmp_path / "extra/view_v03_u00.png")
    with pytest.raises(LightFieldError, match=r"view_v03_u00\.png: surplus picture; .* grid of 5x3"):
        read(tmp_path / "extra")
