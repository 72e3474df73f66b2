"""Ctrl-C, which must not be lost.

Python raises KeyboardInterrupt wherever the main thread happens to be. Where that is a finalizer, a callback
of a weak reference (imports have them) or one that a C library calls (compilers, readers), Python prints the
exception and goes on as if nothing had been asked; and some libraries catch all that is raised.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from types import FrameType, TracebackType
from typing import Any, Self

_AGAIN = 0.05  # s; after this, whatever swallowed the interrupt has returned


class Interrupts:
    """A context in which Ctrl-C is taken note of, and sent again where it was raised in vain.

    Attributes
    ----------
    wanted : bool
        Whether Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.wanted = False
        self._open = False
        self._hook: Any = None

    def __enter__(self) -> Self:
        # Elsewhere signals are not handled; and whoever handles them otherwise, or ignores them, has reasons.
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._open, self._hook = True, sys.unraisablehook
            sys.unraisablehook = self._lost
            signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self._open = False
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.unraisablehook = self._hook

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self.wanted = True
        raise KeyboardInterrupt

    def _lost(self, what: Any) -> None:
        """Send it again, from a thread: raised here and now it would be lost in the same place."""
        if not issubclass(what.exc_type, KeyboardInterrupt):
            self._hook(what)
            return
        _thread.start_new_thread(self._send, ())  # which takes no lock that the main thread may hold here

    def _send(self) -> None:
        time.sleep(_AGAIN)
        if self._open:
            if hasattr(signal, "pthread_kill"):  # wakes the main thread where it waits, too
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
            else:
                signal.raise_signal(signal.SIGINT)
