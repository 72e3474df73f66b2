"""Tables: the same cells in four forms, numbers with three significant digits, nothing lost or misread."""

import csv
import doctest
import io
import math
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lfdepth import table
from lfdepth.table import Cell, Column, Row, Table, figures

SHOWN = Table(
    (Column("method"), Column("error", "%"), Column("kind", words=True)),
    (
        Row((Cell("<b>|x"), Cell(12.345, "low", best=True), Cell("own"))),
        Row(
            (Cell("SPO", "published, [1]", "[1]"), Cell(None, "no mask 'fine'", "no mask"), Cell("other")),
            "else",
        ),
        Row((Cell("CAE", "published"), Cell(), Cell()), "else"),
    ),
    "BadPix",
    "%",
)


def test_markdown_has_bold_bests_italic_groups_and_escaped_bars() -> None:
    assert SHOWN.to_markdown().splitlines() == [
        "### BadPix (%)",
        "",
        "| method | error (%) | kind |",
        "|---|---:|---|",
        "| <b>\\|x | **12.3 (low)** | own |",
        "| *SPO* (published, [1]) | no mask 'fine' | other |",
        "| *CAE* (published) | – | – |",
    ]


def test_text_is_aligned() -> None:
    lines = SHOWN.to_text().splitlines()
    assert lines[0] == "BadPix (%)"
    assert (
        len({line.index(word) for line, word in zip(lines[1:4], ("kind", "own", "other"), strict=True)}) == 1
    )
    assert all(line == line.rstrip() for line in lines)
    assert lines[2].split() == ["<b>|x", "12.3", "(low)", "own"]


def test_html_is_escaped_and_groups_its_rows() -> None:
    tree = ElementTree.fromstring(str(SHOWN.to_html("wide")))
    assert tree.get("class") == "wide"
    bodies = tree.findall("tbody")
    assert [body.get("class") for body in bodies] == [None, "group"]
    assert ["".join(each.itertext()) for each in bodies[0].find("tr") or ()] == ["<b>|x", "12.3 low", "own"]
    assert bodies[0].find("tr/td/b") is not None
    band, spo, _ = bodies[1].findall("tr")
    assert ["".join(each.itertext()) for each in band] == ["else"]
    assert ["".join(each.itertext()) for each in spo] == ["SPO [1]", "no mask", "other"]
    assert spo[1].get("title") == "no mask 'fine'"


@given(st.lists(st.tuples(st.text(), st.one_of(st.none(), st.floats(allow_nan=False)))))
def test_csv_keeps_every_digit_and_every_name(rows: list[tuple[str, float | None]]) -> None:
    text = Table.of(("name", Column("value", "px")), rows).to_csv()
    head, *lines = csv.reader(io.StringIO(text, newline=""))
    assert head == ["name", "value (px)"]
    assert [(name, float(value) if value else None) for name, value in lines] == rows


@given(st.floats(min_value=1e-3, max_value=1e6), st.sampled_from([1, -1]))
def test_figures_are_right_to_half_of_the_last_digit(size: float, sign: int) -> None:
    text = figures(sign * size)
    digits = len(text.partition(".")[2])
    assert abs(float(text) - sign * size) <= 0.5000001 * 10.0**-digits
    assert digits <= 3
    assert digits == 3 or size >= 0.99 or float(text) == sign * size


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((12.34, "12.3"), (2.594, "2.59"), (0.0434, "0.043"), (110.0, "110"), (0.0, "0")),
        *((-2.0, "-2.00"), (math.nan, "–"), (math.inf, "inf")),
    ],
)
def test_values_are_printed_as_in_the_published_tables(value: float, text: str) -> None:
    assert figures(value) == text


def test_the_example_runs() -> None:
    found = doctest.testmod(table)
    assert found.attempted
    assert not found.failed
