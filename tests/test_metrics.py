"""Metrics against hand-worked values, an independent implementation, and the laws they follow."""

import os
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

import lfdepth
import naive_metrics as naive
from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity
from lfdepth.lightfield import LightField
from lfdepth.scoring import HighResolution, evaluate, metrics, read_high_resolution
from lfdepth.scoring.metrics import HIGH, LOW
from lfdepth.scoring.scores import LOW_INSTEAD, METRICS

Array = NDArray[Any]
COTTON = Path(__file__).parents[2] / "shared" / "data" / "hci4d" / "cotton"
HEIGHT, WIDTH = 48, 52


def camera(height: int = HEIGHT, width: int = WIDTH) -> Camera:
    return Camera(
        focal_length_mm=100.0,
        sensor_size_mm=35.0,
        baseline_mm=25.0,
        focus_distance_m=4.25,
        width=width,
        height=height,
    )


def random_case(seed: int, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> tuple[Array, Array, Array]:
    """Truth, a noisy estimate of it with holes, and a mask."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-0.6, 1, shape).astype(np.float32)
    noise = rng.normal(0, 0.05, shape) + (rng.random(shape) < 0.1) * rng.normal(0, 1, shape)
    estimate = (truth + noise).astype(np.float32)
    estimate[rng.random(shape) < 0.02] = np.nan
    return truth, estimate, rng.random(shape) < 0.6


def step_scene(offset: int = 0) -> Array:
    """Foreground at 1 px left of a vertical edge, background at 0 right of it, the edge moved by `offset`."""
    truth = np.zeros((HEIGHT, WIDTH), np.float32)
    truth[:, : WIDTH // 2 + offset] = 1.0
    return truth


def light_field(truth: Array, masks: dict[str, Array] | None = None, name: str = "scene") -> LightField:
    height, width = truth.shape
    views = np.zeros((3, 3, height, width, 1), np.uint8)
    return LightField(views, camera=camera(height, width), truth=truth, masks=masks or {}, name=name)


# --- an independent implementation agrees


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("masked", [False, True])
def test_general_metrics_agree_with_plain_loops(seed: int, masked: bool) -> None:
    truth, estimate, mask = random_case(seed)
    chosen = mask if masked else None
    for threshold in metrics.BADPIX_THRESHOLDS:
        expected = naive.badpix(estimate, truth, threshold, chosen, 15)
        assert metrics.badpix(estimate, truth, threshold, chosen) == pytest.approx(expected, abs=1e-9)
    assert metrics.mse(estimate, truth, chosen) == pytest.approx(naive.mse(estimate, truth, chosen, 15))
    assert metrics.q25(estimate, truth, chosen) == pytest.approx(naive.q25(estimate, truth, chosen, 15))


@pytest.mark.parametrize("seed", range(2))
def test_region_metrics_agree_with_plain_loops(seed: int) -> None:
    truth, estimate, mask = random_case(seed)
    smooth = np.where(np.isfinite(estimate), truth + (estimate - truth) / 50, np.nan)
    for function in ("fine_fattening", "fine_thinning"):
        expected = getattr(naive, function)(estimate, truth, mask, 15)
        assert getattr(metrics, function)(estimate, truth, mask, LOW) == pytest.approx(expected)
    assert metrics.bumpiness(smooth, truth, mask) == pytest.approx(naive.bumpiness(smooth, truth, mask, 15))
    filled = np.clip(np.nan_to_num(estimate), -0.8, None)  # -0.87 is infinitely far
    expected = naive.angle_error(filled, truth, mask, camera(), 15)
    assert metrics.angle_error(filled, truth, mask, camera()) == pytest.approx(expected)


def test_stratified_metrics_agree_with_plain_loops() -> None:
    truth, estimate, mask = random_case(5)
    for function, column in (("backgammon_fattening", 14), ("backgammon_thinning", WIDTH - 2)):
        expected = getattr(naive, function)(estimate, truth, mask, 15, column)
        assert getattr(metrics, function)(estimate, truth, mask, LOW) == pytest.approx(expected)
    rng = np.random.default_rng(5)
    boxes, sizes = rng.integers(0, 4, truth.shape), rng.integers(0, 9, truth.shape)
    loose = truth + rng.normal(0, 0.6, truth.shape)
    assert metrics.missed_dots(loose, truth, boxes, sizes) == pytest.approx(
        naive.missed_dots(loose, truth, boxes, sizes)
    )


def test_high_resolution_agrees_with_plain_loops() -> None:
    _, estimate, _ = random_case(7, (32, 34))
    truth, _, mask = random_case(8, (320, 340))
    large = np.array(naive.enlarge(estimate, 320, 340))
    np.testing.assert_array_equal(metrics.enlarge(estimate, (320, 340)), large)
    expected = naive.badpix(large, truth, 0.07, mask, 150)
    assert metrics.badpix(estimate, truth, 0.07, mask, HIGH) == pytest.approx(expected)
    for function, column in (("backgammon_fattening", 140), ("backgammon_thinning", 340 - 11)):
        expected = getattr(naive, function)(large, truth, mask, 150, column)
        assert getattr(metrics, function)(estimate, truth, mask) == pytest.approx(expected)


def test_benchmark_enlargement_takes_the_index_of_its_formula() -> None:
    wanted = np.floor(np.arange(5120) * 511 / 5119 + 0.5)
    np.testing.assert_array_equal(metrics.enlarge(np.arange(512)[:, None], (5120, 1))[:, 0], wanted)


def test_ause_agrees_with_plain_loops() -> None:
    truth, estimate, _ = random_case(3)
    confidence = np.random.default_rng(3).permutation(truth.size).reshape(truth.shape)
    expected = naive.ause_badpix(estimate, truth, confidence, 0.07, 20, 15)
    assert metrics.ause(estimate, truth, confidence, steps=20) == pytest.approx(expected)


def test_boundaries_agree_with_plain_loops() -> None:
    truth = np.kron(np.random.default_rng(1).uniform(-0.3, 0.3, (4, 4)), np.ones((6, 7)))
    near = metrics.near_boundaries(truth, jump=0.25, distance=2.5)
    assert set(zip(*(axis.tolist() for axis in near.nonzero()), strict=True)) == naive.near_boundaries(
        truth, 0.25, 2.5
    )


# --- hand-worked


def all_masks(truth: Array) -> dict[str, Array]:
    names = {name for metric in METRICS for name in metric.masks}
    foreground = step_scene() > 0
    return {name: np.ones(truth.shape, bool) for name in names} | {
        "foreground_fattening": ~foreground,
        "foreground_thinning": foreground,
    }


def test_a_perfect_map_scores_zero_everywhere() -> None:
    truth = step_scene() + np.linspace(0, 0.3, WIDTH, dtype=np.float32)
    scores = evaluate(truth, light_field(truth, all_masks(truth)), confidence=truth)
    assert {metric.key for metric in METRICS} == set(scores)
    assert {key: value for key, value in scores.items() if value != 0} == {}


@pytest.mark.parametrize(("offset", "bad"), [(0.02, 1), (-0.05, 2), (0.1, 3)])
def test_a_constant_offset(offset: float, bad: int) -> None:
    truth = step_scene()
    scores = evaluate(truth.astype(np.float64) + offset, light_field(truth, all_masks(truth)))
    assert [scores[f"badpix_{t}"] for t in (0.01, 0.03, 0.07)] == [100.0] * bad + [0.0] * (3 - bad)
    assert scores["mse_x100"] == pytest.approx(100 * offset**2)
    assert scores["q25"] == pytest.approx(100 * abs(offset))
    assert scores["bumpiness_planes"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        (0.05, set()),
        (0.1, {"share"}),
        (-0.1, {"share"}),
        (0.2, {"share", "fine_fattening"}),
        (-0.2, {"share", "fine_thinning"}),
        (0.45, {"share", "fine_fattening", "dots_missed"}),
        (-0.45, {"share", "fine_thinning", "dots_missed"}),
        (0.6, {"share", "fine_fattening", "dots_missed", "backgammon_fattening"}),
        (-0.6, {"share", "fine_thinning", "dots_missed", "backgammon_thinning"}),
    ],
)
def test_a_constant_offset_moves_each_regions_metric_past_its_threshold(
    offset: float, expected: set[str]
) -> None:
    truth = step_scene()
    scores = evaluate(truth.astype(np.float64) + offset, light_field(truth, all_masks(truth)))
    shares = {  # BadPix 0.07 in a mask
        *("discontinuities", "stripes_low_texture", "stripes_high_contrast", "stripes_low_contrast"),
        *("badpix_0.07_boundaries", "badpix_0.07_textureless", "badpix_0.07_thin"),
    }
    for key in shares:
        assert scores[key] == (100 if "share" in expected else 0), key
    for key in (
        "fine_fattening",
        "fine_thinning",
        "dots_missed",
        "backgammon_fattening",
        "backgammon_thinning",
    ):
        assert scores[key] == (100 if key in expected else 0), key
    assert scores["dots_background"] == pytest.approx(100 * offset**2)
    for key in ("bumpiness_planes", "bumpiness_continuous", "pyramids_slanted", "pyramids_parallel"):
        assert scores[key] == pytest.approx(0, abs=1e-9), key


@pytest.mark.parametrize("n", [0, 1, 4])
def test_a_dilated_foreground_fattens_at_high_resolution(n: int) -> None:
    low, names = step_scene(), {name for metric in METRICS for name in metric.masks}
    truth = metrics.enlarge(low, (10 * HEIGHT, 10 * WIDTH))
    foreground = truth > 0
    masks: dict[str, Array] = {name: np.ones(truth.shape, bool) for name in names}
    masks |= {"foreground_fattening": ~foreground, "foreground_thinning": foreground, "fine": foreground}
    masks |= {"fine_surrounding": ~foreground, "low_texture": ~foreground}
    lf = light_field(low, all_masks(low))
    scores = evaluate(step_scene(n), lf, high=HighResolution(truth, masks))
    assert not scores.notes
    if n == 0:
        assert {key: value for key, value in scores.items() if value != 0} == {}
    # n columns of the views are n (10 W − 1)/(W − 1) of the truth's, up to rounding at either end.
    wrong, scored = n * (10 * WIDTH - 1) / (WIDTH - 1), 10 * WIDTH - 150 - foreground[0].sum()
    for key in ("backgammon_fattening", "fine_fattening", "stripes_low_texture"):
        assert scores[key] == pytest.approx(100 * wrong / scored, abs=100 / scored)
    assert scores["badpix_0.07"] == pytest.approx(100 * wrong / (10 * WIDTH - 300), abs=100 / scored)
    assert (scores["backgammon_thinning"], scores["fine_thinning"]) == (0, 0)


@pytest.mark.parametrize("n", [1, 3, 6])
def test_a_dilated_foreground_fattens(n: int) -> None:
    truth = step_scene()
    background = truth == 0
    masks = {
        "foreground_fattening": background,
        "foreground_thinning": ~background,
        "discontinuities": background,
    }
    scores = evaluate(step_scene(n), light_field(truth, masks))
    scored = WIDTH - 15 - WIDTH // 2  # columns of background inside the border
    assert scores["backgammon_fattening"] == pytest.approx(100 * n / scored)
    assert scores["backgammon_thinning"] == 0
    assert scores["discontinuities"] == pytest.approx(100 * n / scored)
    # All of it lies within 5 px of the edge (6 columns on either side), save what is dilated further.
    near = min(6, scored) + min(6, WIDTH // 2 - 15)
    assert scores["badpix_0.07_boundaries"] == pytest.approx(100 * n / near)
    eroded = evaluate(step_scene(-n), light_field(truth, masks))
    assert eroded["backgammon_thinning"] == pytest.approx(100 * n / (WIDTH // 2 - 15))
    assert eroded["backgammon_fattening"] == 0


def test_fine_structures_that_vanish_are_thinned_and_swollen_ones_fattened() -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.float32)
    truth[:, 25] = 1.0  # a bar of one column
    swollen, gone = truth.copy(), np.zeros_like(truth)
    swollen[:, 24] = 1.0
    fine = truth > 0
    around = np.zeros_like(fine)
    around[:, [24, 26]] = True
    lf = light_field(truth, {"fine": fine, "fine_surrounding": around})
    scores = evaluate(swollen, lf)
    assert (scores["fine_fattening"], scores["fine_thinning"]) == (50.0, 0.0)
    assert evaluate(gone, lf)["fine_thinning"] == 100.0
    assert evaluate(gone, lf)["fine_fattening"] == 0.0


def test_bumpiness_of_a_quadratic_bowl() -> None:
    # e = x²/1000: the derivative (1, 0, −1) taken twice gives 4 · e'' = 8/1000 in x and nothing else.
    error = np.arange(WIDTH) ** 2 / 1000 * np.ones((HEIGHT, 1))
    everywhere = np.ones((HEIGHT, WIDTH), bool)
    flat = np.zeros((HEIGHT, WIDTH))
    assert metrics.bumpiness(error, flat, everywhere) == pytest.approx(0.8)
    assert metrics.bumpiness(100 * error, flat, everywhere) == pytest.approx(5.0)  # the cap


def test_angle_between_two_planes() -> None:
    # With Z = a + b·x/(W − 1) and h = s/2f, the tangents of (h X Z, h Y Z, Z) give the normal (Z h Z_x …);
    # at a constant depth it points along the optical axis. X is quadratic in x, so the central difference is
    # exact and the angle to a depth that rises across follows.
    cam = camera(64, 64)
    flat = np.full((64, 64), 4.0)
    slope = 1.0
    rising = 4.0 + slope * np.arange(64) / 63 * np.ones((64, 1))
    h = 0.5 * cam.sensor_size_mm / cam.focal_length_mm
    y, x = 32, 32
    u, v, z = x / 63, y / 63, 4.0 + slope * x / 63
    along_x = np.array([h * (z + u * slope), h * v * slope, slope])
    along_y = np.array([0.0, h * z, 0.0])
    normal = np.cross(along_x, along_y)
    expected = np.degrees(np.arccos(normal[2] / np.linalg.norm(normal)))
    only = np.zeros((64, 64), bool)
    only[y, x] = True
    error = metrics.angle_error(cam.depth_to_disparity(rising), cam.depth_to_disparity(flat), only, cam)
    assert error == pytest.approx(expected, rel=1e-3)


def test_missed_dots_counts_a_dot_at_half_its_pixels() -> None:
    truth = np.zeros((40, 40))
    boxes, sizes = np.zeros((40, 40), int), np.zeros((40, 40), int)
    boxes[:20], boxes[20:] = 1, 2
    sizes[2, :4], sizes[6, :4], sizes[22, :4] = 1, 2, 1  # three dots of four pixels, two in the border
    estimate = truth.copy()
    estimate[2, :2] = 0.5  # half of the first is off: not found
    estimate[6, :1] = 0.5
    estimate[22, :4] = 0.4  # exactly at the threshold: found
    assert metrics.missed_dots(estimate, truth, boxes, sizes) == pytest.approx(100 / 3)


def test_noise_moves_mse_by_its_variance_and_badpix_by_its_tail() -> None:
    truth = np.zeros((400, 400), np.float32)
    noisy = np.random.default_rng(0).normal(0, 0.07, truth.shape)
    assert metrics.mse(noisy, truth) == pytest.approx(0.49, rel=0.02)
    assert metrics.badpix(noisy, truth) == pytest.approx(31.73, abs=0.5)  # P(|n| > σ)
    assert metrics.q25(noisy, truth) == pytest.approx(7 * 0.3186, rel=0.02)  # quartile of |n|


def test_one_wrong_pixel_in_a_known_number() -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.float32)
    estimate = truth.copy()
    estimate[20, 20] = 0.5
    estimate[0, 0] = 9.0  # in the border
    count = (HEIGHT - 30) * (WIDTH - 30)
    assert metrics.badpix(estimate, truth) == pytest.approx(100 / count)
    assert metrics.mse(estimate, truth) == pytest.approx(100 * 0.25 / count)


def test_missing_values_count_as_bad_and_are_reported() -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.float32)
    estimate = truth.copy()
    estimate[20, 20:24] = np.nan, np.inf, -np.inf, np.nan
    scores = evaluate(estimate, light_field(truth))
    assert scores.invalid_pixels == 4
    assert scores["badpix_0.07"] == pytest.approx(400 / scores.pixels)
    assert scores["mse_x100"] == 0
    assert "4 of 396 pixels have no value" in scores.table()


# --- confidence


def test_a_confidence_in_the_order_of_the_error_has_no_area() -> None:
    truth, estimate, _ = random_case(2)
    estimate = np.nan_to_num(estimate)
    error = np.abs(estimate.astype(float) - truth)
    measures: tuple[Literal["badpix", "absolute", "squared"], ...] = ("badpix", "absolute", "squared")
    for measure in measures:
        assert metrics.ause(estimate, truth, -error, measure) == pytest.approx(0, abs=1e-9)
        assert metrics.ause(estimate, truth, error, measure) > 0


def test_a_constant_confidence_gives_a_flat_curve() -> None:
    truth, estimate, _ = random_case(4)
    curve = metrics.sparsification(estimate, truth, np.ones_like(truth))
    np.testing.assert_allclose(curve.error, metrics.badpix(estimate, truth))


def test_ause_worked_by_hand() -> None:
    # A quarter of the pixels is bad and trusted most: dropping the good ones first leaves the bad ones.
    truth = np.zeros((40, 40))
    estimate = truth.copy()
    estimate[:, 15:20] = 1.0  # 5 of the 10 columns inside the border
    curve = metrics.sparsification(estimate, truth, estimate, steps=4)
    np.testing.assert_allclose(curve.dropped, [0, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(curve.error, [50, 100 * 50 / 75, 100, 100])
    np.testing.assert_allclose(curve.oracle, [50, 100 * 25 / 75, 0, 0])
    assert curve.area == pytest.approx((0 + 100 / 3 + 100 + 100) / 4)


def test_pixels_without_confidence_go_first() -> None:
    truth = np.zeros((40, 40))
    estimate = np.zeros((40, 40))
    estimate[20, 20] = 1.0
    confidence = np.zeros((40, 40))
    confidence[20, 20] = np.nan
    assert metrics.ause(estimate, truth, confidence) == pytest.approx(0, abs=1e-9)


# --- evaluate


def test_a_metric_without_its_mask_is_missing_with_the_reason() -> None:
    truth, estimate, mask = random_case(0)
    scores = evaluate(estimate, light_field(truth, {"planes": mask, "discontinuities": mask}))
    assert "bumpiness_planes" in scores
    assert scores.missing["bumpiness_continuous"] == "no mask 'smooth_surfaces'"
    assert scores.missing["dots_missed"] == "no mask 'boxes' and no mask 'dots_by_size'"
    assert scores.missing["ause_absolute"] == "no confidence"
    assert scores.notes == {"discontinuities": LOW_INSTEAD}
    assert set(scores) | set(scores.missing) == {metric.key for metric in METRICS}


def test_high_resolution_truth_is_used_where_the_benchmark_wants_it() -> None:
    low = np.zeros((40, 40), np.float32)
    high = np.full((400, 400), 0.05, np.float32)
    mask = np.ones((400, 400), bool)
    lf = light_field(low, name="stripes")
    scores = evaluate(low, lf, high=HighResolution(high, {"low_texture": mask}))
    assert scores["badpix_0.03"] == 100.0
    assert scores["stripes_low_texture"] == 0.0
    assert not scores.notes
    other = evaluate(low, light_field(low, name="cotton"), high=HighResolution(high, {"fine": mask}))
    assert other["badpix_0.03"] == 0.0
    general = {"badpix_0.01", "badpix_0.03", "badpix_0.07", "mse_x100", "q25"}
    assert evaluate(low, lf).notes.keys() == general
    # Scenes in the manner of the benchmark's, by their name or by their masks.
    assert evaluate(low, light_field(low, name="wedges")).notes.keys() == general
    marked = light_field(low, {"foreground_thinning": low == 0, "foreground_fattening": low == 0})
    stratified = {"backgammon_fattening", "backgammon_thinning"}
    assert evaluate(low, marked).notes == dict.fromkeys(general | stratified, LOW_INSTEAD)


def test_an_array_can_be_the_truth_and_the_scores_are_plain_data() -> None:
    truth, estimate, _ = random_case(0)
    scores = evaluate(estimate, truth)
    assert scores.as_dict()["scores"]["mse_x100"] == metrics.mse(estimate, truth)
    assert "BadPix 0.07" in scores.table()
    assert "no camera" not in scores.table()
    assert "no mask 'fine'" in scores.table(every=True)


@pytest.mark.parametrize(
    ("estimate", "message"),
    [
        (np.zeros((5, 7)), "scene: estimate is 7x5 px; expected 52x48 px like the truth"),
        (np.full((HEIGHT, WIDTH), np.nan), "scene: estimate has no finite value"),
        (np.zeros((HEIGHT, WIDTH, 3)), "scene: estimate is 3x52x48 px"),
    ],
)
def test_an_unusable_estimate_is_named(estimate: Array, message: str) -> None:
    with pytest.raises(LightFieldError, match=message):
        evaluate(estimate, light_field(step_scene()))


def test_other_unusable_input_is_named() -> None:
    truth = step_scene()
    with pytest.raises(LightFieldError, match="light field: no truth"):
        evaluate(truth, LightField(np.zeros((3, 3, HEIGHT, WIDTH, 1), np.uint8)))
    with pytest.raises(LightFieldError, match="confidence is 2x2 px"):
        evaluate(truth, light_field(truth), confidence=np.zeros((2, 2)))
    with pytest.raises(LightFieldError, match="high-resolution truth is 30x20 px; expected 10 times"):
        evaluate(truth, light_field(truth), high=HighResolution(np.zeros((20, 30))))
    with pytest.raises(LightFieldError, match="expected more than 30 px a side"):
        evaluate(truth[:20], truth[:20])
    with pytest.raises(LightFieldError, match="mask: 2x2 px; expected 52x48 px"):
        metrics.badpix(truth, truth, mask=np.ones((2, 2)))
    with pytest.raises(LightFieldError, match="estimate: 2x2 px"):
        metrics.badpix(truth[:2, :2], truth)


def test_high_resolution_files_are_read_and_a_mask_of_another_size_is_named(tmp_path: Path) -> None:
    from PIL import Image

    assert read_high_resolution(tmp_path) is None
    (tmp_path / "gt_disp_highres.pfm").write_bytes(b"Pf\n400 400\n-1\n" + bytes(4 * 400 * 400))
    Image.fromarray(np.full((400, 400), 255, np.uint8)).save(tmp_path / "mask_fine_highres.png")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "mask_discontinuities_highres.png")
    high = read_high_resolution(tmp_path)
    assert high is not None
    scores = evaluate(np.zeros((40, 40)), np.zeros((40, 40)), high=high)
    assert scores["fine_thinning"] == 0.0
    assert "mask_discontinuities_highres.png: 4x4 px" in scores.missing["discontinuities"]


SPO = Path(os.environ.get("LFDEPTH_SPO_COTTON", COTTON.parents[1] / "spo" / "cotton.pfm"))


@pytest.mark.skipif(
    not (COTTON.exists() and SPO.exists()),
    reason="the published map of SPO on cotton is not here; LFDEPTH_SPO_COTTON=cotton.pfm gives it",
)
def test_the_published_map_of_spo_scores_what_was_published() -> None:
    scores = evaluate(read_disparity(SPO), lfdepth.read(COTTON))
    assert [round(scores[f"badpix_{t}"], 3) for t in (0.01, 0.03, 0.07)] == [69.057, 13.708, 2.594]
    assert (round(scores["mse_x100"], 3), round(scores["q25"], 3)) == (1.313, 0.857)


@pytest.mark.skipif(not COTTON.exists(), reason="no ../shared/data beside the repository")
def test_cotton_has_the_metrics_of_its_masks() -> None:
    lf = lfdepth.read(COTTON)
    assert lf.truth is not None
    scores = evaluate(lf.truth, lf)
    assert set(scores.notes) == {"discontinuities"}
    assert {"bumpiness_planes", "mae_continuous"} <= set(scores)
    assert all(value == 0 for value in scores.values())
