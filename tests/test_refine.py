"""Refinement between planes: against the oracle, its laws, no bias between samples, and what it gains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import fields
import naive_refine
from lfdepth import scenes
from lfdepth.blocks import refine
from lfdepth.blocks.refine import RefineRule, gather_evidence, outer_views, refine_disparity
from lfdepth.engines import engine
from lfdepth.engines.cpu.kernels.refine import PAD
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.scenes import rendering
from lfdepth.scenes.model import Plane, Scene
from lfdepth.scenes.suite import Stage

Array = fields.Array

SMALL = RefineRule(radius=4, wide_radius=6, wide_spacing=3, high_pass=0.8, rim_radius=4)


def rough(lf: LightField, seed: int, spread: float = 0.02) -> Array:
    """The truth of `fields.scene`, a little off."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: lf.height, : lf.width]
    inside = (abs(x - 0.45 * lf.width) < 0.2 * lf.width) & (abs(y - 0.5 * lf.height) < 0.25 * lf.height)
    return np.asarray(np.where(inside, 0.8, -0.6) + rng.normal(0, spread, inside.shape), np.float32)


CASES = [
    fields.scene(1, (3, 3), (18, 21)),
    fields.scene(2, (4, 5), (16, 19), 1, "uint16"),
    fields.scene(3, (3, 4), (17, 16), 3, "float32", absent=True),
    fields.scene(4, (1, 9), (14, 23)),
]
NAMES = ["colour", "grey-uint16-even-grid", "float-absent", "row-of-views"]


@pytest.mark.parametrize("lf", CASES, ids=NAMES)
def test_splines_pass_through_the_samples(lf: LightField) -> None:
    """Weights 1/6, 4/6, 1/6 of the coefficients give the luma back; the oracle solves for them."""
    with engine() as started:
        views = started.spline_views(lf, outer_views(lf))
    assert np.array_equal(views.chosen, naive_refine.outer(lf.available))
    for place, data in zip(views.at, views.data, strict=True):
        grey = naive_refine.grey(lf.views[tuple(place)])
        down = (data[:-2] + 4 * data[1:-1] + data[2:]) / 6
        back = (down[:, :-2] + 4 * down[:, 1:-1] + down[:, 2:]) / 6
        np.testing.assert_allclose(back[PAD - 1 : 1 - PAD, PAD - 1 : 1 - PAD], grey, atol=2e-3)
        np.testing.assert_allclose(data[PAD:-PAD, PAD:-PAD], naive_refine.coefficients(grey), atol=5e-3)


@pytest.mark.parametrize("lf", CASES, ids=NAMES)
def test_evidence_agrees_with_the_oracle(lf: LightField) -> None:
    disparity = rough(lf, 5)
    with engine() as started:
        found = gather_evidence(lf, disparity, SMALL, started)
    step, weight, trusted = naive_refine.evidence(lf.views, disparity, SMALL, lf.available)
    assert np.count_nonzero(step) > 0.3 * step.size or lf.shape[:2] == (3, 4)
    # A view that rounding hides or shows changes the sums of its pixel, and their means around it.
    alike = abs(found.weight - weight) <= 0.01 * weight + 0.01
    assert alike.mean() > 0.97
    np.testing.assert_allclose(found.step[alike], step[alike], atol=1e-3)
    np.testing.assert_allclose(found.trusted[alike], trusted[alike], rtol=0.02, atol=0.02)


@pytest.mark.parametrize("lf", CASES, ids=NAMES)
def test_engines_agree(lf: LightField) -> None:
    disparity = rough(lf, 15)
    with engine() as fast, engine("numpy") as plain:
        found, expected = (gather_evidence(lf, disparity, SMALL, each) for each in (fast, plain))
        alike = abs(found.weight - expected.weight) <= 0.01 * expected.weight + 0.01
        assert alike.mean() > 0.97
        np.testing.assert_allclose(found.step[alike], expected.step[alike], atol=1e-3)
        np.testing.assert_allclose(found.trusted[alike], expected.trusted[alike], rtol=0.02, atol=0.02)
        maps = [refine_disparity(lf, disparity, SMALL, engine=each) for each in (fast, plain)]
    assert np.mean(abs(maps[0] - maps[1]) > 5e-4) < 0.03


@pytest.mark.parametrize("rounds", [1, 2])
@pytest.mark.parametrize("lf", CASES, ids=NAMES)
def test_refined_maps_agree_with_the_oracle(lf: LightField, rounds: int) -> None:
    disparity, rule = rough(lf, 6), replace(SMALL, rounds=rounds)
    found = refine_disparity(lf, disparity, rule)
    expected = naive_refine.refined(lf.views, disparity, rule, lf.available)
    assert np.mean(abs(found - expected) > 5e-4) < 0.03
    assert abs(found - disparity).max() > 0.005


