"""The camera of a light field, and the way from disparity to metres."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from math import inf, isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError

Float = npt.NDArray[np.floating[Any]]

_MM_PER_M = 1000.0


@dataclass(frozen=True)
class Camera:
    """Pinhole cameras on a regular grid, shifted (not rotated), whose pictures agree at the focus distance.

    The focus distance is where disparity is zero.

    Parameters
    ----------
    focal_length_mm : float
        Focal length f, > 0.
    sensor_size_mm : float
        Length s of the sensor's longer side, > 0; the longer side of the picture covers it.
    baseline_mm : float
        Distance b between neighbouring views, > 0.
    focus_distance_m : float
        Depth of zero disparity, > 0; infinity for parallel cameras whose pictures were not shifted.
    width, height : int
        Size of a view in pixels.
    centre : tuple of float, optional
        Pixel (x, y) that the optical axis of the reference view meets; the picture's middle by default.

    Raises
    ------
    LightFieldError
        If a value is not positive, or not finite where it has to be.

    Notes
    -----
    The 4D Light Field Benchmark's geometry (Honauer et al. 2016, doi:10.1007/978-3-319-54187-7_2). With
    the pixel pitch p = s / max(width, height), ``disparity = b·f / p · (1/Z - 1/F)`` px per view step.

    Examples
    --------
    The camera of the benchmark's scene "cotton". A disparity of 0 is at the focus distance:

    >>> import lfdepth
    >>> camera = lfdepth.Camera(
    ...     focal_length_mm=100, sensor_size_mm=35, baseline_mm=25, focus_distance_m=7, width=512, height=512
    ... )
    >>> camera.disparity_to_depth([-1.0, 0.0, 1.0]).round(2)
    array([8.66, 7.  , 5.88])
    >>> camera.depth_to_disparity(5.0).round(2)
    np.float64(2.09)
    >>> camera.points([[0.0] * 512] * 512).shape
    (512, 512, 3)
    """

    focal_length_mm: float
    sensor_size_mm: float
    baseline_mm: float
    focus_distance_m: float
    width: int
    height: int
    centre: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("focal_length_mm", "sensor_size_mm", "baseline_mm", "width", "height"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise LightFieldError(f"camera: {name} is {value}; expected a positive number; change it")
        if not self.focus_distance_m > 0:
            raise LightFieldError(
                f"camera: focus_distance_m is {self.focus_distance_m}; expected a positive number of metres, "
                "or inf for parallel cameras; change it"
            )

    @property
    def pixel_pitch_mm(self) -> float:
        """Side of one pixel on the sensor, mm."""
        return self.sensor_size_mm / max(self.width, self.height)

    @property
    def principal_point(self) -> tuple[float, float]:
        """Pixel (x, y) on the optical axis; pixel centres have whole coordinates."""
        return self.centre or ((self.width - 1) / 2, (self.height - 1) / 2)

    @property
    def _disparity_metres(self) -> float:
        """Disparity times (1/Z - 1/F in 1/m) of a point: b·f/p in px·m."""
        return self.baseline_mm * self.focal_length_mm / self.pixel_pitch_mm / _MM_PER_M

    def disparity_to_depth(self, disparity: npt.ArrayLike) -> Float:
        """Depth Z along the optical axis, in metres.

        Parameters
        ----------
        disparity : array_like
            Disparity in px per view step, any shape.

        Returns
        -------
        ndarray
            Metres, same shape, > 0. Disparity at or below that of a point infinitely far away gives ``inf``.
        """
        d = np.asarray(disparity, dtype=np.float64)
        inverse = d / self._disparity_metres + 1 / self.focus_distance_m
        return np.divide(1.0, inverse, out=np.full_like(inverse, np.inf), where=~(inverse <= 0))

    def depth_to_disparity(self, depth: npt.ArrayLike) -> Float:
        """Disparity in px per view step of points at a depth.

        Parameters
        ----------
        depth : array_like
            Depth Z in metres, > 0, any shape; ``inf`` is legal.

        Returns
        -------
        ndarray
            Disparity, same shape.

        Raises
        ------
        LightFieldError
            If a depth is zero or negative.
        """
        z = np.asarray(depth, dtype=np.float64)
        if np.any(z <= 0):
            raise LightFieldError(
                f"depth: smallest value is {np.nanmin(z):g} m; expected depths > 0 in front of the camera; "
                "check the sign and the unit (metres)"
            )
        return np.asarray(self._disparity_metres * (1 / z - 1 / self.focus_distance_m))

    def points(self, disparity: npt.ArrayLike) -> Float:
        """Points in metres of a disparity map of the reference view.

        Parameters
        ----------
        disparity : array_like, shape (H, W)
            Disparity in px per view step, of the camera's height and width.

        Returns
        -------
        ndarray, shape (H, W, 3)
            X to the right, Y down, Z forward from the reference view, in metres; not finite where the
            depth is not.

        Raises
        ------
        LightFieldError
            If the map does not have the camera's size.
        """
        depth = self.disparity_to_depth(disparity)
        if depth.shape != (self.height, self.width):
            raise LightFieldError(
                f"disparity: shape is {depth.shape}; expected the camera's (height, width) = "
                f"{(self.height, self.width)}; crop or scale the camera with the picture"
            )
        cx, cy = self.principal_point
        step = self.pixel_pitch_mm / self.focal_length_mm
        rays_x = (np.arange(self.width) - cx) * step
        rays_y = (np.arange(self.height) - cy) * step
        with np.errstate(invalid="ignore"):  # 0 · inf on the optical axis
            return np.stack([rays_x * depth, rays_y[:, None] * depth, depth], axis=-1)

    def crop(self, x: int, y: int, width: int, height: int) -> Camera:
        """Camera of a window of the picture: same rays, same pixel pitch."""
        if (x, y, width, height) == (0, 0, self.width, self.height):
            return self
        cx, cy = self.principal_point
        return replace(
            self,
            sensor_size_mm=self.pixel_pitch_mm * max(width, height),
            width=width,
            height=height,
            centre=(cx - x, cy - y),
        )

    def scaled(self, scale: float) -> Camera:
        """Camera of the picture shrunk by a factor: same rays, larger pixels.

        Pixel x of the small picture has its centre at ``(x + 1/2) / scale - 1/2`` of the large one.
        """
        if scale == 1:
            return self
        width, height = int(self.width * scale + 1e-9), int(self.height * scale + 1e-9)
        cx, cy = self.principal_point
        return replace(
            self,
            sensor_size_mm=self.pixel_pitch_mm / scale * max(width, height),
            width=width,
            height=height,
            centre=((cx + 0.5) * scale - 0.5, (cy + 0.5) * scale - 0.5),
        )


@dataclass(frozen=True)
class CameraOptions:
    """Values of a camera given by hand; None leaves what the file says.

    Parameters
    ----------
    baseline_mm, focal_length_mm, sensor_size_mm, focus_distance_m : float, optional
        As in `Camera`, for the whole views before any crop. Where the file knows no camera, the first three
        are needed together, and the focus distance is infinite unless given: parallel cameras.
    """

    baseline_mm: float | None = None
    focal_length_mm: float | None = None
    sensor_size_mm: float | None = None
    focus_distance_m: float | None = None

    def apply(self, known: Camera | None, width: int, height: int) -> Camera | None:
        """Camera of views of a size, from these values over the known ones; None if there are neither.

        Raises
        ------
        LightFieldError
            If some values are given but one that is needed is not, or a value is impossible.
        """
        given = {name: value for name, value in asdict(self).items() if value is not None}
        if known:
            return replace(known, **given)
        if not given:
            return None
        absent = [f.name for f in fields(self)[:3] if f.name not in given]
        if absent:
            raise LightFieldError(
                f"camera: {', '.join(given)} given but not {', '.join(absent)}; expected all of baseline_mm, "
                "focal_length_mm and sensor_size_mm, since the file names no camera; give the others too"
            )
        return Camera(**{"focus_distance_m": inf, "width": width, "height": height} | given)
