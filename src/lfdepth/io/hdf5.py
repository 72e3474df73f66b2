"""HDF5, among it the older HCI benchmark (Wanner et al. 2013, doi:10.2312/PE.VMV.VMV13.225-226)."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import limits, signature, stack
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
from lfdepth.io.layout import Layout
from lfdepth.io.limits import readable
from lfdepth.io.notes import KEY, Bundle
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

# The files do not tell the sensor's size; any one states the same camera.
_NOMINAL_SENSOR_MM = 36.0
# A focal length of so many picture widths is an angle of view of half a degree: then it counts pixels.
_MOST_WIDTHS = 115.0
# Cameras further apart than that are no light field.
_MOST_BASELINE_M = 10.0
# How the notes begin that lfdepth wrote up to version 0.2.
_OLDER_NOTES = b'{\n  "lfdepth": "light field"'


def recognise(path: Path) -> bool:
    """True for an HDF5 file."""
    return signature.starts_with(path, signature.HDF5)


def open_hdf5(path: Path, layout: Layout) -> ViewSource:
    """Open the light field of an HDF5 file: the dataset `LF`, or the only one with enough axes.

    Files of the older HCI benchmark (attributes `dH`, `focalLength` and `shift` beside `LF`) also give the
    camera and, from `GT_DEPTH` (V, U, H, W) in metres, the truth: ``disparity = dH · focalLength / depth -
    shift``. Their columns of views run from right to left, and are reversed. Their focal length counts
    picture widths, and dH is the baseline in metres times the picture's width in pixels; one beyond any
    picture width counts pixels, and then dH is the baseline. A camera that cannot be is left out.

    Raises
    ------
    LightFieldError
        If h5py is not installed, the file is truncated, or holds no light field.
    """
    file = open_file(path, "hdf5")
    try:
        with readable(path):
            arrays = datasets(file)
            source = stack.open_arrays(
                arrays, _text_of_notes(file, path), path, layout, close=file.close, matlab=True
            )
            if "LF" in arrays and {"dH", "focalLength", "shift"} <= set(file.attrs):
                return _older_benchmark(source, file, arrays)
            return source
    except BaseException:
        file.close()
        raise


def write_views_hdf5(path: Path, lf: LightField) -> None:
    """Write the dataset `LF` (V, U, H, W, C); truth, masks and, as text of fixed length, notes."""
    h5py = need("h5py", "hdf5", path)
    bundle = Bundle.of(lf)
    with atomic(path) as temporary, temporary.open("rb+", buffering=0) as raw:
        target = _Target(raw)
        with h5py.File(target, "w") as file:
            for name, array in bundle.arrays.items():
                file.create_dataset(name, data=array)
            file.create_dataset(KEY, data=np.bytes_(bundle.text.encode("ascii")))
        if target.error is not None:
            raise target.error


class _Target:
    """A file that HDF5 writes to, which keeps an error for later: the library does not come through one."""

    def __init__(self, raw: FileIO) -> None:
        self._raw = raw
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        while len(left) and self.error is None:
            try:
                left = left[self._raw.write(left) :]
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._raw.truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def readinto(self, buffer: Any) -> int:
        return self._raw.readinto(buffer) or 0

    def read(self, size: int = -1) -> bytes:
        return self._raw.read(size) or b""

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def flush(self) -> None:
        self._raw.flush()


def open_file(path: Path, extra: str) -> Any:
    """Open an HDF5 file with h5py."""
    h5py = need("h5py", extra, path)
    with readable(path):
        return h5py.File(path, "r")


def read_hdf5(path: Path) -> dict[str, Any]:
    """The arrays of an HDF5 file, which are read when they are asked for."""
    return datasets(open_file(path, "hdf5"))


def datasets(file: Any) -> dict[str, Any]:
    """All arrays of numbers in an HDF5 file by their path in it.

    Raises
    ------
    LightFieldError
        If the file is damaged, or an array is somewhere else than in it, or asks for more memory than it may.
    """
    found = {}
    path = Path(file.filename)

    def visit(name: str | bytes, item: Any) -> None:
        if hasattr(item, "shape") and item.shape is not None and item.dtype.kind in "uif":
            _check_dataset(item, path)
            found[name if isinstance(name, str) else name.decode("utf-8", "replace")] = item

    with readable(path):
        file.visititems(visit)
    return found


def _check_dataset(item: Any, path: Path) -> None:
    elsewhere = [name for name, _, _ in item.external or ()]
    if item.is_virtual:
        elsewhere += [source.file_name for source in item.virtual_sources() if source.file_name != "."]
    if elsewhere:
        raise LightFieldError(
            f"{path}: samples of {item.name} are stored in another file ({elsewhere[0]}), which is not "
            "opened; expected them in this one; if you trust it, merge both (h5repack)"
        )
    stored = item.id.get_storage_size()
    limits.check_unpacked(path, item.shape, item.dtype.itemsize, stored=stored, whole=False)
    if item.chunks:
        limits.check_unpacked(path, item.chunks, item.dtype.itemsize, stored=stored)


def _text_of_notes(file: Any, path: Path) -> str | None:
    """The notes of a file: a dataset of fixed length, or up to version 0.2 a text of variable length.

    The HDF5 library never returns from a text of variable length whose place is damaged; so it is not asked.
    """
    if type(file.get(KEY, getlink=True)).__name__ == "HardLink":  # others may lead out of the file
        item = file[KEY]
        fixed = getattr(item, "shape", None) == () and item.dtype.kind == "S"
        if fixed and item.dtype.itemsize <= limits.MOST_TEXT:
            _check_dataset(item, path)
            return bytes(item[()]).decode("ascii", "replace")
    return _older_text(path) if KEY in file.attrs else None


def _older_text(path: Path) -> str | None:
    """The notes as the file's bytes have them."""
    with path.open("rb") as raw, mmap(raw.fileno(), 0, access=ACCESS_READ) as data:
        start = data.find(_OLDER_NOTES)
        text = data[start : start + limits.MOST_TEXT].decode("ascii", "replace") if start >= 0 else ""
    with suppress(ValueError, RecursionError):
        return text[: json.JSONDecoder().raw_decode(text)[1]]
    return None


