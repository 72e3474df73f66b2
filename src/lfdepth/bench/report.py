"""What a bench writes: JSON, CSV, Markdown, and one HTML page (`lfdepth.bench.page`).

No file carries a date, so equal results are equal bytes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lfdepth.bench.page import html_text
from lfdepth.bench.published import PublishedRow, published_rows
from lfdepth.bench.results import Bench, SceneResult
from lfdepth.bench.tables import LEGEND, MetricTable, long_table, sources, tables
from lfdepth.io.atomic import atomic
from lfdepth.version import __version__


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
        ("results.csv", long_table(found).to_csv()),
        ("results.md", markdown_text(result, found)),
        ("report.html", html_text(result, found, compare)),
    ):
        with atomic(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


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


def markdown_text(result: Bench, found: Sequence[MetricTable]) -> str:
    """All tables, what failed, and where published rows come from."""
    parts = ["# Depth from light fields: comparison", "", LEGEND, ""]
    numbered = sources(found)
    for table in found:
        parts += [table.table(numbered).to_markdown(), ""]
    if result.failures:
        parts += ["### Not everything ran", "", *(f"- {failure}" for failure in result.failures), ""]
    if numbered:
        parts += ["### Where published rows come from", ""]
        parts += [f"{n}. {each.title} ({each.reference})" for n, each in enumerate(numbered, 1)] + [""]
    return "\n".join(parts)
