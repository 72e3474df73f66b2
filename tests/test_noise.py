"""The residual level and the weight of texture against the oracle, and against noise of known strength."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import fields
import naive_vis
from lfdepth.blocks import noise
from lfdepth.blocks.noise import ramp, residual, texture_weight, threshold_bounds
from lfdepth.engines import single
from lfdepth.lightfield import LightField

Array = fields.Array

PLANES = np.arange(1.2, -1.1, -0.13)


def weights(lf: LightField) -> Array:
    """The weight of texture over the light field's own noise."""
    return texture_weight(lf, residual(lf, PLANES).level)


def test_the_ramp() -> None:
    found = ramp(np.array([-1.0, 0.2, 0.3, 0.4, 7.0]), 0.2, 0.4)
    np.testing.assert_allclose(found, [0, 0, 0.5, 1, 1], atol=1e-6)
    assert found.dtype == np.float32


@pytest.mark.thin(5)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("grid", [(3, 3), (4, 6), (1, 5), (7, 1)])
def test_the_level_agrees_with_the_oracle(grid: tuple[int, int], channels: int, dtype: str) -> None:
    rng = np.random.default_rng([*grid, channels, len(dtype)])
    present = fields.random_present(rng, grid) if dtype == "uint8" else None
    size = (int(rng.integers(6, 14)), int(rng.integers(8, 34)))
    lf = fields.light_field(rng, grid, size, channels, dtype, present=present)
    expected, noise = naive_vis.residual(lf.views, PLANES, present)
    assert residual(lf, PLANES) == pytest.approx((expected, noise), rel=1e-4)
    weight = naive_vis.texture_weight(lf.views, expected, present)
    np.testing.assert_allclose(texture_weight(lf, expected), weight, atol=1e-3)


def test_residuals_agree_with_the_oracle_pixel_by_pixel() -> None:
    rng = np.random.default_rng(1)
    lf = fields.light_field(rng, (5, 4), (12, 15), 3, kind="noise")
    places = [(0, 0), (11, 14), (5, 7), (0, 14), (6, 3)]
    rows, columns = np.array(places).T
    least = single().residuals(single().views(lf), rows, columns, PLANES)
    expected = naive_vis.residuals(lf.views, PLANES, places, None)
    np.testing.assert_allclose(least / 255, expected, rtol=1e-5)


