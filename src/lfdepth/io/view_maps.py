"""Writing the maps of all views: NPZ, Zarr with a chunk for each view, or a folder of PFM files."""

from __future__ import annotations

import json
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import MANIFEST, atomic, atomic_folder, check_target
from lfdepth.io.extras import need
from lfdepth.io.names import view_name
from lfdepth.io.pfm import write_pfm
from lfdepth.io.record import Record
from lfdepth.io.zarr_store import writing
from lfdepth.result import Result, ViewMaps

View = tuple[int, int]

ABSENT: Mapping[str, np.generic] = {
    "disparity": np.float32(np.nan),
    "confidence": np.float32(0),
    "visible": np.bool_(False),
}
"""What is written of each view, and the value that stands for a view that does not exist."""
_PIECE = 1 << 24  # bytes that are copied at once
_ENDINGS = (".npz", ".zarr", "")


def check_view_maps_writable(path: Path) -> None:
    """Raise LightFieldError, before long work, if `write_view_maps` would refuse the path."""
    ending = path.suffix.lower()
    if ending not in _ENDINGS:
        raise LightFieldError(
            f"{path}: a map of every view; expected a name ending in .npz or .zarr, or a folder, without "
            "ending; choose one of these"
        )
    if ending == ".zarr":
        need("zarr", "zarr", path)
    check_target(path, folder=ending != ".npz")


class ViewMapsTarget(Protocol):
    """Takes the maps of all views, one by one."""

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        """Take one of `ABSENT` (H, W) of a view, at row and column of the grid; each once."""

    def finish(self, facts: Mapping[str, Any]) -> None:
        """Take what else is known (`facts_of`), when all maps are there."""


def write_view_maps(path: Path, maps: ViewMaps) -> None:
    """Write disparity, confidence and visibility of every view, (V, U, H, W), complete or not at all.

    A folder holds `disparity_v00_u00.pfm` and `confidence_v00_u00.pfm` for each view that exists; the other
    formats hold the arrays `disparity`, `confidence` and `visible`, range, runtime in s, and parameters.
    """
    check_view_maps_writable(path)
    present = np.isfinite(maps.disparity[:, :, 0, 0])
    with writing_view_maps(path, maps.disparity.shape, present) as target:
        for v, u in np.argwhere(present).tolist():
            for name in ABSENT:
                target.put(name, (v, u), getattr(maps, name)[v, u])
        target.finish(facts_of(maps.reference, maps.consistency, maps.runtime))


def facts_of(reference: Result, consistency: float, runtime: float) -> dict[str, Any]:
    """What is written beside maps."""
    return {
        "range": list(reference.range),
        "runtime": runtime,
        "consistency": consistency,
        "parameters": json.dumps(reference.method.as_dict()),
    }


def writing_view_maps(
    path: Path, shape: tuple[int, ...], present: NDArray[np.bool_]
) -> AbstractContextManager[ViewMapsTarget]:
    """A target for maps (V, U, H, W) of the views that are `present` (V, U): see `write_view_maps`.

    LightFieldError if the path cannot be written, or whatever else is written there meanwhile.
    """
    kind = {".npz": _npz, ".zarr": _zarr, "": _folder}[path.suffix.lower()]
    return kind(path, shape, np.argwhere(~present).tolist())


@contextmanager
def _npz(path: Path, shape: tuple[int, ...], absent: list[list[int]]) -> Iterator[ViewMapsTarget]:
    with atomic(path) as temporary, ExitStack() as opened:
        # An archive is written from its beginning to its end, and maps come as they are made.
        files = {
            name: opened.enter_context(tempfile.TemporaryFile(dir=temporary.parent, prefix=".lfdepth-"))
            for name in ABSENT
        }
        target = _Npz(temporary, shape, files)
        _put_absent(target, shape, absent)
        yield target


@dataclass(frozen=True, eq=False)
class _Npz:
    """Maps in a file for each kind, which are joined in the end."""

    temporary: Path
    shape: tuple[int, ...]
    files: Mapping[str, IO[bytes]]

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        self.files[name].seek((view[0] * self.shape[1] + view[1]) * values.nbytes)
        self.files[name].write(np.ascontiguousarray(values).data)

    def finish(self, facts: Mapping[str, Any]) -> None:
        with zipfile.ZipFile(self.temporary, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
            for name, file in self.files.items():
                dtype = ABSENT[name].dtype
                header = {
                    "descr": np.lib.format.dtype_to_descr(dtype),
                    "fortran_order": False,
                    "shape": self.shape,
                }
                file.seek(0)
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                    np.lib.format.write_array_header_1_0(member, header)
                    shutil.copyfileobj(file, member, _PIECE)
            for name, fact in facts.items():
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asarray(fact), allow_pickle=False)


@contextmanager
def _zarr(path: Path, shape: tuple[int, ...], absent: list[list[int]]) -> Iterator[ViewMapsTarget]:
    zarr = need("zarr", "zarr", path)
    with (
        atomic_folder(path, manifest=f"disparity/{MANIFEST}") as temporary,
        writing(zarr, temporary) as store,
    ):
        group = zarr.open_group(store, mode="w", zarr_format=2)
        arrays = {
            name: group.create_array(name, shape=shape, dtype=value.dtype, chunks=(1, 1, *shape[2:]))
            for name, value in ABSENT.items()
        }
        target = _Zarr(group, arrays)
        _put_absent(target, shape, absent)
        yield target


@dataclass(frozen=True, eq=False)
class _Zarr:
    """A chunk for each view."""

    group: Any
    arrays: Mapping[str, Any]

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        self.arrays[name][view] = values

    def finish(self, facts: Mapping[str, Any]) -> None:
        self.group.attrs.update({"unit": "px per view step", **facts})


@contextmanager
def _folder(path: Path, shape: tuple[int, ...], absent: list[list[int]]) -> Iterator[ViewMapsTarget]:
    del absent  # a folder has files of the views that exist
    with atomic_folder(path) as temporary:
        yield _Folder(temporary, (shape[0], shape[1]))


@dataclass(frozen=True, eq=False)
class _Folder:
    """Files for each view; visibility is not among them."""

    temporary: Path
    grid: tuple[int, int]

    def put(self, name: str, view: View, values: NDArray[Any]) -> None:
        if name != "visible":
            write_pfm(self.temporary / view_name(name, view, self.grid, "pfm"), Record(values))

    def finish(self, facts: Mapping[str, Any]) -> None:
        """There is no place for facts."""


def _put_absent(target: ViewMapsTarget, shape: tuple[int, ...], absent: list[list[int]]) -> None:
    for v, u in absent:
        for name, value in ABSENT.items():
            target.put(name, (v, u), np.full(shape[2:], value, value.dtype))
