"""NPZ files whose bytes depend on what is in them alone."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt


def packed(arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Bytes of an NPZ file."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as file:
        for key in sorted(arrays):
            member = io.BytesIO()
            np.save(member, np.asarray(arrays[key], order="C"), allow_pickle=False)
            file.writestr(zipfile.ZipInfo(f"{key}.npy"), member.getvalue(), zipfile.ZIP_DEFLATED)
    return target.getvalue()
