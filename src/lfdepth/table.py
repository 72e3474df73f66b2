"""Tables: columns, rows and units, as Markdown, CSV, HTML and plain text.

>>> speed = Table(
...     (Column("method"), Column("run time", "s")),
...     (Row((Cell("fbs"), Cell(1.234))), Row((Cell("fbs-sfa"), Cell(0.5, best=True)))),
... )
>>> print(speed.to_text())
method   run time (s)
fbs              1.23
fbs-sfa         0.500
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from markupsafe import Markup

Value = str | int | float | None

ABSENT = "–"
"""What stands where a table has no value."""


def figures(value: float) -> str:
    """Value with three significant digits, as the published tables print them; whole numbers are not cut.

    No digit is printed beyond the third decimal.
    """
    if not math.isfinite(value):
        return ABSENT if math.isnan(value) else str(value)
    if value == 0:
        return "0"
    return f"{value:.{max(0, 2 - max(math.floor(math.log10(abs(value))), -1))}f}"


@dataclass(frozen=True)
class Column:
    """A column: its title, the unit of its values, and whether they are words, which stand at the left."""

    title: str
    unit: str = ""
    words: bool = False

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True)
class Cell:
    """What stands in one place of a table.

    Attributes
    ----------
    value : str, int, float or None
        Floats are printed with three significant digits (`figures`).
    note : str
        What is special about the value, or why there is none.
    short : str
        The note in fewer words, for HTML, which shows all of it when it is pointed at.
    best : bool
        Whether it is set in bold.
    """

    value: Value = None
    note: str = ""
    short: str = ""
    best: bool = False

    @property
    def plain(self) -> str:
        """The value alone."""
        if self.value is None:
            return ABSENT
        return figures(self.value) if isinstance(self.value, float) else str(self.value)

    @property
    def text(self) -> str:
        """Value and note."""
        if self.value is None:
            return self.note or ABSENT
        return f"{self.plain} ({self.note})" if self.note else self.plain


@dataclass(frozen=True)
class Row:
    """A line of a table; rows of a group stand together below its name (HTML)."""

    cells: tuple[Cell, ...]
    group: str = ""

    @classmethod
    def of(cls, *values: Value) -> Row:
        """Row of bare values."""
        return cls(tuple(Cell(value) for value in values))


@dataclass(frozen=True)
class Table:
    """Columns and rows; the first column names the rows.

    Attributes
    ----------
    columns : tuple of Column
    rows : tuple of Row
        Each with a cell for every column.
    title, unit : str
        What the values are, where all are of one kind.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    title: str = ""
    unit: str = ""

    @classmethod
    def of(cls, columns: Sequence[str | Column], rows: Sequence[Sequence[Value]]) -> Table:
        """Table of bare titles and values."""
        heads = tuple(each if isinstance(each, Column) else Column(each) for each in columns)
        return cls(heads, tuple(Row.of(*row) for row in rows))

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def to_markdown(self) -> str:
        """GitHub's Markdown: the best in bold, the names of grouped rows in italics."""
        lines = [f"### {self.heading}", ""] if self.title else []
        lines.append(_markdown_line([_piped(column.heading) for column in self.columns]))
        lines.append("|" + "".join("---|" if left else "---:|" for left in self._left()))
        for row in self.rows:
            texts = [f"**{_piped(cell.text)}**" if cell.best else _piped(cell.text) for cell in row.cells]
            if row.group:
                name = row.cells[0]
                texts[0] = f"*{_piped(name.plain)}*" + (f" ({_piped(name.note)})" if name.note else "")
            lines.append(_markdown_line(texts))
        return "\n".join(lines)

    def to_csv(self) -> str:
        """Comma-separated values, floats with every digit; notes are left out, units stand in the heads."""
        lines = [[column.heading for column in self.columns]]
        lines += [[_exact(cell.value) for cell in row.cells] for row in self.rows]
        return "".join(map(_csv_line, lines))

    def to_html(self, style: str = "") -> Markup:
        """An element ``table``, of the CSS class `style`."""
        from lfdepth.templating import render

        groups = [(name, tuple(rows)) for name, rows in groupby(self.rows, key=lambda row: row.group)]
        return render("table.html", table=self, groups=groups, style=style, left=self._left())

    def to_text(self) -> str:
        """Aligned columns, two spaces apart, for a terminal."""
        lines = [[column.heading for column in self.columns]]
        lines += [[cell.text for cell in row.cells] for row in self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        aligned = [
            "  ".join(
                text.ljust(width) if left else text.rjust(width)
                for text, width, left in zip(line, widths, self._left(), strict=True)
            ).rstrip()
            for line in lines
        ]
        return "\n".join([self.heading, *aligned] if self.title else aligned)

    def _left(self) -> list[bool]:
        return [number == 0 or column.words for number, column in enumerate(self.columns)]


def _markdown_line(texts: Sequence[str]) -> str:
    return "| " + " | ".join(texts) + " |"


def _piped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _csv_line(texts: Sequence[str]) -> str:
    buffer = io.StringIO()
    # Only what the terminator consists of is quoted where it stands in a text.
    csv.writer(buffer, lineterminator="\r\n").writerow(texts)
    return buffer.getvalue().removesuffix("\r\n") + "\n"


def _exact(value: Value) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
