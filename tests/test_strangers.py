"""Files from anybody: they run nothing, lead nowhere else, and fill no memory."""

import json
import os
import pickle
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import OpenEXR  # type: ignore[import-not-found]
import pytest
import scipy.io
import tifffile
import zarr
from PIL import Image

from lfdepth.bench.submission import check_submission
from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import limits, read, read_disparity, read_high_resolution, read_record, write
from lfdepth.io.mat5 import check_mat5
from lfdepth.io.notes import Bundle
from lfdepth.lightfield import LightField

VIEWS = np.random.default_rng(0).integers(0, 256, (3, 3, 6, 7, 3)).astype(np.uint8)
MAP = np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7)
SECRET = "a letter that did not come with the folder"


# --- code


class Payload:
    """What a pickle runs when it is loaded: here it makes a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.folder),)


def array_folder(root: Path, name: str, **known: Any) -> None:
    """An array of a Zarr store of format 2, of one chunk that is a pickle."""
    (root / name).mkdir(parents=True)
    shape = [3, 3, 6, 7, 3] if name == "LF" else [6, 7]
    text = {
        "zarr_format": 2,
        "shape": shape,
        "chunks": shape,
        "dtype": "|u1",
        "fill_value": 0,
        "order": "C",
        "compressor": None,
        "filters": None,
        **known,
    }
    (root / name / ".zarray").write_text(json.dumps(text))
    chunk = ".".join("0" * len(shape))
    (root / name / chunk).write_bytes(pickle.dumps(Payload(root.parent / "ran")))


@pytest.mark.parametrize(
    "packing",
    [
        {"filters": [{"id": "pickle"}]},
        {"compressor": {"id": "pickle"}},
        {"filters": [{"id": "pickle"}], "dtype": "|O", "fill_value": None},
        {"filters": [{"id": "delta", "dtype": "|O"}, {"id": "pickle"}]},
        {"dtype": "|O", "fill_value": None, "filters": [{"id": "json2"}]},
        {"dtype": [["a", "<f4"]]},
    ],
)
@pytest.mark.parametrize(("name", "act"), [("LF", read), ("disparity", read_disparity)])
def test_a_zarr_store_runs_nothing(tmp_path: Path, packing: dict[str, Any], name: str, act: Any) -> None:
    zarr.open_group(str(tmp_path / "x.zarr"), mode="w", zarr_format=2)
    array_folder(tmp_path / "x.zarr", name, **packing)
    with pytest.raises(LightFieldError, match=rf"x\.zarr: .*{name}") as error:
        act(tmp_path / "x.zarr")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["truth", "mask_planes"])
def test_truth_and_masks_of_a_zarr_store_run_nothing(tmp_path: Path, name: str) -> None:
    write(tmp_path / "x.zarr", LightField(VIEWS, truth=MAP, masks={"planes": MAP > 0}))
    metadata = tmp_path / "x.zarr" / name / ".zarray"
    known = json.loads(metadata.read_text())
    metadata.write_text(json.dumps({**known, "filters": [{"id": "pickle"}], "compressor": None}))
    (tmp_path / "x.zarr" / name / "0.0").write_bytes(pickle.dumps(Payload(tmp_path / "ran")))
    with pytest.raises(LightFieldError, match=rf"{name} is compressed by pickle; expected one of blosc"):
        read(tmp_path / "x.zarr")
    assert not (tmp_path / "ran").exists()


def test_consolidated_metadata_are_not_believed(tmp_path: Path) -> None:
    write(tmp_path / "x.zarr", MAP)
    zarr.consolidate_metadata(str(tmp_path / "x.zarr"))
    file = tmp_path / "x.zarr/.zmetadata"
    known = json.loads(file.read_text())
    known["metadata"]["disparity/.zarray"] |= {"filters": [{"id": "pickle"}], "compressor": None}
    file.write_text(json.dumps(known))
    np.testing.assert_array_equal(read_disparity(tmp_path / "x.zarr"), MAP)  # by the array's own


def test_zarr_format_3_with_a_codec_that_is_not_known(tmp_path: Path) -> None:
    zarr.create_array(str(tmp_path / "x.zarr"), data=VIEWS, zarr_format=3)
    np.testing.assert_array_equal(read(tmp_path / "x.zarr").views, VIEWS)
    file = tmp_path / "x.zarr/zarr.json"
    known = json.loads(file.read_text())
    for codecs in ([{"name": "numcodecs.pickle"}], [{"name": "sharding_indexed", "configuration": {
        "chunk_shape": [1], "codecs": [{"name": "numcodecs.pickle"}], "index_codecs": []}}]):  # fmt: skip
        file.write_text(json.dumps({**known, "codecs": codecs}))
        with pytest.raises(LightFieldError, match=r"compressed by numcodecs\.pickle; expected one of blosc"):
            read(tmp_path / "x.zarr")


def test_other_arrays_of_a_zarr_store_do_no_harm(tmp_path: Path) -> None:
    write(tmp_path / "x.zarr", LightField(VIEWS))
    array_folder(tmp_path / "x.zarr", "labels", dtype="|O", fill_value=None, filters=[{"id": "vlen-utf8"}])
    np.testing.assert_array_equal(read(tmp_path / "x.zarr").views, VIEWS)


def test_objects_in_npz_are_not_loaded(tmp_path: Path) -> None:
    payload = np.empty((), object)
    payload[()] = Payload(tmp_path / "ran")
    for name in ("LF", "disparity", "lfdepth"):
        arrays: dict[str, Any] = {"LF": VIEWS, "disparity": MAP} | {name: payload}
        np.savez(tmp_path / "x.npz", **arrays)
        with pytest.raises(LightFieldError):
            (read_record if name == "disparity" else read)(tmp_path / "x.npz")
    np.save(tmp_path / "x.npy", payload, allow_pickle=True)
    with pytest.raises(LightFieldError):
        read(tmp_path / "x.npy")
    assert not (tmp_path / "ran").exists()


def test_postscript_is_no_picture(tmp_path: Path) -> None:
    for v, u in np.ndindex(2, 2):
        Image.fromarray(VIEWS[v, u]).save(tmp_path / f"{v}_{u}.jpg")
    Image.fromarray(VIEWS[0, 0]).save(tmp_path / "1_1.eps")
    (tmp_path / "1_1.eps").rename(tmp_path / "1_1.jpg")
    with pytest.raises(LightFieldError, match=r"1_1\.jpg: not a readable picture"):
        read(tmp_path)


# --- other files


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A picture and bytes outside of the folder that is read."""
    (tmp_path / "secret.bin").write_bytes(SECRET.encode() * 100)
    Image.fromarray(VIEWS[0, 0]).save(tmp_path / "secret.png")
    return tmp_path


