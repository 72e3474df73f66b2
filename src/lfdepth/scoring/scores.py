"""Which metrics a scene has, and all of them at once: `evaluate`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.scoring import metrics
from lfdepth.scoring.metrics import HIGH, LOW, Array, Resolution
from lfdepth.table import Column, Table, Value

if TYPE_CHECKING:
    from lfdepth.camera import Camera
    from lfdepth.result import Result
    from lfdepth.truth import HighResolution

HIGH_RESOLUTION_SCENES = frozenset({"backgammon", "dots", "stripes", "wedges", "specks", "strips"})
"""Scenes whose BadPix, MSE and Q25 are taken at high resolution: three of the benchmark, and those of
`lfdepth.scenes` in their manner. All others' are taken at low."""

_HIGH_RESOLUTION_MASKS = frozenset({"foreground_fattening", "dots_by_size", "low_texture"})
"""Masks that tell a scene in the manner of one of these whatever its name."""

LOW_INSTEAD = "low-resolution truth"
"""Note at a metric of high resolution that was taken at low, for want of the truth."""


@dataclass(frozen=True, eq=False)
class Sample:
    """One estimate beside the truth of one scene at one resolution: what a metric computes from."""

    estimate: Array
    truth: Array
    masks: Mapping[str, Array]
    resolution: Resolution
    camera: Camera | None = None
    confidence: Array | None = None


Compute = Callable[[Sample], float]


@dataclass(frozen=True)
class Metric:
    """A metric of the table; lower is better for every one.

    Attributes
    ----------
    key : str
        Name in JSON and CSV.
    label, unit : str
        Name and unit in tables.
    compute : callable
        From a `Sample` that has what the metric needs to its value.
    masks : tuple of str
        Masks that it needs.
    resolution : {"low", "high", "scene"}
        The truth that it is defined on; "scene" is high for `HIGH_RESOLUTION_SCENES` and low for all others.
    needs : {"camera", "confidence"}, optional
        What else it needs.
    """

    key: str
    label: str
    unit: str
    compute: Compute
    masks: tuple[str, ...] = ()
    resolution: Literal["low", "high", "scene"] = "low"
    needs: Literal["camera", "confidence"] | None = None


def _on(function: Callable[..., float], *names: str, **options: Any) -> Compute:
    """Metric on the union of masks; on the whole frame without any."""

    def compute(s: Sample) -> float:
        mask = np.any([s.masks[name] != 0 for name in names], axis=0) if names else None
        return function(s.estimate, s.truth, mask=mask, resolution=s.resolution, **options)

    return compute


def _angle_on(name: str) -> Compute:
    return lambda s: _on(metrics.angle_error, name, camera=s.camera)(s)


def _ause(measure: str) -> Compute:
    return lambda s: _on(metrics.ause, confidence=s.confidence, measure=measure)(s)


def _near_boundaries(s: Sample) -> float:
    near = metrics.near_boundaries(s.truth)
    return metrics.badpix(s.estimate, s.truth, 0.07, near, s.resolution)


def _missed_dots(s: Sample) -> float:
    return metrics.missed_dots(s.estimate, s.truth, s.masks["boxes"], s.masks["dots_by_size"])


def _general() -> Iterator[Metric]:
    for threshold in metrics.BADPIX_THRESHOLDS:
        compute = _on(metrics.badpix, threshold=threshold)
        yield Metric(f"badpix_{threshold}", f"BadPix {threshold}", "%", compute, resolution="scene")
    yield Metric("mse_x100", "MSE×100", "px²", _on(metrics.mse), resolution="scene")
    yield Metric("q25", "Q25", "px/100", _on(metrics.q25), resolution="scene")


