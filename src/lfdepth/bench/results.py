"""The results of a bench as data: what the runner makes, and tables and reports read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from lfdepth.errors import LightFieldError
from lfdepth.scoring.metrics import Array
from lfdepth.scoring.scores import Scores

if TYPE_CHECKING:
    from lfdepth.bench.plan import Setting

Origin = Literal["measured", "external"]


@dataclass(frozen=True, eq=False)
class Found:
    """A disparity map (H, W), its confidence, and the run time in s, where they are known."""

    disparity: Array
    confidence: Array | None = None
    runtime: float | None = None


@dataclass(frozen=True)
class Failure:
    """A scene, or a method on a scene, that gave no result."""

    scene: str
    method: str | None
    message: str

    def __str__(self) -> str:
        return " / ".join(filter(None, [self.scene, self.method])) + f": {self.message}"


@dataclass(frozen=True, eq=False)
class Entry:
    """The result of one method on one scene; `scores` is None without truth."""

    found: Found
    scores: Scores | None


@dataclass(frozen=True, eq=False)
class SceneResult:
    """One scene and every method's result on it, by the method's name.

    `grid` is the number of views (V, U); `high` tells whether there was high-resolution truth.
    """

    name: str
    reference: Array
    truth: Array | None
    range: tuple[float, float] | None
    entries: Mapping[str, Entry]
    grid: tuple[int, int] = (0, 0)
    high: bool = False


@dataclass(frozen=True, eq=False)
class Bench:
    """All results.

    Attributes
    ----------
    scenes : tuple of SceneResult
        Those that could be read.
    methods : mapping of str to {"measured", "external"}
        Names in the order of the tables.
    settings : tuple of Setting
        What the measured ones are.
    failures : tuple of Failure
        What went wrong, in the order it did.
    """

    scenes: tuple[SceneResult, ...]
    methods: Mapping[str, Origin]
    settings: tuple[Setting, ...] = ()
    failures: tuple[Failure, ...] = ()


def one_line(error: Exception) -> str:
    """Message of an error that a user can act on; others keep the name of their kind and are cut short."""
    text = " ".join(str(error).split())
    return text if isinstance(error, LightFieldError) else f"{type(error).__name__}: {text[:200]}"
