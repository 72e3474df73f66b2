"""The metrics of the 4D Light Field Benchmark and a few of our own, as pure functions on arrays.

The definitions follow Honauer et al., "A Dataset and Evaluation Methodology for Depth Estimation on 4D Light
Fields", ACCV 2016, DOI 10.1007/978-3-319-54187-7_2, and the benchmark's own figures. Three rules hold for
all:

- A border is dropped on every side, 15 px at low and 150 px at high resolution (only `missed_dots` keeps it).
- A pixel whose truth is not finite is not scored.
- A pixel whose estimate is not finite has failed: it counts as bad in every share, and takes the highest
  value a capped or ranked metric knows. Only means of errors (`mse`) leave it out, which is why
  `invalid_pixels` must be read beside them.

Disparities are in px per view step, positive = nearer. Shapes are (H, W); masks are True where a pixel
counts. A function without a scored pixel returns NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from lfdepth.camera import Camera

Array = NDArray[Any]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BADPIX_THRESHOLDS = (0.01, 0.03, 0.07)
"""Thresholds in px per view step at which the benchmark counts bad pixels."""

BUMPINESS_CAP = 0.05
"""Largest value one pixel adds to the bumpiness, so that a step costs no more than a rough surface."""


@dataclass(frozen=True)
class Resolution:
    """A resolution of the truth: its name, its size relative to the views, its border in px."""

    name: Literal["low", "high"]
    factor: int
    border: int


LOW = Resolution("low", factor=1, border=15)
HIGH = Resolution("high", factor=10, border=150)


# --- which pixels are scored --------------------------------------------------------------------------------


def enlarge(estimate: Array, shape: tuple[int, int]) -> Array:
    """Enlarge a map by nearest neighbour, the first and last pixels of both grids lying on each other.

    Parameters
    ----------
    estimate : (h, w) array
    shape : (H, W)
        Size wanted.

    Returns
    -------
    (H, W) array
        Row i is row ``floor(i (h − 1) / (H − 1) + 1/2)`` of the estimate; columns alike.
    """
    rows, columns = (_nearest_index(n, m) for n, m in zip(estimate.shape, shape, strict=True))
    return estimate[rows][:, columns]


def _nearest_index(source: int, target: int) -> NDArray[np.int64]:
    # In whole numbers, so that no rounding of a quotient decides which pixel is taken.
    span = max(target - 1, 1)
    return (2 * np.arange(target, dtype=np.int64) * (source - 1) + span) // (2 * span)


def region(truth: Array, mask: Array | None = None, resolution: Resolution = LOW) -> BoolArray:
    """Pixels that count: inside the border, with a finite truth, in the mask.

    Raises
    ------
    LightFieldError
        If the mask has another size than the truth, or the border leaves nothing.
    """
    height, width = truth.shape
    border = resolution.border
    if min(height, width) <= 2 * border:
        raise LightFieldError(
            f"truth: {width}x{height} px; expected more than {2 * border} px a side, since the "
            f"{resolution.name}-resolution metrics drop a border of {border} px; score a larger map"
        )
    inside = np.zeros(truth.shape, dtype=bool)
    _inside(inside, resolution)[...] = np.isfinite(_inside(truth, resolution))
    if mask is None:
        return inside
    if mask.shape != truth.shape:
        raise LightFieldError(
            f"mask: {_size(mask)} px; expected {_size(truth)} px like the truth; use the same resolution for "
            "both"
        )
    inside &= mask != 0
    return inside


def errors(
    estimate: Array, truth: Array, mask: Array | None = None, resolution: Resolution = LOW
) -> FloatArray:
    """Errors ``estimate − truth`` at the pixels that count, as a vector in the order of the rows."""
    where = region(truth, mask, resolution)
    estimate = _matched(estimate, truth, resolution)
    if mask is not None or np.count_nonzero(where) < _inside(truth, resolution).size:
        return np.subtract(estimate[where], truth[where], dtype=np.float64)
    # All of the frame: high-resolution maps are large, so it is not worth gathering the pixels one by one.
    return np.subtract(_inside(estimate, resolution), _inside(truth, resolution), dtype=np.float64).ravel()


def _inside(image: Array, resolution: Resolution) -> Array:
    border = resolution.border
    part: Array = image[border:-border, border:-border]
    return part


def _matched(estimate: Array, truth: Array, resolution: Resolution) -> Array:
    if estimate.shape == truth.shape:
        return estimate
    if tuple(n * resolution.factor for n in estimate.shape) == truth.shape:
        return enlarge(estimate, (truth.shape[0], truth.shape[1]))
    smaller = f" or {resolution.factor} times smaller" if resolution.factor > 1 else ""
    raise LightFieldError(
        f"estimate: {_size(estimate)} px; expected {_size(truth)} px like the truth{smaller}; "
        "give a map of the reference view at the size of the views"
    )


def _size(array: Array) -> str:
    return "x".join(str(n) for n in array.shape[::-1])


def _percent(flags: BoolArray) -> float:
    return 100.0 * float(flags.mean()) if flags.size else float("nan")


# --- general metrics ----------------------------------------------------------------------------------------


def invalid_pixels(
    estimate: Array, truth: Array, mask: Array | None = None, resolution: Resolution = LOW
) -> int:
    """Number of scored pixels whose estimate is not finite."""
    return int(np.count_nonzero(~np.isfinite(errors(estimate, truth, mask, resolution))))


def badpix(
    estimate: Array,
    truth: Array,
    threshold: float = 0.07,
    mask: Array | None = None,
    resolution: Resolution = LOW,
) -> float:
    """BadPix(t): share of pixels whose error is above `threshold`, in percent.

    In `mask_discontinuities` at high resolution this is the benchmark's *Discontinuities*; in the masks of
    stripes, its *Low Texture* and contrast figures. (The benchmark's toolkit counts NaN as good; here it is
    bad.)
    """
    return _percent(~(np.abs(errors(estimate, truth, mask, resolution)) <= threshold))


def mse(estimate: Array, truth: Array, mask: Array | None = None, resolution: Resolution = LOW) -> float:
    """MSE×100: a hundred times the mean squared error of the finite pixels, in px²."""
    found = errors(estimate, truth, mask, resolution)
    finite = found[np.isfinite(found)]
    return 100.0 * float(np.mean(np.square(finite))) if finite.size else float("nan")


def q25(estimate: Array, truth: Array, mask: Array | None = None, resolution: Resolution = LOW) -> float:
    """Q25: a hundred times the error at the end of the best quarter of the pixels, in px.

    The value at index ``int(N / 4)`` of the N errors in ascending order; errors that are not finite come
    last.
    """
    found = np.abs(errors(estimate, truth, mask, resolution))
    quarter = found.size // 4
    return 100.0 * float(np.partition(found, quarter)[quarter]) if found.size else float("nan")


# --- photo-realistic regions --------------------------------------------------------------------------------


def fine_fattening(estimate: Array, truth: Array, mask: Array, resolution: Resolution = HIGH) -> float:
    """Share of the surroundings of fine structures that came out over 0.15 px too near, in percent."""
    return _percent(~(errors(estimate, truth, mask, resolution) <= 0.15))


def fine_thinning(estimate: Array, truth: Array, mask: Array, resolution: Resolution = HIGH) -> float:
    """Share of the fine structures that came out over 0.15 px too far, in percent."""
    return _percent(~(errors(estimate, truth, mask, resolution) >= -0.15))


def bumpiness(estimate: Array, truth: Array, mask: Array, resolution: Resolution = LOW) -> float:
    """Bumpiness: a hundred times the mean of ``min(‖Hessian(e)‖_F, 0.05)``, ``e = estimate − truth``.

    Second derivatives are first derivatives taken twice, each with (3, 10, 3)/16 across and (1, 0, −1) along.
    """
    where = region(truth, mask, resolution)
    error = _matched(estimate, truth, resolution).astype(np.float64) - truth
    rows, columns = _derivative(error, 0), _derivative(error, 1)
    squares = sum(np.square(_derivative(first, axis)) for first in (rows, columns) for axis in (0, 1))
    # fmin, unlike minimum, turns a NaN into the cap.
    capped = np.fmin(np.sqrt(squares)[where], BUMPINESS_CAP)
    return 100.0 * float(capped.mean()) if capped.size else float("nan")


def _derivative(image: FloatArray, axis: int) -> FloatArray:
    """Scharr derivative along an axis; the border is mirrored, the outermost frame of the result zero."""
    turned = np.moveaxis(image, axis, 0)
    padded = np.pad(turned, 1, mode="symmetric")
    smooth = (3.0 * padded[:, :-2] + 10.0 * padded[:, 1:-1] + 3.0 * padded[:, 2:]) / 16.0
    result = np.zeros(turned.shape)
    result[1:-1, 1:-1] = (smooth[2:] - smooth[:-2])[1:-1, 1:-1]
    return np.moveaxis(result, 0, axis)


def angle_error(
    estimate: Array, truth: Array, mask: Array, camera: Camera, resolution: Resolution = LOW
) -> float:
    """MAE: median angle between the surface normals of estimate and truth, in degrees.

    A pixel without a normal counts as 180°. The camera turns disparities into depths.
    """
    where = region(truth, mask, resolution)
    mine, wanted = (
        normals(camera.disparity_to_depth(each.astype(np.float64)), camera)[where]
        for each in (_matched(estimate, truth, resolution), truth)
    )
    # atan2 of cross and dot product is exact at zero, where the arc cosine is not.
    crossed = np.linalg.norm(np.cross(mine, wanted), axis=-1)
    angles = np.degrees(np.arctan2(crossed, np.sum(mine * wanted, axis=-1)))
    return float(np.median(np.where(np.isfinite(angles), angles, 180.0))) if angles.size else float("nan")


def normals(depth: Array, camera: Camera) -> FloatArray:
    """Surface normals (H, W, 3), not normalised, of a depth map (H, W) in metres.

    The cross product of the two tangents of the points ``(X, Y, Z)`` with ``X = column/(W − 1) · s Z / 2f``
    and ``Y = row/(H − 1) · s Z / 2f``: the benchmark's quirk, the origin in a corner and half the sensor's
    size, is kept so that angles compare with published ones. The border wraps around.
    """
    height, width = depth.shape
    depth = np.where(np.isfinite(depth), depth, np.nan)  # infinity minus infinity would warn
    scale = 0.5 * camera.sensor_size_mm / camera.focal_length_mm
    rows, columns = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)
    points = np.stack([columns * scale * depth, rows * scale * depth, depth], axis=-1)
    return np.cross(_wrapped_derivative(points, 1), _wrapped_derivative(points, 0))


def _wrapped_derivative(points: FloatArray, axis: int) -> FloatArray:
    across = 1 - axis
    smooth = 3.0 * np.roll(points, 1, across) + 10.0 * points + 3.0 * np.roll(points, -1, across)
    return (np.roll(smooth, -1, axis) - np.roll(smooth, 1, axis)) / 64.0


# --- stratified scenes --------------------------------------------------------------------------------------


def backgammon_fattening(estimate: Array, truth: Array, mask: Array, resolution: Resolution = HIGH) -> float:
    """Share of the background between the wedges nearer to the foreground than to the truth, in percent.

    The foreground of a row is the truth at column 140 at high resolution.
    """
    column = 14 * resolution.factor
    return _beyond_midpoint(estimate, truth, mask, resolution, column, nearer=True)


def backgammon_thinning(estimate: Array, truth: Array, mask: Array, resolution: Resolution = HIGH) -> float:
    """Share of the wedges that is nearer to the background than to the truth, in percent.

    The background of a row is the truth at the eleventh column from the right at high resolution.
    """
    column = truth.shape[1] - 1 - resolution.factor
    return _beyond_midpoint(estimate, truth, mask, resolution, column, nearer=False)


def _beyond_midpoint(
    estimate: Array, truth: Array, mask: Array, resolution: Resolution, column: int, *, nearer: bool
) -> float:
    where = region(truth, mask, resolution)
    values = _matched(estimate, truth, resolution)[where]
    midpoint = ((truth[:, column, None].astype(np.float64) + truth) / 2)[where]
    kept = values <= midpoint if nearer else values >= midpoint
    return _percent(~kept)


def missed_dots(estimate: Array, truth: Array, boxes: Array, sizes: Array) -> float:
    """Share of the dots that were not found, in percent; no border is dropped.

    Parameters
    ----------
    estimate, truth : (H, W) array
        At high resolution, or the estimate at the size of the views.
    boxes : (H, W) integer array
        `mask_boxes`: a label above 0 for each box.
    sizes : (H, W) integer array
        `mask_dots_by_size`: 1 to 8 in a dot, by its size; a box has one dot of a size.

    Returns
    -------
    float
        A dot is found when its BadPix(0.4) is below 50 %.
    """
    where = (boxes > 0) & (sizes > 0) & np.isfinite(truth)
    values = (estimate if estimate.shape == truth.shape else _matched(estimate, truth, HIGH))[where]
    bad = ~(np.abs(values.astype(np.float64) - truth[where]) <= 0.4)
    dots = boxes[where].astype(np.int64) * (int(sizes.max(initial=0)) + 1) + sizes[where]
    pixels = np.bincount(dots)
    missed = np.bincount(dots, weights=bad)[pixels > 0] >= 0.5 * pixels[pixels > 0]
    return _percent(missed)


# --- our own ------------------------------------------------------------------------------------------------


def near_boundaries(truth: Array, *, jump: float = 0.2, distance: float = 5.0) -> BoolArray:
    """Mask (H, W) of the pixels near an occlusion boundary of the truth.

    Parameters
    ----------
    truth : (H, W) array
    jump : float
        Two neighbours, across or down, whose disparities differ by more than this (px per view step) lie on
        either side of a boundary. A jump of 0.2 px moves the occluder by 0.8 px in the outermost of nine
        views.
    distance : float
        Pixels at most this far (px, Euclidean) from such a neighbour are near.
    """
    edges = np.zeros(truth.shape, dtype=bool)
    truth = np.where(np.isfinite(truth), truth, np.nan)  # infinity minus infinity would warn
    down = np.abs(np.diff(truth, axis=0)) > jump
    across = np.abs(np.diff(truth, axis=1)) > jump
    edges[:-1] |= down
    edges[1:] |= down
    edges[:, :-1] |= across
    edges[:, 1:] |= across
    return _dilate(edges, distance)


def _dilate(mask: BoolArray, radius: float) -> BoolArray:
    reach = int(radius)
    height, width = mask.shape
    padded = np.pad(mask, reach)
    grown = np.zeros_like(mask)
    for dy in range(-reach, reach + 1):
        half = int(np.sqrt(radius**2 - dy**2))
        for dx in range(-half, half + 1):
            grown |= padded[reach + dy : reach + dy + height, reach + dx : reach + dx + width]
    return grown


@dataclass(frozen=True, eq=False)
class Sparsification:
    """Error of what is left as ever more pixels are dropped.

    Attributes
    ----------
    dropped : (N,) array
        Share of pixels dropped, 0 … below 1.
    error : (N,) array
        Error of the rest, the least confident dropped first.
    oracle : (N,) array
        The same with the worst pixels dropped first: no confidence can do better.
    """

    dropped: FloatArray
    error: FloatArray
    oracle: FloatArray

    @property
    def area(self) -> float:
        """AUSE: mean distance between the two curves, in the unit of the error; 0 is ideal."""
        return float(np.mean(self.error - self.oracle))


def sparsification(
    estimate: Array,
    truth: Array,
    confidence: Array,
    measure: Literal["badpix", "absolute", "squared"] = "badpix",
    *,
    threshold: float = 0.07,
    steps: int = 100,
    mask: Array | None = None,
    resolution: Resolution = LOW,
) -> Sparsification:
    """Sparsification curve of a confidence map, and the ideal one.

    Parameters
    ----------
    estimate, truth, confidence : (H, W) array
        Higher confidence is better; only its order matters. NaN is least confident.
    measure : "badpix", "absolute" or "squared"
        BadPix(`threshold`) in percent; 100·mean|e| in px; MSE×100 in px². The last two leave out pixels whose
        estimate is not finite.
    steps : int
        The curve has a point for every 1/steps of the pixels dropped, from 0 to 1 − 1/steps.

    Notes
    -----
    Pixels of equal confidence are dropped together, as the mean over all their orders, so a constant map
    gives a flat curve. The area is that of Ilg et al., ECCV 2018, DOI 10.1007/978-3-030-01234-2_40, without
    dividing by the error at the start.
    """
    found = np.abs(errors(estimate, truth, mask, resolution))
    counted = region(truth, mask, resolution)
    trust = _matched(confidence, truth, resolution)[counted].astype(np.float64)
    if measure == "badpix":
        losses = np.where(found <= threshold, 0.0, 100.0)
    else:
        finite = np.isfinite(found)
        found, trust = found[finite], trust[finite]
        losses = 100.0 * (found if measure == "absolute" else np.square(found))
    dropped = np.arange(steps) / steps
    if not losses.size:
        nothing = np.full(steps, np.nan)
        return Sparsification(dropped, nothing, nothing)
    by_trust = _shared_among_ties(losses, np.where(np.isnan(trust), -np.inf, trust))
    return Sparsification(dropped, _kept_means(by_trust, dropped), _kept_means(np.sort(losses), dropped))


def _shared_among_ties(losses: FloatArray, trust: FloatArray) -> FloatArray:
    """Losses from the most to the least trusted; each of a group of equal trust carries the group's mean."""
    _, group, sizes = np.unique(-trust, return_inverse=True, return_counts=True)
    means = np.bincount(group, weights=losses) / sizes
    return np.repeat(means, sizes)


def _kept_means(losses: FloatArray, dropped: FloatArray) -> FloatArray:
    kept = np.maximum(np.rint((1.0 - dropped) * losses.size).astype(np.int64), 1)
    return np.asarray(np.cumsum(losses)[kept - 1] / kept, dtype=np.float64)


def ause(
    estimate: Array,
    truth: Array,
    confidence: Array,
    measure: Literal["badpix", "absolute", "squared"] = "badpix",
    **options: Any,
) -> float:
    """Area between the `sparsification` curve of a confidence and the ideal one; 0 is ideal."""
    return sparsification(estimate, truth, confidence, measure, **options).area


def mean_over_scenes(values: Sequence[float | None]) -> float:
    """Plain mean over the scenes that have the metric; NaN when none has."""
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")
