"""The joint decoder: sign profile and photo-consistency in one energy, made smooth along scanlines.

The sign profile of a pixel is smooth, unbiased and precise between planes, but an occluder drags its zero
crossing along; the share of views that agree in colour peaks at the surface's plane whatever hides some of
them, but is flat where there is no texture. Their joint energy at plane k,

    E_k = step · (Σ_{i<k} C̃_i + C̃_k / 2) − λ · P̃_k,

has the virtues of both: without P it is sign function approximation. λ falls where P says nothing. Where
neither says much neighbours do: semi-global matching (Hirschmüller, TPAMI 2008, doi:10.1109/TPAMI.2007.1166)
adds to each pixel's energies those of the best smooth paths that lead to it from four sides; small changes
of disparity cost in proportion, jumps a constant, both less across an edge of the reference view.
A parabola through the minimum places the disparity between planes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfdepth.lightfield import LightField
from lfdepth.sweep.joint_kernels import (
    SCALE,
    decode_kernel,
    energy_kernel,
    horizontal_kernel,
    store_kernel,
    vertical_kernel,
)
from lfdepth.sweep.noise import ramp, texture_weight
from lfdepth.sweep.parallel import Workers
from lfdepth.sweep.photo import local_thresholds, photo_plane, prepare_colours
from lfdepth.sweep.smoothing import GuidedFilter


@dataclass(frozen=True, kw_only=True)
class JointRule:
    """Weights of the joint decoder.

    Parameters
    ----------
    photo_weight
        λ, in px per view step; 0 leaves the signs alone.
    slope_penalty
        Cost of a change of one plane between neighbours (P1 of semi-global matching), in the energy's units.
    jump_penalty
        Cost of any larger change (P2).
    edge_sharpness
        Both penalties fall as exp(−edge_sharpness · Σ_channels |ΔI|), I in [0, 1].
    """

    photo_weight: float = 1.0
    slope_penalty: float = 0.12
    jump_penalty: float = 2.0
    edge_sharpness: float = 20.0


class JointEnergy:
    """Collects smoothed votes front to back, then decides.

    Unlike the streaming decoders it keeps a volume (5 bytes per plane and pixel, 9 while it decides): a path may change its mind.

    Parameters
    ----------
    planes
        (K,) disparities front to back, K ≥ 3.
    lf
        Light field, whose colours vote.
    smoothing
        Filter for the photo-consistency votes, with its guide.
    rule
        Weights.
    """

    def __init__(
        self, lf: LightField, planes: NDArray[np.float64], smoothing: GuidedFilter, rule: JointRule
    ) -> None:
        self.planes = planes
        self.rule = rule
        self._smoothing = smoothing
        self._colours = prepare_colours(lf, float(np.abs(planes).max()))
        self._thresholds = local_thresholds(lf.reference)
        self._texture = texture_weight(lf, planes)
        shape = (len(planes), *smoothing.guide.shape[:2])
        self._agreeing, self._share = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)
        self._signs = np.empty(shape, np.float32)
        self._photo = np.empty(shape, np.uint8)
        self._running = np.zeros(shape[1:], np.float32)
        self._lowest = np.zeros(shape[1:], np.float32)
        self._peak = np.zeros(shape[1:], np.float32)
        self._photo_sum = np.zeros(shape[1:], np.float32)

    def update(self, index: int, smoothed: NDArray[np.float32], workers: Workers) -> None:
        """Take the smoothed sign votes of plane `index`, and count photo-consistency there."""
        photo_plane(self._colours, float(self.planes[index]), self._thresholds, workers, self._agreeing)
        self._smoothing.smooth_plane(self._agreeing, workers, self._share)
        workers.rows(
            smoothed.shape[0],
            store_kernel,
            np.float32(self.planes[0] - self.planes[1]),
            smoothed,
            self._share,
            self._running,
            self._lowest,
            self._peak,
            self._photo_sum,
            self._signs[index],
            self._photo[index],
        )

    def decide(self, workers: Workers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity and confidence, both (H, W); the volume is used up."""
        height, width = self._running.shape
        count = len(self.planes)
        step = float(self.planes[0] - self.planes[1])
        contrast = self._peak - self._photo_sum / np.float32(count)
        weight = np.float32(self.rule.photo_weight) * ramp(contrast, 0.03, 0.1) * self._texture
        energy = np.empty((height, width, count), np.int16)
        workers.rows(height, energy_kernel, self._signs, self._photo, weight, energy)
        del self._signs, self._photo
        total = np.zeros((height, width, count), np.int16)
        for kernel, length in ((horizontal_kernel, height), (vertical_kernel, width)):
            workers.rows(
                length,
                kernel,
                energy,
                total,
                self._smoothing.guide,
                np.float32(self.rule.slope_penalty * SCALE),
                np.float32(self.rule.jump_penalty * SCALE),
                np.float32(self.rule.edge_sharpness),
            )
        position, sharpness = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
        workers.rows(height, decode_kernel, total, position, sharpness)
        disparity = np.float32(self.planes[0]) - np.float32(step) * position
        fit = np.clip((self._running - 2 * self._lowest) / np.float32(step * count), 0, 1)
        return disparity, np.sqrt(fit * np.clip(contrast, 0, 1))
