"""Folders of the 4D Light Field Benchmark (Honauer et al. 2016, doi:10.1007/978-3-319-54187-7_2)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from configparser import ConfigParser
from configparser import Error as ConfigError
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic_folder
from lfdepth.io.layout import Layout, size
from lfdepth.io.limits import check_grid, check_inside, read_text
from lfdepth.io.pfm import read_pfm, write_pfm
from lfdepth.io.picture import checked_name, read_picture, write_picture
from lfdepth.io.record import Record, checked_map
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField, check_range
from lfdepth.truth import HighResolution

_VIEW = re.compile(r"input_Cam(\d+)\.png")
_CONFIG = "parameters.cfg"


@dataclass(frozen=True)
class _Resolution:
    """Names of the files of one resolution of the truth."""

    word: str

    @property
    def truth(self) -> str:
        return f"gt_disp_{self.word}.pfm"

    def mask(self, name: str) -> str:
        return f"mask_{name}_{self.word}.png"

    def masks(self, folder: Path) -> dict[str, Path]:
        """Masks in a folder by name."""
        found = ((self.mask_name(file.name), file) for file in sorted(folder.iterdir()))
        return {name: file for name, file in found if name}

    def mask_name(self, file: str) -> str | None:
        """Name of the mask that a file holds; None for other files."""
        match = re.fullmatch(rf"mask_(\w+)_{self.word}\.png", file)
        return match and match[1]


_LOW, _HIGH = _Resolution("lowres"), _Resolution("highres")


@dataclass(frozen=True)
class Parameters:
    """What `parameters.cfg` says of a scene."""

    camera: Camera
    grid: tuple[int, int]
    disparity_range: tuple[float, float]


def recognise(path: Path) -> bool:
    """True for a folder that holds `input_CamNNN.png` or `parameters.cfg`."""
    if not path.is_dir():
        return False
    return (path / _CONFIG).exists() or any(_VIEW.fullmatch(file.name) for file in path.iterdir())


def open_benchmark(path: Path, layout: Layout) -> ViewSource:
    """Open a folder with `input_CamNNN.png`, numbered row by row from the top left view.

    `parameters.cfg` gives grid, camera and disparity range. Without it the grid is the one asked for or a
    square, and the light field has no camera and no range. `gt_disp_lowres.pfm` becomes the truth, and every
    `mask_NAME_lowres.png` the mask NAME.

    Raises
    ------
    LightFieldError
        If views are missing and it is not meant, or there are too many; if `parameters.cfg` is garbled or
        contradicts the files or the grid asked for; if the truth is damaged or of another size.
    """
    files = _view_files(path)
    check_inside(path, [*files.values(), path / _CONFIG, path / _LOW.truth])
    parameters = read_parameters(path / _CONFIG) if (path / _CONFIG).exists() else None
    grid = parameters.grid if parameters else layout.of_count(max(files, default=-1) + 1, str(path))
    check_grid(path, grid)
    present = _present(path, files, grid, layout)
    if parameters:
        _check_resolution(next(iter(files.values())), parameters.camera)

    masks, unusable = _usable_masks(_LOW.masks(path), next(iter(files.values())))

    def file(v: int, u: int) -> Path:
        number = v * grid[1] + u
        return files.get(number, path / _view_name(number))

    return ViewSource(
        grid=grid,
        read_view=lambda v, u: read_picture(file(v, u)),
        describe=lambda v, u: str(file(v, u)),
        present=present,
        camera=parameters.camera if parameters else None,
        disparity_range=parameters.disparity_range if parameters else None,
        truth=_read_truth(path / _LOW.truth),
        masks={name: mask > 0 for name, mask in masks.items()},
        unusable=unusable,
        name=path.resolve().name,
    )


def write_benchmark(
    path: Path,
    lf: LightField,
    *,
    high: HighResolution | None = None,
    labels: Mapping[str, npt.NDArray[Any]] | None = None,
    category: str = "",
) -> None:
    """Write a folder in the benchmark's layout, which many tools read.

    A folder is replaced if it is empty or was written so and holds nothing else.

    Parameters
    ----------
    path : Path
        The folder.
    lf : LightField
        Views of 8 or 16 bits, with camera and disparity range.
    high : HighResolution, optional
        Truth and masks at ten times the size, written beside those of the light field.
    labels : mapping of str to (H, W) uint8 array, optional
        Masks with several labels, which those of a light field do not tell apart.
    category : str
        What `parameters.cfg` calls the kind of scene.

    Raises
    ------
    LightFieldError
        If the light field has no camera or no disparity range, both of which `parameters.cfg` has to hold, or
        if its samples are float.
    """
    if lf.views.dtype == np.float32:
        raise LightFieldError(f"{path}: float views; expected 8 or 16 bits; convert them (--samples uint16)")
    if lf.camera is None or lf.disparity_range is None:
        absent = "camera" if lf.camera is None else "disparity range"
        raise LightFieldError(
            f"{path}: the {absent} is unknown, but {_CONFIG} needs it; give it, or write a plain "
            "folder of views"
        )
    with atomic_folder(path) as folder:
        for number, (v, u) in enumerate(np.ndindex(*lf.shape[:2])):
            if lf.present is None or lf.present[v, u]:
                write_picture(folder / _view_name(number), lf.views[v, u])
        name = lf.name if category else path.name
        text = _parameters_text(lf.shape, lf.camera, lf.disparity_range, name, category)
        (folder / _CONFIG).write_text(text, encoding="utf-8")
        _write_truth(folder, _LOW, lf.truth, {**lf.masks, **(labels or {})})
        if high is not None:
            _write_truth(folder, _HIGH, high.truth, high.masks)


def _write_truth(
    folder: Path,
    resolution: _Resolution,
    truth: npt.NDArray[Any] | None,
    masks: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Write truth and masks; masks are black and white, those with several labels keep them."""
    if truth is not None:
        write_pfm(folder / resolution.truth, Record(truth))
    for name, mask in masks.items():
        values = mask.astype(np.uint8)
        if values.max() <= 1:
            values = values * np.uint8(255)
        write_picture(folder / resolution.mask(checked_name(name, folder)), values[..., None])


