"""What a bench writes: JSON, CSV, Markdown, and one HTML page that needs no other file.

The page is put together from strings: it has one layout, and a template engine would be a dependency for
nothing. Every text that comes from outside goes through `escape`. No file carries a date, so equal results
are equal bytes.
"""

from __future__ import annotations

import base64
import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth import __version__
from lfdepth.bench.charts import COLOURS, Axis, Curve, Point, line_chart, point_chart
from lfdepth.bench.published import PublishedRow, Source, published_rows
from lfdepth.bench.run import Bench, SceneResult
from lfdepth.bench.tables import (
    Cell,
    Row,
    Table,
    cell_mark,
    cell_text,
    figures,
    markdown,
    sources,
    tables,
)
from lfdepth.io.atomic import atomic
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
from lfdepth.scoring.metrics import Array
from lfdepth.scoring.scores import Scores


@dataclass(frozen=True)
class Coding:
    """How pictures are kept: WebP quality, None for no losses; every how many-th pixel."""

    quality: int | None = None
    every: int = 1


BUDGET = 14_000_000
"""Bytes of pictures in a page before encoding as text; beyond it they are compressed with losses."""

_LEVELS = 0.02  # px; errors are rounded to this before they become colours, which halves the pictures
_MAIN = ("badpix_0.07", "mse_x100", "runtime")
_OVERVIEW = ("badpix_0.01", "badpix_0.03", "badpix_0.07", "mse_x100", "q25", "discontinuities", "runtime")


