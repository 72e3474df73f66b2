"""How far the work is, on standard error."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from lfdepth.engines.cpu.compilation import on_compilation

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


class Progress:
    """A bar over steps on a terminal, and a word when kernels are compiled.

    Attributes
    ----------
    compiled : bool
        Whether kernels had to be compiled.
    """

    def __init__(self) -> None:
        self.compiled = False
        self._bar: Bar | None = None
        self._task: Any = None
        self._listening = ExitStack()

    def __enter__(self) -> Progress:
        self._listening.enter_context(on_compilation(self.note_compilation))
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.close()
        self._close_bar()

    def step(self, done: int, total: int, what: str) -> None:
        """Show the steps that are done, of those in all, and what is being done."""
        if not sys.stderr.isatty():
            return
        if self._bar is None:
            self._bar = _bar()
            self._bar.start()
            self._task = self._bar.add_task(what, total=total)
        self._bar.update(self._task, completed=done, total=total, description=what)
        if done == total:
            self._close_bar()

    def announce(self, words: str) -> None:
        """Say what comes next, for people who watch."""
        if sys.stderr.isatty():
            print(words, file=sys.stderr)

    def note_compilation(self) -> None:
        """Say once that kernels are being compiled."""
        if not self.compiled:
            print("compiling kernels (first run only)", file=sys.stderr)
        self.compiled = True

    def _close_bar(self) -> None:
        if self._bar is not None:
            self._bar.stop()
        self._bar = None


def _bar() -> Bar:
    """A bar that leaves nothing behind when it ends."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Bar(*columns, console=Console(stderr=True), transient=True)