def _parameters_text(
    shape: tuple[int, ...],
    camera: Camera,
    disparity_range: tuple[float, float],
    name: str,
    category: str,
) -> str:
    x, y = camera.principal_point
    axis = f"principal_point_x_px = {x!r}\nprincipal_point_y_px = {y!r}\n" if camera.centre else ""
    kind = f"category = {category}\n" if category else ""
    return f"""# Written by lfdepth
[intrinsics]
focal_length_mm = {camera.focal_length_mm!r}
image_resolution_x_px = {camera.width}
image_resolution_y_px = {camera.height}
sensor_size_mm = {camera.sensor_size_mm!r}
{axis}
[extrinsics]
num_cams_x = {shape[1]}
num_cams_y = {shape[0]}
baseline_mm = {camera.baseline_mm!r}
focus_distance_m = {camera.focus_distance_m!r}

[meta]
scene = {name}
{kind}disp_min = {disparity_range[0]!r}
disp_max = {disparity_range[1]!r}
"""


def read_parameters(path: Path) -> Parameters:
    """Read the benchmark's `parameters.cfg`.

    Raises
    ------
    LightFieldError
        If the file is unreadable, or a value is missing, no number or out of its range.
    """
    config = ConfigParser(interpolation=None)
    try:
        config.read_string(read_text(path))
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        reason = " ".join(str(error).split())[:100]
        raise LightFieldError(
            f"{path}: garbled ({reason}); expected the benchmark's [intrinsics], [extrinsics] and [meta]; "
            "restore the file, or remove it and give the disparity range yourself"
        ) from None

    def number(section: str, key: str) -> float:
        try:
            return float(config[section][key])
        except (KeyError, ValueError):
            found = config.get(section, key, fallback="missing")
            raise LightFieldError(
                f"{path}: [{section}] {key} is {found}; expected a number; fix the entry"
            ) from None

    def count(section: str, key: str) -> int:
        value = number(section, key)
        if not (value > 0 and value.is_integer()):
            raise LightFieldError(f"{path}: [{section}] {key} is {value:g}; expected a count; fix the entry")
        return int(value)

    disparity_range = number("meta", "disp_min"), number("meta", "disp_max")
    check_range(disparity_range, f"{path}: disp_min to disp_max")
    grid = count("extrinsics", "num_cams_y"), count("extrinsics", "num_cams_x")
    try:
        camera = Camera(
            focal_length_mm=number("intrinsics", "focal_length_mm"),
            sensor_size_mm=number("intrinsics", "sensor_size_mm"),
            baseline_mm=number("extrinsics", "baseline_mm"),
            focus_distance_m=number("extrinsics", "focus_distance_m"),
            width=count("intrinsics", "image_resolution_x_px"),
            height=count("intrinsics", "image_resolution_y_px"),
            centre=_axis(config, number),
        )
    except LightFieldError as error:
        message = str(error)
        raise LightFieldError(message if str(path) in message else f"{path}: {message}") from None
    return Parameters(camera, grid, disparity_range)


