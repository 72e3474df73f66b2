"""Where a disparity map jumps from one surface to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines.boxes import join_around, local_range
from lfdepth.engines.layout import JUMP_SHARE


def near_jumps(disparity: NDArray[np.float32], jump: float, reach: int) -> NDArray[np.bool_]:
    """Pixels within `reach` px of a jump by at least `jump` px per view step, (H, W)."""
    change = local_range(disparity, 1)
    edge = (change >= np.float32(jump)) & (change >= np.float32(JUMP_SHARE) * local_range(disparity, 2))
    return join_around(np.logical_or, edge, reach - 1)
