"""Algorithm 1: one loop over the planes, front to back, that composes the blocks."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.decode import Accumulate, Decoder, SignStep, decided
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.blocks.energy import JointEnergy, JointRule
from lfdepth.blocks.occlusion import NoOcclusion, SkipMask
from lfdepth.blocks.planes import check_range, disparity_planes
from lfdepth.blocks.reparam import FULL_SCALE, grey_levels, stack_views
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.blocks.voting import VoteRule, quotient, vote_plane
from lfdepth.engines.cpu.workers import Workers
from lfdepth.lightfield import LightField
from lfdepth.methods import Method
from lfdepth.methods import method as named_method
from lfdepth.probe.ranges import find_range

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Volumes:
    """Volumes of a sweep, kept only on request.

    Attributes
    ----------
    planes
        (K,) disparities front to back.
    initial, smoothed, decided
        (K, H, W) float32 in [−1, 1]: votes `C`, guided-filtered votes `C̃`, one step per pixel `Ĉ`.
    """

    planes: NDArray[np.float64]
    initial: NDArray[np.float32]
    smoothed: NDArray[np.float32]
    decided: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Result:
    """A disparity map with its evidence.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step, positive nearer.
    confidence
        (H, W) float32 in [0, 1]: how well the profile fits one sign step, and how much evidence it had.
    range
        (min, max) disparity that was searched.
    runtime
        Seconds for the estimate, reading and compiling excluded where they came before.
    method
        The method with all its parameters.
    range_found
        Whether the range was found from the views, for want of a given one.
    volumes
        The volumes, with `keep_volume=True`; else None.
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    range: tuple[float, float]
    runtime: float
    method: Method
    range_found: bool = False
    volumes: Volumes | None = None


def estimate(
    lf: LightField,
    method: str | Method = "fbs-vis",
    *,
    range: tuple[float, float] | None = None,
    keep_volume: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
    force: bool = False,
    **options: Any,
) -> Result:
    """Estimate the disparity map of the reference view.

    Parameters
    ----------
    lf
        Light field with at least 3 views along one axis.
    method
        Name of a method (`lfdepth.methods.NAMES`) or a `Method`.
    range
        (min, max) disparity in px per view step; None takes the light field's own, and where it has none
        finds it (`lfdepth.probe.ranges.find_range`).
    keep_volume
        Keep the volumes; memory grows by three times planes × H × W × 4 bytes.
    threads
        Number of threads; None takes every processor. The result does not depend on it.
    progress
        Called with (planes done, planes in all).
    force
        Allow an extreme number of planes.
    **options
        Fields of `Method` to change, such as `step=0.02`.

    Returns
    -------
    Result

    Raises
    ------
    LightFieldError
        For an unknown method or option, or input the method cannot work with.
    """
    started = time.perf_counter()
    chosen = named_method(method, **options)
    searched = range if range is not None else lf.disparity_range
    found = searched is None
    if searched is None:
        searched = find_range(lf, threads=threads)
    searched = check_range(searched)
    planes = disparity_planes(searched, step=chosen.step, count=chosen.planes, force=force)
    size = lf.views.shape[2:4]
    volumes = _empty_volumes(planes, size) if keep_volume else None
    with Workers(threads) as workers:
        disparity, confidence = _sweep(lf, chosen, planes, volumes, workers, progress)
    disparity = np.clip(disparity, *searched).astype(np.float32)
    if volumes is not None:
        volumes.decided[:] = decided(disparity, planes)
    return Result(disparity, confidence, searched, time.perf_counter() - started, chosen, found, volumes)


def _sweep(
    lf: LightField,
    method: Method,
    planes: NDArray[np.float64],
    volumes: Volumes | None,
    workers: Workers,
    progress: Progress | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Algorithm 1, and the decoder's disparity and confidence."""
    smoothing = GuidedFilter(guide_image(lf, method.guide), method.radius, method.epsilon)
    decoder = _decoder(lf, method, planes, smoothing.guide)
    passes = 2 if method.occlusion == "visibility" and method.decoder == "joint" else 1

    def report(done: int) -> None:
        if progress is not None:
            progress(done, len(planes) * passes)

    _vote(lf, method, planes, smoothing, decoder, volumes, workers, report)
    disparity, confidence = decoder.decide(workers)
    if method.occlusion != "visibility":
        return disparity, confidence
    edges = DepthEdges(lf, EdgeRule(passes=method.edge_passes))
    if not isinstance(decoder, JointEnergy):
        disparity = edges.settle(disparity, workers)
        return disparity, edges.distrust(confidence, disparity)
    # One pass will do for a map that only says which views see what.
    first = edges.settle(disparity, workers, passes=1)
    for index in decoder.recount(first, workers):
        report(len(planes) + index + 1)
    if method.gloss:
        decoder.replace_glossy(workers)
    disparity, confidence = decoder.decide(workers)
    disparity = edges.settle(disparity, workers)
    return disparity, edges.distrust(confidence, disparity)


def _vote(
    lf: LightField,
    method: Method,
    planes: NDArray[np.float64],
    smoothing: GuidedFilter,
    decoder: Decoder,
    volumes: Volumes | None,
    workers: Workers,
    report: Callable[[int], None],
) -> None:
    """The loop over planes: vote, smooth, take note; the views' grey levels are let go of at its end."""
    occlusion = (
        SkipMask(method.skip, planes[0] - planes[1]) if method.occlusion == "skip-mask" else NoOcclusion()
    )
    rule = VoteRule(method.delta, method.threshold, method.gradient)
    stack = stack_views(lf, float(np.abs(planes).max()))
    votes, evidence, smoothed = (np.empty(stack.size, np.float32) for _ in "123")
    for index, plane in enumerate(planes):
        vote_plane(stack, float(plane), rule, occlusion.mask(index), workers, votes, evidence)
        if method.normalise:
            smoothing.smooth_quotient(votes, evidence, workers, smoothed)
        else:
            smoothing.smooth_plane(quotient(votes, evidence), workers, smoothed)
        occlusion.update(index, smoothed)
        decoder.update(index, smoothed, workers)
        if volumes is not None:
            volumes.initial[index], volumes.smoothed[index] = quotient(votes, evidence), smoothed
        report(index + 1)


def guide_image(lf: LightField, guide: str) -> NDArray[np.float32]:
    """The reference view in [0, 1] as a filter guide: (H, W, 3) for "colour" if any, or (H, W, 1)."""
    if guide == "colour":
        return lf.reference.astype(np.float32) / np.float32(lf.full_scale)
    return (grey_levels(lf.reference).astype(np.float32) / np.float32(FULL_SCALE))[..., None]


def _decoder(
    lf: LightField, method: Method, planes: NDArray[np.float64], guide: NDArray[np.float32]
) -> Decoder:
    size = guide.shape[:2]
    if method.decoder == "accumulate":
        return Accumulate(planes, size)
    if method.decoder == "sfa":
        return SignStep(planes, size, subplane=method.subplane)
    rule = JointRule(
        photo_weight=method.photo_weight,
        slope_penalty=method.slope_penalty,
        jump_penalty=method.jump_penalty,
        fit_radius=method.fit_radius,
    )
    smoothing = GuidedFilter(guide, method.photo_radius, method.epsilon)
    return JointEnergy(lf, planes, smoothing, rule, stride=2 if method.occlusion == "visibility" else 1)


def _empty_volumes(planes: NDArray[np.float64], size: tuple[int, int]) -> Volumes:
    shape = (len(planes), *size)
    return Volumes(planes, *(np.empty(shape, np.float32) for _ in "123"))
