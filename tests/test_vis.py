"""The default method end to end: against the oracle, its laws, what it gains, what its confidence says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fields
import naive
import naive_vis
from against_truth import Scene, check_confidence
from fields import RANGE, scene
from lfdepth import scenes
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods.fbs_vis import FbsVis

Array = fields.Array

OPTIONS: dict[str, Any] = {"step": 0.13, "radius": 2, "epsilon": 1e-3, "fit_radius": 4}
DECODED: dict[str, Any] = {**OPTIONS, "effort": "fast", "edge_net": False}


# Against the oracle


def agree(lf: LightField, chosen: FbsVis) -> naive_vis.Decoded:
    """Check an estimate against the oracle's, which is returned.

    No pixel differs where this was written. Conventions (rounding of levels, shifts, shares and energies) are
    the oracle's own; what may differ is what single precision leaves open: an exponential's last digit that
    makes a whole penalty one smaller, or two colours as near to a pixel's own. Two pixels in a thousand may.
    """
    found, expected = estimate(lf, chosen), naive_vis.estimate(lf.views, RANGE, chosen, lf.present)
    assert np.mean(np.abs(found.disparity - expected.disparity) > 1e-3) <= 0.002
    assert np.mean(np.abs(found.confidence - expected.confidence) > 1e-3) <= 0.002
    return expected


@pytest.mark.thin(3)
@pytest.mark.parametrize(
    ("lf", "options"),
    [
        (scene(1, (3, 3), (20, 33)), {}),
        (scene(2, (4, 3), (22, 21), 1, "uint16"), {"guide": "grey", "photo_radius": 3}),
        (scene(3, (3, 4), (18, 24), 3, "float32", absent=True), {"edge_passes": 0}),
        (scene(4, (1, 5), (17, 32)), {"normalise": False, "photo_weight": 0.7}),
        (scene(5, (3, 3), (16, 31)), {"step": 0.9, "edge_passes": 1}),
        (scene(6, (9, 9), (12, 16), 1), {"step": 0.3}),
        (scene(7, (7, 8), (13, 14)), {"step": 0.25, "fit_radius": 0}),
    ],
    ids=["colour", "grey-uint16", "float-absent", "row-of-views", "few-planes", "thinned", "unfitted"],
)
def test_the_method_agrees_with_the_oracle(lf: LightField, options: dict[str, Any]) -> None:
    agree(lf, FbsVis(**{**DECODED, **options}))


@pytest.mark.thin(2)
@pytest.mark.parametrize(("grid", "dtype"), [((5, 5), "uint8"), ((3, 5), "float32")])
def test_gloss_agrees_with_the_oracle(grid: tuple[int, int], dtype: str) -> None:
    """Where it decides much of the picture."""
    views = fields.quantise(fields.glossy_plane(np.random.default_rng(3), grid, (18, 36)), dtype)
    lf, chosen = (
        LightField(views, disparity_range=RANGE),
        FbsVis(**{**DECODED, "step": 0.25}),
    )
    with_it = agree(lf, chosen)
    without = estimate(lf, replace(chosen, gloss=False))
    assert np.mean(np.abs(with_it.disparity - without.disparity) > 0.05) > 0.1


# Laws


def test_threads_change_no_estimate() -> None:
    lf = scene(6, (4, 5), (80, 41))
    one = estimate(lf, "fbs-vis", threads=1)
    for threads in (2, 3, 5):
        many = estimate(lf, "fbs-vis", threads=threads)
        np.testing.assert_array_equal(many.disparity, one.disparity)
        np.testing.assert_array_equal(many.confidence, one.confidence)


@pytest.mark.parametrize("seed", [7, 8])
def test_transposing_the_views_transposes_the_estimate(seed: int) -> None:
    lf = scene(seed, size=(50, 57))
    turned = LightField(np.ascontiguousarray(lf.views.transpose(1, 0, 3, 2, 4)), disparity_range=RANGE)
    found, expected = estimate(turned, "fbs-vis"), estimate(lf, "fbs-vis")
    assert np.mean(np.abs(found.disparity - expected.disparity.T) > 0.02) < 0.03
    assert np.mean(np.abs(found.confidence - expected.confidence.T) > 0.02) < 0.03


@pytest.mark.parametrize("pixels", [-2, 1])
def test_moving_the_views_moves_the_estimate(pixels: int) -> None:
    lf = scene(9, size=(72, 76))
    moved = np.empty_like(lf.views)
    for i, j in np.ndindex(5, 5):
        moved[i, j] = np.roll(lf.views[i, j], (-pixels * (i - 2), -pixels * (j - 2)), (0, 1))
    found = estimate(LightField(moved), "fbs-vis", range=(RANGE[0] + pixels, RANGE[1] + pixels))
    inner = (slice(18, -18), slice(18, -18))
    apart = np.abs(found.disparity - pixels - estimate(lf, "fbs-vis").disparity)[inner]
    assert np.mean(apart > 0.02) < 0.02


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("value", [0.0, 0.3, 1.0])
def test_a_scene_without_texture_gets_no_confidence(value: float, dtype: str) -> None:
    views = fields.quantise(np.full((5, 5, 30, 34, 3), value), dtype)
    result = estimate(LightField(views, disparity_range=RANGE), "fbs-vis")
    assert result.confidence.max() == 0
    assert np.unique(result.disparity).size == 1


def test_noise_gets_hardly_any_confidence() -> None:
    views = np.rint(128 + np.random.default_rng(10).normal(0, 3, (9, 9, 50, 54, 3))).astype(np.uint8)
    textured = estimate(scene(10, (9, 9), (50, 54)), "fbs-vis").confidence
    noise = estimate(LightField(views, disparity_range=RANGE), "fbs-vis").confidence
    assert np.quantile(noise, 0.95) < 0.2 * np.median(textured)


@pytest.mark.parametrize("disparity", [-0.83, 0.0, 0.61])
def test_a_scene_of_one_plane_gives_that_plane(disparity: float) -> None:
    paint = fields.texture(np.random.default_rng(11))
    views = np.stack([fields.plane_views(paint, disparity, (7, 7), (48, 52))] * 3, axis=-1)
    result = estimate(LightField(fields.quantise(views, "uint8"), disparity_range=RANGE), "fbs-vis")
    inner = (slice(6, -6), slice(6, -6))
    error = np.abs(result.disparity - disparity)[inner]
    assert np.median(error) < 0.01
    assert np.mean(error > 0.07) < 0.01
    assert np.median(result.confidence[inner]) > 0.4


def test_progress_counts_both_passes() -> None:
    """And what follows either: a map, gloss, a decision, edges, refinement, the network."""
    seen: list[tuple[int, int, str]] = []
    lf = scene(12, size=(40, 44))
    estimate(lf, "fbs-vis", progress=lambda *step: seen.append(step), **OPTIONS)
    planes = len(naive.planes(RANGE, OPTIONS["step"]))
    after = ["gloss", "decision", "edges", "refinement", "edge net"]
    steps = ["plane"] * planes + ["first map"] + ["second count"] * planes + after
    assert seen == [(k + 1, len(steps), what) for k, what in enumerate(steps)]


def test_the_light_field_is_left_alone() -> None:
    lf = scene(13, size=(40, 44))
    before = lf.views.copy()
    estimate(lf, "fbs-vis", **OPTIONS)
    np.testing.assert_array_equal(lf.views, before)


@pytest.mark.slow  # kernels are compiled anew for such views
@pytest.mark.parametrize("name", ["fbsocc-sfa", "fbs-vis"])
def test_views_that_cannot_be_written_give_the_same(name: str) -> None:
    lf = scene(13, size=(40, 44))
    expected = estimate(lf, name, **OPTIONS).disparity
    lf.views.setflags(write=False)
    np.testing.assert_array_equal(estimate(lf, name, **OPTIONS).disparity, expected)


@pytest.mark.parametrize("planes", [2, 3, 5, 6])
def test_few_planes_are_enough_to_run(planes: int) -> None:
    result = estimate(scene(14, size=(40, 44)), "fbs-vis", planes=planes)
    assert np.isfinite(result.disparity).all()
    assert RANGE[0] <= result.disparity.min() <= result.disparity.max() <= np.float32(RANGE[1])


# On scenes with truth


@pytest.fixture(scope="module", params=["demo", "bars"])
def rendered(request: pytest.FixtureRequest) -> Scene:
    return Scene(scenes.render(request.param, size=128, views=9, seed=0))


def test_fewer_bad_pixels_than_the_paper_near_occlusions(rendered: Scene) -> None:
    boundary = rendered.lf.masks["occlusion_boundary"]
    assert rendered.badpix("fbs-vis", boundary) < 2 / 3 * rendered.badpix("fbsocc-sfa", boundary)


def test_a_third_fewer_bad_pixels_and_no_larger_error(rendered: Scene) -> None:
    assert rendered.badpix("fbs-vis") < 2 / 3 * rendered.badpix("fbsocc-sfa")
    assert rendered.mse("fbs-vis") <= rendered.mse("fbsocc-sfa")


def test_two_textured_layers_part_at_their_edge() -> None:
    views, truth = fields.two_planes(np.random.default_rng(15), (7, 7), (80, 90))
    colours = fields.quantise(np.stack([views, views**0.7, views**1.6], axis=-1), "uint8")
    layers = Scene(LightField(colours, disparity_range=RANGE, truth=truth.astype(np.float32)))
    jump = np.abs(truth - np.roll(truth, 1, 0)) + np.abs(truth - np.roll(truth, 1, 1)) > 0
    near = np.max([np.roll(jump, (y, x), (0, 1)) for y in range(-4, 5) for x in range(-4, 5)], axis=0)
    assert layers.badpix("fbs-vis", near) < 2 / 3 * layers.badpix("fbsocc-sfa", near)


def test_confidence_sorts_the_pixels(rendered: Scene) -> None:
    check_confidence(rendered, "fbs-vis")
