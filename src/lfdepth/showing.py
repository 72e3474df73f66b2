"""How things show themselves in notebooks; what draws them stands far above them, and provides itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_SHOWS: dict[str, Callable[[Any], Any]] = {}


def provide(name: str, draw: Callable[[Any], Any]) -> None:
    """Say what draws things of a kind."""
    _SHOWS[name] = draw


def show(name: str, thing: Any) -> Any:
    """What a notebook shows of a thing."""
    return _SHOWS[name](thing)
