"""Dense, sharp disparity maps from light fields by foreground-background separation.

>>> import lfdepth
>>> lf = lfdepth.read("cotton")  # doctest: +SKIP
>>> result = lfdepth.estimate(lf)  # doctest: +SKIP
>>> lfdepth.write("cotton.pfm", result)  # doctest: +SKIP

Before an estimate: `check_orientation` tells from the pixels whether the views are in order, `find_range` the
range of their disparities. After it: `refocus`, `all_in_focus`, `foreground_masks`, and for metres the
`Camera` of the light field: ``lf.camera.disparity_to_depth(result.disparity)``, ``lf.camera.points(...)``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lfdepth.showing import provide
from lfdepth.version import __version__ as __version__

if TYPE_CHECKING:
    from lfdepth.blocks.recentre import from_view
    from lfdepth.camera import Camera
    from lfdepth.errors import LightFieldError
    from lfdepth.estimation import estimate
    from lfdepth.io import read, read_confidence, read_disparity, write
    from lfdepth.io.pixels import write_picture
    from lfdepth.lightfield import LightField
    from lfdepth.methods import Method, method
    from lfdepth.probe.brightness import Equalisation, equalise, measure_brightness
    from lfdepth.probe.geometry import refine_positions, with_aspect
    from lfdepth.probe.order import check_orientation
    from lfdepth.probe.ranges import find_range
    from lfdepth.render.refocus import all_in_focus, foreground_masks, refocus, write_masks
    from lfdepth.result import Result, ViewMaps
    from lfdepth.scale.batch import estimate_many
    from lfdepth.scale.tiles import estimate_tiled
    from lfdepth.scale.video import estimate_video
    from lfdepth.scale.views import WrittenViews, estimate_views, estimate_views_to
    from lfdepth.scoring import evaluate
    from lfdepth.trace import Trace
    from lfdepth.viewer.evidence import Evidence, explain
    from lfdepth.viewer.notebook import view


# Where each public name lives; resolved on first use so that `import lfdepth` costs next to nothing.
_HOMES = {
    "Camera": "lfdepth.camera",
    "Equalisation": "lfdepth.probe.brightness",
    "Evidence": "lfdepth.viewer.evidence",
    "LightField": "lfdepth.lightfield",
    "LightFieldError": "lfdepth.errors",
    "Method": "lfdepth.methods",
    "Result": "lfdepth.result",
    "Trace": "lfdepth.trace",
    "ViewMaps": "lfdepth.result",
    "WrittenViews": "lfdepth.scale.views",
    "all_in_focus": "lfdepth.render.refocus",
    "check_orientation": "lfdepth.probe.order",
    "equalise": "lfdepth.probe.brightness",
    "estimate": "lfdepth.estimation",
    "estimate_many": "lfdepth.scale.batch",
    "estimate_tiled": "lfdepth.scale.tiles",
    "estimate_video": "lfdepth.scale.video",
    "estimate_views": "lfdepth.scale.views",
    "estimate_views_to": "lfdepth.scale.views",
    "evaluate": "lfdepth.scoring",
    "explain": "lfdepth.viewer.evidence",
    "find_range": "lfdepth.probe.ranges",
    "from_view": "lfdepth.blocks.recentre",
    "foreground_masks": "lfdepth.render.refocus",
    "measure_brightness": "lfdepth.probe.brightness",
    "method": "lfdepth.methods",
    "read": "lfdepth.io",
    "read_confidence": "lfdepth.io",
    "read_disparity": "lfdepth.io",
    "refine_positions": "lfdepth.probe.geometry",
    "refocus": "lfdepth.render.refocus",
    "view": "lfdepth.viewer.notebook",
    "with_aspect": "lfdepth.probe.geometry",
    "write": "lfdepth.io",
    "write_masks": "lfdepth.render.refocus",
    "write_picture": "lfdepth.io.pixels",
}

__all__ = [
    "Camera",
    "Equalisation",
    "Evidence",
    "LightField",
    "LightFieldError",
    "Method",
    "Result",
    "Trace",
    "ViewMaps",
    "WrittenViews",
    "all_in_focus",
    "check_orientation",
    "equalise",
    "estimate",
    "estimate_many",
    "estimate_tiled",
    "estimate_video",
    "estimate_views",
    "estimate_views_to",
    "evaluate",
    "explain",
    "find_range",
    "foreground_masks",
    "from_view",
    "measure_brightness",
    "method",
    "read",
    "read_confidence",
    "read_disparity",
    "refine_positions",
    "refocus",
    "view",
    "with_aspect",
    "write",
    "write_masks",
    "write_picture",
]


def _provide(name: str) -> None:
    """Let things show themselves in notebooks by a function of the viewer, loaded when it is first used."""
    provide(name, lambda thing: getattr(import_module("lfdepth.viewer.notebook"), name)(thing))


for _name in ("light_field_html", "light_field_png", "result_html", "result_png"):
    _provide(_name)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        globals()[name] = getattr(import_module(_HOMES[name]), name)
        return globals()[name]
    raise AttributeError(f"module 'lfdepth' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
