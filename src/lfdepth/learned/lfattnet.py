"""What LFAttNet looks like, and its ONNX file (Tsai, Liu, Ouhyoung and Chuang, AAAI 2020)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lfdepth.learned.onnx_file import Graph
from lfdepth.learned.shape import EPSILON, Weights

VIEWS, FEATURES = 9, 4
"""Views along an axis, and features of a view."""
PLANES = tuple(range(-4, 5))
"""Disparities of the volume, px per view step."""
POOLS = (2, 4, 8, 16)
"""Sides of the windows over which features are pooled, px."""
SMALLEST = max(POOLS)
"""Views are a multiple of this high and wide."""
CHANNELS = 150
"""Of the volume's convolutions."""
STAGES = ((4, 4, 2, 1), (4, 8, 8, 1), (8, 16, 2, 1), (16, 16, 2, 2))
"""Channels in and out, blocks and dilation of the stages of residual blocks."""
HIDDEN, WEIGHTS = 170, 15
"""Neurons of the attention, and different weights of views."""
_REACH = VIEWS // 2


def mirrored() -> list[int]:
    """Which of the attention's weights each view takes, row by row.

    Views that are mirror images of each other, in either axis or the diagonal, share one.
    """
    pairs: dict[tuple[int, int], int] = {}
    for i in range(_REACH + 1):
        for j in range(i + 1):
            pairs[i, j] = pairs[j, i] = len(set(pairs.values()))
    offsets = range(-_REACH, _REACH + 1)
    return [pairs[_REACH - abs(v), _REACH - abs(u)] for v in offsets for u in offsets]


