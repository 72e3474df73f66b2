"""Files of maps: which format an ending names, and reading back what was written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import quilt
from lfdepth.io.atomic import check_target
from lfdepth.io.exr import read_exr, write_exr
from lfdepth.io.extras import need
from lfdepth.io.limits import check_file, readable
from lfdepth.io.notes import read_notes
from lfdepth.io.npy import axes_of_npy, read_npy, read_npz, write_npy, write_npz
from lfdepth.io.pfm import read_pfm, write_pfm
from lfdepth.io.png import has_scale, read_png, scale_file, write_png
from lfdepth.io.png_text import text_in
from lfdepth.io.record import Record, checked_map
from lfdepth.io.tiff import pages_of_tiff, read_tiff, write_tiff
from lfdepth.io.unchanged import unchanged
from lfdepth.io.zarr_store import is_zarr, read_zarr, write_zarr

_WRITERS = {
    ".pfm": write_pfm,
    ".png": write_png,
    ".npy": write_npy,
    ".npz": write_npz,
    ".tif": write_tiff,
    ".tiff": write_tiff,
    ".exr": write_exr,
    ".zarr": write_zarr,
}
_BARE = {
    ".pfm": read_pfm,
    ".png": read_png,
    ".npy": read_npy,
    ".tif": read_tiff,
    ".tiff": read_tiff,
}
"""Formats with a map and nothing else."""
_RICH = {".npz": read_npz, ".exr": read_exr, ".zarr": read_zarr}
"""Formats with named arrays."""
_LIBRARIES = {
    ".tif": ("tifffile", "tiff"),
    ".tiff": ("tifffile", "tiff"),
    ".exr": ("OpenEXR", "exr"),
    ".zarr": ("zarr", "zarr"),
}
"""What an ending needs, and the extra that brings it."""

POINTS = ".ply"
"""Ending of point clouds and meshes."""
READABLE = tuple(_WRITERS)
"""Endings of maps that are read."""
WRITABLE = (*_WRITERS, POINTS)
"""Endings of what is written of a map."""


def check_writable(path: str | Path) -> None:
    """Raise LightFieldError, before long work, if `write` would refuse the path for a map."""
    path = Path(path)
    ending = path.suffix.lower()
    check_ending(path, WRITABLE)
    if ending in _LIBRARIES:
        need(*_LIBRARIES[ending], path)
    check_target(path, folder=ending == ".zarr")
    if ending == ".png":
        _check_scale_file(path)


def write_map(path: Path, record: Record) -> None:
    """Write a map in the format that the path's ending names."""
    check_ending(path, tuple(_WRITERS))
    if path.suffix.lower() == ".png":
        _check_scale_file(path)
    _WRITERS[path.suffix.lower()](path, record)


