"""EPINET without a framework: every convolution is four products of matrices, which BLAS computes.

Pixels are rows and channels columns. In a picture that keeps its row length W, the neighbours below and to
the right of all pixels are the same rows moved on by W and by 1, so a 2x2 convolution needs no copy of its
input. Each convolution leaves one column more that holds nothing of use; they are cut off at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.learned.shape import EPSILON, EpinetShape, Weights

Float = npt.NDArray[np.float32]


def folded(shape: EpinetShape, weights: Weights) -> Weights:
    """The same weights without batch normalisation, which becomes part of the convolution before it."""
    found = {name: array for name, array in weights.items() if ".norm." not in name}
    for name, _, _ in shape.blocks():
        norm = {
            part: weights[f"{name}.norm.{part}"] for part in ("weight", "bias", "running_mean", "running_var")
        }
        scale = norm["weight"] / np.sqrt(norm["running_var"] + np.float32(EPSILON))
        found[f"{name}.second.weight"] = weights[f"{name}.second.weight"] * scale[:, None, None, None]
        bias = weights[f"{name}.second.bias"] - norm["running_mean"]
        found[f"{name}.second.bias"] = bias * scale + norm["bias"]
    return found


class Forward:
    """An EPINET ready to run.

    Parameters
    ----------
    shape
        Its sizes.
    weights
        Its weights, with batch normalisation.
    """

    def __init__(self, shape: EpinetShape, weights: Weights) -> None:
        self.shape = shape
        arrays = folded(shape, weights)
        self._layers = {
            name.removesuffix(".weight"): (
                np.ascontiguousarray(array.transpose(2, 3, 1, 0)),  # (2, 2, in, out)
                arrays[name.removesuffix("weight") + "bias"],
            )
            for name, array in arrays.items()
            if name.endswith(".weight")
        }

    def __call__(self, stacks: Float) -> Float:
        """Disparity (H - lost, W - lost) of stacks (4, views, H, W), grey in 0..1."""
        _, views, height, width = stacks.shape
        streams = []
        for i in range(4):
            rows = np.ascontiguousarray(stacks[i].reshape(views, height * width).T)
            for block in range(self.shape.stream_blocks):
                rows = self._block(f"stream{i}.{block}", rows, width)
            streams.append(rows)
        rows = np.concatenate(streams, axis=1)
        for block in range(self.shape.merged_blocks):
            rows = self._block(f"merged.{block}", rows, width)
        rows = self._layer("last.first", rows, width)
        np.maximum(rows, 0, out=rows)
        found = self._layer("last.second", rows, width)[:, 0]
        lost = self.shape.lost
        # The last row lacks the columns that hold nothing.
        whole = np.zeros((height - lost) * width, np.float32)
        whole[: found.size] = found[: whole.size]
        return whole.reshape(height - lost, width)[:, : width - lost]

    def _block(self, name: str, rows: Float, width: int) -> Float:
        for layer in ("first", "second"):
            rows = self._layer(f"{name}.{layer}", rows, width)
            np.maximum(rows, 0, out=rows)
        return rows

    def _layer(self, name: str, rows: Float, width: int) -> Float:
        """A convolution of (N, in) rows to (N - width - 1, out)."""
        from scipy.linalg.blas import sgemm  # here, since listing the methods needs no SciPy

        weights, bias = self._layers[name]
        count = len(rows) - width - 1
        out: Any = np.empty((count, len(bias)), np.float32)
        out[:] = bias
        for down in range(2):
            for right in range(2):
                part = rows[down * width + right :][:count]
                # In Fortran's order, in which BLAS takes matrices: out' += weights' · part'
                out = sgemm(1.0, weights[down, right].T, part.T, 1.0, out.T, overwrite_c=True).T
        return out  # type: ignore[no-any-return]


def tiles(height: int, width: int, side: int) -> Iterator[tuple[slice, slice]]:
    """Rows and columns of tiles of at most `side` px that cover a map."""
    for top in range(0, height, side):
        for left in range(0, width, side):
            yield slice(top, min(top + side, height)), slice(left, min(left + side, width))