def _photorealistic() -> Iterator[Metric]:
    for key, label, function, mask in (
        ("discontinuities", "Discontinuities", metrics.badpix, "discontinuities"),
        ("fine_fattening", "Fine fattening", metrics.fine_fattening, "fine_surrounding"),
        ("fine_thinning", "Fine thinning", metrics.fine_thinning, "fine"),
    ):
        yield Metric(key, label, "%", _on(function, mask), (mask,), "high")
    for name, mask in (("planes", "planes"), ("continuous", "smooth_surfaces")):
        yield Metric(f"bumpiness_{name}", f"Bumpiness, {name}", "", _on(metrics.bumpiness, mask), (mask,))
    for name, mask in (("planes", "planes"), ("continuous", "smooth_surfaces")):
        yield Metric(f"mae_{name}", f"MAE, {name}", "°", _angle_on(mask), (mask,), needs="camera")


def _stratified() -> Iterator[Metric]:
    for name, function in (
        ("fattening", metrics.backgammon_fattening),
        ("thinning", metrics.backgammon_thinning),
    ):
        mask = f"foreground_{name}"
        yield Metric(f"backgammon_{name}", f"Backgammon {name}", "%", _on(function, mask), (mask,), "high")
    for name, masks in (
        ("slanted", ("sphere_in", "sphere_out", "pyramids")),
        ("parallel", ("plane",)),
    ):
        compute = _on(metrics.bumpiness, *masks)
        yield Metric(f"pyramids_{name}", f"Pyramids, {name}: bumpiness", "", compute, masks)
    background = _on(metrics.mse, "background")
    yield Metric("dots_background", "Dots: background MSE×100", "px²", background, ("background",), "high")
    yield Metric("dots_missed", "Dots: missed", "%", _missed_dots, ("boxes", "dots_by_size"), "high")
    for mask in ("low_texture", "high_contrast", "low_contrast"):
        label = f"Stripes: {mask.replace('_', ' ')}"
        yield Metric(f"stripes_{mask}", label, "%", _on(metrics.badpix, mask), (mask,), "high")


def _own() -> Iterator[Metric]:
    yield Metric("badpix_0.07_boundaries", "BadPix 0.07 near occlusion boundaries", "%", _near_boundaries)
    for mask, label in (("textureless", "textureless areas"), ("thin", "thin structures")):
        label = f"BadPix 0.07, {label}"
        yield Metric(f"badpix_0.07_{mask}", label, "%", _on(metrics.badpix, mask), (mask,))
    yield Metric("ause_badpix_0.07", "AUSE of BadPix 0.07", "%", _ause("badpix"), needs="confidence")
    yield Metric("ause_absolute", "AUSE of 100·|error|", "px/100", _ause("absolute"), needs="confidence")


METRICS: tuple[Metric, ...] = (*_general(), *_photorealistic(), *_stratified(), *_own())
"""Every metric of a map, in the order of the tables."""

BY_KEY: Mapping[str, Metric] = {metric.key: metric for metric in METRICS}


