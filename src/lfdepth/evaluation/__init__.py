"""Metrics, comparisons, the paper's experiments, submissions."""

from lfdepth.evaluation.scores import METRICS, Metric, Scores, evaluate
from lfdepth.evaluation.truth import HighResolution, read_high_resolution

__all__ = ["METRICS", "HighResolution", "Metric", "Scores", "evaluate", "read_high_resolution"]
