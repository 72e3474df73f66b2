"""MATLAB files: version 5 to 7 through SciPy, version 7.3 (HDF5 inside) through h5py."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import hdf5, signature, stack
from lfdepth.io.atomic import atomic
from lfdepth.io.extras import need
from lfdepth.io.layout import Layout
from lfdepth.io.mat5 import check_mat5
from lfdepth.io.notes import KEY, Bundle, parse_notes
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

_MOST = 2 << 30


def recognise(path: Path) -> bool:
    """True for a MATLAB file of version 5 or later."""
    return signature.starts_with(path, signature.MATLAB_5, signature.MATLAB_7_3)


def open_mat(path: Path, layout: Layout) -> ViewSource:
    """Open the light field of a MATLAB file: variable or field `LF`, or the only array with enough axes.

    Files of the Light Field Toolbox have a fourth channel with weights, which is left out.

    Raises
    ------
    LightFieldError
        If SciPy or h5py is not installed, the file is damaged, or holds no light field.
    """
    if signature.starts_with(path, signature.MATLAB_7_3):
        return _open_7_3(path, layout)
    return _open_5(path, layout)


def _open_5(path: Path, layout: Layout) -> ViewSource:
    variables = _variables(path)
    text = variables.get(KEY)
    arrays = _numbers(variables)
    notes = parse_notes(text, f"{path}: {KEY}")
    if notes is not None:  # SciPy drops axes of length 1, and makes plain numbers of arrays of one
        arrays |= {name: np.asarray(value) for name, value in variables.items() if np.isscalar(value)}
        if "LF" in arrays and arrays["LF"].size == prod(notes.shape):
            arrays["LF"] = arrays["LF"].reshape(notes.shape)
    return stack.open_arrays(arrays, text, path, layout, channels=3)


def read_mat(path: Path) -> dict[str, Any]:
    """The numeric arrays of a MATLAB file by name.

    Raises
    ------
    LightFieldError
        If SciPy or h5py is not installed, or the file is damaged.
    """
    if signature.starts_with(path, signature.MATLAB_7_3):
        return {name: _Reversed(array) for name, array in hdf5.datasets(hdf5.open_file(path, "mat")).items()}
    return dict(_numbers(_variables(path)))


def _variables(path: Path) -> dict[str, Any]:
    scipy_io = need("scipy.io", "mat", path)
    try:
        check_mat5(path)
        variables: dict[str, Any] = scipy_io.loadmat(path, simplify_cells=True)
    except LightFieldError:
        raise
    except Exception as error:  # SciPy lets struct.error, zlib.error, TypeError and others through
        raise stack.unreadable(path, error) from None
    return variables


def _open_7_3(path: Path, layout: Layout) -> ViewSource:
    file = hdf5.open_file(path, "mat")
    try:
        arrays = {name: _Reversed(array) for name, array in hdf5.datasets(file).items()}
        return stack.open_arrays(arrays, None, path, layout, close=file.close, channels=3)
    except BaseException:
        file.close()
        raise


def write_views_mat(path: Path, lf: LightField) -> None:
    """Write a MATLAB 5 file: `LF` (V, U, H, W, C), truth, masks and notes.

    Raises
    ------
    LightFieldError
        If SciPy is not installed, or an array has more than the 2 GiB that the format can hold.
    """
    scipy_io = need("scipy.io", "mat", path)
    if lf.views.nbytes >= _MOST:
        raise LightFieldError(
            f"{path}: views take {lf.views.nbytes / 2**30:.1f} GiB; expected less than 2 GiB, which MATLAB 5 "
            "files can hold; write HDF5 (.h5), which MATLAB reads as well"
        )
    bundle = Bundle.of(lf)
    with atomic(path) as temporary, temporary.open("wb") as file:
        scipy_io.savemat(file, {**bundle.arrays, KEY: bundle.text})


class _Reversed:
    """An HDF5 dataset as MATLAB sees it: with its axes in the opposite order."""

    def __init__(self, array: Any) -> None:
        self._array = array

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self._array.shape[::-1])

    @property
    def dtype(self) -> Any:
        return self._array.dtype

    def __getitem__(self, index: Any, /) -> npt.NDArray[Any]:
        reverse = index[::-1] if isinstance(index, tuple) else index
        return np.asarray(self._array[reverse]).T


def _numbers(variables: dict[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """Numeric arrays among variables and the fields of structs, by their last name."""
    found: dict[str, npt.NDArray[Any]] = {}
    for name, value in variables.items():
        if isinstance(value, dict):
            found |= _numbers(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "uif":
            found[name] = value
    return found
