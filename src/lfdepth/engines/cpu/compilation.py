"""How kernels are compiled, and when: it takes seconds once, and is to be told apart from the work."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

KERNEL: dict[str, Any] = {"nogil": True, "cache": True, "no_cfunc_wrapper": True}
"""Options of functions that Python calls."""

INNER: dict[str, Any] = {**KERNEL, "no_cpython_wrapper": True}
"""Of functions that only kernels call: without a wrapper for Python they compile faster."""


def on_compilation(act: Callable[[], None]) -> AbstractContextManager[Any]:
    """While the context is open, act whenever numba compiles because its cache has nothing."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, event: Any) -> None:
            act()

        def on_end(self, event: Any) -> None:
            pass

    context: AbstractContextManager[Any] = event.install_listener("numba:compile", Listener())
    return context
