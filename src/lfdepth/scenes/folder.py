"""A scene as a folder in the layout of the 4D Light Field Benchmark."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.io.atomic import atomic_folder
from lfdepth.io.pfm import write_pfm
from lfdepth.io.record import Record
from lfdepth.lightfield import LightField
from lfdepth.scenes.rendering import Rendering

FACTOR = 10
"""Pixels of the high-resolution truth per pixel of a view, along one axis."""
_CONFIG = "parameters.cfg"


def write_folder(path: Path, rendering: Rendering) -> None:
    """Write views, parameters, truth and masks of a rendered scene; all of it or nothing."""
    lf = rendering.lf
    with atomic_folder(path) as folder:
        for number, index in enumerate(np.ndindex(*lf.shape[:2])):
            _write_png(folder / f"input_Cam{number:03d}.png", lf.views[index])
        (folder / _CONFIG).write_text(_parameters(lf), encoding="utf-8")
        for resolution, factor in (("lowres", 1), ("highres", FACTOR)):
            truth, labels = rendering.geometry(factor)
            write_pfm(folder / f"gt_disp_{resolution}.pfm", Record(truth))
            _write_masks(folder, resolution, labels)
        if "textureless" in lf.masks:
            _write_masks(folder, "lowres", {"textureless": lf.masks["textureless"].view(np.uint8)})


def _write_masks(folder: Path, resolution: str, labels: Mapping[str, npt.NDArray[np.uint8]]) -> None:
    """Masks are black and white; those with several labels keep them."""
    for name, mask in labels.items():
        values = mask if mask.max() > 1 else mask * np.uint8(255)
        _write_png(folder / f"mask_{name}_{resolution}.png", values)


def _write_png(path: Path, pixels: npt.NDArray[Any]) -> None:
    from PIL import Image

    Image.fromarray(pixels).save(path, compress_level=3)  # a third of the time for a tenth more bytes


def _parameters(lf: LightField) -> str:
    """The benchmark's parameters.cfg."""
    assert lf.camera is not None
    assert lf.disparity_range is not None
    camera = lf.camera
    return f"""# Rendered by lfdepth.scenes
[intrinsics]
focal_length_mm = {camera.focal_length_mm!r}
image_resolution_x_px = {lf.width}
image_resolution_y_px = {lf.height}
sensor_size_mm = {camera.sensor_size_mm!r}

[extrinsics]
num_cams_x = {lf.shape[1]}
num_cams_y = {lf.shape[0]}
baseline_mm = {camera.baseline_mm!r}
focus_distance_m = {camera.focus_distance_m!r}

[meta]
scene = {lf.name}
category = procedural
disp_min = {lf.disparity_range[0]!r}
disp_max = {lf.disparity_range[1]!r}
"""
