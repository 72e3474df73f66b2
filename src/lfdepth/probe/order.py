"""Is the grid of views in order? Flips, transposition and the sign of disparity, tested on the pixels.

Rows and columns: where the grid is in order, a point moves along x from column to column and along y from row
to row, by the same disparity. Of the four ways to transpose or mirror a grid, only the true one lets all
views agree with the reference view.

Sign: if rows and columns are both reversed, all disparities change their sign and the views agree as before.
Which sign is right shows where surfaces hide each other: the nearer one, of larger disparity, has to win.

Serpentine order: where every second row of views runs back, the first views of two rows stand at opposite
ends of the grid, and differ more than the first of one does from the last of the other.

Another grid: where the ends of rows, or the tiles of a picture, lie elsewhere than they were read, the views
are looked at once more in that grid, and only if they are in place there it is what is advised.

All of it is to hold where brightness differs between the views: orders are compared by local contrast, and
for the sign the views are made alike first. What is found counts only if nearly all views then show what the
reference view shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.engines import using
from lfdepth.engines.base import Engine
from lfdepth.lightfield import LightField, grid_offsets
from lfdepth.probe.agreement import likeness, share_in_place
from lfdepth.probe.evening import Shades, measure_shades
from lfdepth.probe.matching import (
    LIMIT,
    Match,
    Order,
    Probe,
    better,
    local_contrast,
    make_probe,
    match,
    plane_range,
    shrink_to,
    widest,
)
from lfdepth.probe.ranges import COARSE, SLACK, WIDER, coarse_range, ends
from lfdepth.probe.regrid import in_other_rows, in_other_tiles

# Shorter side, px, of the views that are compared; for the sign, larger ones if the first do not decide it.
_SIDES = 256, 512
# Half way out, one surface still moves enough against another to hide it.
_RINGS = 1.0, 0.5
# Least share of the pixels that tell the orders apart; of them, least share that has to agree.
_DECISIVE, _AGREEING = 0.02, 0.6
# Least share of the views that have to show what the reference view shows; most points.
_IN_PLACE, _TESTED = 0.7, 500
# Serpentine order: shorter side of the views that are compared; pairs of rows at most; by how much views that
# would be neighbours have to be more alike, and in which share of the pairs.
_SIDE_OF_NEIGHBOURS, _PAIRS, _MORE_ALIKE, _OFTEN = 96, 6, 0.85, 0.8
# Least number of occlusions; least share of them that has to agree.
_FEWEST, _MAJORITY = 40, 0.7
# Grey levels of 255: at most what a visible surface mispredicts a view by; at least what a hidden one does.
_SAME, _OTHER = 4.0, 8.0
# From how many px on one surface moves against another, between the reference view and a view.
_JUMP = 1.2


@dataclass(frozen=True)
class Reordering:
    """What is done to a grid of views: options of `lfdepth.read`, which applies them in this sequence."""

    transpose: bool = False
    flip_v: bool = False
    flip_u: bool = False
    serpentine: bool = False

    @property
    def options(self) -> str:
        """The options of the command line, such as "--transpose --flip-u"; empty if nothing is done."""
        named = {
            "--serpentine": self.serpentine,
            "--transpose": self.transpose,
            "--flip-v": self.flip_v,
            "--flip-u": self.flip_u,
        }
        return " ".join(option for option, needed in named.items() if needed)

    @property
    def call(self) -> str:
        """The same in Python, such as "read(path, transpose=True, flip_u=True)"."""
        named = {
            "serpentine": self.serpentine,
            "transpose": self.transpose,
            "flip_v": self.flip_v,
            "flip_u": self.flip_u,
        }
        return f"read({', '.join(['path', *(f'{name}=True' for name, needed in named.items() if needed)])})"

    def then(self, other: Reordering) -> Reordering:
        """What does the same as this one and then the other, which is not serpentine."""
        flip_v, flip_u = (self.flip_u, self.flip_v) if other.transpose else (self.flip_v, self.flip_u)
        return Reordering(
            self.transpose != other.transpose,
            flip_v != other.flip_v,
            flip_u != other.flip_u,
            self.serpentine,
        )

    def undone(self, lf: LightField) -> LightField:
        """The views of a light field that was read so, in the rows in which they are stored."""

        def stored(grid: NDArray[Any]) -> NDArray[Any]:
            grid = grid[:: -1 if self.flip_v else 1, :: -1 if self.flip_u else 1]
            return grid.swapaxes(0, 1) if self.transpose else grid

        return LightField(stored(lf.views), present=stored(lf.available), name=lf.name)


AS_STORED = Reordering()


@dataclass(frozen=True)
class Orientation:
    """What the pixels say about the order of the views.

    Attributes
    ----------
    reordering
        What the light field has to be read with; while the sign is undecided, if it is as it was read.
    opposite
        What it would have to be read with if disparity had the opposite sign.
    applied
        What it was read with.
    order_evidence
        Of the pixels that can tell, the share that is for this order of rows and columns, 0 to 1.
    sign_evidence
        Of the occlusions, the share that is for one of the signs, 0.5 to 1.
    order_decided, sign_decided
        Whether there are enough pixels and occlusions, and enough of them agree.
    in_place
        Share of the views that show what the reference view shows, once they are in the best order; 0 where
        that repeats along the grid.
    grid
        (V, U), rows and columns as stored, if the views were taken on another grid than they were read with.
    """

    reordering: Reordering
    opposite: Reordering
    applied: Reordering
    order_evidence: float
    sign_evidence: float
    order_decided: bool
    sign_decided: bool
    in_place: float = 1.0
    grid: tuple[int, int] | None = None

    @property
    def decided(self) -> bool:
        """Whether order and sign are known."""
        return self.order_decided and self.sign_decided

    @property
    def wrong(self) -> bool:
        """Whether the views are known to be in another order, or on another grid, than they should be."""
        if self.grid is not None:
            return True
        possible = {self.reordering} if self.sign_decided else {self.reordering, self.opposite}
        return self.order_decided and self.applied not in possible

    @property
    def message(self) -> str:
        """What was found and what to do about it, in one line."""
        if not self.order_decided:
            if self.in_place < _IN_PLACE:
                return (
                    "the views agree with one another in no order; check the number of rows and columns "
                    "(--grid), how the views are numbered, the format (--format), and whether they all show "
                    "the same scene at the same time"
                )
            return (
                "order of the views undecided: hardly anything moves with the grid in any order; check the "
                "number of rows and columns and how the views are numbered"
            )
        use, opposite = self._advice(self.reordering), self._advice(self.opposite)
        if self.wrong:
            what = "views are not in the expected order, top to bottom and left to right"
            if self.grid is not None:
                what = "views were taken on another grid than they are read with"
            found = f"{what}; {use}"
            return (
                found if self.sign_decided else f"{found}, or, if near and far come out swapped, {opposite}"
            )
        if self.sign_decided:
            return "views are in order"
        other = opposite if self.reordering == self.applied else use
        return (
            "rows and columns of views are in order, but the sign of disparity is undecided, because too few "
            f"surfaces hide each other; if near and far come out swapped, {other}"
        )

    @property
    def call(self) -> str:
        """What reads the views in order in Python, such as "read(path, grid=(6, 6), flip_u=True)"."""
        if self.grid is None:
            return self.reordering.call
        return self.reordering.call.replace("path", f"path, grid={self.grid}", 1)

    @property
    def options(self) -> str:
        """The options that read the views in order, such as "--grid 6x6 --flip-u"; empty if it needs none."""
        return self._options(self.reordering)

    def _options(self, reordering: Reordering) -> str:
        grid = "" if self.grid is None else f"--grid {self.grid[1]}x{self.grid[0]} "
        return f"{grid}{reordering.options}".rstrip()

    def _advice(self, reordering: Reordering) -> str:
        options = self._options(reordering)
        return f"use {options}" if options else f"leave out {self.applied.options}"


def check_orientation(
    lf: LightField,
    *,
    applied: Reordering = AS_STORED,
    threads: int | None = None,
    engine: Engine | None = None,
) -> Orientation:
    """Test on the pixels whether the views are in order.

    Parameters
    ----------
    lf
        Light field as it was read.
    applied
        The options it was read with, so that the advice applies to reading it again.
    threads
        Number of threads; None uses all processors. The result does not depend on it.
    engine
        Engine to use instead of the default one.

    Returns
    -------
    Orientation
        Undecided if the scene does not show it: without texture, or with all of it at zero disparity, nothing
        shows the order; without surfaces that hide each other, nothing shows the sign.

    Raises
    ------
    LightFieldError
        If no view in line with the reference view is present.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("leaves", size=96, views=5)
    >>> lfdepth.check_orientation(lf).message
    'views are in order'
    >>> lfdepth.check_orientation(replace(lf, views=lf.views[:, ::-1])).reordering.options
    '--flip-u'
    """
    with using(engine, threads=threads) as used:
        if lf.positions is None and _runs_back(lf, applied):
            base = Reordering(serpentine=not applied.serpentine)
            found = _ordered(_unwound(applied.undone(lf)), base, applied, used)
        else:
            found = _ordered(lf, applied, applied, used)
        return find_grid(lf, used, applied=applied) or found


def find_grid(lf: LightField, engine: Engine, *, applied: Reordering = AS_STORED) -> Orientation | None:
    """What the pixels say of the views on another grid, if they were taken on that.

    Parameters
    ----------
    lf
        Light field as it was read.
    engine
        Engine.
    applied
        The options it was read with.
    """
    if lf.positions is not None:
        return None
    stored = applied.undone(lf)
    for other in (in_other_rows(stored), in_other_tiles(stored)):
        if other is None:
            continue
        found = _ordered(other, AS_STORED, AS_STORED, engine)
        if found.order_decided:
            return replace(found, applied=applied, grid=(other.shape[0], other.shape[1]))
    return None


def _ordered(lf: LightField, base: Reordering, applied: Reordering, engine: Engine) -> Orientation:
    """What the pixels say of views that were read with `base`, every row in one direction."""
    for limit in (widest(lf), WIDER * widest(lf)):
        probe = make_probe(lf, limit, shrink_to(lf, _SIDES[0]), _RINGS, contrast=True, engine=engine)
        order, found, agreeing, decisive = _find_order(probe, limit, engine)
        in_place = _share_in_place(lf, order, probe, found, engine)
        decided = decisive >= _DECISIVE and agreeing >= _AGREEING and in_place >= _IN_PLACE
        if decided:
            break
    sign = _find_sign(lf, order, found, probe, limit, engine) if decided else _Sign()
    expected, opposite = _remedies(lf, order)
    if sign.decided and sign.far_wins > sign.near_wins:
        expected, opposite = opposite, expected
    return Orientation(
        reordering=base.then(expected),
        opposite=base.then(opposite),
        applied=applied,
        order_evidence=agreeing,
        sign_evidence=sign.majority,
        order_decided=decided,
        sign_decided=sign.decided,
        in_place=in_place,
    )


def _runs_back(lf: LightField, applied: Reordering) -> bool:
    """Whether every second row of views, as they are stored, runs the other way."""
    columns = applied.transpose
    rows, length = lf.shape[1::-1] if columns else lf.shape[:2]
    if min(rows, length) < 2:
        return False
    shrink = shrink_to(lf, _SIDE_OF_NEIGHBOURS)
    first = max(0, (rows - 1 - _PAIRS) // 2)
    seen: dict[tuple[int, int], NDArray[np.float32] | None] = {}

    def view(row: int, place: int) -> NDArray[np.float32] | None:
        index = (place, row) if columns else (row, place)
        if index not in seen:
            seen[index] = local_contrast(lf, index, shrink) if lf.available[index] else None
        return seen[index]

    pairs = []
    for row in range(first, min(rows - 1, first + _PAIRS)):
        for place in (0, length - 1):
            own, straight, back = view(row, place), view(row + 1, place), view(row + 1, length - 1 - place)
            if own is not None and straight is not None and back is not None:
                pairs.append(_apart(own, back) < _MORE_ALIKE * _apart(own, straight))
    return len(pairs) > 1 and float(np.mean(pairs)) >= _OFTEN


def _apart(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    return float(np.minimum(np.abs(one - other), LIMIT).mean())


def _unwound(lf: LightField) -> LightField:
    """The same with every second row of views reversed."""
    views, present = lf.views.copy(), lf.available.copy()
    views[1::2], present[1::2] = lf.views[1::2, ::-1], lf.available[1::2, ::-1]
    return replace(lf, views=views, present=present)


def _find_order(probe: Probe, limit: float, engine: Engine) -> tuple[Order, Match, float, float]:
    """The best order, what was found with it, and the shares of decisive pixels for it, and of all."""
    planes = plane_range(-limit, limit, probe.unit)
    mirrored = (False, True) if probe.offsets.any(axis=0).all() else (False,)  # one row has only a sign
    orders = [Order(transposed, mirror) for transposed in (False, True) for mirror in mirrored]
    found = [match(probe, planes, engine, order) for order in orders]
    costs = np.stack([each.cost for each in found])
    first, second = np.partition(costs, 1, axis=0)[:2]
    decisive = better(first, second)
    votes = np.bincount(costs.argmin(axis=0)[decisive], minlength=len(orders))
    best = int(votes.argmax())
    return orders[best], found[best], float(votes[best] / max(votes.sum(), 1)), float(decisive.mean())


def _share_in_place(lf: LightField, order: Order, probe: Probe, found: Match, engine: Engine) -> float:
    """Share of the views that show what the reference view shows; 1 where too little can tell."""
    places = np.argwhere(found.coherent(0.5 * probe.unit, 4))
    places = places[:: max(1, -(-len(places) // _TESTED))]
    points = np.asarray((places + 0.5) * probe.shrink, np.int64)
    ordered = replace(lf, positions=order.of(lf.offsets) - grid_offsets((lf.shape[0], lf.shape[1])))
    alike = likeness(ordered, points, found.disparity[tuple(places.T)].astype(np.float64), engine)
    return share_in_place(alike)


def _remedies(lf: LightField, order: Order) -> tuple[Reordering, Reordering]:
    """What mends an order if disparity has the expected sign, and if it has the opposite one."""
    rows, columns = lf.shape[1::-1] if order.transposed else lf.shape[:2]
    expected = Reordering(order.transposed, flip_v=False, flip_u=order.mirrored)
    opposite = Reordering(order.transposed, flip_v=rows > 1, flip_u=columns > 1 and not order.mirrored)
    return expected, opposite


@dataclass(frozen=True)
class _Sign:
    """Number of occlusions in which the surface of larger disparity wins, and in which it loses."""

    near_wins: int = 0
    far_wins: int = 0

    @property
    def majority(self) -> float:
        more, all_ = max(self.near_wins, self.far_wins), self.near_wins + self.far_wins
        return more / all_ if all_ else 0.5

    @property
    def decided(self) -> bool:
        return self.near_wins + self.far_wins >= _FEWEST and self.majority >= _MAJORITY


def _find_sign(
    lf: LightField, order: Order, found: Match, probe: Probe, limit: float, engine: Engine
) -> _Sign:
    """Compare the occlusions of surfaces, all views made as bright as the reference view."""
    outer = ends(found, probe.unit, COARSE)
    if outer is None:
        span = coarse_range(probe, limit, engine, order)
    else:
        span = outer[0] - SLACK * probe.unit, outer[1] + SLACK * probe.unit
    sign = _Sign()
    if span is None:
        return sign
    shades: Shades | None = None
    for shrink in dict.fromkeys(shrink_to(lf, side) for side in _SIDES):
        grey = make_probe(lf, max(-span[0], span[1]), shrink, _RINGS, engine=engine)
        if shades is None:
            shades = measure_shades(grey, found, order)
        grey = shades.evened(grey)
        closer = match(grey, plane_range(*span, grey.unit / 2), engine, order, halves=True)
        pixels = _Pixels(grey, closer, order, engine)
        counts = engine.each(pixels.occlusions, range(len(grey.views)))
        sign = _Sign(sum(near for near, _ in counts), sum(far for _, far in counts))
        if sign.decided:
            break
    return sign


class _Pixels:
    """The certain pixels of the reference view, from far to near."""

    def __init__(self, probe: Probe, found: Match, order: Order, engine: Engine) -> None:
        self.probe = probe
        self.grid = probe.ordered(order)
        places = np.flatnonzero(found.certain)
        places = places[np.argsort(found.disparity.flat[places], kind="stable")]
        self.disparity = found.disparity.flat[places]
        self.y, self.x = np.divmod(places, found.disparity.shape[1])
        self.level = probe.reference.flat[places]
        self.errors = engine.each(self._error, range(len(probe.views)))

    def occlusions(self, view: int) -> tuple[int, int]:
        """How often two surfaces meet in a pixel of a view that shows the nearer one, or the farther one.

        Both have to be seen in a view on the other side, where they move apart: otherwise a disparity that is
        wrong beside an occlusion boundary would count.
        """
        opposite = self._opposite(view)
        if opposite is None:
            return 0, 0
        error = self.errors[view]
        known = np.flatnonzero(np.isfinite(error) & (self.errors[opposite] < _SAME))
        near, far = self._meeting(view, known)
        away = float(np.abs(self.grid[view]).max()) / self.probe.shrink
        jump = (self.disparity[near] - self.disparity[far]) * away > _JUMP
        distinct = np.abs(self.level[near] - self.level[far]) > _OTHER
        near, far = near[jump & distinct], far[jump & distinct]
        return self._wins(error[near], error[far]), self._wins(error[far], error[near])

    @staticmethod
    def _wins(error: NDArray[np.float32], other: NDArray[np.float32]) -> int:
        return int(np.count_nonzero((error < _SAME) & (other > _OTHER)))

    def _opposite(self, view: int) -> int | None:
        """The view that comes closest to the mirror image of a view about the reference view."""
        along = self.grid @ self.grid[view]
        nearest = int(np.abs(self.grid + self.grid[view]).sum(axis=1).argmin())
        return nearest if along[nearest] < 0 else None

    def _landing(self, view: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where the pixels appear in a view, (y, x)."""
        v, u = self.grid[view]
        moved = self.disparity / np.float32(self.probe.shrink)
        return self.y - moved * np.float32(v), self.x - moved * np.float32(u)

    def _meeting(self, view: int, known: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Nearest and farthest of the known pixels that land on one pixel of a view, where they differ."""
        y, x = (np.rint(part[known]).astype(np.intp) for part in self._landing(view))
        height, width = self.probe.reference.shape
        target = y * width + x
        near, far = np.full(height * width, -1, np.intp), np.full(height * width, -1, np.intp)
        near[target] = known  # from far to near: the last one stays
        far[target[::-1]] = known[::-1]
        several = near != far
        return near[several], far[several]

    def _error(self, view: int) -> NDArray[np.float32]:
        """Difference between the view, where the pixels appear in it, and the pixels; infinite outside."""
        y, x = self._landing(view)
        height, width = self.probe.reference.shape
        outside = (y < 0) | (x < 0) | (y > height - 1) | (x > width - 1)
        y, x = np.clip(y, 0, height - 1.001), np.clip(x, 0, width - 1.001)
        row, column = y.astype(np.intp), x.astype(np.intp)
        down, right = y - row, x - column
        picture, column = self.probe.views[view], column + self.probe.margin
        upper = picture[row, column] * (1 - right) + picture[row, column + 1] * right
        lower = picture[row + 1, column] * (1 - right) + picture[row + 1, column + 1] * right
        error = np.abs(upper * (1 - down) + lower * down - self.level)
        return np.where(outside, np.float32(np.inf), error)
