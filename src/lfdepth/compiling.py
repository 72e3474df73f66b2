"""Options under which kernels are compiled."""

from __future__ import annotations

from typing import Any

KERNEL: dict[str, Any] = {"nogil": True, "cache": True, "no_cfunc_wrapper": True}
"""Of functions that Python calls."""

INNER: dict[str, Any] = {**KERNEL, "no_cpython_wrapper": True}
"""Of functions that only kernels call: without a wrapper for Python they compile faster."""