def _axis(config: ConfigParser, number: Callable[[str, str], float]) -> tuple[float, float] | None:
    """Where the optical axis is, which only crops have to say; the benchmark has no such values."""
    if not config.has_option("intrinsics", "principal_point_x_px"):
        return None
    return number("intrinsics", "principal_point_x_px"), number("intrinsics", "principal_point_y_px")


def _view_files(path: Path) -> dict[int, Path]:
    """View files by their number, in order."""
    found = {int(match[1]): file for file in path.iterdir() if (match := _VIEW.fullmatch(file.name))}
    return dict(sorted(found.items()))


def _view_name(number: int) -> str:
    return f"input_Cam{number:03d}.png"


def _present(
    path: Path, files: dict[int, Path], grid: tuple[int, int], layout: Layout
) -> npt.NDArray[np.bool_] | None:
    if layout.grid not in (None, grid):
        raise LightFieldError(
            f"{path}: grid of {size(grid)} in {_CONFIG}; expected {size(layout.grid or grid)} as asked for; "
            "change the grid or leave it out"
        )
    count = grid[0] * grid[1]
    surplus = [file for number, file in files.items() if number >= count]
    if surplus:
        raise LightFieldError(
            f"{path}: {len(surplus)} surplus views, first {surplus[0].name}; expected {count} views in a "
            f"grid of {size(grid)}; remove them or correct num_cams_x and num_cams_y in {_CONFIG}"
        )
    present = np.isin(np.arange(count), list(files)).reshape(grid)
    return layout.checked(present, str(path), _view_name(int(np.argmin(present))))


def _check_resolution(file: Path, camera: Camera) -> None:
    height, width, _ = read_picture(file).shape
    if (width, height) != (camera.width, camera.height):
        raise LightFieldError(
            f"{file}: {width}x{height} px; expected {camera.width}x{camera.height} as {_CONFIG} says; "
            "correct image_resolution_x_px and image_resolution_y_px, or the views"
        )


def _read_truth(file: Path) -> npt.NDArray[np.float32] | None:
    """The truth, which may have gaps; None if there is none."""
    return checked_map(read_pfm(file), str(file), finite=False) if file.exists() else None


# --- what scores need beside the light field


def read_high_resolution(folder: Path | str) -> HighResolution | None:
    """Read `gt_disp_highres.pfm` and every `mask_NAME_highres.png` of a benchmark folder.

    Returns
    -------
    HighResolution or None
        None where there is no high-resolution truth. A mask that is damaged or of another size than the truth
        is named in `unusable`, and the rest is read.

    Raises
    ------
    LightFieldError
        If the truth is there but damaged.
    """
    folder = Path(folder)
    if not (folder / _HIGH.truth).exists():
        return None
    check_inside(folder, [folder / _HIGH.truth])
    truth = read_pfm(folder / _HIGH.truth)
    masks, unusable = _masks_of_size(_HIGH.masks(folder), truth.shape)
    return HighResolution(truth, masks, unusable)


def _usable_masks(
    files: Mapping[str, Path], view: Path
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """Masks of the size of a view; the view is read only if there are any."""
    return _masks_of_size(files, read_picture(view).shape[:2]) if files else ({}, {})


def _masks_of_size(
    files: Mapping[str, Path], size: tuple[int, ...]
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """The masks (H, W) that can be used, with their labels, and the reason for each of the others."""
    masks: dict[str, npt.NDArray[Any]] = {}
    unusable: dict[str, str] = {}
    for name, file in files.items():
        try:
            check_inside(file.parent, [file])
            mask = read_picture(file)[..., 0]
        except LightFieldError as error:
            unusable[name] = str(error)
            continue
        if mask.shape == size:
            masks[name] = mask
        else:
            found, expected = (f"{shape[1]}x{shape[0]} px" for shape in (mask.shape, size))
            unusable[name] = f"{file}: {found}; expected {expected}; replace it"
    return masks, unusable
