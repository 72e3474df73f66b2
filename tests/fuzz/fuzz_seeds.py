"""Small files and folders of every kind that lfdepth reads, for `fuzz_run` to damage."""

from __future__ import annotations

import os
import traceback
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import imagecodecs
import numpy as np
import OpenEXR  # type: ignore[import-not-found]
import scipy.io
import tifffile
import zarr
from PIL import Image

from lfdepth.bench.submission import SCENES
from lfdepth.camera import Camera
from lfdepth.io import write
from lfdepth.io.notes import KEY, Bundle
from lfdepth.io.record import Record
from lfdepth.lightfield import LightField

COMMANDS = {
    "light field": "info {path} --no-check --json",
    "mosaic": "info {path} --format mosaic --grid 3x3 --no-check --json",
    "positions": "info {path}/x.npy --positions {path}/table.csv --no-check --json",
    **{
        f"truth {form}": f"info {{path}}/x.npy --truth {{path}}/truth{form} --truth-scale 2 --no-check --json"
        for form in (".h5", ".mat", ".png")
    },
    "map": "convert {path} -o {out}.npz --json",
    "submission": "submit --check {path} --json",
    "scores": "evaluate {path}/map.pfm {path}/scene --json",
}
"""The command that reads a seed, by what the seed is. `convert` writes to `out`, the others write nothing."""


@dataclass(frozen=True)
class Seed:
    """A file or folder as bytes by relative path; `entry` is what the command is given."""

    name: str
    kind: str
    entry: str
    files: dict[str, bytes]


_SHAPE = (3, 3, 12, 14, 3)


def _light_field(
    dtype: str = "uint8", channels: int = 3, size: tuple[int, int] = (_SHAPE[2], _SHAPE[3])
) -> LightField:
    random = np.random.default_rng(7)
    shape = (*_SHAPE[:2], *size, channels)
    views: Any = random.integers(0, 255, shape).astype(dtype)
    views = views / np.float32(255) if dtype == "float32" else views
    return LightField(
        views,
        camera=Camera(50, 36, 4, 2, size[1], size[0]),
        disparity_range=(-1.0, 1.5),
        truth=random.uniform(-1, 1.5, size).astype(np.float32),
        masks={"planes": random.random(size) > 0.5},
        name="seed",
    )


def _record() -> Record:
    random = np.random.default_rng(8)
    values, confidence = random.random((2, 12, 14)).astype(np.float32)
    return Record(values, confidence=confidence, range=(-1.0, 1.0), runtime=1.5, parameters='{"name": "fbs"}')


def make_seeds(folder: Path) -> list[Seed]:
    """Write every seed once in a folder, and take them into memory.

    They are written in a child: libraries start threads, which children that are forked later would lack.
    """
    child = os.fork()
    if not child:
        try:
            for name, (_, entry, make) in KINDS.items():
                (folder / name).mkdir(parents=True)
                make(folder / name / entry)
            os._exit(0)
        finally:
            traceback.print_exc()
            os._exit(1)
    if os.waitpid(child, 0)[1]:
        raise RuntimeError("seeds could not be written")
    seeds = []
    for name, (kind, entry, _) in KINDS.items():
        place = folder / name
        files = {
            file.relative_to(place).as_posix(): file.read_bytes()
            for file in sorted(place.rglob("*"))
            if file.is_file()
        }
        seeds.append(Seed(name, kind, entry, files))
    return seeds


def _written(**options: Any) -> Callable[[Path], None]:
    """A light field that lfdepth writes."""
    row, format = options.pop("row", False), options.pop("format", None)
    lf = _light_field(**options)
    return lambda path: write(path, replace(lf, views=lf.views[:1]) if row else lf, format=format)


def _map(path: Path) -> None:
    write(path, _record())


def _compressed_npz(path: Path) -> None:
    lf = _light_field()
    np.savez_compressed(path, LF=lf.views, weights=np.ones((3, 3)))


def _older_benchmark(path: Path) -> None:
    lf = _light_field()
    with h5py.File(path, "w") as file:
        file.create_dataset("LF", data=lf.views, chunks=(1, 1, 12, 14, 3), compression="gzip")
        file.create_dataset("GT_DEPTH", data=np.full(_SHAPE[:4], 2.5, np.float32))
        file.attrs.update({"dH": 0.01, "focalLength": 500.0, "shift": 0.5})


