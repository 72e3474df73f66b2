"""The guided filter against the oracle, OpenCV and what the paper of the filter says of it."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fields
import naive
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines import engine
from lfdepth.engines.boxes import box_mean
from lfdepth.errors import LightFieldError

# Size and radius: windows as large as the image, whose sizes have all digits to base 4 (window sums are put
# together from runs of 1, 4, 16 …), columns around vector lengths.
CASES = [
    ((9, 11), 1),
    ((9, 9), 4),
    ((33, 20), 3),
    ((40, 65), 4),
    ((70, 31), 7),
    ((97, 34), 16),
    ((17, 64), 8),
    ((56, 70), 27),
]


def guide_of(rng: np.random.Generator, size: tuple[int, int], channels: int) -> NDArray[np.float32]:
    """A picture with edges, texture and a flat part, in [0, 1]."""
    lf = fields.light_field(rng, (3, 3), size, channels, "float32")
    guide = lf.reference.copy()
    guide[: size[0] // 3, : size[1] // 3] = 0.5
    return guide


def votes_of(rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.float32]:
    """Something like a slice of votes: two sides of an edge, noise, and an area without evidence."""
    votes = np.where(fields.random_mask(rng, size), 0.8, -0.7) + rng.normal(0, 0.3, size)
    votes[size[0] // 2 :, size[1] // 2 :] = 0
    return np.clip(votes, -1, 1).astype(np.float32)


@pytest.mark.parametrize(("size", "radius"), CASES)
def test_box_means_agree_with_the_oracle(size: tuple[int, int], radius: int) -> None:
    image = np.random.default_rng(1).normal(size=size)
    np.testing.assert_allclose(box_mean(image, radius), naive.box_mean(image, radius), atol=1e-12)


@pytest.mark.thin(5)
@pytest.mark.parametrize(("size", "radius"), CASES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("epsilon", "tolerance"), [(1e-2, 4e-7), (1e-4, 4e-6), (2e-6, 1.25e-4)])
def test_the_filter_agrees_with_the_oracle(
    size: tuple[int, int], radius: int, channels: int, epsilon: float, tolerance: float
) -> None:
    """Single against double precision; the smaller ε, the closer to singular the windows' systems.

    The last is fbs-vis's own: shares of views are kept in 1/255, thirty times as coarse as that.
    """
    rng = np.random.default_rng([2, *size, channels])
    guide, votes = guide_of(rng, size, channels), votes_of(rng, size)
    found = GuidedFilter(guide, radius, epsilon)(votes)
    assert found.dtype == np.float32
    np.testing.assert_allclose(
        found, naive.GuidedFilter(guide, radius, epsilon)(votes), rtol=0, atol=tolerance
    )


def test_the_oracles_windows_are_cut_at_the_border() -> None:
    """The oracle's fast means are those of its value-by-value ones."""
    image = np.random.default_rng(3).normal(size=(9, 13))
    oracle = naive.GuidedFilter(image[..., None], 4, 1.0)
    np.testing.assert_allclose(oracle.mean[..., 0], naive.box_mean(image, 4), atol=1e-12)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("epsilon", [1e-3, 1e-4])