@dataclass(frozen=True, eq=False)
class Scores(Mapping[str, float]):
    """Scores of one map: a mapping from metric key to value, and what is to be known beside it.

    Attributes
    ----------
    scene : str
        Name of the scene.
    scores : mapping of str to float
        The metrics that the scene has, in the order of `METRICS`; last `runtime` in seconds where it is
        known.
    resolution : mapping of str to str
        "low" or "high" by metric key: the truth that it was taken on.
    notes : mapping of str to str
        Remarks by metric key, such as `LOW_INSTEAD`.
    missing : mapping of str to str
        Why each of the other metrics has no value.
    pixels : int
        Pixels inside the border.
    invalid_pixels : int
        Those of them whose estimate is not finite; BadPix counts them as bad, MSE leaves them out.
    """

    scene: str
    scores: Mapping[str, float]
    resolution: Mapping[str, str] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    pixels: int = 0
    invalid_pixels: int = 0

    def __getitem__(self, key: str) -> float:
        return self.scores[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.scores)

    def __len__(self) -> int:
        return len(self.scores)

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return {
            "scene": self.scene,
            "scores": dict(self.scores),
            "resolution": dict(self.resolution),
            "notes": dict(self.notes),
            "missing": dict(self.missing),
            "pixels": self.pixels,
            "invalid_pixels": self.invalid_pixels,
        }

    def table(self, *, every: bool = False) -> str:
        """Text table, a line per metric; with `every` also the metrics without a value, and why."""
        units = {metric.key: metric.unit for metric in METRICS} | {"runtime": "s"}
        rows: list[tuple[Value, ...]] = [
            (label_of(key), value, units[key], self.notes.get(key, "")) for key, value in self.scores.items()
        ]
        if every:
            rows += [(label_of(key), None, "", reason) for key, reason in self.missing.items()]
        columns: tuple[str | Column, ...] = (
            self.scene,
            "score",
            Column("unit", words=True),
            Column("note", words=True),
        )
        if not any(row[-1] for row in rows):
            columns, rows = columns[:-1], [row[:-1] for row in rows]
        lines = [Table.of(columns, rows).to_text()]
        if self.invalid_pixels:
            lines.append(
                f"{self.invalid_pixels} of {self.pixels} pixels have no value; BadPix counts them as bad"
            )
        return "\n".join(lines)


def label_of(key: str) -> str:
    """Name of a metric, or of the run time, in tables."""
    return "Run time" if key == "runtime" else BY_KEY[key].label


def evaluate(
    result_or_disparity: Result | Array,
    lf_or_truth: LightField | Array,
    *,
    confidence: Array | None = None,
    high: HighResolution | None = None,
    unusable: Mapping[str, str] | None = None,
) -> Scores:
    """Score a disparity map against the truth.

    Parameters
    ----------
    result_or_disparity : Result or (H, W) array
        A result also has confidence and run time.
    lf_or_truth : LightField or (H, W) array
        A light field also has masks and a camera, for the metrics that need them.
    confidence : (H, W) array, optional
        Higher is better; for the area under the sparsification error (AUSE).
    high : HighResolution, optional
        Truth and masks at ten times the size (`read_high_resolution`), for the metrics that the benchmark
        defines there. Without it they are taken at low resolution where the masks allow it, and `notes` says
        so.
    unusable : mapping of str to str, optional
        Masks of the light field that could not be used, with the reason, which becomes that of the metrics
        that need them.

    Returns
    -------
    Scores
        All metrics that the scene has truth and masks for.

    Raises
    ------
    LightFieldError
        If there is no truth, a map has another size than the truth, or no pixel of the estimate is finite.

    Examples
    --------
    >>> import numpy as np
    >>> import lfdepth
    >>> truth = np.zeros((64, 64), np.float32)
    >>> lfdepth.evaluate(truth + np.float32(0.05), truth)["badpix_0.03"]
    100.0
    """
    truth, name = _truth_of(lf_or_truth)
    estimate = _checked_estimate(result_or_disparity, truth, name)
    confidence = _checked_confidence(result_or_disparity, confidence, truth, name)
    lf = lf_or_truth if isinstance(lf_or_truth, LightField) else None
    camera = lf.camera if lf else None
    samples = {"low": Sample(estimate, truth, lf.masks if lf else {}, LOW, camera, confidence)}
    if high is not None:
        enlarged = metrics.enlarge(estimate, _high_shape(high, truth, name))
        samples["high"] = Sample(enlarged, high.truth, high.masks, HIGH)
    reasons = {**(unusable or {}), **(high.unusable if high else {})}
    return _score(name, samples, reasons, getattr(result_or_disparity, "runtime", None))


