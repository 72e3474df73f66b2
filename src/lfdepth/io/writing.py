"""Writing light fields: which format a path asks for, and whether it can be written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io import benchmark, folder, hdf5, matlab, npy, quilt, tiff, zarr_store
from lfdepth.io.atomic import check_target
from lfdepth.io.extras import need
from lfdepth.lightfield import LightField


@dataclass(frozen=True)
class Writer:
    """A way to store a light field.

    Attributes
    ----------
    write
        Writes all of it or nothing.
    endings
        Of the paths that ask for it; none for folders.
    needs
        The library it takes and the extra that brings it.
    folder
        Whether what it writes is a folder.
    """

    write: Callable[[Path, LightField], None]
    endings: tuple[str, ...] = ()
    needs: tuple[str, str] | None = None
    folder: bool = False


WRITERS = {
    "folder": Writer(folder.write_folder, folder=True),
    "benchmark": Writer(benchmark.write_benchmark, folder=True),
    "npz": Writer(npy.write_views_npz, (".npz",)),
    "npy": Writer(npy.write_views_npy, (".npy",)),
    "hdf5": Writer(hdf5.write_views_hdf5, (".h5", ".hdf5"), ("h5py", "hdf5")),
    "zarr": Writer(zarr_store.write_views_zarr, (".zarr",), ("zarr", "zarr"), folder=True),
    "mat": Writer(matlab.write_views_mat, (".mat",), ("scipy.io", "mat")),
    "tiff": Writer(tiff.write_views_tiff, (".tif", ".tiff"), ("tifffile", "tiff")),
    "quilt": Writer(quilt.write_quilt, (".png",)),
}
"""The formats that light fields are written in, by the names that they are read with."""


def write_light_field(path: Path, lf: LightField, format: str | None) -> None:
    """Write a light field; see `lfdepth.write`."""
    find_writer(path, format).write(path, lf)


def check_light_field_writable(path: str | Path, format: str | None = None) -> None:
    """Raise LightFieldError, before long work, if `write` would refuse the path for a light field."""
    path = Path(path)
    writer = find_writer(path, format)
    if writer.needs is not None:
        need(*writer.needs, path)
    check_target(path, folder=writer.folder)


def find_writer(path: Path, format: str | None) -> Writer:
    """The writer of a format, or of what the path's ending names; a path without ending is a folder.

    Raises
    ------
    LightFieldError
        If there is no such format or ending, or they contradict each other.
    """
    ending = path.suffix.lower()
    if format is None:
        for writer in WRITERS.values():
            if ending in writer.endings:
                return writer
        if not ending or path.is_dir():
            return WRITERS["folder"]
        raise LightFieldError(
            f"{path}: unknown extension {ending} for a light field; expected one of {_endings()}, or a "
            "folder, without an extension; choose one of these, or estimate a map first"
        )
    if format not in WRITERS:
        raise LightFieldError(
            f"format {format!r}: not written; expected one of {', '.join(WRITERS)}; choose one of these"
        )
    writer = WRITERS[format]
    if writer.endings and ending not in writer.endings:
        raise LightFieldError(
            f"{path}: ending {ending or '(none)'} for the format {format}; expected "
            f"{' or '.join(writer.endings)}; rename it"
        )
    return writer


def _endings() -> str:
    return ", ".join(ending for writer in WRITERS.values() for ending in writer.endings)
