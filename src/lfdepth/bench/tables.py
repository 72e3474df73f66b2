"""Tables of a bench: methods × scenes for each metric, with published rows beside the measured ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Literal

from lfdepth.bench.published import PublishedRow, Source, published_rows
from lfdepth.bench.results import Bench, SceneResult
from lfdepth.scoring.metrics import mean_over_scenes
from lfdepth.scoring.scores import LOW_INSTEAD, METRICS, label_of
from lfdepth.table import ABSENT, Cell, Column, Row, Table

BOLD = 3
"""How many of the best are set in bold, as the paper does; never the last of a column."""

LEGEND = (
    "Lower is better; the best three of each column are bold, but never the last. Rows marked *published* "
    "were not run here; their values are ranked only if they were scored on truth of the same resolution. "
    "(low) or (high): scored on truth of that resolution, while the others, or the benchmark, use the other. "
    "Run times of published rows come from other machines."
)
"""What a reader must know, in Markdown."""

_LOG = "runtime_log10"
_TIMES = ("runtime", _LOG)
_SHORTEST = 1e-6  # s; a shorter run time has this logarithm


@dataclass(frozen=True)
class Score:
    """One value of a metric's table.

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

    @property
    def cell(self) -> Cell:
        """As it is shown: a value that stands on other truth than it should, or on part of it, says so."""
        if self.value is None:
            return Cell(None, self.note, "no mask" if self.note.startswith("no mask") else "")
        if self.note == LOW_INSTEAD:
            return Cell(self.value, "low", best=self.best)
        return Cell(self.value, self.note or (self.resolution if not self.rank else ""), best=self.best)


@dataclass(frozen=True)
class MethodRow:
    """A method: its scores by scene, and its mean over them."""

    method: str
    origin: Literal["measured", "external", "published"]
    cells: tuple[Score, ...]
    mean: Score
    source: Source | None = None
    device: str = ""
    learned: bool = False

    def row(self, numbered: Sequence[Source], *, device: bool) -> Row:
        """As it is shown, with the number of its source, and the device if that matters."""
        remarks = [
            *(["learned"] if self.learned else []),
            *([self.device] if self.device and device else []),
            *([f"[{numbered.index(self.source) + 1}]"] if self.source in numbered else []),
        ]
        note = ", ".join([*([] if self.origin == "measured" else [self.origin]), *remarks])
        published = self.origin == "published"
        name = Cell(self.method, note, " ".join(remarks) if published else "")
        return Row((name, *(each.cell for each in (*self.cells, self.mean))), PUBLISHED if published else "")


PUBLISHED = "published, not run here"
"""Name of the group of the published rows."""


@dataclass(frozen=True)
class MetricTable:
    """A metric of all methods on all scenes."""

    key: str
    label: str
    unit: str
    scenes: tuple[str, ...]
    rows: tuple[MethodRow, ...]

    @property
    def is_time(self) -> bool:
        """Whether it is one of the run times."""
        return self.key in _TIMES

    def table(self, numbered: Sequence[Source] = ()) -> Table:
        """As it is shown, published rows with the number of their source."""
        columns = tuple(Column(name) for name in ("method", *self.scenes, "mean"))
        rows = tuple(row.row(numbered, device=self.is_time) for row in self.rows)
        return Table(columns, rows, self.label, self.unit)


def tables(result: Bench, *, published: bool = True) -> tuple[MetricTable, ...]:
    """A table for each metric that a scene has, in the order of `METRICS`, and two of the run times.

    Published rows stand in the tables of the metrics that they have for one of the scenes. A column is ranked
    among the values that were taken on truth of the same resolution as the measured ones; a mean is ranked if
    it is over all scenes.
    """
    units = {metric.key: metric.unit for metric in METRICS} | {"runtime": "s", _LOG: "log10 s"}
    return tuple(
        MetricTable(
            key,
            label_of(key.removesuffix("_log10")),
            unit,
            tuple(scene.name for scene in result.scenes),
            rows,
        )
        for key, unit in units.items()
        if (rows := _rows(result, key, published))
    )


def _rows(result: Bench, key: str, published: bool) -> tuple[MethodRow, ...]:
    own = [
        MethodRow(name, origin, tuple(_cell(scene, name, key) for scene in result.scenes), Score())
        for name, origin in result.methods.items()
    ]
    # Scenes that have the metric: where none of our rows has a value, truth or mask is missing.
    scored = [any(row.cells[i].value is not None for row in own) for i in range(len(result.scenes))]
    if not any(scored):
        return ()
    others = list(_published(result, key, scored)) if published else []
    return _ranked([_with_mean(row, scored) for row in own], others, scored)


