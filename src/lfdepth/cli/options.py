"""Options that several commands share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter, Token

from lfdepth import methods
from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lfdepth.lightfield import LightField
    from lfdepth.probe.order import Orientation
    from lfdepth.result import Result

DEFAULT_METHOD = methods.DEFAULT

Flag = Annotated[bool, Parameter(negative=(), show_default=False)]
Json = Annotated[
    bool,
    Parameter(
        name="--json",
        negative=(),
        show_default=False,
        help="Print a single JSON object on standard output, and nothing else.",
    ),
]


def _view(_: Any, tokens: Sequence[Token]) -> tuple[int, int]:
    """(row, column) from V,U."""
    match = re.fullmatch(r"(\d+),(\d+)", tokens[0].value)
    if not match:
        raise ValueError(f"found {tokens[0].value!r}, expected V,U (row and column from 0) such as 0,8")
    return int(match[1]), int(match[2])


def _memory(_: Any, tokens: Sequence[Token]) -> float:
    """Bytes from a number with a unit."""
    match = re.fullmatch(r"([0-9.]+)\s*([KMGT]?)B?", tokens[0].value, re.I)
    try:
        number = float(match[1]) if match else 0.0
    except ValueError:
        number = 0.0
    if match is None or number <= 0:
        raise ValueError(f"found {tokens[0].value!r}, expected a size such as 2GB or 500MB")
    return number * float(1000 ** " KMGT".index(match[2].upper() or " "))


Memory = Annotated[float | None, Parameter(converter=_memory, n_tokens=1, metavar="SIZE")]
View = Annotated[tuple[int, int] | None, Parameter(converter=_view, n_tokens=1, metavar="V,U")]
Output = Annotated[Path, Parameter(alias="-o")]
Range = Annotated[tuple[float, float] | None, Parameter(metavar="MIN MAX")]


# --- parameters of the methods


def method_parameters(name: str) -> tuple[Any, Any]:
    """Type and default of an argument with the options of a method; None leaves one as the method has it."""
    known = methods.parameters_of(methods.method_class(name)).values()
    options = make_dataclass(
        "MethodOptions",
        [(each.name, Annotated[_type_of(each) | None, _shown(each)], field(default=None)) for each in known],
        namespace={"__module__": __name__},
        kw_only=True,
        frozen=True,
    )
    group = Group(
        f"Parameters of {name}",
        help="For another method's parameters: lfdepth estimate --method NAME --help.",
        sort_key=2,
    )
    return Annotated[options, Parameter(name="*", group=group)], options()


def _type_of(parameter: methods.Parameter) -> Any:
    return Literal[parameter.choices] if parameter.choices else parameter.kind


def _shown(parameter: methods.Parameter) -> Parameter:
    """What the help says of a parameter."""
    symbol = f" ({parameter.spec.symbol})" if parameter.spec.symbol else ""
    values = (
        ""
        if isinstance(parameter.spec, methods.Switch | methods.Word | methods.Text)
        else f" {_capital(parameter.range)}."
    )
    default = parameter.default
    shown = f"{default:g}" if isinstance(default, float) else default
    if isinstance(default, bool):
        shown = "yes" if default else "no"
    numeric = parameter.kind in (int, float)
    return Parameter(
        help=f"{parameter.spec.text.rstrip('.')}{symbol}.{values}",
        show_default=False if default is None else (lambda _: str(shown)),
        converter=(lambda _, tokens: parameter.parse(tokens[0].value)) if numeric else None,
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def method_named_in(arguments: Sequence[str]) -> str:
    """The method that a command line names, or the default one where it names none that there is."""
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        found = following if word == "--method" else word.removeprefix("--method=") if "=" in word else ""
        if found in methods.names():
            return found
    return DEFAULT_METHOD


def given(options: Any) -> dict[str, Any]:
    """Options that were set."""
    return {name: value for name, value in vars(options).items() if value is not None}


# --- how a light field is read


def _grid(_: Any, tokens: Sequence[Token]) -> tuple[int, int]:
    """(V, U) from COLUMNSxROWS, as people write it; one number is a square grid."""
    match = re.fullmatch(r"(\d+)(?:x(\d+))?", tokens[0].value)
    if not match:
        raise ValueError(f"found {tokens[0].value!r}, expected COLUMNSxROWS such as 9x7, or 9 for 9x9")
    return int(match[2] or match[1]), int(match[1])


_GRID = Parameter(converter=_grid, n_tokens=1, metavar="COLUMNSxROWS")

Grid = Annotated[tuple[int, int] | None, _GRID]
NumberOfViews = Annotated[tuple[int, int], _GRID, Parameter(show_default=lambda grid: f"{grid[1]}x{grid[0]}")]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a light field is read.

    Attributes
    ----------
    format
        Format of the scene, if it is not recognised: benchmark, folder, eslf, hdf5, mat, mosaic, npy, npz,
        quilt, tiff, zarr.
    grid
        Grid of views as stored, if the files only carry a running number; 9 means 9x9.
    partial
        Accept a grid with missing views.
    pattern
        Which pictures in a folder are views, such as `shot*.png` or `*/000.png`.
    axes
        Order of an array's axes, such as VUHWC or WHUV, if their lengths leave it open.
    views
        Use only this many views, around the reference view; 3 means 3x3.
    crop
        Use only this window of each view, px.
    scale
        Shrink views by this factor, above 0 and at most 1; disparities shrink with them.
    transpose
        Swap rows and columns of the grid of views.
    flip_u
        Reverse the columns of the grid of views.
    flip_v
        Reverse the rows of the grid of views.
    serpentine
        Every second row of views, as stored, runs backwards.
    white_level
        Sample value of white, such as 4095 for 12 bits in a 16-bit file; by default taken from the file or
        estimated from its samples.
    positions
        Table of camera positions: CSV with v,u,y,x for each view.
    truth
        Disparity of the reference view, px per view step: .pfm, .npy, .npz, .tif, .exr, .zarr, .mat, .h5 or
        .png.
    truth_scale
        Disparity per unit of the truth's samples: disparity = offset + scale · sample.
    truth_offset
        Disparity of sample 0; see --truth-scale.
    truth_variable
        Name of the truth in a file with several arrays.
    baseline_mm
        Distance between neighbouring views, mm.
    focal_mm
        Focal length, mm.
    sensor_mm
        Longer side of the sensor, mm.
    focus_m
        Distance of zero disparity, metres.
    """

    format: str | None = None
    grid: Grid = None
    partial: Flag = False
    pattern: str | None = None
    axes: str | None = None
    views: Grid = None
    crop: Annotated[tuple[int, int, int, int] | None, Parameter(metavar="X Y WIDTH HEIGHT")] = None
    scale: float = 1.0
    transpose: Flag = False
    flip_u: Flag = False
    flip_v: Flag = False
    serpentine: Flag = False
    white_level: float | None = None
    positions: Path | None = None
    truth: Path | None = None
    truth_scale: float | None = None
    truth_offset: float = 0.0
    truth_variable: str | None = None
    baseline_mm: float | None = None
    focal_mm: float | None = None
    sensor_mm: float | None = None
    focus_m: float | None = None

    def read(self, scene: Path, unusable: dict[str, str] | None = None) -> LightField:
        """Read a light field; `unusable` takes the masks that cannot be used, as in `lfdepth.read`."""
        import lfdepth

        return lfdepth.read(scene, unusable=unusable, **self.arguments())

    def arguments(self) -> dict[str, Any]:
        """The same as arguments of `lfdepth.read`."""
        options = dict(vars(self))
        for short, long in _LONG_NAMES.items():
            options[long] = options.pop(short)
        return options

    def given(self) -> dict[str, Any]:
        """Those that were set."""
        usual = AS_IT_IS.arguments()
        return {key: value for key, value in self.arguments().items() if value != usual[key]}

    def check_order(self, lf: LightField) -> Orientation:
        """Test on the pixels whether the views that were read so are in order."""
        from lfdepth.probe.order import Reordering, check_orientation

        return check_orientation(
            lf, applied=Reordering(self.transpose, self.flip_v, self.flip_u, self.serpentine)
        )

    def require_order(self, lf: LightField) -> None:
        """Raise LightFieldError if a range would be looked for in views whose order is wrong."""
        if lf.disparity_range is None and (found := self.check_order(lf)).wrong:
            raise LightFieldError(
                f"{lf.name}: {found.message}; or give --range MIN MAX to use them in this order anyway"
            )

    @property
    def keeps_size(self) -> bool:
        """Whether views keep the size that they have in the files."""
        return self.crop is None and self.scale == 1


