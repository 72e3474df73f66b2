"""Kernel that gathers what the views show at pixels beside depth edges."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import KERNEL
from lfdepth.engines.cpu.kernels.edges import _agrees, _background_colour, _foreground_colour
from lfdepth.engines.cpu.kernels.sampling import inside, sample
from lfdepth.engines.layout import DISPARITY_PARTS as PARTS


@nb.njit(**KERNEL)
def edge_colours_kernel(
    first,
    last,
    places,
    surfaces,
    disparity,
    views,
    scale,
    reference,
    others,
    nearest,
    margin,
    row_length,
    thresholds,
    front,
    back,
    spreads,
    counts,
):
    """Colours and counts of pixels [first, last) of a list.

    `places` (N, 2) are rows and columns, `surfaces` (N, 2) the near and the far disparity there; `others` is
    (present but for the reference view, offsets). Into `front` and `back` (N, C) go the surfaces' colours in
    8-bit levels, into `spreads` (N, 2) their summed variances, the first negative where there is no front,
    and into `counts` (N, 6): views that see past the edge, those of them that agree at the near and at the
    far disparity; views that show the place but do not see past, those of them that agree at the near
    disparity, and all views that show the pixel at the near disparity.
    """
    rows, columns, height, width, channels = views.shape
    present, offsets = others
    samples = np.empty((rows * columns, channels), np.float32)
    here, own = np.empty(channels, np.float32), np.empty(channels, np.float32)
    for i in range(first, last):
        y, x = places[i, 0], places[i, 1]
        near, far = surfaces[i, 0], surfaces[i, 1]
        threshold = thresholds[y, x]
        for c in range(channels):
            own[c] = scale * np.float32(reference[y, x, c])
        weight, spreads[i, 0] = _foreground_colour(disparity, reference, scale, y, x, near, far, front[i])
        if weight <= np.float32(1e-6):
            spreads[i, 0] = -1
        horizon = (far + np.float32(0.5) * (near - far)) * np.float32(PARTS)
        seeing = seeing_near = seeing_far = hidden = hidden_near = shown_near = 0
        for v in range(rows):
            for u in range(columns):
                if not present[v, u]:
                    continue
                to_y, to_x = y - offsets[v, u, 0] * far, x - offsets[v, u, 1] * far
                sees, hides = False, False
                if inside(to_y, to_x, height, width):
                    row = (v * columns + u) * height + int(to_y + 0.5)
                    sees = nearest[row * row_length + margin + int(to_x + 0.5)] <= horizon
                    hides = not sees
                if sees:
                    sample(views[v, u], to_y, to_x, scale, samples[seeing])
                    seeing_far += _agrees(samples[seeing], own, threshold)
                    seeing += 1
                hidden += hides
                to_y, to_x = y - offsets[v, u, 0] * near, x - offsets[v, u, 1] * near
                if inside(to_y, to_x, height, width):
                    sample(views[v, u], to_y, to_x, scale, here)
                    agrees = _agrees(here, own, threshold)
                    shown_near += 1
                    seeing_near += agrees and sees
                    hidden_near += agrees and hides
        if seeing > 0:
            spreads[i, 1] = _background_colour(samples, seeing, back[i])
        counts[i, 0], counts[i, 1], counts[i, 2] = seeing, seeing_near, seeing_far
        counts[i, 3], counts[i, 4], counts[i, 5] = hidden, hidden_near, shown_near
