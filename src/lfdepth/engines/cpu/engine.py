"""The CPU engine: kernels compiled by numba, run over bands of rows by a pool of threads.

Functions check nothing that blocks have checked. What each promises stands at `lfdepth.engines.base.Engine`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lfdepth.engines.base import Array, Bool, Box, Delta, EdgeColours, Float, Gradient
from lfdepth.engines.cpu import guided, layout, medians
from lfdepth.engines.cpu.kernels import decode as decode_kernels
from lfdepth.engines.cpu.kernels import differences as difference_kernels
from lfdepth.engines.cpu.kernels import edge_colours as edge_colour_kernels
from lfdepth.engines.cpu.kernels import edges as edge_kernels
from lfdepth.engines.cpu.kernels import energy as energy_kernels
from lfdepth.engines.cpu.kernels import entropy as entropy_kernels
from lfdepth.engines.cpu.kernels import focusing as focusing_kernels
from lfdepth.engines.cpu.kernels import gloss as gloss_kernels
from lfdepth.engines.cpu.kernels import groups as group_kernels
from lfdepth.engines.cpu.kernels import histograms as histogram_kernels
from lfdepth.engines.cpu.kernels import labels as label_kernels
from lfdepth.engines.cpu.kernels import matching as matching_kernels
from lfdepth.engines.cpu.kernels import noise as noise_kernels
from lfdepth.engines.cpu.kernels import photo as photo_kernels
from lfdepth.engines.cpu.kernels import refine as refine_kernels
from lfdepth.engines.cpu.kernels import stacks as stack_kernels
from lfdepth.engines.cpu.kernels import surface as surface_kernels
from lfdepth.engines.cpu.kernels import views as view_kernels
from lfdepth.engines.cpu.kernels import visibility as visibility_kernels
from lfdepth.engines.cpu.kernels import voting as voting_kernels
from lfdepth.engines.cpu.kernels import windows as windows_kernels
from lfdepth.engines.cpu.layout import ColourStack, GreyStack, NearestSurfaces, SplineViews, ViewsAsTheyAre
from lfdepth.engines.cpu.workers import Workers
from lfdepth.engines.layout import (
    COLOUR_WHITE,
    DISPARITY_LIMIT,
    DISPARITY_PARTS,
    ENERGY_SCALE,
    GREY_WHITE,
    PATH_STEPS,
    SHARE_LEVELS,
    SURFACE_JUMP,
    UNKNOWN_SURFACE,
    VISIBILITY_MARGIN,
    grey_levels,
    nearest_pixels,
    plane_horizon,
    shifts,
    vote_tolerance,
)
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

_FALLEN = 6.0
"""Standard deviations beyond which a level weighs nothing in an entropy."""


class CpuEngine:
    """Kernels on the processor.

    Parameters
    ----------
    threads
        Number of threads; None takes every processor this process may use. Results do not depend on it.

    Raises
    ------
    LightFieldError
        If `threads` is below 1.
    """

    name: ClassVar[str] = "cpu"

    def __init__(self, threads: int | None = None) -> None:
        self.workers = Workers(threads)

    def close(self) -> None:
        """Let the threads go."""
        self.workers.close()

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
        """An array of zeros; pages are cleared where threads touch them first."""
        return np.zeros(shape, dtype)

    def upload(self, array: NDArray[Any]) -> Array:
        """The array itself, contiguous."""
        return np.ascontiguousarray(array)

    def download(self, array: Array) -> NDArray[Any]:
        """The array itself."""
        return np.asarray(array)

    def each(self, act: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """By the same threads as kernels."""
        return self.workers.each(act, items)

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
        """Best plane per pixel, and costs beside it."""
        height, width = reference.shape
        sums = np.empty((height, len(apertures[0]), width), np.float32)
        recent = np.empty((apart + 1, height, width), np.float32)
        farther = np.full((height, width), np.inf, np.float32)
        costs = np.full((4, height, width), np.inf, np.float32)
        best = np.zeros((height, width), np.int32)
        for index, (down, across) in enumerate(zip(*shifts, strict=True)):
            sampling = (reference, views, down, across, sides, margin, limit)
            self.workers.rows(height, matching_kernels.difference_kernel, sums, *sampling)
            found = (sums, *apertures, index, apart, recent, farther, best, costs)
            self.workers.rows(height, matching_kernels.compare_kernel, *found)
        return best, costs

    # --- the vote of the signs

    def grey_views(self, lf: LightField, reach: float) -> GreyStack:
        """Grey views with padded rows."""
        return layout.grey_stack(self.workers, lf, reach)

    def vote(
        self,
        views: GreyStack,
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
        padded, reach, placing = _placed_mask(views, mask)
        self.workers.rows(
            views.size[0],
            voting_kernels.vote_kernel,
            votes,
            evidence,
            padded,
            reach,
            placing,
            *_grey_sampling(views, disparity),
            vote_tolerance(delta, threshold),
            (gradient == "sobel", delta == "sign", mask is not None),
            np.int16(1),
        )

    def signs(self, views: GreyStack, disparity: float, *, gradient: Gradient) -> tuple[Array, Array]:
        """Signs of all views; 0 for absent ones."""
        shape = (*views.grid, *views.size)
        signs = np.zeros(shape, np.int8), np.zeros(shape, np.int8)
        sampling = _grey_sampling(views, disparity)
        self.workers.rows(views.size[0], voting_kernels.sign_kernel, *signs, *sampling, gradient == "sobel")
        return signs

    def quotient(self, votes: Array, evidence: Array) -> Array:
        """Votes over evidence."""
        return np.divide(votes, evidence, out=np.zeros_like(votes), where=evidence > 0)

    def foreground(self, smoothed: Array) -> Array:
        """Where a slice is above 0."""
        return smoothed > 0

    # --- smoothing of slices

    def guided_filter(self, guide: Float, radius: int, epsilon: float) -> guided.Prepared:
        """The guide's statistics, row by row."""
        return guided.prepare(self.workers, guide, radius, epsilon)

    def smooth(self, prepared: guided.Prepared, image: Array, out: Array) -> None:
        """Smooth a slice."""
        guided.smooth(self.workers, prepared, image, image, False, out)

    def smooth_quotient(
        self, prepared: guided.Prepared, numerator: Array, denominator: Array, out: Array
    ) -> None:
        """Smooth two slices and divide."""
        guided.smooth(self.workers, prepared, numerator, denominator, True, out)

    # --- streaming decoders

    def sign_step(self, plane: int, smoothed: Array, state: tuple[Array, Array, Array, Array, Array]) -> None:
        """Take a slice into the running sums."""
        self.workers.rows(len(smoothed), decode_kernels.sign_step_kernel, plane, smoothed, *state)

    def accumulate(self, smoothed: Array, count: Array) -> None:
        """Count foreground."""
        count += smoothed > 0

    # --- photo-consistency and visibility

    def colour_views(self, lf: LightField, reach: float, held: Bool | None = None) -> ColourStack:
        """Views with padded rows; those that are not held take no memory."""
        return layout.colour_stack(self.workers, lf, reach, held)

    def voting(self, views: ColourStack, present: Bool) -> ColourStack:
        """The same views, of which fewer or more vote."""
        return replace(views, present=present)

    def subgrid(self, views: ColourStack, rows: slice, columns: slice) -> ColourStack:
        """A copy of some views."""
        v, u = (
            range(count)[part].index(index)
            for count, part, index in zip(views.grid, (rows, columns), views.reference, strict=True)
        )
        part = (rows, columns)
        return replace(
            views,
            data=views.data.reshape(*views.grid, -1)[part].reshape(-1),
            present=np.ascontiguousarray(views.present[part]),
            held=np.ascontiguousarray(views.held[part]),
            offsets=np.ascontiguousarray(views.offsets[part]),
            reference=(v, u),
        )

    def high_passed(self, views: ColourStack, box: Box) -> ColourStack:
        """High-passed views that vote; the others are left undefined."""
        rows, columns = box
        height, width = rows.stop - rows.start, columns.stop - columns.start
        length = layout.round_width(width) + 2 * views.margin
        source = views.data.reshape(*views.grid, views.size[0], views.channels, views.row_length)
        out = np.empty((*views.grid, height, views.channels, length), source.dtype)
        voting = np.argwhere(views.present)
        corner = (rows.start, columns.start)
        place = (source, views.margin, views.size[1], corner, out)
        self.workers.rows(len(voting), gloss_kernels.high_pass_kernel, voting, *place)
        return replace(
            views, data=out.reshape(-1), size=(height, width), row_length=length, held=views.present
        )

    def nearest_surfaces(
        self, disparity: Float, views: ColourStack, spare: NearestSurfaces | None = None
    ) -> NearestSurfaces:
        """Splat a map into views laid out like the stack."""
        place = (views.present, views.offsets, views.margin, views.row_length)
        return self._splat(disparity, *place, spare)

    def surfaces_of(
        self, disparity: Float, views: ViewsAsTheyAre, spare: NearestSurfaces | None = None
    ) -> NearestSurfaces:
        """Splat a map into views without margins."""
        return self._splat(disparity, views.present, views.offsets, 0, disparity.shape[1], spare)

    def _splat(
        self,
        disparity: Float,
        present: Bool,
        offsets: NDArray[np.float64],
        margin: int,
        row_length: int,
        spare: NearestSurfaces | None,
    ) -> NearestSurfaces:
        count, disparity = present.size * disparity.shape[0], np.ascontiguousarray(disparity)
        # Fresh memory costs as much as the splats.
        fits = spare is not None and spare.data.size == count * row_length
        data = spare.data if fits and spare is not None else np.empty(count * row_length, np.int16)
        levels = np.clip(disparity * np.float32(DISPARITY_PARTS), -DISPARITY_LIMIT, DISPARITY_LIMIT)
        rows = np.empty(count, np.int16)
        self.workers.rows(
            present.size,
            visibility_kernels.splat_kernel,
            disparity,
            levels.astype(np.int16),
            present,
            offsets,
            data,
            rows,
            margin,
            row_length,
            np.float32(SURFACE_JUMP * DISPARITY_PARTS),
            np.int16(UNKNOWN_SURFACE),
        )
        grid = present.shape[0], present.shape[1]
        return NearestSurfaces(data, rows, grid, margin, row_length, disparity)

    def surfaces_in(self, surfaces: NearestSurfaces, box: Box) -> NearestSurfaces:
        """Surfaces in a box of the image."""
        return layout.surfaces_in(surfaces, box, box[1].stop - box[1].start)

    def photo(
        self,
        views: ColourStack,
        disparity: float,
        thresholds: Array,
        out: Array,
        *,
        surfaces: NearestSurfaces | None = None,
        rows: tuple[int, int] | None = None,
    ) -> None:
        """Count one plane."""
        first, last = (0, views.size[0]) if rows is None else rows
        lines = np.arange(views.size[0])
        arguments = _photo_arguments(views, disparity, thresholds, surfaces)
        self.workers.rows(last, photo_kernels.photo_kernel, lines, out, *arguments, first=first)

    def photo_peaks(
        self, views: ColourStack, planes: NDArray[np.float64], thresholds: Array, rows: NDArray[np.int64]
    ) -> Float:
        """Largest share over planes in some rows."""
        peaks = np.zeros((len(rows), views.size[1]), np.float32)
        shares = np.empty_like(peaks)
        for plane in planes:
            arguments = _photo_arguments(views, float(plane), thresholds, None)
            self.workers.rows(len(rows), photo_kernels.photo_kernel, rows, shares, *arguments)
            self.workers.rows(len(rows), gloss_kernels.peak_kernel, shares, peaks)
        return peaks

    # --- the energy of signs and photo-consistency

    def store_signs(self, smoothed: Array, step: float, running: Array, lowest: Array, out: Array) -> None:
        """Keep a plane of the sign energy."""
        state = (running, lowest, out)
        self.workers.rows(
            len(smoothed), energy_kernels.store_signs_kernel, np.float32(step), smoothed, *state
        )

    def store_shares(self, share: Array, out: Array) -> None:
        """Keep a plane of shares."""
        self.workers.rows(len(share), energy_kernels.store_photo_kernel, share, out)

    def peak(self, shares: Array) -> NDArray[np.uint8]:
        """Largest share along the planes."""
        return np.asarray(shares.max(axis=0))

    def contrast(self, shares: Array) -> Float:
        """Largest less mean share along the planes."""
        spread = np.empty(shares.shape[1:], np.float32)

        def fill(first: int, last: int) -> None:
            part = shares[:, first:last]
            spread[first:last] = part.max(axis=0) - part.mean(axis=0, dtype=np.float32)
            spread[first:last] /= np.float32(SHARE_LEVELS)

        self.workers.rows(len(spread), fill)
        return spread

    def put_where(self, volume: Array, mask: Bool, values: Array | float) -> None:
        """Replace pixels of a volume."""
        volume[:, mask] = values[:, mask] if isinstance(values, np.ndarray) else values

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
        height, width = weight.shape
        energy = np.empty((height, width, len(signs)), np.int16)
        # Of every other plane, too: a copy takes less time than a kernel for other strides.
        volumes = np.ascontiguousarray(signs), np.ascontiguousarray(shares)
        self.workers.rows(height, energy_kernels.energy_kernel, *volumes, weight, energy)
        total = np.zeros(energy.shape, energy.dtype)
        penalties = [
            np.float32(each) for each in (slope * ENERGY_SCALE, jump * ENERGY_SCALE, sharpness, noise)
        ]
        for kernel, length in (
            (energy_kernels.horizontal_kernel, height),
            (energy_kernels.vertical_kernel, width),
        ):
            self.workers.rows(length, kernel, energy, total, guide, *penalties)
        return total

    def least(self, total: Array) -> Float:
        """Place of the least total."""
        position = np.empty(total.shape[:2], np.float32)
        self.workers.rows(len(position), energy_kernels.decode_kernel, total, position)
        return position

    def fill_islands(self, position: Float, planes: int, largest: int) -> None:
        """Fill islands at the ends of the range."""
        self.workers.once(energy_kernels.fill_islands_kernel, position, planes, largest)

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
        target, strength, fitted = (np.empty_like(position) for _ in "123")
        height, near, steep = len(position), np.float32(gate), np.float32(sharpness)
        planar = np.ascontiguousarray(np.moveaxis(guide, 2, 0), np.float32).reshape(-1)
        energy = (signs, shares, weight)
        rows = self.workers.rows
        rows(height, surface_kernels.minima_kernel, *energy, position, np.float32(prior), target, strength)
        flat = [each.reshape(-1) for each in (position, target, strength)]
        window, likeness = (radius, spacing), (near, steep, np.float32(ridge))
        rows(height, surface_kernels.fit_kernel, *flat, planar, guide.shape, window, *likeness, fitted)
        place = (fitted.reshape(-1), planar, guide.shape, near, steep)
        rows(height, surface_kernels.even_kernel, *place, target)
        return target

    # --- refinement between planes

    def spline_views(self, lf: LightField, chosen: Bool) -> SplineViews:
        """Coefficients, and what the kernels have to know of the views."""
        at = np.argwhere(chosen)
        pad = 2 * refine_kernels.PAD
        data = np.empty((len(at), lf.height + pad, lf.width + pad), np.float32)
        scale = np.float32(255 / lf.full_scale)
        self.workers.rows(len(at), refine_kernels.spline_kernel, lf.views, scale, at, data)
        origin = grey_levels(lf.reference) * np.float32(255 / GREY_WHITE)
        return SplineViews(data, at, chosen, lf.offsets, origin)

    def ask_views(
        self,
        views: SplineViews,
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
        """Moments over the views that see each pixel, and what follows from them."""
        height, width = disparity.shape
        disparity = np.ascontiguousarray(disparity)
        rows, single = self.workers.rows, np.float32
        surfaces = self._splat(disparity, views.chosen, views.offsets, 0, width, None)
        moments = np.empty((height, refine_kernels.MOMENTS, width), single)
        seen = (surfaces.data, single(margin), views.origin, moments)
        rows(height, refine_kernels.moments_kernel, disparity, views.data, views.standing, *seen)
        maps, spreads = np.empty((4, height, width), single), np.empty((3, height, width), single)
        rows(height, refine_kernels.slopes_kernel, moments, views.origin, fewest, maps, spreads)
        fine, taps = np.empty_like(maps[:3]), _gaussian(high_pass)
        for index in range(3):
            rows(height, refine_kernels.blur_kernel, maps[index], taps, True, fine[index])
        if typical is None:
            differing = maps[3][maps[3] > 0]
            typical = float(np.median(differing)) if differing.size else 0.0
        noise = np.maximum(self.blur(maps[3], noise_blur), single(max(typical, least_noise)))
        step, weight, trusted = (np.empty_like(disparity) for _ in "123")
        rule = (single(farthest), single(halving), single(jump))
        near, out = np.array(rims, single), (step, weight, trusted)
        rows(height, refine_kernels.evidence_kernel, fine, spreads, noise, disparity, rule, near, *out)
        return step, weight, trusted, typical

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
        out, planar = np.empty_like(disparity), _planar(guide)
        flat = [each.reshape(-1) for each in (disparity, target, strength)]
        likeness = (np.float32(gate), np.float32(sharpness), np.float32(ridge))
        place = (planar, guide.shape, (radius, spacing))
        self.workers.rows(len(out), surface_kernels.fit_kernel, *flat, *place, *likeness, out)
        return out

    def even_lattices(self, disparity: Float, guide: Float, *, gate: float, sharpness: float) -> Float:
        """Means over pairs of opposite pixels."""
        out, planar = np.empty_like(disparity), _planar(guide)
        likeness = (np.float32(gate), np.float32(sharpness))
        place = (disparity.reshape(-1), planar, guide.shape)
        self.workers.rows(len(out), surface_kernels.even_kernel, *place, *likeness, out)
        return out

    def blur(self, image: Float, deviation: float) -> Float:
        """Separable Gaussian mean."""
        out = np.empty_like(image)
        self.workers.rows(len(out), refine_kernels.blur_kernel, image, _gaussian(deviation), False, out)
        return out

    # --- depth edges and noise

    def views(self, lf: LightField) -> ViewsAsTheyAre:
        """The views as they are."""
        return layout.views_as_they_are(lf)

    def decide_edges(
        self,
        views: ViewsAsTheyAre,
        disparity: Float,
        surfaces: NearestSurfaces,
        thresholds: Float,
        found: Bool,
        *,
        jump: float,
        spread: float,
        inertia: float,
        rows: tuple[int, int] | None = None,
    ) -> Float:
        """Decide every pixel beside an edge once."""
        first, last = (0, len(disparity)) if rows is None else rows
        decided = np.empty_like(disparity)  # pages of other rows are never touched
        decided[first:last] = disparity[first:last]
        self.workers.rows(
            last,
            edge_kernels.edge_kernel,
            disparity,
            *_beside_edges(views, surfaces, thresholds),
            np.float32(jump),
            np.float32(spread),
            np.float32(inertia),
            decided,
            found,
            first=first,
        )
        return decided[first:last]

    def edge_colours(
        self,
        views: ViewsAsTheyAre,
        disparity: Float,
        places: NDArray[np.int64],
        sides: Float,
        surfaces: NearestSurfaces,
        thresholds: Float,
    ) -> EdgeColours:
        """Colours and counts of a list of pixels."""
        size = len(places), views.views.shape[-1]
        front, back = np.zeros(size, np.float32), np.zeros(size, np.float32)
        spreads, counts = np.zeros((len(places), 2), np.float32), np.zeros((len(places), 6), np.float32)
        self.workers.rows(
            len(places),
            edge_colour_kernels.edge_colours_kernel,
            places,
            sides,
            disparity,
            *_beside_edges(views, surfaces, thresholds),
            front,
            back,
            spreads,
            counts,
        )
        return EdgeColours(front, back, spreads, counts)

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
        """Weighted median by sorting networks."""
        return medians.weighted_median(
            self.workers, disparity, guide, weight, radius, sigma_colour, sigma_space
        )

    def residuals(
        self,
        views: ViewsAsTheyAre,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        planes: NDArray[np.float64],
    ) -> Float:
        """Least difference of each pixel to all views."""
        least = np.full(len(rows), np.inf, np.float32)
        others = (views.others, views.offsets)
        place = (views.views, views.reference, others, rows, columns, planes, least)
        self.workers.rows(len(rows), noise_kernels.residual_kernel, *place)
        return least

    def window_means(
        self,
        views: ViewsAsTheyAre,
        points: NDArray[np.int64],
        disparity: NDArray[np.float64],
        reach: int,
    ) -> tuple[Float, NDArray[np.bool_]]:
        """Mean levels of windows, and whether they are of use."""
        count = views.views.shape[0] * views.views.shape[1]
        means = np.empty((count, len(points), views.views.shape[4]), np.float32)
        usable = np.empty(means.shape, np.bool_)
        white = np.float32(255 / views.to_bytes)
        places = np.ascontiguousarray(points)  # in one order, or the kernel is compiled for two
        source = (views.views, views.present, views.offsets, places, disparity, reach, white)
        self.workers.rows(count, windows_kernels.window_kernel, *source, means, usable)
        return means, usable

    # --- costs of planes

    def differences(
        self,
        views: ColourStack,
        disparity: float,
        limits: Array,
        out: Array,
        *,
        beyond: float,
        itself: bool = False,
    ) -> None:
        """Truncated differences of one plane."""
        place = (out, limits, beyond, *_colour_sampling(views, disparity), itself)
        self.workers.rows(views.size[0], difference_kernels.difference_kernel, *place)

    def angular_entropy(self, views: ColourStack, disparity: float, sigma: float, out: Array) -> None:
        """Entropy of one plane."""
        place = (out, *_bins(sigma, int(views.present.sum())), *_colour_sampling(views, disparity))
        self.workers.rows(views.size[0], entropy_kernels.entropy_kernel, *place)

    def focal_symmetry(
        self,
        views: ColourStack,
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
        """Differences of focal stacks, a few pixels of a row at all planes at a time."""
        moved = [views.shifts(float(plane)) for plane in planes]
        used = np.argwhere(stacks.any(axis=0) & views.present)
        v, u = used.T
        down, across = (
            np.array([getattr(plane, way)[v, u] for plane in moved]) for way in ("down", "across")
        )
        weights = np.array([plane.weights[v, u] for plane in moved], np.int16)
        member = np.ascontiguousarray(stacks[:, v, u])
        shape = (*views.grid, views.size[0], views.channels, views.row_length, views.margin, 0)
        source = (views.data, shape, v * views.grid[1] + u, down, across, weights)
        scale = np.float32(1 / (64 * 2 * views.channels * (sigma * COLOUR_WHITE) ** 2))
        place = (out, *source, member, pairs, (reach, stride), scale)
        self.workers.rows(rows[1], stack_kernels.symmetry_kernel, *place, first=rows[0])

    # --- cost volumes

    def minima(self, volume: Array) -> tuple[NDArray[np.int32], Float]:
        """Least costs, and what lies around them."""
        index = np.empty(volume.shape[1:], np.int32)
        beside = np.empty((4, *index.shape), np.float32)
        self.workers.rows(len(index), label_kernels.minima_kernel, volume, index, beside)
        return index, beside

    def line_paths(self, volume: Array, weights: Float, table: Float) -> None:
        """Sums over the best paths, line by line, labels innermost."""
        count, height, width = volume.shape
        energy, total = (
            np.empty((height, width, count), np.float32),
            np.zeros((height, width, count), np.float32),
        )

        def turn(first: int, last: int) -> None:
            energy[first:last] = volume[:, first:last].transpose(1, 2, 0)

        def turn_back(first: int, last: int) -> None:
            volume[:, first:last] = total[first:last].transpose(2, 0, 1)

        self.workers.rows(height, turn)
        lines = (height, width, height + width - 1, height + width - 1)
        for weight, step, number in zip(weights, PATH_STEPS, lines, strict=False):
            place = (energy, total, np.ascontiguousarray(weight), table, step)
            self.workers.rows(number, label_kernels.path_kernel, *place)
        self.workers.rows(height, turn_back)

    def local_means(self, volume: Array, weights: Float, around: NDArray[np.int64], out: Array) -> None:
        """Weighted sums, a row of all slices at once."""
        place = (volume, weights, around, out)
        self.workers.rows(volume.shape[1], label_kernels.local_mean_kernel, *place)

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
        """Histograms of all labels side by side."""
        place = (pictures, bins, walk, corners, weights, out)
        self.workers.rows(out.shape[1], histogram_kernels.histogram_kernel, *place)

    def view_groups(
        self, views: ColourStack, disparity: float, groups: Array, means: Array, variances: Array
    ) -> None:
        """Sums over the views of each row."""
        place = (groups, *_colour_sampling(views, disparity), means, variances)
        self.workers.rows(views.size[0], group_kernels.group_kernel, *place)

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
        """Point by point."""
        side = 2 * radius + 1
        found = np.empty((len(points), side * side), np.bool_)
        rule = (radius, clusters, float(alike), rounds)
        self.workers.rows(len(points), group_kernels.region_kernel, picture, points, *rule, found)
        return found.reshape(-1, side, side)

    # --- pictures from many views

    def seen(self, disparity: Float, offset: tuple[float, float], *, plane: float = 0.0) -> Float:
        """What a view shows of a map."""
        disparity = np.ascontiguousarray(disparity)
        front, rows = np.empty(disparity.size, np.float32), np.empty(len(disparity), np.float32)
        moved = disparity - np.float32(plane)
        place = (np.ones((1, 1), np.bool_), np.array(offset, np.float64).reshape(1, 1, 2), front, rows)
        ends = (0, disparity.shape[1], np.float32(SURFACE_JUMP), np.float32(-np.inf))
        self.workers.once(visibility_kernels.splat_kernel, 0, 1, moved, disparity, *place, *ends)
        return front.reshape(disparity.shape)

    def from_view(self, views: ViewsAsTheyAre, at: tuple[int, int]) -> ViewsAsTheyAre:
        """Another reference view."""
        others = views.present.copy()
        others[at] = False
        return replace(
            views, reference=views.views[at], others=others, offsets=views.offsets - views.offsets[at]
        )

    def known_surfaces(self, levels: NDArray[np.int16], views: ViewsAsTheyAre) -> NearestSurfaces:
        """The levels themselves; neither is the nearest of a row asked for, nor a map."""
        grid, width = (levels.shape[0], levels.shape[1]), levels.shape[3]
        none = np.empty((0, 0), np.float32)
        return NearestSurfaces(levels.reshape(-1), np.empty(0, np.int16), grid, 0, width, none)

    def carry(self, disparity: Float, beside: Float, offset: tuple[float, float]) -> tuple[Float, Float]:
        """Splat and sharpen."""
        seen = self.seen(disparity, offset)
        carried, carried_beside = np.empty_like(seen), np.empty_like(seen)
        down, across = (np.float32(each) for each in offset)
        place = (disparity, beside, seen, down, across, np.float32(SURFACE_JUMP), carried, carried_beside)
        self.workers.rows(len(disparity), view_kernels.carry_kernel, *place)
        return carried, carried_beside

    def support(
        self,
        views: ViewsAsTheyAre,
        surfaces: NearestSurfaces,
        places: NDArray[np.int64],
        candidates: Float,
        thresholds: Float,
        *,
        margin: float,
    ) -> Float:
        """Ask the views at places."""
        found = np.empty(candidates.shape, np.float32)
        self.workers.rows(
            len(places),
            view_kernels.support_kernel,
            np.ascontiguousarray(places),
            np.ascontiguousarray(candidates),
            views.views,
            np.float32(views.to_bytes),
            views.reference,
            (views.others, views.offsets),
            surfaces.data,
            thresholds,
            np.float32(margin),
            found,
        )
        return found

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
        size = maps.shape[1:]
        settled = np.empty(size, np.float32)
        agreeing, against = np.empty(size, np.int32), np.empty(size, np.int32)
        place = (maps, own, partners, steps, np.float32(tolerance), settled, agreeing, against)
        self.workers.rows(size[0], view_kernels.agree_kernel, *place)
        return settled, agreeing, against

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
        place = (total, count, view, *offset, disparity, front, limit)
        self.workers.rows(len(disparity), focusing_kernels.gather_kernel, *place)


def _grey_sampling(stack: GreyStack, disparity: float) -> tuple[Any, ...]:
    """The kernels' arguments that say how a plane samples grey views."""
    plane = stack.shifts(disparity)
    own = stack.reference[0] * stack.grid[1] + stack.reference[1]
    shape = (*stack.grid, *stack.size, stack.row_length, stack.margin, own)
    return stack.data, shape, plane.down, plane.across, plane.weights.astype(np.int16), stack.present


def _placed_mask(stack: GreyStack, mask: tuple[Array, float] | None) -> tuple[Any, int, tuple[Any, ...]]:
    """The mask, padded as far as the views sample it, the padding, and the sampling."""
    offset = 0.0 if mask is None else mask[1]
    plane = shifts(stack.offsets, offset).limited(stack.size)
    placing = (plane.down, plane.across, plane.weights.astype(np.int16))
    if mask is None:
        return np.empty(0, np.int16), 0, placing
    foreground = mask[0]
    if foreground.shape != stack.size:
        raise LightFieldError(
            f"mask: found shape {foreground.shape}, expected {stack.size} like the views; resize the mask"
        )
    reach, width = plane.reach, stack.size[1]
    border = ((reach, reach), (reach, reach + layout.round_width(width) - width))
    return np.pad(foreground.astype(np.int16), border, "edge").reshape(-1), reach, placing


def _photo_arguments(
    stack: ColourStack, disparity: float, thresholds: Array, surfaces: NearestSurfaces | None
) -> tuple[Any, ...]:
    """Arguments of `photo_kernel` after its output.

    Sums of differences are whole numbers, so `sum / (C·WHITE) < threshold` is
    `sum < ceil(threshold·C·WHITE)`; the product is exact in double precision.
    """
    sampling = _colour_sampling(stack, disparity)
    return thresholds, *sampling, _placed_visibility(stack, disparity, surfaces), surfaces is not None


def _colour_sampling(stack: ColourStack, disparity: float) -> tuple[Any, ...]:
    """The kernels' arguments that say how a plane samples views in colour."""
    plane = stack.shifts(disparity)
    own = stack.reference[0] * stack.grid[1] + stack.reference[1]
    shape = (*stack.grid, stack.size[0], stack.channels, stack.row_length, stack.margin, own)
    return stack.data, shape, plane.down, plane.across, plane.weights.astype(np.int16), stack.present


def _placed_visibility(
    stack: ColourStack, disparity: float, surfaces: NearestSurfaces | None
) -> tuple[Any, ...]:
    """The kernel's arguments that say where a plane samples the nearest surfaces: at the nearest pixel.

    A pixel in front of the plane is voted on by all views: its surface hides the plane in every one, and must
    go on saying that it is in front.
    """
    if surfaces is None:
        none = np.empty(0, np.int16)
        nowhere = np.empty((0, 0), np.int64)
        return none, none, nowhere, nowhere, np.empty((0, 0), np.float32), np.float32(0), 0
    down, across = nearest_pixels(stack.offsets, disparity)
    front = np.float32(disparity + VISIBILITY_MARGIN)
    place = surfaces.data, surfaces.rows, down, stack.inside(across)
    return *place, surfaces.disparity, front, plane_horizon(disparity)


def _beside_edges(views: ViewsAsTheyAre, surfaces: NearestSurfaces, thresholds: Float) -> tuple[Any, ...]:
    """The arguments of kernels that ask what views show beside depth edges."""
    own = views.views, np.float32(views.to_bytes), views.reference, (views.others, views.offsets)
    return *own, surfaces.data, surfaces.margin, surfaces.row_length, thresholds


def _planar(guide: Float) -> Float:
    """A guide (H, W, C) laid out channel by channel, flat."""
    return np.ascontiguousarray(np.moveaxis(guide, 2, 0), np.float32).reshape(-1)


def _bins(sigma: float, views: int) -> tuple[Float, Float]:
    """What a bin's −h·ln h gains by each further view (N, bins), and the bins' weights (bins,), times N.

    Bins are whole levels about the middle one; the outermost hold all that lies beyond and weigh nothing.
    """
    reach = min(int(np.ceil(_FALLEN * sigma)) + 1, 127)
    weights = np.exp(-(np.arange(-reach, reach + 1.0) ** 2) / (2 * sigma**2))
    weights[[0, -1]] = 0
    filled = np.arange(views + 1)[:, None] * weights
    sums = filled * np.log(np.where(filled > 0, filled / views, 1))
    return np.diff(sums, axis=0).astype(np.float32), weights.astype(np.float32)


def _gaussian(deviation: float) -> Float:
    """Weights of a Gaussian mean, out to four standard deviations."""
    reach = int(np.ceil(4 * deviation))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)
