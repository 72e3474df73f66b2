"""What an estimate gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.showing import show

if TYPE_CHECKING:
    from lfdepth.methods.base import Method
    from lfdepth.probe.brightness import Equalisation
    from lfdepth.probe.checks import Checks


@dataclass(frozen=True, eq=False)
class Result:
    """A disparity map with its evidence.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step, positive nearer.
    confidence
        (H, W) float32 in [0, 1]: how well the evidence supports the disparity.
    range
        (min, max) disparity that was searched.
    planes
        Number of planes that were searched; 0 for a method without planes.
    runtime
        Seconds for the estimate, without reading, and without compiling if that was done before.
    method
        The method with all its parameters.
    engine
        Name of the engine.
    version
        Version of lfdepth.
    range_found
        Whether the range was estimated from the views because none was given.
    equalisation
        How the brightness of the views differed; None if it was not measured.
    sigma
        (H, W) float32, standard error in px per view step: the errors of about 68 % of the pixels that are
        not outliers lie within it; None if the method gives none, or without refinement.
    checks
        Whether the views agree with the map, and what may be wrong; None if that was not checked.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> result = lfdepth.estimate(scenes.render("bars", size=64, views=5), effort="fast")
    >>> result.disparity.shape, result.disparity.dtype
    ((64, 64), dtype('float32'))
    >>> result.method.name, result.planes
    ('fbs-vis', 51)
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    range: tuple[float, float]
    planes: int
    runtime: float
    method: Method
    engine: str
    version: str
    range_found: bool = False
    equalisation: Equalisation | None = None
    sigma: NDArray[np.float32] | None = None
    checks: Checks | None = None

    def to_xarray(self) -> Any:
        """The maps as an `xarray.Dataset`.

        Returns
        -------
        xarray.Dataset
            Variables disparity, confidence and, where it is known, sigma, over the dimensions y and x; units
            in their attributes, the method and its parameters in those of the dataset.

        Raises
        ------
        LightFieldError
            If xarray is not installed.
        """
        try:
            xarray = import_module("xarray")
        except ImportError:
            raise LightFieldError(
                "to_xarray: the package xarray is not installed; expected it; run: pip install xarray"
            ) from None
        units = {"disparity": "px per view step", "confidence": "1", "sigma": "px per view step"}
        maps = {name: getattr(self, name) for name in units}
        height, width = self.disparity.shape
        return xarray.Dataset(
            {
                name: (("y", "x"), values, {"units": units[name]})
                for name, values in maps.items()
                if values is not None
            },
            coords={
                "y": ("y", np.arange(height), {"units": "px"}),
                "x": ("x", np.arange(width), {"units": "px"}),
            },
            attrs={
                "method": self.method.name,
                "parameters": str(self.method.parameters()),
                "range": self.range,
                "version": self.version,
            },
        )

    def _repr_html_(self) -> str:
        """For notebooks: the map, its range, and the checks."""
        return str(show("result_html", self))

    def _repr_png_(self) -> bytes:
        """For notebooks: the map."""
        return bytes(show("result_png", self))


@dataclass(frozen=True, eq=False)
class ViewMaps:
    """Disparity of every view of a light field.

    Attributes
    ----------
    disparity
        (V, U, H, W) float32, px per view step, positive nearer; NaN for absent views.
    confidence
        (V, U, H, W) float32 in [0, 1]; 0 for absent views.
    visible
        (V, U, H, W) bool: pixels whose surface the reference view shows as well.
    reference
        The reference view's own estimate, from which the maps were made.
    consistency
        Share of the pixels that hold in the views they were compared with: some pixel around the place they
        land on has their disparity within 0.1 px per view step. Where something nearer is there, a pixel is
        hidden and does not count.
    runtime
        Seconds for all of it.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> maps = lfdepth.estimate_views(scenes.render("bars", size=64, views=3), "fbs-sfa", planes=10)
    >>> maps.disparity.shape, maps.disparity.dtype
    ((3, 3, 64, 64), dtype('float32'))
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    visible: NDArray[np.bool_]
    reference: Result
    consistency: float
    runtime: float

    def of(self, view: tuple[int, int]) -> Result:
        """The map of one view, at row and column of the grid, as a result of its own.

        Raises
        ------
        LightFieldError
            If there is no such view.
        """
        rows, columns = self.disparity.shape[:2]
        v, u = view
        if not (0 <= v < rows and 0 <= u < columns):
            raise LightFieldError(
                f"view {v},{u} asked for; expected a row from 0 to {rows - 1} and a column from 0 to "
                f"{columns - 1}; choose one of these"
            )
        return replace(
            self.reference,
            disparity=self.disparity[view],
            confidence=self.confidence[view],
            runtime=self.runtime,
            sigma=None,
            checks=None,
        )
