"""The formats that light fields are read from, in the order in which a path is tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io import (
    benchmark,
    eslf,
    folder,
    hdf5,
    lytro,
    matlab,
    mosaic,
    names,
    npy,
    picture,
    quilt,
    tiff,
    zarr_store,
)
from lfdepth.io.layout import Layout
from lfdepth.io.source import ViewSource


@dataclass(frozen=True)
class Format:
    """A way in which light fields are stored.

    Parameters
    ----------
    name : str
        What `read(format=...)` takes.
    what : str
        A few words for messages and lists.
    recognise : callable
        Whether a path looks like this format, from its name and first bytes.
    open : callable
        Yields the views.
    """

    name: str
    what: str
    recognise: Callable[[Path], bool]
    open: Callable[[Path, Layout], ViewSource]


FORMATS = {
    known.name: known
    for known in (
        Format("zarr", "Zarr array or group", zarr_store.is_zarr, zarr_store.open_zarr),
        Format("benchmark", "4D Light Field Benchmark folder", benchmark.recognise, benchmark.open_benchmark),
        Format("folder", "folder of views", folder.recognise, folder.open_folder),
        Format("lytro", "raw Lytro picture (not readable)", lytro.recognise, lytro.open_lytro),
        Format("npy", "NumPy array", npy.recognise_npy, npy.open_npy),
        Format("npz", "NumPy archive", npy.recognise_npz, npy.open_npz),
        Format("mat", "MATLAB file", matlab.recognise, matlab.open_mat),
        Format("hdf5", "HDF5 file", hdf5.recognise, hdf5.open_hdf5),
        Format("quilt", "quilt picture NAME_qsCxRaA.png", quilt.recognise, quilt.open_quilt),
        Format("eslf", "Lytro ESLF picture", eslf.recognise, eslf.open_eslf),
        Format("mosaic", "views tiled in one picture", mosaic.recognise, mosaic.open_mosaic),
        Format("tiff", "multi-page TIFF", tiff.recognise, tiff.open_tiff),
    )
}


def find_format(path: Path, name: str | None) -> Format:
    """Return the format of that name, or else the first that recognises the path.

    Raises
    ------
    LightFieldError
        If there is no such format, no such path, or none recognises it.
    """
    if name is not None and name not in FORMATS:
        raise LightFieldError(
            f"format {name!r}: unknown; expected one of {', '.join(FORMATS)}; choose one of these"
        )
    _check_exists(path)
    if name is not None:
        return FORMATS[name]
    found = next((known for known in FORMATS.values() if known.recognise(path)), None)
    if found is None:
        raise LightFieldError(
            f"{path}: not recognised as a light field; expected one of {', '.join(FORMATS)}; {_remedy(path)}"
        )
    return found


def _remedy(path: Path) -> str:
    """What to do about a path that no format recognises."""
    if path.is_dir():
        inside = [each for each in sorted(path.iterdir()) if each.is_dir() and len(names.pictures(each)) > 1]
        if len(inside) == 1:
            return f"the pictures in it are in {inside[0]}: read that"
    elif path.suffix.lower() in picture.ENDINGS:
        return (
            "if the picture holds all views, give the grid and say whether they are tiles (--format mosaic "
            "--grid COLUMNSxROWS) or interleaved (--format eslf)"
        )
    return "check the path, or name the format (format)"


def _check_exists(path: Path) -> None:
    try:
        path.stat()
    except FileNotFoundError:
        found = "no such file or folder"
    except OSError as error:  # loops of links, folders that may not be entered
        found = error.strerror or str(error)
    else:
        return
    raise LightFieldError(f"{path}: {found}; expected a light field; check the path")
