"""Scores in a few words, for pictures."""

from __future__ import annotations

from collections.abc import Mapping

from lfdepth.scoring.metrics import LOW
from lfdepth.table import figures


def score_line(scores: Mapping[str, float]) -> str:
    """BadPix 0.07 and MSE×100 of a map, as far as it has them, rounded as in the tables."""
    parts = (("BadPix 0.07", "badpix_0.07", " %"), ("MSE×100", "mse_x100", ""))
    return ", ".join(f"{name} {figures(scores[key])}{unit}" for name, key, unit in parts if key in scores)


def score_lines(scores: Mapping[str, float]) -> tuple[str, ...]:
    """`score_line`, and what was left out of it; nothing for a map without scores."""
    line = score_line(scores)
    return (line, f"{LOW.border} px border not scored") if line else ()
