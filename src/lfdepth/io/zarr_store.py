"""Zarr folders, for light fields and for maps."""

from __future__ import annotations

import asyncio
import errno
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io import limits, stack
from lfdepth.io.atomic import MANIFEST, atomic_folder, walk
from lfdepth.io.extras import need
from lfdepth.io.layout import Layout
from lfdepth.io.limits import check_inside, read_text, readable
from lfdepth.io.notes import KEY, MASK, TRUTH, Bundle
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

_PATIENCE = 60.0  # s, for what Zarr has under way, which takes milliseconds
_MARKERS = ("zarr.json", ".zarray", ".zgroup")
_LOOKED_FOR = {*stack.NAMES, "disparity", "depth", "confidence", "sigma", TRUTH}
_NUMBERS = re.compile(r"[<>|=]?[biuf][1248]|u?int(?:8|16|32|64)|float(?:16|32|64)|bool")
_CODECS = (
    "blosc",
    "zstd",
    "lz4",
    "zlib",
    "gzip",
    "bz2",
    "lzma",
    "shuffle",
    "delta",
    "fixedscaleoffset",
    "bitround",
    "bytes",
    "transpose",
    "crc32",
    "crc32c",
    "adler32",
    "fletcher32",
    "sharding_indexed",
)
"""What an array may be packed with: nothing that runs code."""


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
    root, arrays = _open(path)
    if arrays is None:
        return stack.open_stack(root, path, layout)
    return stack.open_arrays(arrays, root.attrs.get(KEY), path, layout)


def read_zarr(path: Path) -> dict[str, Any]:
    """The arrays of a Zarr group, which are read when they are asked for, and its attributes.

    Raises
    ------
    LightFieldError
        If zarr is not installed, or the folder is damaged.
    """
    root, arrays = _open(path)
    return {} if arrays is None else {**root.attrs, **arrays}


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays of a Zarr group by name, or the only one under no name, read when they are asked for.

    Raises
    ------
    LightFieldError
        If zarr is not installed, or the folder is damaged.
    """
    root, arrays = _open(path)
    return {"": root} if arrays is None else arrays


def write_zarr(path: Path, record: Record) -> None:
    """Write a group with the map under its quantity's name, confidence and sigma; the rest as attributes."""
    zarr = need("zarr", "zarr", path)
    attributes = {
        "unit": record.unit,
        "range": record.range and list(record.range),
        "runtime": record.runtime,
        "parameters": record.parameters,
    }
    with (
        atomic_folder(path, manifest=f"{record.quantity}/{MANIFEST}") as temporary,
        writing(zarr, temporary) as store,
    ):
        # Version 2 of the format is what older libraries read too.
        group = zarr.open_group(store, mode="w", zarr_format=2)
        group.create_array(record.quantity, data=record.values)
        for name in ("confidence", "sigma"):
            if (beside := getattr(record, name)) is not None:
                group.create_array(name, data=beside)
        group.attrs.update({key: value for key, value in attributes.items() if value is not None})


def write_views_zarr(path: Path, lf: LightField) -> None:
    """Write a group with `LF` (V, U, H, W, C), a chunk for each view; truth and masks beside it.

    The notes are an attribute.
    """
    zarr = need("zarr", "zarr", path)
    bundle = Bundle.of(lf)
    with atomic_folder(path, manifest=f"LF/{MANIFEST}") as temporary, writing(zarr, temporary) as store:
        group = zarr.open_group(store, mode="w", zarr_format=2)
        for name, array in bundle.arrays.items():
            group.create_array(
                name, data=array, chunks=(1, 1, *array.shape[2:]) if array.ndim == 5 else "auto"
            )
        group.attrs[KEY] = bundle.text


@contextmanager
def writing(zarr: Any, folder: Path) -> Iterator[Any]:
    """A store in a folder, to which nothing is written any more when the context has been left.

    Zarr writes several files at once, and after one has failed goes on with the others: into a folder that
    may have been removed, and comes back.
    """
    over, loop = False, None

    class Store(zarr.storage.LocalStore):  # type: ignore[misc]
        async def set(self, key: str, value: Any) -> None:
            nonlocal loop
            loop = asyncio.get_running_loop()
            if over:
                raise OSError(errno.ECANCELED, "another file could not be written")
            await super().set(key, value)

    async def settle() -> None:
        if others := asyncio.all_tasks() - {asyncio.current_task()}:
            await asyncio.wait(others, timeout=_PATIENCE)

    try:
        yield Store(folder)
    finally:
        over = True
        if loop is not None:
            asyncio.run_coroutine_threadsafe(settle(), loop).result()