def _cell(scene: SceneResult, method: str, key: str) -> Score:
    entry = scene.entries.get(method)
    if entry is None:
        return Score(note="failed")
    if key in _TIMES:
        seconds = entry.found.runtime
        return Score(note="no run time") if seconds is None else Score(_scaled(key, seconds))
    if entry.scores is None:
        return Score(note="no truth")
    if key not in entry.scores:
        return Score(note=entry.scores.missing.get(key, ABSENT))
    return Score(entry.scores[key], entry.scores.notes.get(key, ""), entry.scores.resolution[key])


def _scaled(key: str, seconds: float) -> float:
    return math.log10(max(seconds, _SHORTEST)) if key == _LOG else float(seconds)


def _published(result: Bench, key: str, scored: Sequence[bool]) -> Iterator[MethodRow]:
    for row in published_rows():
        cells = tuple(_published_cell(row, scene.name, key) for scene in result.scenes)
        made = MethodRow(row.method, "published", cells, Score(), row.source, row.device, row.learned)
        if key in _TIMES and row.runtime is not None:
            yield replace(made, mean=Score(_scaled(key, row.runtime), "on the authors' machine"))
        elif any(cell.value is not None for cell in cells):
            # A mean over some of the scenes would stand beside means over all of them.
            whole = all(cell.value is not None for cell in compress(cells, scored))
            yield _with_mean(made, scored) if whole else replace(made, mean=Score(note=ABSENT))


def _published_cell(row: PublishedRow, scene: str, key: str) -> Score:
    value = row.scores.get(key, {}).get(scene)
    return Score(note=ABSENT) if value is None else Score(float(value), "", row.resolution(scene))


def _with_mean(row: MethodRow, scored: Sequence[bool]) -> MethodRow:
    """The row with its mean over the scenes that have the metric; it says if a method lacks some of them."""
    known = [cell for cell in compress(row.cells, scored) if cell.value is not None]
    mean = mean_over_scenes([cell.value for cell in known])
    if math.isnan(mean):
        return replace(row, mean=Score(note="no scene"))
    resolutions = {cell.resolution for cell in known}
    part = "" if len(known) == sum(scored) else f"{len(known)} of {sum(scored)} scenes"
    return replace(row, mean=Score(mean, part, resolutions.pop() if len(resolutions) == 1 else "mixed"))


def _ranked(
    own: Sequence[MethodRow], others: Sequence[MethodRow], scored: Sequence[bool]
) -> tuple[MethodRow, ...]:
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


def _rank_column(cells: Sequence[Score], own: int) -> list[Score]:
    resolution = next((cell.resolution for cell in cells[:own] if cell.value is not None), "")
    return _rank(cells, [cell.value is not None and cell.resolution == resolution for cell in cells])


def _rank(cells: Sequence[Score], comparable: Sequence[bool]) -> list[Score]:
    pairs = list(zip(cells, comparable, strict=True))
    values = sorted(cell.value for cell, yes in pairs if yes and cell.value is not None)

    def ranked(cell: Score, value: float) -> Score:
        rank = values.index(value) + 1
        return replace(cell, rank=rank, best=_is_best(rank, len(values)))

    return [ranked(cell, cell.value) if yes and cell.value is not None else cell for cell, yes in pairs]


def _is_best(rank: int, count: int) -> bool:
    return rank <= min(BOLD, count - 1)


def best(values: Sequence[float]) -> list[bool]:
    """Which values of a column are set in bold; NaN is none."""
    known = sorted(value for value in values if not math.isnan(value))
    return [value in known and _is_best(known.index(value) + 1, len(known)) for value in values]


def sources(found: Iterable[MetricTable]) -> list[Source]:
    """Sources of the published rows, in the order of their numbers."""
    return list(dict.fromkeys(row.source for table in found for row in table.rows if row.source))


def means(found: Sequence[MetricTable]) -> Table:
    """The means of the methods that were run or given, over all scenes, in one table."""
    # Rows of our own come first, in the same order in every table.
    own = [number for number, row in enumerate(found[0].rows) if row.origin != "published"]
    return Table(
        (Column("method"), *(Column(table.label, table.unit) for table in found)),
        tuple(
            Row(
                (found[0].rows[n].row((), device=False).cells[0], *(each.rows[n].mean.cell for each in found))
            )
            for n in own
        ),
        "Means over the scenes",
    )


def long_table(found: Iterable[MetricTable]) -> Table:
    """All values in one table, a line per method, scene and metric."""
    heads = ("metric", "unit", "method", "origin", "scene", "value", "truth", "note")
    return Table.of(
        heads,
        [
            (table.key, table.unit, row.method, row.origin, scene, score.value, score.resolution, score.note)
            for table in found
            for row in table.rows
            for scene, score in zip((*table.scenes, "mean"), (*row.cells, row.mean), strict=True)
        ],
    )