def linked_view(folder: Path) -> None:
    (folder / "scene/view_v00_u00.png").unlink()
    (folder / "scene/view_v00_u00.png").symlink_to(folder / "secret.png")


def linked_mask(folder: Path) -> None:
    (folder / "scene/masks/planes.png").unlink()
    (folder / "scene/masks/planes.png").symlink_to("../../secret.png")


def linked_masks(folder: Path) -> None:
    (folder / "scene/masks").rename(folder / "others")
    (folder / "scene/masks").symlink_to("../others")


def linked_truth(folder: Path) -> None:
    (folder / "scene/truth.pfm").rename(folder / "truth.pfm")
    (folder / "scene/truth.pfm").symlink_to("../truth.pfm")


def linked_notes(folder: Path) -> None:
    (folder / "scene/lightfield.json").rename(folder / "notes.json")
    (folder / "scene/lightfield.json").symlink_to("../notes.json")


@pytest.mark.parametrize("link", [linked_view, linked_mask, linked_masks, linked_truth, linked_notes])
def test_links_out_of_a_folder_are_refused(secret: Path, link: Callable[[Path], None]) -> None:
    write(secret / "scene", LightField(VIEWS, truth=MAP, masks={"planes": MAP > 0}))
    read(secret / "scene")
    link(secret)
    with pytest.raises(LightFieldError, match="is a link out of its folder; expected a file in it"):
        read(secret / "scene")


