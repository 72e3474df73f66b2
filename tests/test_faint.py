"""What signs say of faint surfaces: against the oracle, on energies that are known, and on a plain ball."""

from __future__ import annotations

import numpy as np
import pytest

import fields
import naive_faint
from lfdepth.blocks.faint import ask_signs, partly_hidden
from lfdepth.engines import engine
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField

Array = fields.Array

PLANES: fields.Array = 1.4 - 0.07 * np.arange(41)


def layers(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """A box before a slanted wall, with a little noise."""
    y, x = np.mgrid[: size[0], : size[1]]
    box = (abs(x - 0.6 * size[1]) < 5) & (abs(y - 0.4 * size[0]) < 4)
    return np.asarray(np.where(box, 0.6, -0.5 + 0.01 * x) + rng.normal(0, 0.01, size), np.float32)


def test_agrees_with_the_oracle() -> None:
    rng, size = np.random.default_rng(1), (34, 42)
    disparity = layers(rng, size)
    noise = 0.02 * np.cumsum(rng.normal(0, 0.3, (len(PLANES), *size)), axis=0)
    energies = 0.1 * (PLANES[:, None, None] - disparity - rng.normal(0, 0.2, size)) ** 2 + noise
    signs, photo = energies.astype(np.float32), rng.uniform(0, 1.2, size).astype(np.float32)
    expected = naive_faint.asked(signs, PLANES, disparity, photo, 2.0)
    assert 0.2 < np.mean(expected[1] > 0) < 0.8
    for name in ("cpu", "numpy"):
        with engine(name) as used:
            found = ask_signs(signs, PLANES, disparity, photo, 2.0, engine=used)
        np.testing.assert_allclose(found[0], expected[0], atol=1e-4)
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-3, atol=0.02)


@pytest.mark.parametrize("off", [-0.25, -0.02, 0.03, 0.2])
def test_parabolas_are_found_wherever_they_lie_between_planes(off: float) -> None:
    """Energies a·(D − D₀)², a = 0.05: the step is D₀ − D, the information half of all."""
    disparity = np.tile(np.linspace(-0.5, 0.5, 60, dtype=np.float32), (20, 1))
    signs = (0.05 * (PLANES[:, None, None] - disparity - off) ** 2).astype(np.float32)
    step, information = ask_signs(signs, PLANES, disparity, np.zeros_like(disparity), 4.0)
    np.testing.assert_allclose(step, off, atol=1e-3)
    np.testing.assert_allclose(information, 250, rtol=1e-2)


def test_nothing_is_asked_where_colours_tell_or_planes_are_few() -> None:
    disparity = np.zeros((12, 14), np.float32)
    signs = ((PLANES[:, None, None] - disparity - 0.1) ** 2).astype(np.float32)
    assert not np.any(ask_signs(signs, PLANES, disparity, np.ones_like(disparity), 4.0))
    assert not np.any(ask_signs(signs[:8], PLANES[:8], disparity, np.zeros_like(disparity), 4.0))
    level = np.ones_like(signs)
    assert not np.any(ask_signs(level, PLANES, disparity, np.zeros_like(disparity), 4.0))


@pytest.mark.parametrize("reach", [1.0, 4.0])
def test_what_a_nearer_surface_hides(reach: float) -> None:
    """A box 1.5 px nearer is noticed less than reach·1.5 + 7 px beside it, and itself hidden nowhere."""
    disparity = np.zeros((60, 70), np.float32)
    disparity[25:35, 30:40] = 1.5
    y, x = np.mgrid[:60, :70]
    away = np.maximum(np.maximum(25 - y, y - 34), np.maximum(30 - x, x - 39))
    hidden = partly_hidden(disparity, reach)
    np.testing.assert_array_equal(hidden, (away > 0) & (away < reach * 1.5 + 7))
    rough = layers(np.random.default_rng(2), (30, 36))
    np.testing.assert_array_equal(partly_hidden(rough, reach), naive_faint.hidden(rough, reach))


def ball(noise: float, size: int = 96) -> LightField:
    """A plain ball, from dark to bright, before a textured wall; disparity falls with the radius squared."""
    rng = np.random.default_rng(3)
    wall, middle, radius = fields.texture(rng), size / 2 - 0.5, 0.3 * size
    y, x = np.mgrid[:size, :size].astype(float)
    views = np.empty((9, 9, size, size))

    def inside(at_x: Array, at_y: Array) -> Array:
        return ((at_x - middle) ** 2 + (at_y - middle) ** 2) / radius**2

    for v, u in np.ndindex(9, 9):
        own_x, own_y = x, y
        for _ in range(8):  # where the ball's point at this pixel of the view lies in the reference view
            nearer = 0.6 * (1 - np.minimum(inside(own_x, own_y), 1.0)) - 0.1
            own_x, own_y = x + (u - 4) * nearer, y + (v - 4) * nearer
        shade = 0.5 + 0.15 * (own_x - middle + 0.7 * (own_y - middle)) / radius
        behind = wall(x - 0.8 * (u - 4), y - 0.8 * (v - 4))
        views[v, u] = np.where(inside(own_x, own_y) < 1, shade, behind)
    noisy = np.rint(255 * views + rng.normal(0, noise, views.shape)).clip(0, 255).astype(np.uint8)
    share = inside(x, y)
    truth = np.where(share < 1, 0.6 * (1 - share) - 0.1, -0.8).astype(np.float32)
    return LightField(noisy[..., None], truth=truth, disparity_range=(-0.9, 0.7))


def bad(disparity: Array, truth: Array) -> float:
    """Share of the ball, but for its rim, that is off by more than 0.07 px."""
    return float(np.mean(abs(disparity - truth)[truth > 0] > 0.07))


@pytest.mark.parametrize(("noise", "most"), [(2.0, 0.01), (4.0, 0.45)])
def test_a_plain_ball_is_round(noise: float, most: float) -> None:
    """Fewer bad pixels than with the paper's own method, and than half of those without the signs' say."""
    lf = ball(noise)
    assert lf.truth is not None
    found = bad(estimate(lf, "fbs-vis").disparity, lf.truth)
    assert found < most
    assert found < bad(estimate(lf, "fbs-sfa").disparity, lf.truth)
    assert found < 0.5 * bad(estimate(lf, "fbs-vis", faint=False).disparity, lf.truth)
