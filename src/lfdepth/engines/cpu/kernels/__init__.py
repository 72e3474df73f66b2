"""Kernels: functions over rows of an image, compiled by numba; only the engine calls them.

All of them are declared here, so that all are kept where `compilation.kernel_cache` says; those that render
scenes when they are first asked for.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from lfdepth.engines.cpu.compilation import kernel_cache

_LATER = "scenes"


def __getattr__(name: str) -> Any:
    if name != _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with kernel_cache():
        return import_module(f"{__name__}.{name}")


with kernel_cache():
    for _module in iter_modules(__path__):
        if _module.name != _LATER:
            import_module(f"{__name__}.{_module.name}")