def write_reports(
    result: Bench, folder: Path, *, published: bool = True, compare: Sequence[tuple[str, str]] | None = None
) -> None:
    """Write `results.json`, `results.csv`, `results.md` and `report.html` into a folder.

    Raises
    ------
    LightFieldError
        If a file cannot be written.
    """
    found = tables(result, published=published)
    for name, text in (
        ("results.json", json_text(result, published=published)),
        ("results.csv", csv_text(found)),
        ("results.md", markdown_text(result, found)),
        ("report.html", html_text(result, found, compare)),
    ):
        with atomic(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


# --- plain formats


def json_text(result: Bench, *, published: bool) -> str:
    """Everything but the maps."""
    data = {
        "lfdepth": __version__,
        "methods": [
            {"name": each.name, "method": each.method, "options": dict(each.options)}
            | {"parameters": each.resolve().parameters()}
            for each in result.settings
        ],
        "scenes": [_scene_json(scene) for scene in result.scenes],
        "results": [
            {"scene": scene.name, "method": name, "origin": result.methods[name]}
            | {"runtime": entry.found.runtime}
            | (entry.scores.as_dict() if entry.scores else {})
            for scene in result.scenes
            for name, entry in scene.entries.items()
        ],
        "failures": [
            {"scene": each.scene, "method": each.method, "message": each.message} for each in result.failures
        ],
        "published": [_published_json(row) for row in published_rows()] if published else [],
    }
    return json.dumps(data, indent=1, ensure_ascii=False, default=str) + "\n"


def _scene_json(scene: SceneResult) -> dict[str, Any]:
    height, width = scene.reference.shape[:2]
    truth = None if scene.truth is None else "high" if scene.high else "low"
    return {
        "scene": scene.name,
        "views": list(scene.grid),
        "size": [height, width],
        "disparity_range": scene.range,
        "truth": truth,
    }


def _published_json(row: PublishedRow) -> dict[str, Any]:
    return {
        "method": row.method,
        "source": f"{row.source.title} ({row.source.reference})",
        "learned": row.learned,
        "truth": row.truth,
        "scores": row.scores,
        "averages": row.averages,
        "runtime": row.runtime,
        "seconds_per_plane": row.seconds_per_plane,
    }


def csv_text(found: Iterable[Table]) -> str:
    """One line per method, scene and metric."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["metric", "unit", "method", "origin", "scene", "value", "truth", "note"])
    for table in found:
        for row in table.rows:
            for scene, cell in zip((*table.scenes, "mean"), (*row.cells, row.mean), strict=True):
                value = "" if cell.value is None else repr(cell.value)
                writer.writerow(
                    [table.key, table.unit, row.method, row.origin, scene, value, cell.resolution, cell.note]
                )
    return buffer.getvalue()


def markdown_text(result: Bench, found: Sequence[Table]) -> str:
    """All tables, what failed, and where published rows come from."""
    parts = ["# Depth from light fields: comparison", "", _LEGEND, ""]
    numbered = sources(found)
    parts += [markdown(table, numbered) for table in found]
    if result.failures:
        parts += ["### Not everything ran", "", *(f"- {failure}" for failure in result.failures), ""]
    if numbered:
        parts += ["### Where published rows come from", ""]
        parts += [f"{n}. {each.title} ({each.reference})" for n, each in enumerate(numbered, 1)] + [""]
    return "\n".join(parts)


_LEGEND = (
    "Lower is better; the best three of a column are bold, but never its last. Rows marked *published* were "
    "not run here; their values take part in the ranking only where they stand on truth of the same "
    "resolution. (low) or (high): taken on truth of that resolution where the others, or the benchmark, use "
    "the other. Run times of published rows come from other machines."
)


# --- the page


def html_text(result: Bench, found: Sequence[Table], compare: Sequence[tuple[str, str]] | None = None) -> str:
    """The page: tables, charts, pictures."""
    main = [table for table in found if table.key in _MAIN]
    rest = [table for table in found if table.key not in _MAIN]
    numbered = sources(found)
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(result.methods)}
    body = [
        "<h1>Depth from light fields: comparison</h1>",
        f"<p>{len(result.scenes)} scenes, {len(result.methods)} methods, lfdepth {escape(__version__)}.</p>",
        _failures_html(result),
        f"<p>{escape(_LEGEND).replace('*published*', '<em>published</em>')}</p>",
        _overview_html([table for table in found if table.key in _OVERVIEW]),
        *(_table_html(table, numbered) for table in main),
        _details("All other metrics", "".join(_table_html(table, numbered) for table in rest))
        if rest
        else "",
        _scatter_html(found, colours),
        _sparsification_html(result, colours),
        *_scenes_html(result, compare or _neighbours(tuple(result.methods))),
        _runs_html(result),
        _sources_html(numbered),
    ]
    page = _PAGE.replace("{{values}}", _gradient("values")).replace("{{signed}}", _gradient("signed"))
    return page.replace("{{body}}", "\n".join(filter(None, body)))


def _failures_html(result: Bench) -> str:
    if not result.failures:
        return ""
    items = "".join(f"<li>{escape(str(failure))}</li>" for failure in result.failures)
    return f'<section class="failures"><h2>Not everything ran</h2><ul>{items}</ul></section>'


def _overview_html(found: Sequence[Table]) -> str:
    """The means of the methods that were run or given, over all scenes, in one table."""
    if not found:
        return ""
    head = "".join(f"<th>{escape(_titled(table))}</th>" for table in found)
    lines = ""
    for number, row in enumerate(found[0].rows):
        if row.origin != "published":  # rows of our own come first, in the same order in every table
            cells = "".join(_cell_html(table.rows[number].mean) for table in found)
            lines += f"<tr><th>{escape(row.method)}{_origin(row)}</th>{cells}</tr>"
    return (
        '<h2>Means over the scenes</h2><div class="wide"><table class="overview"><thead><tr><th>method</th>'
        f"{head}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


def _titled(table: Table) -> str:
    return f"{table.label} ({table.unit})" if table.unit else table.label


def _origin(row: Row) -> str:
    return " <small>external</small>" if row.origin == "external" else ""


def _table_html(table: Table, numbered: Sequence[Source]) -> str:
    unit = f" <small>({escape(table.unit)})</small>" if table.unit else ""
    head = "".join(f"<th>{escape(name)}</th>" for name in ("method", *table.scenes, "mean"))
    own = [row for row in table.rows if row.origin != "published"]
    others = [row for row in table.rows if row.origin == "published"]
    body = f"<tbody>{''.join(_row_html(row, table, numbered) for row in own)}</tbody>"
    if others:
        columns = len(table.scenes) + 2
        title = f'<tr><th class="band" colspan="{columns}">published, not run here</th></tr>'
        rows = "".join(_row_html(row, table, numbered) for row in others)
        body += f'<tbody class="published">{title}{rows}</tbody>'
    return (
        f'<h2>{escape(table.label)}{unit}</h2><div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"{body}</table></div>"
    )


def _row_html(row: Row, table: Table, numbered: Sequence[Source]) -> str:
    source = f" <small>[{numbered.index(row.source) + 1}]</small>" if row.source else ""
    device = f" <small>{escape(row.device)}</small>" if row.device and table.key.startswith("runtime") else ""
    learned = " <small>learned</small>" if row.learned else ""
    cells = "".join(_cell_html(cell) for cell in (*row.cells, row.mean))
    return f"<tr><th>{escape(row.method)}{_origin(row)}{learned}{device}{source}</th>{cells}</tr>"


def _cell_html(cell: Cell) -> str:
    if cell.value is None:
        short = "no mask" if cell.note.startswith("no mask") else cell.note
        return f'<td class="none" title="{escape(cell.note)}">{escape(short)}</td>'
    text = escape(figures(cell.value))
    mark = cell_mark(cell)
    return (
        f'<td title="{escape(cell_text(cell))}">{f"<b>{text}</b>" if cell.best else text}'
        f"{f' <small>{escape(mark)}</small>' if mark else ''}</td>"
    )


def _runs_html(result: Bench) -> str:
    """What was run on what: whoever reads the tables must be able to do it again."""
    scenes = [_scene_row(_scene_json(scene)) for scene in result.scenes]
    methods = [(each.name, each.method, _parameters(each.resolve().parameters())) for each in result.settings]
    content = _plain_table(("scene", "views", "px", "disparity range", "truth"), scenes)
    if methods:
        content += _plain_table(("name", "method", "parameters"), methods)
    return f"<h2>Scenes and methods</h2>{content}"


def _scene_row(facts: dict[str, Any]) -> tuple[str, ...]:
    (rows, columns), (height, width), ends = facts["views"], facts["size"], facts["disparity_range"]
    range = " to ".join(_ends(ends)) if ends else "found in the views"
    truth = {None: "none", "low": "low resolution", "high": "low and high resolution"}[facts["truth"]]
    return facts["scene"], f"{columns}×{rows}", f"{width}×{height}", range, truth


def _parameters(values: dict[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in values.items() if value is not None)


def _plain_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    titles = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
    return f'<table class="facts"><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>'


def _sources_html(numbered: Sequence[Source]) -> str:
    items = "".join(f"<li>{escape(each.title)} ({escape(each.reference)})</li>" for each in numbered)
    return f"<h2>Where published rows come from</h2><ol>{items}</ol>" if items else ""


def _details(title: str, content: str) -> str:
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


# --- charts


def _scatter_html(found: Sequence[Table], colours: dict[str, str]) -> str:
    """Mean error against mean run time over the same scenes, for the methods that can be compared."""
    by_key = {table.key: table for table in found}
    if not {"badpix_0.07", "runtime"} <= set(by_key):
        return ""
    rows = {(row.method, row.origin): row for row in by_key["runtime"].rows}
    points = []
    for row in by_key["badpix_0.07"].rows:
        time = _time_beside(rows.get((row.method, row.origin)), row)
        if time and row.mean.value is not None and row.mean.rank:
            hollow = row.origin == "published"
            points.append(Point(row.method, time, row.mean.value, colours.get(row.method, "#888"), hollow))
    if not points:
        return ""
    seconds = [point.x for point in points]
    x = Axis("run time (s)", min(seconds) / 2, max(seconds) * 2, log=True)
    y = Axis("mean BadPix 0.07 (%)", 0.0, 1.1 * max(point.y for point in points) or 1.0)
    return (
        "<h2>Error and run time</h2><p>Mean over the scenes. Hollow: published, on other machines.</p>"
        + point_chart(points, x, y)
    )


def _time_beside(times: Row | None, errors: Row) -> float | None:
    """Mean run time over the scenes that an error was averaged over; of a published row the one there is."""
    if times is None:
        return None
    if times.origin == "published":
        return times.mean.value
    scored = [
        time.value for time, error in zip(times.cells, errors.cells, strict=True) if error.value is not None
    ]
    return None if None in scored else metrics.mean_over_scenes(scored)


def _sparsification_html(result: Bench, colours: dict[str, str]) -> str:
    charts = [
        f"<figure>{chart}<figcaption>{escape(scene.name)}</figcaption></figure>"
        for scene in result.scenes
        if (chart := _sparsification_chart(scene, colours))
    ]
    if not charts:
        return ""
    named = [name for name in colours if any(_has_curve(scene, name) for scene in result.scenes)]
    keys = "".join(f'<span style="color:{colours[name]}">■</span> {escape(name)} &ensp;' for name in named)
    return (
        "<h2>Confidence: error of what is left as the least confident pixels are dropped</h2>"
        f"<p>{keys} Dashed: the worst pixels dropped first, which no confidence can beat.</p>"
        f'<div class="charts">{"".join(charts)}</div>'
    )


def _has_curve(scene: SceneResult, name: str) -> bool:
    entry = scene.entries.get(name)
    return entry is not None and entry.found.confidence is not None and entry.scores is not None


def _sparsification_chart(scene: SceneResult, colours: dict[str, str]) -> str:
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
        return ""
    highest = max(max(curve.y) for curve in curves)
    y = Axis("BadPix 0.07 of the rest (%)", 0.0, 1.05 * highest or 1.0)
    return line_chart(curves, Axis("pixels dropped (%)", 0.0, 100.0), y)


# --- pictures


def _neighbours(methods: Sequence[str]) -> list[tuple[str, str]]:
    """Each method with the one before it."""
    return [(after, before) for before, after in pairwise(methods)]


def _scenes_html(result: Bench, compare: Sequence[tuple[str, str]]) -> list[str]:
    """Sections with pictures, compressed only as far as the budget asks."""
    sections: list[str] = []
    for coding in (Coding(), Coding(80), Coding(50), Coding(70, 2), Coding(70, 4)):
        sections = [_scene_html(scene, compare, coding) for scene in result.scenes]
        if sum(map(len, sections)) * 3 // 4 <= BUDGET:
            break
    return sections


def _scene_html(scene: SceneResult, compare: Sequence[tuple[str, str]], coding: Coding) -> str:
    content = _maps_html(scene, coding)
    if scene.truth is not None:
        content += _errors_html(scene, scene.truth, coding)
        content += _differences_html(scene, scene.truth, compare, coding)
    return f'<section class="scene"><h2>{escape(scene.name)}</h2>{content}</section>'


def _maps_html(scene: SceneResult, coding: Coding) -> str:
    """The reference view and each method's map."""
    maps = {name: entry.found.disparity for name, entry in scene.entries.items()}
    range = _range(scene)
    pictures = [
        _picture(
            view_colours(scene.reference), "reference view", replace(coding, quality=coding.quality or 90)
        )
    ]
    pictures += [_picture(disparity_colours(each, range), name, coding) for name, each in maps.items()]
    return _line_html(pictures, _scale(*_ends(range), "values", " px per view step"))


def _errors_html(scene: SceneResult, truth: Array, coding: Coding) -> str:
    """The truth and each method's signed error."""
    pictures = [_picture(disparity_colours(truth, _range(scene)), "truth", coding)]
    for name, entry in scene.entries.items():
        pixels = error_colours(_rounded(entry.found.disparity - truth), np.zeros_like(truth))
        pictures.append(_picture(pixels, f"{name}: {_score_line(entry.scores)}", coding))
    return _line_html(pictures, _scale(f"−{ERROR_LIMIT} too far", f"+{ERROR_LIMIT} px too near", "signed"))


def _score_line(scores: Scores | None) -> str:
    """The main scores of a map, those of the tables."""
    parts = (("BadPix 0.07", "badpix_0.07", " %"), ("MSE×100", "mse_x100", ""))
    return ", ".join(
        f"{name} {figures(scores[key])}{unit}" for name, key, unit in parts if scores and key in scores
    )


def _differences_html(
    scene: SceneResult, truth: Array, compare: Sequence[tuple[str, str]], coding: Coding
) -> str:
    """Differences of absolute errors of pairs of methods, the paper's figure 7."""
    pictures = []
    for pair in compare:
        if set(pair) <= set(scene.entries):
            a, b = (_rounded(scene.entries[name].found.disparity - truth) for name in pair)
            pixels = difference_colours(a, b, np.zeros_like(truth))
            caption = f"{pair[0]} against {pair[1]}"
            pictures.append(_picture(pixels, caption, coding))
    if not pictures:
        return ""
    words = (
        "<p>Difference of the absolute errors of two methods: blue where the first is better, "
        "red where it is worse.</p>"
    )
    blank = [""] * (len(scene.entries) - len(pictures))
    scale = _scale(f"−{ERROR_LIMIT} better", f"+{ERROR_LIMIT} px worse", "signed")
    return _line_html([words, *blank, *pictures], scale)


def _line_html(pictures: Sequence[str], scale: str) -> str:
    columns = f"grid-template-columns:repeat({len(pictures)},minmax(180px,1fr))"
    cells = "".join(each or "<div></div>" for each in pictures)
    return f'<div class="pictures" style="{columns}">{cells}</div>{scale}'


def _range(scene: SceneResult) -> tuple[float, float]:
    if scene.truth is not None:
        return span(scene.truth)
    return scene.range or span(*(entry.found.disparity for entry in scene.entries.values()))


def _rounded(errors: Array) -> Array:
    return np.asarray(np.round(errors / _LEVELS) * _LEVELS)


def _picture(pixels: Pixels, caption: str, coding: Coding) -> str:
    """A picture as text."""
    from PIL import Image

    height, width = pixels.shape[:2]
    buffer = io.BytesIO()
    options: dict[str, Any] = {"lossless": True} if coding.quality is None else {"quality": coding.quality}
    kept = np.ascontiguousarray(pixels[:: coding.every, :: coding.every])
    Image.fromarray(kept).save(buffer, "WEBP", method=2, **options)
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'<figure><img src="data:image/webp;base64,{data}" width="{width}" height="{height}" '
        f'alt="{escape(caption)}"><figcaption>{escape(caption)}</figcaption></figure>'
    )


