"""How far the work is, on standard error."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import Any

from lfdepth.engines.cpu.compilation import on_compilation


class Progress:
    """A bar over steps on a terminal, and a word when kernels are compiled.

    Attributes
    ----------
    compiled : bool
        Whether kernels had to be compiled.
    """

    def __init__(self) -> None:
        self.compiled = False
        self._bar: Any = None
        self._listening = ExitStack()

    def __enter__(self) -> Progress:
        self._listening.enter_context(on_compilation(self.note_compilation))
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.close()
        self._close_bar()

    def step(self, done: int, total: int, what: str) -> None:
        """Show the steps that are done, of those in all, and what is being done."""
        from tqdm import tqdm

        if self._bar is None:
            self._bar = tqdm(total=total, unit="step", leave=False, disable=None)
        self._bar.set_description_str(what, refresh=False)
        self._bar.update(done - self._bar.n)
        self._bar.refresh()
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
            self._bar.close()
        self._bar = None
