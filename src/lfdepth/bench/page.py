"""The report: one HTML page with tables, charts and pictures, that needs no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from lfdepth.bench.charts import COLOURS, Axis, Curve, Point, line_chart, point_chart
from lfdepth.bench.results import Bench, SceneResult
from lfdepth.bench.tables import LEGEND, MethodRow, MetricTable, means, sources
from lfdepth.pictures import (
    ERROR_LIMIT,
    Pixels,
    difference_colours,
    disparity_colours,
    error_colours,
    span,
    view_colours,
)
from lfdepth.scoring import metrics
from lfdepth.scoring.captions import score_line
from lfdepth.scoring.metrics import Array
from lfdepth.table import Column, Row, Table
from lfdepth.templating import render
from lfdepth.version import __version__

if TYPE_CHECKING:
    from markupsafe import Markup


@dataclass(frozen=True)
class Coding:
    """How pictures are kept: WebP quality, None for no losses; every how many-th pixel."""

    quality: int | None = None
    every: int = 1


BUDGET = 14_000_000
"""Bytes of pictures in a page before encoding as text; beyond it they are compressed with losses."""

CODINGS = (Coding(), Coding(80), Coding(50), Coding(70, 2), Coding(70, 4))
"""How pictures are kept, best first; the first that fits the budget is taken."""

_LEVELS = 0.02  # px; errors are rounded to this before they become colours, which halves the pictures
_MAIN = ("badpix_0.07", "mse_x100", "runtime")
_OVERVIEW = ("badpix_0.01", "badpix_0.03", "badpix_0.07", "mse_x100", "q25", "discontinuities", "runtime")


def html_text(
    result: Bench, found: Sequence[MetricTable], compare: Sequence[tuple[str, str]] | None = None
) -> str:
    """The page, of the tables `found` of a result; `compare` names pairs of methods as `bench` does."""
    numbered = sources(found)
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(result.methods)}
    overview = [table for table in found if table.key in _OVERVIEW]
    return render(
        "report.html",
        version=__version__,
        result=result,
        legend=LEGEND,
        overview=means(overview) if overview else None,
        main=[table.table(numbered) for table in found if table.key in _MAIN],
        others=[table.table(numbered) for table in found if table.key not in _MAIN],
        scatter=_scatter(found, colours),
        sparsification=_sparsification(result, colours),
        colours={name: colours[name] for name in colours if _has_curves(result, name)},
        scenes=_pictures(result, compare or _neighbours(tuple(result.methods))),
        facts=_facts(result),
        sources=numbered,
        gradients={kind: _gradient(kind) for kind in ("values", "signed")},
    )


def _facts(result: Bench) -> list[Table]:
    """What was run on what: whoever reads the tables must be able to do it again."""
    heads = ("scene", "views", "px", "disparity range", "truth")
    scenes = Table(_words(heads), tuple(Row.of(*_scene_facts(scene)) for scene in result.scenes))
    settings = [
        (each.name, each.method, _parameters(each.resolve().parameters())) for each in result.settings
    ]
    methods = Table(_words(("name", "method", "parameters")), tuple(Row.of(*each) for each in settings))
    return [scenes, *([methods] if settings else [])]


def _words(heads: Sequence[str]) -> tuple[Column, ...]:
    return tuple(Column(head, words=True) for head in heads)


def _scene_facts(scene: SceneResult) -> tuple[str, ...]:
    (rows, columns), (height, width) = scene.grid, scene.reference.shape[:2]
    range = " to ".join(_ends(scene.range)) if scene.range else "estimated from the views"
    truth = "none" if scene.truth is None else "low and high resolution" if scene.high else "low resolution"
    return scene.name, f"{columns}×{rows}", f"{width}×{height}", range, truth


def _parameters(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in values.items() if value is not None)


# --- charts


def _scatter(found: Sequence[MetricTable], colours: Mapping[str, str]) -> Markup | None:
    """Mean error against mean run time over the same scenes, for the methods that can be compared."""
    by_key = {table.key: table for table in found}
    if not {"badpix_0.07", "runtime"} <= set(by_key):
        return None
    rows = {(row.method, row.origin): row for row in by_key["runtime"].rows}
    points = []
    for row in by_key["badpix_0.07"].rows:
        time = _time_beside(rows.get((row.method, row.origin)), row)
        if time and row.mean.value is not None and row.mean.rank:
            hollow = row.origin == "published"
            points.append(Point(row.method, time, row.mean.value, colours.get(row.method, "#888"), hollow))
    if not points:
        return None
    seconds = [point.x for point in points]
    x = Axis("run time (s)", min(seconds) / 2, max(seconds) * 2, log=True)
    y = Axis("mean BadPix 0.07 (%)", 0.0, 1.1 * max(point.y for point in points) or 1.0)
    return point_chart(points, x, y)


def _time_beside(times: MethodRow | None, errors: MethodRow) -> float | None:
    """Mean run time over the scenes that an error was averaged over; of a published row the one there is."""
    if times is None:
        return None
    if times.origin == "published":
        return times.mean.value
    scored = [
        time.value for time, error in zip(times.cells, errors.cells, strict=True) if error.value is not None
    ]
    return None if None in scored else metrics.mean_over_scenes(scored)


def _sparsification(result: Bench, colours: Mapping[str, str]) -> list[tuple[str, Markup]]:
    """Scenes that have curves, and their charts."""
    charts = ((scene.name, _sparsification_chart(scene, colours)) for scene in result.scenes)
    return [(name, chart) for name, chart in charts if chart is not None]


def _has_curves(result: Bench, name: str) -> bool:
    entries = (scene.entries.get(name) for scene in result.scenes)
    return any(each and each.found.confidence is not None and each.scores is not None for each in entries)


def _sparsification_chart(scene: SceneResult, colours: Mapping[str, str]) -> Markup | None:
    curves: list[Curve] = []
    for name, entry in scene.entries.items():
        if entry.found.confidence is not None and scene.truth is not None:
            found = metrics.sparsification(
                entry.found.disparity, scene.truth, entry.found.confidence, steps=50
            )
            x = (100 * found.dropped).tolist()
            curves.append(Curve(name, x, found.error.tolist(), colours[name]))
            curves.append(Curve(f"{name}, ideal", x, found.oracle.tolist(), colours[name], dashed=True))
    if not curves:
        return None
    highest = max(max(curve.y) for curve in curves)
    y = Axis("BadPix 0.07 of the rest (%)", 0.0, 1.05 * highest or 1.0)
    return line_chart(curves, Axis("pixels dropped (%)", 0.0, 100.0), y)


# --- pictures


@dataclass(frozen=True)
class Picture:
    """A picture as text, its size on the page in px, and its caption."""

    data: str
    width: int
    height: int
    caption: str


@dataclass(frozen=True)
class Scale:
    """A colour scale: what its ends mean, and which colours it has."""

    low: str
    high: str
    colours: str


@dataclass(frozen=True)
class Line:
    """Pictures side by side (None: an empty place), words in the first place, and their scale."""

    pictures: tuple[Picture | None, ...]
    scale: Scale
    words: str = ""


def _neighbours(methods: Sequence[str]) -> list[tuple[str, str]]:
    """Each method with the one before it."""
    return [(after, before) for before, after in pairwise(methods)]


def _pictures(result: Bench, compare: Sequence[tuple[str, str]]) -> list[tuple[str, list[Line]]]:
    """Scenes and their lines of pictures, compressed only as far as the budget asks."""
    found: list[tuple[str, list[Line]]] = []
    for coding in CODINGS:
        found = [(scene.name, _lines(scene, compare, coding)) for scene in result.scenes]
        pictures = (each for _, lines in found for line in lines for each in line.pictures if each)
        if sum(len(each.data) for each in pictures) * 3 // 4 <= BUDGET:
            break
    return found


def _lines(scene: SceneResult, compare: Sequence[tuple[str, str]], coding: Coding) -> list[Line]:
    lines = [_maps(scene, coding)]
    if scene.truth is not None:
        lines.append(_errors(scene, scene.truth, coding))
        lines += _differences(scene, scene.truth, compare, coding)
    return lines


def _maps(scene: SceneResult, coding: Coding) -> Line:
    """The reference view and each method's map."""
    range = _range(scene)
    kept = replace(coding, quality=coding.quality or 90)
    pictures = [_picture(view_colours(scene.reference), "reference view", kept)]
    for name, entry in scene.entries.items():
        pictures.append(_picture(disparity_colours(entry.found.disparity, range), name, coding))
    low, high = _ends(range)
    return Line(tuple(pictures), Scale(low, f"{high} px per view step", "values"))


