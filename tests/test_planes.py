"""Disparity planes against the oracle and the definition."""

import numpy as np
import pytest

import naive
from lfdepth.blocks.planes import MAX_PLANES, disparity_planes
from lfdepth.errors import LightFieldError

RANGES = [
    ((-1.4, 1.4), 0.02),
    ((-2.0, 2.0), 0.05),
    ((-0.3, 1.0), 0.07),
    ((0.1, 0.7), 0.1),
    ((-5.25, -3.0), 0.3),
    ((0.0, 0.05), 0.2),
    ((-1e-3, 1e-3), 1e-4),
]


@pytest.mark.parametrize(("ends", "step"), RANGES)
def test_planes_agree_with_the_oracle(ends: tuple[float, float], step: float) -> None:
    found = disparity_planes(ends, step=step)
    np.testing.assert_allclose(found, naive.planes(ends, step), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("ends", "step"), RANGES)
def test_planes_run_from_near_to_far_and_cover_the_range(ends: tuple[float, float], step: float) -> None:
    found = disparity_planes(ends, step=step)
    assert found[0] == ends[1]
    assert ends[0] - step < found[-1] <= ends[0] + 1e-9
    np.testing.assert_allclose(np.diff(found), -step, atol=1e-12)


@pytest.mark.parametrize(("ends", "count"), [((-1.0, 2.0), 2), ((-1.4, 1.4), 141), ((0.3, 0.4), 7)])
def test_a_number_of_planes_is_spread_over_the_range(ends: tuple[float, float], count: int) -> None:
    np.testing.assert_allclose(disparity_planes(ends, count=count), np.linspace(ends[1], ends[0], count))


def test_a_whole_number_of_steps_ends_on_the_range() -> None:
    """Rounding of range / step adds no plane: the paper's synthetic set has 2.8 / 0.02 + 1 planes."""
    assert len(disparity_planes((-1.4, 1.4), step=0.02)) == 141
    assert len(disparity_planes((0.1, 0.4), step=0.1)) == 4


def test_a_step_wider_than_the_range_gives_two_planes() -> None:
    np.testing.assert_allclose(disparity_planes((0.0, 0.1), step=1.0), [0.1, -0.9])


@pytest.mark.parametrize(
    ("ends", "options", "named"),
    [
        ((1.0, -1.0), {"step": 0.1}, "range"),
        ((0.5, 0.5), {"step": 0.1}, "range"),
        ((np.nan, 1.0), {"step": 0.1}, "range"),
        ((-np.inf, 1.0), {"step": 0.1}, "range"),
        ((0.0, 1.0), {"step": 0.0}, "step"),
        ((0.0, 1.0), {"step": -0.1}, "step"),
        ((0.0, 1.0), {"step": np.nan}, "step"),
        ((0.0, 1.0), {"step": np.inf}, "step"),
        ((0.0, 1.0), {"count": 1}, "planes"),
        ((0.0, 1.0), {"count": 0}, "planes"),
        ((0.0, 1.0), {"count": -3}, "planes"),
        ((0.0, 1.0), {}, "planes"),
        ((0.0, 1.0), {"step": 0.1, "count": 3}, "planes"),
        ((0.0, 1.0), {"step": 1e-5}, "step"),
    ],
)
def test_senseless_planes_are_refused_in_one_line(
    ends: tuple[float, float], options: dict[str, float], named: str
) -> None:
    with pytest.raises(LightFieldError) as error:
        disparity_planes(ends, **options)  # type: ignore[arg-type]
    message = str(error.value)
    assert message.startswith(named)
    assert "expected" in message
    assert "\n" not in message


def test_force_allows_many_planes() -> None:
    assert len(disparity_planes((0.0, 1.0), step=1 / (MAX_PLANES + 4), force=True)) == MAX_PLANES + 5
