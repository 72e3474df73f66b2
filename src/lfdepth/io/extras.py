"""Libraries that only some formats need."""

from __future__ import annotations

import logging
from importlib import import_module
from pathlib import Path
from typing import Any

from lfdepth.errors import LightFieldError


def need_tifffile(path: Path) -> Any:
    """Import tifffile, whose complaints about damaged files must not reach the screen beside ours."""
    tifffile = need("tifffile", "tiff", path)
    logging.getLogger("tifffile").addHandler(logging.NullHandler())
    return tifffile


def need(module: str, extra: str, path: Path) -> Any:
    """Import an optional library.

    Raises
    ------
    LightFieldError
        If it is not installed; names the extra that brings it.
    """
    try:
        return import_module(module)
    except ImportError:
        raise LightFieldError(
            f"{path}: needs the package {module.partition('.')[0]}, which is not installed; expected the "
            "extra "
            f'{extra!r}; run: pip install "lfdepth[{extra}]"'
        ) from None
