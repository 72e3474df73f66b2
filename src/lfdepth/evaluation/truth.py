"""High-resolution truth of a scene in the benchmark's layout."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.evaluation.metrics import Array
from lfdepth.io.pfm import read_pfm
from lfdepth.io.picture import read_picture

_TRUTH = "gt_disp_highres.pfm"
_MASK = re.compile(r"mask_(\w+)_highres\.png")


@dataclass(frozen=True, eq=False)
class HighResolution:
    """Truth at ten times the size of the views.

    Attributes
    ----------
    truth : (10 H, 10 W) array
        Disparity of the reference view, px of the *views* per view step.
    masks : mapping of str to array
        Named regions of the same size; labels (`boxes`, `dots_by_size`) are kept as whole numbers.
    unusable : mapping of str to str
        Masks that could not be used, with the reason.
    """

    truth: Array
    masks: Mapping[str, Array] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)


def read_high_resolution(folder: Path | str) -> HighResolution | None:
    """Read `gt_disp_highres.pfm` and every `mask_NAME_highres.png` of a benchmark folder.

    Returns
    -------
    HighResolution or None
        None where there is no high-resolution truth. A mask that is damaged or of another size than the truth
        is named in `unusable`, and the rest is read.

    Raises
    ------
    LightFieldError
        If the truth is there but damaged.
    """
    folder = Path(folder)
    if not (folder / _TRUTH).exists():
        return None
    truth = read_pfm(folder / _TRUTH)
    masks: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for file in sorted(folder.iterdir()):
        if match := _MASK.fullmatch(file.name):
            try:
                masks[match[1]] = _read_mask(file, truth)
            except LightFieldError as error:
                unusable[match[1]] = str(error)
    return HighResolution(truth, masks, unusable)


def _read_mask(file: Path, truth: Array) -> Array:
    mask = read_picture(file)[..., 0]
    if mask.shape != truth.shape:
        raise LightFieldError(
            f"{file}: {mask.shape[1]}x{mask.shape[0]} px; expected {truth.shape[1]}x{truth.shape[0]} px like "
            f"{_TRUTH}; replace it"
        )
    return mask