@pytest.mark.parametrize("name", ["input_Cam000.png", "parameters.cfg", "gt_disp_lowres.pfm"])
def test_links_out_of_a_benchmark_folder_are_refused(tmp_path: Path, name: str) -> None:
    from test_io import make_folder

    make_folder(tmp_path / "scene")
    write(tmp_path / "scene/gt_disp_lowres.pfm", np.zeros((5, 6), np.float32))
    (tmp_path / "link").symlink_to("scene")
    assert read(tmp_path / "link").name == "scene"  # the folder itself may be one
    (tmp_path / "scene" / name).rename(tmp_path / name)
    (tmp_path / "scene" / name).symlink_to(f"../{name}")
    with pytest.raises(LightFieldError, match=rf"{name}: is a link out of its folder"):
        read(tmp_path / "scene")


def test_links_within_a_folder_are_followed(tmp_path: Path) -> None:
    write(tmp_path / "scene", LightField(VIEWS))
    (tmp_path / "scene/view_v00_u00.png").unlink()
    (tmp_path / "scene/view_v00_u00.png").symlink_to("view_v01_u01.png")
    np.testing.assert_array_equal(read(tmp_path / "scene").views[0, 0], VIEWS[1, 1])


def test_links_out_of_a_zarr_store_are_refused(secret: Path) -> None:
    write(secret / "x.zarr", LightField(VIEWS))
    (secret / "x.zarr/LF/0.0.0.0.0").unlink()
    (secret / "x.zarr/LF/0.0.0.0.0").symlink_to(secret / "secret.bin")
    with pytest.raises(LightFieldError, match="is a link out of its folder"):
        read(secret / "x.zarr")


def test_high_resolution_truth_stays_in_its_folder(secret: Path) -> None:
    (secret / "scene").mkdir()
    write(secret / "elsewhere.pfm", MAP)
    (secret / "scene/gt_disp_highres.pfm").symlink_to("../elsewhere.pfm")
    with pytest.raises(LightFieldError, match="is a link out of its folder"):
        read_high_resolution(secret / "scene")
    (secret / "scene/gt_disp_highres.pfm").unlink()
    write(secret / "scene/gt_disp_highres.pfm", MAP)
    (secret / "scene/mask_x_highres.png").symlink_to("../secret.png")
    found = read_high_resolution(secret / "scene")
    assert found is not None
    assert "is a link out of its folder" in found.unusable["x"]


def test_pipes_in_a_folder_are_not_waited_for(tmp_path: Path) -> None:
    write(tmp_path / "scene", LightField(VIEWS))
    (tmp_path / "scene/view_v00_u00.png").unlink()
    os.mkfifo(tmp_path / "scene/view_v00_u00.png")
    os.mkfifo(tmp_path / "map.pfm")
    for act, name in ((read, "scene"), (read_disparity, "map.pfm"), (read, "map.pfm")):
        with pytest.raises(LightFieldError, match="is a device or a pipe; expected a file"):
            act(tmp_path / name)


def test_hdf5_that_refers_to_other_files(secret: Path) -> None:
    for name in ("external", "virtual", "link"):
        with h5py.File(secret / f"{name}.h5", "w") as file:
            if name == "external":
                size = VIEWS.size
                file.create_dataset("LF", VIEWS.shape, "u1", external=[(str(secret / "secret.bin"), 0, size)])
            elif name == "virtual":
                with h5py.File(secret / "other.h5", "w") as other:
                    other["LF"] = VIEWS
                layout = h5py.VirtualLayout(VIEWS.shape, "u1")
                layout[...] = h5py.VirtualSource(str(secret / "other.h5"), "LF", VIEWS.shape)
                file.create_virtual_dataset("LF", layout)
            else:
                file["LF"] = h5py.ExternalLink(str(secret / "other.h5"), "LF")
        message = "holds no arrays" if name == "link" else r"samples of /LF are stored in another file \(.*\)"
        with pytest.raises(LightFieldError, match=message):
            read(secret / f"{name}.h5")


def older_hdf5(path: Path, lf: LightField) -> None:
    """As lfdepth wrote it up to version 0.2: with its notes as an attribute of variable length."""
    bundle = Bundle.of(lf)
    with h5py.File(path, "w") as file:
        for name, array in bundle.arrays.items():
            file[name] = array
        file.attrs["lfdepth"] = bundle.text


