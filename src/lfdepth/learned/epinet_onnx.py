"""EPINET as an ONNX file."""

from __future__ import annotations

import numpy as np

from lfdepth.learned.forward import folded
from lfdepth.learned.onnx_file import Graph
from lfdepth.learned.shape import EpinetShape, Weights


def epinet_onnx(shape: EpinetShape, weights: Weights) -> bytes:
    """An ONNX file: stacks (4, views, H, W), grey in 0..1, to disparity (H - lost, W - lost)."""
    arrays = folded(shape, weights)
    graph = Graph("stacks", (4, shape.views, "height", "width"))

    def layer(name: str, x: str) -> str:
        weight, bias = (graph.array(arrays[f"{name}.{part}"]) for part in ("weight", "bias"))
        return graph.node("Conv", x, weight, bias, kernel_shape=[2, 2])

    def block(name: str, x: str) -> str:
        for part in ("first", "second"):
            x = graph.node("Relu", layer(f"{name}.{part}", x))
        return x

    streams = graph.nodes("Split", 4, "stacks", axis=0)
    for i in range(4):
        for k in range(shape.stream_blocks):
            streams[i] = block(f"stream{i}.{k}", streams[i])
    x = graph.node("Concat", *streams, axis=1)
    for k in range(shape.merged_blocks):
        x = block(f"merged.{k}", x)
    x = layer("last.second", graph.node("Relu", layer("last.first", x)))
    x = graph.node("Squeeze", x, graph.array(np.array([0, 1])))
    return graph.model(x, ("rows", "columns"))
