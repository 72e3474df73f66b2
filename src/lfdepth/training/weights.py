"""Weights from elsewhere, and to elsewhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
from lfdepth.learned.epinet_onnx import epinet_onnx
from lfdepth.learned.lfattnet import lfattnet_arrays, lfattnet_onnx
from lfdepth.learned.shape import EPINETS, EpinetShape, Weights
from lfdepth.learned.weights import check_arrays, read_arrays, shipped
from lfdepth.training.packing import packed

_LAYER = re.compile(
    r"(?P<model>[^/]*)/S(?P<part>[123])_(?P<layer>c1|c2|BN|last)(?P<block>\d*)(_\d+)?/"
    r"(?P<array>kernel|bias|gamma|beta|moving_mean|moving_variance)(:0)?$"
)
"""Where the authors' layers stand: S1_c10 is the first convolution of block 0 of a stream."""
_LAYERS = {"c1": "first", "c2": "second", "BN": "norm"}
_ARRAYS = {
    "kernel": "weight",
    "bias": "bias",
    "gamma": "weight",
    "beta": "bias",
    "moving_mean": "running_mean",
    "moving_variance": "running_var",
}


def import_weights(name: str, source: str | Path, output: str | Path) -> None:
    """Turn weights of EPINET in Keras' layout into a file that `--weights` takes.

    The streams are taken in the order of the authors' code: 0, 90, 45 and -45 degrees.

    Parameters
    ----------
    name
        Name of an EPINET.
    source
        HDF5 file as Keras' `save_weights` writes it from the authors' model: a group for each of its parts,
        and in it S1_c10/kernel:0 (height, width, in, out) and so on.
    output
        NPZ file to write.

    Raises
    ------
    LightFieldError
        If the file cannot be read, or its layers are not those of the net.
    """
    source, output = Path(source), Path(output)
    shape = _epinet(name)
    arrays = _renamed(_keras_arrays(source))
    check_arrays(source, arrays, shape.arrays(), name)
    with atomic(output) as temporary:
        temporary.write_bytes(packed(arrays))


def export_weights(name: str, output: str | Path, *, weights: str | Path | None = None) -> None:
    """Write a learned method as an ONNX file.

    Parameters
    ----------
    name
        Name of the method.
    output
        File to write, .onnx.
    weights
        NPZ file; by default that of the package.

    Raises
    ------
    LightFieldError
        If there are no weights, or they cannot be read, or are another net's.
    """
    output = Path(output)
    expected = lfattnet_arrays() if name == "lfattnet" else _epinet(name).arrays()
    source = Path(weights) if weights is not None else shipped(name)
    if source is None:
        raise LightFieldError(
            f"{name}: found no weights in the package, expected a file; give one with --weights"
        )
    arrays = read_arrays(source)
    check_arrays(source, arrays, expected, name)
    made = lfattnet_onnx(arrays) if name == "lfattnet" else epinet_onnx(_epinet(name), arrays)
    with atomic(output) as temporary:
        temporary.write_bytes(made)


def _epinet(name: str) -> EpinetShape:
    if name not in EPINETS:
        raise LightFieldError(f"weights: found {name!r}, expected one of {', '.join(EPINETS)}; choose one")
    return EPINETS[name]


def _keras_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of numbers by where they stand, such as "sequential_1/S1_c10/kernel:0"."""
    h5py = need("h5py", "hdf5", path)
    if not path.is_file():
        raise LightFieldError(f"{path}: found no such file, expected weights in HDF5; give another file")
    found: dict[str, np.ndarray] = {}

    def visit(place: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind == "f":
            found[place] = np.asarray(item, np.float32)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise LightFieldError(
            f"{path}: cannot be read ({str(error).splitlines()[0]}), expected weights in HDF5; give "
            "another file"
        ) from None
    return found


def _renamed(arrays: dict[str, np.ndarray]) -> Weights:
    """Weights by our names, as far as the authors' names are known."""
    places = [_LAYER.search(place) for place in arrays]
    streams = sorted({match["model"] for match in places if match and match["part"] == "1"}, key=_by_number)
    found: Weights = {}
    for match, array in zip(places, arrays.values(), strict=True):
        if match is None:
            continue
        part, layer, block = match["part"], match["layer"], match["block"]
        if part == "3":
            owner = "last.second" if layer == "last" else "last.first"
        else:
            stem = f"stream{streams.index(match['model'])}" if part == "1" else "merged"
            owner = f"{stem}.{block}.{_LAYERS.get(layer, layer)}"
        ours = _ARRAYS[match["array"]]
        found[f"{owner}.{ours}"] = np.ascontiguousarray(
            array.transpose(3, 2, 0, 1) if match["array"] == "kernel" and array.ndim == 4 else array
        )
    return found


def _by_number(name: str) -> list[int | str]:
    """So that sequential_10 comes after sequential_9."""
    return [int(each) if each.isdigit() else each for each in re.split(r"(\d+)", name)]
