"""Brightness that differs between the views: measured where they show the same surfaces, and made equal.

Rigs have a gain and an offset per camera; plenoptic cameras darken towards the outer views and towards the
corners of every view. A first, coarse map that looks at local contrast, which a gain does not change, says
which blocks of the views show the same surface. There the levels of a view are a low polynomial over the view
times those of the scene, plus an offset: few parameters, so that nothing of the scene itself goes into them.
Where these have to be corrected, a second map, by the levels of the views made equal, says which views show a
point at all, and the parameters are fitted once more to these.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.lightfield import FULL_SCALE, LUMA, LightField, reference_index
from lfdepth.probe.foreign import foreign_views
from lfdepth.probe.levels import unevenness, view_levels
from lfdepth.probe.matching import make_probe, match, plane_range, shrink_to, widest
from lfdepth.probe.ranges import coarse_range
from lfdepth.probe.samples import Samples, sample
from lfdepth.probe.visibility import hidden, of_one_surface, surface_map

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine

Array = NDArray[np.float64]

# Shorter side, px, of the views for the first map; windows that fit into the shorter side of the views.
_SIDE, _WINDOWS = 256, 64
# Shorter side, px, of the smallest views that tell gains from what differs at their borders.
_SMALLEST = 64
_TOO_SMALL = f"views under {_SMALLEST} px"
_RINGS = 1.0, 1 / 3
# Samples at most, the second time, many of them hidden, and at least.
_SAMPLES, _SAMPLES_AGAIN, _FEWEST = 2000, 4000, 100
# Turns of fitting shading, then gains and offsets.
_TURNS = 3
# Multiples of the scatter up to which samples are trusted, round by round. What is hidden in part, as behind
# wires, is off by little and to one side: the last rounds leave it out.
_TRUSTED = 2.0, 2.0, 1.0, 1.0, 1.0
# Share of the views that tell of a sample whether it is hidden somewhere; error beyond which it is, times
# that of the typical sample; error where a sample is not seen, in units of the scatter.
_MOST, _SELECTED, _TYPICAL = 0.75, 0.5, 0.67
# How many samples tell how far they scatter.
_ENOUGH = 400
# What offsets (of full scale) and terms of the shading are expected to be, where the views do not tell.
_USUAL_SHADING, _USUAL_DEVIATION = 0.3, 1.0
# Error of a sample, of full scale, neighbours being alike.
_ERROR = 0.01
# From what effect on, of full scale and of what is left of the differences, gains are mended.
_NOTABLE, _APART = 0.002, 0.5
# By which share parts of the model have to lessen what is left: gloss, occlusion and noise do by less.
_VIGNETTING, _SHADING, _OFFSET = 0.01, 0.08, 0.045
# Offsets and shading have to be the same in two halves of the picture: correlation; size of offsets, of full
# scale, from which they may lessen what is left by less; by so much, only offsets do. Blocks along a side of
# the picture, which belong to either half in turn.
_ALIKE, _AGREED, _SURELY, _BLOCKS = 0.9, 0.005, 0.12, 6
# Ways in which shading falls; the least base of a power.
_POWERS, _LEAST_FACTOR = (1000.0, 1.0, -2.0), 0.05
# Shading is that of one lens, a polynomial of this degree over the grid of views, unless the halves of the
# picture agree, by this correlation, on what each view has besides, of at least this size. Rounds of fitting.
_DEGREE, _OWN, _OWN_SIZE, _SMOOTHINGS = 3, 0.5, 0.005, 4
# Coefficient of x² + y² above which vignetting is none; rounding, of full scale.
_FAINT_VIGNETTING, _ROUNDING = -0.04, 0.0003
# A view is dark below this share of the reference view's level; level below which logarithms tell nothing.
_DARKEST, _DARK = 0.25, 0.01
# Contrast (squared) below which offsets are not told from gains; least error that is one, of full scale.
_FAINT, _FINEST = 1e-4, 0.0015


@dataclass(frozen=True, eq=False)
class Equalisation:
    """How the brightness of each view differs from the reference view's.

    A level L of the reference view is, in view (v, u) at (x, y), `gain·(1 + p/power)^power·L + offset`, where
    p = shading·(x, y, x², xy, y²), with x and y from −1 to 1 over the picture.

    Attributes
    ----------
    gain : ndarray, shape (V, U, C)
        Factor.
    offset : ndarray, shape (V, U, C)
        Of full scale.
    shading : ndarray, shape (V, U, 5)
        Terms of the polynomial.
    left_out : ndarray, shape (V, U)
        True for views that are dark, empty or unlike the others.
    effect : ndarray, shape (V, U)
        Root mean square of what the differences change, of full scale.
    samples : int
        Blocks of the reference view from which this was measured; 0 if it could not be measured.
    needed : bool
        Whether the differences are large enough to correct.
    power : float
        How shading falls: 1 as a polynomial does, −2 as cos⁴ of the angle does, 1000 as an exponential does.
    suspected : float
        By how much the mean levels of views differ, of their level, where views are too small to measure
        more and the scene does not explain it; otherwise 0.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> found = lfdepth.measure_brightness(scenes.render("bars", size=64, views=5))
    >>> found.needed, found.gain.shape
    (False, (5, 5, 3))
    """

    gain: Array
    offset: Array
    shading: Array
    left_out: NDArray[np.bool_]
    effect: Array
    samples: int
    needed: bool
    power: float = 1000.0
    suspected: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return {
            "needed": self.needed,
            "measured": self.samples > 0,
            "views_left_out": int(self.left_out.sum()),
            "effect": float(self.effect.max()),
            "gain": self.gain.tolist(),
            "offset": self.offset.tolist(),
            "shading": self.shading.tolist(),
            "shading_power": self.power,
            "suspected": self.suspected,
            "message": self.message,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every attribute as an array, for files."""
        return {each.name: np.asarray(getattr(self, each.name)) for each in fields(self)}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Equalisation:
        """What `arrays` gave."""
        plain: dict[str, Any] = {
            name: array if array.ndim else array.item() for name, array in arrays.items()
        }
        return cls(**plain)

    @property
    def message(self) -> str:
        """What was found, in one line."""
        left_out = int(self.left_out.sum())
        dark = f"{left_out} dark or foreign view{'s'[: left_out > 1]} ignored" if left_out else ""
        if not self.samples:
            unlike = f"differs between views by {100 * self.suspected:.0f} %, not equalised: {_TOO_SMALL}"
            return "; ".join(
                filter(None, [unlike if self.suspected else "not measured: too little texture", dark])
            )
        if not self.needed:
            return "; ".join(filter(None, ["the same in all views", dark]))
        kept = ~self.left_out & (self.effect > 0)
        gain = self.gain[kept] / self.gain[reference_index((self.left_out.shape[0], self.left_out.shape[1]))]
        parts = [f"gains {gain.min():.2f} to {gain.max():.2f}"] if kept.any() else []
        if self.offset.any():
            parts.append(
                f"offsets {100 * self.offset[kept].min():.1f} to {100 * self.offset[kept].max():.1f} %"
            )
        if self.shading.any():
            corners = _shaded(self.shading[..., [2, 4]].sum(axis=-1), self.power)
            parts.append(f"shading, corners at {100 * float(np.median(corners)):.0f} %")
        return "; ".join(filter(None, [f"differs between views ({', '.join(parts)}), equalised", dark]))


