"""Decoders against the oracle: every profile (K,) is decided as the paper's step of least error."""

from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

import naive
from lfdepth.blocks.decode import Accumulate, SignStep, accumulate, decided, sign_step
from lfdepth.blocks.planes import disparity_planes
from lfdepth.engines import engine

PLANES = disparity_planes((-1.0, 1.5), step=0.125)


def random_volume(
    seed: int, count: int = len(PLANES), size: tuple[int, int] = (37, 41)
) -> NDArray[np.float32]:
    """Noisy steps in [−1, 1] that turn anywhere or nowhere; odd multiples of 1/512, which add exactly."""
    rng = np.random.default_rng(seed)
    turn = rng.integers(-3, count + 3, size)
    slope = rng.choice([0.2, 1.0, 5.0], size)
    profile = np.tanh((np.arange(count)[:, None, None] - turn) * slope) + rng.normal(0, 0.4, (count, *size))
    profile[:, :4] = rng.uniform(-1, 1, (count, 4, size[1]))  # pure noise
    odd = 2 * np.rint(np.clip(profile, -1, 1) * 255) + 1
    return np.asarray(np.clip(odd, -511, 511) / 512, np.float32)


@pytest.mark.parametrize("subplane", [False, True])
@pytest.mark.parametrize("seed", [1, 2])
def test_sign_step_agrees_with_the_oracle(seed: int, subplane: bool) -> None:
    volume = random_volume(seed)
    found = sign_step(volume, PLANES, subplane=subplane)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, naive.sign_step(volume, PLANES, subplane), atol=1e-5)


@pytest.mark.parametrize("seed", [3, 4])
def test_accumulation_agrees_with_the_oracle(seed: int) -> None:
    volume = random_volume(seed)
    found = accumulate(volume, PLANES)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, naive.accumulate(volume, PLANES), atol=1e-5)


@pytest.mark.parametrize("decoder", [Accumulate, SignStep])
def test_confidence_agrees_with_the_oracle(decoder: type[Accumulate] | type[SignStep]) -> None:
    volume = random_volume(5)
    found = run(decoder(PLANES, volume.shape[1:]), volume).confidence()
    np.testing.assert_allclose(found, naive.confidence(volume), atol=1e-5)


Streaming = TypeVar("Streaming", bound=SignStep | Accumulate)


def run(decoder: Streaming, volume: NDArray[np.float32]) -> Streaming:
    for index, smoothed in enumerate(volume):
        decoder.update(index, smoothed)
    return decoder


def test_the_running_sum_finds_the_step_of_least_error() -> None:
    """The identity behind the streaming decoder: for |C̃| ≤ 1, L1 errors and running sums have one minimum."""
    volume = random_volume(6, size=(9, 11))
    for y, x in np.ndindex(9, 11):
        profile = volume[:, y, x].astype(np.float64)
        errors, sums = naive.step_errors(profile), naive.running_sums(profile)
        np.testing.assert_allclose(errors, len(profile) + 2 * sums - profile.sum(), atol=1e-9)


def ideal_volume(disparity: NDArray[np.float64], slope: float) -> NDArray[np.float32]:
    return np.clip((disparity - PLANES[:, None, None]) / slope, -1, 1).astype(np.float32)


def test_ideal_profiles_give_their_disparity() -> None:
    """Truth: a profile that rises linearly through zero at D is decoded as D, between planes too."""
    disparity = np.linspace(PLANES[-1] + 0.201, PLANES[0] - 0.202, 143).reshape(11, 13)  # none on a plane
    volume = ideal_volume(disparity, slope=0.3)
    step = PLANES[0] - PLANES[1]
    assert np.abs(sign_step(volume, PLANES) - disparity).max() < 1e-5
    assert np.abs(sign_step(volume, PLANES, subplane=False) - disparity).max() <= step / 2 + 1e-6
    assert np.abs(accumulate(volume, PLANES) - disparity).max() <= step / 2 + 1e-6