def _errors(scene: SceneResult, truth: Array, coding: Coding) -> Line:
    """The truth and each method's signed error."""
    pictures = [_picture(disparity_colours(truth, _range(scene)), "truth", coding)]
    for name, entry in scene.entries.items():
        pixels = error_colours(_rounded(entry.found.disparity - truth), np.zeros_like(truth))
        pictures.append(_picture(pixels, f"{name}: {score_line(entry.scores or {})}", coding))
    scale = Scale(f"−{ERROR_LIMIT} too far", f"+{ERROR_LIMIT} px too near", "signed")
    return Line(tuple(pictures), scale)


def _differences(
    scene: SceneResult, truth: Array, compare: Sequence[tuple[str, str]], coding: Coding
) -> list[Line]:
    """Differences of absolute errors of pairs of methods, the paper's figure 7."""
    pictures = []
    for pair in compare:
        if set(pair) <= set(scene.entries):
            a, b = (_rounded(scene.entries[name].found.disparity - truth) for name in pair)
            pixels = difference_colours(a, b, np.zeros_like(truth))
            pictures.append(_picture(pixels, f"{pair[0]} against {pair[1]}", coding))
    if not pictures:
        return []
    words = (
        "Difference of the absolute errors of two methods: blue where the first is better, red where worse."
    )
    blank = [None] * (len(scene.entries) - len(pictures))
    scale = Scale(f"−{ERROR_LIMIT} better", f"+{ERROR_LIMIT} px worse", "signed")
    return [Line((*blank, *pictures), scale, words)]


