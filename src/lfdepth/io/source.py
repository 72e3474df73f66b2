"""What a reader yields before pixels are loaded, and how a light field is put together from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera, CameraOptions
from lfdepth.errors import LightFieldError
from lfdepth.io.positions import SAME_STEPS, off_the_grid, read_positions, step_ratio
from lfdepth.io.scaling import scale_nearest, scale_view, scaled_size
from lfdepth.io.white import apply_white, find_white, lift_undershoot
from lfdepth.lightfield import LightField, angular_window, check_window, reference_index

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
    read_part : callable, optional
        ``read_part(v, u, rows, columns)`` reads these slices of a view, where that takes less than all of it;
        views are then all of one size.
    size : tuple of int, optional
        (H, W) of views, where `read_part` is there and it is known without reading one.
    describe : callable
        ``describe(v, u)`` names a view in error messages, usually its file.
    present : ndarray, shape (V, U), optional
        Which views exist; None: all of them.
    default_views : tuple of int, optional
        How many views (V, U) around the reference view are read unless the caller says otherwise.
    close : callable
        Called when all views are read.
    unusable : mapping of str to str
        Masks that are damaged or not of the views' size, with the reason.
    white : float, optional
        Value of white, where the file states it.
    positions : ndarray, shape (V, U, 2), optional
        Where the cameras stand, in any unit and either order of the two coordinates; NaN for absent views.
    remarks : tuple of str
        What the reader found out or left out, a sentence each.
    camera, disparity_range, truth, masks, name
        As in `LightField`; truth and masks are those of the view (V // 2, U // 2).
    """

    grid: tuple[int, int]
    read_view: Callable[[int, int], npt.NDArray[Any]]
    describe: Callable[[int, int], str]
    present: npt.NDArray[np.bool_] | None = None
    default_views: tuple[int, int] | None = None
    close: Callable[[], None] = lambda: None
    read_part: Callable[[int, int, slice, slice], npt.NDArray[Any]] | None = None
    size: tuple[int, int] | None = None
    white: float | None = None
    positions: npt.NDArray[np.float64] | None = None
    remarks: tuple[str, ...] = ()
    camera: Camera | None = None
    disparity_range: tuple[float, float] | None = None
    truth: npt.NDArray[np.float32] | None = None
    masks: Mapping[str, npt.NDArray[np.bool_]] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)
    name: str = "light field"


@dataclass(frozen=True)
class Selection:
    """What of a light field is read.

    Parameters
    ----------
    views : tuple of int, optional
        (V, U) views around the reference view.
    crop : tuple of int, optional
        Window (x, y, width, height) of every view, px of the stored views.
    scale : float
        Factor in (0, 1] by which views shrink after cropping; disparity shrinks with them.
    transpose, flip_v, flip_u : bool
        Reorder the grid: swap its rows and columns, then reverse its rows, its columns.
    serpentine : bool
        Every second row of the grid as it is stored runs back; this comes before the reordering.
    white_level : float, optional
        Value of white in the file, over what the file and its samples say.
    positions : Path, optional
        Table of camera positions, over what the file says.
    truth : ndarray, shape (H, W), optional
        Disparity of the reference view that is read, of the size of whole views, over what the file says.
    camera : CameraOptions
        Values that replace those of the file.
    """

    views: tuple[int, int] | None = None
    crop: tuple[int, int, int, int] | None = None
    scale: float = 1.0
    transpose: bool = False
    flip_v: bool = False
    flip_u: bool = False
    serpentine: bool = False
    white_level: float | None = None
    positions: Path | None = None
    truth: npt.NDArray[np.float32] | None = None
    camera: CameraOptions = field(default_factory=CameraOptions)


