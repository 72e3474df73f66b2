"""The choice among maps: truth, oracle, and laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from lfdepth import LightField, scenes
from lfdepth.blocks import choosing
from lfdepth.blocks.choosing import choose
from lfdepth.engines import engine
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import unit
from lfdepth.scenes.chance import whole

Array = NDArray[Any]
VIEWS = whole(5)


@pytest.fixture(scope="module")
def wedges() -> LightField:
    return scenes.render("wedges", size=(70, 80), views=5, samples=2)


def bad(found: Array, truth: Array) -> float:
    return float(np.mean(np.abs(found - truth)[8:-8, 8:-8] > 0.07))


def test_what_is_right_anywhere_in_some_map_is_found(wedges: LightField) -> None:
    """Truth: of three maps, each is wrong by 0.3 to 1 px in two thirds of the patches of 4x4 px."""
    truth, rng = wedges.truth, np.random.default_rng(3)
    assert truth is not None
    right = rng.integers(0, 3, (18, 20)).repeat(4, 0).repeat(4, 1)[:70, :80]
    maps = []
    for number in range(3):
        error = (rng.uniform(0.3, 1, truth.shape) * rng.choice([-1, 1], truth.shape)).astype(np.float32)
        maps.append(np.where(right == number, truth, truth + error))
    assert min(bad(each, truth) for each in maps) > 0.6
    assert bad(choose(wedges, maps, VIEWS), truth) < 0.03


def test_occluders_do_not_decide(wedges: LightField) -> None:
    """Truth against the same map drawn 2 px too wide around what is near, as windows do: gaps are kept.

    The mean over all views would take the wide one wherever most views see the occluder.
    """
    truth = wedges.truth
    assert truth is not None
    wide = ndimage.maximum_filter(truth, 5)
    assert bad(wide, truth) > 0.18
    assert bad(choose(wedges, [wide, truth], VIEWS), truth) < 0.2 * bad(wide, truth)


def test_disagreement_is_that_of_its_definition(wedges: LightField) -> None:
    """Oracle: in one piece instead of strips, view by view; a quarter of 24 views is asked."""
    truth = wedges.truth
    assert truth is not None
    maps = [truth, truth + np.float32(0.4)]
    others = [position for position in VIEWS if position != (0, 0)]
    with engine("cpu", threads=2) as used:
        reference = unit(wedges.reference, wedges.full_scale)
        found = choosing._disagreement(wedges, reference, maps, others, used)
    levels = wedges.views.astype(float) / 255
    rows, columns = np.mgrid[:70, :80].astype(float)
    for disparity, each in zip(maps, found, strict=True):
        windows = []
        for v, u in others:
            places = rows - disparity * v, columns - disparity * u
            differences = [
                np.abs(
                    ndimage.map_coordinates(levels[2 + v, 2 + u, ..., c], places, order=3, mode="nearest")
                    - levels[2, 2, ..., c]
                )
                for c in range(3)
            ]
            padded = np.pad(np.mean(differences, axis=0), 1, "symmetric")
            windows.append(
                np.mean([padded[i : i + 70, j : j + 80] for i in range(3) for j in range(3)], axis=0)
            )
        expected = np.sort(windows, axis=0)[:6].mean(axis=0)
        # at the views' own borders, splines of what lies beyond them differ a little
        np.testing.assert_allclose(each[12:-12, 12:-12], expected[12:-12, 12:-12], atol=2e-5)


def test_one_map_is_itself_but_for_the_medians(wedges: LightField) -> None:
    """Law: a plane stays, whatever the views show."""
    plane = np.full((70, 80), 0.4, np.float32)
    np.testing.assert_array_equal(choose(wedges, [plane], VIEWS), plane)


def test_same_map_for_any_number_of_threads(wedges: LightField) -> None:
    truth = wedges.truth
    assert truth is not None
    maps = [truth, truth + np.float32(0.2), truth - np.float32(0.1)]
    found = [choose(wedges, maps, VIEWS, engine=engine("cpu", threads=threads)) for threads in (1, 2, 3)]
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_nothing_to_choose_from_is_refused(wedges: LightField) -> None:
    with pytest.raises(LightFieldError, match="found 0 maps"):
        choose(wedges, [], VIEWS)
    with pytest.raises(LightFieldError, match="0 views beside"):
        choose(wedges, [np.zeros((70, 80), np.float32)], [(0, 0)])
