"""A smooth surface through a map: total generalised variation of second order.

Bredies, Kunisch, Pock: Total Generalized Variation, SIAM J. Imaging Sciences 3(3), 2010. Piecewise planes
cost nothing but where they meet. Solved by the primal-dual method of Chambolle and Pock (2011).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Exact = NDArray[np.float32]

_STEP = np.float32(1 / np.sqrt(12))
"""Of primal and dual variables: the operator's squared norm is at most 12."""


def smooth_surface(
    target: NDArray[Any],
    strength: NDArray[Any],
    edges: NDArray[Any],
    *,
    first: float = 1.0,
    second: float = 2.0,
    iterations: int = 60,
) -> NDArray[np.float32]:
    """Minimise `Σ first·g·|∇z − w| + second·|ε(w)| + strength/2·(z − target)²` over maps z and fields w.

    Parameters
    ----------
    target
        (H, W) map.
    strength
        (H, W) weight of the target, not negative.
    edges
        (2, H, W) weights g from 0 to 1 of changes from a pixel to the next to the right, and below.
    first, second
        Weights of a change that the field does not explain (α₁), and of the field's own (α₀).
    iterations
        Of the solver.

    Returns
    -------
    (H, W) float32.
    """
    wanted, trust = np.asarray(target, np.float32), np.asarray(strength, np.float32)
    limit = np.float32(first) * np.asarray(edges, np.float32)
    limit[0, :, -1] = limit[1, -1] = 0  # there is no next pixel
    z, w = wanted.copy(), np.zeros((2, *wanted.shape), np.float32)
    ahead_z, ahead_w = z.copy(), w.copy()
    p, q = np.zeros_like(w), np.zeros((3, *wanted.shape), np.float32)
    for _ in range(iterations):
        p += _STEP * (_forward(ahead_z) - ahead_w)
        np.clip(p, -limit, limit, out=p)
        q += _STEP * _strain(ahead_w)
        q /= np.maximum(1, np.sqrt(q[0] ** 2 + q[1] ** 2 + 2 * q[2] ** 2) / np.float32(second))
        z_before, w_before = z, w
        z = (z + _STEP * (_divergence(p) + trust * wanted)) / (1 + _STEP * trust)
        w = w + _STEP * (p + _strain_divergence(q))
        ahead_z, ahead_w = 2 * z - z_before, 2 * w - w_before
    return z


def _forward(image: Exact) -> Exact:
    """Differences (2, H, W) to the next pixel to the right, and below; 0 at the border."""
    out = np.zeros((2, *image.shape), np.float32)
    out[0, :, :-1] = image[:, 1:] - image[:, :-1]
    out[1, :-1] = image[1:] - image[:-1]
    return out


def _backward(image: Exact, axis: int) -> Exact:
    """Negative adjoint of the forward difference along the columns (0) or the rows (1)."""
    turned = image if axis == 1 else image.T
    out = np.empty_like(turned)
    out[0], out[-1] = turned[0], -turned[-2]
    out[1:-1] = turned[1:-1] - turned[:-2]
    return out if axis == 1 else out.T


def _divergence(field: Exact) -> Exact:
    return _backward(field[0], 0) + _backward(field[1], 1)


def _strain(field: Exact) -> Exact:
    """Symmetric derivative (xx, yy, xy) of a field (2, H, W)."""
    across, down = _forward(field[0]), _forward(field[1])
    return np.stack([across[0], down[1], np.float32(0.5) * (across[1] + down[0])])


def _strain_divergence(strain: Exact) -> Exact:
    xx, yy, xy = strain
    return np.stack([_backward(xx, 0) + _backward(xy, 1), _backward(xy, 0) + _backward(yy, 1)])
