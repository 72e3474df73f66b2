"""The joint decoder: sign profile and photo-consistency in one energy, made smooth along scanlines.

The sign profile of a pixel is smooth, unbiased and precise between planes, but an occluder drags its zero
crossing along; the share of views that agree in colour peaks at the surface's plane whatever hides some of
them, but is flat where there is no texture. Their joint energy at plane k,

    E_k = step · (Σ_{i<k} C̃_i + C̃_k / 2) − λ · P̃_k,

has the virtues of both: without P it is sign function approximation. λ falls where P says nothing. Where
neither says much neighbours do: semi-global matching (Hirschmüller, TPAMI 2008, doi:10.1109/TPAMI.2007.1166)
adds to each pixel's energies those of the best smooth paths that lead to it from four sides; small changes
of disparity cost in proportion, jumps a constant, both less across an edge of the reference view.
A parabola through the minimum places the disparity between planes, and planes fitted to the pixels' own
energies (`surface`) refine it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.gloss import WEIGHT, FineCount, replace_shares, suspects
from lfdepth.blocks.noise import ramp, residual, texture_weight, threshold_bounds
from lfdepth.blocks.photo import ColourStack, local_thresholds, photo_plane, prepare_colours, thinned
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.blocks.surface import fit_surfaces
from lfdepth.blocks.visibility import NearestSurfaces, nearest_surfaces
from lfdepth.engines.cpu.energy import (
    SCALE,
    decode_kernel,
    energy_kernel,
    fill_islands_kernel,
    horizontal_kernel,
    store_photo_kernel,
    store_signs_kernel,
    vertical_kernel,
)
from lfdepth.engines.cpu.workers import Workers
from lfdepth.lightfield import LightField

_LARGEST_ISLAND = 2
"""Pixels up to which an island at an end of the range is filled."""


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
        Both penalties fall as exp(−edge_sharpness · Σ_channels |ΔI|), I in [0, 1], where ΔI counts only as
        far as it exceeds the level at which views differ for no reason.
    fit_radius
        Radius in px of the planes fitted to the pixels' own energies; 0 leaves the paths' disparity.
    """

    photo_weight: float = 1.0
    slope_penalty: float = 0.3
    jump_penalty: float = 2.0
    edge_sharpness: float = 20.0
    fit_radius: int = 8