def _convolutions() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Names and shapes of convolutions with batch normalisation."""
    yield "features.first", (4, 1, 3, 3)
    yield "features.second", (4, 4, 3, 3)
    for i, (inside, outside, blocks, _) in enumerate(STAGES):
        for k in range(blocks):
            first = inside if k == 0 else outside
            yield f"features.stages.{i}.{k}.first", (outside, first, 3, 3)
            yield f"features.stages.{i}.{k}.second", (outside, outside, 3, 3)
            if k == 0 and outside != 4:
                yield f"features.stages.{i}.{k}.skip", (outside, first, 1, 1)
    for i in range(len(POOLS)):
        yield f"features.pools.{i}", (4, 16, 1, 1)
    yield "features.joined", (16, 8 + 16 + 4 * len(POOLS), 3, 3)
    yield "begin.0", (CHANNELS, VIEWS * VIEWS * FEATURES, 3, 3, 3)
    for name in ("begin.1", *(f"middle.{i}.{part}" for i in range(2) for part in ("first", "second")), "end"):
        yield name, (CHANNELS, CHANNELS, 3, 3, 3)


def lfattnet_arrays() -> dict[str, tuple[int, ...]]:
    """Shapes of all weights by name."""
    found: dict[str, tuple[int, ...]] = {}
    for name, size in _convolutions():
        found[f"{name}.0.weight"] = size
        for part in ("weight", "bias", "running_mean", "running_var"):
            found[f"{name}.1.{part}"] = size[:1]
    found["features.last.weight"] = (FEATURES, 16, 1, 1)
    channels = VIEWS * VIEWS * FEATURES
    found |= {"attention.first.weight": (HIDDEN, channels), "attention.first.bias": (HIDDEN,)}
    found |= {"attention.second.weight": (WEIGHTS, HIDDEN), "attention.second.bias": (WEIGHTS,)}
    return found | {"last.weight": (1, CHANNELS, 3, 3, 3)}


class _Builder:
    """Puts LFAttNet's layers into a graph."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self.graph = Graph("views", (VIEWS * VIEWS, "height", "width"))

    def whole(self, *values: int) -> str:
        return self.graph.array(np.array(values, np.int64))

    def conv(self, name: str, x: str, dilation: int = 1) -> str:
        """A convolution whose result has the size of its input, batch normalisation folded into it."""
        kernel = self.weights[f"{name}.0.weight"]
        norm = {
            part: self.weights[f"{name}.1.{part}"]
            for part in ("weight", "bias", "running_mean", "running_var")
        }
        scale = norm["weight"] / np.sqrt(norm["running_var"] + np.float32(EPSILON))
        bias = norm["bias"] - norm["running_mean"] * scale
        spread = scale.reshape(-1, *[1] * (kernel.ndim - 1))
        return self._conv(x, kernel * spread, dilation, self.graph.array(bias))

    def plain(self, name: str, x: str) -> str:
        """A convolution without bias."""
        return self._conv(x, self.weights[f"{name}.weight"], 1)

    def _conv(self, x: str, kernel: np.ndarray, dilation: int, *bias: str) -> str:
        sizes = list(kernel.shape[2:])
        pads = [dilation * (size // 2) for size in sizes]
        return self.graph.node(
            "Conv",
            x,
            self.graph.array(kernel),
            *bias,
            kernel_shape=sizes,
            pads=pads * 2,
            dilations=[dilation] * len(sizes),
        )

    def relu(self, x: str) -> str:
        return self.graph.node("Relu", x)

    def residual(self, name: str, x: str, dilation: int = 1) -> str:
        found = self.conv(f"{name}.second", self.relu(self.conv(f"{name}.first", x, dilation)), dilation)
        skip = self.conv(f"{name}.skip", x) if f"{name}.skip.0.weight" in self.weights else x
        return self.graph.node("Add", found, skip)

    def features(self, x: str) -> str:
        """(81, 1, H, W) to (81, 4, H, W)."""
        for name in ("first", "second"):
            x = self.relu(self.conv(f"features.{name}", x))
        kept = []
        for i, (_, _, blocks, dilation) in enumerate(STAGES):
            for k in range(blocks):
                x = self.residual(f"features.stages.{i}.{k}", x, dilation)
            kept.append(x)
        pooled = [self._pooled(i, side, x) for i, side in enumerate(POOLS)]
        joined = self.graph.node("Concat", kept[1], kept[3], *pooled[::-1], axis=1)
        return self.plain("features.last", self.relu(self.conv("features.joined", joined)))

    def _pooled(self, i: int, side: int, x: str) -> str:
        node = self.graph.node
        small = node("AveragePool", x, kernel_shape=[side, side], strides=[side, side])
        small = self.relu(self.conv(f"features.pools.{i}", small))
        size = node("Slice", node("Shape", x), self.whole(2), self.whole(4))
        sizes = node("Concat", self.whole(VIEWS * VIEWS, 4), size, axis=0)
        how = {"mode": "linear", "coordinate_transformation_mode": "align_corners"}
        return node("Resize", small, "", "", sizes, **how)

    def volume(self, seen: str) -> str:
        """Features (81, 4, H, W) moved to every plane: (1, 324, 9, H, W)."""
        node = self.graph.node
        border = _REACH * max(PLANES)
        padded = node("Pad", seen, self.whole(0, 0, border, border, 0, 0, border, border))
        views = self.graph.nodes("Split", VIEWS * VIEWS, padded, axis=0)
        axes, planes = self.whole(2, 3), []
        for plane in PLANES:
            moved = []
            for i, view in enumerate(views):
                down, right = plane * (i // VIEWS - _REACH), plane * (i % VIEWS - _REACH)
                ends = [-(border + each) or np.iinfo(np.int64).max for each in (down, right)]
                starts = self.whole(border - down, border - right)
                moved.append(node("Slice", view, starts, self.whole(*ends), axes))
            planes.append(node("Unsqueeze", node("Concat", *moved, axis=1), self.whole(2)))
        return node("Concat", *planes, axis=2)

    def attention(self, volume: str) -> str:
        """Weights of the views, (1, 324, 1, 1, 1)."""
        node, array, weights = self.graph.node, self.graph.array, self.weights
        x = node("Reshape", node("GlobalAveragePool", volume), self.whole(1, -1))
        for name, kind in (("first", "Relu"), ("second", "Sigmoid")):
            kernel, bias = (array(weights[f"attention.{name}.{part}"]) for part in ("weight", "bias"))
            x = node(kind, node("Gemm", x, kernel, bias, transB=1))
        index = np.repeat(np.array(mirrored(), np.int64), FEATURES)
        return node("Reshape", node("Gather", x, array(index), axis=1), self.whole(1, -1, 1, 1, 1))


def lfattnet_onnx(weights: Weights) -> bytes:
    """An ONNX file: views (81, H, W), grey in 0..1, row by row, to disparity (H, W).

    H and W have to be multiples of 16.
    """
    net = _Builder(weights)
    node = net.graph.node
    volume = net.volume(net.features(node("Unsqueeze", "views", net.whole(1))))
    x = node("Mul", volume, net.attention(volume))
    for name in ("begin.0", "begin.1"):
        x = net.relu(net.conv(name, x))
    for name in ("middle.0", "middle.1"):
        x = net.residual(name, x)
    x = net.plain("last", net.relu(net.conv("end", x)))
    likely = node("Softmax", x, axis=2)
    planes = net.graph.array(np.array(PLANES, np.float32).reshape(1, 1, -1, 1, 1))
    found = node("ReduceSum", node("Mul", likely, planes), net.whole(0, 1, 2), keepdims=0)
    return net.graph.model(found, ("rows", "columns"))
