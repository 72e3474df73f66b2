"""The weighted median against the oracle, and its laws."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import naive_photo
from lfdepth.blocks.median import weighted_median
from lfdepth.engines import engine
from lfdepth.engines.cpu.medians import sorting_network
from lfdepth.errors import LightFieldError

Array = NDArray[Any]


def maps(rng: np.random.Generator, size: tuple[int, int], channels: int = 3) -> tuple[Array, Array]:
    """A map with repeated values, and a guide of a few colours with noise."""
    values = rng.integers(-6, 7, size) / 4 + rng.integers(0, 2, size) * rng.normal(size=size)
    colours = rng.random((3, channels))[rng.integers(0, 3, size)]
    guide = np.clip(colours + rng.normal(0, 0.03, (*size, channels)), 0, 1)
    return values.astype(np.float32), guide.astype(np.float32)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("radius", [1, 2, 3])
@pytest.mark.parametrize("weighed", [False, True])
def test_matches_the_oracle(radius: int, channels: int, weighed: bool) -> None:
    rng = np.random.default_rng([radius, channels, weighed])
    for size, sigmas in (((12, 15), (0.05, 2.0)), ((3, 30), (0.3, 1.0)), ((15, 2), (0.02, 5.0))):
        values, guide = maps(rng, size, channels)
        weight = rng.random(size) if weighed else None
        found = weighted_median(
            values, guide, radius=radius, sigma_colour=sigmas[0], sigma_space=sigmas[1], weight=weight
        )
        low, high = naive_photo.weighted_median(values, guide, radius, *sigmas, weight, slack=1e-4)
        # Weights are rounded, which may decide where half of them is a matter of the last digits.
        assert ((found == low) | (found == high)).all()
        assert np.mean(low == high) > 0.98


@pytest.mark.parametrize("width", [127, 128, 129, 300])
def test_matches_the_oracle_at_any_width(width: int) -> None:
    values, guide = maps(np.random.default_rng(width), (4, width))
    low, high = naive_photo.weighted_median(values, guide, 2, 0.05, 2.0, slack=1e-4)
    found = weighted_median(values, guide)
    assert ((found == low) | (found == high)).all()


@pytest.mark.parametrize("radius", [1, 2, 4])
def test_equal_weights_give_the_lower_median(radius: int) -> None:
    """Truth: windows cut at the border often hold an even number of values, a tie."""
    rng = np.random.default_rng(radius)
    values, guide = maps(rng, (13, 11))
    found = weighted_median(values, guide, radius=radius, sigma_colour=1e6, sigma_space=1e6)
    for y, x in np.ndindex(values.shape):
        window = values[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1]
        assert found[y, x] == np.sort(window, axis=None)[(window.size - 1) // 2]


def test_a_constant_stays() -> None:
    _, guide = maps(np.random.default_rng(1), (9, 40))
    assert (weighted_median(np.full((9, 40), -0.7, np.float32), guide) == np.float32(-0.7)).all()


def test_increasing_functions_pass_through() -> None:
    rng = np.random.default_rng(2)
    _, guide = maps(rng, (20, 33))
    values = rng.integers(-100, 100, (20, 33))
    expected = weighted_median(values, guide).astype(np.int64) ** 3
    np.testing.assert_array_equal(weighted_median(values**3, guide), expected)


def test_transposing_passes_through() -> None:
    values, guide = maps(np.random.default_rng(3), (21, 34))
    found = weighted_median(values.T, guide.transpose(1, 0, 2))
    np.testing.assert_array_equal(found.T, weighted_median(values, guide))


def test_results_are_values_of_the_window() -> None:
    values, guide = maps(np.random.default_rng(4), (15, 16))
    found = weighted_median(values, guide, radius=2)
    for y, x in np.ndindex(values.shape):
        assert found[y, x] in values[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]


@pytest.mark.parametrize("place", [(6, 7), (0, 0), (11, 4)])
def test_an_outlier_of_the_same_colour_goes(place: tuple[int, int]) -> None:
    values, guide = np.full((12, 14), 0.5, np.float32), np.full((12, 14, 3), 0.4, np.float32)
    values[place] = 3
    assert (weighted_median(values, guide) == 0.5).all()


def test_an_edge_between_two_colours_stays() -> None:
    """Also at corners and on a line one pixel wide, where a plain median rounds and erases."""
    inside = np.zeros((20, 24), bool)
    inside[5:14, 6:15] = True
    inside[:, 20] = True
    guide = np.where(inside[..., None], [0.8, 0.3, 0.2], [0.2, 0.4, 0.7])
    values = np.where(inside, 1.5, -0.5).astype(np.float32)
    np.testing.assert_array_equal(weighted_median(values, guide), values)


def test_pixels_without_weight_have_no_say() -> None:
    rng = np.random.default_rng(5)
    values, guide = maps(rng, (14, 20))
    bad = rng.random((14, 20)) < 0.3
    spoilt = np.where(bad, 1e6 * rng.normal(size=bad.shape), values)
    first, second = (weighted_median(v, guide, weight=~bad) for v in (values, spoilt))
    kept = first != values
    kept |= ~bad
    np.testing.assert_array_equal(first[kept], second[kept])


def test_a_window_without_weight_keeps_the_value() -> None:
    values, guide = maps(np.random.default_rng(6), (10, 11))
    np.testing.assert_array_equal(weighted_median(values, guide, weight=np.zeros((10, 11))), values)


def test_threads_change_nothing() -> None:
    values, guide = maps(np.random.default_rng(7), (100, 30))
    with engine(threads=3) as three:
        found = weighted_median(values, guide, engine=three)
    np.testing.assert_array_equal(found, weighted_median(values, guide))


@pytest.mark.parametrize("count", range(1, 13))
def test_networks_sort_every_pattern_of_zeros_and_ones(count: int) -> None:
    """The zero-one principle: a network that sorts these sorts everything."""
    patterns = np.array(list(product((0, 1), repeat=count)))
    for low, high in sorting_network(count):
        patterns[:, [low, high]] = np.sort(patterns[:, [low, high]], axis=1)
    assert (np.diff(patterns, axis=1) >= 0).all()


def test_large_networks_sort() -> None:
    rng = np.random.default_rng(8)
    for radius in (2, 3, 5, 15):
        rows = rng.random((50, (2 * radius + 1) ** 2))
        for low, high in sorting_network(rows.shape[1]):
            rows[:, [low, high]] = np.sort(rows[:, [low, high]], axis=1)
        assert (np.diff(rows, axis=1) >= 0).all()


def test_bad_arguments_are_refused() -> None:
    values, guide = maps(np.random.default_rng(9), (6, 7))
    wrong: list[tuple[str, dict[str, Any]]] = [
        ("radius: found 0", {"radius": 0}),
        ("radius: found 16", {"radius": 16}),
        ("sigma_colour: found 0", {"sigma_colour": 0}),
        ("sigma_space: found nan", {"sigma_space": float("nan")}),
        ("weight: found shape", {"weight": np.ones((7, 6))}),
        ("weight: found shape", {"weight": np.full((6, 7), 1.1)}),
        ("guide: found shape", {"guide": guide[:, :-1]}),
        ("disparity: found NaN", {"disparity": np.full((6, 7), np.nan)}),
        ("disparity: found shape", {"disparity": values[0]}),
    ]
    for message, options in wrong:
        with pytest.raises(LightFieldError, match=message):
            weighted_median(**{"disparity": values, "guide": guide, **options})
