"""Metrics, comparisons, the paper's experiments, submissions."""

from lfdepth.scoring.scores import METRICS, Metric, Scores, evaluate
from lfdepth.scoring.truth import HighResolution, read_high_resolution

__all__ = ["METRICS", "HighResolution", "Metric", "Scores", "evaluate", "read_high_resolution"]
