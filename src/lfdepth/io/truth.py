"""Truth of the reference view from a file of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import hdf5, matlab, stack
from lfdepth.io.maps import READABLE, read_disparity
from lfdepth.io.picture import read_picture
from lfdepth.io.png import scale_file
from lfdepth.io.record import checked_map

_ARRAYS = {".mat": matlab.read_mat, ".h5": hdf5.read_hdf5, ".hdf5": hdf5.read_hdf5}


def read_truth(
    path: Path | str, *, scale: float | None = None, offset: float = 0.0, variable: str | None = None
) -> npt.NDArray[np.float32]:
    """Read the truth of a reference view.

    Parameters
    ----------
    path : str or Path
        What `read_disparity` reads, a 16-bit PNG of another program, MATLAB or HDF5.
    scale, offset : float
        The disparity is offset + scale · value, in px per view step. PNG without the scale that lfdepth
        writes beside it needs a scale.
    variable : str, optional
        Name of the array in MATLAB, HDF5, NPZ, or Zarr, where it has several.

    Returns
    -------
    ndarray, shape (H, W)
        float32, px per view step; NaN or infinite where there is no truth.

    Raises
    ------
    LightFieldError
        If the file is missing, damaged, of another kind, or holds several arrays and none was named.
    """
    path = Path(path)
    if not path.exists():
        raise LightFieldError(
            f"{path}: no such file; expected the truth of the reference view; check the path"
        )
    ending = path.suffix.lower()
    if ending in _ARRAYS:
        values = _named(_ARRAYS[ending](path), variable, path)
    elif ending == ".png" and not scale_file(path).exists():
        values = _samples(path, scale)
    elif ending in READABLE:
        values = read_disparity(path, finite=False, variable=variable)
    else:
        raise LightFieldError(
            f"{path}: unknown extension {ending or '(none)'}; expected one of "
            f"{', '.join((*READABLE, *_ARRAYS))}; "
            "convert the truth"
        )
    truth = checked_map(values, str(path), finite=False)
    if scale is None and not offset:
        return truth
    with np.errstate(over="ignore", invalid="ignore"):  # no disparity: infinite, as where the file has none
        return (np.float64(offset) + np.float64(1 if scale is None else scale) * truth).astype(np.float32)


def _samples(path: Path, scale: float | None) -> npt.NDArray[Any]:
    if scale is None:
        raise LightFieldError(
            f"{path}: a picture without a scale; expected the scale of its samples; give truth_scale "
            "(--truth-scale, disparity = offset + scale · sample)"
        )
    pixels = read_picture(path)
    if pixels.shape[2] != 1:
        raise LightFieldError(f"{path}: a colour picture; expected a grey map; use the map, not its preview")
    return pixels[..., 0].astype(np.float64)


def _named(arrays: dict[str, Any], variable: str | None, path: Path) -> npt.NDArray[Any]:
    maps = {name: array for name, array in arrays.items() if len(array.shape) == 2 and min(array.shape) > 1}
    wanted = variable or next((name for name in maps if stack.is_truth(name)), None)
    if wanted is None and len(maps) == 1:
        wanted = next(iter(maps))
    if wanted not in arrays:
        found = ", ".join(f"{name} {tuple(array.shape)}" for name, array in arrays.items()) or "no arrays"
        raise LightFieldError(
            f"{path}: holds {found[:200]}; expected {variable or 'one map (H, W)'}; name the array "
            "(--truth-variable)"
        )
    return np.asarray(arrays[str(wanted)][...])