def equalise(
    lf: LightField,
    found: Equalisation,
    *,
    part: tuple[slice, slice] | None = None,
    size: tuple[int, int] | None = None,
) -> LightField:
    """The light field with the brightness of all views made that of the reference view.

    Parameters
    ----------
    lf
        Light field.
    found
        What was measured in its views.
    part, size
        Where the light field is a window of a larger one that was measured: its rows and columns there, and
        the larger one's (H, W).

    Returns
    -------
    LightField
        The same object if nothing has to change. Otherwise 8-bit views become 16-bit views, so that
        rounding adds no steps; views left out are marked as missing.

    Examples
    --------
    One view is darker than the others; afterwards it is not:

    >>> from dataclasses import replace
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> views = lf.views.copy()
    >>> views[0, 0] = (0.7 * views[0, 0]).astype(views.dtype)
    >>> dark = replace(lf, views=views)
    >>> even = lfdepth.equalise(dark, lfdepth.measure_brightness(dark))
    >>> ratio = (even.views[0, 0].mean() / even.full_scale) / (lf.views[0, 0].mean() / lf.full_scale)
    >>> round(float(ratio), 1)
    1.0
    """
    if found.left_out.any():
        there = np.ones(lf.shape[:2], np.bool_) if lf.present is None else lf.present
        lf = replace(lf, present=there & ~found.left_out)
    if not found.needed:
        return lf
    kind = "float32" if lf.views.dtype == np.float32 else "uint16"
    white, views = FULL_SCALE[kind], np.zeros(lf.shape, kind)
    whole = size or (lf.height, lf.width)
    here = part or (slice(None), slice(None))
    axes = (np.linspace(-1, 1, n)[along] for n, along in zip(whole, here, strict=True))
    terms = _terms(*np.meshgrid(*axes, indexing="ij"))
    for index in np.ndindex(*lf.shape[:2]):
        if lf.present is not None and not lf.present[index]:
            continue
        factor = (white / lf.full_scale / _shaded(terms @ found.shading[index], found.power)).astype(
            np.float32
        )
        levels = lf.views[index] - (found.offset[index] * lf.full_scale).astype(np.float32)
        levels *= factor[..., None] / np.maximum(found.gain[index], _LEAST_FACTOR).astype(np.float32)
        np.clip(levels, 0, white, out=levels)
        views[index] = levels if white == 1 else np.rint(levels)
    return replace(lf, views=views)