def test_fewer_pixels_are_looked_at_on_large_views() -> None:
    """A level from every third pixel is about that from all."""
    rng = np.random.default_rng(2)
    lf = fields.light_field(rng, (3, 3), (60, 66), 1)
    every = residual(lf, PLANES, samples=60 * 66).level
    some = residual(lf, PLANES, samples=60 * 66 // 9).level
    assert some == pytest.approx(every, rel=0.5)
    places = [(y, x) for y in range(1, 60, 3) for x in range(1, 66, 3)]
    found = naive_vis.residuals(lf.views, PLANES[::2], places, None)
    assert some == pytest.approx(float(np.quantile(found, naive_vis.RESIDUAL_QUANTILE)), rel=1e-4)


@pytest.mark.parametrize("sigma", [1.0, 3.0, 8.0])
def test_the_level_is_that_of_the_noise(sigma: float) -> None:
    """Truth: an even wall and normal noise. Without interpolation two views differ by 2σ/√π on average.

    Interpolation halves the other view's noise at most, and a low quantile takes a pixel that is nearly
    even itself at best: √(2/π)·σ/2.
    """
    rng = np.random.default_rng(3)
    views = np.rint(128 + rng.normal(0, sigma, (9, 9, 40, 40, 3))).astype(np.uint8)
    level = 255 * residual(LightField(views), PLANES).level
    assert np.sqrt(2 / np.pi) * sigma / 2 < level < 2 * sigma / np.sqrt(np.pi)


@pytest.mark.parametrize(
    ("noise", "bounds"),
    [(0.0, (0.003, 0.02)), (0.006, (0.003, 0.02)), (0.012, (0.009, 0.02)), (0.05, (0.047, 0.047))],
)
def test_thresholds_rise_by_what_noise_exceeds(noise: float, bounds: tuple[float, float]) -> None:
    assert threshold_bounds(noise) == pytest.approx(bounds)


def test_thresholds_of_the_noisiest_views_stay_thresholds() -> None:
    assert threshold_bounds(0.8) == pytest.approx((0.1, 0.1))


def test_an_exact_scene_has_no_residual() -> None:
    paint = fields.texture(np.random.default_rng(4), shortest=25.0, longest=60.0)
    views = fields.plane_views(paint, 0.4, (5, 5), (30, 34))
    exact = LightField(fields.quantise(views[..., None], "uint16"))
    assert residual(exact, np.array([1.0, 0.7, 0.4, 0.1, -0.2])).level < 0.001


@pytest.mark.parametrize("grid", [(3, 3), (5, 5), (9, 9), (1, 9)])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("sigma", [1.0, 4.0, 12.0])
def test_noise_alone_weighs_little(sigma: float, channels: int, grid: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    views = np.rint(128 + rng.normal(0, sigma, (*grid, 40, 44, channels))).astype(np.uint8)
    assert weights(LightField(views)).mean() < 0.3


@pytest.mark.parametrize("sigma", [0.0, 1.0, 3.0])
def test_texture_above_the_noise_weighs_in_full(sigma: float) -> None:
    """A wall half textured, half even: by windows, so not at the seam."""
    rng = np.random.default_rng(6)
    paint = fields.texture(rng, shortest=4.0, longest=8.0)
    views = 255 * fields.plane_views(paint, 0.4, (7, 7), (60, 44))
    views[:, :, 30:] = 128
    noisy = np.clip(np.stack([views] * 3, axis=-1) + rng.normal(0, sigma, (7, 7, 60, 44, 3)), 0, 255)
    weight = weights(LightField(np.rint(noisy).astype(np.uint8)))
    reach = noise._WINDOW + 4
    assert weight[: 30 - reach].mean() > 0.95
    if sigma > 0:
        assert weight[30 + reach :].mean() < 0.3


def test_views_that_never_overlap_leave_a_level() -> None:
    """Planes so far from zero that no other view holds any pixel: finite, whatever it is."""
    lf = fields.light_field(np.random.default_rng(9), (3, 3), (20, 24), 3)
    assert np.isfinite(residual(lf, np.arange(30.0, 28.0, -0.5)).level)


def test_more_noise_never_adds_weight() -> None:
    rng = np.random.default_rng(7)
    grey, _ = fields.two_planes(rng, (5, 5), (40, 44))
    unit = rng.normal(0, 1, (5, 5, 40, 44, 3))
    means = []
    for sigma in (0.5, 2.0, 6.0, 15.0, 40.0):
        noisy = np.clip(128 + 40 * (grey[..., None] - 0.5) + sigma * unit, 0, 255)
        means.append(weights(LightField(np.rint(noisy).astype(np.uint8))).mean())
    assert all(after <= before + 0.02 for before, after in pairwise(means)), means
    assert means[0] - means[-1] > 0.3, means


def test_transposing_the_views_transposes_the_weight() -> None:
    rng = np.random.default_rng(8)
    lf = fields.light_field(rng, (5, 4), (26, 27), 3)  # every pixel is looked at
    turned = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)))
    assert residual(turned, PLANES).level == pytest.approx(residual(lf, PLANES).level, rel=1e-5)
    np.testing.assert_allclose(weights(turned), weights(lf).T, atol=1e-3)


def test_a_higher_level_never_adds_weight() -> None:
    lf = fields.light_field(np.random.default_rng(10), (3, 3), (30, 34), 3)
    levels = [texture_weight(lf, level) for level in (0.0, 0.005, 0.02, 0.1, 1.0)]
    assert all((after <= before).all() for before, after in pairwise(levels))
    assert levels[0].mean() > 0.9
    assert levels[-1].max() == 0
