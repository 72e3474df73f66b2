"""Tables of a bench: methods × scenes for each metric, with published rows beside the measured ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Literal

from lfdepth.bench.published import PublishedRow, Source, published_rows
from lfdepth.bench.run import Bench, SceneResult
from lfdepth.scoring.metrics import mean_over_scenes
from lfdepth.scoring.scores import LOW_INSTEAD, METRICS, label_of

BOLD = 3
"""How many of the best are set in bold, as the paper does; never the last of a column."""


_LOG = "runtime_log10"
_SHORTEST = 1e-6  # s; a shorter run time has this logarithm


@dataclass(frozen=True)
class Cell:
    """One value of a table.

    Attributes
    ----------
    value : float or None
    note : str
        Why there is no value, or what is special about it.
    resolution : str
        "low" or "high": the truth behind it.
    rank : int
        1 for the best of the values that can be compared in the column; 0 where it is not ranked.
    best : bool
        Whether it is set in bold.
    """

    value: float | None = None
    note: str = ""
    resolution: str = ""
    rank: int = 0
    best: bool = False


@dataclass(frozen=True)
class Row:
    """A method: its cells by scene, and its mean over them."""

    method: str
    origin: Literal["measured", "external", "published"]
    cells: tuple[Cell, ...]
    mean: Cell
    source: Source | None = None
    device: str = ""
    learned: bool = False


@dataclass(frozen=True)
class Table:
    """A metric of all methods on all scenes."""

    key: str
    label: str
    unit: str
    scenes: tuple[str, ...]
    rows: tuple[Row, ...]


def tables(result: Bench, *, published: bool = True) -> tuple[Table, ...]:
    """A table for each metric that a scene has, in the order of `METRICS`, and two of the run times.

    Published rows stand in the tables of the metrics that they have for one of the scenes. A column is ranked
    among the values that were taken on truth of the same resolution as the measured ones; a mean is ranked if
    it is over all scenes.
    """
    units = {metric.key: metric.unit for metric in METRICS} | {"runtime": "s", _LOG: "log10 s"}
    return tuple(
        Table(
            key,
            label_of(key.removesuffix("_log10")),
            unit,
            tuple(scene.name for scene in result.scenes),
            rows,
        )
        for key, unit in units.items()
        if (rows := _rows(result, key, published))
    )


def _rows(result: Bench, key: str, published: bool) -> tuple[Row, ...]:
    own = [
        Row(name, origin, tuple(_cell(scene, name, key) for scene in result.scenes), Cell())
        for name, origin in result.methods.items()
    ]
    # Scenes that have the metric: where none of our rows has a value, truth or mask is missing.
    scored = [any(row.cells[i].value is not None for row in own) for i in range(len(result.scenes))]
    if not any(scored):
        return ()
    others = list(_published(result, key, scored)) if published else []
    return _ranked([_with_mean(row, scored) for row in own], others, scored)


def _cell(scene: SceneResult, method: str, key: str) -> Cell:
    entry = scene.entries.get(method)
    if entry is None:
        return Cell(note="failed")
    if key in ("runtime", _LOG):
        seconds = entry.found.runtime
        return Cell(note="no run time") if seconds is None else Cell(_scaled(key, seconds))
    if entry.scores is None:
        return Cell(note="no truth")
    if key not in entry.scores:
        return Cell(note=entry.scores.missing.get(key, "–"))
    return Cell(entry.scores[key], entry.scores.notes.get(key, ""), entry.scores.resolution[key])


def _scaled(key: str, seconds: float) -> float:
    return math.log10(max(seconds, _SHORTEST)) if key == _LOG else seconds


def _published(result: Bench, key: str, scored: Sequence[bool]) -> Iterator[Row]:
    for row in published_rows():
        cells = tuple(_published_cell(row, scene.name, key) for scene in result.scenes)
        made = Row(row.method, "published", cells, Cell(), row.source, row.device, row.learned)
        if key in ("runtime", _LOG) and row.runtime is not None:
            yield replace(made, mean=Cell(_scaled(key, row.runtime), "on the authors' machine"))
        elif any(cell.value is not None for cell in cells):
            # A mean over some of the scenes would stand beside means over all of them.
            whole = all(cell.value is not None for cell in compress(cells, scored))
            yield _with_mean(made, scored) if whole else replace(made, mean=Cell(note="–"))


def _published_cell(row: PublishedRow, scene: str, key: str) -> Cell:
    value = row.scores.get(key, {}).get(scene)
    return Cell(note="–") if value is None else Cell(value, "", row.resolution(scene))


def _with_mean(row: Row, scored: Sequence[bool]) -> Row:
    """The row with its mean over the scenes that have the metric; it says if a method lacks some of them."""
    known = [cell for cell in compress(row.cells, scored) if cell.value is not None]
    mean = mean_over_scenes([cell.value for cell in known])
    if math.isnan(mean):
        return replace(row, mean=Cell(note="no scene"))
    resolutions = {cell.resolution for cell in known}
    part = "" if len(known) == sum(scored) else f"{len(known)} of {sum(scored)} scenes"
    return replace(row, mean=Cell(mean, part, resolutions.pop() if len(resolutions) == 1 else "mixed"))


def _ranked(own: Sequence[Row], others: Sequence[Row], scored: Sequence[bool]) -> tuple[Row, ...]:
    rows = [*own, *others]
    columns = [_rank_column([row.cells[i] for row in rows], len(own)) for i in range(len(scored))]
    # A mean is comparable with another where each of its scenes is.
    counted = list(compress(columns, scored))
    comparable = [all(column[number].rank for column in counted) for number in range(len(rows))]
    means = _rank([row.mean for row in rows], comparable)
    return tuple(
        replace(row, cells=tuple(column[number] for column in columns), mean=means[number])
        for number, row in enumerate(rows)
    )


def _rank_column(cells: Sequence[Cell], own: int) -> list[Cell]:
    resolution = next((cell.resolution for cell in cells[:own] if cell.value is not None), "")
    return _rank(cells, [cell.value is not None and cell.resolution == resolution for cell in cells])


def _rank(cells: Sequence[Cell], comparable: Sequence[bool]) -> list[Cell]:
    pairs = list(zip(cells, comparable, strict=True))
    values = sorted(cell.value for cell, yes in pairs if yes and cell.value is not None)

    def ranked(cell: Cell, value: float) -> Cell:
        rank = values.index(value) + 1
        return replace(cell, rank=rank, best=_is_best(rank, len(values)))

    return [ranked(cell, cell.value) if yes and cell.value is not None else cell for cell, yes in pairs]


def _is_best(rank: int, count: int) -> bool:
    return rank <= min(BOLD, count - 1)


def best(values: Sequence[float]) -> list[bool]:
    """Which values of a column are set in bold; NaN is none."""
    known = sorted(value for value in values if not math.isnan(value))
    return [value in known and _is_best(known.index(value) + 1, len(known)) for value in values]


def figures(value: float) -> str:
    """Value with three significant digits, as the published tables print them; whole numbers are not cut."""
    if value == 0:
        return "0"
    return f"{value:.{max(0, 2 - max(math.floor(math.log10(abs(value))), -1))}f}"


def cell_text(cell: Cell) -> str:
    """What stands in a cell of a plain table; a value that is not comparable carries the reason."""
    if cell.value is None:
        return cell.note
    mark = cell_mark(cell)
    return figures(cell.value) + (f" ({mark})" if mark else "")


def cell_mark(cell: Cell) -> str:
    """What a reader must know of a value: that it stands on other truth than it should, or on part of it."""
    if cell.note == LOW_INSTEAD:
        return "low"
    return cell.note or (cell.resolution if not cell.rank else "")


def sources(found: Iterable[Table]) -> list[Source]:
    """Sources of the published rows, in the order of their numbers."""
    return list(dict.fromkeys(row.source for table in found for row in table.rows if row.source))


def markdown(table: Table, numbered: Sequence[Source]) -> str:
    """The table in Markdown; the best three of a column in bold, published rows with their source."""
    head = ["method", *table.scenes, "mean"]
    lines = [
        f"### {table.label}{f' ({table.unit})' if table.unit else ''}",
        "",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
    ]
    for row in table.rows:
        name = row.method if row.origin == "measured" else f"*{row.method}* ({row.origin})"
        name += ", learned" if row.learned else ""
        name += f" [{numbered.index(row.source) + 1}]" if row.source else ""
        texts = [_markdown_cell(cell) for cell in (*row.cells, row.mean)]
        lines.append("| " + " | ".join([name, *texts]) + " |")
    return "\n".join([*lines, ""])


def _markdown_cell(cell: Cell) -> str:
    return f"**{cell_text(cell)}**" if cell.best else cell_text(cell)