def test_notes_in_hdf5_of_earlier_versions(tmp_path: Path) -> None:
    camera = Camera(50, 36, 4, 2, 7, 6)
    older_hdf5(tmp_path / "x.h5", LightField(VIEWS, camera, (-1.5, 1.25), truth=MAP))
    found = read(tmp_path / "x.h5")
    assert (found.camera, found.disparity_range) == (camera, (-1.5, 1.25))
    np.testing.assert_array_equal(found.truth, MAP)


def test_damaged_text_of_variable_length_in_hdf5(tmp_path: Path) -> None:
    """The HDF5 library looks for it for ever, where a length in its heap of texts is damaged."""
    path = tmp_path / "x.h5"
    older_hdf5(path, LightField(VIEWS, disparity_range=(-1.5, 1.25)))
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL")
    data[heap + 17 : heap + 25] = b"\xff" * 8
    path.write_bytes(data)
    code = f"from lfdepth.io import read; print(read({str(path)!r}).disparity_range)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=30, check=False)
    assert done.stdout.strip() == b"(-1.5, 1.25)"
    with h5py.File(path, "a") as file:
        del file.attrs["lfdepth"]
        file["lfdepth"] = h5py.ExternalLink("other.h5", "notes")
    assert read(path).disparity_range is None


def test_a_camera_of_variable_length_in_hdf5(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["LF"] = VIEWS
        file.attrs.update({"dH": 0.01, "focalLength": "500", "shift": 0.5})
    with pytest.raises(LightFieldError, match="focalLength is of type object; expected a number"):
        read(tmp_path / "x.h5")


def test_ome_tiff_that_refers_to_other_files(tmp_path: Path) -> None:
    """Nine pages of which four are in this file, as OME describes it; the others are not looked for."""
    tifffile.imwrite(tmp_path / "secret.tif", np.full((5, 6, 7), 7, np.uint8), photometric="minisblack")
    pages = "".join(
        f'<TiffData IFD="{page if page < 4 else page - 4}" FirstT="{page}" PlaneCount="1">'
        f'<UUID FileName="{"x" if page < 4 else "secret"}.tif">urn:uuid:{page // 4}</UUID></TiffData>'
        for page in range(9)
    )
    described = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
        'UUID="urn:uuid:0"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYTZC" Type="uint8" '
        f'SizeX="7" SizeY="6" SizeT="9" SizeZ="1" SizeC="1">{pages}</Pixels></Image></OME>'
    )
    own = VIEWS.reshape(9, 6, 7, 3)[:4, ..., 0]
    tifffile.imwrite(tmp_path / "x.tif", own, photometric="minisblack", description=described, metadata=None)
    with tifffile.TiffFile(tmp_path / "x.tif") as file:
        assert (file.series[0].asarray()[4:] == 7).all()  # this is what opening it in good faith would do
    try:
        views = read(tmp_path / "x.tif").views
    except LightFieldError:
        return
    np.testing.assert_array_equal(views.reshape(4, 6, 7), own)


def test_pages_of_a_tiff_in_a_circle(tmp_path: Path) -> None:
    """tifffile looks for some circles only, and goes round in others for ever."""
    path = tmp_path / "x.tif"
    with tifffile.TiffWriter(path) as writer:
        for _ in range(150):
            writer.write(VIEWS[0, 0], photometric="rgb", contiguous=False, metadata=None)
    with tifffile.TiffFile(path) as file:
        offsets = [page.offset for page in file.pages]
    data = bytearray(path.read_bytes())
    tags = struct.unpack_from("<H", data, offsets[-1])[0]
    struct.pack_into("<I", data, offsets[-1] + 2 + 12 * tags, offsets[120])
    path.write_bytes(data)
    with pytest.raises(LightFieldError, match="pages form a loop"):
        read(path, grid=(10, 15))


