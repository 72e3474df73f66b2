"""What the writers of maps are given."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from lfdepth.camera import Camera
    from lfdepth.lightfield import LightField
    from lfdepth.result import Result


@dataclass(frozen=True, eq=False)
class Record:
    """A map of the reference view and what is known of it.

    Parameters
    ----------
    values : ndarray, shape (H, W)
        float32.
    quantity, unit : str
        What the values are, for formats that can say so.
    confidence : ndarray, shape (H, W), optional
        float32 in [0, 1].
    sigma : ndarray, shape (H, W), optional
        float32, standard error in the map's unit.
    range : tuple of float, optional
        The disparities swept, px per view step.
    runtime : float, optional
        Seconds.
    parameters : str, optional
        The method's fields as JSON.
    """

    values: npt.NDArray[np.float32]
    quantity: str = "disparity"
    unit: str = "px per view step"
    confidence: npt.NDArray[np.float32] | None = None
    sigma: npt.NDArray[np.float32] | None = None
    range: tuple[float, float] | None = None
    runtime: float | None = None
    parameters: str | None = None

    def arrays(self) -> dict[str, npt.NDArray[np.float32]]:
        """The maps by name: under its quantity's the values, then what there is of confidence and sigma."""
        maps = {self.quantity: self.values, "confidence": self.confidence, "sigma": self.sigma}
        return {name: array for name, array in maps.items() if array is not None}


def as_record(result: Result | Record | npt.NDArray[Any]) -> Record:
    """Wrap a result or a bare disparity map; a record stays what it is.

    Raises
    ------
    LightFieldError
        If the map is not two-dimensional, empty, or not finite.
    """
    if isinstance(result, Record):
        return result
    if isinstance(result, np.ndarray):
        return Record(checked_map(result, "disparity"))
    return Record(
        checked_map(result.disparity, "disparity"),
        confidence=checked_map(result.confidence, "confidence"),
        sigma=None if result.sigma is None else checked_map(result.sigma, "sigma"),
        range=result.range,
        runtime=result.runtime,
        parameters=json.dumps(result.method.as_dict()),
    )


def as_depth(record: Record, camera: Camera) -> Record:
    """Turn disparity and its standard error into metres; infinity where a pixel is infinitely far away.

    The error is that towards the camera, which is the smaller one.
    """
    depth = camera.disparity_to_depth(record.values).astype(np.float32)
    sigma = None
    if record.sigma is not None:
        nearer = camera.disparity_to_depth(record.values + record.sigma).astype(np.float32)
        with np.errstate(invalid="ignore"):
            sigma = np.where(np.isinf(depth), np.float32(np.inf), depth - nearer)
    return replace(record, values=depth, sigma=sigma, quantity="depth", unit="m")


def check_size(values: npt.NDArray[Any], lf: LightField, what: str) -> None:
    """Raise LightFieldError unless a map (H, W) has the size of the views."""
    if values.shape != (lf.height, lf.width):
        raise LightFieldError(
            f"{what}: found {values.shape[1]}x{values.shape[0]} px, expected {lf.width}x{lf.height} "
            f"like the views of {lf.name}; apply the same crop and scale to both"
        )


def checked_map(values: npt.NDArray[Any], what: str, *, finite: bool = True) -> npt.NDArray[np.float32]:
    """Return a (H, W) map as float32, or raise LightFieldError if it is none, or not finite."""
    if values.ndim != 2 or values.size == 0 or values.dtype.kind not in "fiu":
        raise LightFieldError(
            f"{what}: {values.dtype} array of shape {values.shape}; expected numbers of shape (H, W); "
            "give a single map"
        )
    if finite and (bad := int(np.count_nonzero(~np.isfinite(values)))):
        raise LightFieldError(
            f"{what}: {bad} of {values.size} values are NaN or infinite; expected finite values; "
            "repair the map"
        )
    return values.astype(np.float32, copy=False)