def _scale(low: str, high: str, kind: str, unit: str = "") -> str:
    return f'<p class="scale">{escape(low)} <span class="{kind}"></span> {escape(high + unit)}</p>'


def _ends(range: tuple[float, float]) -> tuple[str, str]:
    """Ends of a range of disparities, in words."""
    low, high = (f"{value:.2f}".replace("-", "−") for value in range)
    return low, high


def _gradient(kind: str) -> str:
    """The colour scale as CSS, from the very colours of the pictures."""
    steps = np.linspace(-ERROR_LIMIT, ERROR_LIMIT, 17)[None]
    pixels = disparity_colours(steps) if kind == "values" else error_colours(steps, 0 * steps)
    return ",".join(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in pixels[0].tolist())


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>Depth from light fields: comparison</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; margin: 24px auto; max-width: 1500px; padding: 0 20px; color:
#1a1a1a } h1 { font-size: 24px } h2 { font-size: 18px; margin: 28px 0 8px }
small { color: #777; font-weight: normal }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: 3px 12px; text-align: right; white-space: nowrap }
th:first-child { text-align: left; font-weight: 600 }
thead th { border-bottom: 2px solid #888 }
tbody tr:hover { background: #f2f5f9 }
td:last-child { border-left: 1px solid #ccc }
td b { color: #000 }
td.none { color: #888; font-size: 12px; max-width: 220px; white-space: normal }
.published { color: #555; font-style: italic } .published th { font-weight: 400 }
.published th.band { font: 12px system-ui, sans-serif; color: #777; border-top: 1px solid #ccc; padding-top:
6px } .failures { border-left: 4px solid #c62828; padding: 2px 16px; background: #fdf1f0 }
details { margin: 20px 0 } summary { cursor: pointer; font-weight: 600 }
.charts { display: flex; flex-wrap: wrap; gap: 16px }
svg { max-width: 100%; height: auto } svg text { font: 11px system-ui, sans-serif; fill: #333 }
svg .grid { stroke: #e3e3e3; fill: none }
svg text.name { paint-order: stroke; stroke: #fff; stroke-width: 3px }
.facts { margin-bottom: 14px } .facts th, .facts td { text-align: left; vertical-align: top }
.overview td:last-child { border-left: 0 }
.facts td:last-child { border-left: 0; white-space: normal }
figure { margin: 0; min-width: 0 } figcaption { font-size: 12.5px; color: #444; padding: 2px 0 }
.charts figcaption { text-align: center }
.pictures { display: grid; gap: 10px; margin-top: 10px; overflow-x: auto }
.pictures img { width: 100%; height: auto; max-width: 768px; image-rendering: pixelated; cursor: zoom-in;
display: block } .pictures img.large { position: fixed; inset: 0; margin: auto; width: auto; height: 96vh;
max-width: 98vw;
  object-fit: contain; z-index: 1; cursor: zoom-out; box-shadow: 0 0 0 100vmax #000b }
.scale { font-size: 12px; color: #444; margin: 2px 0 6px }
.scale span { display: inline-block; width: 180px; height: 10px; vertical-align: middle }
.values { background: linear-gradient(90deg, {{values}}) }
.signed { background: linear-gradient(90deg, {{signed}}) }
</style>
</head>
<body>
{{body}}
<script>
document.addEventListener("click", (event) => {
  if (event.target.matches(".pictures img")) event.target.classList.toggle("large");
});
</script>
</body>
</html>
"""
