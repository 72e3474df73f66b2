"""The light field: a grid of views of one scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.showing import show

FULL_SCALE: Mapping[str, float] = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
"""The value of white for each sample type that views may have."""

# Rec. 601 luma: what published methods of this family mean by "grey".
LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in luma."""


def luma(samples: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Rec. 601 luma, 0.299 R + 0.587 G + 0.114 B, of samples (..., C), C = 1 or 3, in their own unit."""
    values = samples.astype(np.float32)
    return values[..., 0] if samples.shape[-1] == 1 else np.asarray(values @ LUMA, np.float32)


def unit(samples: npt.NDArray[Any], white: float) -> npt.NDArray[np.float32]:
    """Samples of any kind and shape, float32, white at 1."""
    return np.asarray(samples.astype(np.float32) / np.float32(white), np.float32)


def reference_index(grid: tuple[int, int]) -> tuple[int, int]:
    """Row and column of the reference view in a grid of (V, U) views: its middle, the later one of two."""
    return grid[0] // 2, grid[1] // 2


def grid_offsets(grid: tuple[int, int]) -> npt.NDArray[np.float64]:
    """Where views of a regular grid stand: (V, U, 2) view steps down and across from the reference view."""
    v, u = reference_index(grid)
    steps = np.mgrid[-v : grid[0] - v, -u : grid[1] - u]
    return np.ascontiguousarray(np.moveaxis(steps, 0, 2), np.float64)


@dataclass(frozen=True, eq=False)
class LightField:
    """Views of one scene from a regular grid of cameras.

    The reference view is ``views[V // 2, U // 2]``; view indices u (to the right) and v (down) count from it.
    A pixel (x, y) of the reference view with disparity D appears in view (u, v) at (x - D·u, y - D·v), so
    positive disparity (px per view step) is nearer than the focus distance.

    Parameters
    ----------
    views : ndarray, shape (V, U, H, W, C)
        uint8, uint16 or float32 with white at 255, 65535 and 1.0; C = 1 (grey) or 3 (RGB).
        Float views lie in [0, 1]. V and U may be odd or even, and one of them may be 1.
    camera : Camera, optional
        Needed only for metres.
    disparity_range : tuple of float, optional
        (smallest, largest) disparity in the scene, px per view step.
    truth : ndarray, shape (H, W), optional
        Exact disparity of the reference view, float32; NaN or infinite where it is unknown.
    masks : mapping of str to ndarray, optional
        Named regions of the reference view, (H, W) bool.
    present : ndarray, shape (V, U), optional
        True where a view exists; missing views are zero and must not be used. None: all exist.
    positions : ndarray, shape (V, U, 2), optional
        Known offsets of the cameras from the regular grid: (down, right), in steps of the grid; float64, 0
        for the reference view. View (v, u) from the reference view then shows a pixel (x, y) with disparity D
        at (x - D·(u + right), y - D·(v + down)). None: all are on the grid.
    white_level : float, optional
        Value of white in the file, if that is not its type's; samples were scaled from it to `full_scale`.
    remarks : tuple of str
        What reading found out or ignored, a sentence each, for people to read.
    name : str
        Short name for messages and tables.

    Raises
    ------
    LightFieldError
        If any of the above does not hold.

    Examples
    --------
    A wall at disparity 1 in 3×3 views, as an array of your own:

    >>> import numpy as np
    >>> import lfdepth
    >>> wall = np.random.default_rng(0).integers(0, 256, (66, 66, 1), np.uint8)
    >>> views = np.array([[wall[v : v + 64, u : u + 64] for u in range(3)] for v in range(3)])
    >>> lf = lfdepth.LightField(views, disparity_range=(0, 2), name="wall")
    >>> lf.shape
    (3, 3, 64, 64, 1)
    >>> lf.centre
    (1, 1)
    >>> np.array_equal(lf.reference[:, 1:], lf.views[1, 2][:, :-1])  # one px to the left per view step
    True
    """

    views: npt.NDArray[Any]
    camera: Camera | None = None
    disparity_range: tuple[float, float] | None = None
    truth: npt.NDArray[np.float32] | None = None
    masks: Mapping[str, npt.NDArray[np.bool_]] = field(default_factory=dict)
    present: npt.NDArray[np.bool_] | None = None
    positions: npt.NDArray[np.float64] | None = None
    white_level: float | None = None
    remarks: tuple[str, ...] = ()
    name: str = "light field"

    def __post_init__(self) -> None:
        self._check_views()
        self._check_present()
        self._check_positions()
        if self.disparity_range is not None:
            check_range(self.disparity_range, f"{self.name}: disparity range")
        if self.truth is not None:
            self._check_map("truth", self.truth, np.dtype(np.float32))
        for key, mask in self.masks.items():
            self._check_map(f"mask {key!r}", mask, np.dtype(np.bool_))
        if self.camera and (self.camera.height, self.camera.width) != self.views.shape[2:4]:
            found = f"camera is for {self.camera.width}x{self.camera.height} px"
            raise self._error(
                found, f"the views' {self.width}x{self.height}", "apply the same crop and scale to both"
            )

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """(V, U, H, W, C)."""
        v, u, h, w, c = self.views.shape
        return v, u, h, w, c

    @property
    def height(self) -> int:
        """Rows of a view."""
        return self.shape[2]

    @property
    def width(self) -> int:
        """Columns of a view."""
        return self.shape[3]

    @property
    def centre(self) -> tuple[int, int]:
        """Grid position (V // 2, U // 2) of the reference view."""
        return reference_index(self.shape[:2])

    @property
    def offsets(self) -> npt.NDArray[np.float64]:
        """Where views are: (V, U, 2) view steps down and across from the reference view."""
        grid = grid_offsets(self.shape[:2])
        return grid if self.positions is None else grid + self.positions

    @property
    def available(self) -> npt.NDArray[np.bool_]:
        """(V, U), True where a view exists: `present`, spelt out."""
        return np.ones(self.shape[:2], np.bool_) if self.present is None else self.present

    @property
    def reference(self) -> npt.NDArray[Any]:
        """The reference view, (H, W, C)."""
        view: npt.NDArray[Any] = self.views[self.centre]
        return view

    @property
    def full_scale(self) -> float:
        """The value of white: 255, 65535 or 1."""
        return FULL_SCALE[self.views.dtype.name]

    def _repr_html_(self) -> str:
        """For notebooks: the reference view and what is known."""
        return str(show("light_field_html", self))

    def _repr_png_(self) -> bytes:
        """For notebooks: the reference view."""
        return bytes(show("light_field_png", self))

    def grey(self) -> npt.NDArray[Any]:
        """Luma of every view (Rec. 601: 0.299 R + 0.587 G + 0.114 B).

        Returns
        -------
        ndarray, shape (V, U, H, W)
            uint8, rounded, for 8-bit views; float32 scaled to 0..255 for all others.
        """
        v, u, h, w, channels = self.shape
        eight_bit = self.views.dtype == np.uint8
        if eight_bit and channels == 1:
            grey: npt.NDArray[Any] = self.views[..., 0]
            return grey
        grey = np.empty((v, u, h, w), dtype=np.uint8 if eight_bit else np.float32)
        scale = np.float32(255 / self.full_scale)
        for index in np.ndindex(v, u):  # view by view: a float copy of all of them would be large
            levels = luma(self.views[index]) * scale
            grey[index] = np.rint(levels) if eight_bit else levels
        return grey

    def epi_horizontal(self, y: int) -> npt.NDArray[Any]:
        """Epipolar-plane image (U, W, C) of row y in the central row of views."""
        self._check_index("y", y, self.height)
        epi: npt.NDArray[Any] = self.views[self.centre[0], :, y]
        return epi

    def epi_vertical(self, x: int) -> npt.NDArray[Any]:
        """Epipolar-plane image (V, H, C) of column x in the central column of views."""
        self._check_index("x", x, self.width)
        epi: npt.NDArray[Any] = self.views[:, self.centre[1], :, x]
        return epi

    def with_samples(self, dtype: str) -> LightField:
        """The same with samples of another type, scaled so that white stays white.

        Parameters
        ----------
        dtype
            "uint8", "uint16" or "float32". To fewer bits, samples are rounded.

        Raises
        ------
        LightFieldError
            If views cannot have samples of that type.
        """
        if dtype not in FULL_SCALE:
            raise self._error(f"samples {dtype!r}", ", ".join(FULL_SCALE), "choose one of these")
        if dtype == self.views.dtype:
            return self
        factor = FULL_SCALE[dtype] / self.full_scale
        views = np.empty(self.shape, dtype)
        for index in np.ndindex(*self.shape[:2]):  # view by view: a float copy of all of them would be large
            scaled = self.views[index] * np.float64(factor)
            views[index] = scaled if dtype == "float32" else np.rint(scaled)
        return replace(self, views=views)

    def angular_crop(self, v: int, u: int) -> LightField:
        """Keep v × u views around the reference view, which stays the same.

        Raises
        ------
        LightFieldError
            If the light field has fewer views, or so few are left that it is none.
        """
        rows = angular_window(self.shape[0], v, self.name)
        columns = angular_window(self.shape[1], u, self.name)
        present = None if self.present is None else self.present[rows, columns]
        positions = None if self.positions is None else self.positions[rows, columns]
        return replace(self, views=self.views[rows, columns], present=present, positions=positions)

    def crop(self, x: int, y: int, width: int, height: int) -> LightField:
        """Keep the window of every view whose top left pixel is (x, y).

        Raises
        ------
        LightFieldError
            If the window does not lie inside the views.
        """
        check_window((x, y, width, height), (self.width, self.height), self.name)
        rows, columns = slice(y, y + height), slice(x, x + width)
        return replace(
            self,
            views=self.views[:, :, rows, columns],
            camera=self.camera and self.camera.crop(x, y, width, height),
            truth=None if self.truth is None else self.truth[rows, columns],
            masks={key: mask[rows, columns] for key, mask in self.masks.items()},
        )

    def _check_views(self) -> None:
        views = self.views
        if views.ndim != 5 or views.shape[4] not in (1, 3):
            raise self._error(
                f"views have shape {views.shape}", "(V, U, H, W, C) with C = 1 or 3", "reorder the axes"
            )
        if views.shape[:2] == (1, 1) or 0 in views.shape:
            raise self._error(
                f"views have shape {views.shape}", "at least two views, with pixels", "add views"
            )
        if views.dtype.name not in FULL_SCALE:
            raise self._error(f"views are {views.dtype}", "uint8, uint16 or float32", "convert them")
        if views.dtype == np.float32:
            low, high = float(views.min()), float(views.max())
            if not (low >= 0 and high <= 1):  # also catches NaN
                raise self._error(
                    f"float views span [{low:g}, {high:g}]", "finite values in [0, 1]", "scale or repair them"
                )

    def _check_present(self) -> None:
        if self.present is None:
            return
        if self.present.shape != self.views.shape[:2] or self.present.dtype != np.bool_:
            found = f"present is {self.present.dtype} {self.present.shape}"
            raise self._error(found, f"bool {self.views.shape[:2]}", "pass one flag per view")
        if not self.present[self.centre]:
            raise self._error(
                f"reference view {self.centre} is absent", "it to be present", "choose another grid"
            )

    def _check_positions(self) -> None:
        positions = self.positions
        if positions is None:
            return
        if positions.shape != (*self.views.shape[:2], 2) or positions.dtype != np.float64:
            found = f"positions are {positions.dtype} {positions.shape}"
            expected = f"float64 {(*self.views.shape[:2], 2)}"
            raise self._error(found, expected, "give an offset for each view")
        if not np.isfinite(positions).all() or positions[self.centre].any():
            raise self._error(
                "positions are not finite, or not 0 for the reference view",
                "offsets from the regular grid in view steps",
                "count them from the reference view",
            )

    def _check_map(self, what: str, array: npt.NDArray[Any], dtype: np.dtype[Any]) -> None:
        if array.shape != self.views.shape[2:4] or array.dtype != dtype:
            found = f"{what} is {array.dtype} {array.shape}"
            raise self._error(found, f"{dtype} {self.views.shape[2:4]}, the views' size", "crop or resize it")

    def _check_index(self, axis: str, index: int, size: int) -> None:
        if not 0 <= index < size:
            raise self._error(f"{axis} = {index}", f"0 to {size - 1}", "choose a line inside the views")

    def _error(self, found: str, expected: str, remedy: str) -> LightFieldError:
        return LightFieldError(f"{self.name}: {found}; expected {expected}; {remedy}")


def check_range(disparity_range: tuple[float, float], what: str = "range") -> tuple[float, float]:
    """The range as two finite, ordered floats.

    Raises
    ------
    LightFieldError
        Otherwise; it calls the range `what`.
    """
    low, high = (float(end) for end in disparity_range)
    if not (isfinite(low) and isfinite(high)):
        raise LightFieldError(
            f"{what}: found [{low:g}, {high:g}], expected finite numbers in px per view step; give both ends"
        )
    if low >= high:
        raise LightFieldError(
            f"{what}: found [{low:g}, {high:g}], expected MIN below MAX (positive is nearer); swap or "
            "widen the ends"
        )
    return low, high


def check_window(window: tuple[int, int, int, int], size: tuple[int, int], what: str) -> None:
    """Raise LightFieldError unless the window (x, y, width, height) lies inside a picture of size (W, H)."""
    x, y, width, height = window
    if not (
        x >= 0 and y >= 0 and width > 0 and height > 0 and x + width <= size[0] and y + height <= size[1]
    ):
        raise LightFieldError(
            f"{what}: crop {x} {y} {width} {height} (x y width height) leaves the views; "
            f"expected a window inside {size[0]}x{size[1]} px; choose a smaller one"
        )


def angular_window(available: int, wanted: int, what: str) -> slice:
    """Slice of one grid axis that keeps `wanted` views and the same reference view."""
    if not 1 <= wanted <= available:
        raise LightFieldError(
            f"{what}: {wanted} views asked for along an axis that has {available}; "
            f"expected 1 to {available}; choose fewer"
        )
    start = available // 2 - wanted // 2
    return slice(start, start + wanted)
