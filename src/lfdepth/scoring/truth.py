"""Truth and masks of a scene in the benchmark's layout: high resolution, and masks that cannot be used."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lfdepth.errors import LightFieldError
from lfdepth.io.limits import check_inside
from lfdepth.io.pfm import read_pfm
from lfdepth.io.picture import read_picture
from lfdepth.lightfield import LightField
from lfdepth.scoring.metrics import Array

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
    check_inside(folder, [folder / _TRUTH])
    truth = read_pfm(folder / _TRUTH)
    masks: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for name, file in _files(folder, _MASK).items():
        try:
            check_inside(folder, [file])
            masks[name] = _read_mask(file, (truth.shape[0], truth.shape[1]))
        except LightFieldError as error:
            unusable[name] = str(error)
    return HighResolution(truth, masks, unusable)


def read_scene(path: Path, read: Callable[..., LightField]) -> tuple[LightField, dict[str, str]]:
    """Read a light field to be scored, also where some of its masks cannot be used.

    Parameters
    ----------
    path : Path
        The scene.
    read : callable
        As `lfdepth.read`, with its argument `unusable`.

    Returns
    -------
    LightField
        With the masks that can be used.
    dict of str to str
        The reason by name for each of the others.

    Raises
    ------
    LightFieldError
        If something else is wrong.
    """
    unusable: dict[str, str] = {}
    return read(path, unusable=unusable), unusable


def _files(folder: Path, pattern: re.Pattern[str]) -> dict[str, Path]:
    """Masks in a folder by name."""
    return {match[1]: file for file in sorted(folder.iterdir()) if (match := pattern.fullmatch(file.name))}


def _read_mask(file: Path, size: tuple[int, int]) -> Array:
    mask = read_picture(file)[..., 0]
    if mask.shape != size:
        raise LightFieldError(
            f"{file}: {mask.shape[1]}x{mask.shape[0]} px; expected {size[1]}x{size[0]} px; replace it"
        )
    return mask
