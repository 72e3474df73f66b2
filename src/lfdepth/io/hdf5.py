"""HDF5, among it the older HCI benchmark (Wanner et al. 2013, doi:10.2312/PE.VMV.VMV13.225-226)."""

from __future__ import annotations

from dataclasses import replace
from io import FileIO
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

# The files give the focal length in pixels; any sensor size states the same camera.
_NOMINAL_SENSOR_MM = 36.0


def recognise(path: Path) -> bool:
    """True for an HDF5 file."""
    return signature.starts_with(path, signature.HDF5)


def open_hdf5(path: Path, layout: Layout) -> ViewSource:
    """Open the light field of an HDF5 file: the dataset `LF`, or the only one with enough axes.

    Files of the older HCI benchmark (attributes `dH`, `focalLength` and `shift` beside `LF`) also give the
    camera and, from `GT_DEPTH` (V, U, H, W) in metres, the truth: ``disparity = dH · focalLength / depth -
    shift``. Their columns of views run from right to left, and are reversed. Truth that is not finite is
    left out.

    Raises
    ------
    LightFieldError
        If h5py is not installed, the file is truncated, or holds no light field.
    """
    file = open_file(path, "hdf5")
    try:
        with readable(path):
            arrays = datasets(file)
            source = stack.open_arrays(arrays, file.attrs.get(KEY), path, layout, close=file.close)
            if "LF" in arrays and {"dH", "focalLength", "shift"} <= set(file.attrs):
                return _older_benchmark(source, file, arrays)
            return source
    except BaseException:
        file.close()
        raise


def write_views_hdf5(path: Path, lf: LightField) -> None:
    """Write the dataset `LF` (V, U, H, W, C); truth and masks beside it, the notes as an attribute."""
    h5py = need("h5py", "hdf5", path)
    bundle = Bundle.of(lf)
    with atomic(path) as temporary, temporary.open("rb+", buffering=0) as raw:
        target = _Target(raw)
        with h5py.File(target, "w") as file:
            for name, array in bundle.arrays.items():
                file.create_dataset(name, data=array)
            file.attrs[KEY] = bundle.text
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


def datasets(file: Any) -> dict[str, Any]:
    """All arrays of numbers in an HDF5 file by their path in it.

    Raises
    ------
    LightFieldError
        If the file is damaged, or an array is somewhere else than in it, or asks for more memory than it may.
    """
    found = {}
    path = Path(file.filename)

    def visit(name: str, item: Any) -> None:
        if hasattr(item, "shape") and item.shape is not None and item.dtype.kind in "uif":
            _check_dataset(item, path)
            found[name] = item

    with readable(path):
        file.visititems(visit)
    return found


def _check_dataset(item: Any, path: Path) -> None:
    elsewhere = [name for name, _, _ in item.external or ()]
    if item.is_virtual:
        elsewhere += [source.file_name for source in item.virtual_sources() if source.file_name != "."]
    if elsewhere:
        raise LightFieldError(
            f"{path}: samples of {item.name} are in another file ({elsewhere[0]}), which is not opened; "
            "expected them in this one; if you trust it, copy them into one (h5repack)"
        )
    stored = item.id.get_storage_size()
    limits.check_unpacked(path, item.shape, item.dtype.itemsize, stored=stored, whole=False)
    if item.chunks:
        limits.check_unpacked(path, item.chunks, item.dtype.itemsize, stored=stored)


def _older_benchmark(source: ViewSource, file: Any, arrays: dict[str, Any]) -> ViewSource:
    baseline, focal_px, shift = (
        float(np.ravel(file.attrs[key])[0]) for key in ("dH", "focalLength", "shift")
    )
    v, u = source.grid
    height, width = source.read_view(v // 2, u // 2).shape[:2]
    truth = None
    if "GT_DEPTH" in arrays and arrays["GT_DEPTH"].shape == (v, u, height, width):
        truth = _truth(arrays["GT_DEPTH"][v // 2, u - 1 - u // 2], baseline * focal_px, shift)
    camera = None
    if baseline > 0 and focal_px > 0 and shift >= 0:
        camera = Camera(
            focal_length_mm=focal_px * _NOMINAL_SENSOR_MM / max(width, height),
            sensor_size_mm=_NOMINAL_SENSOR_MM,
            baseline_mm=baseline * 1000,
            focus_distance_m=baseline * focal_px / shift if shift else float("inf"),
            width=width,
            height=height,
        )
    read_part = source.read_part
    assert read_part is not None  # arrays have one
    return replace(
        source,
        read_view=lambda row, column: source.read_view(row, u - 1 - column),
        read_part=lambda row, column, rows, columns: read_part(row, u - 1 - column, rows, columns),
        camera=camera,
        truth=truth,
    )


def _truth(depth: npt.NDArray[Any], scale: float, shift: float) -> npt.NDArray[np.float32] | None:
    with np.errstate(divide="ignore", invalid="ignore"):
        disparity = (scale / np.asarray(depth, np.float64) - shift).astype(np.float32)
    return disparity if np.isfinite(disparity).all() else None
