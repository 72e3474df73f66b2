"""16-bit grey PNG maps, which hold their scale as a text."""

from __future__ import annotations

import hashlib
import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.limits import read_text
from lfdepth.io.picture import read_picture
from lfdepth.io.pixels import encode_png
from lfdepth.io.png_text import text_in, with_text
from lfdepth.io.record import Record, checked_map

_WHITE = 65535
_SAMPLES = "samples"


def write_png(path: Path, record: Record) -> None:
    """Write a map with its scale: value = offset + scale · sample, exact to half a scale.

    The smallest value becomes sample 0 and the largest 65535. The scale is a text in the PNG itself. For
    other programs it is in `NAME.json` as well, with a checksum of the samples that it belongs to.
    """
    checked_map(record.values, f"{path}: {record.quantity}")  # depth may be infinite, which samples cannot be
    low, high = float(record.values.min()), float(record.values.max())
    scale = (high - low) / _WHITE or 1.0  # a constant map: all samples 0
    samples = np.rint((record.values.astype(np.float64) - low) / scale).astype(np.uint16)
    header = {"quantity": record.quantity, "unit": record.unit, "scale": scale, "offset": low}
    with atomic(path) as picture:
        picture.write_bytes(with_text(encode_png(samples), json.dumps(header)))
        with atomic(scale_file(path)) as sidecar:
            beside = {**header, _SAMPLES: _checksum(samples)}
            sidecar.write_text(json.dumps(beside, indent=2) + "\n", encoding="utf-8")


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
            "use the map, not its preview"
        )
    scale, offset = _read_scale(path, samples)
    return (samples[..., 0] * scale + offset).astype(np.float32)


def scale_file(path: Path) -> Path:
    """Where the scale of a PNG map is stored."""
    return path.with_suffix(".json")


def has_scale(path: Path) -> bool:
    """Whether a PNG says itself that it is a map, and of what scale."""
    try:
        return "scale" in json.loads(text_in(path) or "{}")
    except (OSError, ValueError, TypeError, RecursionError):
        return False


def _checksum(samples: npt.NDArray[Any]) -> str:
    return hashlib.sha256(np.ascontiguousarray(samples, ">u2").data).hexdigest()


def _read_scale(picture: Path, samples: npt.NDArray[Any]) -> tuple[float, float]:
    path = picture if has_scale(picture) else scale_file(picture)
    try:
        header = json.loads((text_in(path) or "") if path == picture else read_text(path))
        if header.get(_SAMPLES, _checksum(samples)) != _checksum(samples):
            raise LightFieldError(
                f"{path}: belongs to other samples than those of {picture.name}; expected the scale written "
                "with it; write the map again"
            )
        quantity, scale, offset = header["quantity"], float(header["scale"]), float(header["offset"])
        if quantity == "disparity" and isfinite(scale) and scale > 0 and isfinite(offset):
            return scale, offset
        found = f"{str(quantity)[:40]} with scale {scale}, offset {offset}"
    except FileNotFoundError:
        found = "missing"
    except LightFieldError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        found = f"unreadable ({type(error).__name__})"
    raise LightFieldError(
        f"{path}: {found}; expected the quantity disparity, its scale > 0 and offset; keep it beside the PNG"
    )