def measure_brightness(
    lf: LightField,
    disparity: NDArray[Any] | None = None,
    *,
    range: tuple[float, float] | None = None,
    threads: int | None = None,
    engine: Engine | None = None,
) -> Equalisation:
    """Measure how the brightness of the views differs from the reference view's.

    Views whose shorter side is below 64 px are too small for that: of them it is only told whether their mean
    levels differ by more than the scene explains (`Equalisation.suspected`).

    Parameters
    ----------
    lf
        Light field.
    disparity
        (H, W) disparity of the reference view, px per view step, NaN where it is unknown; None estimates a
        coarse one.
    range
        (min, max) of that disparity, if it is known.
    threads
        Number of threads; None uses all processors.
    engine
        Engine to use instead of the default one.

    Returns
    -------
    Equalisation

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lfdepth.measure_brightness(scenes.render("bars", size=64, views=5)).message
    'the same in all views'
    """
    if min(lf.height, lf.width) < _SMALLEST:
        found, levels = _unknown(lf), view_levels(lf)
        levels[found.left_out] = np.nan
        return replace(found, suspected=unevenness(levels, lf.centre))
    with using(engine, threads=threads) as used:
        if disparity is None:
            disparity = first_map(lf, range, used)
        return _fitted(lf, disparity, range, used)


def first_map(
    lf: LightField, range: tuple[float, float] | None, engine: Engine
) -> NDArray[np.float32] | None:
    """Coarse disparity by local contrast, of any size, NaN where it is not certain; None if there is none."""
    shrink = shrink_to(lf, _SIDE)
    limit = widest(lf) if range is None else max(-range[0], range[1], 0.1)
    probe = make_probe(lf, limit, shrink, _RINGS, contrast=True, engine=engine)
    if range is None:
        range = coarse_range(probe, limit, engine)
    if range is None:
        return None
    found = match(probe, plane_range(*range, probe.unit / 2), engine)
    return np.where(found.coherent(0.5 * probe.unit, 3), found.disparity, np.float32(np.nan))


def _terms(y: NDArray[Any], x: NDArray[Any]) -> NDArray[np.float32]:
    """(…, 5) terms x, y, x², xy, y² of the shading."""
    return np.stack([x, y, x * x, x * y, y * y], axis=-1).astype(np.float32)


def _shaded(polynomial: NDArray[Any], power: float) -> Array:
    """Factor that a polynomial of the place stands for."""
    return np.asarray(np.maximum(1 + polynomial / power, _LEAST_FACTOR) ** power, np.float64)


