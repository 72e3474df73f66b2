"""Laws that votes and estimates obey whatever the scene."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fields
from lfdepth.blocks.voting import DELTAS, GRADIENTS, Mask, VoteRule, vote
from lfdepth.engines import engine
from lfdepth.engines.base import Delta, Gradient
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods import FAMILY
from lfdepth.trace import Trace

Array = fields.Array

votes_law = settings(max_examples=25, deadline=None, derandomize=True, database=None)
estimate_law = settings(max_examples=4, deadline=None, derandomize=True, database=None)

seeds = st.integers(0, 2**32 - 1)
sides = st.integers(8, 70)
odd = st.sampled_from([3, 5])
any_count = st.integers(3, 6)
kinds = st.sampled_from(fields.TEXTURES)
rules = st.builds(
    VoteRule, st.sampled_from(DELTAS), st.sampled_from([0.02, 0.1, 0.3]), st.sampled_from(GRADIENTS)
)
# Quarters of a pixel have exact bilinear weights on either side; see `test_mirrored_shifts...`.
quarters = st.integers(-14, 14).map(lambda q: q / 4)
any_disparity = st.floats(-3.5, 3.5, allow_nan=False)

OPTIONS: dict[str, Any] = {"step": 0.125, "radius": 3, "range": (-1.0, 1.25)}
SHARE = 0.01
"""Share of pixels in which two estimates may differ: single precision decides the odd `C̃ > 0` otherwise."""


def mirror_x(array: Array) -> Array:
    """(V, U, H, W, ...) mirrored in x and u."""
    return np.ascontiguousarray(array[:, ::-1, :, ::-1])


def mirror_y(array: Array) -> Array:
    """(V, U, H, W, ...) mirrored in y and v."""
    return np.ascontiguousarray(array[::-1, :, ::-1])


def transpose(array: Array) -> Array:
    """(V, U, H, W, ...) with x and y, and u and v, exchanged."""
    return np.ascontiguousarray(array.swapaxes(0, 1).swapaxes(2, 3))


# A law on views and what it does to a map (H, W).
SYMMETRIES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "mirror in x and u": (mirror_x, lambda image: image[:, ::-1]),
    "mirror in y and v": (mirror_y, lambda image: image[::-1]),
    "transpose": (transpose, lambda image: image.T),
}


def random_field(
    seed: int, grid: tuple[int, int], size: tuple[int, int], kind: str, absent: bool
) -> LightField:
    rng = np.random.default_rng(seed)
    present = fields.random_present(rng, grid) if absent else None
    return fields.light_field(rng, grid, size, kind=kind, present=present)


def changed(lf: LightField, change: Callable[[Array], Array]) -> LightField:
    """The light field with its views, and which of them exist, rearranged."""
    present = None if lf.present is None else change(lf.present[:, :, None, None])[:, :, 0, 0]
    return LightField(change(lf.views), present=present)


@pytest.mark.parametrize("law", SYMMETRIES)
@given(
    seed=seeds,
    rows=odd,
    columns=odd,
    height=sides,
    width=sides,
    kind=kinds,
    absent=st.booleans(),
    rule=rules,
    disparity=quarters,
    offset=st.none() | quarters,
)
@votes_law
def test_votes_commute_with_symmetries(
    law: str,
    seed: int,
    rows: int,
    columns: int,
    height: int,
    width: int,
    kind: str,
    absent: bool,
    rule: VoteRule,
    disparity: float,
    offset: float | None,
) -> None:
    change, move = SYMMETRIES[law]
    lf = random_field(seed, (rows, columns), (height, width), kind, absent)
    foreground = fields.random_mask(np.random.default_rng(seed), (height, width))
    mask, moved = None, None
    if offset is not None:
        mask, moved = Mask(foreground, offset), Mask(np.ascontiguousarray(move(foreground)), offset)
    found = vote(changed(lf, change), disparity, rule=rule, mask=moved)
    np.testing.assert_array_equal(found, move(vote(lf, disparity, rule=rule, mask=mask)))


@given(
    seed=seeds,
    rows=any_count,
    columns=any_count,
    height=sides,
    width=sides,
    kind=kinds,
    absent=st.booleans(),
    rule=rules,
    disparity=any_disparity,
)
@votes_law
def test_votes_commute_with_transposition_at_any_disparity(
    seed: int,
    rows: int,
    columns: int,
    height: int,
    width: int,
    kind: str,
    absent: bool,
    rule: VoteRule,
    disparity: float,
) -> None:
    lf = random_field(seed, (rows, columns), (height, width), kind, absent)
    found = vote(changed(lf, transpose), disparity, rule=rule)
    np.testing.assert_array_equal(found, vote(lf, disparity, rule=rule).T)


@pytest.mark.parametrize("law", SYMMETRIES)
@given(seed=seeds, disparity=any_disparity)
@votes_law
def test_mirrored_shifts_round_alike_but_for_ties(law: str, seed: int, disparity: float) -> None:
    """Products of two fractional shifts are rounded to whole weights; mirrored, a tie goes the other way."""
    change, move = SYMMETRIES[law]
    lf = random_field(seed, (5, 5), (30, 34), "scene", absent=False)
    found = vote(changed(lf, change), disparity, rule=VoteRule("none"))
    expected = move(vote(lf, disparity, rule=VoteRule("none")))
    assert np.abs(found - expected).mean() < 0.02
    assert np.mean(found * expected < 0) < 0.01


@given(
    seed=seeds,
    rows=any_count,
    columns=any_count,
    disparity=any_disparity,
    pixels=st.integers(-2, 2),
    rule=rules,
)
@votes_law
def test_moving_the_views_moves_the_disparity(
    seed: int, rows: int, columns: int, disparity: float, pixels: int, rule: VoteRule
) -> None:
    """Views shifted by whole pixels (k·u, k·v): away from the border, votes at D are then those at D + k."""
    disparity = round(disparity * 64) / 64  # D + k must not round
    reach = 6 * 3 + 2
    wide = random_field(seed, (rows, columns), (64, 67), "noise", absent=False)
    rough = wide.views
    moved = np.empty_like(rough)
    for i, j in np.ndindex(rows, columns):
        moved[i, j] = np.roll(rough[i, j], (-pixels * (i - rows // 2), -pixels * (j - columns // 2)), (0, 1))
    found = vote(LightField(moved), disparity + pixels, rule=rule)
    inner = (slice(reach, -reach), slice(reach, -reach))
    np.testing.assert_array_equal(found[inner], vote(wide, disparity, rule=rule)[inner])


@given(
    seed=seeds,
    rows=any_count,
    columns=any_count,
    disparity=any_disparity,
    scale=st.sampled_from([2, 3, 8]),
    offset=st.integers(0, 50),
    delta=st.sampled_from(["none", "sign"]),
    gradient=st.sampled_from(GRADIENTS),
    masked=st.booleans(),
)
@votes_law
def test_brightness_changes_no_vote_without_threshold(
    seed: int,
    rows: int,
    columns: int,
    disparity: float,
    scale: int,
    offset: int,
    delta: Delta,
    gradient: Gradient,
    masked: bool,
) -> None:
    """Also not inverted: eq. 2 and 3 see the product of two gradients, which turn together."""
    rng = np.random.default_rng(seed)
    dark = rng.integers(0, 25, (rows, columns, 12, 40, 1))
    mask = Mask(fields.random_mask(rng, (12, 40)), -0.3) if masked else None
    rule = VoteRule(delta, gradient=gradient)

    def votes(samples: Array) -> Array:
        return vote(LightField(samples.astype(np.uint8)), disparity, rule=rule, mask=mask)

    expected = votes(dark)
    np.testing.assert_array_equal(votes(dark * scale + offset), expected)
    np.testing.assert_array_equal(votes(255 - dark * scale), expected)


@given(seed=seeds, rows=any_count, columns=any_count, disparity=any_disparity, rule=rules)
@votes_law
def test_an_offset_in_brightness_changes_no_vote(
    seed: int, rows: int, columns: int, disparity: float, rule: VoteRule
) -> None:
    dark = np.random.default_rng(seed).integers(0, 200, (rows, columns, 12, 40, 1)).astype(np.uint8)
    found = vote(LightField(dark + np.uint8(55)), disparity, rule=rule)
    np.testing.assert_array_equal(found, vote(LightField(dark), disparity, rule=rule))


@given(
    seed=seeds, rows=any_count, columns=any_count, disparity=any_disparity, rule=rules, masked=st.booleans()
)
@votes_law
def test_votes_are_fractions(
    seed: int, rows: int, columns: int, disparity: float, rule: VoteRule, masked: bool
) -> None:
    rng = np.random.default_rng(seed)
    lf = random_field(seed, (rows, columns), (20, 45), "noise", absent=masked)
    mask = Mask(fields.random_mask(rng, (20, 45)), 0.4) if masked else None
    found = vote(lf, disparity, rule=rule, mask=mask)
    assert np.abs(found).max() <= 1


@pytest.mark.parametrize("masked", [False, True])
@given(seed=seeds, height=st.integers(30, 200), rule=rules, kind=kinds)
@votes_law
def test_threads_change_no_vote(masked: bool, seed: int, height: int, rule: VoteRule, kind: str) -> None:
    lf = random_field(seed, (3, 4), (height, 33), kind, absent=False)
    mask = Mask(fields.random_mask(np.random.default_rng(seed), (height, 33)), -0.4) if masked else None
    one = vote(lf, 0.3, rule=rule, mask=mask)
    for threads in (2, 3, 5):
        with engine(threads=threads) as used:
            np.testing.assert_array_equal(vote(lf, 0.3, rule=rule, mask=mask, engine=used), one)


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", FAMILY)
def test_threads_change_no_estimate(name: str) -> None:
    lf = random_field(1, (4, 5), (150, 41), "scene", absent=False)
    one = estimate(lf, name, threads=1, **OPTIONS)
    for threads in (2, 3, 5):
        many = estimate(lf, name, threads=threads, **OPTIONS)
        np.testing.assert_array_equal(many.disparity, one.disparity)
        np.testing.assert_array_equal(many.confidence, one.confidence)


def assert_almost_everywhere(found: Array, expected: Array, tolerance: float = 0.01) -> None:
    assert np.mean(np.abs(found - expected) > tolerance) < SHARE


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", FAMILY)
@pytest.mark.parametrize("law", SYMMETRIES)
@given(seed=seeds, height=st.integers(30, 60), width=st.integers(30, 60))
@estimate_law
def test_estimates_commute_with_symmetries(name: str, law: str, seed: int, height: int, width: int) -> None:
    change, move = SYMMETRIES[law]
    lf = random_field(seed, (5, 5), (height, width), "scene", absent=False)
    found = estimate(changed(lf, change), name, **OPTIONS)
    expected = estimate(lf, name, **OPTIONS)
    assert_almost_everywhere(found.disparity, move(expected.disparity))
    assert_almost_everywhere(found.confidence, move(expected.confidence))


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", FAMILY)
@given(seed=seeds, pixels=st.sampled_from([-2, -1, 1, 2]))
@estimate_law
def test_moving_the_views_moves_the_estimate(name: str, seed: int, pixels: int) -> None:
    """Views and range shifted by k: the map rises by k, away from the border."""
    lf = random_field(seed, (5, 5), (64, 66), "scene", absent=False)
    moved = np.empty_like(lf.views)
    for i, j in np.ndindex(5, 5):
        moved[i, j] = np.roll(lf.views[i, j], (-pixels * (i - 2), -pixels * (j - 2)), (0, 1))
    low, high = OPTIONS["range"]
    options = {**OPTIONS, "range": (low + pixels, high + pixels)}
    found = estimate(LightField(moved), name, **options).disparity - pixels
    # Shifts up to 2 views x 3.25 px, and as much again for what the filter's windows carry inwards.
    inner = (slice(16, -16), slice(16, -16))
    assert_almost_everywhere(found[inner], estimate(lf, name, **OPTIONS).disparity[inner])


@pytest.mark.parametrize("name", FAMILY)
@given(seed=seeds, scale=st.sampled_from([2, 3]))
@estimate_law
def test_brightness_changes_no_votes_volume(name: str, seed: int, scale: int) -> None:
    """Without threshold the initial volume of the first planes, before any mask, depends on no brightness."""
    rng = np.random.default_rng(seed)
    dark = rng.integers(0, 80, (4, 5, 34, 40, 1))

    def initial(samples: Array) -> Array:
        lf = LightField(samples.astype(np.uint8))
        trace = Trace(keep=("votes",))
        estimate(lf, name, delta="none", trace=trace, **OPTIONS)
        return np.stack(trace.kept["votes"][:3])

    np.testing.assert_array_equal(initial(dark * scale), initial(dark))
