"""Does a disparity map hold? What the views say of it, and what may be wrong if they do not agree with it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.probe.agreement import disagreement
from lfdepth.probe.brightness import measure_brightness
from lfdepth.probe.geometry import NOTABLE_ASPECT, NOTABLE_POSITIONS, measure_aspect, measure_off_grid

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine
    from lfdepth.probe.preparation import Prepared

# Bounds: on clean scenes of the suite at most 0.40 disagree and 0.03 lie at the ends (docs/research-log.md).
MOST_DISAGREEING, MOST_WITHOUT_ASPECT = 0.5, 0.38
MOST_AT_ENDS = 0.12
MOST_UNEVEN = 0.02

# How far from a point the typical view shows something else, as a share of the contrast around it.
_DISAGREEING = 0.5
# Px per view step that belong to an end of the range; of it, at most.
_END, _END_SHARE = 0.05, 0.02
# Confidence below which there is no evidence, and above which positions of views are measured.
_NO_EVIDENCE, _SURE = 0.2, 0.5
# Only where fewer points disagree does a map tell where views stand.
_GOOD_MAP = 0.25


@dataclass(frozen=True)
class Checks:
    """What the views say of a disparity map.

    Attributes
    ----------
    disagreeing
        Share of the textured points at which the typical view shows something else than the reference view.
    at_ends
        Share of the pixels at the ends of the range that was searched.
    without_evidence
        Share of the pixels whose confidence is below 0.2.
    uneven
        Largest difference in brightness between views that was left, of full scale.
    aspect
        Vertical over horizontal steps, beside what the light field says of them; None if it is unknown.
    off_grid
        How far the typical view stands off its place, in steps.
    warnings
        In plain words, the likeliest cause first; empty if nothing is beyond its bound.
    """

    disagreeing: float
    at_ends: float
    without_evidence: float
    uneven: float
    aspect: float | None
    off_grid: float
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return asdict(self) | {"warnings": list(self.warnings)}


def check_map(
    prepared: Prepared,
    disparity: NDArray[np.float32],
    confidence: NDArray[np.float32],
    *,
    engine: Engine | None = None,
) -> Checks:
    """Check a map against the views that it was estimated from.

    Parameters
    ----------
    prepared
        The light field as the method saw it, and its range.
    disparity, confidence
        (H, W) maps.
    engine
        Engine to use instead of the default one.
    """
    lf, range = prepared.lf, prepared.range
    apart = disagreement(lf, disparity, engine=engine)
    uneven = 0.0
    if prepared.equalisation is None:
        left = measure_brightness(lf, range=range, engine=engine)
        uneven = float(left.effect.max()) if left.needed else 0.0
    sure = np.where(confidence > _SURE, disparity, np.nan)
    found = Checks(
        disagreeing=float((apart > _DISAGREEING).mean()) if apart.size else 0.0,
        at_ends=_at_ends(disparity, range),
        without_evidence=float((confidence < _NO_EVIDENCE).mean()),
        uneven=uneven,
        aspect=measure_aspect(lf, range, engine=engine),
        off_grid=measure_off_grid(lf, sure, engine=engine),
    )
    two_axes = min(lf.shape[:2]) > 1
    warnings = tuple(_warnings(found, range, prepared.range_found, two_axes=two_axes))
    return replace(found, warnings=warnings)


def _at_ends(disparity: NDArray[np.float32], range: tuple[float, float]) -> float:
    near = min(_END, _END_SHARE * (range[1] - range[0]))
    return float(((disparity < range[0] + near) | (disparity > range[1] - near)).mean())


def _warnings(found: Checks, range: tuple[float, float], range_found: bool, *, two_axes: bool) -> list[str]:
    words = []
    if found.uneven > MOST_UNEVEN:
        words.append(
            f"brightness differs between views by {100 * found.uneven:.0f} % of full scale; leave out "
            "--equalise off (equalise=False in Python)"
        )
    if found.aspect is not None and abs(found.aspect - 1) > NOTABLE_ASPECT:
        words.append(
            f"vertical steps of the views are {found.aspect:.2f} of the horizontal ones; use "
            f"--aspect {found.aspect:.2f} (lfdepth.with_aspect in Python)"
        )
    if found.off_grid > NOTABLE_POSITIONS and found.disagreeing < _GOOD_MAP:
        words.append(
            f"views stand {100 * found.off_grid:.0f} % of a step off their places; use --refine-positions "
            "(lfdepth.refine_positions in Python)"
        )
    if found.at_ends > MOST_AT_ENDS:
        words.append(
            f"{100 * found.at_ends:.0f} % of the pixels lie at the ends of the range {range[0]:g} to "
            f"{range[1]:g}; the scene may reach beyond it; give a wider one with --range MIN MAX"
        )
    # Where row and column of views share no disparities, less is enough: clean 0.34, transposed 0.42.
    most = MOST_WITHOUT_ASPECT if two_axes and found.aspect is None else MOST_DISAGREEING
    if found.disagreeing > most:
        causes = "the range, " if not range_found else ""
        words.append(
            f"at {100 * found.disagreeing:.0f} % of the textured points most views show something else than "
            f"the map says; check {causes}the order of the views and the number of rows and columns "
            "(lfdepth info), brightness and white level"
        )
    return words
