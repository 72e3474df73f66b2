"""Reading light fields, writing and reading back maps."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera, CameraOptions
from lfdepth.errors import LightFieldError
from lfdepth.io.benchmark import read_high_resolution
from lfdepth.io.formats import FORMATS, Format, find_format
from lfdepth.io.layout import Layout
from lfdepth.io.limits import check_file
from lfdepth.io.maps import (
    POINTS,
    WRITABLE,
    check_ending,
    check_writable,
    is_map,
    read_confidence,
    read_disparity,
    read_record,
    write_map,
)
from lfdepth.io.ply import write_ply
from lfdepth.io.record import Record, as_depth, as_record, checked_map
from lfdepth.io.source import Selection, assemble
from lfdepth.io.stack import unreadable
from lfdepth.io.truth import read_truth
from lfdepth.io.unchanged import unchanged
from lfdepth.io.view_maps import check_view_maps_writable, write_view_maps
from lfdepth.io.white import check_white_level
from lfdepth.io.writing import check_light_field_writable, write_light_field
from lfdepth.lightfield import LightField
from lfdepth.result import Result, ViewMaps

__all__ = [
    "FORMATS",
    "check_light_field_writable",
    "check_view_maps_writable",
    "check_writable",
    "is_map",
    "read",
    "read_confidence",
    "read_disparity",
    "read_high_resolution",
    "read_record",
    "read_truth",
    "write",
]

_ARRAYS = ("npy", "npz", "hdf5", "mat", "zarr")
"""Formats that are one array of views."""


def read(
    path: str | Path,
    *,
    format: str | None = None,
    grid: tuple[int, int] | None = None,
    partial: bool = False,
    pattern: str | None = None,
    axes: str | None = None,
    views: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    scale: float = 1.0,
    transpose: bool = False,
    flip_v: bool = False,
    flip_u: bool = False,
    serpentine: bool = False,
    white_level: float | None = None,
    positions: str | Path | None = None,
    truth: str | Path | npt.NDArray[Any] | None = None,
    truth_scale: float | None = None,
    truth_offset: float = 0.0,
    truth_variable: str | None = None,
    baseline_mm: float | None = None,
    focal_length_mm: float | None = None,
    sensor_size_mm: float | None = None,
    focus_distance_m: float | None = None,
    check: bool = False,
    unusable: dict[str, str] | None = None,
) -> LightField:
    """Read a light field.

    Parameters
    ----------
    path : str or Path
        A file or folder in one of `FORMATS`, which is recognised from its content.
    format : str, optional
        Name of the format, if it is not recognised.
    grid : tuple of int, optional
        (V, U), rows and columns of views as stored, if the files only carry a running number.
    partial : bool
        Accept missing views in any pattern. Otherwise only patterns that are symmetric about the reference
        view (the centre cross, the diagonals) may lack views.
    pattern : str, optional
        Which files in a folder are views, if there are others among them: ``"shot_*.png"``, ``"*/000.png"``.
    axes : str, optional
        Order of an array's axes, if their lengths leave it open: V and U, or N for a running number of views,
        H, W, and C if there is one, such as ``"WHUV"``.
    views : tuple of int, optional
        (V, U) views to read around the reference view, after reordering.
    crop : tuple of int, optional
        Window (x, y, width, height) of every view to read, px of the stored views.
    scale : float
        Factor in (0, 1] by which views shrink after cropping. Disparities, their range, the truth and the
        camera shrink with them.
    transpose, flip_v, flip_u : bool
        Reorder the grid of views: swap its rows and columns, then reverse its rows, its columns. The pictures
        stay as they are. Views numbered column by column are read with ``grid=(U, V), transpose=True``.
    serpentine : bool
        Every second row of views runs backwards, as cameras moved back and forth record them. This is undone
        before the other reorderings.
    white_level : float, optional
        Sample value of white, such as 4095 for 12 bits in a 16-bit file. By default what the file states, or
        an estimate from the samples: for 16 bits, the fewest of 8, 10, 12, 14 or 16 bits that hold all of
        them; for floats beyond 1, see `lfdepth.io.white.find_white`. Samples are scaled to the white of their
        type.
    positions : str or Path, optional
        CSV with `v,u,y,x` for each view: its row and column as stored, and the position of its camera.
    truth : str, Path or (H, W) array, optional
        Disparity of the reference view, instead of what the files say; NaN where it is unknown.
    truth_scale, truth_offset : float
        For truth from a file: disparity = offset + scale · sample.
    truth_variable : str, optional
        Name of the truth in a file with several arrays.
    baseline_mm, focal_length_mm, sensor_size_mm, focus_distance_m : float, optional
        Camera, instead of what the files say; see `lfdepth.Camera`. Values are those of the whole views.
    check : bool
        Check on the pixels whether the grid of views is in order, and refuse it if it is not. If the scene
        does not show it, a warning says so.
    unusable : dict, optional
        Receives the names of masks that are damaged or of another size than the views, with the reason; the
        rest is read. Without it, such a mask is an error.

    Returns
    -------
    LightField
        Holds only what was selected.

    Raises
    ------
    LightFieldError
        If the path does not exist, is not a light field, is damaged, or lacks what was selected; with
        `check`, also if its views are in another order.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> folder = tempfile.mkdtemp()
    >>> lfdepth.write(f"{folder}/bars.npz", scenes.render("bars", size=64, views=5))
    >>> lfdepth.read(f"{folder}/bars.npz").shape
    (5, 5, 64, 64, 3)
    >>> lfdepth.read(f"{folder}/bars.npz", views=(3, 3), scale=0.5).shape
    (3, 3, 32, 32, 3)
    """
    path = Path(path)
    _check_grid(grid)
    camera = CameraOptions(baseline_mm, focal_length_mm, sensor_size_mm, focus_distance_m)
    check_file(path)
    check_white_level(white_level)
    known = find_format(path, format)
    layout = Layout(grid, partial, _checked_pattern(pattern, known), _checked_axes(axes, known))
    if isinstance(truth, (str, Path)):
        truth = read_truth(truth, scale=truth_scale, offset=truth_offset, variable=truth_variable)
    selection = Selection(
        views=views,
        crop=crop,
        scale=scale,
        transpose=transpose,
        flip_v=flip_v,
        flip_u=flip_u,
        serpentine=serpentine,
        white_level=white_level,
        positions=None if positions is None else Path(positions),
        truth=None if truth is None else checked_map(np.asarray(truth), "truth", finite=False),
        camera=camera,
    )
    try:
        with unchanged(path):
            source = known.open(path, layout)
            if source.unusable and unusable is None:
                source.close()
                raise LightFieldError(next(iter(source.unusable.values())))
            lf = assemble(source, selection)
    except OSError as error:  # a folder where a file should be, missing permissions
        raise unreadable(path, error) from None
    if unusable is not None:
        unusable.update(source.unusable)
    if check:
        _check_order(lf, path, selection)
    return lf


def write(
    path: str | Path,
    result: Result | ViewMaps | Record | LightField | npt.NDArray[Any],
    *,
    scene: LightField | None = None,
    quantity: Literal["disparity", "depth"] = "disparity",
    mesh: bool = False,
    format: str | None = None,
) -> None:
    """Write a map, its points, or a light field, in the format that the path's extension selects.

    The output is either complete or absent: it is written under a temporary name, then renamed.

    Parameters
    ----------
    path : str or Path
        For a map, ends in `.pfm`, `.npy`, `.tif`, `.tiff` (the map as float), `.png` (16 bits, its scale in a
        `.json` beside it), `.exr` (map and confidence), `.npz`, `.zarr` (disparity, confidence, range,
        runtime in s, and the method's parameters as JSON) or `.ply` (coloured points, in metres).
        For a light field, ends in `.npz`, `.h5`, `.hdf5`, `.zarr`, `.mat` (the views as array `LF` of shape
        (V, U, H, W, C), and all that is known of them), `.npy`, `.tif`, `.tiff` (a page for each view),
        `_qsCxRaA.png` (a quilt of one row of views); or is a folder, for a picture of each view.
        For the maps of all views, ends in `.npz` or `.zarr` (disparity, confidence, visibility), or is a
        folder, for a PFM file of each view.
    result : Result, ViewMaps, Record, ndarray or LightField
        What `estimate` returned or `read_record` read, a disparity map (H, W) in px per view step, or a light
        field. A light field reads back unchanged: samples, missing views, range and camera, and, from
        folders, `.npz`, `.h5`, `.zarr` and `.mat`, also truth and masks.
    scene : LightField, optional
        The light field of the map; needed for depth and PLY, with its camera.
    quantity : {"disparity", "depth"}
        What the map holds: px per view step, or metres along the optical axis.
    mesh : bool
        PLY only: join the points into a triangle mesh, cut at depth edges.
    format : str, optional
        Light fields only: name of the format, such as "benchmark" for a folder in the benchmark's layout.

    Raises
    ------
    LightFieldError
        If the extension is unknown, the format cannot hold the light field, the map is not finite, metres are
        requested and the camera is unknown, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> folder = tempfile.mkdtemp()
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> result = lfdepth.estimate(lf, "fbs-sfa")
    >>> lfdepth.write(f"{folder}/map.npz", result)  # disparity, confidence, range, parameters
    >>> lfdepth.write(f"{folder}/depth.npy", result, scene=lf, quantity="depth")  # metres
    >>> lfdepth.write(f"{folder}/views", lf)  # a folder of views
    """
    path = Path(path)
    if isinstance(result, ViewMaps):
        if scene is not None or mesh or quantity != "disparity" or format is not None:
            raise LightFieldError(
                f"{path}: maps of all views, with scene, quantity, mesh or format; expected these with one "
                "map; drop them"
            )
        write_view_maps(path, result)
        return
    if isinstance(result, LightField):
        if scene is not None or mesh or quantity != "disparity":
            raise LightFieldError(
                f"{path}: a light field, with scene, quantity or mesh; expected these only with a map; leave "
                "them out"
            )
        write_light_field(path, result, format)
        return
    if format is not None:
        raise LightFieldError(
            f"{path}: a map, with a format; expected that only with a light field; leave it out"
        )
    record = as_record(result)
    check_ending(path, WRITABLE)
    if path.suffix.lower() == POINTS:
        write_ply(path, record, *_with_camera(scene, record.values, path), mesh=mesh)
        return
    if mesh:
        raise LightFieldError(f"{path}: cannot hold a mesh; expected a name ending in {POINTS}; rename it")
    if quantity == "depth":
        record = as_depth(record, _with_camera(scene, record.values, path)[1])
    write_map(path, record)


def _check_order(lf: LightField, path: Path, selection: Selection) -> None:
    """Raise LightFieldError if the views are in another order, warn if that cannot be told."""
    from lfdepth.probe.order import Reordering, check_orientation

    applied = Reordering(selection.transpose, selection.flip_v, selection.flip_u, selection.serpentine)
    found = check_orientation(lf, applied=applied)
    if found.wrong:
        raise LightFieldError(f"{path}: {found.message}; in Python {found.call}")
    if not found.decided:
        warnings.warn(f"{path}: {found.message}", stacklevel=3)


def _check_grid(grid: tuple[int, int] | None) -> None:
    if grid is not None and min(grid) < 1:
        raise LightFieldError(
            f"grid: {grid[0]} rows and {grid[1]} columns; expected at least one of each; change it"
        )


def _checked_pattern(pattern: str | None, known: Format) -> str | None:
    if pattern is not None and known.name != "folder":
        raise LightFieldError(
            f"pattern: given for {known.what}; expected it only with a folder of views; leave it out"
            + (", or read it as a plain folder (format)" if known.name == "benchmark" else "")
        )
    return pattern


def _checked_axes(axes: str | None, known: Format) -> str | None:
    if axes is None:
        return None
    axes = axes.upper()
    if known.name not in _ARRAYS:
        raise LightFieldError(
            f"axes: given for {known.what}; expected them only with an array ({', '.join(_ARRAYS)}); leave "
            "them out"
        )
    if "".join(sorted(axes.replace("C", "", 1))) not in ("HUVW", "HNW"):
        raise LightFieldError(
            f"axes {axes!r}: unknown; expected V and U, or N for a running number of views, H, W, and C "
            "if there is one, each once, such as VUHWC; change them"
        )
    return axes


def _with_camera(scene: LightField | None, values: npt.NDArray[Any], path: Path) -> tuple[LightField, Camera]:
    """The scene and its camera, if they say what metres need."""
    if scene is None or scene.camera is None:
        raise LightFieldError(
            f"{path}: the camera is unknown, but metres need it; give the scene with its baseline_mm, "
            "focal_length_mm, sensor_size_mm and focus_distance_m"
        )
    if scene.shape[2:4] != values.shape:
        raise LightFieldError(
            f"{scene.name}: views are {scene.width}x{scene.height} px; expected the map's "
            f"{values.shape[1]}x{values.shape[0]}; apply the same crop and scale to both"
        )
    return scene, scene.camera
