"""The numpy engine: each function of the protocol is a line or two of NumPy, or a call of this folder.

Nothing here knows the cpu engine's kernels: formulas and their numbers are written down anew, so that either
engine checks the other. What each function promises stands at `lfdepth.engines.base.Engine`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lfdepth.engines.base import Array, Bool, Box, Delta, EdgeColours, Float, Gradient
from lfdepth.engines.layout import SHARE_LEVELS, SURFACE_JUMP
from lfdepth.engines.plain import (
    costs,
    edges,
    energy,
    filters,
    labels,
    photo,
    pictures,
    refine,
    sides,
    voting,
)
from lfdepth.engines.plain import views as view_maps
from lfdepth.engines.plain.edges import Views
from lfdepth.engines.plain.filters import Prepared
from lfdepth.engines.plain.photo import ColourLevels, Surfaces
from lfdepth.engines.plain.refine import Splines
from lfdepth.engines.plain.voting import GreyLevels
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField


class NumpyEngine:
    """Plain NumPy on one thread.

    Parameters
    ----------
    threads
        At least 1; any number gives one thread.

    Raises
    ------
    LightFieldError
        If `threads` is below 1.
    """

    name: ClassVar[str] = "numpy"

    def __init__(self, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise LightFieldError(f"threads: found {threads}, expected at least 1")

    def close(self) -> None:
        """There is nothing to let go of."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- arrays are NumPy's

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
        """An array whose values are not set."""
        return np.empty(shape, dtype)

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
        """An array of zeros."""
        return np.zeros(shape, dtype)

    def upload(self, array: NDArray[Any]) -> Array:
        """The array itself."""
        return array

    def download(self, array: Array) -> NDArray[Any]:
        """The array itself."""
        return np.asarray(array)

    def each(self, act: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """One after the other."""
        return [act(item) for item in items]

    # --- a first look

    def match(
        self,
        reference: Float,
        views: Float,
        shifts: tuple[NDArray[np.float64], NDArray[np.float64]],
        sides: NDArray[np.int32],
        apertures: tuple[Float, Float],
        *,
        margin: int,
        apart: int,
        limit: float,
    ) -> tuple[NDArray[np.int32], Float]:
        """Best plane per pixel of all planes' costs."""
        costs = [
            pictures.plane_costs(reference, views, down, across, sides, apertures, margin, limit)
            for down, across in zip(*shifts, strict=True)
        ]
        return pictures.beside_best(np.array(costs), apart)

    # --- the vote of the signs

    def grey_views(self, lf: LightField, reach: float) -> GreyLevels:
        """Views in whole grey levels."""
        return voting.prepare(lf, reach)

    def vote(
        self,
        views: GreyLevels,
        disparity: float,
        votes: Array,
        evidence: Array,
        *,
        gradient: Gradient = "central",
        delta: Delta = "photo",
        threshold: float = 0.03,
        mask: tuple[Array, float] | None = None,
    ) -> None:
        """Count one plane."""
        votes[:], evidence[:] = voting.vote(views, disparity, delta, threshold, gradient, mask)

    def signs(self, views: GreyLevels, disparity: float, *, gradient: Gradient) -> tuple[Array, Array]:
        """Signs of all views; 0 for absent ones."""
        along_x, along_y = (np.zeros(views.levels.shape, np.int8) for _ in "xy")
        for each in voting.view_signs(views, disparity, gradient):
            along_x[each.view], along_y[each.view] = each.along_x, each.along_y
        return along_x, along_y

    def quotient(self, votes: Array, evidence: Array) -> Array:
        """Votes over evidence."""
        return np.divide(votes, evidence, out=np.zeros_like(votes), where=evidence > 0)

    def foreground(self, smoothed: Array) -> Array:
        """Where a slice is above 0."""
        return smoothed > 0

    # --- smoothing of slices

    def guided_filter(self, guide: Float, radius: int, epsilon: float) -> Prepared:
        """The guide's statistics."""
        return filters.prepare(guide, radius, epsilon)

    def smooth(self, prepared: Prepared, image: Array, out: Array) -> None:
        """Smooth a slice."""
        out[:] = filters.smooth(prepared, image)

    def smooth_quotient(self, prepared: Prepared, numerator: Array, denominator: Array, out: Array) -> None:
        """Smooth two slices and divide."""
        out[:] = filters.smooth_quotient(prepared, numerator, denominator)

    # --- streaming decoders

    def sign_step(self, plane: int, smoothed: Array, state: tuple[Array, Array, Array, Array, Array]) -> None:
        """Take a slice into the running sums."""
        total, lowest, index, before, after = state
        np.copyto(after, smoothed, where=index == plane - 1)
        total += smoothed
        lower = total < lowest
        for kept, new in ((lowest, total), (before, smoothed), (index, np.int32(plane))):
            np.copyto(kept, new, where=lower)

    def accumulate(self, smoothed: Array, count: Array) -> None:
        """Count foreground."""
        count += smoothed > 0

    # --- photo-consistency and visibility

    def colour_views(self, lf: LightField, reach: float, held: Bool | None = None) -> ColourLevels:
        """Views in whole levels."""
        return photo.prepare(lf, reach, held)

    def voting(self, views: ColourLevels, present: Bool) -> ColourLevels:
        """The same views, of which fewer or more vote."""
        return replace(views, present=present)

    def subgrid(self, views: ColourLevels, rows: slice, columns: slice) -> ColourLevels:
        """Some of the views."""
        return photo.subgrid(views, rows, columns)

    def high_passed(self, views: ColourLevels, box: Box) -> ColourLevels:
        """Views less their local mean."""
        return photo.high_passed(views, box)

    def nearest_surfaces(
        self, disparity: Float, views: ColourLevels, spare: Surfaces | None = None
    ) -> Surfaces:
        """Splat a map."""
        return photo.splat(disparity, views.present, views.offsets)

    def surfaces_in(self, surfaces: Surfaces, box: Box) -> Surfaces:
        """Surfaces in a box of the image."""
        return photo.surfaces_in(surfaces, box)

    def photo(
        self,
        views: ColourLevels,
        disparity: float,
        thresholds: Array,
        out: Array,
        *,
        surfaces: Surfaces | None = None,
        rows: tuple[int, int] | None = None,
    ) -> None:
        """Count one plane."""
        first, last = (0, views.size[0]) if rows is None else rows
        out[first:last] = photo.share(views, disparity, thresholds, np.arange(first, last), surfaces)

    def photo_peaks(
        self,
        views: ColourLevels,
        planes: NDArray[np.float64],
        thresholds: Array,
        rows: NDArray[np.int64],
    ) -> Float:
        """Largest share over planes in some rows."""
        return photo.peaks(views, planes, thresholds, rows)

    # --- the energy of signs and photo-consistency

    def store_signs(self, smoothed: Array, step: float, running: Array, lowest: Array, out: Array) -> None:
        """Keep a plane of the sign energy."""
        wide = np.float32(step)
        out[:] = running + np.float32(0.5) * wide * smoothed
        running += wide * smoothed
        np.minimum(lowest, running, out=lowest)

    def store_shares(self, share: Array, out: Array) -> None:
        """Keep a plane of shares."""
        out[:] = np.floor(np.clip(share, 0, 1) * np.float32(SHARE_LEVELS) + np.float32(0.5))

    def peak(self, shares: Array) -> NDArray[np.uint8]:
        """Largest share along the planes."""
        return np.asarray(shares.max(axis=0))

    def contrast(self, shares: Array) -> Float:
        """Largest less mean share along the planes."""
        return np.asarray((shares.max(axis=0) - shares.mean(axis=0)) / SHARE_LEVELS, np.float32)

    def put_where(self, volume: Array, mask: Bool, values: Array | float) -> None:
        """Replace pixels of a volume."""
        np.copyto(volume, values, where=mask)

    def paths(
        self,
        signs: Array,
        shares: Array,
        weight: Float,
        guide: Float,
        *,
        slope: float,
        jump: float,
        sharpness: float,
        noise: float,
    ) -> Array:
        """Energies (H, W, K) summed over the best paths from four sides."""
        whole = energy.whole_energies(signs, shares, weight)
        return energy.paths(whole, guide, slope, jump, sharpness, noise)

    def least(self, total: Array) -> Float:
        """Place of the least total."""
        return energy.least(total)

    def fill_islands(self, position: Float, planes: int, largest: int) -> None:
        """Fill islands at the ends of the range."""
        energy.fill_islands(position, planes, largest)

    def fit_planes(
        self,
        position: Float,
        signs: Array,
        shares: Array,
        weight: Float,
        guide: Float,
        *,
        radius: int,
        spacing: int,
        gate: float,
        prior: float,
        ridge: float,
        sharpness: float,
    ) -> Float:
        """Minima beside the positions, planes fitted to them, and the lattices of the fits made to agree."""
        target, strength = energy.own_minima(signs, shares, weight, position, prior)
        fitted = energy.fit(position, target, strength, guide, radius, spacing, gate, ridge, sharpness)
        return energy.even(fitted, guide, gate, sharpness)

    # --- refinement between planes

    def spline_views(self, lf: LightField, chosen: Bool) -> Splines:
        """Coefficients of interpolating splines."""
        return refine.prepare(lf, chosen)

    def ask_views(
        self,
        views: Splines,
        disparity: Float,
        *,
        margin: float,
        high_pass: float,
        noise_blur: float,
        least_noise: float,
        fewest: int,
        farthest: float,
        halving: float,
        jump: float,
        rims: tuple[float, ...],
        typical: float | None,
    ) -> tuple[Float, Float, Float, float]:
        """One Gauss–Newton step at every pixel."""
        return refine.ask(
            views,
            disparity,
            margin=margin,
            high_pass=high_pass,
            noise_blur=noise_blur,
            least_noise=least_noise,
            fewest=fewest,
            farthest=farthest,
            halving=halving,
            jump=jump,
            rims=rims,
            typical=typical,
        )

    def fit_steps(
        self,
        disparity: Float,
        target: Float,
        strength: Float,
        guide: Float,
        *,
        radius: int,
        spacing: int,
        gate: float,
        ridge: float,
        sharpness: float,
    ) -> Float:
        """Planes fitted to targets."""
        exact = target.astype(np.float64), strength.astype(np.float64)
        return energy.fit(disparity, *exact, guide, radius, spacing, gate, ridge, sharpness)

    def even_lattices(self, disparity: Float, guide: Float, *, gate: float, sharpness: float) -> Float:
        """Means over pairs of opposite pixels."""
        return energy.even(disparity, guide, gate, sharpness)

    def blur(self, image: Float, deviation: float) -> Float:
        """Gaussian mean."""
        return refine.blur(image, deviation).astype(np.float32)

    # --- depth edges and noise

    def views(self, lf: LightField) -> Views:
        """The views as they are."""
        return edges.prepare(lf)

    def decide_edges(
        self,
        views: Views,
        disparity: Float,
        surfaces: Surfaces,
        thresholds: Float,
        found: Bool,
        *,
        jump: float,
        spread: float,
        inertia: float,
        rows: tuple[int, int] | None = None,
    ) -> Float:
        """Decide every pixel beside an edge once."""
        part = slice(None) if rows is None else slice(*rows)
        at_edge = np.zeros(disparity.shape, np.bool_)
        decided = edges.decide(views, disparity, surfaces, thresholds, at_edge, jump, spread, inertia)
        found[part] |= at_edge[part]
        return decided[part]

    def edge_colours(
        self,
        views: Views,
        disparity: Float,
        places: NDArray[np.int64],
        sides: Float,
        surfaces: Surfaces,
        thresholds: Float,
    ) -> EdgeColours:
        """Colours and counts of a list of pixels."""
        return edges.edge_colours(views, disparity, places, sides, surfaces, thresholds)

    def surfaces_of(self, disparity: Float, views: Views, spare: Surfaces | None = None) -> Surfaces:
        """Splat a map."""
        return photo.splat(disparity, views.present, views.offsets)

    def median(
        self,
        disparity: Float,
        guide: Float,
        weight: Float | None,
        *,
        radius: int,
        sigma_colour: float,
        sigma_space: float,
    ) -> Float:
        """Weighted median."""
        return filters.weighted_median(disparity, guide, weight, radius, sigma_colour, sigma_space)

    def residuals(
        self,
        views: Views,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        planes: NDArray[np.float64],
    ) -> Float:
        """Least difference of each pixel to all views."""
        return edges.residuals(views, rows, columns, planes)

    def window_means(
        self, views: Views, points: NDArray[np.int64], disparity: NDArray[np.float64], reach: int
    ) -> tuple[Float, Bool]:
        """Mean levels of windows, and whether they are of use."""
        return edges.window_means(views, points, disparity, reach)

    # --- costs of planes

    def differences(
        self,
        views: ColourLevels,
        disparity: float,
        limits: Array,
        out: Array,
        *,
        beyond: float,
        itself: bool = False,
    ) -> None:
        """Truncated differences of one plane."""
        out[:] = costs.differences(views, disparity, limits, beyond, itself)

    def angular_entropy(self, views: ColourLevels, disparity: float, sigma: float, out: Array) -> None:
        """Entropy of one plane."""
        out[:] = costs.angular_entropy(views, disparity, sigma)

    def focal_symmetry(
        self,
        views: ColourLevels,
        planes: NDArray[np.float64],
        stacks: Bool,
        pairs: NDArray[np.int64],
        reach: int,
        sigma: float,
        out: Array,
        *,
        rows: tuple[int, int],
        stride: int = 1,
    ) -> None:
        """Differences of focal stacks; the stacks of all rows are made, and some rows of them used."""
        part = slice(*rows)
        out[:, part] = costs.focal_symmetry(views, planes, stacks, pairs, (reach, stride), sigma, part)

    # --- cost volumes

    def minima(self, volume: Array) -> tuple[NDArray[np.int32], Float]:
        """Least costs, and what lies around them."""
        return labels.minima(volume)

    def line_paths(self, volume: Array, weights: Float, table: Float) -> None:
        """Sums over the best paths."""
        volume[:] = labels.paths(volume, weights, table)

    def local_means(self, volume: Array, weights: Float, around: NDArray[np.int64], out: Array) -> None:
        """Weighted sums."""
        out[:] = labels.local_means(volume, weights, around)

    # --- two sides of a line, and two groups of views

    def histogram_distances(
        self,
        pictures: Array,
        bins: int,
        walk: tuple[int, int],
        corners: NDArray[np.int64],
        weights: Float,
        out: Array,
    ) -> None:
        """One bin after another."""
        out[:] = sides.histogram_distances(pictures, bins, walk, corners, weights)

    def view_groups(
        self, views: ColourLevels, disparity: float, groups: Array, means: Array, variances: Array
    ) -> None:
        """Means and variances over the views of each group."""
        means[:], variances[:] = sides.view_groups(views, disparity, groups)

    def patch_regions(
        self,
        picture: Float,
        points: NDArray[np.int64],
        *,
        radius: int,
        clusters: int,
        alike: float,
        rounds: int,
    ) -> Bool:
        """All patches at once."""
        return sides.patch_regions(picture, points, radius, clusters, alike, rounds)

    # --- pictures from many views

    def seen(self, disparity: Float, offset: tuple[float, float], *, plane: float = 0.0) -> Float:
        """What a view shows of a map."""
        front = np.full(disparity.shape, -np.inf, np.float32)
        moved = disparity - np.float32(plane)
        photo.land(front, moved, disparity, np.array(offset, np.float64), SURFACE_JUMP)
        return front

    def from_view(self, views: Views, at: tuple[int, int]) -> Views:
        """Another reference view."""
        others = views.present.copy()
        others[at] = False
        return replace(
            views, reference=views.views[at], others=others, offsets=views.offsets - views.offsets[at]
        )

    def known_surfaces(self, levels: NDArray[np.int16], views: Views) -> Surfaces:
        """Surfaces from maps."""
        return Surfaces(levels.astype(np.int32), slice(0, levels.shape[3]), np.empty((0, 0), np.float32))

    def carry(self, disparity: Float, beside: Float, offset: tuple[float, float]) -> tuple[Float, Float]:
        """Splat and sharpen."""
        return view_maps.carry(disparity, beside, self.seen(disparity, offset), offset)

    def support(
        self,
        views: Views,
        surfaces: Surfaces,
        places: NDArray[np.int64],
        candidates: Float,
        thresholds: Float,
        *,
        margin: float,
    ) -> Float:
        """Ask the views at places."""
        return view_maps.support(views, surfaces, places, candidates, thresholds, margin)

    def agree(
        self,
        maps: Float,
        own: int,
        partners: NDArray[np.int64],
        steps: NDArray[np.float64],
        *,
        tolerance: float,
    ) -> tuple[Float, NDArray[np.int32], NDArray[np.int32]]:
        """Hold a map against others."""
        return view_maps.agree(maps, own, partners, steps, tolerance)

    def gather(
        self,
        view: NDArray[Any],
        offset: tuple[float, float],
        disparity: Float,
        total: Float,
        count: Float,
        *,
        front: Float,
        limit: Float,
    ) -> None:
        """Add a view."""
        pictures.gather(view, offset, disparity, total, count, front, limit)
