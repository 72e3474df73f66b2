"""Planes fitted to the pixels' own energies: against the oracle, worked out by hand, laws, and truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

import fields
import naive_vis
from lfdepth.blocks import surface
from lfdepth.blocks.surface import SPACING, fit_surfaces
from lfdepth.engines import engine
from lfdepth.engines.cpu.kernels.surface import _REACH
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods import method

Array = fields.Array

PLANES = 14
FINE = 0.02  # step so fine that the pull to the paths' position hardly counts


@dataclass
class Case:
    """What a fit is made from; energies are the sign energies alone unless photo-consistency is given."""

    position: Array
    signs: Array
    guide: Array
    shares: Array
    weight: Array
    step: float = FINE
    radius: int = 8

    def fitted(self, threads: int = 1) -> Array:
        energy = (self.signs.astype(np.float32), self.shares, self.weight.astype(np.float32))
        position, guide = self.position.astype(np.float32), self.guide.astype(np.float32)
        with engine(threads=threads) as used:
            return fit_surfaces(position, energy, guide, self.step, self.radius, engine=used)

    def expected(self) -> Array:
        energy = self.signs.astype(np.float64) - self.weight * (self.shares / 255)
        return naive_vis.fit_surfaces(
            self.position, np.moveaxis(energy, 0, -1), self.guide, self.step, self.radius
        )


def case(
    position: Array, minimum: Array, sharpness: Array | float = 5.0, guide: Array | None = None, **rest: float
) -> Case:
    """Energies that are parabolas over planes."""
    k = np.arange(PLANES)[:, None, None]
    signs = sharpness * (k - minimum) ** 2
    guide = np.zeros((*position.shape, 1)) if guide is None else guide
    none = np.zeros((PLANES, *position.shape), np.uint8)
    made = Case(position.astype(np.float32), signs, guide, none, np.zeros(position.shape))
    made.step, made.radius = rest.get("step", FINE), int(rest.get("radius", 8))
    return made


def ramp(size: tuple[int, int], across: float, down: float, middle: float = 6.0) -> Array:
    y, x = np.mgrid[: size[0], : size[1]]
    return np.asarray(middle + across * (x - size[1] / 2) + down * (y - size[0] / 2))


def gate(step: float) -> float:
    """Planes beyond which another surface begins."""
    return max(surface._GATE / step, naive_vis.FEWEST_PLANES_SLOPE)


# Against the oracle


def random_case(rng: np.random.Generator, size: tuple[int, int], channels: int, step: float) -> Case:
    """Two surfaces, ends of the range, energies with and without a minimum, a guide of two colours."""
    near = fields.random_mask(rng, size)
    position = np.where(near, 9, 3) + rng.normal(0, 0.7, size)
    position = np.where(rng.random(size) < 0.1, rng.choice([0, PLANES - 1], size), position)
    made = case(position, position + rng.normal(0, 0.5, size), rng.uniform(-0.02, 0.1, size), step=step)
    made.signs = made.signs + rng.normal(0, 0.03, made.signs.shape)
    made.shares = rng.integers(0, 256, made.signs.shape).astype(np.uint8)
    made.weight = rng.uniform(0, 0.3, size) * (rng.random(size) < 0.7)
    grain = rng.uniform(0, 0.1, (*size, channels))
    made.guide = (0.3 * near[..., None] + grain).astype(np.float32)
    return made


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("step", [0.03, 0.07, 0.3])
@pytest.mark.parametrize(
    ("size", "radius"), [((9, 14), 8), ((17, 33), 4), ((1, 31), 6), ((32, 1), 2), ((3, 2), 8), ((5, 6), 50)]
)
def test_fits_agree_with_the_oracle(size: tuple[int, int], radius: int, step: float, channels: int) -> None:
    made = random_case(np.random.default_rng([*size, radius, channels]), size, channels, step)
    made.radius = radius
    np.testing.assert_allclose(made.fitted(), made.expected(), atol=1e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_threads_change_nothing(channels: int) -> None:
    made = random_case(np.random.default_rng(1), (41, 37), channels, 0.07)
    one = made.fitted()
    for threads in (2, 3, 5, 41):
        np.testing.assert_array_equal(made.fitted(threads), one)


# By hand: a picture of one pixel has its own minimum alone


def one_pixel(energies: list[float], position: float, step: float = 0.07) -> float:
    made = case(np.full((1, 1), position), np.zeros((1, 1)), step=step)
    made.signs = np.array(energies)[:, None, None]
    made.shares = np.zeros(made.signs.shape, np.uint8)
    return float(made.fitted()[0, 0])


@pytest.mark.parametrize("position", [1.6, 2.0, 2.4])
def test_a_minimum_is_drawn_to_the_paths_position_by_the_prior(position: float) -> None:
    """Energies 0.2·(k − 2.3)² + 1 at planes 1, 2, 3: curvature 0.2, minimum 2.3."""
    prior = surface._PRIOR * 0.07**2
    energies = [9.0, *(0.2 * (k - 2.3) ** 2 + 1 for k in (1, 2, 3)), -4.0]
    expected = (0.2 * 2.3 + prior * position) / (0.2 + prior)
    assert one_pixel(energies, position) == pytest.approx(expected, abs=1e-5)


def test_a_minimum_far_away_is_not_followed_to_its_end() -> None:
    """0.1·(k − 9)²: seen from plane 2 the minimum is 7 planes away."""
    energies = [0.1 * (k - 9.0) ** 2 for k in range(6)]
    prior = surface._PRIOR * 0.07**2
    expected = (0.1 * (2 + float(_REACH)) + prior * 2) / (0.1 + prior)
    assert one_pixel(energies, 2.0) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("energies", "position"),
    [
        ([0.7] * 6, 2.3),  # flat
        ([1.0, 0.8, 0.6, 0.4, 0.2, 0.0], 2.3),  # falling
        ([0.0, 1.0, 1.5, 1.0, 0.0, 0.0], 2.3),  # a maximum
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 0.0),  # the first plane
        ([5.0, 4.0, 3.0, 2.0, 1.0, 0.0], 5.0),  # the last
        ([1.0, 0.0, 1.0, 1.0, 1.0, 1.0], 0.4),  # beside the first
    ],
    ids=["flat", "falling", "maximum", "first", "last", "beside-the-first"],
)
def test_without_a_minimum_the_paths_position_stays(energies: list[float], position: float) -> None:
    assert one_pixel(energies, position) == pytest.approx(position, abs=1e-6)


def test_photo_consistency_has_its_part_in_the_energy() -> None:
    """Flat sign energies, shares 100, 200, 150 at planes 1, 2, 3 with weight 0.5."""
    made = case(np.full((1, 1), 2.0), np.zeros((1, 1)), 0.0)
    made.shares[1:4, 0, 0], made.weight[:] = [100, 200, 150], 0.5
    curvature, prior = 0.5 / 255 * 75, surface._PRIOR * FINE**2
    vertex = 2 + (150 - 100) / (2 * (100 + 50))
    expected = (curvature * vertex + prior * 2) / (curvature + prior)
    assert made.fitted()[0, 0] == pytest.approx(expected, abs=1e-5)


# Truth


@pytest.mark.parametrize(("across", "down"), [(0.0, 0.0), (0.2, 0.0), (0.0, -0.15), (-0.11, 0.17)])
@pytest.mark.parametrize("radius", [2, 8])
def test_a_slanted_plane_is_found_from_whole_planes(across: float, down: float, radius: int) -> None:
    """The paths say the nearest plane, the pixels' energies where between planes the surface is."""
    truth = ramp((23, 26), across, down)
    found = case(np.rint(truth), truth, radius=radius).fitted()
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_noise_is_averaged_over_a_slanted_plane() -> None:
    rng = np.random.default_rng(2)
    truth = ramp((40, 40), 0.06, -0.08)
    minimum = truth + rng.normal(0, 0.2, truth.shape)
    spread = [
        float(np.sqrt(np.mean((case(np.rint(truth), minimum, radius=r).fitted() - truth) ** 2)))
        for r in (2, 4, 8, 12)
    ]
    assert all(wide < narrow for narrow, wide in pairwise([0.2, *spread])), spread
    assert spread[2] < 0.2 / 3


