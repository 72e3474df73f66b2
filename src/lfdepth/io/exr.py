"""OpenEXR maps: disparity as luminance (channel Y), depth as channel Z, which is what it is called there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import stack
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
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


def read_exr(path: Path) -> npt.NDArray[Any]:
    """Read a disparity map.

    Raises
    ------
    LightFieldError
        If OpenEXR is not installed, the file is damaged, or has no channel Y.
    """
    openexr = need("OpenEXR", "exr", path)
    try:
        with openexr.File(str(path)) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except Exception as error:  # the library raises RuntimeError and others
        raise stack.unreadable(path, error) from None
    if _CHANNELS["disparity"] not in channels:
        raise LightFieldError(
            f"{path}: channels {', '.join(channels)}; expected a channel Y with disparities; choose the "
            "disparity map"
        )
    return np.asarray(channels[_CHANNELS["disparity"]])
