"""Zarr folders, for light fields and for maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lfdepth.io import stack
from lfdepth.io.atomic import MANIFEST, atomic_folder
from lfdepth.io.extras import need
from lfdepth.io.layout import Layout
from lfdepth.io.notes import KEY, Bundle
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

_MARKERS = ("zarr.json", ".zarray", ".zgroup")


def is_zarr(path: Path) -> bool:
    """True for a folder that is a Zarr array or group."""
    return path.is_dir() and any((path / marker).exists() for marker in _MARKERS)


def open_zarr(path: Path, layout: Layout) -> ViewSource:
    """Open a Zarr array, or the light field in a group: `LF`, or the only array with enough axes.

    Raises
    ------
    LightFieldError
        If zarr is not installed, the folder is damaged, or holds no light field.
    """
    root = _open(path)
    if hasattr(root, "shape"):
        return stack.open_stack(root, path, layout)
    return stack.open_arrays(dict(root.arrays()), root.attrs.get(KEY), path, layout)


def read_zarr(path: Path) -> dict[str, Any]:
    """The arrays of a Zarr group, which are read when they are asked for, and its attributes.

    Raises
    ------
    LightFieldError
        If zarr is not installed, or the folder is damaged.
    """
    root = _open(path)
    return {} if hasattr(root, "shape") else {**root.attrs, **dict(root.arrays())}


def write_zarr(path: Path, record: Record) -> None:
    """Write a group with the map under its quantity's name and the confidence; the rest as attributes."""
    zarr = need("zarr", "zarr", path)
    attributes = {
        "unit": record.unit,
        "range": record.range and list(record.range),
        "runtime": record.runtime,
        "parameters": record.parameters,
    }
    with atomic_folder(path, manifest=f"{record.quantity}/{MANIFEST}") as temporary:
        # Version 2 of the format is what older libraries read too.
        group = zarr.open_group(str(temporary), mode="w", zarr_format=2)
        group.create_array(record.quantity, data=record.values)
        if record.confidence is not None:
            group.create_array("confidence", data=record.confidence)
        group.attrs.update({key: value for key, value in attributes.items() if value is not None})


def write_views_zarr(path: Path, lf: LightField) -> None:
    """Write a group with `LF` (V, U, H, W, C), a chunk for each view; truth and masks beside it.

    The notes are an attribute.
    """
    zarr = need("zarr", "zarr", path)
    bundle = Bundle.of(lf)
    with atomic_folder(path, manifest=f"LF/{MANIFEST}") as temporary:
        group = zarr.open_group(str(temporary), mode="w", zarr_format=2)
        for name, array in bundle.arrays.items():
            group.create_array(
                name, data=array, chunks=(1, 1, *array.shape[2:]) if array.ndim == 5 else "auto"
            )
        group.attrs[KEY] = bundle.text


def _open(path: Path) -> Any:
    zarr = need("zarr", "zarr", path)
    try:
        return zarr.open(str(path), mode="r")
    except Exception as error:  # zarr raises many kinds on damaged metadata
        raise stack.unreadable(path, error) from None