@pytest.mark.parametrize("step", [0.02, 0.07, 0.3])
def test_a_step_larger_than_the_gate_is_not_averaged_across(step: float) -> None:
    """Both sides as though they were alone; a step within the gate is bridged."""
    left = np.broadcast_to(np.arange(24) < 11, (18, 24))

    def fitted(height: float) -> tuple[Array, Array]:
        truth = np.where(left, 2.3, 2.3 + height)
        return case(truth, truth, step=step).fitted(), truth

    found, truth = fitted(gate(step) + 0.1)
    np.testing.assert_allclose(found, truth, atol=1e-4)
    found, truth = fitted(gate(step) - 0.1)
    assert np.abs(found - truth)[:, 9:13].min() > 0.05


def test_a_step_of_colour_is_not_averaged_across() -> None:
    left = np.broadcast_to(np.arange(24) < 11, (18, 24))
    truth = np.where(left, 5.0, 6.4)
    guide = np.where(left, 0.2, 0.2 + 8 / surface._SHARPNESS)[..., None]
    np.testing.assert_allclose(case(np.rint(truth), truth, guide=guide).fitted(), truth, atol=1e-3)
    assert np.abs(case(np.rint(truth), truth).fitted() - truth)[:, 9:13].min() > 0.05


@pytest.mark.parametrize("slope", [0.002, 0.004])
def test_a_slow_change_of_colour_keeps_a_plane(slope: float) -> None:
    truth = ramp((20, 24), 0.15, 0.1)
    guide = np.repeat(ramp((20, 24), slope, -slope, 0.5)[..., None], 3, axis=2)
    np.testing.assert_allclose(case(np.rint(truth), truth, guide=guide).fitted(), truth, atol=1e-3)