def is_map(path: str | Path) -> bool:
    """Whether a path is a map, and not a light field, which has some of the same endings.

    Raises
    ------
    LightFieldError
        If the file is damaged.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".zarr":
        return is_zarr(path) and "disparity" in read_zarr(path)
    if ending not in READABLE or not path.is_file():
        return False
    if ending == ".png":
        return has_scale(path) or (
            text_in(path) is None and scale_file(path).exists() and read_notes(scale_file(path)) is None
        )
    if ending == ".npz":
        return "disparity" in read_npz(path)
    if ending == ".npy":
        return axes_of_npy(path) == 2
    if ending in (".tif", ".tiff"):
        return pages_of_tiff(path) == 1 and not quilt.recognise(path)
    return True


def read_disparity(
    path: str | Path, *, finite: bool = True, variable: str | None = None
) -> npt.NDArray[np.float32]:
    """Read a disparity map back.

    Parameters
    ----------
    path : str or Path
        A PFM, NPY, TIFF, OpenEXR (channel Y), NPZ or Zarr (array `disparity`) file, or a 16-bit PNG with
        its scale beside it.
    finite : bool
        Refuse maps with NaN or infinite values.
    variable : str, optional
        Name of the array in NPZ, OpenEXR and Zarr; `disparity` if it is not given.

    Returns
    -------
    ndarray, shape (H, W)
        float32, px per view step.

    Raises
    ------
    LightFieldError
        If the ending is unknown, the file is missing or damaged, or the map is not finite.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import lfdepth
    >>> file = tempfile.mkdtemp() + "/map.pfm"
    >>> lfdepth.write(file, np.full((48, 64), 0.25, np.float32))
    >>> lfdepth.read_disparity(file)[0, 0]
    np.float32(0.25)
    """
    name = variable or "disparity"
    path = Path(path)
    with unchanged(path):
        return checked_map(_array(path, _read(path, name)[name]), str(path), finite=finite)


def read_confidence(path: str | Path) -> npt.NDArray[np.float32] | None:
    """Read the confidence that is stored beside a map; None where the file has none.

    Parameters
    ----------
    path : str or Path
        A file that `read_disparity` reads. NPZ, OpenEXR and Zarr can hold a confidence.

    Returns
    -------
    ndarray, shape (H, W), or None
        float32 in [0, 1].

    Raises
    ------
    LightFieldError
        If the ending is unknown, the file is missing or damaged, or its confidence is no finite map.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> file = tempfile.mkdtemp() + "/map.npz"
    >>> lfdepth.write(file, lfdepth.estimate(scenes.render("bars", size=64, views=5), "fbs-sfa"))
    >>> lfdepth.read_confidence(file).shape
    (64, 64)
    """
    path = Path(path)
    with unchanged(path):
        return _beside(path, _read(path), "confidence")


def read_record(path: str | Path) -> Record:
    """Read the map, and as far as a file has them confidence, sigma, range, runtime and parameters.

    Raises
    ------
    LightFieldError
        As `read_disparity` and `read_confidence`.
    """
    path = Path(path)
    with unchanged(path), readable(path):
        return _record(path, _read(path))


def _record(path: Path, found: Mapping[str, Any]) -> Record:
    ends = [float(end) for end in np.ravel(_array(path, found["range"]))] if "range" in found else None
    return Record(
        checked_map(_array(path, found["disparity"]), str(path)),
        confidence=_beside(path, found, "confidence"),
        sigma=_beside(path, found, "sigma"),
        range=(ends[0], ends[1]) if ends is not None and len(ends) == 2 else None,
        runtime=float(_array(path, found["runtime"])) if "runtime" in found else None,
        parameters=str(_array(path, found["parameters"])) if "parameters" in found else None,
    )


def check_ending(path: Path, known: tuple[str, ...]) -> None:
    """Raise LightFieldError unless a path has one of the known endings."""
    if path.suffix.lower() not in known:
        raise LightFieldError(
            f"{path}: unknown extension {path.suffix or '(none)'}; expected one of {', '.join(known)}; "
            "choose one of these"
        )


def _check_scale_file(path: Path) -> None:
    file = scale_file(path)
    if read_notes(file) is not None:
        raise LightFieldError(
            f"{file}: belongs to a light field; expected a free name for the scale of {path.name}; choose "
            "another name"
        )


def _read(path: Path, name: str = "disparity") -> Mapping[str, Any]:
    """What a file holds, by name; the map of that name is among it."""
    check_ending(path, READABLE)
    if not path.exists():
        raise LightFieldError(f"{path}: no such file; expected a disparity map; check the path")
    check_file(path)
    ending = path.suffix.lower()
    if ending in _BARE:
        return {name: _BARE[ending](path)}
    found = _RICH[ending](path)
    if name not in found:
        raise LightFieldError(
            f"{path}: holds {', '.join(found) or 'nothing'}; expected an array {name!r} (OpenEXR: channel "
            "Y); save the map under that name"
        )
    return found


def _beside(path: Path, found: Mapping[str, Any], name: str) -> npt.NDArray[np.float32] | None:
    """A map that is stored beside the one of disparity."""
    return checked_map(_array(path, found[name]), f"{path}: {name}") if name in found else None


def _array(path: Path, value: Any) -> npt.NDArray[Any]:
    """In memory, whatever part of a file it was."""
    if not hasattr(value, "shape"):
        return np.array(value)
    with readable(path):
        return np.array(value[...])
