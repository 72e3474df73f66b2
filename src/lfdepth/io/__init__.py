"""Reading light fields, writing and reading back results."""

from __future__ import annotations

from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io import benchmark
from lfdepth.io.source import assemble
from lfdepth.lightfield import LightField

__all__ = ["read"]


def read(path: str | Path) -> LightField:
    """Read a light field.

    Parameters
    ----------
    path : str or Path
        A folder of the 4D Light Field Benchmark.

    Raises
    ------
    LightFieldError
        If the path does not exist, is no light field, or is damaged.
    """
    path = Path(path)
    if not path.exists():
        raise LightFieldError(f"{path}: no such file or folder; expected a light field; check the path")
    if not benchmark.recognise(path):
        raise LightFieldError(
            f"{path}: not recognised as a light field; expected a folder with input_Cam000.png and so on; "
            "check the path"
        )
    return assemble(benchmark.open_benchmark(path))