def assemble(source: ViewSource, selection: Selection) -> LightField:
    """Decode the selected views, one per thread, straight into the light field.

    Nothing larger than the result and a few whole views is held in memory.

    Raises
    ------
    LightFieldError
        If a view cannot be read, views differ in size or kind, or the selection leaves the light field.
    """
    try:
        return _assemble(source, selection)
    except MemoryError:
        raise LightFieldError(
            f"{source.name}: does not fit in memory; expected a smaller light field; read fewer views, a "
            "crop or a smaller scale (views, crop, scale)"
        ) from None
    finally:
        source.close()


def _assemble(source: ViewSource, selection: Selection) -> LightField:
    stored = _stored_positions(source, selection)
    present = None if source.present is None else source.present.reshape(-1)[stored]
    reference = divmod(int(stored[reference_index(stored.shape)]), source.grid[1])
    if source.present is not None and not source.present[reference]:
        raise LightFieldError(
            f"{source.describe(*reference)}: the reference view is missing; expected it to be present; read "
            "other views, or another grid"
        )
    if _can_leave_out(source, selection):
        assert source.read_part is not None
        assert source.size is not None
        size = source.size
        window = _Window.of(size, selection, source.name)
        whole = source.read_part(*reference, *window.slices)
        first = scale_view(whole, window.scale)
    else:
        whole = source.read_view(*reference)
        size = (whole.shape[0], whole.shape[1])
        window = _Window.of(size, selection, source.name)
        first = window.view(whole)
    views = np.zeros((*stored.shape, *first.shape), dtype=first.dtype)
    peaks = np.zeros(stored.shape)
    peaks[reference_index(stored.shape)] = whole.max(initial=0)

    def load(index: tuple[int, ...]) -> None:
        if present is not None and not present[index]:
            return
        at = divmod(int(stored[index]), source.grid[1])
        if source.read_part is not None:
            part = source.read_part(*at, *window.slices)
            peaks[index] = max(peaks[index], part.max(initial=0))
            views[index] = scale_view(part, window.scale)
            return
        view = source.read_view(*at)
        if view.shape != whole.shape or view.dtype != whole.dtype:
            raise LightFieldError(
                f"{source.describe(*at)}: view is {_kind(view)} but {source.describe(*reference)} is "
                f"{_kind(whole)}; expected views of the same size and kind; convert the odd ones"
            )
        peaks[index] = view.max(initial=0)
        views[index] = window.view(view)

    with ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(load, np.ndindex(*stored.shape)))
    white, remarks = _to_full_scale(views, whole, float(peaks.max()), source, selection)
    # Reordering an even grid moves the reference view, and the truth is that of the old one.
    same_reference = reference == reference_index(source.grid)
    positions, steps = _positions(source, selection, stored, present)
    truth = _checked_truth(selection.truth, size, source.name)
    if truth is None and same_reference:
        truth = source.truth
    return LightField(
        views=views,
        camera=window.camera(selection.camera.apply(source.camera, size[1], size[0])),
        disparity_range=window.disparity_range(source.disparity_range),
        truth=None if truth is None else window.disparity(truth),
        masks={key: window.map(mask) for key, mask in source.masks.items()} if same_reference else {},
        present=None if present is None or present.all() else present,
        positions=positions,
        white_level=white,
        remarks=(*source.remarks, *remarks, *steps),
        name=source.name,
    )


def _can_leave_out(source: ViewSource, selection: Selection) -> bool:
    """Whether the reference view need not be read whole: nothing but its size, and white, is asked of it."""
    return source.size is not None and selection.crop is not None and selection.white_level is not None


def _to_full_scale(
    views: npt.NDArray[Any],
    whole: npt.NDArray[Any],
    peak: float,
    source: ViewSource,
    selection: Selection,
) -> tuple[float | None, list[str]]:
    """Scale samples that fill only part of their type in place; white in the file, and remarks on it."""
    remarks = []
    white, where = find_white(whole, peak, source.white, selection.white_level, source.name)
    if white is not None:
        clipped = apply_white(views, white)
        brighter = f"; {clipped:.2g} of the samples are brighter and were clipped" if clipped else ""
        remarks.append(f"white level {white:g} ({where}): samples were scaled to the full range{brighter}")
    if negative := lift_undershoot(views):
        remarks.append(f"{negative:.2g} of the samples are below 0 and were set to 0")
    return white, remarks


