"""Estimates that the page asks for, one at a time, in a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.methods import method as named_method
from lfdepth.methods import method_class, parameters_of

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField
    from lfdepth.methods import Method
    from lfdepth.result import Result


class _CancelledError(Exception):
    """Somebody changed their mind."""


class Runs:
    """Runs methods on one light field for whoever asks.

    Parameters
    ----------
    lf
        Light field.
    finished
        Called with each result, and returns the number of its map.
    threads
        Number of threads.
    """

    def __init__(
        self, lf: LightField, finished: Callable[[Result], int], *, threads: int | None = None
    ) -> None:
        self._lf, self._finished, self._threads = lf, finished, threads
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: dict[str, Any] = {"running": False}

    def start(self, wanted: Any) -> dict[str, Any]:
        """Start a run: {"method": name, "options": {...}, "range": [min, max] or null}.

        Raises
        ------
        LightFieldError
            If a run is going on, or the method or a parameter is not known, or out of range.
        """
        chosen, ends = self._parsed(wanted)
        with self._lock:
            if self._state["running"]:
                raise LightFieldError("run: one is going on; expected none; wait for it or stop it")
            self._stop.clear()
            self._state = {"running": True, "done": 0, "total": 0, "what": "preparing", "method": chosen.name}
            self._thread = threading.Thread(target=self._run, args=(chosen, ends), daemon=True)
            self._thread.start()
        return self.state()

    def state(self) -> dict[str, Any]:
        """How far the run is, and when it is over its map's number, or what was wrong."""
        with self._lock:
            return dict(self._state)

    def cancel(self) -> None:
        """Stop the run at its next step."""
        self._stop.set()

    def join(self) -> None:
        """Wait for the run to end."""
        if self._thread is not None:
            self._thread.join()

    def _parsed(self, wanted: Any) -> tuple[Method, tuple[float, float] | None]:
        if not isinstance(wanted, dict) or not isinstance(wanted.get("method"), str):
            raise LightFieldError("run: found no method; expected its name; choose one")
        known = parameters_of(method_class(wanted["method"]))
        given = wanted.get("options") or {}
        unknown = [name for name in given if name not in known]
        if unknown:
            raise LightFieldError(
                f"{unknown[0]}: method {wanted['method']} has no such parameter; expected one of "
                f"{', '.join(known)}; choose one of these"
            )
        options = {name: known[name].parse(str(value)) for name, value in given.items()}
        ends = wanted.get("range")
        if ends is None:
            return named_method(wanted["method"], **options), None
        try:
            low, high = (float(end) for end in ends)
        except (TypeError, ValueError):
            raise LightFieldError(
                f"range: found {ends!r}, expected two numbers in px per view step; give both ends"
            ) from None
        return named_method(wanted["method"], **options), (low, high)

    def _run(self, chosen: Method, ends: tuple[float, float] | None) -> None:
        try:
            result = estimate(self._lf, chosen, range=ends, threads=self._threads, progress=self._progress)
            number = self._finished(result)
            self._end(map=number)
        except _CancelledError:
            self._end(cancelled=True)
        except LightFieldError as error:
            self._end(error=str(error))
        except Exception as error:  # the page has to hear of it; a thread's traceback goes unread
            self._end(error=f"{type(error).__name__}: {error}")
            raise

    def _progress(self, done: int, total: int, what: str) -> None:
        if self._stop.is_set():
            raise _CancelledError
        with self._lock:
            self._state.update(done=done, total=total, what=what)

    def _end(self, **outcome: Any) -> None:
        with self._lock:
            self._state = {"running": False, **outcome}
