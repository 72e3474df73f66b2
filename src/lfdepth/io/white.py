"""Samples that fill only part of their type: which value is white, and scaling it to the type's."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import FULL_SCALE

Array = npt.NDArray[Any]

WHITES = (255.0, 1023.0, 4095.0, 16383.0, 65535.0)
"""Whites of 8, 10, 12, 14 and 16 bits: what cameras and converters store in 16-bit files."""

# Highlights of pictures beyond 1 that are clipped: the brightest 0.5 % of the reference view at most.
_CLIPPED = 0.005
# Filters of renderers undershoot; further below 0, floats are no brightness.
_UNDERSHOOT = 0.1


def whole_samples(pixels: Array, what: str) -> Array:
    """Whole numbers of any type as uint8 or uint16, whose white is found afterwards.

    Raises
    ------
    LightFieldError
        If some are negative or beyond 65535.
    """
    if pixels.dtype.newbyteorder("=") in (np.uint8, np.uint16):
        return pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
    least, most = int(pixels.min(initial=0)), int(pixels.max(initial=0))
    if least < 0 or most > WHITES[-1]:
        raise LightFieldError(
            f"{what}: samples of type {pixels.dtype} from {least} to {most}; expected 0 to 65535; scale them"
        )
    return pixels.astype(np.uint16)


def white_of_bits(bits: int) -> float:
    """The value of white of samples with that many bits."""
    return float(2**bits - 1)


def check_white_level(level: float | None) -> None:
    """Raise LightFieldError unless a white level is a positive number."""
    if level is not None and not (isfinite(level) and level > 0):
        raise LightFieldError(
            f"white level: {level:g}; expected a positive number, such as 4095 for 12 bits; change it"
        )


def find_white(
    reference: Array, peak: float, stated: float | None, given: float | None, what: str
) -> tuple[float | None, str]:
    """The value of white, where it is not that of the samples' type.

    In this order: the one given; the one that the file states; for 16 bits, that of the fewest of 8, 10, 12,
    14 or 16 bits which hold every sample; for floats that are whole numbers and exceed 1, the same; for other
    floats that exceed 1, the smallest power of two (so that scaling is exact) that at least 99.5 % of the
    samples of the reference view do not exceed, at which highlights are clipped.

    Parameters
    ----------
    reference : ndarray, shape (H, W, C)
        Samples of the reference view as stored.
    peak : float
        Largest sample of the light field.
    stated, given : float, optional
        White according to the file, and to the caller.
    what : str
        Name for messages.

    Returns
    -------
    white : float or None
        None where white is that of the type.
    where : str
        Where it comes from, in words.

    Raises
    ------
    LightFieldError
        If the white level exceeds what samples of the type can be.
    """
    full = FULL_SCALE.get(reference.dtype.name)
    if full is None or not isfinite(peak):  # refused with the views
        return None, ""
    whole_type = reference.dtype.kind == "u"
    for level, where in ((given, "given"), (stated, "stated by the file")):
        if level is None:
            continue
        if whole_type and level > full:
            raise LightFieldError(
                f"{what}: white level {level:g}; expected at most {full:g} for {reference.dtype} samples; "
                "correct it"
            )
        return (None if level == full else level), where
    if whole_type:
        white = _fewest_bits(peak) if full > WHITES[0] and peak > 0 else full
        return (None if white == full else white), f"no sample takes more than {int(white).bit_length()} bits"
    if peak <= 1:
        return None, ""
    if peak <= WHITES[-1] and np.array_equal(reference, np.rint(reference.astype(np.float64))):
        return _fewest_bits(peak), "samples are whole numbers"
    bright = float(np.quantile(reference, 1 - _CLIPPED))
    white = 2.0 ** max(0, int(np.ceil(np.log2(max(bright, 1.0)))))
    return white, "99.5 % of the reference view is no brighter"


def apply_white(views: npt.NDArray[Any], white: float) -> float:
    """Scale samples in place so that white becomes that of their type; brighter ones become white.

    Whole numbers stay different from each other, as there are more of them afterwards.

    Returns
    -------
    float
        Share of the samples that were brighter than white.
    """
    clipped = 0
    full = FULL_SCALE[views.dtype.name]
    whole = views.dtype.kind == "u"
    table = np.rint(np.minimum(np.arange(full + 1) / white, 1) * full).astype(views.dtype) if whole else None
    for view in _each(views):
        clipped += int(np.count_nonzero(view > white))
        if table is not None:
            view[...] = table[view]
        else:
            np.divide(view, np.float32(white), out=view)
            np.minimum(view, np.float32(1), out=view)
    return clipped / views.size


def lift_undershoot(views: npt.NDArray[Any]) -> float:
    """Set floats slightly below 0, which renderers' filters make, to 0 in place; return their share."""
    if views.dtype.kind != "f":
        return 0.0
    below = sum(np.count_nonzero(view < 0) for view in _each(views))
    if not below or float(views.min()) < -_UNDERSHOOT:
        return 0.0
    for view in _each(views):
        np.maximum(view, np.float32(0), out=view)
    return below / views.size


def _fewest_bits(peak: float) -> float:
    return next((white for white in WHITES if peak <= white), WHITES[-1])


def _each(views: npt.NDArray[Any]) -> Iterator[npt.NDArray[Any]]:
    for index in np.ndindex(*views.shape[:2]):
        yield views[index]