def _checked_truth(
    truth: npt.NDArray[np.float32] | None, size: tuple[int, int], what: str
) -> npt.NDArray[np.float32] | None:
    if truth is not None and truth.shape != size:
        raise LightFieldError(
            f"{what}: truth is {truth.shape[1]}x{truth.shape[0]} px; expected {size[1]}x{size[0]} px, the "
            "size of the whole views; give this scene's truth"
        )
    return truth


def _positions(
    source: ViewSource,
    selection: Selection,
    stored: npt.NDArray[np.intp],
    present: npt.NDArray[np.bool_] | None,
) -> tuple[npt.NDArray[np.float64] | None, list[str]]:
    """How far views lie off the regular grid, and remarks on its steps."""
    table = selection.positions
    positions = source.positions if table is None else read_positions(table, source.grid)
    if positions is None:
        return None, []
    what = source.name if table is None else str(table)
    positions = positions.reshape(-1, 2)[stored]
    offsets, ratio = off_the_grid(positions, present, what), step_ratio(positions, present)
    if ratio is None or abs(ratio - 1) < SAME_STEPS:
        return offsets, []
    return offsets, [f"according to the camera positions, a step down is {ratio:.3g} of a step to the right"]


def _stored_positions(source: ViewSource, selection: Selection) -> npt.NDArray[np.intp]:
    """Row-major position in the file of each selected view, shape (V, U)."""
    stored = np.arange(source.grid[0] * source.grid[1]).reshape(source.grid)
    if selection.serpentine:
        stored[1::2] = stored[1::2, ::-1].copy()
    wanted = selection.views or source.default_views
    if selection.transpose:
        stored = stored.T
        if wanted and not selection.views:
            wanted = wanted[::-1]
    if selection.flip_v:
        stored = stored[::-1]
    if selection.flip_u:
        stored = stored[:, ::-1]
    v, u = wanted or stored.shape
    rows, columns = (angular_window(n, k, source.name) for n, k in zip(stored.shape, (v, u), strict=True))
    return stored[rows, columns]


@dataclass(frozen=True)
class _Window:
    """The part of every view that is read, and its scale."""

    x: int
    y: int
    width: int
    height: int
    scale: float

    @staticmethod
    def of(view: tuple[int, int], selection: Selection, what: str) -> _Window:
        """The window of views of a size (H, W)."""
        size = view[1], view[0]
        crop: tuple[int, int, int, int] = selection.crop or (0, 0, *size)
        check_window(crop, size, what)
        scaled_size(crop[2:], selection.scale, what)  # raises early
        return _Window(*crop, selection.scale)

    def map(self, whole: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Window of a map, sampled where it is scaled: averages would invent values at boundaries."""
        return scale_nearest(self._cut(whole), self.scale)

    def view(self, whole: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return scale_view(self._cut(whole), self.scale)

    def disparity(self, whole: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        with np.errstate(invalid="ignore"):  # NaN of any kind stands for no disparity
            return self.map(whole) * np.float32(self.scale)

    def disparity_range(self, whole: tuple[float, float] | None) -> tuple[float, float] | None:
        return whole and (whole[0] * self.scale, whole[1] * self.scale)

    def camera(self, whole: Camera | None) -> Camera | None:
        return whole and whole.crop(self.x, self.y, self.width, self.height).scaled(self.scale)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def _cut(self, whole: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return whole[self.slices]


def _kind(view: npt.NDArray[Any]) -> str:
    height, width, channels = view.shape
    return f"{width}x{height} px, {'grey' if channels == 1 else 'colour'}, {view.dtype}"
