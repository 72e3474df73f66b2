"""What commands print: facts as JSON, or in words."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from lfdepth.cli.progress import Progress
    from lfdepth.lightfield import LightField
    from lfdepth.probe.brightness import Equalisation
    from lfdepth.probe.order import Orientation
    from lfdepth.result import Result
    from lfdepth.scale.tiles import Tiled
    from lfdepth.scale.views import WrittenViews

Facts = dict[str, Any]

_FOUND = "estimated from the views"


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


def estimate_facts(
    lf: LightField,
    result: Result,
    progress: Progress,
    written: Sequence[str],
    maps: WrittenViews | None = None,
) -> Facts:
    """What an estimate did: of the reference view, or of all with their maps."""
    facts: Facts = {
        "scene": lf.name,
        "shape": list(lf.shape),
        "method": result.method.as_dict(),
        "engine": result.engine,
        "version": result.version,
        "range": list(result.range),
        "range_found": result.range_found,
        "planes": result.planes,
        "runtime_s": result.runtime,
        "ms_per_plane": 1000 * result.runtime / max(result.planes, 1),
        "compiled": progress.compiled,
        "brightness": result.equalisation and result.equalisation.as_dict(),
        "checks": result.checks and result.checks.as_dict(),
        "written": list(written),
    }
    if maps is not None:
        facts["all_views"] = {"runtime_s": maps.runtime, "consistency": maps.consistency}
    return facts


def estimate_text(facts: Facts) -> str:
    """What an estimate did, in words."""
    found = f" ({_FOUND})" if facts["range_found"] else ""
    compilation = " (including compilation, first run only)" if facts["compiled"] else ""
    views = facts.get("all_views")
    every = (
        {}
        if views is None
        else {
            "all views": f"{views['runtime_s']:.2f} s, {100 * views['consistency']:.1f} % of the pixels hold "
            "in the views they were compared with"
        }
    )
    return _aligned(
        {
            "scene": f"{facts['scene']}, {_shape_text(facts['shape'])}",
            "method": facts["method"]["name"],
            "brightness": facts["brightness"]["message"] if facts["brightness"] else "unchanged",
            "range": f"{_range_text(facts['range'])}{found}, {facts['planes']} planes",
            "time": f"{facts['runtime_s']:.2f} s, {facts['ms_per_plane']:.1f} ms per plane{compilation}",
            **every,
            "written": ", ".join(facts["written"]),
        }
    )


def tiled_facts(scene: Path, done: Tiled) -> Facts:
    """What an estimate by tiles did."""
    return {
        "scene": str(scene),
        "shape": list(done.shape),
        "range": list(done.range),
        "tiles": done.tiles,
        "done_before": done.there,
        "tile_px": done.tile,
        "halo_px": done.halo,
        "done_again": done.again,
        "apart_at_borders": done.apart,
        "warnings": list(done.warnings),
        "runtime_s": done.seconds,
        "written": [str(done.output)],
    }


def tiled_text(facts: Facts) -> str:
    """The same in words."""
    apart, off = (f"{100 * facts[name]:.2g} %" for name in ("apart_at_borders", "off"))
    done = f", {facts['done_before']} of them done before" if facts["done_before"] else ""
    done += f", {facts['done_again']} done again" if facts["done_again"] else ""
    return _aligned(
        {
            "scene": f"{facts['scene']}, {_shape_text(facts['shape'])}",
            "range": _range_text(facts["range"]),
            "tiles": f"{facts['tiles']} of {facts['tile_px']} px with {facts['halo_px']} around{done}",
            "borders": f"tiles differ by more than 0.02 px on {apart} of the pixels there, "
            f"and about {off} of all may be as wrong",
            "time": f"{facts['runtime_s']:.2f} s",
            "written": ", ".join(facts["written"]),
        }
    )


# --- methods


def methods_facts() -> Facts:
    """Methods with their parameters, presets, engines."""
    from lfdepth import engines, methods
    from lfdepth.errors import LightFieldError

    known, unusable = [], []
    for name in methods.names():
        try:
            known.append(methods.method_class(name))
        except LightFieldError as error:  # another package's; it must not hide the others
            unusable.append({"name": name, "problem": str(error)})
    return {
        "methods": [
            {
                "name": each.info.name,
                "summary": each.info.summary,
                "reference": each.info.reference,
                "parameters": [parameter.as_dict() for parameter in methods.parameters_of(each).values()],
            }
            for each in known
        ],
        "unusable": unusable,
        "presets": methods.PRESETS,
        "engines": [{"name": name, "summary": engines.SUMMARIES[name]} for name in engines.NAMES],
    }


def methods_text(facts: Facts) -> str:
    """Methods, presets and engines in words."""
    lines = []
    for method in facts["methods"]:
        defaults = {each["option"]: each["default"] for each in method["parameters"]}
        lines += [f"{method['name']}: {method['summary']}", f"    {_parameters_text(defaults)}"]
    lines += [f"{each['name']}: cannot be used\n    {each['problem']}" for each in facts["unusable"]]
    lines += ["", "What each parameter means: lfdepth estimate --method NAME --help", ""]
    lines += [f"--preset {name}: {_parameters_text(preset)}" for name, preset in facts["presets"].items()]
    lines += [f"--engine {each['name']}: {each['summary']}" for each in facts["engines"]]
    return "\n".join(lines)


def _parameters_text(parameters: Mapping[str, Any]) -> str:
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key} {words[value] if isinstance(value, bool) else value}"
        for key, value in parameters.items()
        if value is not None
    )


# --- info


def scene_facts(
    lf: LightField,
    orientation: Orientation | None,
    found: tuple[float, float] | None,
    problem: str | None,
    brightness: Equalisation | None = None,
    geometry: tuple[float | None, float] | None = None,
) -> Facts:
    """What is known of a light field, with the range that was `found` for it, or the `problem` with that.

    `geometry` is the ratio of steps, and how far views stand off their places, as measured in the views.
    """
    import numpy as np

    ends = lf.disparity_range or found
    return {
        "name": lf.name,
        "shape": list(lf.shape),
        "dtype": lf.views.dtype.name,
        "absent_views": _absent(lf),
        "order": _order_facts(orientation) if orientation else None,
        "brightness": brightness and brightness.as_dict(),
        "disparity_range": ends,
        "range_found": found is not None,
        "range_problem": problem,
        "depth_range_m": lf.camera.disparity_to_depth(ends)[::-1].tolist() if lf.camera and ends else None,
        "camera": asdict(lf.camera) if lf.camera else None,
        "truth_range": _truth_range(lf),
        "truth_share": None if lf.truth is None else float(np.isfinite(lf.truth).mean()),
        "masks": sorted(lf.masks),
        "white_level": lf.white_level,
        "measured_aspect": geometry and geometry[0],
        "measured_off_grid": geometry and geometry[1],
        "off_grid": None if lf.positions is None else float(np.abs(lf.positions).max()),
        "remarks": list(lf.remarks),
    }


def scene_text(facts: Facts) -> str:
    """What is known of a light field, in words."""
    depth, camera, truth = (facts[key] for key in ("depth_range_m", "camera", "truth_range"))
    absent = f", {facts['absent_views']} absent" if facts["absent_views"] else ""
    return _aligned(
        {
            "scene": facts["name"],
            "views": f"{_shape_text(facts['shape'])}, {facts['dtype']}{absent}",
            "order": facts["order"]["message"] if facts["order"] else "not checked",
            "brightness": facts["brightness"]["message"] if facts["brightness"] else "not checked",
            "white": _white_text(facts["white_level"]),
            "geometry": _geometry_text(facts["measured_aspect"], facts["measured_off_grid"]),
            "range": _scene_range_text(facts),
            "depth": f"{depth[0]:.3g} to {depth[1]:.3g} m" if depth else "unknown",
            "camera": _camera_text(camera) if camera else "unknown",
            "truth": _truth_text(truth, facts["truth_share"]),
            "masks": ", ".join(facts["masks"]) or "none",
        }
        | _positions_line(facts["off_grid"])
        | _remark_lines(facts["remarks"])
    )


def _truth_range(lf: LightField) -> list[float] | None:
    import numpy as np

    if lf.truth is None or not np.isfinite(lf.truth).any():
        return None
    known = lf.truth[np.isfinite(lf.truth)]
    return [float(known.min()), float(known.max())]


def _truth_text(ends: Sequence[float] | None, share: float | None) -> str:
    if not ends:
        return "none"
    return _range_text(ends) + ("" if share == 1 else f", for {100 * (share or 0):.3g} % of the pixels")


def _positions_line(off_grid: float | None) -> dict[str, str]:
    if off_grid is None:
        return {}
    return {"cameras": f"off the regular grid by up to {100 * off_grid:.2g} % of a view step"}


def _white_text(level: float | None) -> str:
    return "full scale" if level is None else f"{level:g} in the file"


def _geometry_text(aspect: float | None, off_grid: float | None) -> str:
    """What the views say of where they stand, and the options that make up for it."""
    from lfdepth.probe.geometry import NOTABLE_ASPECT, NOTABLE_POSITIONS

    if off_grid is None:
        return "not checked"
    words = []
    if aspect is None:
        words.append("aspect not measured: rows and columns of views have too little in common")
    elif abs(aspect - 1) > NOTABLE_ASPECT:
        words.append(f"vertical step is {aspect:.2f} of the horizontal step, use --aspect {aspect:.2f}")
    if off_grid > NOTABLE_POSITIONS:
        words.append(f"views are off the grid by {100 * off_grid:.0f} % of a step, use --refine-positions")
    return "; ".join(words) or "regular grid, equal steps"


def _remark_lines(remarks: Sequence[str]) -> dict[str, str]:
    """A line for each remark; the first one has the heading."""
    return {("remarks" if number == 0 else " " * number): remark for number, remark in enumerate(remarks)}


def _order_facts(orientation: Orientation) -> Facts:
    options = orientation.options if orientation.order_decided else None
    return {
        "decided": orientation.decided,
        "wrong": orientation.wrong,
        "options": options,
        "message": orientation.message,
    }


def _scene_range_text(facts: Facts) -> str:
    if facts["disparity_range"] is None:
        return f"unknown: {facts['range_problem']}" if facts["range_problem"] else "unknown"
    found = f" ({_FOUND})" if facts["range_found"] else ""
    return f"{_range_text(facts['disparity_range'])}{found}"


def _camera_text(camera: Mapping[str, Any]) -> str:
    return (
        f"focal length {camera['focal_length_mm']:g} mm, sensor {camera['sensor_size_mm']:g} mm, "
        f"baseline {camera['baseline_mm']:g} mm, focus at {camera['focus_distance_m']:g} m"
    )


# --- convert


def conversion_facts(lf: LightField | None, output: Path) -> Facts:
    """What was converted: a light field, or a map."""
    return {
        "scene": lf and lf.name,
        "shape": lf and list(lf.shape),
        "absent_views": lf and _absent(lf),
        "white_level": lf and lf.white_level,
        "remarks": list(lf.remarks) if lf else [],
        "written": [str(output)],
    }


def conversion_text(facts: Facts) -> str:
    """What was converted, in words."""
    written = {"written": ", ".join(facts["written"])}
    if facts["scene"] is None:
        return _aligned(written)
    absent = f", {facts['absent_views']} absent" if facts["absent_views"] else ""
    scene = {"scene": f"{facts['scene']}, {_shape_text(facts['shape'])}{absent}"}
    return _aligned(scene | _remark_lines(facts["remarks"]) | written)


# --- refocus, mask


def refocus_facts(
    lf: LightField, disparity: float | None, without_foreground: float | None, output: Path
) -> Facts:
    """What was focused on."""
    return {
        "scene": lf.name,
        "disparity": disparity,
        "all_in_focus": disparity is None,
        "without_foreground": without_foreground,
        "written": [str(output)],
    }


def refocus_text(facts: Facts) -> str:
    """What was focused on, in words."""
    left_out, plane = facts["without_foreground"], facts["disparity"]
    without = "" if left_out is None else f", without anything nearer than {left_out:g}"
    focus = "everywhere" if facts["all_in_focus"] else f"{plane:g} px per view step{without}"
    return _aligned({"scene": facts["scene"], "focus": focus, "written": ", ".join(facts["written"])})


def mask_facts(lf: LightField, masks: NDArray[np.bool_], disparity: float, output: Path) -> Facts:
    """What a 4-D mask holds."""
    there = masks if lf.present is None else masks[lf.present]
    return {
        "scene": lf.name,
        "foreground_of": disparity,
        "masks": there.size // (lf.height * lf.width),
        "foreground_share": float(there.mean()),
        "written": [str(output)],
    }


def mask_text(facts: Facts) -> str:
    """What a 4-D mask holds, in words."""
    return _aligned(
        {
            "scene": facts["scene"],
            "masks": f"{facts['masks']}, nearer than {facts['foreground_of']:g} px per view step",
            "share": f"{facts['foreground_share']:.1%} of the pixels are foreground",
            "written": ", ".join(facts["written"]),
        }
    )


# --- parts


def _absent(lf: LightField) -> int:
    return 0 if lf.present is None else int((~lf.present).sum())


def _shape_text(shape: Sequence[int]) -> str:
    v, u, height, width, channels = shape
    return f"{u}×{v} views of {width}×{height} px, {'grey' if channels == 1 else 'colour'}"


def _range_text(ends: Sequence[float]) -> str:
    return f"{ends[0]:g} to {ends[1]:g} px per view step"


def _aligned(lines: Mapping[str, str]) -> str:
    width = max(map(len, lines))
    return "\n".join(f"{key:<{width}}  {value}" for key, value in lines.items())
