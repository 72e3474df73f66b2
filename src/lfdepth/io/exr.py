"""OpenEXR maps: disparity as luminance (channel Y), depth as channel Z, which is what it is called there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
from lfdepth.io.openexr import read_channels
from lfdepth.io.record import Record

_CHANNELS = {"disparity": "Y", "depth": "Z"}


def write_exr(path: Path, record: Record) -> None:
    """Write the map, and the confidence as a channel of its own, losslessly compressed."""
    openexr = need("OpenEXR", "exr", path)
    channels = {_CHANNELS[record.quantity]: np.ascontiguousarray(record.values)}
    if record.confidence is not None:
        channels["confidence"] = np.ascontiguousarray(record.confidence)
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