def _number(file: Any, name: str) -> float:
    """The first number of an attribute, which no text or list of variable length may stand in for."""
    attribute = file.attrs.get_id(name)
    if attribute.dtype.kind not in "uif":
        raise LightFieldError(
            f"{file.filename}: {name} is of type {attribute.dtype}; expected a number; write it as one"
        )
    return float(np.ravel(file.attrs[name])[0])


def _older_benchmark(source: ViewSource, file: Any, arrays: dict[str, Any]) -> ViewSource:
    distance, focal, shift = (_number(file, key) for key in ("dH", "focalLength", "shift"))
    v, u = source.grid
    height, width = source.read_view(v // 2, u // 2).shape[:2]
    truth = None
    if "GT_DEPTH" in arrays and arrays["GT_DEPTH"].shape == (v, u, height, width):
        truth = _truth(arrays["GT_DEPTH"][v // 2, u - 1 - u // 2], distance * focal, shift)
    camera, remarks = _camera(distance, focal, shift, (width, height))
    read_part = source.read_part
    assert read_part is not None  # arrays have one
    return replace(
        source,
        read_view=lambda row, column: source.read_view(row, u - 1 - column),
        read_part=lambda row, column, rows, columns: read_part(row, u - 1 - column, rows, columns),
        camera=camera,
        truth=truth if truth is not None else source.truth,
        remarks=(*source.remarks, *remarks),
    )


def _camera(
    distance: float, focal: float, shift: float, size: tuple[int, int]
) -> tuple[Camera | None, tuple[str, ...]]:
    """Camera of views of a size (width, height), from `dH`, `focalLength` and `shift`; and remarks on it."""
    width = size[0]
    in_widths = focal <= _MOST_WIDTHS
    baseline = distance / width if in_widths else distance
    focal_px = focal * width if in_widths else focal
    found = f"dH {distance:g}, focalLength {focal:g}, shift {shift:g}"
    possible = focal > 0 and shift >= 0 and width / 20 < focal_px < _MOST_WIDTHS * width
    if not (possible and 0 < baseline <= _MOST_BASELINE_M):
        return None, (
            f"the file's camera ({found}) is impossible and was ignored, so depth in metres is not available",
        )
    units = "picture widths and dH the baseline times them" if in_widths else "pixels and dH the baseline"
    camera = Camera(
        focal_length_mm=focal_px * _NOMINAL_SENSOR_MM / max(size),
        sensor_size_mm=_NOMINAL_SENSOR_MM,
        baseline_mm=baseline * 1000,
        focus_distance_m=baseline * focal_px / shift if shift else float("inf"),
        width=width,
        height=size[1],
    )
    return camera, (f"camera by the file's {found}: focalLength counts {units}",)


def _truth(depth: npt.NDArray[Any], scale: float, shift: float) -> npt.NDArray[np.float32] | None:
    """Disparity from depth in metres, NaN or infinite where there is none; None if there is none at all."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        disparity = (scale / np.asarray(depth, np.float64) - shift).astype(np.float32)
    return disparity if np.isfinite(disparity).any() else None