class JointEnergy:
    """Collects smoothed votes front to back, then decides.

    Unlike the streaming decoders it keeps a volume, since a path may change its mind: 5 bytes per plane and
    pixel, and 4 more while it decides.

    Parameters
    ----------
    lf
        Light field, whose colours vote.
    planes
        (K,) disparities front to back, K ≥ 3.
    smoothing
        Filter for the photo-consistency votes, with its guide.
    rule
        Weights.
    stride
        Count photo-consistency on every `stride`-th plane only, and if that is not every one in every other
        row and column of views: enough for a first map that says which views see what, before `recount`.
    """

    def __init__(
        self,
        lf: LightField,
        planes: NDArray[np.float64],
        smoothing: GuidedFilter,
        rule: JointRule,
        *,
        stride: int = 1,
    ) -> None:
        self.planes = planes
        self.rule = rule
        self.stride = stride if len(planes) >= 3 * stride else 1
        self._smoothing = smoothing
        self._colours = prepare_colours(lf, float(np.abs(planes).max()))
        self._residual = residual(lf, planes)
        low, high = threshold_bounds(self._residual.noise)
        self._thresholds = local_thresholds(lf.reference, low=low, high=high)
        self._texture = texture_weight(lf, self._residual.level)
        size = smoothing.guide.shape[:2]
        self._agreeing, self._share = np.empty(size, np.float32), np.empty(size, np.float32)
        self._signs = np.empty((len(planes), *size), np.float32)
        self._photo = np.empty((len(planes), *size), np.uint8)
        self._running, self._lowest = np.zeros(size, np.float32), np.zeros(size, np.float32)
        self._glossy = np.zeros(size, np.bool_)
        self._nearest: NearestSurfaces | None = None

    def update(self, index: int, smoothed: NDArray[np.float32], workers: Workers) -> None:
        """Take the smoothed sign votes of plane `index`, and count photo-consistency there."""
        step = np.float32(self.planes[0] - self.planes[1])
        workers.rows(
            len(smoothed), store_signs_kernel, step, smoothed, self._running, self._lowest, self._signs[index]
        )
        if index % self.stride == 0:
            self._count(index, None, workers)

    def recount(self, disparity: NDArray[np.float32], workers: Workers) -> Iterator[int]:
        """Count photo-consistency again on all planes, in the views that see past a first map (H, W).

        Yields the index of each plane done.
        """
        self.stride = 1
        stack = self._voting()
        self._nearest = nearest_surfaces(disparity, stack.present, stack.margin, stack.row_length, workers)
        for index in range(len(self.planes)):
            self._count(index, self._nearest, workers)
            yield index

    def replace_glossy(self, workers: Workers) -> None:
        """Leave glossy pixels to the photo votes of high-passed views (`gloss`), after `recount`."""
        if self.rule.photo_weight == 0 or self._nearest is None:
            return
        cells = suspects(self._colours, self._thresholds, self._texture, self.planes, workers)
        if not cells.any():
            return
        count = FineCount(self._voting(), self._thresholds, self._smoothing, self.planes, self._nearest)
        self._glossy = replace_shares(count, self._photo, cells, workers)
        self._signs[:, self._glossy] = 0

    def _voting(self) -> ColourStack:
        """The views, of which only those are present that vote at this stride."""
        return replace(self._colours, present=thinned(self._colours.present, sparse=self.stride > 1))

    def _count(self, index: int, nearest: NearestSurfaces | None, workers: Workers) -> None:
        plane = float(self.planes[index])
        photo_plane(self._voting(), plane, self._thresholds, workers, self._agreeing, nearest)
        self._smoothing.smooth_plane(self._agreeing, workers, self._share)
        workers.rows(len(self._share), store_photo_kernel, self._share, self._photo[index])

    def decide(self, workers: Workers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity and confidence, both (H, W)."""
        signs, photo = self._signs[:: self.stride], self._photo[:: self.stride]
        step = np.float32(self.planes[0] - self.planes[1])
        contrast = (photo.max(axis=0) - photo.mean(axis=0, dtype=np.float32)) / np.float32(255)
        weight = np.float32(self.rule.photo_weight) * ramp(contrast, 0.03, 0.1) * self._texture
        weight[self._glossy] *= np.float32(WEIGHT)
        total = self._smooth_paths(signs, photo, weight, workers)
        position = np.empty(weight.shape, np.float32)
        workers.rows(len(position), decode_kernel, total, position)
        fill_islands_kernel(position, len(signs), _LARGEST_ISLAND)
        if self.stride == 1 and self.rule.fit_radius > 0:
            radius, guide = self.rule.fit_radius, self._smoothing.guide
            position = fit_surfaces(position, (signs, photo, weight), guide, float(step), radius, workers)
        disparity = np.float32(self.planes[0]) - step * np.float32(self.stride) * position
        fit = np.clip((self._running - 2 * self._lowest) / (step * np.float32(len(self.planes))), 0, 1)
        fit[self._glossy] = contrast[self._glossy]  # there is no step to fit
        return disparity, np.sqrt(fit * np.clip(contrast, 0, 1))

    def _smooth_paths(
        self,
        signs: NDArray[np.float32],
        photo: NDArray[np.uint8],
        weight: NDArray[np.float32],
        workers: Workers,
    ) -> NDArray[np.int16]:
        """Energies (H, W, K) summed over the best paths from four sides."""
        height, width = weight.shape
        energy = np.empty((height, width, len(signs)), np.int16)
        workers.rows(height, energy_kernel, signs, photo, weight, energy)
        total = np.zeros(energy.shape, energy.dtype)  # pages are cleared where threads touch them first
        for kernel, length in ((horizontal_kernel, height), (vertical_kernel, width)):
            workers.rows(
                length,
                kernel,
                energy,
                total,
                self._smoothing.guide,
                np.float32(min(self.rule.slope_penalty * self.stride, self.rule.jump_penalty) * SCALE),
                np.float32(self.rule.jump_penalty * SCALE),
                np.float32(self.rule.edge_sharpness),
                np.float32(self._residual.level * self._smoothing.guide.shape[2]),
            )
        return total
