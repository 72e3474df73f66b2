"""Kernels: functions over rows of an image, compiled by numba; only the engine calls them.

All of them are declared here, so that all are kept where `compilation.kernel_cache` says.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from lfdepth.engines.cpu.compilation import kernel_cache

with kernel_cache():
    for _module in iter_modules(__path__):
        import_module(f"{__name__}.{_module.name}")
