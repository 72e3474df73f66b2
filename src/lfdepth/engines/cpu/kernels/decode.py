"""Row kernels of the decoders."""

from __future__ import annotations

import numba as nb
import numpy as np

from lfdepth.engines.cpu.compilation import KERNEL


@nb.njit(**KERNEL)
def sign_step_kernel(first_row, last_row, plane, smoothed, total, lowest, index, before, after):
    """Take plane `plane` into the running sums of rows [first_row, last_row)."""
    width = smoothed.shape[1]
    here, previous = np.int32(plane), np.int32(plane - 1)
    for y in range(first_row, last_row):
        for x in range(width):
            value = smoothed[y, x]
            running = total[y, x] + value
            after[y, x] = value if index[y, x] == previous else after[y, x]
            is_lower = running < lowest[y, x]
            total[y, x] = running
            lowest[y, x] = running if is_lower else lowest[y, x]
            before[y, x] = value if is_lower else before[y, x]
            index[y, x] = here if is_lower else index[y, x]