def _open(path: Path) -> tuple[Any, dict[str, Any] | None]:
    """The root of a store and its arrays of numbers by name; None for these if the root is an array itself.

    Zarr unpacks with whatever a store names, which can run code that came with it (`pickle`), and follows
    links. So the store's own files are looked at first, and only what is safe is opened.
    """
    zarr = need("zarr", "zarr", path)
    with readable(path):
        store = zarr.storage.LocalStore(path, read_only=True)
        if _kind(path) == "array":
            _check_array(path, path)
            return zarr.open_array(store, mode="r"), None
        root = zarr.open_group(store, mode="r", use_consolidated=False)
        names = [entry.name for entry in sorted(path.iterdir()) if _kind(entry) == "array"]
        safe = _safe_arrays(path, names)
        return root, {name: zarr.open_array(store, path=name, mode="r") for name in safe}


def _safe_arrays(path: Path, names: list[str]) -> list[str]:
    """Arrays that are opened; an error if others have names that are looked for, or there are only others."""
    safe, problems = [], {}
    for name in names:
        try:
            _check_array(path, path / name)
            safe.append(name)
        except LightFieldError as error:
            problems[name] = error
    for name, problem in problems.items():
        if not safe or name in _LOOKED_FOR or name.startswith(MASK):
            raise problem
    return safe


def _kind(folder: Path) -> str | None:
    """Whether a folder is an array or a group, by the metadata that zarr would read."""
    if (folder / "zarr.json").exists():
        return str(_metadata(folder / "zarr.json").get("node_type"))
    if (folder / ".zarray").exists():
        return "array"
    return "group" if (folder / ".zgroup").exists() else None


def _metadata(file: Path) -> dict[str, Any]:
    check_inside(file.parent, [file])
    found = json.loads(read_text(file))
    if not isinstance(found, dict):
        raise ValueError(f"{file.name} holds no metadata")
    return found


def _check_array(path: Path, folder: Path) -> None:
    """Raise LightFieldError unless an array holds numbers that are packed in a way known to be safe."""
    version_3 = (folder / "zarr.json").exists()
    known = _metadata(folder / ("zarr.json" if version_3 else ".zarray"))
    kind = known["data_type" if version_3 else "dtype"]
    if not (isinstance(kind, str) and _NUMBERS.fullmatch(kind)):
        raise LightFieldError(
            f"{path}: samples of {folder.name} are {str(kind)[:40]}; expected whole or real numbers; convert "
            "them"
        )
    if version_3:
        packing = [*known["codecs"], *(known.get("storage_transformers") or ())]
        chunks = known["chunk_grid"]["configuration"]["chunk_shape"]
    else:
        packing = [each for each in (known["compressor"], *(known["filters"] or ())) if each is not None]
        chunks = known["chunks"]
    for codec in packing:
        _check_codec(path, folder, codec)
    entries = list(walk(folder))
    check_inside(path, [Path(entry.path) for entry in entries])
    stored = sum(entry.stat().st_size for entry in entries if entry.is_file())
    itemsize = np.dtype(kind).itemsize
    limits.check_unpacked(path, known["shape"], itemsize, stored=stored, whole=False)
    limits.check_unpacked(path, chunks, itemsize, stored=stored)


def _check_codec(path: Path, folder: Path, codec: dict[str, Any]) -> None:
    name = codec.get("id") or codec.get("name")
    if not isinstance(name, str) or name.removeprefix("numcodecs.") not in _CODECS:
        raise LightFieldError(
            f"{path}: {folder.name} is compressed by {str(name)[:40]}; expected one of {', '.join(_CODECS)}; "
            "others are not supported; store it as one of these"
        )
    settings = codec.get("configuration") or codec
    for key in ("dtype", "astype"):
        if key in settings and not (isinstance(settings[key], str) and _NUMBERS.fullmatch(settings[key])):
            raise LightFieldError(
                f"{path}: {folder.name} is stored as {str(settings[key])[:40]}; expected whole or real "
                "numbers; convert them"
            )
    for inner in (*settings.get("codecs", ()), *settings.get("index_codecs", ())):
        _check_codec(path, folder, inner)
