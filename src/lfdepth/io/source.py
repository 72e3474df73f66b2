"""What a reader yields before pixels are loaded, and how a light field is put together from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

# Decoders release the GIL, but every thread holds one decoded view.
_THREADS = 4


@dataclass(frozen=True, eq=False)
class ViewSource:
    """A grid of views that are read one at a time.

    Parameters
    ----------
    grid : tuple of int
        (V, U).
    read_view : callable
        ``read_view(v, u)`` decodes one view, (H, W, C); it may run in several threads at once.
    describe : callable
        ``describe(v, u)`` names a view in error messages, usually its file.
    """

    grid: tuple[int, int]
    read_view: Callable[[int, int], npt.NDArray[Any]]
    describe: Callable[[int, int], str]
    camera: Camera | None = None
    disparity_range: tuple[float, float] | None = None
    truth: npt.NDArray[np.float32] | None = None
    masks: Mapping[str, npt.NDArray[np.bool_]] = field(default_factory=dict)
    name: str = "light field"


def assemble(source: ViewSource) -> LightField:
    """Decode the views of a source, one per thread, straight into the light field.

    Raises
    ------
    LightFieldError
        If a view cannot be read, or differs from the others in size or kind.
    """
    first = source.read_view(0, 0)
    views = np.empty((*source.grid, *first.shape), dtype=first.dtype)

    def load(index: tuple[int, int]) -> None:
        view = source.read_view(*index)
        if view.shape != first.shape or view.dtype != first.dtype:
            raise LightFieldError(
                f"{source.describe(*index)}: view is {_kind(view)} but {source.describe(0, 0)} is "
                f"{_kind(first)}; expected views of one size and kind; convert the odd ones"
            )
        views[index] = view

    with ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(load, np.ndindex(*source.grid)))
    return LightField(
        views=views,
        camera=source.camera,
        disparity_range=source.disparity_range,
        truth=source.truth,
        masks=source.masks,
        name=source.name,
    )


def _kind(view: npt.NDArray[Any]) -> str:
    height, width, channels = view.shape
    return f"{width}x{height} px, {'grey' if channels == 1 else 'colour'}, {view.dtype}"