def mirror(views: Array) -> Array:
    return np.ascontiguousarray(views[:, ::-1, :, ::-1])


def transpose(views: Array) -> Array:
    return np.ascontiguousarray(views.transpose(1, 0, 3, 2, 4))


@pytest.mark.parametrize(
    ("turn", "back"),
    [(mirror, lambda image: image[:, ::-1]), (transpose, lambda image: image.T)],
    ids=["mirror", "transpose"],
)
def test_turned_views_turn_the_map(turn: Callable[[Array], Array], back: Callable[[Array], Array]) -> None:
    lf = fields.scene(7, (5, 5), (52, 60))
    disparity = rough(lf, 8)
    turned = refine_disparity(LightField(turn(lf.views)), np.ascontiguousarray(back(disparity)))
    assert np.mean(abs(back(turned) - refine_disparity(lf, disparity)) > 0.01) < 0.002


@pytest.mark.parametrize("pixels", [-2, 1])
def test_moving_the_views_moves_the_map(pixels: int) -> None:
    lf = fields.scene(9, (5, 5), (64, 66))
    moved = np.empty_like(lf.views)
    for i, j in np.ndindex(5, 5):
        moved[i, j] = np.roll(lf.views[i, j], (-pixels * (i - 2), -pixels * (j - 2)), (0, 1))
    disparity = rough(lf, 10)
    found = refine_disparity(LightField(moved), disparity + np.float32(pixels)) - pixels
    inner = (slice(16, -16), slice(16, -16))
    assert np.mean(abs(found - refine_disparity(lf, disparity))[inner] > 0.01) < 0.005


def test_threads_change_nothing() -> None:
    lf = fields.scene(11, (5, 5), (47, 41))
    disparity = rough(lf, 12)
    one = refine_disparity(lf, disparity)
    for threads in (2, 3):
        with engine(threads=threads) as started:
            np.testing.assert_array_equal(refine_disparity(lf, disparity, engine=started), one)


def test_without_texture_the_map_stays() -> None:
    views = np.full((5, 5, 30, 34, 3), 90, np.uint8)
    disparity = np.full((30, 34), 0.4, np.float32)
    np.testing.assert_array_equal(refine_disparity(LightField(views), disparity), disparity)


def test_a_change_that_the_views_deny_is_refused() -> None:
    """Planes cannot follow a curved surface that the views show; where they leave it, the map stays."""
    rng = np.random.default_rng(13)
    size = (70, 74)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    truth = np.asarray(0.045 * np.sin(x / 2.6) * np.sin(y / 2.6), np.float32)
    paint = fields.texture(rng, shortest=2.6, longest=8)
    views = np.empty((5, 5, *size, 3))
    for i, j in np.ndindex(5, 5):
        at_x, at_y = x.copy(), y.copy()
        for _ in range(20):  # the reference pixel that this view shows here
            d = 0.045 * np.sin(at_x / 2.6) * np.sin(at_y / 2.6)
            at_x, at_y = x + (j - 2) * d, y + (i - 2) * d
        views[i, j] = paint(at_x, at_y)[..., None]
    lf = LightField(fields.quantise(views, "uint8"))
    free = RefineRule(refusal=1e9)
    inner = (slice(12, -12), slice(12, -12))
    kept = abs(refine_disparity(lf, truth) - truth)[inner]
    changed = abs(refine_disparity(lf, truth, free) - truth)[inner]
    assert changed.mean() > 1.2 * kept.mean()
    assert np.mean(kept == 0) > 0.05


# No bias between samples


def wall(surface: Callable[[int], Plane], size: int = 112, seed: int = 0) -> LightField:
    """A textured wall before nine by nine cameras."""
    stage = Stage(size, size, seed)
    scene = Scene([stage.wall(surface(size), stage.natural("haze", "slate", "sand", "ivory"))])
    return rendering.render(scene, "wall", (size, size), (9, 9), seed, 0.0, 3).lf


@pytest.mark.thin(3)
@pytest.mark.parametrize("part", range(16))
def test_no_sixteenth_of_a_pixel_is_biased(part: int) -> None:
    disparity = -2 + part / 16
    lf = wall(lambda size: Plane(disparity), size=88)
    error = (estimate(lf, "fbs-vis").disparity - disparity)[15:-15, 15:-15]
    assert abs(np.median(error)) < 0.002
    assert np.median(abs(error)) < 0.004


