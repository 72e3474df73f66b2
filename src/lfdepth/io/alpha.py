"""Alpha, which many programs write beside colours although nothing is transparent."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io.white import WHITES


def without_alpha(pixels: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    """The colours of a picture whose last channel is alpha and opaque everywhere.

    Raises
    ------
    LightFieldError
        If the picture is transparent somewhere: what is behind is not known.
    """
    alpha = pixels[..., -1]
    least, most = alpha.min(), alpha.max()
    opaque = (1.0,) if alpha.dtype.kind == "f" else WHITES
    if least != most or float(least) not in opaque:
        share = float(np.mean(alpha < most)) if least != most else 1.0
        raise LightFieldError(
            f"{what}: alpha is not opaque at {100 * share:.3g} % of the pixels; expected grey or RGB, or "
            "alpha that is opaque everywhere; render over a background"
        )
    return pixels[..., :-1]
