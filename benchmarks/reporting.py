"""What the benchmarks share: Markdown tables, JSON, and a line about the machine."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lfdepth.bench.timing import load, processor
from lfdepth.table import Table, Value

Cell = Value


def markdown(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A Markdown table: the first column to the left, the others to the right, None as a dash."""
    return Table.of(header, rows).to_markdown()


def machine() -> dict[str, Any]:
    """Processor, number of processors this process may use, load at this moment, versions."""
    import numba
    import numpy

    from lfdepth.engines.cpu.workers import default_threads

    return {
        "processor": processor(),
        "processors": default_threads(),
        "load": load(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
    }


def machine_line() -> str:
    """`machine` in words."""
    found = machine()
    load = "" if found["load"] is None else f", load {found['load']:.1f} when this began to print"
    return (
        f"{found['processor']}, {found['processors']} processors{load}; Python {found['python']}, "
        f"NumPy {found['numpy']}, Numba {found['numba']}"
    )


def write_json(file: Path | None, found: Mapping[str, Any]) -> None:
    """Write the figures with the machine they come from, if a file is wanted."""
    if file is not None:
        text = json.dumps({"machine": machine(), **found}, indent=2, ensure_ascii=False)
        file.write_text(text + "\n", encoding="utf-8")