@pytest.mark.parametrize("turn", [1, 7, len(PLANES) - 1])
def test_perfect_steps(turn: int) -> None:
    volume = np.where(np.arange(len(PLANES)) < turn, -1, 1)[:, None, None] * np.ones((2, 3), np.float32)
    middle = (PLANES[turn - 1] + PLANES[turn]) / 2
    for disparity in (
        sign_step(volume, PLANES),
        sign_step(volume, PLANES, subplane=False),
        accumulate(volume, PLANES),
    ):
        np.testing.assert_allclose(disparity, middle, atol=1e-6)
    for kind in (SignStep, Accumulate):
        np.testing.assert_allclose(run(kind(PLANES, (2, 3)), volume).confidence(), 1)


def test_a_surface_beyond_the_planes_gets_their_end() -> None:
    front, behind = np.ones((len(PLANES), 2, 2), np.float32), -np.ones((len(PLANES), 2, 2), np.float32)
    for decode in (accumulate, sign_step):
        np.testing.assert_allclose(decode(front, PLANES), PLANES[0])
        np.testing.assert_allclose(decode(behind, PLANES), PLANES[-1])


def test_no_evidence_gives_a_disparity_in_range_without_confidence() -> None:
    nothing = np.zeros((len(PLANES), 3, 4), np.float32)
    for decoder in (SignStep(PLANES, (3, 4)), Accumulate(PLANES, (3, 4))):
        run(decoder, nothing)
        assert (decoder.confidence() == 0).all()
        assert ((decoder.disparity() >= PLANES[-1]) & (decoder.disparity() <= PLANES[0])).all()


def test_a_profile_that_is_zero_on_a_plane_crosses_there() -> None:
    """−1, 0, +1 is symmetric about the middle plane, and so must its disparity be."""
    profile = np.ones(len(PLANES), np.float32)
    profile[:6], profile[6] = -1, 0
    volume = np.broadcast_to(profile[:, None, None], (len(PLANES), 2, 3))
    np.testing.assert_allclose(sign_step(volume, PLANES), PLANES[6], atol=1e-6)


def test_of_equal_steps_the_nearest_is_taken() -> None:
    """The first minimum front to back: −, +, −, + with equal dips."""
    profile = np.ones(len(PLANES), np.float32)
    profile[:3], profile[3:5], profile[5:7] = -0.5, 0.5, -0.5
    volume = np.broadcast_to(profile[:, None, None], (len(PLANES), 2, 3))
    np.testing.assert_allclose(sign_step(volume, PLANES), (PLANES[2] + PLANES[3]) / 2, atol=1e-6)


def test_threads_change_nothing() -> None:
    volume = random_volume(7, size=(130, 20))
    for decoder in (Accumulate, SignStep):
        one = run(decoder(PLANES, (130, 20)), volume)
        for threads in (2, 3, 5):
            with engine(threads=threads) as used:
                many = run(decoder(PLANES, (130, 20), engine=used), volume)
            np.testing.assert_array_equal(many.disparity(), one.disparity())
            np.testing.assert_array_equal(many.confidence(), one.confidence())


def test_decided_profiles_are_one_step() -> None:
    disparity = np.random.default_rng(8).uniform(-1.2, 1.7, (5, 6)).astype(np.float32)
    profiles = decided(disparity, PLANES)
    assert set(np.unique(profiles)) <= {-1.0, 1.0}
    expected = np.array([np.where(disparity > plane, 1, -1) for plane in PLANES])
    np.testing.assert_array_equal(profiles, expected)


def test_a_forced_number_of_planes_does_not_overflow() -> None:
    """With `force` there may be more planes than 16 bits count."""
    planes = disparity_planes((0.0, 1.0), count=40_000, force=True)
    volume = np.where(np.arange(len(planes)) < 35_000, -1, 1).astype(np.float32)[:, None, None]
    expected = (planes[34_999] + planes[35_000]) / 2
    np.testing.assert_allclose(sign_step(volume, planes), expected, atol=1e-4)
    np.testing.assert_allclose(
        accumulate(-volume, planes), planes[-1] + 34_999.5 * (planes[0] - planes[1]), atol=1e-4
    )
