"""OpenEXR: views, and maps: disparity as luminance (channel Y), depth as channel Z, as it is called there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
from lfdepth.io.openexr import read_channels
from lfdepth.io.record import Record

_CHANNELS = {"disparity": "Y", "depth": "Z"}


def write_exr(path: Path, record: Record) -> None:
    """Write the map, and confidence and sigma as channels of their own, losslessly compressed."""
    openexr = need("OpenEXR", "exr", path)
    channels = {_CHANNELS[record.quantity]: np.ascontiguousarray(record.values)}
    for name in ("confidence", "sigma"):
        if (beside := getattr(record, name)) is not None:
            channels[name] = np.ascontiguousarray(beside)
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage, "comments": record.unit}
    with atomic(path) as temporary, openexr.File(header, channels) as file:
        file.write(str(temporary))


def read_exr(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read all channels; Y is called `disparity`.

    Raises
    ------
    LightFieldError
        If the file is damaged, or of a kind that `read_channels` does not read.
    """
    quantities = {channel: quantity for quantity, channel in _CHANNELS.items()}
    return {quantities.get(name, name): pixels for name, pixels in read_channels(path).items()}


def read_colours(path: Path) -> tuple[npt.NDArray[np.float32], str]:
    """Read the colours of a picture: channels R, G and B, or Y.

    Of several layers, the one without a name counts, or the one called Combined, as Blender calls it.

    Returns
    -------
    pixels : ndarray, shape (H, W, C)
        float32.
    mode : str
        "L" or "RGB", or with alpha "LA" or "RGBA".

    Raises
    ------
    LightFieldError
        If the file is damaged, of a kind that `read_channels` does not read, or has no such channels.
    """
    channels = read_channels(path)
    layers = {name.rpartition(".")[0] for name in channels}
    for layer in sorted(layers, key=lambda name: (name != "", not name.endswith("Combined"), name)):
        named = {
            name.rpartition(".")[2]: each
            for name, each in channels.items()
            if name.rpartition(".")[0] == layer
        }
        for mode, names in (("RGB", "RGB"), ("L", "Y")):
            if set(names) <= set(named):
                taken = [named[name] for name in (names + "A" if "A" in named else names)]
                return np.stack(taken, axis=-1).astype(np.float32), f"{mode}A" if "A" in named else mode
    raise LightFieldError(
        f"{path}: channels {', '.join(sorted(channels)) or 'none'}; expected R, G and B, or Y; if it is not "
        "a view, select the pictures that are (--pattern)"
    )
