"""Published scores of other methods, as data with their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from lfdepth.scoring.scores import HIGH_RESOLUTION_SCENES


@dataclass(frozen=True)
class Source:
    """Where a row was published."""

    title: str
    reference: str


@dataclass(frozen=True, eq=False)
class PublishedRow:
    """Published scores of one method.

    Attributes
    ----------
    method : str
    source : Source
    learned : bool
        Whether it was trained.
    truth : {"benchmark", "low"}
        "benchmark": scored on high-resolution truth in `HIGH_RESOLUTION_SCENES`, on low elsewhere; "low": on
        low-resolution truth everywhere.
    scores : mapping of str to mapping of str to float
        By metric key, then scene.
    averages : mapping of str to float
        By metric key, over the benchmark's twelve scenes, as published.
    runtime : float or None
        Seconds a scene, on the authors' machine.
    device : str
        "GPU" where it was one.
    seconds_per_plane : float or None
    """

    method: str
    source: Source
    learned: bool
    truth: Literal["benchmark", "low"]
    scores: Mapping[str, Mapping[str, float]]
    averages: Mapping[str, float]
    runtime: float | None = None
    device: str = ""
    seconds_per_plane: float | None = None

    def resolution(self, scene: str) -> str:
        """Resolution of the truth behind BadPix, MSE and Q25 of a scene."""
        return "high" if self.truth == "benchmark" and scene in HIGH_RESOLUTION_SCENES else "low"


@cache
def published_rows() -> tuple[PublishedRow, ...]:
    """All published rows that come with the package (`published.toml`)."""
    import tomllib

    data = tomllib.loads((files("lfdepth.bench") / "published.toml").read_text(encoding="utf-8"))
    sources = {key: Source(**source) for key, source in data["sources"].items()}
    return tuple(_row(row, sources) for row in data["rows"])


def _row(row: dict[str, Any], sources: Mapping[str, Source]) -> PublishedRow:
    return PublishedRow(**{"scores": {}, "averages": {}} | row | {"source": sources[row["source"]]})
