"""Runs of the command line as processes of their own, with what they took."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LFDEPTH = [sys.executable, "-c", "import sys; from lfdepth.cli import main; sys.exit(main())"]
"""The command `lfdepth` of the interpreter that runs the benchmark."""


@dataclass(frozen=True)
class Run:
    """Seconds on the wall, seconds of computing, peak memory in MB (10⁶ bytes), standard output."""

    seconds: float
    cpu: float
    peak: float
    output: str

    def json(self) -> Any:
        """Standard output, parsed."""
        return json.loads(self.output)


def run(command: Sequence[str], cache: Path | None = None) -> Run:
    """Run a command and wait for it; `cache` is where it keeps compiled kernels, None where it always does.

    A process starts with the peak of the one that starts it, so keep the benchmark's own memory small.
    """
    environment: Mapping[str, str] = {**os.environ, **({"NUMBA_CACHE_DIR": str(cache)} if cache else {})}
    with tempfile.TemporaryFile("w+") as output:
        began = time.perf_counter()
        process = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"exit status {process.returncode} from {' '.join(command)}")
        output.seek(0)
        unit = 1 if sys.platform == "darwin" else 1024
        computing = usage.ru_utime + usage.ru_stime
        return Run(seconds, computing, usage.ru_maxrss * unit / 1e6, output.read())


def render(scene: str, size: int, folder: Path) -> Path:
    """Render a procedural scene as a folder of the benchmark's layout."""
    run([*LFDEPTH, "scenes", "render", scene, "-o", str(folder), "--size", str(size)])
    return folder / scene


def methods() -> list[str]:
    """Names of the registered methods."""
    return [method["name"] for method in run([*LFDEPTH, "methods", "--json"]).json()["methods"]]
