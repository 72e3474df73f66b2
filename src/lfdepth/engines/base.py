"""What an engine is: the functions that blocks call, and what they promise.

Blocks decide, engines compute. A block knows light fields, planes and rules; an engine knows how views,
slices and volumes are kept and worked on. Prepared views, surfaces, filters, and arrays made by `empty`,
`zeros` or `upload` are the engine's own: a block hands them from one function to the next, slices volumes
along their first axis, and reads them with `download`. Everything else that goes in or out is a NumPy array
on the host. Shapes: V, U views of H×W px with C channels; K planes, front to back.

All engines agree on rounding (`layout`), so that counts of votes are the same on each; sums of floats may
differ in their last digits. The conformance test of the repository runs every function of an engine against
the oracle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lfdepth.lightfield import LightField

Array = Any
"""An array of the engine: has `shape` and `dtype`, and can be sliced along its axes."""

Float = NDArray[np.float32]
Bool = NDArray[np.bool_]
Gradient = Literal["central", "sobel"]
Delta = Literal["photo", "sign", "none"]
Box = tuple[slice, slice]
"""Rows and columns of an image."""


class EdgeColours(NamedTuple):
    """What the views show at N pixels beside depth edges, all float32.

    `front` and `back` (N, C) are the colours of the nearer surface inside, and of the farther one at the very
    pixel, in 8-bit levels; `spreads` (N, 2) their variances, summed over the channels, the first negative
    where no pixel of the nearer surface is around. `counts` (N, 6): views that see past the edge, and those
    of them that agree with the pixel at the near, at the far disparity; views that show the place but do not
    see past, and those of them that agree at the near disparity; all that show it at the near disparity.
    """

    front: Float
    back: Float
    spreads: Float
    counts: Float


class GreyViews(Protocol):
    """Grey views, prepared for planes up to some |D|."""

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""


class ColourViews(Protocol):
    """Views of all channels, prepared for planes up to some |D|; those `present` vote."""

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""

    @property
    def present(self) -> Bool:
        """(V, U), which views vote."""

    @property
    def offsets(self) -> NDArray[np.float64]:
        """(V, U, 2) view steps down and across from the reference view."""


class Engine(Protocol):
    """Everything that is computed for blocks. Functions end in the order of a method."""

    name: ClassVar[str]

    def close(self) -> None:
        """Let go of threads or devices."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    # --- arrays

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
        """An array whose values are not set."""

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
        """An array of zeros."""

    def upload(self, array: NDArray[Any]) -> Array:
        """A host array as one of the engine's."""

    def download(self, array: Array) -> NDArray[Any]:
        """One of the engine's arrays on the host; may share its memory."""

    def each(self, act: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """What a function of the host gives for each item, by threads if the engine has some.

        The function is NumPy's work on large arrays, and leaves the engine alone.
        """

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
        """Best plane per pixel of a few smoothed grey views, and costs beside it.

        Parameters
        ----------
        reference
            (H, W) grey levels.
        views
            (N, H, W + 2·margin), columns repeated beyond the border.
        shifts
            Two (K, N): where each plane samples each view, px down and across from the pixel.
        sides
            (N, 2) where each view lies, −1, 0 or 1 down and across from the reference view.
        apertures
            Weights and penalties (A,): A = 1, all views; or 5, also those not to the right, left, below,
            above.
        margin
            Columns left and right of each view.
        apart
            Planes beside the best one that do not count as its runner-up.
        limit
            Largest difference that counts.

        Returns
        -------
        (H, W) index of the best plane; (4, H, W) its cost (mean over 3×3 px of the best aperture), those of
        the planes before and after it, and the smallest of planes more than `apart` away.
        """

    # --- the vote of the signs

    def grey_views(self, lf: LightField, reach: float) -> GreyViews:
        """Prepare grey views for planes up to |D| = `reach` px per view step."""

    def vote(
        self,
        views: GreyViews,
        disparity: float,
        votes: Array,
        evidence: Array,
        *,
        gradient: Gradient = "central",
        delta: Delta = "photo",
        threshold: float = 0.03,
        mask: tuple[Array, float] | None = None,
    ) -> None:
        """Vote on one plane (eq. 2-6).

        Sums of votes, and of votes that count, as shares of all possible ones.

        `votes` and `evidence` (H, W) float32 are written. `mask` is a foreground (H, W) bool of the reference
        view, and the disparity of this plane less that of the plane where it was found (eq. 7).
        LightFieldError where the plane lies beyond what the views were prepared for.
        """

    def signs(self, views: GreyViews, disparity: float, *, gradient: Gradient) -> tuple[Array, Array]:
        """Signs S_xu and S_yv (V, U, H, W) int8 of every view at one plane (eq. 2 and 3)."""

    def quotient(self, votes: Array, evidence: Array) -> Array:
        """Votes over evidence, 0 where there is none (eq. 4 and 5)."""

    def foreground(self, smoothed: Array) -> Array:
        """Where a slice is above 0 (eq. 7), (H, W) bool."""

    # --- smoothing of slices

    def guided_filter(self, guide: Float, radius: int, epsilon: float) -> Any:
        """Prepare a guided filter for a guide (H, W, C) in [0, 1]."""

    def smooth(self, prepared: Any, image: Array, out: Array) -> None:
        """Smooth an image (H, W) into `out`."""

    def smooth_quotient(self, prepared: Any, numerator: Array, denominator: Array, out: Array) -> None:
        """Smoothed numerator over smoothed denominator (at least 1e-3), within [−1, 1], into `out`."""

    # --- streaming decoders

    def sign_step(self, plane: int, smoothed: Array, state: tuple[Array, Array, Array, Array, Array]) -> None:
        """Take a slice into (running sum, its least, plane of the least, slice there, slice after it)."""

    def accumulate(self, smoothed: Array, count: Array) -> None:
        """Add 1 to `count` (H, W) int32 where a slice is above 0."""

    # --- photo-consistency and visibility

    def colour_views(self, lf: LightField, reach: float, held: Bool | None = None) -> ColourViews:
        """Prepare the views that are `held` (V, U), by default all, for planes up to |D| = `reach`."""

    def voting(self, views: ColourViews, present: Bool) -> ColourViews:
        """The same views, of which only those `present` (V, U) vote; all of them have to be held."""

    def subgrid(self, views: ColourViews, rows: slice, columns: slice) -> ColourViews:
        """The views in some rows and columns of the grid, the reference view among them."""

    def high_passed(self, views: ColourViews, box: Box) -> ColourViews:
        """Views in a box of the image, less their mean over 7×7 px, plus mid-grey; borders repeat."""

    def nearest_surfaces(self, disparity: Float, views: ColourViews, spare: Any = None) -> Any:
        """Splat a map (H, W) into every view that votes: the nearest surface at each of its pixels.

        Each point lands on one pixel; gaps within a surface are filled (`layout.SURFACE_JUMP`).

        `spare` is a result no longer needed, whose memory may be used again.
        """

    def surfaces_in(self, surfaces: Any, box: Box) -> Any:
        """The nearest surfaces in a box of the image, for views `high_passed` in the same box."""

    def photo(
        self,
        views: ColourViews,
        disparity: float,
        thresholds: Array,
        out: Array,
        *,
        surfaces: Any = None,
        rows: tuple[int, int] | None = None,
    ) -> None:
        """Share of the views that show the reference view's colour at one plane, into `out` (H, W).

        A view counts where the mean over channels of its absolute difference is below `thresholds` (H, W), in
        (0, 0.5] of full scale. With `surfaces`, only views that see the plane count, unless the pixel lies in
        front of it. With `rows`, only rows [first, last) are written. LightFieldError where the plane lies
        beyond what the views were prepared for.
        """

    def photo_peaks(
        self, views: ColourViews, planes: NDArray[np.float64], thresholds: Array, rows: NDArray[np.int64]
    ) -> Float:
        """Largest share over planes in some rows, a mean over 7 px along them, (rows, W)."""

    # --- the energy of signs and photo-consistency

    def store_signs(self, smoothed: Array, step: float, running: Array, lowest: Array, out: Array) -> None:
        """Sign energy `running + step·smoothed/2` into `out`; updates the running sum and its least."""

    def store_shares(self, share: Array, out: Array) -> None:
        """Shares in [0, 1] as whole parts of `layout.SHARE_LEVELS`, into `out` uint8."""

    def peak(self, shares: Array) -> NDArray[np.uint8]:
        """Largest along the planes of a volume (K, H, W) uint8, on the host."""

    def contrast(self, shares: Array) -> Float:
        """Largest less mean along the planes of a volume, as a share in [0, 1], on the host."""

    def put_where(self, volume: Array, mask: Bool, values: Array | float) -> None:
        """Replace all planes of a volume where a mask (H, W) is True, by those of another, or by a number."""

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
        """Joint energies, summed over the best smooth paths from four sides (semi-global matching).

        The energy of a pixel is `signs − weight·shares`, above its least and at most 2. Between neighbours, a
        change by one plane costs `slope`, any larger one `jump`, times exp(−sharpness·max(Σ_channels |ΔI| −
        noise, 0)).
        """

    def least(self, total: Array) -> Float:
        """Place along the planes of each pixel's least total, by a parabola between planes, on the host."""

    def fill_islands(self, position: Float, planes: int, largest: int) -> None:
        """Fill islands of at most `largest` px at the first or last plane by the median around, in place."""

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
        """Places along the planes by local planes fitted to each pixel's own minima (`blocks.surface`)."""

    # --- refinement between planes

    def spline_views(self, lf: LightField, chosen: Bool) -> Any:
        """Cubic B-spline coefficients of the luma of the `chosen` views (V, U), the reference view's too."""

    def ask_views(
        self,
        views: Any,
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
        """One Gauss–Newton step at every pixel of a map, by views `spline_views` (`blocks.refine`).

        The step (H, W), its information, and what is left of that near depth edges; and the `typical` squared
        difference of views, grey levels squared, which nowhere counts as less: that of these pixels by
        default.
        """

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
        """Height of the plane fitted around every pixel to the targets of its surface (`blocks.refine`)."""

    def even_lattices(self, disparity: Float, guide: Float, *, gate: float, sharpness: float) -> Float:
        """Binomial mean over pairs of opposite pixels of 3×3, of one surface and alike in colour."""

    def blur(self, image: Float, deviation: float) -> Float:
        """Gaussian mean of an image (H, W), out to four standard deviations; borders repeat."""

    # --- depth edges and noise

    def views(self, lf: LightField) -> Any:
        """The views as they are, for functions that look at scattered places."""

    def decide_edges(
        self,
        views: Any,
        disparity: Float,
        surfaces: Any,
        thresholds: Float,
        found: Bool,
        *,
        jump: float,
        spread: float,
        inertia: float,
        rows: tuple[int, int] | None = None,
    ) -> Float:
        """Decide every pixel beside a depth edge of a map, or of rows [first, last), once (`blocks.edges`).

        `found` gains the pixels at edges; `surfaces` are those of the map in all views (`surfaces_of`);
        `thresholds` (H, W) in 8-bit levels. Of the map, these rows alone are given back.
        """

    def edge_colours(
        self,
        views: Any,
        disparity: Float,
        places: NDArray[np.int64],
        sides: Float,
        surfaces: Any,
        thresholds: Float,
    ) -> EdgeColours:
        """What the views show at pixels `places` (N, 2) of a map, rows and columns, beside depth edges.

        `sides` (N, 2) are the near and the far disparity there; the rest as for `decide_edges`.
        """

    def surfaces_of(self, disparity: Float, views: Any, spare: Any = None) -> Any:
        """As `nearest_surfaces`, for the views as they are."""

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
        """Weighted median (`blocks.median`)."""

    def residuals(
        self, views: Any, rows: NDArray[np.int64], columns: NDArray[np.int64], planes: NDArray[np.float64]
    ) -> Float:
        """Least over planes of the mean absolute difference between the reference view and all others.

        For a list of pixels, in the views' own levels; infinite where no other view shows a pixel.
        """

    def window_means(
        self, views: Any, points: NDArray[np.int64], disparity: NDArray[np.float64], reach: int
    ) -> tuple[Float, Bool]:
        """Mean levels (V·U, N, C) of windows where views show points (N, 2) of the reference view; their use.

        Windows are (2·`reach` + 1)² px about the nearest whole px, in the views' own levels; no use (V·U, N,
        C) where a view is absent, the window leaves it, or a sample is 0 or white.
        """

    # --- costs of planes

    def differences(
        self,
        views: ColourViews,
        disparity: float,
        limits: Array,
        out: Array,
        *,
        beyond: float,
        itself: bool = False,
    ) -> None:
        """Mean over the views that vote of their difference to the reference view at one plane, into `out`.

        A view's difference is the mean over channels of absolute ones; where it is not below `limits` (H, W)
        it counts as `beyond`, all in parts of full scale. With `itself`, the reference view is moved in every
        view's stead. LightFieldError where the plane lies beyond what the views were prepared for.
        """

    def angular_entropy(self, views: ColourViews, disparity: float, sigma: float, out: Array) -> None:
        """Constrained angular entropy of one plane, the mean over channels, into `out` (H, W).

        Of N views, n show a level l at a pixel, in whole 8-bit levels; the share of l is h = n/N·exp(−(l −
        l₀)²/(2·`sigma`²)), l₀ the reference view's level. The entropy is −Σ h·ln h / Σ h. LightFieldError
        where the plane lies beyond what the views were prepared for.
        """

    def focal_symmetry(
        self,
        views: ColourViews,
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
        """How unlike focal stacks are before and behind planes, into rows [first, last) of `out` (K, H, W).

        A stack φ_i holds the mean of the present ones of its views, `stacks[i]` (V, U), at every one of K +
        2·`reach` planes, evenly spaced front to back. Of the planes but for `reach` at either end, plane k
        costs the mean over d = 0, `stride`, ... up to `reach` of the least over pairs (i, j), of `pairs` (N,
        2), of ρ(φ_i(k − d) − φ_j(k + d)), ρ(x) = 1 − exp(−x²/(2·`sigma`²)), x² the mean over channels, in
        parts of full scale.
        """

    # --- cost volumes

    def minima(self, volume: Array) -> tuple[NDArray[np.int32], Float]:
        """Least cost of each pixel of a volume (K, H, W), and what lies around it, on the host.

        Returns
        -------
        (H, W) first label of least cost; (4, H, W) the cost there, those of the labels before and after it
        (its own at the ends), and that of the next lowest local minimum, or where there is none the largest
        cost.
        """

    def line_paths(self, volume: Array, weights: Float, table: Float) -> None:
        """Replace costs (K, H, W) float32 by their sums over the best paths from 2·N sides, in place.

        Semi-global matching with any penalty. Between neighbours, a change by d labels costs their weight
        times `table[d]`, and from the table's last entry on that one; `table[0]` is 0, and none is less than
        the one before. `weights` (N, H, W), N = 2 or 4, are those between a pixel and the next to the right,
        below, below to the right, and below to the left. Each path counts a pixel's own cost once.
        """

    def local_means(self, volume: Array, weights: Float, around: NDArray[np.int64], out: Array) -> None:
        """Weighted sum of the pixels around every pixel, slice by slice of a volume (K, H, W), into `out`.

        `around` (N, 2) says where they lie, px down and across; `weights` (H, N, W) are 0 where that is
        beyond the border (`blocks.bilateral`).
        """

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
        """Sums of squares over the bins of weighted histograms, for several labels at once.

        `out[l, p] = Σ_c Σ_b (Σ_n Σ_s weights[n, s, l]·[pictures[n, c, p + corners[n] + s·walk] = b])²`.

        Parameters
        ----------
        pictures
            (N, C, H, W) uint8, below `bins`; beyond the border they repeat.
        bins
            Bins of each channel.
        walk
            Px down and right from a sample to the next.
        corners
            (N, 2) px down and right from a pixel to the first sample of each picture.
        weights
            (N, S, L).
        out
            (L, H, W) float32.
        """

    def view_groups(
        self, views: ColourViews, disparity: float, groups: Array, means: Array, variances: Array
    ) -> None:
        """What two groups of views show of a plane: means, and variances of all channels together.

        `groups` (2, V·U, H, W) uint8 is 1 where a view that votes belongs to a group. `means` (2, C, H, W)
        float32 are less the reference view's levels, `variances` (2, H, W) float32 unbiased and summed over
        channels, both in parts of full scale. LightFieldError where the plane lies beyond what the views
        were prepared for.
        """

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
        """What belongs with the middle of the patch around each point, (P, side, side); side = 2·radius + 1.

        The colours of a patch, whose borders repeat, are put into `clusters` by k-means: the first centre is
        the middle's colour, each next one the colour farthest from those before; centres move until nothing
        changes or `rounds` are over. Clusters whose centres are nearer than `alike` are one. What hangs
        together with the middle, over eight neighbours, is its region.

        Parameters
        ----------
        picture
            (H, W, C).
        points
            (P, 2) rows and columns.
        """

    # --- maps of several views

    def from_view(self, views: Any, at: tuple[int, int]) -> Any:
        """The same `views` (as they are) with the one at row and column `at` as the reference view."""

    def known_surfaces(self, levels: NDArray[np.int16], views: Any) -> Any:
        """Surfaces, for `decide_edges` and `support`, of maps of all views, in `surface_levels`.

        Those, (V, U, H, W), may be kept: they must not change.
        """

    def carry(self, disparity: Float, beside: Float, offset: tuple[float, float]) -> tuple[Float, Float]:
        """What the view at `offset` shows of a map (H, W), to a part of a pixel; −inf where that is unknown.

        The splat of `seen` says which surface a pixel shows. Where the map is of one surface (changes by
        less than `SURFACE_JUMP`) around the place that the pixel comes from, it is interpolated there, twice,
        since that place follows from the disparity. The second map is what is `beside` (H, W) the nearest
        pixel there, 0 where unknown.
        """

    def support(
        self,
        views: Any,
        surfaces: Any,
        places: NDArray[np.int64],
        candidates: Float,
        thresholds: Float,
        *,
        margin: float,
    ) -> Float:
        """How far `views` (as they are) agree with candidates of disparity, (N, K) in [0, 1].

        The mean over the views that show a place (N, 2) at a candidate (N, K), and nothing nearer than it by
        more than `margin`, of 1 / (1 + (Δ/τ)²): Δ is the mean absolute difference of the channels to the
        reference view, and τ one of `thresholds` (H, W), both in 8-bit levels. 0 where fewer than two views
        show it; −1 for a candidate that is not finite.
        """

    def agree(
        self,
        maps: Float,
        own: int,
        partners: NDArray[np.int64],
        steps: NDArray[np.float64],
        *,
        tolerance: float,
    ) -> tuple[Float, NDArray[np.int32], NDArray[np.int32]]:
        """Hold map `own` of `maps` (N, H, W) against the maps of its `partners` (M,), `steps` (M, 2) from it.

        A partner agrees with a pixel where one of the four pixels around the place it lands on is within
        `tolerance`, and speaks against it where all four are farther. A pixel that more speak against than
        for takes the value, of the eight around it and of the nearest pixel in each partner, for which most
        speak. The map, and the numbers of partners (H, W) for and against.
        """

    # --- pictures from many views

    def seen(self, disparity: Float, offset: tuple[float, float], *, plane: float = 0.0) -> Float:
        """Disparity (H, W) that the view at `offset` shows of a map, as seen from a plane; −inf: unknown.

        The same splat as that of `nearest_surfaces`, in full precision.
        """

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
        """Add the view at `offset`, sampled where points of the reference view at `disparity` appear in it.

        Samples outside the view do not count, nor do those that touch a pixel whose `front` is above `limit`.
        """