def _zarr_array(path: Path) -> None:
    zarr.create_array(str(path), data=_light_field().views, zarr_format=3, chunks=(1, 1, *_SHAPE[2:]))


def _mat_5(path: Path) -> None:
    lf = _light_field()
    nested = {"LF": lf.views, "Decode": {"name": "camera", "gain": np.arange(6.0)}}
    scipy.io.savemat(path, {"LightField": nested, "text": "x"}, do_compression=True)


def _mat_7_3(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["LF"] = _light_field().views.transpose()
    data = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + data[512:])


def _packed_tiff(path: Path) -> None:
    views = _light_field().views.reshape(9, *_SHAPE[2:])
    tifffile.imwrite(path, views, photometric="rgb", compression="zlib")


def _imagej(path: Path) -> None:
    views = _light_field().views.transpose(0, 1, 4, 2, 3)
    tifffile.imwrite(path, views, imagej=True, metadata={"axes": "TZCYX"})


def _ome_tiff(path: Path) -> None:
    views = _light_field(dtype="uint16").views.transpose(0, 1, 4, 2, 3)
    tifffile.imwrite(path, views, photometric="minisblack", metadata={"axes": "TZCYX"})


def _older_notes(path: Path) -> None:
    """As lfdepth wrote HDF5 up to version 0.2: the notes as text of variable length."""
    bundle = Bundle.of(_light_field())
    with h5py.File(path, "w") as file:
        for name, array in bundle.arrays.items():
            file[name] = array
        file.attrs[KEY] = bundle.text


