"""What commands print: facts as JSON, or in words."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lfdepth.cli.progress import Progress
    from lfdepth.lightfield import LightField
    from lfdepth.sweep.run import Result

Facts = dict[str, Any]


def report(facts: Facts, as_json: bool, text: Callable[[Facts], str]) -> None:
    """Print facts, as one JSON object or in words."""
    print(json.dumps(_finite(facts), allow_nan=False) if as_json else text(facts))


def _finite(facts: Any) -> Any:
    """The same with None for numbers that JSON cannot hold."""
    if isinstance(facts, dict):
        return {key: _finite(value) for key, value in facts.items()}
    if isinstance(facts, (list, tuple)):
        return [_finite(value) for value in facts]
    return None if isinstance(facts, float) and not isfinite(facts) else facts


# --- estimate


def estimate_facts(lf: LightField, result: Result, progress: Progress, written: Sequence[str]) -> Facts:
    """What an estimate did."""
    return {
        "scene": lf.name,
        "shape": list(lf.shape),
        "method": asdict(result.method),
        "range": list(result.range),
        "planes": progress.planes,
        "runtime_s": result.runtime,
        "ms_per_plane": 1000 * result.runtime / progress.planes,
        "compiled": progress.compiled,
        "written": list(written),
    }


def estimate_text(facts: Facts) -> str:
    """What an estimate did, in words."""
    compilation = " (with compilation, first run only)" if facts["compiled"] else ""
    return _aligned(
        {
            "scene": f"{facts['scene']}, {_shape_text(facts['shape'])}",
            "method": facts["method"]["name"],
            "range": f"{_range_text(facts['range'])}, {facts['planes']} planes",
            "time": f"{facts['runtime_s']:.2f} s, {facts['ms_per_plane']:.1f} ms per plane{compilation}",
            "written": ", ".join(facts["written"]),
        }
    )


# --- methods


def methods_text(facts: Facts) -> str:
    """Methods and presets with their parameters."""
    lines = []
    for method in facts["methods"]:
        parameters = {key: value for key, value in method.items() if key not in ("name", "summary")}
        lines += [f"{method['name']}: {method['summary']}", f"    {_parameters_text(parameters)}"]
    lines.append("")
    lines += [f"--preset {name}: {_parameters_text(preset)}" for name, preset in facts["presets"].items()]
    return "\n".join(lines)


def _parameters_text(parameters: Mapping[str, Any]) -> str:
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key} {words[value] if isinstance(value, bool) else value}"
        for key, value in parameters.items()
        if value is not None
    )


# --- info


def scene_facts(lf: LightField) -> Facts:
    """What is known of a light field."""
    ends = lf.disparity_range
    grid = lf.shape[0] * lf.shape[1]
    return {
        "name": lf.name,
        "shape": list(lf.shape),
        "dtype": lf.views.dtype.name,
        "absent_views": 0 if lf.present is None else grid - int(lf.present.sum()),
        "disparity_range": ends,
        "depth_range_m": lf.camera.disparity_to_depth(ends)[::-1].tolist() if lf.camera and ends else None,
        "camera": asdict(lf.camera) if lf.camera else None,
        "truth_range": None if lf.truth is None else [float(lf.truth.min()), float(lf.truth.max())],
        "masks": sorted(lf.masks),
    }


def scene_text(facts: Facts) -> str:
    """What is known of a light field, in words."""
    ends, depth, camera, truth = (
        facts[key] for key in ("disparity_range", "depth_range_m", "camera", "truth_range")
    )
    absent = f", {facts['absent_views']} absent" if facts["absent_views"] else ""
    return _aligned(
        {
            "scene": facts["name"],
            "views": f"{_shape_text(facts['shape'])}, {facts['dtype']}{absent}",
            "range": _range_text(ends) if ends else "unknown",
            "depth": f"{depth[0]:.3g} to {depth[1]:.3g} m" if depth else "unknown",
            "camera": _camera_text(camera) if camera else "unknown",
            "truth": _range_text(truth) if truth else "none",
            "masks": ", ".join(facts["masks"]) or "none",
        }
    )


def _camera_text(camera: Mapping[str, Any]) -> str:
    return (
        f"focal length {camera['focal_length_mm']:g} mm, sensor {camera['sensor_size_mm']:g} mm, "
        f"baseline {camera['baseline_mm']:g} mm, focus at {camera['focus_distance_m']:g} m"
    )


# --- parts


def _shape_text(shape: Sequence[int]) -> str:
    v, u, height, width, channels = shape
    return f"{u}×{v} views of {width}×{height} px, {'grey' if channels == 1 else 'colour'}"


def _range_text(ends: Sequence[float]) -> str:
    return f"{ends[0]:g} to {ends[1]:g} px per view step"


def _aligned(lines: Mapping[str, str]) -> str:
    width = max(map(len, lines))
    return "\n".join(f"{key:<{width}}  {value}" for key, value in lines.items())
