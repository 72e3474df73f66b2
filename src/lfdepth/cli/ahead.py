"""While views are read, the kernels that a method will need are made ready."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from lfdepth import methods

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField

_GRID, _PLANES, _LARGEST = 9, 8, 96
_EXPECTED = "uint8"
_SWITCH = 0.0005  # s; readers wait for the interpreter no longer than this, ten times less than usual

_log = logging.getLogger(__name__)


class KernelsAhead:
    """A context in which the kernels of one of lfdepth's own methods are loaded, or compiled, in a thread.

    Parameters
    ----------
    method
        Method.
    engine
        Name of the engine; others than "cpu" have nothing to be made ready.
    compiling
        Called where kernels have to be compiled.
    """

    def __init__(self, method: methods.Method, engine: str, compiling: Callable[[], None]) -> None:
        self._method, self._compiling = method, compiling
        self._wanted = engine == "cpu" and method.info.name in methods.NAMES
        self._stop, self._loading, self._found = Event(), Event(), Event()
        self._thread: Thread | None = None
        self._compiled = False
        self._interval = sys.getswitchinterval()

    def __enter__(self) -> Self:
        sys.setswitchinterval(_SWITCH)
        self._start(_EXPECTED)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()
        sys.setswitchinterval(self._interval)

    def settle(self, samples: str) -> None:
        """Once the views' samples are known; waits where kernels have to be compiled."""
        if samples != _EXPECTED:
            self._end()
            self._start(samples)
        while self._thread is not None and self._thread.is_alive():
            self._thread.join(0.02)
            if self._found.is_set() and not self._compiled:  # the others are in the cache, too, as a rule
                return

    def _start(self, samples: str) -> None:
        self._stop, self._loading, self._found = Event(), Event(), Event()
        if self._wanted:
            self._thread = Thread(target=self._run, args=(samples,), daemon=True)
            self._thread.start()

    def _end(self) -> None:
        self._stop.set()
        # A thread that merely imports may end with the process; one in a compiler may not.
        if self._thread is not None and self._loading.is_set():
            self._thread.join()

    def _run(self, samples: str) -> None:
        try:
            from lfdepth.engines.cpu.ahead import Rehearsal, make_ready
            from lfdepth.engines.cpu.compilation import on_compilation

            with on_compilation(self._note), Rehearsal() as engine:
                rehearse(self._method, engine, samples)
                if not self._stop.is_set():
                    self._loading.set()
                    make_ready(engine.calls, self._stop, self._found.set)
        except Exception:  # the estimate itself will say what is wrong
            _log.debug("kernels could not be made ready", exc_info=True)

    def _note(self) -> None:
        self._compiled = True
        self._compiling()


def rehearse(method: methods.Method, engine: Any, samples: str) -> None:
    """Run a method on a tiny, black light field of such samples; not if its windows are too large for it."""
    import numpy as np

    from lfdepth.errors import LightFieldError
    from lfdepth.lightfield import LightField
    from lfdepth.trace import Trace

    side = 2 * method.halo() + 2
    if side > _LARGEST:
        return
    lf = LightField(np.zeros((_GRID, _GRID, side, side, 3), samples))
    planes = np.linspace(1.0, -1.0, _PLANES)
    with suppress(LightFieldError), np.errstate(all="ignore"):
        method.check(lf.shape)
        method.run(methods.Problem(lf, (-1.0, 1.0), planes), methods.Work(engine, Trace()))
        _look(lf, engine)


def _look(lf: LightField, engine: Any) -> None:
    """What is asked of an engine before and after a method: a first map, and windows of the views."""
    import numpy as np

    from lfdepth.probe.matching import make_probe, match, plane_range

    match(make_probe(lf, 1.0, 1, (1.0,), contrast=True), plane_range(-1.0, 1.0, 0.5), engine)
    engine.window_means(engine.views(lf), np.zeros((1, 2), np.int64), np.zeros(1), 1)