def _reversed(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["scene/LF"] = _light_field().views.transpose()


def _mosaic(path: Path) -> None:
    views = _light_field().views
    Image.fromarray(np.concatenate(np.concatenate(views, axis=1), axis=1)).save(path)


def _pnm(kinds: tuple[int, int]) -> Callable[[Path], None]:
    """A folder of PGM or PPM pictures, plain ones and raw ones by turns."""

    def make(path: Path) -> None:
        path.mkdir()
        for index, view in enumerate(_light_field().views.reshape(9, *_SHAPE[2:])):
            pixels = view if kinds == (3, 6) else view[..., 0]
            head = f"P{kinds[index % 2]} # a comment\n{view.shape[1]} {view.shape[0]} 255\n".encode()
            samples = pixels.tobytes() if index % 2 else " ".join(map(str, pixels.ravel())).encode()
            (path / f"{index // 3}_{index % 3}.pnm").write_bytes(head + samples)

    return make


def _exr_views(path: Path) -> None:
    path.mkdir()
    kinds = OpenEXR.ZIP_COMPRESSION, OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION
    for index, view in enumerate(_light_field(dtype="float32").views.reshape(9, *_SHAPE[2:])):
        header = {"compression": kinds[index % 3], "type": OpenEXR.scanlineimage}
        pixels = view.astype(np.float16 if index % 2 else np.float32)
        with OpenEXR.File(header, {"RGB": pixels}) as file:
            file.write(str(path / f"{index // 3}_{index % 3}.exr"))


def _table(path: Path) -> None:
    lines = [f"{v},{u},{v * 1.5 + 0.1 * u},{u * 1.5}" for v, u in np.ndindex(3, 3)]
    path.write_text("v,u,y,x\n" + "\n".join(lines))


def _positions(path: Path) -> None:
    path.mkdir()
    np.save(path / "x.npy", _light_field().views)
    _table(path / "table.csv")


def _folder_with_table(path: Path) -> None:
    _jpegs(path)
    _table(path / "positions.csv")


def _truth(form: str) -> Callable[[Path], None]:
    """Views, and their truth in another file."""

    def make(path: Path) -> None:
        lf = _light_field()
        assert lf.truth is not None
        path.mkdir()
        np.save(path / "x.npy", lf.views)
        truth = path / f"truth{form}"
        if form == ".h5":
            with h5py.File(truth, "w") as file:
                file["disparity"] = lf.truth
        elif form == ".mat":
            scipy.io.savemat(truth, {"gt_disparity": lf.truth}, do_compression=True)
        else:
            Image.fromarray((lf.truth * 100 + 200).astype(np.uint16)).save(truth)

    return make


def _eslf(path: Path) -> None:
    picture = np.random.default_rng(5).integers(0, 65535, (14 * 6, 14 * 7, 3)).astype(np.uint16)
    for v, u in np.ndindex(14, 14):
        if min(v, u) == 0 or max(v, u) == 13:
            picture[v::14, u::14] //= 20
    path.write_bytes(imagecodecs.png_encode(picture))


def _jpegs(path: Path) -> None:
    path.mkdir()
    for index, view in enumerate(_light_field().views.reshape(9, *_SHAPE[2:])):
        Image.fromarray(view).save(path / f"{index // 3}_{index % 3}.{('jpg', 'bmp', 'webp')[index % 3]}")


def _submission(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for scene in SCENES:
            archive.writestr(f"disp_maps/{scene}.pfm", b"Pf\n512 512\n-1\n" + bytes(4 * 512 * 512))
            archive.writestr(f"runtimes/{scene}.txt", "1.25\n")


def _scores(path: Path) -> None:
    path.mkdir()
    lf = _light_field(size=(36, 40))
    write(path / "scene", lf, format="benchmark")
    assert lf.truth is not None
    write(path / "map.pfm", lf.truth)
    high = np.repeat(np.repeat(lf.truth, 10, 0), 10, 1)
    write(path / "scene/gt_disp_highres.pfm", high)
    Image.fromarray(np.full(high.shape, 255, np.uint8)).save(path / "scene/mask_planes_highres.png")


KINDS: dict[str, tuple[str, str, Callable[[Path], Any]]] = {
    "npy": ("light field", "x.npy", _written()),
    "npz": ("light field", "x.npz", _written()),
    "npz-packed": ("light field", "x.npz", _compressed_npz),
    "hdf5": ("light field", "x.h5", _written(dtype="uint16")),
    "hdf5-older": ("light field", "x.h5", _older_benchmark),
    "zarr": ("light field", "x.zarr", _written()),
    "zarr-array": ("light field", "x.zarr", _zarr_array),
    "mat": ("light field", "x.mat", _written()),
    "mat-packed": ("light field", "x.mat", _mat_5),
    "mat-7.3": ("light field", "x.mat", _mat_7_3),
    "tiff": ("light field", "x.tif", _written(dtype="float32")),
    "tiff-packed": ("light field", "x.tif", _packed_tiff),
    "quilt": ("light field", "x_qs3x1a1.png", _written(row=True)),
    "tiff-imagej": ("light field", "x.tif", _imagej),
    "tiff-ome": ("light field", "x.ome.tif", _ome_tiff),
    "hdf5-notes": ("light field", "x.h5", _older_notes),
    "hdf5-reversed": ("light field", "x.h5", _reversed),
    "mosaic": ("mosaic", "x.png", _mosaic),
    "positions": ("positions", "x", _positions),
    "truth-hdf5": ("truth .h5", "x", _truth(".h5")),
    "truth-mat": ("truth .mat", "x", _truth(".mat")),
    "truth-png": ("truth .png", "x", _truth(".png")),
    "eslf": ("light field", "x_eslf.png", _eslf),
    "folder": ("light field", "x", _written(dtype="uint16", channels=1)),
    "folder-float": ("light field", "x", _written(dtype="float32")),
    "folder-jpeg": ("light field", "x", _jpegs),
    "folder-ppm": ("light field", "x", _pnm((3, 6))),
    "folder-pgm": ("light field", "x", _pnm((2, 5))),
    "folder-exr": ("light field", "x", _exr_views),
    "folder-table": ("light field", "x", _folder_with_table),
    "benchmark": ("light field", "x", _written(format="benchmark")),
    "map-pfm": ("map", "x.pfm", _map),
    "map-png": ("map", "x.png", _map),
    "map-npy": ("map", "x.npy", _map),
    "map-npz": ("map", "x.npz", _map),
    "map-tiff": ("map", "x.tif", _map),
    "map-exr": ("map", "x.exr", _map),
    "map-zarr": ("map", "x.zarr", _map),
    "submission": ("submission", "x.zip", _submission),
    "scores": ("scores", "x", _scores),
}
"""By name: what it is, the file or folder that the command is given, and what writes it."""