def _score(
    name: str, samples: Mapping[str, Sample], unusable: Mapping[str, str], runtime: float | None
) -> Scores:
    values: dict[str, float] = {}
    resolution: dict[str, str] = {}
    notes: dict[str, str] = {}
    missing: dict[str, str] = {}
    for metric in METRICS:
        wanted = _resolution(metric, name, samples)
        choice = [samples[each] for each in dict.fromkeys((wanted, "low")) if each in samples]
        sample = next((each for each in choice if not _lacks(metric, each)), None)
        value = metric.compute(sample) if sample else math.nan
        if sample is None:
            missing[metric.key] = _reason(metric, choice[-1], unusable)
        elif math.isnan(value):
            missing[metric.key] = "no pixel to score"
        else:
            values[metric.key] = value
            resolution[metric.key] = sample.resolution.name
            if sample.resolution.name != wanted:
                notes[metric.key] = LOW_INSTEAD
    if runtime is not None:
        values["runtime"] = float(runtime)
    low = samples["low"]
    return Scores(
        scene=name,
        scores=values,
        resolution=resolution,
        notes=notes,
        missing=missing,
        pixels=int(np.count_nonzero(metrics.region(low.truth))),
        invalid_pixels=metrics.invalid_pixels(low.estimate, low.truth),
    )


def _resolution(metric: Metric, name: str, samples: Mapping[str, Sample]) -> str:
    """Resolution that the benchmark defines a metric at, for a scene."""
    if metric.resolution != "scene":
        return metric.resolution
    masks = {mask for sample in samples.values() for mask in sample.masks}
    return "high" if name in HIGH_RESOLUTION_SCENES or masks & _HIGH_RESOLUTION_MASKS else "low"


def _lacks(metric: Metric, sample: Sample) -> list[str]:
    masks = [f"mask {name!r}" for name in metric.masks if name not in sample.masks]
    return masks + ([metric.needs] if metric.needs and getattr(sample, metric.needs) is None else [])


def _reason(metric: Metric, sample: Sample, unusable: Mapping[str, str]) -> str:
    reasons = [unusable[name] for name in metric.masks if name in unusable]
    return "; ".join(reasons) or f"no {' and no '.join(_lacks(metric, sample))}"


def _truth_of(lf_or_truth: LightField | Array) -> tuple[Array, str]:
    if not isinstance(lf_or_truth, LightField):
        return np.asarray(lf_or_truth), "truth"
    if lf_or_truth.truth is None:
        raise LightFieldError(
            f"{lf_or_truth.name}: no truth; expected gt_disp_lowres.pfm beside the views, or a light field "
            "with truth; without truth nothing can be scored"
        )
    return lf_or_truth.truth, lf_or_truth.name


def _checked_estimate(result: Result | Array, truth: Array, name: str) -> Array:
    estimate = np.asarray(getattr(result, "disparity", result))
    _check_size("estimate", estimate, truth, name)
    if not np.isfinite(estimate).any():
        raise LightFieldError(
            f"{name}: estimate has no finite value; expected disparities in px per view step; compute it "
            "again"
        )
    return estimate


def _checked_confidence(
    result: Result | Array, confidence: Array | None, truth: Array, name: str
) -> Array | None:
    found = confidence if confidence is not None else getattr(result, "confidence", None)
    if found is None:
        return None
    found = np.asarray(found)
    _check_size("confidence", found, truth, name)
    return found


def _check_size(what: str, array: Array, truth: Array, name: str) -> None:
    if array.shape != truth.shape:
        raise LightFieldError(
            f"{name}: {what} is {'x'.join(map(str, array.shape[::-1]))} px; expected "
            f"{'x'.join(map(str, truth.shape[::-1]))} px like the truth; give the map of this scene's "
            "reference view"
        )


def _high_shape(high: HighResolution, truth: Array, name: str) -> tuple[int, int]:
    height, width = high.truth.shape
    if (height, width) != (HIGH.factor * truth.shape[0], HIGH.factor * truth.shape[1]):
        raise LightFieldError(
            f"{name}: high-resolution truth is {width}x{height} px; expected {HIGH.factor} times the "
            f"low-resolution truth's {truth.shape[1]}x{truth.shape[0]} px; use the two of one scene"
        )
    return height, width
