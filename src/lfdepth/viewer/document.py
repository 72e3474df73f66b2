"""What a page shows: a light field, maps of it, and everything a browser has to know about them."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.layout import SURFACE_JUMP
from lfdepth.errors import LightFieldError
from lfdepth.io.ply import occlusion_step
from lfdepth.io.record import Record, as_record
from lfdepth.lightfield import LightField
from lfdepth.memory import size_text
from lfdepth.pictures import span, view_colours

if TYPE_CHECKING:
    from lfdepth.result import Result

LARGEST = 1 << 30
"""Bytes that the views may take on the graphics processor."""

MOST_VIEWS = 1024
"""Views that one shader can go through in every browser."""

_COLOURS = {"viridis": "viridis", "cividis": "cividis", "grey": "gray", "signed": "RdBu_r"}


@dataclass(frozen=True, eq=False)
class ShownMap:
    """A map of the reference view as the page shows it.

    Attributes
    ----------
    identity
        Number by which the page asks for it.
    name
        Where it comes from: a method, or a file.
    record
        Disparity, confidence, standard error.
    source
        What evidence is asked of: the result, or what a file holds.
    facts
        Method with parameters, range, time, warnings, for the page.
    """

    identity: int
    name: str
    record: Record
    source: Result | Record
    facts: Mapping[str, Any] = field(default_factory=dict)

    def layers(self) -> dict[str, NDArray[np.float32]]:
        """Its (H, W) arrays by name."""
        return self.record.arrays()


def shown_map(source: Result | Record | NDArray[Any], lf: LightField, identity: int, name: str) -> ShownMap:
    """A map for the page.

    Parameters
    ----------
    source
        Result of `estimate`, what a file holds, or a bare (H, W) map.
    lf
        Light field of the map.
    identity, name
        See `ShownMap`.

    Raises
    ------
    LightFieldError
        If the map is not finite or of another size than the views.
    """
    record = as_record(source)
    values = np.asarray(record.values)
    if record.quantity != "disparity":
        raise LightFieldError(
            f"{name}: holds {record.quantity} in {record.unit}; expected disparity in px per view step; "
            "give the map that the depth was made from"
        )
    if values.shape != (lf.height, lf.width):
        raise LightFieldError(
            f"{name}: is a map of {values.shape[1]}x{values.shape[0]} px; expected {lf.width}x{lf.height} "
            f"like the views of {lf.name}; apply the same crop and scale to both"
        )
    if isinstance(source, Record | np.ndarray):
        return ShownMap(identity, name, record, record, {"range": list(record.range or span(values))})
    facts = {
        "method": source.method.name,
        "parameters": source.method.parameters(),
        "range": list(source.range),
        "range_found": source.range_found,
        "planes": source.planes,
        "runtime_s": source.runtime,
        "warnings": list(source.checks.warnings) if source.checks else [],
    }
    return ShownMap(identity, name, record, source, facts)


def check_showable(lf: LightField) -> None:
    """Raise LightFieldError where a browser could not hold the views."""
    v, u, height, width, _ = lf.shape
    size = 4 * v * u * height * width
    if v * u > MOST_VIEWS or size > LARGEST:
        raise LightFieldError(
            f"{lf.name}: {u}×{v} views of {width}×{height} px take {size_text(size)} in a browser; expected "
            f"at most {MOST_VIEWS} views and {size_text(LARGEST)}; use --views or --scale"
        )


def scene_facts(lf: LightField) -> dict[str, Any]:
    """What the page has to know of a light field, for JSON."""
    return {
        "name": lf.name,
        "width": lf.width,
        "height": lf.height,
        "channels": lf.shape[4],
        "grid": list(lf.shape[:2]),
        "centre": list(lf.centre),
        "offsets": lf.offsets.reshape(-1, 2).tolist(),
        "present": lf.available.reshape(-1).astype(int).tolist(),
        "range": lf.disparity_range and list(lf.disparity_range),
        "camera": _camera_facts(lf),
        "truth": lf.truth is not None,
        "jump": SURFACE_JUMP,
        "cut": occlusion_step(lf),
        "remarks": list(lf.remarks),
    }


def map_facts(shown: ShownMap) -> dict[str, Any]:
    """What the page has to know of a map, for JSON."""
    return {
        "id": shown.identity,
        "name": shown.name,
        "layers": list(shown.layers()),
        "span": list(span(shown.record.values)),
        **shown.facts,
    }


def _camera_facts(lf: LightField) -> dict[str, float] | None:
    """Depth Z = 1 / (D / scale + inverse_focus); a ray leaves pixel x at (x − cx)·step."""
    camera = lf.camera
    if camera is None:
        return None
    metres = camera.baseline_mm * camera.focal_length_mm / camera.pixel_pitch_mm / 1000
    return {
        "scale": metres,
        "inverse_focus": 1 / camera.focus_distance_m,
        "cx": camera.principal_point[0],
        "cy": camera.principal_point[1],
        "step": camera.pixel_pitch_mm / camera.focal_length_mm,
    }


def colour_tables() -> dict[str, bytes]:
    """256 colours (R, G, B) of each colour map: perceptually uniform for values, blue to red for errors."""
    from matplotlib import colormaps

    steps = np.linspace(0, 1, 256)
    return {
        name: np.ascontiguousarray(colormaps[table](steps, bytes=True)[:, :3]).tobytes()
        for name, table in _COLOURS.items()
    }


def view_samples(lf: LightField, index: tuple[int, int]) -> NDArray[np.uint8]:
    """A view (H, W, 3) in 8 bits."""
    return np.ascontiguousarray(view_colours(lf.views[index]))


def as_jpeg(pixels: NDArray[np.uint8], quality: int) -> bytes:
    """JPEG of a picture (H, W, 3), colour as fine as brightness."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, subsampling=0, optimize=True)
    return stream.getvalue()


def as_bytes(array: NDArray[Any]) -> bytes:
    """Little-endian float32."""
    return np.ascontiguousarray(array, "<f4").tobytes()
