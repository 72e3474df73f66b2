"""Writing the maps of all views: NPZ, Zarr with a chunk for each view, or a folder of PFM files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import MANIFEST, atomic, atomic_folder, check_target
from lfdepth.io.extras import need
from lfdepth.io.names import view_name
from lfdepth.io.pfm import write_pfm
from lfdepth.io.record import Record
from lfdepth.io.zarr_store import writing
from lfdepth.result import ViewMaps

_ARRAYS = ("disparity", "confidence", "visible")
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


def write_view_maps(path: Path, maps: ViewMaps) -> None:
    """Write disparity, confidence and visibility of every view, (V, U, H, W), complete or not at all.

    A folder holds `disparity_v00_u00.pfm` and `confidence_v00_u00.pfm` for each view that exists; the other
    formats hold the arrays `disparity`, `confidence` and `visible`, range, runtime in s, and parameters.
    """
    check_view_maps_writable(path)
    {".npz": _write_npz, ".zarr": _write_zarr, "": _write_folder}[path.suffix.lower()](path, maps)


def _facts(maps: ViewMaps) -> dict[str, Any]:
    return {
        "range": list(maps.reference.range),
        "runtime": maps.runtime,
        "consistency": maps.consistency,
        "parameters": json.dumps(maps.reference.method.as_dict()),
    }


def _write_npz(path: Path, maps: ViewMaps) -> None:
    arrays = {name: getattr(maps, name) for name in _ARRAYS}
    with atomic(path) as temporary:
        np.savez(
            temporary, allow_pickle=False, **arrays, **{k: np.asarray(v) for k, v in _facts(maps).items()}
        )


def _write_zarr(path: Path, maps: ViewMaps) -> None:
    zarr = need("zarr", "zarr", path)
    with (
        atomic_folder(path, manifest=f"disparity/{MANIFEST}") as temporary,
        writing(zarr, temporary) as store,
    ):
        group = zarr.open_group(store, mode="w", zarr_format=2)
        for name in _ARRAYS:
            array = getattr(maps, name)
            kept = group.create_array(
                name, shape=array.shape, dtype=array.dtype, chunks=(1, 1, *array.shape[2:])
            )
            for index in np.ndindex(*array.shape[:2]):  # view by view: nothing is held packed in memory
                kept[index] = array[index]
        group.attrs.update({"unit": "px per view step", **_facts(maps)})


def _write_folder(path: Path, maps: ViewMaps) -> None:
    rows, columns = maps.disparity.shape[:2]
    with atomic_folder(path) as temporary:
        for v, u in np.argwhere(np.isfinite(maps.disparity[:, :, 0, 0])).tolist():
            for name in ("disparity", "confidence"):
                file = temporary / view_name(name, (v, u), (rows, columns), "pfm")
                write_pfm(file, Record(getattr(maps, name)[v, u]))
