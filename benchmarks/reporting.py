"""What the benchmarks share: Markdown tables, JSON, and a line about the machine."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Cell = str | float | int | None


def markdown(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A Markdown table: the first column to the left, the others to the right, None as a dash."""
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    lines += ["| " + " | ".join(_text(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.0f}" if abs(cell) >= 1000 else f"{cell:.3g}" if abs(cell) < 10 else f"{cell:.1f}"
    return str(cell)


def machine() -> dict[str, Any]:
    """Processor, number of processors this process may use, load at this moment, versions."""
    import numba
    import numpy

    from lfdepth.engines.cpu.workers import default_threads

    return {
        "processor": _processor(),
        "processors": default_threads(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
    }


def _processor() -> str:
    file = Path("/proc/cpuinfo")
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


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
