"""16-bit grey PNG maps, with their scale in a JSON file beside them."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.picture import read_picture
from lfdepth.io.pixels import encode_png
from lfdepth.io.record import Record, checked_map

_WHITE = 65535


def write_png(path: Path, record: Record) -> None:
    """Write `NAME.png` and `NAME.json`; value = offset + scale · sample, exact to half a scale.

    The smallest value becomes sample 0 and the largest 65535.
    """
    checked_map(record.values, f"{path}: {record.quantity}")  # depth may be infinite, which samples cannot be
    low, high = float(record.values.min()), float(record.values.max())
    scale = (high - low) / _WHITE or 1.0  # a constant map: all samples 0
    samples = np.rint((record.values.astype(np.float64) - low) / scale).astype(np.uint16)
    header = {"quantity": record.quantity, "unit": record.unit, "scale": scale, "offset": low}
    with atomic(path) as picture:
        picture.write_bytes(encode_png(samples))
        with atomic(scale_file(path)) as sidecar:
            sidecar.write_text(json.dumps(header, indent=2) + "\n", encoding="utf-8")


def read_png(path: Path) -> npt.NDArray[np.float32]:
    """Read a map written by `write_png`.

    Returns
    -------
    ndarray, shape (H, W)
        float32.

    Raises
    ------
    LightFieldError
        If the picture is not 16-bit grey, or its scale is missing or garbled.
    """
    samples = read_picture(path)
    if samples.dtype != np.uint16 or samples.shape[2] != 1:
        raise LightFieldError(
            f"{path}: {samples.dtype} picture with {samples.shape[2]} channels; expected a 16-bit grey map; "
            "choose the map, not its preview"
        )
    scale, offset = _read_scale(scale_file(path))
    return (samples[..., 0] * scale + offset).astype(np.float32)


def scale_file(path: Path) -> Path:
    """Where the scale of a PNG map is stored."""
    return path.with_suffix(".json")


def _read_scale(path: Path) -> tuple[float, float]:
    try:
        header = json.loads(path.read_text(encoding="utf-8"))
        quantity, scale, offset = header["quantity"], float(header["scale"]), float(header["offset"])
        if quantity == "disparity" and isfinite(scale) and scale > 0 and isfinite(offset):
            return scale, offset
        found = f"{quantity} with scale {scale}, offset {offset}"
    except FileNotFoundError:
        found = "missing"
    except (OSError, ValueError, KeyError, TypeError) as error:
        found = f"unreadable ({type(error).__name__})"
    raise LightFieldError(
        f"{path}: {found}; expected the quantity disparity, its scale > 0 and offset; keep it beside the PNG"
    )