def test_names_in_hdf5_that_are_no_text(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["LF"] = VIEWS
        file[b"\xff\xfe"] = MAP
    np.testing.assert_array_equal(read(tmp_path / "x.h5").views, VIEWS)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_truth_beyond_all_numbers(tmp_path: Path) -> None:
    """Infinite is what a disparity is called that there is not."""
    np.save(tmp_path / "x.npy", VIEWS)
    write(tmp_path / "truth.pfm", np.where(MAP > 0, np.float32(3e38), MAP))
    truth = read(tmp_path / "x.npy", truth=tmp_path / "truth.pfm", truth_scale=2).truth
    assert truth is not None
    np.testing.assert_array_equal(truth, np.where(MAP > 0, np.inf, 2 * MAP))


# --- bombs


def exr_bomb(path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Y": MAP}) as file:
        file.write(str(path))
    window = struct.pack("<4i", 0, 0, 6, 5)
    data = path.read_bytes()
    assert data.count(window) == 2
    path.write_bytes(data.replace(window, struct.pack("<4i", 0, 0, 29999, 29999)))


def tiff_bomb(path: Path) -> None:
    """20000 × 20000 px, the same packed strip again and again."""
    strip = zlib.compress(bytes(100 * 20000 * 4))
    tifffile.imwrite(
        path, iter([strip] * 200), shape=(20000, 20000), dtype="f4", rowsperstrip=100, compression="zlib"
    )


def png_bomb(path: Path) -> None:
    """15000 × 15000 px of 16 bits, by its header."""
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", 15000, 15000, 16, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(1 << 20))),
        (b"IEND", b""),
    )
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in chunks
        )
    )


def mat_bomb(path: Path) -> None:
    """400 MB of zeros in 400 kB."""
    size = 400_000_000
    name = struct.pack("<HH4s", 1, 2, b"LF")
    flags, shape = struct.pack("<IIII", 6, 8, 9, 0), struct.pack("<IIii", 5, 8, size, 1)
    head = flags + shape + name + struct.pack("<II", 2, size)
    packing = zlib.compressobj()
    first, again = (
        packing.compress(part) + packing.flush(zlib.Z_FULL_FLUSH)
        for part in (struct.pack("<II", 14, len(head) + size) + head, bytes(1_000_000))
    )
    content = first + again * 400
    header = b"MATLAB 5.0 MAT-file".ljust(124, b" ") + struct.pack("<H2s", 0x0100, b"IM")
    path.write_bytes(header + struct.pack("<II", 15, len(content)) + content)


def hdf5_bomb(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "LF", (9, 9, 8000, 8000, 3), "u1", chunks=(1, 1, 8000, 8000, 3), compression="gzip"
        )


def zarr_bomb(path: Path) -> None:
    group = zarr.open_group(str(path), mode="w", zarr_format=2)
    group.create_array("LF", shape=(9, 9, 8000, 8000, 3), chunks=(1, 1, 8000, 8000, 3), dtype="u1")


def zarr_chunk_bomb(path: Path) -> None:
    write(path, LightField(VIEWS))
    metadata = path / "LF/.zarray"
    known = json.loads(metadata.read_text())
    metadata.write_text(json.dumps({**known, "chunks": [1, 1, 60000, 60000, 3]}))


def npz_bomb(path: Path) -> None:
    shape = (3, 3, 4000, 4000, 3)
    header = {"descr": "|u1", "fortran_order": False, "shape": shape}
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("LF.npy", "w") as file,
    ):
        np.lib.format.write_array_header_1_0(file, header)
        for _ in range(9):
            file.write(bytes(4000 * 4000 * 3))


def grid_bomb(path: Path) -> None:
    path.mkdir()
    for name in ("v0_u0", "v1_u1", "v1000000_u1000000"):
        Image.fromarray(VIEWS[0, 0]).save(path / f"{name}.png")


def number_bomb(path: Path) -> None:
    path.mkdir()
    for number in ("000", "1" + "0" * 40):
        Image.fromarray(VIEWS[0, 0]).save(path / f"input_Cam{number}.png")


def text_bomb(path: Path) -> None:
    path.mkdir()
    Image.fromarray(VIEWS[0, 0]).save(path / "input_Cam000.png")
    with (path / "parameters.cfg").open("wb") as file:
        file.truncate(1 << 40)


