"""Metrics of a disparity map against the truth: each one, all of them at once, and captions."""

from lfdepth.io.benchmark import read_high_resolution
from lfdepth.scoring.scores import METRICS, Metric, Scores, evaluate
from lfdepth.truth import HighResolution

__all__ = ["METRICS", "HighResolution", "Metric", "Scores", "evaluate", "read_high_resolution"]
