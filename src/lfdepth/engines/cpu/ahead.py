"""Kernels made ready before they are needed: found by a rehearsal, loaded or compiled beside other work."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterable
from importlib import import_module
from inspect import getsource
from pathlib import Path
from threading import Event, Thread
from typing import Any

from numba.core.dispatcher import Dispatcher
from numpy.typing import DTypeLike

from lfdepth.engines.base import Array
from lfdepth.engines.cpu.compilation import on_compilation
from lfdepth.engines.cpu.engine import CpuEngine
from lfdepth.engines.cpu.workers import Workers, default_threads

Call = tuple[Any, tuple[Any, ...]]
"""A kernel, and the types of its arguments."""

_MOST_HELPERS = 3
_HELP = "from lfdepth.engines.cpu.ahead import help_out; help_out()"


class Rehearsal(CpuEngine):
    """An engine that runs no kernel, but takes note of which would run, and on what types.

    Attributes
    ----------
    calls
        Kernels and types, in the order they were needed first.
    """

    def __init__(self) -> None:
        super().__init__(1)
        self.calls: list[Call] = []
        self.workers = _Notes(self.calls)

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
        """Zeros, as nothing will be put in their place."""
        return self.zeros(shape, dtype)


class _Notes(Workers):
    def __init__(self, calls: list[Call]) -> None:
        super().__init__(1)
        self._calls = calls

    def rows(self, height: int, kernel: Callable[..., Any], *args: Any, first: int = 0) -> None:
        if isinstance(kernel, Dispatcher):
            self.once(kernel, first, height, *args)
        else:
            super().rows(height, kernel, *args, first=first)

    def once(self, kernel: Callable[..., Any], *args: Any) -> None:
        noted: Any = kernel
        call = noted, tuple(noted.typeof_pyval(each) for each in args)
        if call not in self._calls:
            self._calls.append(call)


def make_ready(calls: Iterable[Call], stop: Event, ready: Callable[[], None] = lambda: None) -> None:
    """Load kernels from their cache, or compile them, several at once where there are processors for it.

    numba compiles one function at a time in a process; so other processes help, and leave theirs in the
    cache.

    Parameters
    ----------
    calls
        What is needed, most urgent first.
    stop
        Set where it is no longer needed: the kernel at work is finished.
    ready
        Called after each kernel.
    """
    waiting = deque(calls)
    crew = _Crew(waiting)
    with on_compilation(crew.start):
        try:
            while not stop.is_set() and (call := _next(waiting)):
                call[0].compile(call[1])
                ready()
            for kernel, types in crew.finish(stop):
                kernel.compile(types)
        finally:
            crew.dismiss()


class _Crew:
    """Processes that compile what waits."""

    def __init__(self, waiting: deque[Call]) -> None:
        self.started = False
        self._waiting = waiting
        self._done: list[Call] = []
        self._helpers: list[tuple[Thread, subprocess.Popen[bytes]]] = []

    def start(self) -> None:
        """Let them begin, unless they have."""
        if self.started:
            return
        self.started = True
        # The largest first, so that none is left to the end.
        largest = sorted(self._waiting, key=_size, reverse=True)
        self._waiting.clear()
        self._waiting.extend(largest)
        if not sys.executable:
            return
        home = str(Path(__file__).parents[3])
        path = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
        for _ in range(min(default_threads() - 1, _MOST_HELPERS, len(largest))):
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", _HELP],
                env={**os.environ, "PYTHONPATH": path},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            thread = Thread(target=self._keep_busy, args=(process,), daemon=True)
            self._helpers.append((thread, process))
            thread.start()

    def _keep_busy(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        while call := _next(self._waiting):
            try:
                function = call[0].py_func
                pickle.dump((function.__module__, function.__name__, call[1]), process.stdin)
                process.stdin.flush()
                answer = process.stdout.readline()
            except OSError:
                answer = b""
            if not answer:  # it has failed: this process will say why, if it fails as well
                self._waiting.append(call)
                return
            self._done.append(call)

    def finish(self, stop: Event) -> list[Call]:
        """Wait for what is under way; what the cache now has, and what is still to be done."""
        for thread, _ in self._helpers:
            while thread.is_alive() and not stop.is_set():
                thread.join(0.1)
        return [] if stop.is_set() else [*self._done, *self._waiting]

    def dismiss(self) -> None:
        """End the processes."""
        for _, process in self._helpers:
            process.kill()
        for thread, process in self._helpers:
            process.wait()
            thread.join()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def _next(waiting: deque[Call]) -> Call | None:
    try:
        return waiting.popleft()
    except IndexError:  # another thread may have taken the last one
        return None


def _size(call: Call) -> int:
    """Characters in the kernel's file, which compiling takes about as long as."""
    return len(getsource(sys.modules[call[0].py_func.__module__]))


def help_out() -> None:
    """Compile what is asked for on standard input until it ends, with a line on standard output for each."""
    while True:
        try:
            module, name, types = pickle.load(sys.stdin.buffer)
        except (EOFError, KeyboardInterrupt):
            return
        getattr(import_module(module), name).compile(types)
        sys.stdout.write("done\n")
        sys.stdout.flush()
