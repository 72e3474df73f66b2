"""The joint decoder against the oracle, and the laws of energies, paths, minima and what comes of them.

Its parts are compared with the oracle on every engine in `test_engines`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fields
import naive
import naive_photo
import naive_vis
from lfdepth.blocks import energy as joint
from lfdepth.blocks.energy import JointEnergy, JointRule
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.engines import engine, single
from lfdepth.engines.layout import ENERGY_SCALE as SCALE
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods import Method, method
from lfdepth.trace import Trace

Array = fields.Array

CUT = 2 * SCALE
PART = SCALE // 16  # sixteenths are exact as energies in either form


def level_guide(rng: np.random.Generator, size: tuple[int, int], channels: int) -> Array:
    """A guide of a few levels, whose differences are exact: most neighbours are alike, some all but."""
    levels = rng.choice([0, 0, 0, 1, 2, 8], (*size, channels))
    return np.asarray(levels / 64, np.float32)


def random_energy(rng: np.random.Generator, shape: tuple[int, int, int]) -> Array:
    """Whole energies with a zero at every pixel; some flat, some cut."""
    energy = PART * rng.integers(0, 33, shape) * rng.choice([0, 1], (*shape[:2], 1), p=[0.2, 0.8])
    energy = np.where(rng.random(shape) < 0.2, CUT, energy)
    return np.asarray(energy - energy.min(axis=-1, keepdims=True))


def path_total(
    energy: Array,
    guide: Array,
    slope: float,
    jump: float,
    sharpness: float,
    threads: int = 1,
    noise: float = 0.0,
) -> Array:
    """Costs (H, W, K) over paths from four sides; energies and penalties are whole."""
    signs = np.ascontiguousarray(np.moveaxis(energy / SCALE, 2, 0), np.float32)
    none, silent = np.zeros(signs.shape, np.uint8), np.zeros(signs.shape[1:], np.float32)
    costs = {"slope": slope / SCALE, "jump": jump / SCALE, "sharpness": sharpness, "noise": noise}
    with engine(threads=threads) as used:
        return used.download(used.paths(signs, none, silent, guide, **costs))


def positions(total: Array, threads: int = 1) -> Array:
    with engine(threads=threads) as used:
        return np.asarray(used.least(total))


# Paths and minima


def test_a_parabola_is_found_where_it_is() -> None:
    """Truth: energies that are a parabola of the plane."""
    k, place = np.arange(9.0), np.linspace(0.6, 7.4, 40)
    total = path_total(400 * (k - place[:, None])[None] ** 2, np.zeros((1, 40, 1), np.float32), 0, 0, 0)
    np.testing.assert_allclose(positions(total)[0], place, atol=2e-3)


def test_threads_change_no_path() -> None:
    rng = np.random.default_rng(4)
    energy, guide = random_energy(rng, (31, 37, 6)), level_guide(rng, (31, 37), 3)
    one = path_total(energy, guide, 240.0, 2000.0, 20.0, noise=0.01)
    for threads in (2, 3, 5):
        many = path_total(energy, guide, 240.0, 2000.0, 20.0, threads, noise=0.01)
        np.testing.assert_array_equal(many, one)
        np.testing.assert_array_equal(positions(many, threads), positions(one))


def test_without_penalties_every_pixel_is_on_its_own() -> None:
    rng = np.random.default_rng(5)
    energy = random_energy(rng, (7, 9, 8))
    guide = level_guide(rng, (7, 9), 1)
    np.testing.assert_array_equal(path_total(energy, guide, 0.0, 0.0, 20.0), 4 * energy)


def test_a_pixel_without_evidence_takes_its_neighbours_plane() -> None:
    energy = np.full((5, 7, 6), 1000)
    energy[..., 4] = 0
    energy[2, 3] = 0
    total = path_total(energy, np.zeros((5, 7, 1), np.float32), 200.0, 1500.0, 20.0)
    np.testing.assert_array_equal(total.argmin(axis=-1), 4)


def test_paths_do_not_cross_an_edge_of_the_reference_view() -> None:
    """Half of it without evidence: filled where the guide is even, left alone behind an edge."""
    energy = np.zeros((4, 12, 6))
    energy[:, :6] = 1000
    energy[:, :6, 2] = 0
    guide = np.zeros((4, 12, 1), np.float32)
    even = path_total(energy, guide, 200.0, 1500.0, 20.0)
    np.testing.assert_array_equal(even.argmin(axis=-1), 2)
    guide[:, 6:] = 1
    torn = path_total(energy, guide, 200.0, 1500.0, 20.0)
    np.testing.assert_array_equal(torn[:, 6:], 0)


def test_colour_differences_below_the_noise_change_no_path() -> None:
    """Truth: as though the guide were even. Beyond the noise only the excess counts."""
    rng = np.random.default_rng(8)
    energy = random_energy(rng, (9, 12, 6))
    even = np.full((9, 12, 3), 0.5, np.float32)
    grainy = even + rng.choice([-1, 1], even.shape).astype(np.float32) / 256  # differences of 0 to 6 / 256
    flat = path_total(energy, even, 240.0, 1500.0, 20.0)
    for noise in (6 / 256, 0.1):
        np.testing.assert_array_equal(path_total(energy, grainy, 240.0, 1500.0, 20.0, noise=noise), flat)
    assert (path_total(energy, grainy, 240.0, 1500.0, 20.0, noise=3 / 256) != flat).any()


def test_only_what_exceeds_the_noise_weakens_a_path() -> None:
    """A step of 24 / 256 with a noise of 8 / 256 is as one of 16 / 256 without."""
    energy = random_energy(np.random.default_rng(9), (5, 14, 6))
    step = np.zeros((5, 14, 1), np.float32)
    step[:, 7:] = 1
    found = path_total(energy, step * np.float32(24 / 256), 240.0, 1500.0, 20.0, noise=8 / 256)
    expected = path_total(energy, step * np.float32(16 / 256), 240.0, 1500.0, 20.0)
    np.testing.assert_array_equal(found, expected)


# Islands at the ends of the range

PLANES = 12


def filled(position: Array, largest: int = 2) -> Array:
    out = np.array(position, np.float32, order="C")
    single().fill_islands(out, PLANES, largest)
    return out


@pytest.mark.parametrize("end", [0, PLANES - 1])
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 1)])
def test_a_small_island_takes_what_lies_around_it(size: tuple[int, int], end: int) -> None:
    truth = np.full((8, 9), 5.5, np.float32)
    for y, x in ((0, 0), (3, 4), (8 - size[0], 9 - size[1])):
        position = truth.copy()
        position[y : y + size[0], x : x + size[1]] = end
        np.testing.assert_array_equal(filled(position), truth)


@pytest.mark.parametrize("end", [0, PLANES - 1])
@pytest.mark.parametrize(
    "size", [(1, 3), (3, 1), (1, 4), (1, 5), (6, 1), (7, 1), (2, 2), (2, 5), (5, 5), (6, 7)]
)
def test_a_larger_region_at_an_end_is_left(size: tuple[int, int], end: int) -> None:
    """Lines too, however thin."""
    position = np.full((9, 10), 5.5, np.float32)
    position[1 : 1 + size[0], 2 : 2 + size[1]] = end
    np.testing.assert_array_equal(filled(position), position)


def test_a_ragged_region_at_an_end_is_left() -> None:
    """Two bays that meet only at the bottom: whichever pixel one starts from, there is one region."""
    rows = ["#.#.#.#", "#.#.#.#", "#######", ".#...#.", ".#####."]
    land = np.array([[c == "#" for c in row] for row in rows])
    for turned in (land, land[::-1], land[:, ::-1], land.T, land[::-1].T):
        position = np.where(turned, 0, 6.25).astype(np.float32)
        np.testing.assert_array_equal(filled(position), position)


def test_islands_away_from_the_ends_are_left() -> None:
    position = np.full((6, 7), 8.0, np.float32)
    position[2, 3], position[4, 5] = 0.25, PLANES - 1.25
    np.testing.assert_array_equal(filled(position), position)


def test_the_end_of_a_slope_is_left() -> None:
    """Neighbours within two planes are of one surface, so this is none of its islands."""
    position = np.broadcast_to(np.minimum(1.75 * np.arange(7), PLANES - 1), (5, 7)).astype(np.float32)
    assert np.all(position[:, [0, -2]] == [0, 8.75])
    np.testing.assert_array_equal(filled(position), position)
    steeper = np.broadcast_to([0, 2.25, 4, 6, 8], (1, 5)).astype(np.float32)
    np.testing.assert_array_equal(filled(steeper), [[2.25, 2.25, 4, 6, 8]])


def test_the_shore_is_where_the_median_is_taken() -> None:
    """Corners do not touch; of an even number the lower one of the middle two counts."""
    position = np.array([[9, 3, 9], [5, 0, 6], [9, 8, 9]], np.float32)
    assert filled(position)[1, 1] == 5


def test_a_map_that_is_one_island_is_left() -> None:
    for size in ((1, 1), (1, 2)):
        np.testing.assert_array_equal(filled(np.zeros(size)), 0)


# The decoder


RANGE = (-1.0, 1.2)


def collect(
    lf: LightField, plane: Array, volume: Array, rule: JointRule, stride: int, guide: Array
) -> JointEnergy:
    decoder = JointEnergy(lf, plane, GuidedFilter(guide.astype(np.float32), 2, 1e-3), rule, stride=stride)
    for k, smoothed in enumerate(volume):
        decoder.update(k, smoothed)
    return decoder


@pytest.mark.thin(4)
@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize(
    ("grid", "channels", "size", "planes"),
    [
        ((3, 4), 3, (8, 33), 9),
        ((1, 5), 1, (17, 9), 6),
        ((5, 5), 3, (9, 10), 3),
        ((4, 3), 1, (6, 31), 5),
        ((9, 9), 1, (7, 8), 6),  # enough views to thin them
    ],
)
def test_decoders_agree_with_the_oracle(
    grid: tuple[int, int], channels: int, size: tuple[int, int], planes: int, dtype: str, stride: int
) -> None:
    """Both passes. An energy rounded otherwise moves a parabola a little, rarely more."""
    rng = np.random.default_rng([*grid, channels, planes])
    present = fields.random_present(rng, grid) if dtype == "uint8" else None
    lf = fields.light_field(rng, grid, size, channels, dtype, present=present)
    plane = np.linspace(1.21, -1.013, planes)  # so that no surface lies at the margin's very end
    # Profiles as they are, one step from −1 to +1, with noise.
    surface = np.rint(64 * rng.uniform(-0.8, 1.0, size)) / 64
    profiles = np.sign(surface - plane[:, None, None]) + rng.normal(0, 0.5, (planes, *size))
    volume = np.clip(profiles, -1, 1).astype(np.float32)
    guide = naive.guide_image(lf.views, "colour")
    rule = JointRule(fit_radius=4)
    decoder = collect(lf, plane, volume, rule, stride, guide)
    smooth = naive.GuidedFilter(guide, 2, 1e-3)
    level, noise = naive_vis.residual(lf.views, plane, present)
    limits = naive_vis.thresholds(lf.views, noise)
    used = stride if planes >= 3 * stride else 1
    assert decoder.stride == used
    some = naive_vis.voting(lf.views, present, used > 1)
    shares = np.stack([smooth(naive_photo.photo_consistency(lf.views, d, limits, some)) for d in plane])
    expected = naive_vis.decode(plane, volume, shares, lf.views, level, guide, rule, used, present)
    rough = surface.astype(np.float32)
    compare(decoder.decide(), expected, float(plane[0] - plane[1]) * used)
    assert list(decoder.recount(rough)) == list(range(planes))
    again = decoder.decide()
    more = naive_vis.voting(lf.views, present)
    shares = np.stack([smooth(naive_vis.visible_share(lf.views, d, limits, rough, more)) for d in plane])
    expected = naive_vis.decode(plane, volume, shares, lf.views, level, guide, rule, 1, present)
    compare(again, expected, float(plane[0] - plane[1]))


def compare(found: tuple[Array, Array], expected: naive_vis.Decoded, step: float) -> None:
    disparity, confidence = found
    apart = np.abs(disparity - expected.disparity)
    assert np.sum(apart > 0.02 * step) <= max(2, 0.02 * apart.size)
    np.testing.assert_allclose(confidence, expected.confidence, atol=5e-3)


def test_the_decoder_weighs_what_the_rule_says() -> None:
    """Without photo-consistency and penalties it is the parabola on the running sum: sign approximation."""
    rng = np.random.default_rng(7)
    lf = fields.light_field(rng, (3, 3), (20, 24), 3)
    plane = np.linspace(1.2, -1.0, 23)
    surface = rng.uniform(-0.5, 0.7, (20, 24))
    profiles: Array = np.clip((surface - plane[:, None, None]) / 0.3, -1, 1)
    volume = profiles.astype(np.float32)
    rule = JointRule(photo_weight=0.0, slope_penalty=0.0, jump_penalty=0.0, fit_radius=0)
    decoder = collect(lf, plane, volume, rule, 1, naive.guide_image(lf.views, "colour"))
    disparity, _ = decoder.decide()
    total = np.moveaxis(naive_vis.sign_energy(volume, 0.1), 0, -1)
    np.testing.assert_allclose(disparity, plane[0] - 0.1 * naive_vis.parabola(total), atol=0.005)


# The method without its treatment of edges


def plain(**options: Any) -> Method:
    """The joint decoder alone, on every plane."""
    return method("fbs-vis", visibility=False, **options)


def scene(seed: int = 1, **options: Any) -> LightField:
    return fields.light_field(
        np.random.default_rng(seed), (5, 5), (40, 44), 3, disparity_range=RANGE, **options
    )


def test_the_running_sums_parabola_decides_when_nothing_else_weighs() -> None:
    weightless = plain(photo_weight=0, slope_penalty=0, jump_penalty=0, fit_radius=0, step=0.1)
    trace = Trace(keep=("smoothed",))
    result = estimate(scene(), weightless, trace=trace)
    total = np.moveaxis(naive_vis.sign_energy(np.stack(trace.kept["smoothed"]), 0.1), 0, -1)
    expected = np.clip(weightless.planes_for(RANGE)[0] - 0.1 * naive_vis.parabola(total), *RANGE)
    clear = np.sort(total, axis=-1)[..., 1] - total.min(axis=-1) > 2 / SCALE
    close = np.abs(result.disparity - expected) < 0.02
    assert close[clear].mean() > 0.99
    assert clear.mean() > 0.8


def test_sign_function_approximation_is_the_limit_of_no_weight() -> None:
    """λ = 0: up to the interpolation between planes both decoders see one minimum of the running sum."""
    joint_map = estimate(scene(2), plain(photo_weight=0, slope_penalty=0, jump_penalty=0)).disparity
    sign_map = estimate(scene(2), "fbs-sfa", step=0.06).disparity
    assert np.mean(np.abs(joint_map - sign_map) < 0.06) > 0.95


@pytest.mark.parametrize("visibility", [False, True])
def test_photo_consistency_changes_nothing_where_there_is_no_texture(visibility: bool) -> None:
    lf = LightField(np.full((5, 5, 30, 34, 3), 90, np.uint8), disparity_range=RANGE)
    result = estimate(lf, "fbs-vis", visibility=visibility)
    assert result.confidence.max() == 0
    assert np.unique(result.disparity).size == 1


@pytest.mark.parametrize("times", [2, 25])
def test_a_slope_dearer_than_a_jump_is_never_paid(times: int) -> None:
    jump = method("fbs-vis").parameters()["jump_penalty"]
    expected = estimate(scene(3), plain(slope_penalty=jump)).disparity
    found = estimate(scene(3), plain(slope_penalty=times * jump)).disparity
    np.testing.assert_array_equal(found, expected)


def test_the_rules_defaults_are_the_methods() -> None:
    chosen, rule = method("fbs-vis"), joint.JointRule()
    for name in ("photo_weight", "slope_penalty", "jump_penalty", "fit_radius"):
        assert getattr(chosen, name) == getattr(rule, name), name


def test_penalties_make_the_map_smoother() -> None:
    """Total variation falls as penalties rise, in the mean over pixels."""

    noise = np.random.default_rng(4).normal(128, 6, (5, 5, 40, 44, 3))
    lf = LightField(np.rint(noise).astype(np.uint8), disparity_range=RANGE)

    def roughness(scale: float) -> float:
        found = estimate(lf, plain(slope_penalty=0.1 * scale, jump_penalty=scale)).disparity
        return float(np.abs(np.diff(found, axis=0)).mean() + np.abs(np.diff(found, axis=1)).mean())

    loose, middle, stiff = (roughness(scale) for scale in (0.0, 0.2, 2.0))
    assert loose > middle > stiff