@pytest.mark.parametrize(
    ("name", "make", "act", "message"),
    [
        ("x.exr", exr_bomb, read_disparity, "unpacks to 3.4 GiB from"),
        ("x.tif", tiff_bomb, read_disparity, "unpacks to 1.5 GiB from"),
        ("x.png", png_bomb, lambda path: read(path, format="eslf"), "unpacks to 429.2 MiB from"),
        ("x.mat", mat_bomb, read, "unpacks to 381.5 MiB from"),
        ("x.h5", hdf5_bomb, read, "unpacks to 14.5 GiB from"),
        ("x.zarr", zarr_bomb, read, "unpacks to 14.5 GiB from"),
        ("x.zarr", zarr_chunk_bomb, read, "unpacks to 10.1 GiB; expected at most 8.0 GiB"),
        ("x.npz", npz_bomb, read, "unpacks to 412.0 MiB from"),
        ("x", grid_bomb, read, "a grid of 1000001x1000001 views|views missing"),
        ("x", number_bomb, read, "expected a square number|a grid of"),
        ("x", text_bomb, read, "more than 16.0 MiB of text"),
    ],
)
def test_bombs_are_refused_before_they_are_unpacked(
    tmp_path: Path, name: str, make: Callable[[Path], None], act: Any, message: str
) -> None:
    make(tmp_path / name)
    with pytest.raises(LightFieldError, match=message) as error:
        act(tmp_path / name)
    assert "\n" not in str(error.value)


def test_what_is_large_and_honest_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "FREE_BYTES", 1000)
    for name in ("x.npz", "x.h5", "x.zarr", "x.mat", "x.tif", "x.npy", "x"):
        write(tmp_path / name, LightField(VIEWS))
        np.testing.assert_array_equal(read(tmp_path / name).views, VIEWS)


def test_submissions_are_unpacked_only_as_zip_usually_is(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("disp_maps/cotton.pfm", bytes(1000))
    assert any(
        "disp_maps/cotton.pfm: not compressed by deflate" in problem
        for problem in check_submission(tmp_path / "x.zip")
    )


# --- damage that libraries do not survive


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP"])
@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.uint32])
@pytest.mark.parametrize("shape", [(1, 1), (6, 7), (37, 53), (100, 3)])
def test_openexr_that_the_library_wrote(
    tmp_path: Path, compression: str, dtype: Any, shape: tuple[int, int]
) -> None:
    values = (np.random.default_rng(1).random(shape) * 9).round(1).astype(dtype)
    flat = np.zeros(shape, np.float32)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Y": values, "confidence": flat}) as file:
        file.write(str(tmp_path / "x.exr"))
    found = read_record(tmp_path / "x.exr")
    np.testing.assert_array_equal(found.values, values.astype(np.float32))
    np.testing.assert_array_equal(found.confidence, flat)


def test_openexr_of_other_kinds_says_what_to_do(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Y": MAP}) as file:
        file.write(str(tmp_path / "x.exr"))
    with pytest.raises(LightFieldError, match=r"OpenEXR with compression PIZ; .* convert it"):
        read_disparity(tmp_path / "x.exr")


@pytest.mark.parametrize("packed", [False, True])
def test_matlab_5_of_all_kinds_passes_the_check(tmp_path: Path, packed: bool) -> None:
    variables = {
        "LF": VIEWS,
        "nested": {"a": 1.5, "b": {"c": "text", "d": np.arange(5)}},
        "cell": np.array([1, "x", np.zeros((0, 3))], object),
        "complex": np.ones(3) * 1j,
        "flags": np.array([True, False]),
        "records": np.array([(1, 2.0), (3, 4.0)], [("q", "i4"), ("z", "f8")]),
        "empty": np.zeros((0, 0)),
    }
    scipy.io.savemat(tmp_path / "x.mat", variables, do_compression=packed)
    check_mat5(tmp_path / "x.mat")
    np.testing.assert_array_equal(read(tmp_path / "x.mat").views, VIEWS)


def test_matlab_5_with_a_type_that_does_not_exist(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"LF": VIEWS})
    data = bytearray((tmp_path / "x.mat").read_bytes())
    at = data.index(struct.pack("<II", 2, VIEWS.size))
    data[at : at + 4] = struct.pack("<I", 1000)
    (tmp_path / "x.mat").write_bytes(data)
    with pytest.raises(LightFieldError, match=r"x\.mat: not readable \(.* of type 1000"):
        read(tmp_path / "x.mat")