def test_the_filter_agrees_with_opencv_inside(channels: int, epsilon: float) -> None:
    """OpenCV reflects at the border, and clamps determinants of guides in [0, 1]: ours goes to 255."""
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "ximgproc"):
        pytest.skip("this OpenCV has no ximgproc")
    rng = np.random.default_rng(4)
    guide, votes = guide_of(rng, (60, 72), channels), votes_of(rng, (60, 72))
    radius = 4
    scaled = np.squeeze(guide * np.float32(255))
    expected = cv2.ximgproc.guidedFilter(scaled, votes, radius, epsilon * 255**2)
    inner = (slice(2 * radius, -2 * radius),) * 2
    np.testing.assert_allclose(GuidedFilter(guide, radius, epsilon)(votes)[inner], expected[inner], atol=2e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_one_filter_smooths_many_slices(channels: int) -> None:
    """Nothing of one slice is left over in the next."""
    rng = np.random.default_rng(5)
    guide = guide_of(rng, (40, 45), channels)
    shared = GuidedFilter(guide, 4, 1e-4)
    for _ in range(3):
        votes = votes_of(rng, (40, 45))
        np.testing.assert_array_equal(shared(votes), GuidedFilter(guide, 4, 1e-4)(votes))


@pytest.mark.parametrize("channels", [1, 3])
def test_a_constant_stays(channels: int) -> None:
    guide = guide_of(np.random.default_rng(6), (50, 40), channels)
    for value in (-1.0, 0.0, 0.3, 1.0):
        found = GuidedFilter(guide, 5, 1e-4)(np.full((50, 40), value))
        np.testing.assert_allclose(found, value, atol=1e-4)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_linear_function_of_the_guide_stays(channels: int) -> None:
    """With ε → 0 the filter is exact for slices that the guide explains: edges survive."""
    guide = guide_of(np.random.default_rng(7), (50, 40), channels)
    slopes = np.array([0.5, -0.8, 0.4][:channels])
    image = guide @ slopes + 0.1
    np.testing.assert_allclose(GuidedFilter(guide, 3, 1e-6)(image), image, atol=0.02)


@pytest.mark.parametrize("channels", [1, 3])
def test_without_guide_contrast_the_filter_is_a_box_twice(channels: int) -> None:
    image = np.random.default_rng(8).normal(size=(40, 33)).astype(np.float32)
    flat = np.full((40, 33, channels), 0.4, np.float32)
    expected = naive.box_mean(naive.box_mean(image, 3), 3)
    np.testing.assert_allclose(GuidedFilter(flat, 3, 1e-2)(image), expected, atol=1e-4)


@pytest.mark.parametrize("channels", [1, 3])
def test_normalised_smoothing_agrees_with_the_oracle(channels: int) -> None:
    rng = np.random.default_rng(12)
    guide, votes = guide_of(rng, (40, 45), channels), votes_of(rng, (40, 45))
    evidence = np.where(fields.random_mask(rng, (40, 45)), rng.random((40, 45)), 0).astype(np.float32)
    evidence[:20, :20] = 0
    votes *= evidence
    found = np.empty_like(votes)
    GuidedFilter(guide, 3, 1e-3).smooth_quotient(votes, evidence, found)
    weight = naive.GuidedFilter(guide, 3, 1e-3)(evidence)
    expected = naive.normalised(naive.GuidedFilter(guide, 3, 1e-3), votes, evidence)
    # An error of 1e-6 in the numerator grows as the denominator falls.
    assert (np.abs(found - expected) < 1e-5 / np.maximum(weight, 1e-3)).all()
    assert np.abs(found).max() <= 1


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("radius", [1, 4, 7])
def test_nothing_is_left_behind_by_what_went_through(channels: int, radius: int) -> None:
    """Beyond the reach of its windows an empty area stays exactly empty, on all sides of a strong one."""
    rng = np.random.default_rng(13)
    votes = np.zeros((80, 90))
    votes[30:45, 30:50] = rng.normal(0, 1, (15, 20))
    smooth = GuidedFilter(guide_of(rng, votes.shape, channels), radius, 1e-6)
    found, reach = smooth(votes), 2 * radius
    found[30 - reach : 45 + reach, 30 - reach : 50 + reach] = 0
    assert (found == 0).all()


def test_an_edge_of_the_guide_stays_sharp() -> None:
    guide = np.zeros((30, 40, 1), np.float32)
    guide[:, 20:] = 1
    rng = np.random.default_rng(9)
    votes = np.where(guide[..., 0] > 0, 1.0, -1.0) * (rng.random((30, 40)) < 0.7)
    found = GuidedFilter(guide, 4, 1e-4)(votes)
    assert (found[:, 20:] > 0.4).all()
    assert (found[:, :20] < -0.4).all()


@pytest.mark.parametrize("threads", [2, 3, 5, None])
@pytest.mark.parametrize("channels", [1, 3])
def test_threads_change_nothing(threads: int | None, channels: int) -> None:
    rng = np.random.default_rng(10)
    guide, votes = guide_of(rng, (130, 50), channels), votes_of(rng, (130, 50))
    with engine(threads=threads) as used:
        found = GuidedFilter(guide, 6, 1e-4, engine=used)(votes)
    np.testing.assert_array_equal(found, GuidedFilter(guide, 6, 1e-4)(votes))


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int8, np.bool_])
def test_any_numeric_slice_is_taken(dtype: Any) -> None:
    rng = np.random.default_rng(11)
    guide, image = guide_of(rng, (20, 30), 3), (rng.random((30, 20)) > 0.5).astype(dtype).T
    expected = naive.GuidedFilter(guide, 4, 1e-3)(image)
    np.testing.assert_allclose(GuidedFilter(guide, 4, 1e-3)(image), expected, atol=1e-4)


@pytest.mark.parametrize(
    ("shape", "radius", "epsilon", "named"),
    [
        ((20, 20), 4, 1e-4, "guide"),
        ((20, 20, 2), 4, 1e-4, "guide"),
        ((20, 20, 3), 0, 1e-4, "radius"),
        ((20, 20, 3), -2, 1e-4, "radius"),
        ((20, 8, 3), 4, 1e-4, "radius"),
        ((8, 20, 1), 4, 1e-4, "radius"),
        ((20, 20, 3), 4, 0.0, "epsilon"),
        ((20, 20, 3), 4, -1e-4, "epsilon"),
        ((20, 20, 3), 4, float("nan"), "epsilon"),
    ],
)
def test_bad_filters_are_refused(shape: tuple[int, ...], radius: int, epsilon: float, named: str) -> None:
    with pytest.raises(LightFieldError, match=f"^{named}: found"):
        GuidedFilter(np.zeros(shape, np.float32), radius, epsilon)


def test_a_slice_of_another_size_is_refused() -> None:
    with pytest.raises(LightFieldError, match=r"^image: found shape \(20, 21\)"):
        GuidedFilter(np.zeros((20, 20, 1), np.float32), 4, 1e-4)(np.zeros((20, 21)))
