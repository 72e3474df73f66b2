"""What happens to a light field before a method sees it: brightness made equal, the range found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lfdepth.lightfield import LightField
from lfdepth.probe.brightness import Equalisation, equalise, measure_brightness
from lfdepth.probe.ranges import find_range

if TYPE_CHECKING:
    from lfdepth.engines.base import Engine


@dataclass(frozen=True, eq=False)
class Prepared:
    """A light field ready for a method.

    Attributes
    ----------
    lf
        The light field, its views of equal brightness.
    range
        (min, max) disparity to search, px per view step.
    range_found
        Whether the range was found from the views.
    equalisation
        How the brightness of the views differed; None if it was not looked at.
    """

    lf: LightField
    range: tuple[float, float]
    range_found: bool
    equalisation: Equalisation | None


def prepare(
    lf: LightField,
    range: tuple[float, float] | None = None,
    *,
    equal: bool = True,
    engine: Engine | None = None,
) -> Prepared:
    """Prepare a light field.

    Parameters
    ----------
    lf
        Light field.
    range
        (min, max) disparity in px per view step; None takes the light field's own, and where it has none
        finds it.
    equal
        Whether to make the brightness of the views equal, where it differs.
    engine
        Engine to use instead of the default one.

    Raises
    ------
    LightFieldError
        If no range is given and none can be found.
    """
    given = range if range is not None else lf.disparity_range
    found = measure_brightness(lf, range=given, engine=engine) if equal else None
    if found is not None:
        lf = equalise(lf, found)
    searched = find_range(replace(lf, disparity_range=None), engine=engine) if given is None else given
    return Prepared(lf, searched, given is None, found)