def test_no_part_of_a_slanted_wall_is_biased() -> None:
    lf = wall(lambda size: Plane(-0.5, 1.3 / size, 0.9 / size), size=160, seed=1)
    assert lf.truth is not None
    error = (estimate(lf, "fbs-vis").disparity - lf.truth)[15:-15, 15:-15]
    sixteenth = np.floor(lf.truth[15:-15, 15:-15] * 16 + 0.5).astype(int) % 16
    for part in range(16):
        assert abs(np.median(error[sixteenth == part])) < 0.002, part


# What it gains


@pytest.mark.thin(2)
@pytest.mark.parametrize(("name", "fine", "finest"), [("demo", 0.5, 0.8), ("noise-1", 0.75, 0.55)])
def test_maps_become_more_precise(name: str, fine: float, finest: float) -> None:
    """Shares of pixels off by more than 0.03 and 0.01 px fall; those off by more than 0.07 px do not grow."""
    lf = scenes.render(name, size=256)
    assert lf.truth is not None
    before, after = (
        abs(estimate(lf, "fbs-vis", effort=effort).disparity - lf.truth)[15:-15, 15:-15]
        for effort in ("fast", "normal")
    )
    assert np.mean(after > 0.07) <= 1.03 * np.mean(before > 0.07)
    assert np.mean(after > 0.03) < fine * np.mean(before > 0.03)
    assert np.mean(after > 0.01) < finest * np.mean(before > 0.01)


def test_a_second_round_refines_further() -> None:
    """What `effort="best"` is for; docs/fbs-vis.md says by how much over all scenes."""
    lf = scenes.render("noise-2", size=128)
    assert lf.truth is not None
    once, twice = (
        abs(estimate(lf, "fbs-vis", effort=effort, check=False).disparity - lf.truth)[15:-15, 15:-15]
        for effort in ("normal", "best")
    )
    assert np.mean(twice > 0.03) < 0.95 * np.mean(once > 0.03)


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", ["fence", "noise-2", "range-4"])
def test_two_thirds_of_the_errors_lie_within_sigma(name: str) -> None:
    """Errors under 0.07 px, against the standard error; and pixels told to be exact are more exact."""
    lf = scenes.render(name, size=192, seed=5)
    result = estimate(lf, "fbs-vis", check=False)
    assert lf.truth is not None
    assert result.sigma is not None
    error, sigma = (each[15:-15, 15:-15] for each in (abs(result.disparity - lf.truth), result.sigma))
    error, sigma = error[error <= 0.07], sigma[error <= 0.07]
    assert abs(np.mean(error < sigma) - 0.68) < 0.1
    surer = sigma < np.median(sigma)
    assert np.median(error[surer]) < 0.7 * np.median(error[~surer])


def test_rims_lie_on_the_planes_of_their_surfaces() -> None:
    """A rim that is 0.1 px off, beside a jump between two slanted planes, goes back to its own plane."""
    y, x = np.mgrid[:40, :48].astype(np.float32)
    truth = np.where(x < 24, 0.6 + 0.01 * x, -0.5 - 0.005 * y).astype(np.float32)
    blurred = truth.copy()
    blurred[:, 23] -= 0.1
    blurred[:, 24] += 0.1
    lf = LightField(np.full((3, 3, 40, 48, 1), 128, np.uint8))
    with engine() as started:
        guide = lf.reference.astype(np.float32) / np.float32(255)
        found = refine._draw_rims(blurred, guide, RefineRule(), started)
    assert abs(found - truth)[2:-2, 2:-2].max() < 0.003


def test_bad_maps_are_rejected() -> None:
    lf = fields.scene(14, size=(20, 22))
    with pytest.raises(LightFieldError, match=r"disparity: found shape \(20, 21\), expected \(20, 22\)"):
        refine_disparity(lf, np.zeros((20, 21), np.float32))
    with pytest.raises(LightFieldError, match="not finite"):
        refine_disparity(lf, np.full((20, 22), np.nan, np.float32))


def test_the_outer_views_hold_most_of_the_information() -> None:
    """The docstring's figures for 9 × 9 views."""
    lf = LightField(np.zeros((9, 9, 8, 8, 1), np.uint8))
    chosen = outer_views(lf)
    squares = (lf.offsets**2).sum(axis=2)
    assert np.count_nonzero(chosen) == 57
    assert squares[chosen].sum() / squares.sum() > 0.9
    assert np.count_nonzero(chosen) > refine._FEWEST_VIEWS