@pytest.mark.parametrize("step", [0.02, 0.07, 0.3])
@pytest.mark.parametrize("position", [0.0, 3.25, PLANES - 1.0])
def test_an_area_without_energies_keeps_the_paths_position(position: float, step: float) -> None:
    made = case(np.full((20, 21), position), np.zeros((20, 21)), 0.0, step=step)
    np.testing.assert_allclose(made.fitted(), position, atol=1e-6)
    # A slanted one too, but for what the pull to level planes does beside the border.
    slanted = ramp((30, 31), 0.02, -0.03)
    found = case(slanted, slanted, 0.0, step=step).fitted()
    np.testing.assert_allclose(found[8:-8, 8:-8], slanted[8:-8, 8:-8], atol=1e-4)
    np.testing.assert_allclose(found, slanted, atol=0.02)


def test_a_pixel_alone_keeps_its_position() -> None:
    truth = np.full((17, 18), 3.0)
    truth[8, 9] = 3 + 1.1 * gate(FINE)
    found = case(truth, truth).fitted()
    np.testing.assert_allclose(found, truth, atol=1e-5)


def test_the_sharper_minimum_decides() -> None:
    """Half of the pixels know 5.2, the others fifty times less surely 5.6."""
    sure = np.random.default_rng(3).random((20, 20)) < 0.5
    made = case(np.full((20, 20), 5.0), np.where(sure, 5.2, 5.6), np.where(sure, 5.0, 0.1))
    assert np.abs(made.fitted() - 5.2).max() < 0.1


# Laws


def test_transposing_or_mirroring_the_picture_does_so_to_the_fit() -> None:
    made = random_case(np.random.default_rng(4), (22, 27), 3, 0.07)
    whole = made.fitted()
    turns: list[Callable[[Array], Array]] = [
        lambda a: np.swapaxes(a, 0, 1),
        lambda a: a[::-1],
        lambda a: a[:, ::-1],
    ]
    for turn in turns:
        planes = [np.ascontiguousarray(turn(np.moveaxis(a, 0, -1))) for a in (made.signs, made.shares)]
        signs, shares = (np.ascontiguousarray(np.moveaxis(a, -1, 0)) for a in planes)
        position, guide, weight = (
            np.ascontiguousarray(turn(a)) for a in (made.position, made.guide, made.weight)
        )
        turned = Case(position, signs, guide, shares, weight, made.step, made.radius).fitted()
        np.testing.assert_allclose(turned, turn(whole), atol=1e-4)


def test_a_plane_more_in_front_moves_the_fit_by_a_plane() -> None:
    truth = ramp((18, 22), 0.1, 0.1) + np.random.default_rng(5).normal(0, 0.2, (18, 22))
    here, there = case(np.rint(truth), truth), case(np.rint(truth) + 1, truth + 1)
    np.testing.assert_allclose(there.fitted(), here.fitted() + 1, atol=1e-3)


def test_what_is_given_is_left_alone() -> None:
    made = random_case(np.random.default_rng(6), (12, 13), 3, 0.07)
    before = made.position.copy()
    made.position.setflags(write=False)
    made.shares.setflags(write=False)
    made.fitted()
    np.testing.assert_array_equal(made.position, before)


# In the method


def slanted_field(seed: int) -> tuple[LightField, Array]:
    """A textured plane whose disparity grows to the right, seen exactly by every view; and its disparity.

    D(x) = a + b·x of the reference view's point x appears at x − u·D(x), so view u shows (x + a·u)/(1 − b·u).
    """
    rng = np.random.default_rng(seed)
    paint, a, b = fields.texture(rng, shortest=5.0, longest=12.0), -0.5, 1.0 / 50
    x, y = np.meshgrid(np.arange(50.0), np.arange(46.0))
    views = np.empty((7, 7, 46, 50))
    for i, j in np.ndindex(7, 7):
        at_x = (x + a * (j - 3)) / (1 - b * (j - 3))
        views[i, j] = paint(at_x, y + (i - 3) * (a + b * at_x))
    noisy = views[..., None] + rng.normal(0, 0.01, (7, 7, 46, 50, 3))
    lf = LightField(fields.quantise(np.clip(noisy, 0, 1), "uint8"), disparity_range=(-0.9, 0.9))
    return lf, a + b * x


@pytest.mark.parametrize("seed", [7, 8])
def test_fits_bring_a_slanted_plane_closer_to_the_truth(seed: int) -> None:
    lf, truth = slanted_field(seed)
    inner = (slice(6, -6), slice(6, -6))
    without, fitted = (
        np.abs(estimate(lf, "fbs-vis", fit_radius=radius).disparity - truth)[inner] for radius in (0, 8)
    )
    assert fitted.mean() < 0.9 * without.mean(), (fitted.mean(), without.mean())
    assert np.median(fitted) < 0.2 * 0.07


@pytest.mark.parametrize("radius", [-2, 3, 51, 52])
def test_senseless_radii_are_refused(radius: int) -> None:
    with pytest.raises(LightFieldError, match=f"fit_radius: found {radius}, expected"):
        method("fbs-vis", fit_radius=radius)


def test_every_radius_allowed_takes_the_pixel_itself() -> None:
    for radius in (2, method("fbs-vis").parameters()["fit_radius"], 50):
        assert 0 in range(-radius, radius + 1, SPACING)