_LONG_NAMES = {
    "focal_mm": "focal_length_mm",
    "sensor_mm": "sensor_size_mm",
    "focus_m": "focus_distance_m",
}

ReadingParameters = Annotated[Reading, Parameter(name="*", group=Group("Reading the scene", sort_key=3))]
AS_IT_IS = Reading()


# --- where a disparity map comes from

MapMethod = Annotated[str | None, Parameter(show_default=lambda _: DEFAULT_METHOD)]


@dataclass(frozen=True, kw_only=True)
class MapSource:
    """The disparity map of the reference view: a file, or an estimate.

    Attributes
    ----------
    map
        Disparity map, such as "lfdepth estimate" writes; estimated if left out.
    method
        Method for the estimate; "lfdepth methods" lists them.
    range
        Smallest and largest disparity to search, px per view step; by default the scene's own or, if it has
        none, estimated from the views.
    """

    map: Path | None = None
    method: MapMethod = None
    range: Range = None

    def __post_init__(self) -> None:
        if self.map is not None and (self.method is not None or self.range is not None):
            option = "--range" if self.method is None else "--method"
            raise LightFieldError(f"{option}: found with --map, so nothing is estimated; leave one out")
        if self.method is not None:
            methods.method(self.method)

    def of(self, lf: LightField, reading: Reading, threads: int | None) -> NDArray[np.float32]:
        """The map (H, W)."""
        from lfdepth.io import read_disparity

        return read_disparity(self.map) if self.map else self.result(lf, reading, threads).disparity

    def result(self, lf: LightField, reading: Reading, threads: int | None) -> Result:
        """An estimate, with progress."""
        import lfdepth
        from lfdepth.cli.progress import Progress

        if self.range is None:
            reading.require_order(lf)
        with Progress() as progress:
            method = self.method or DEFAULT_METHOD
            return lfdepth.estimate(lf, method, range=self.range, threads=threads, progress=progress.step)


MapSources = Annotated[MapSource, Parameter(name="*", group=Group("The disparity map", sort_key=2))]
ESTIMATED = MapSource()


# --- checks before long work


def check_picture(path: Path, *, apart_from: Path | None = None) -> None:
    """Raise LightFieldError unless a picture can be written at `path`, and a map is another file."""
    from lfdepth.io.atomic import check_target

    if path.suffix.lower() != ".png":
        raise LightFieldError(f"{path}: pictures are PNG files; expected a name ending in .png; rename it")
    if apart_from is not None and path.resolve() == apart_from.resolve():
        raise LightFieldError(f"{path}: is also the map's file; expected two different files; rename one")
    check_target(path)