def _range(scene: SceneResult) -> tuple[float, float]:
    if scene.truth is not None:
        return span(scene.truth)
    return scene.range or span(*(entry.found.disparity for entry in scene.entries.values()))


def _rounded(errors: Array) -> Array:
    return np.asarray(np.round(errors / _LEVELS) * _LEVELS)


def _picture(pixels: Pixels, caption: str, coding: Coding) -> Picture:
    from PIL import Image

    height, width = pixels.shape[:2]
    buffer = io.BytesIO()
    options: dict[str, Any] = {"lossless": True} if coding.quality is None else {"quality": coding.quality}
    kept = np.ascontiguousarray(pixels[:: coding.every, :: coding.every])
    Image.fromarray(kept).save(buffer, "WEBP", method=2, **options)
    return Picture(base64.b64encode(buffer.getvalue()).decode(), width, height, caption)


def _ends(range: tuple[float, float]) -> tuple[str, str]:
    """Ends of a range of disparities, in words."""
    low, high = (f"{value:.2f}".replace("-", "−") for value in range)
    return low, high


def _gradient(kind: str) -> str:
    """The colour scale as CSS, from the very colours of the pictures."""
    steps = np.linspace(-ERROR_LIMIT, ERROR_LIMIT, 17)[None]
    pixels = disparity_colours(steps) if kind == "values" else error_colours(steps, 0 * steps)
    return ",".join(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in pixels[0].tolist())