def _fitted(
    lf: LightField, disparity: NDArray[Any] | None, range: tuple[float, float] | None, engine: Engine
) -> Equalisation:
    """The parameters that samples of the views ask for."""
    if disparity is None:
        return _unknown(lf)
    reach = max(2, min(lf.height, lf.width) // _WINDOWS // 2)
    points, d = _points(disparity, lf.shape[2:4], reach)
    if d.size < _FEWEST:
        return _unknown(lf)
    samples, terms = _samples(lf, points, d, reach, engine)
    first = _Fit(samples.levels, samples.valid, terms, lf.shape[:2], engine)
    if samples.seen[first.centre].sum() < _FEWEST:
        return _unknown(lf)
    foreign = foreign_views(lf, points, d, engine)
    found = first.result(lf.available, first.dark() | foreign.reshape(-1))
    if found.needed:
        known = disparity[np.isfinite(disparity)]
        found = _once_more(lf, first, found, range or (float(known.min()), float(known.max())), engine)
    return _left_alone(found, samples.idle) if samples.idle.any() else found


def _once_more(
    lf: LightField, first: _Fit, found: Equalisation, range: tuple[float, float], engine: Engine
) -> Equalisation:
    """Fitted again to what each view shows according to a map by the levels of the views made equal."""
    surface, unit = surface_map(equalise(lf, found), range, _SIDE, _RINGS, engine)
    reach = max(1, min(lf.height, lf.width) // _WINDOWS // 4)
    points, d = _points(of_one_surface(surface, unit), lf.shape[2:4], reach, _SAMPLES_AGAIN)
    if d.size < _FEWEST:
        return found
    samples, terms = _samples(lf, points, d, reach, engine)
    seen = samples.valid & ~hidden(lf, surface, unit, points, d, engine)[..., None]
    told = seen.all(axis=-1).sum(axis=1) >= _FEWEST
    again = first.again(samples.levels, np.where(told[:, None, None], seen, samples.valid), terms)
    return again.result(lf.available, found.left_out)


def _samples(
    lf: LightField, points: NDArray[np.int64], disparity: Array, reach: int, engine: Engine
) -> tuple[Samples, NDArray[np.float32]]:
    """Points in all views, and their terms; channels that are idle stand in for the others."""
    found = sample(lf, points, disparity, reach, engine)
    if found.idle.any():
        found.levels[..., found.idle] = found.levels[..., ~found.idle].mean(axis=-1, keepdims=True)
    steps = lf.offsets.reshape(-1, 2)
    terms = _terms(
        *(
            2 * (at - disparity * step[:, None]) / max(size - 1, 1) - 1
            for at, step, size in zip(points.T, steps.T, lf.shape[2:4], strict=True)
        )
    )
    return found, terms


def _left_alone(found: Equalisation, idle: NDArray[np.bool_]) -> Equalisation:
    """The same, idle channels left as they are."""
    return replace(found, gain=np.where(idle, 1.0, found.gain), offset=np.where(idle, 0.0, found.offset))


def _unknown(lf: LightField) -> Equalisation:
    """Nothing but which views are dark."""
    v, u, channels = *lf.shape[:2], lf.shape[4]
    return Equalisation(
        np.ones((v, u, channels)),
        np.zeros((v, u, channels)),
        np.zeros((v, u, 5)),
        view_levels(lf) < _DARKEST,
        np.zeros((v, u)),
        0,
        False,
    )


def _points(
    disparity: NDArray[Any], size: tuple[int, int], reach: int, most: int = _SAMPLES
) -> tuple[NDArray[np.int64], Array]:
    """Pixels (N, 2) of the reference view with a known disparity, spread evenly, and that."""
    known = np.flatnonzero(np.isfinite(disparity))
    chosen = known[:: max(1, -(-known.size // most))]
    scale = np.array(size) / disparity.shape
    places = np.stack(np.divmod(chosen, disparity.shape[1]), axis=-1)
    points: NDArray[np.int64] = ((places + 0.5) * scale).astype(np.int64)
    inside = ((points >= reach) & (points < np.array(size) - reach)).all(axis=1)
    return points[inside], disparity.flat[chosen[inside]].astype(np.float64)


class _Fit:
    """Gain, offset and shading per view, fitted robustly to samples."""

    gain: Array
    offset: Array

    def __init__(
        self,
        levels: NDArray[np.float32],
        valid: NDArray[np.bool_],
        terms: NDArray[np.float32],
        grid: tuple[int, int],
        engine: Engine,
    ) -> None:
        self.levels, self.valid, self.terms, self.grid = levels, valid, terms, grid
        self.engine = engine
        v, u = reference_index(grid)
        self.centre = v * grid[1] + u
        self.luma = LUMA if levels.shape[2] == 3 else np.ones(1, np.float32)
        self.select()

    def again(
        self, levels: NDArray[np.float32], valid: NDArray[np.bool_], terms: NDArray[np.float32]
    ) -> _Fit:
        """The same parts of the model, fitted to better samples; offsets, too, if only these show them."""
        other = copy(self)
        other.levels, other.valid, other.terms = levels, valid, terms
        other.fit(again=True)
        if other.with_vignetting:
            other._choose_power()
        if not other.with_offset:
            other._try_offsets()
        return other

    def fit(self, again: bool = False) -> None:
        """Shading from logarithms, gains and offsets by channel, in turn; `again` from those found."""
        if again:  # copies of this share the arrays
            self.gain, self.offset = self.gain.copy(), self.offset.copy()
        else:
            views, _, channels = self.levels.shape
            self.gain, self.offset = np.ones((views, channels)), np.zeros((views, channels))
            self.shading = np.zeros((views, 5))
        shaded = self.with_vignetting or self.with_shading
        for _ in range(_TURNS if shaded and self.with_offset else 1):
            if shaded:
                self._fit_shading()
            self._fit_gains()

    def _factor(self) -> NDArray[np.float32]:
        """Shading (V·U, N) at the samples."""
        return _shaded(np.einsum("vnk,vk->vn", self.terms, self.shading), self.power).astype(np.float32)

    def _fit_shading(self) -> None:
        """Vignetting that all views share, and what each view has besides, from logarithms of the luma."""
        views, count, _ = self.levels.shape
        # channels as they weigh in the reference view: else what is red seems shaded where red gains differ
        gain = np.maximum(self.gain, _LEAST_FACTOR).astype(np.float32)  # that of a black view is 0
        even = (self.levels - self.offset[:, None].astype(np.float32)) / gain[:, None]
        lit = even @ self.luma
        usable = self.valid.all(axis=-1) & (lit > _DARK) & (lit[self.centre] > _DARK)
        lit = np.maximum(lit, _DARK)
        radius = self.terms[..., 2] + self.terms[..., 4]
        target = np.log(lit) - np.log(lit[self.centre])
        columns = [np.ones((views, count, 1), np.float32)]
        prior = [1e-6]
        if self.with_shading:
            columns.append(self.terms)
            prior += [_USUAL_DEVIATION**-2] * 5
        design = np.concatenate(columns, axis=-1)
        shared_radius = radius if self.with_vignetting else np.zeros_like(radius)
        weight = np.where(usable, lit**2, 0).astype(np.float32)
        solved, common = np.zeros((views, design.shape[-1])), 0.0
        for multiple in _TRUSTED:
            # logarithms of the factors, and how they change with the parameters, about those of before
            own = _sum_of_terms(design[..., 1:], solved[:, 1:])
            base = np.maximum(1 + (own + common * shared_radius) / self.power, _LEAST_FACTOR)
            log = self.power * np.log(base)
            slope = (1 / base).astype(np.float32)
            turned = np.concatenate([design[..., :1], design[..., 1:] * slope[..., None]], axis=-1)
            column = shared_radius * slope
            column = column - column[self.centre]
            shown = (log - log[self.centre]).astype(np.float32)
            about = target - shown + own * slope + np.float32(common) * column
            solved, common = _arrow(turned, column, about, weight / _ERROR**2, np.array(prior))
            fitted = _sum_of_terms(turned, solved) + np.float32(common) * column
            error = np.abs(about - fitted) * lit
            relative = error / _scale(error, usable)
            weight = usable * lit**2 * _trust(relative, multiple) * _shown_everywhere(relative, usable)
        self.shading = solved[:, 1:] if self.with_shading else np.zeros((views, 5))
        self.shading = self.shading - self.shading[self.centre]
        if self.one_lens:
            self.shading = self._over_grid(self.shading)
        self.shading[:, [2, 4]] += common

    def _fit_gains(self) -> None:
        """Match means, and with offsets standard deviations, which noise and misalignment leave alike."""
        factor = self._factor()

        def fit(c: int) -> tuple[Array, Array, NDArray[np.float32], Array]:
            return self._fit_channel(c, factor)

        fitted = self.engine.each(fit, range(self.levels.shape[2]))
        self.weight = np.ones(self.valid.shape[:2], np.float32)
        for c, (slope, offset, weight, _) in enumerate(fitted):
            self.gain[:, c], self.offset[:, c] = slope, offset if self.with_offset else 0
            self.weight = np.minimum(self.weight, weight)
        self.scatter = np.mean([scatter for *_, scatter in fitted], axis=0)

    def _fit_channel(
        self, c: int, factor: NDArray[np.float32]
    ) -> tuple[Array, Array, NDArray[np.float32], Array]:
        """Gains, offsets and scatter (V·U,) of one channel, and the weights (V·U, N) of its samples."""
        there = np.ascontiguousarray(self.levels[..., c])
        scene = factor * (there[self.centre] / factor[self.centre])
        valid = self.valid[..., c] & self.valid[self.centre, :, c]
        weight = valid.astype(np.float32)
        for multiple in _TRUSTED:
            total = np.maximum(weight.sum(axis=1), 1e-6)
            mean, of_scene = ((weight * values).sum(axis=1) / total for values in (there, scene))
            slope = mean / np.maximum(of_scene, 1e-6)
            if self.with_offset:
                spread = (weight * (there - mean[:, None]) ** 2).sum(axis=1) / total + _FAINT * mean**2
                usual = (weight * (scene - of_scene[:, None]) ** 2).sum(axis=1) / total
                slope = np.sqrt(spread / (usual + _FAINT * of_scene**2 + 1e-12))
            offset = mean - slope * of_scene
            error = np.abs(there - slope[:, None] * scene - offset[:, None])
            relative = error / _scale(error, valid)
            weight = valid * _trust(relative, multiple) * _shown_everywhere(relative, valid)
        return slope, offset, weight, 1.48 * _median(error, valid)

    def select(self) -> None:
        """Keep only those parts of the model that make the views agree notably better."""
        self.with_shading = self.with_vignetting = self.with_offset = self.one_lens = False
        self.power = _POWERS[0]
        self.fit()
        self._try("with_vignetting", _VIGNETTING)
        if self.with_vignetting and self.shading[self.centre, 2] > _FAINT_VIGNETTING:
            self.with_vignetting = False
            self.fit()
        state = dict(vars(self))
        self._try("with_shading", _SHADING)
        if self.with_shading and _alike(*self._shading_of_halves()) < _ALIKE:
            vars(self).update(state)
        if self.with_vignetting:
            self._choose_power()
        self._try_offsets()
        if self.with_vignetting:
            self.fit(again=True)  # gains, offsets and shading explain some of each other
        if self.with_shading:
            self.one_lens = not self._own_shading()
        if self.one_lens:
            self.fit(again=True)

    def _try_offsets(self) -> None:
        """Fit with offsets; undo it unless two halves of the picture find the same ones."""
        before, state = self.left, dict(vars(self))
        self.with_offset = True
        self.fit()
        fall = 1 - self.left / before
        if fall < _SURELY and not self._same_offsets(0.0 if fall > _OFFSET else _AGREED):
            vars(self).update(state)

    def _same_offsets(self, least: float) -> bool:
        """Whether two halves of the picture find the same offsets, of at least this size.

        Where many samples scatter for other reasons, as behind wires, offsets hardly lessen what is left.
        """
        seen = np.array(self.valid.any(axis=(1, 2)))
        seen[self.centre] = False
        if not seen.any() or _agreed(self.offset[seen], self.offset[seen]) <= least:
            return False
        halves = self._halves()
        for half in halves:
            half.fit()
        one, other = (half.offset[seen] for half in halves)
        return _agreed(one, other) > least and _alike(one, other) > _ALIKE

    def _own_shading(self) -> bool:
        """Whether the halves find the same shading beside what changes smoothly over the grid of views."""
        one, other = (shading - self._over_grid(shading) for shading in self._shading_of_halves())
        return _agreed(one, other) > _OWN_SIZE and _alike(one, other) > _OWN

    def _shading_of_halves(self) -> list[Array]:
        """What the views' shading (V·U, 5) differs from the reference view's, as either half finds it."""
        found = []
        for half in self._halves():
            half._fit_shading()
            found.append(half.shading - half.shading[self.centre])
        return found

    def _halves(self) -> list[_Fit]:
        """Copies that know one half each of the picture, whose blocks take turns as on a chessboard."""
        x, y = np.floor((self.terms[self.centre, :, :2].T + 1) * (_BLOCKS / 2))
        white = (x + y) % 2 == 0
        halves = []
        for part in (white, ~white):
            half = copy(self)
            half.levels, half.valid = self.levels[:, part], self.valid[:, part]
            half.terms = self.terms[:, part]
            halves.append(half)
        return halves

    def _over_grid(self, shading: Array) -> Array:
        """Cubic over the grid of views nearest to what (V·U, 5) differs from the reference view, robustly."""
        axes = (np.linspace(-1, 1, size) if size > 1 else np.zeros(1) for size in self.grid)
        v, u = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        design = np.stack([v**i * u**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=1)
        seen = np.array(self.valid.any(axis=(1, 2)))
        seen[self.centre] = False
        smooth = shading
        weight: NDArray[np.floating] = seen.astype(np.float64)
        for _ in range(_SMOOTHINGS):
            root = np.sqrt(weight)[:, None]
            smooth = design @ np.linalg.lstsq(root * design, root * shading, rcond=None)[0]
            error = np.sqrt(((shading - smooth) ** 2).sum(axis=1))
            usual = float(np.median(error[seen])) if seen.any() else 0.0
            weight = seen * _trust(error / max(usual, 1e-9))
        # what all views but the reference view seem to have is an error of its samples
        return np.asarray(smooth - smooth[self.centre])

    def _choose_power(self) -> None:
        """The way of falling that leaves the least difference."""
        best = dict(vars(self))
        least = self.left
        for power in _POWERS:
            if power == best["power"]:
                continue
            self.power = power
            self.fit(again=True)
            if self.left < least:
                best, least = dict(vars(self)), self.left
        vars(self).update(best)

    def _try(self, part: str, share: float) -> None:
        """Fit with one part more; undo it unless what is left of the differences falls by that share."""
        before, state = self.left, dict(vars(self))
        setattr(self, part, True)
        if part == "with_shading":
            self.with_vignetting = True
        self.fit()
        if self.left > (1 - share) * before:
            vars(self).update(state)

    @property
    def left(self) -> float:
        """Difference that is left in the typical view, of full scale."""
        others = self.valid.any(axis=(1, 2)) & (np.arange(len(self.valid)) != self.centre)
        return float(np.median(self.scatter[others])) + _ROUNDING if others.any() else _ROUNDING

    def effect(self) -> Array:
        """Root mean square, per view, of the difference that the parameters make to the reference view."""
        scene, factor = self.levels[self.centre], self._factor()
        factor = factor / factor[self.centre]
        made = factor[..., None] * self.gain[:, None].astype(np.float32) * scene
        made += self.offset[:, None].astype(np.float32)
        return _rms(np.abs(made - scene).max(axis=-1), self.weight)

    def dark(self) -> NDArray[np.bool_]:
        """Views (V·U,) that are dark, or black or white wherever it was looked."""
        mean = self.levels.mean(axis=(1, 2))
        seen = np.asarray(self.valid.all(axis=-1)).any(axis=1)
        return np.asarray((mean < _DARKEST * mean[self.centre]) | ~seen)

    def result(self, present: NDArray[np.bool_], left_out: NDArray[np.bool_]) -> Equalisation:
        """What was found without the views to leave out."""
        left_out = present.reshape(-1) & left_out.reshape(-1)
        left_out[self.centre] = False
        used = present.reshape(-1) & ~left_out
        effect = np.where(used, self.effect(), 0)
        # the brightness of the corners and the middle of the reference view meets half way
        gain = self.gain / _shaded(2 / 3 * self.shading[self.centre, 2], self.power)
        return Equalisation(
            gain=gain.reshape(*present.shape, -1),
            offset=self.offset.reshape(*present.shape, -1),
            shading=self.shading.reshape(*present.shape, -1),
            left_out=left_out.reshape(present.shape),
            effect=effect.reshape(present.shape),
            samples=self.levels.shape[1],
            needed=self._needed(effect, used),
            power=self.power,
        )

    def _needed(self, effect: Array, used: NDArray[np.bool_]) -> bool:
        notable = np.maximum(_NOTABLE, _APART * self.scatter)
        return self.with_vignetting or self.with_offset or bool((used & (effect > notable)).any())


def _sum_of_terms(terms: NDArray[np.float32], parameters: Array) -> NDArray[np.float32]:
    """What terms (V·U, N, K) times the parameters of each view (V·U, K) come to, (V·U, N); K may be 0.

    Then `einsum` would read the element that an empty array has not, and where that is NaN, so is all.
    """
    if not terms.shape[2]:
        return np.zeros(terms.shape[:2], np.float32)
    return np.asarray(np.einsum("vnk,vk->vn", terms, parameters.astype(np.float32)))


def _arrow(
    design: NDArray[np.float32],
    shared: NDArray[np.float32],
    target: NDArray[np.float32],
    weight: NDArray[np.float32],
    prior: Array,
) -> tuple[Array, float]:
    """Least squares: target (V·U, N) = design (V·U, N, K) · parameters per view + shared (V·U, N) · one."""
    weighted = np.swapaxes(design * weight[..., None], 1, 2)
    left = (weighted @ design).astype(np.float64) + np.diag(prior)
    right = (weighted @ np.stack([target, shared], axis=-1)).astype(np.float64)
    own = np.linalg.solve(left, right)
    # what is left of the shared column once the views' own are taken out
    rest = weight * shared
    square = float((rest * shared).sum()) - float((right[..., 1] * own[..., 1]).sum())
    product = float((rest * target).sum()) - float((right[..., 1] * own[..., 0]).sum())
    common = min(product / (square + _USUAL_SHADING**-2), 0.0)  # corners are never brighter
    return own[..., 0] - common * own[..., 1], common


def _agreed(one: Array, other: Array) -> float:
    """Root of the mean product of two estimates of offsets: their size, where errors are independent."""
    return float(np.sqrt(max(float((one * other).mean()), 0.0)))


def _alike(one: Array, other: Array) -> float:
    """Correlation of two estimates of differences."""
    return float((one * other).sum() / max(float(np.sqrt((one**2).sum() * (other**2).sum())), 1e-12))


def _median(values: NDArray[Any], valid: NDArray[np.bool_]) -> Array:
    """Median (V·U,) of the valid values of each view; 1 where there is none."""
    count = valid.sum(axis=1)
    place = np.minimum(count // 2, values.shape[1] - 1)
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    return np.where(count > 0, ordered[np.arange(len(values)), place], 1.0)


def _rms(values: NDArray[Any], weight: NDArray[np.float32]) -> Array:
    total = np.maximum(weight.sum(axis=1), 1e-6)
    return np.asarray(np.sqrt((weight * values**2).sum(axis=1) / total), np.float64)


def _scale(error: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How far (V·U, 1) the samples of each view typically scatter, of full scale."""
    some = slice(None, None, max(1, error.shape[1] // _ENOUGH))
    return np.maximum(1.48 * _median(error[:, some], valid[:, some]), _FINEST).astype(np.float32)[:, None]


def _trust(relative: NDArray[np.float32], multiple: float = 2.0) -> NDArray[np.float32]:
    """Weight in [0, 1] of samples with these errors, in units of the scatter: little beyond that multiple."""
    part = np.square(relative / multiple)
    part += 1
    np.square(part, out=part)
    return np.asarray(np.divide(1, part, out=part), np.float32)


def _shown_everywhere(relative: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Weight (N,) in [0, 1] of samples: little for those that more than a quarter of the views contradict.

    What stands beside something nearer is hidden in part in many views, by too little in each to be told.
    """
    some = slice(None, None, 2)
    known = np.where(valid[some], relative[some], np.float32(_TYPICAL))
    most = int(_MOST * (len(known) - 1))
    large = np.partition(known, most, axis=0)[most]
    return _trust(large / np.maximum(np.median(large), np.float32(_TYPICAL)), _SELECTED)
