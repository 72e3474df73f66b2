"""Edge-preserving smoothing of a slice: the guided filter.

He, Sun, Tang: Guided Image Filtering, TPAMI 2013, doi:10.1109/TPAMI.2012.213.

Per window the slice is fitted by a linear function of the guide; the pixel's value is the mean of the fits
of all windows that hold it. The guide's mean and the inverse of its regularised covariance do not change
from plane to plane, so they are computed once per light field. Windows are cut at the image border.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import single
from lfdepth.engines.base import Array, Engine
from lfdepth.engines.layout import GREY_WHITE, grey_levels
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField, unit


class GuidedFilter:
    """A guided filter with its guide's statistics.

    Parameters
    ----------
    guide
        (H, W, C) in [0, 1], C = 1 (grey) or 3 (colour).
    radius
        Window radius in px: windows are (2·radius + 1)² pixels; at least 1.
    epsilon
        Regularisation, in the guide's squared units (ε); larger smooths across weaker edges.
    engine
        Engine; by default the processor's, on one thread.

    Raises
    ------
    LightFieldError
        For a radius below 1, a window larger than the image, an epsilon that is not positive, or a guide of
        another shape.
    """

    def __init__(
        self,
        guide: NDArray[Any],
        radius: int = 4,
        epsilon: float = 1e-4,
        *,
        engine: Engine | None = None,
    ) -> None:
        if guide.ndim != 3 or guide.shape[2] not in (1, 3):
            raise LightFieldError(
                f"guide: found shape {guide.shape}, expected (H, W, 1) or (H, W, 3); add the channel axis"
            )
        check_window(radius, (guide.shape[0], guide.shape[1]))
        if not epsilon > 0:
            raise LightFieldError(f"epsilon: found {epsilon}, expected a positive number such as 1e-4")
        self.guide = np.ascontiguousarray(guide, np.float32)
        self.radius, self.epsilon = radius, epsilon
        self._engine = engine or single()
        self._prepared = self._engine.guided_filter(self.guide, radius, epsilon)

    def __call__(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """Smooth an (H, W) image; returns (H, W) float32.

        Raises
        ------
        LightFieldError
            If the image has another size than the guide.
        """
        if image.shape != self.guide.shape[:2]:
            raise LightFieldError(
                f"image: found shape {image.shape}, expected {self.guide.shape[:2]} like the guide; resize it"
            )
        out = self._engine.empty(image.shape, np.float32)
        self.smooth(self._engine.upload(np.asarray(image, np.float32)), out)
        return np.asarray(self._engine.download(out), np.float32)

    def smooth(self, image: Array, out: Array) -> None:
        """Smooth a slice into `out`, both the engine's."""
        self._engine.smooth(self._prepared, image, out)

    def smooth_quotient(self, numerator: Array, denominator: Array, out: Array) -> None:
        """Normalised smoothing: smoothed numerator over smoothed denominator, within [−1, 1], into `out`."""
        self._engine.smooth_quotient(self._prepared, numerator, denominator, out)


def check_window(radius: int, size: tuple[int, int]) -> None:
    """Raise LightFieldError unless windows of this radius, at least 1, fit an image of this size (H, W)."""
    if radius < 1:
        raise LightFieldError(f"radius: found {radius}, expected at least 1 px")
    if 2 * radius + 1 > min(size):
        raise LightFieldError(
            f"radius: found windows of {2 * radius + 1} px for images of {size[1]}×{size[0]} px, "
            "expected windows no larger than the image; use larger images or a smaller --radius"
        )


def guide_image(lf: LightField, guide: str) -> NDArray[np.float32]:
    """The reference view in [0, 1] as a filter guide: (H, W, 3) for "colour" if any, or (H, W, 1)."""
    if guide == "colour":
        return unit(lf.reference, lf.full_scale)
    return (grey_levels(lf.reference).astype(np.float32) / np.float32(GREY_WHITE))[..., None]
