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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.borders import PathBorders
from lfdepth.blocks.faint import ask_signs
from lfdepth.blocks.gloss import WEIGHT, FineCount, outermost, replace_shares, suspects, touched
from lfdepth.blocks.noise import Residual, ramp, residual, texture_weight, threshold_bounds
from lfdepth.blocks.photo import local_thresholds, thinned
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.blocks.surface import fit_surfaces
from lfdepth.engines import single
from lfdepth.engines.base import Array, ColourViews, Engine
from lfdepth.engines.layout import SHARE_LEVELS
from lfdepth.lightfield import LightField
from lfdepth.trace import Trace

# Disparities, px per view step, on either side of the best one that belong to it.
_ONE_PEAK = 0.3
_LARGEST_ISLAND = 2
"""Pixels up to which an island at an end of the range is filled."""

_CONTRAST = (0.01, 0.25)
"""Of photo-consistency along the planes, between which its weight rises from 0 to 1."""


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
    engine
        Engine; by default the processor's, on one thread.
    trace
        Takes note of time. May keep of every decision "sign energies", "joint energies" and "shares" in
        [0, 1], (K, H, W); "paths", the disparity (H, W) before planes are fitted; and "decisions".
    noise
        Levels at which views differ for no reason, where `lf` is a piece of the light field that they were
        measured in; None measures them here.
    borders
        How paths go on across the borders of such a piece; None where they begin and end there.
    """

    def __init__(
        self,
        lf: LightField,
        planes: NDArray[np.float64],
        smoothing: GuidedFilter,
        rule: JointRule,
        *,
        stride: int = 1,
        noise: Residual | None = None,
        borders: PathBorders | None = None,
        engine: Engine | None = None,
        trace: Trace | None = None,
    ) -> None:
        self.planes = planes
        self.rule = rule
        self.stride = stride if len(planes) >= 3 * stride else 1
        self._engine = engine or single()
        self._trace = trace or Trace()
        self._smoothing = smoothing
        self._borders = borders
        self._available = lf.available
        grid = lf.shape[0], lf.shape[1]
        held = thinned(lf.available, sparse=False) | outermost(grid)  # views that any count looks at
        self._colours = self._engine.colour_views(lf, float(np.abs(planes).max()), held)
        self._residual = noise or residual(lf, planes, engine=self._engine)
        low, high = threshold_bounds(self._residual.noise)
        self._thresholds = local_thresholds(lf.reference, low=low, high=high)
        self._bounds = self._engine.upload(self._thresholds)
        self._texture = texture_weight(lf, self._residual.level)
        size = lf.height, lf.width
        self._agreeing, self._share = (self._engine.empty(size, np.float32) for _ in "12")
        self._signs = self._engine.empty((len(planes), *size), np.float32)
        self._shares = self._engine.empty((len(planes), *size), np.uint8)
        self._running, self._lowest = (self._engine.zeros(size, np.float32) for _ in "12")
        self._glossy = np.zeros(size, np.bool_)
        self._weight = np.zeros(size, np.float32)
        self._reach = float(np.abs(lf.offsets[lf.available]).max())
        self._surfaces: Any = None
        self._voters: tuple[int, ColourViews] | None = None

    @property
    def step(self) -> float:
        """Distance of planes, px per view step."""
        return float(self.planes[0] - self.planes[1])

    def update(self, index: int, smoothed: Array) -> None:
        """Take the smoothed sign votes of plane `index`, and count photo-consistency there."""
        with self._trace.block("decoding"):
            self._engine.store_signs(smoothed, self.step, self._running, self._lowest, self._signs[index])
        if index % self.stride == 0:
            self._count(index)

    def recount(self, disparity: NDArray[np.float32]) -> Iterator[int]:
        """Count photo-consistency again on all planes, in the views that see past a first map (H, W).

        Yields the index of each plane done.
        """
        self.stride = 1
        self._surfaces = self._engine.nearest_surfaces(disparity, self._voting())
        for index in range(len(self.planes)):
            self._count(index)
            yield index

    def replace_glossy(self, within: tuple[slice, slice] | None = None) -> None:
        """Leave glossy pixels to the photo votes of high-passed views (`gloss`), after `recount`.

        With `within`, rows and columns, only where cells touch that part of the picture.
        """
        if self.rule.photo_weight == 0 or self._surfaces is None:
            return
        cells = suspects(self._engine, self._colours, self._bounds, self._texture, self.planes)
        if within is not None:
            cells &= touched(cells.shape, within)
        if not cells.any():
            return
        count = FineCount(
            self._engine, self._voting(), self._thresholds, self._smoothing, self.planes, self._surfaces
        )
        self._glossy = replace_shares(count, self._shares, cells)
        self._engine.put_where(self._signs, self._glossy, 0)

    def _voting(self) -> ColourViews:
        """The views, of which only those are present that vote at this stride."""
        if self._voters is None or self._voters[0] != self.stride:
            chosen = thinned(self._available, sparse=self.stride > 1)
            self._voters = self.stride, self._engine.voting(self._colours, chosen)
        return self._voters[1]

    def _count(self, index: int) -> None:
        plane = float(self.planes[index])
        with self._trace.block("voting"):
            self._engine.photo(self._voting(), plane, self._bounds, self._agreeing, surfaces=self._surfaces)
        with self._trace.block("smoothing"):
            self._smoothing.smooth(self._agreeing, self._share)
        with self._trace.block("decoding"):
            self._engine.store_shares(self._share, self._shares[index])

    def decide(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Disparity and confidence, both (H, W)."""
        signs, shares = self._signs[:: self.stride], self._shares[:: self.stride]
        contrast = self._engine.contrast(shares)
        weight = np.float32(self.rule.photo_weight) * ramp(contrast, *_CONTRAST) * self._texture
        weight[self._glossy] *= np.float32(WEIGHT)
        self._weight = weight
        self._keep(signs, shares, weight)
        with self._trace.block("paths"):
            position = self._engine.least(self._smooth_paths(signs, shares, weight))
            self._engine.fill_islands(position, len(signs), _LARGEST_ISLAND)
        self._trace.take("paths", lambda: self._disparity(position))
        if self.stride == 1 and self.rule.fit_radius > 0:
            energy, guide, radius = (signs, shares, weight), self._smoothing.guide, self.rule.fit_radius
            with self._trace.block("planes"):
                position = fit_surfaces(position, energy, guide, self.step, radius, engine=self._engine)
        disparity = self._disparity(position)
        self._trace.take("decisions", lambda: disparity)
        return disparity, self._confidence(contrast)

    def standing_out(self, points: NDArray[np.int64]) -> NDArray[np.float32]:
        """How much more views agree with the best disparity of pixels (N, 2) than with others, 0 to 1."""
        shares = self._engine.download(self._shares)[:, points[:, 0], points[:, 1]]
        near = max(3, round(_ONE_PEAK / self.step))
        others = np.abs(np.arange(len(shares))[:, None] - shares.argmax(axis=0)) > near
        second = np.where(others, shares, 0).max(axis=0)
        apart = shares.max(axis=0).astype(np.float32) - second
        return np.asarray(apart / np.float32(SHARE_LEVELS), np.float32)

    def ask_signs(self, disparity: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What the signs say of a map (H, W) where photo votes weighed little in the last decision."""
        evidence = self._signs, self.planes, disparity, self._weight, self._reach
        return ask_signs(*evidence, engine=self._engine)

    def _disparity(self, position: NDArray[np.float32]) -> NDArray[np.float32]:
        """Disparity at places counted in planes of this stride."""
        step = np.float32(self.step) * np.float32(self.stride)
        return np.asarray(np.float32(self.planes[0]) - step * position, np.float32)

    def _keep(self, signs: Array, shares: Array, weight: NDArray[np.float32]) -> None:
        """Offer the energies of a decision to the trace."""
        down, trace = self._engine.download, self._trace
        trace.take("sign energies", lambda: down(signs))
        trace.take("shares", lambda: down(shares) / np.float32(SHARE_LEVELS))
        trace.take("joint energies", lambda: down(signs) - weight * (down(shares) / np.float32(SHARE_LEVELS)))

    def _confidence(self, contrast: NDArray[np.float32]) -> NDArray[np.float32]:
        """How well one step fits the profile, and how much the peak of the shares stands out."""
        running, lowest = (self._engine.download(each) for each in (self._running, self._lowest))
        fit = np.clip((running - 2 * lowest) / (np.float32(self.step) * np.float32(len(self.planes))), 0, 1)
        fit[self._glossy] = contrast[self._glossy]  # there is no step to fit
        return np.asarray(np.sqrt(fit * np.clip(contrast, 0, 1)), np.float32)

    def _smooth_paths(self, signs: Array, shares: Array, weight: NDArray[np.float32]) -> Array:
        """Energies (H, W, K) summed over the best paths from four sides."""
        guide, engine, borders = self._smoothing.guide, self._engine, self._borders
        if borders is None:
            return self._paths(signs, shares, weight, guide)
        with borders.open(signs, weight, guide, engine) as cut:
            borders.note(signs, shares, weight, cut, self._paths, engine)
            return self._paths(signs, shares, weight, cut)

    def _paths(
        self, signs: Array, shares: Array, weight: NDArray[np.float32], guide: NDArray[np.float32]
    ) -> Array:
        rule = self.rule
        return self._engine.paths(
            signs,
            shares,
            weight,
            guide,
            slope=min(rule.slope_penalty * self.stride, rule.jump_penalty),
            jump=rule.jump_penalty,
            sharpness=rule.edge_sharpness,
            noise=self._residual.level * self._smoothing.guide.shape[2],
        )
