"""Scenes against the geometry and the textures they are said to have."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import distance_transform_edt, map_coordinates

from lfdepth import scenes
from lfdepth.engines.cpu.kernels import scenes as kernels
from lfdepth.errors import LightFieldError
from lfdepth.io import benchmark, read, read_disparity
from lfdepth.lightfield import LightField
from lfdepth.scenes import masks, photoreal, textures
from lfdepth.scenes.model import Ellipsoid, Facets, Layer, Paint, Plane, Scene, ellipse, pack, rectangle
from lfdepth.scenes.stratified import STRATIFIED, pyramid
from lfdepth.scenes.suite import SUITE, Stage
from lfdepth.scoring import metrics, read_high_resolution

SIZE = (120, 136)
Float = npt.NDArray[np.float64]

_RENDERED: dict[str, LightField] = {}


def scene(name: str) -> LightField:
    """Noise-free small light field, rendered once."""
    if name not in _RENDERED:
        size = (256, 256) if name == "fence" else SIZE  # its meshes have to be wider than a shift
        _RENDERED[name] = scenes.render(name, size=size, views=3, seed=3, noise=0)
    return _RENDERED[name]


def truth_of(lf: LightField) -> npt.NDArray[np.float32]:
    assert lf.truth is not None
    return lf.truth


def spline(texture: npt.NDArray[np.float32], x: Any, y: Any) -> Float:
    """SciPy's cubic B-spline with the texture as coefficients."""
    at = np.atleast_1d(y), np.atleast_1d(x)
    channels = [
        map_coordinates(texture[..., c].astype(float), at, order=3, prefilter=False, mode="grid-wrap")
        for c in range(3)
    ]
    return np.stack(channels, axis=-1).reshape(*np.shape(x), 3)


def random_texture(seed: int = 0, n: int = 64) -> npt.NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(20, 235, (n, n, 3)).astype(np.float32)


def solve(surface: Any, x: float, y: float, u: float, v: float, low: float, high: float) -> float:
    """Largest D at which the ray's point (x + D·u, y + D·v) has that disparity, by scanning."""
    ds = np.linspace(high, low, 20001)
    gap = ds - surface(x + ds * u, y + ds * v)
    hit = np.flatnonzero((gap[:-1] > 0) & (gap[1:] <= 0))
    if hit.size == 0:
        return float("nan")
    i = hit[0]
    return float(ds[i] + (ds[i + 1] - ds[i]) * gap[i] / (gap[i] - gap[i + 1]))


def warp_error(lf: LightField, disparity: npt.NDArray[np.float32], v: int, u: int) -> Float:
    """Mean absolute difference over channels of the reference and view (u, v) warped onto it, (H, W)."""
    y, x = np.mgrid[: lf.height, : lf.width].astype(float)
    view = lf.views[lf.centre[0] + v, lf.centre[1] + u].astype(float)
    at = [y - disparity * v, x - disparity * u]
    warped = np.stack([map_coordinates(view[..., c], at, order=3, mode="mirror") for c in range(3)], axis=-1)
    return np.asarray(np.abs(warped - lf.reference).mean(axis=-1))


def away_from_edges(lf: LightField, views_away: int) -> npt.NDArray[np.bool_]:
    """Pixels whose way into a view crosses neither the border nor a depth edge."""
    truth = truth_of(lf)
    reach = views_away * float(truth.max() - truth.min()) + 2
    jump = np.zeros(truth.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(truth, axis=axis)) > 0.08
        jump |= np.pad(step, [(0, 1) if a == axis else (0, 0) for a in (0, 1)])
    border = int(np.ceil(views_away * np.abs(truth).max())) + 4
    inside = np.zeros(truth.shape, dtype=bool)
    inside[border:-border, border:-border] = True
    return np.asarray(inside & (distance_transform_edt(~jump) > reach))


def test_a_view_is_the_texture_at_the_shifted_point() -> None:
    texture, disparity = random_texture(), 0.73
    packed = pack(Scene([Layer(Plane(disparity), Paint(texture))]))
    y, x = np.mgrid[:20, :31]
    for u, v in ((0, 0), (3, -2), (-4, 1)):
        picture = kernels.render_view(packed, float(u), float(v), 20, 31, 1)
        expected = spline(texture, x + disparity * u, y + disparity * v)
        np.testing.assert_allclose(picture, expected, atol=2e-3)


def test_a_pixel_is_the_mean_of_its_samples() -> None:
    texture = random_texture(1)
    picture = kernels.render_view(pack(Scene([Layer(Plane(0.0), Paint(texture))])), 0.0, 0.0, 5, 6, 3)
    y, x = np.mgrid[:15, :18] / 3 - 1 / 3
    expected = spline(texture, x, y).reshape(5, 3, 6, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(picture, expected, atol=2e-3)


@pytest.mark.parametrize(
    ("surface", "formula"),
    [
        (Plane(0.2, 0.02, -0.03, 10, 8), lambda x, y: 0.2 + 0.02 * (x - 10) - 0.03 * (y - 8)),
        (
            Facets([Plane(0.9, -0.05, 0, 12, 0), Plane(0.9, 0.04, 0.01, 12, 0), Plane(0.6)]),
            lambda x, y: np.minimum(
                np.minimum(0.9 - 0.05 * (x - 12), 0.9 + 0.04 * (x - 12) + 0.01 * y), 0.6 + 0 * x
            ),
        ),
        (
            Facets([Plane(-0.9, -0.05, 0, 12, 0), Plane(-0.9, 0.04, 0.01, 12, 0)], hollow=True),
            lambda x, y: np.maximum(-0.9 - 0.05 * (x - 12), -0.9 + 0.04 * (x - 12) + 0.01 * y),
        ),
        (
            Ellipsoid(12, 9, 11, 8, -0.3, 1.1),
            lambda x, y: -0.3 + 1.1 * np.sqrt(1 - ((x - 12) / 11) ** 2 - ((y - 9) / 8) ** 2),
        ),
    ],
)
def test_views_solve_the_surface_equation(surface: Any, formula: Any) -> None:
    texture = random_texture(2)
    packed = pack(Scene([Layer(surface, Paint(texture))]))
    truth, _ = kernels.trace(packed, 0.0, 0.0, np.arange(18.0), 24, 0.0, 1.0)
    with np.errstate(invalid="ignore"):
        for u, v in ((0.0, 0.0), (4.0, 3.0), (-3.0, 4.0)):
            picture = kernels.render_view(packed, u, v, 18, 24, 1)
            for x, y in ((6, 6), (12, 9), (15, 11), (17, 7)):
                d = solve(formula, x, y, u, v, -3, 3)
                expected = spline(texture, x + u * d, y + v * d)
                np.testing.assert_allclose(picture[y, x], expected, atol=0.05)
                np.testing.assert_allclose(truth[y, x], formula(float(x), float(y)), atol=1e-5)


def test_a_dent_is_seen_through_its_mouth_only() -> None:
    mouth = ellipse(16, 16, 8, 8)
    flat = Layer(Plane(0.5), Paint(random_texture()), holes=[mouth])
    dent = Layer(Ellipsoid(16, 16, 8, 8, 0.5, 0.9, far=True), Paint(random_texture(1)))
    truth, _ = kernels.trace(pack(Scene([flat, dent])), 0.0, 0.0, np.arange(33.0), 33, 0.0, 1.0)
    y, x = np.mgrid[:33, :33]
    depth = np.sqrt(np.maximum(0, 1 - ((x - 16) / 8) ** 2 - ((y - 16) / 8) ** 2))
    np.testing.assert_allclose(truth, 0.5 - 0.9 * depth, atol=1e-5)


def test_mirrored_scene_gives_mirrored_views() -> None:
    n = 64
    texture = random_texture(4, n)
    mirrored = np.ascontiguousarray(
        texture[:, ::-1]
    )  # knot x goes to n - 1 - x, as pixels of a width of n do
    layers = [
        Layer(Plane(0.1, 0.01), Paint(texture)),
        Layer(Ellipsoid(20, 30, 9, 12, 0.4, 1.0), Paint(texture)),
    ]
    flipped = [
        Layer(Plane(0.1 + 0.01 * (n - 1), -0.01), Paint(mirrored)),
        Layer(Ellipsoid(n - 1 - 20, 30, 9, 12, 0.4, 1.0), Paint(mirrored)),
    ]
    for u, v in ((0.0, 0.0), (2.0, 1.0)):
        picture = kernels.render_view(pack(Scene(layers)), u, v, n, n, 2)
        other = kernels.render_view(pack(Scene(flipped)), -u, v, n, n, 2)
        np.testing.assert_allclose(picture, other[:, ::-1], atol=0.02)


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", [name for name in scenes.NAMES if name != "gloss"])
def test_warping_by_the_truth_gives_the_reference(name: str) -> None:
    lf = scene(name)
    truth, seen = truth_of(lf), away_from_edges(scene(name), 1)
    errors, wrong = [], []
    for v, u in ((0, 1), (0, -1), (1, 0), (-1, -1)):
        errors.append(warp_error(lf, truth, v, u)[seen])
        wrong.append(warp_error(lf, truth + np.float32(0.25), v, u)[seen])
    error = np.concatenate(errors)
    assert error.size > 300
    assert error.mean() < 0.55  # the views are rounded to whole grey levels
    assert (
        np.quantile(error, 0.9) < 1.0
    )  # the rest: outlines painted on a surface, which no filter interpolates
    assert np.concatenate(wrong).mean() > 1.6 * error.mean()


def test_highlights_do_not_move_with_their_surface() -> None:
    lf = scenes.render("gloss", size=192, views=5)
    error = np.maximum(warp_error(lf, truth_of(lf), 0, 1), warp_error(lf, truth_of(lf), 0, -1))
    away = away_from_edges(lf, 1)
    bright = lf.reference.min(axis=-1) > 170
    assert error[away & bright].mean() > 4 * error[away & ~bright].mean()


@pytest.mark.parametrize("name", scenes.NAMES)
def test_range_masks_and_description(name: str) -> None:
    lf = scene(name)
    truth = truth_of(lf)
    assert lf.disparity_range == pytest.approx((truth.min() - 0.1, truth.max() + 0.1), abs=1e-6)
    assert lf.name == name
    assert len(scenes.describe(name)) > 20
    assert all(mask.any() for mask in lf.masks.values())
    assert 15 < lf.reference.mean() < 240
    assert lf.camera is not None
    depth = lf.camera.disparity_to_depth(truth)
    assert np.isfinite(depth).all()
    np.testing.assert_allclose(lf.camera.depth_to_disparity(depth), truth, atol=1e-5)


@pytest.mark.parametrize("span", [1, 4, 8])
def test_range_scenes_span_what_they_say(span: int) -> None:
    truth = truth_of(scene(f"range-{span}"))
    assert float(truth.max() - truth.min()) == pytest.approx(span, abs=0.01)


def test_wall_of_the_bars_is_its_plane() -> None:
    lf = scene("bars")
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    wall = -1.5 + 1.0 * x / (SIZE[1] - 1) + 0.2 * y / (SIZE[0] - 1)
    behind = ~lf.masks["thin"]
    assert behind.mean() > 0.4
    np.testing.assert_allclose(truth_of(lf)[behind], wall[behind], atol=1e-5)
    assert (truth_of(lf) > wall + 0.1)[lf.masks["thin"]].all()


def test_sphere_is_a_sphere() -> None:
    lf = scene("sphere")
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    r = np.hypot(x - 0.44 * (SIZE[1] - 1), y - 0.47 * (SIZE[0] - 1)) / (0.3 * SIZE[0])
    ball = -0.1 + 1.6 * np.sqrt(np.maximum(0, 1 - r * r))
    inner = r < 0.98
    np.testing.assert_allclose(truth_of(lf)[inner], ball[inner], atol=1e-5)
    assert lf.masks["smooth"][inner].all()


def test_occlusion_boundary_is_within_five_pixels_of_a_jump() -> None:
    lf = scene("demo")
    truth, mask = truth_of(lf), lf.masks["occlusion_boundary"]
    edge = np.zeros(truth.shape, dtype=bool)
    for y in range(SIZE[0]):
        for x in range(SIZE[1]):
            for a, b in ((y + 1, x), (y, x + 1)):
                # steeper than any slope here but the vase's at its rim, which is a jump itself
                if a < SIZE[0] and b < SIZE[1] and abs(float(truth[y, x]) - float(truth[a, b])) > 0.12:
                    edge[y, x] = edge[a, b] = True
    distance = distance_transform_edt(~edge)
    assert not mask[distance > 7].any()
    assert mask[distance <= 4].all()


def test_textureless_is_where_the_picture_is_flat() -> None:
    lf = scene("room")
    flat = lf.masks["textureless"]
    assert 0.3 < flat.mean() < 0.95
    values = lf.reference.astype(float)
    for y, x in np.argwhere(flat[4:-4, 4:-4])[::97] + 4:
        assert values[y - 4 : y + 5, x - 4 : x + 5].std(axis=(0, 1)).max() < 1.5 + 0.3  # rounding adds 0.29
    for y, x in np.argwhere(~flat[4:-4, 4:-4])[::97] + 4:
        assert values[y - 4 : y + 5, x - 4 : x + 5].std(axis=(0, 1)).max() > 1.5 - 0.3


def test_noise_has_its_level() -> None:
    clean = scenes.render("room", size=96, views=3, noise=0).views.astype(float)
    noisy = scenes.render("room", size=96, views=3, noise=6).views.astype(float)
    grey = np.abs(clean - 128) < 8
    assert grey.sum() > 2000
    assert (noisy - clean)[grey].std() == pytest.approx(6, rel=0.05)
    bright = np.abs(clean - 190) < 10
    assert (noisy - clean)[bright].std() == pytest.approx(6 * np.sqrt(0.25 + 0.75 * 190 / 128), rel=0.06)
    first, second = (noisy - clean)[0, 0], (noisy - clean)[0, 1]
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.03


@pytest.mark.parametrize("name", ["demo", "noise-1"])
def test_seed_decides_every_byte_and_threads_none(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    once = scenes.render(name, size=64, views=3, seed=5)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    again = scenes.render(name, size=64, views=3, seed=5)
    other = scenes.render(name, size=64, views=3, seed=6)
    assert once.views.tobytes() == again.views.tobytes()
    assert truth_of(once).tobytes() == truth_of(again).tobytes()
    assert once.views.tobytes() != other.views.tobytes()


def test_grids_and_sizes_of_any_parity() -> None:
    lf = scenes.render("fence", size=(48, 70), views=(4, 3))
    assert lf.shape == (4, 3, 48, 70, 3)
    whole = scenes.render("fence", size=(48, 70), views=5)
    np.testing.assert_array_equal(lf.views, whole.views[:4, 1:4])


def test_textures_stay_in_range_and_fade_in_places() -> None:
    rng = np.random.default_rng(0)
    for texture in (
        textures.natural(rng, 128, [(120, 90, 60), (60, 90, 120)], contrast=40),
        textures.plain(rng, 128, (230, 230, 230), swing=20),
        textures.striped(rng, 128, [(120, 90, 60)], bands=8),
    ):
        assert texture.dtype == np.float32
        assert texture.min() >= 20
        assert texture.max() <= 235
    detail = textures.natural(rng, 256, [(128, 128, 128)]).mean(axis=-1)
    local = detail.reshape(32, 8, 32, 8).std(axis=(1, 3))
    assert np.quantile(local, 0.05) < 1.0
    assert np.quantile(local, 0.95) > 5.0


def test_every_scene_is_built_at_any_size() -> None:
    for name, recipe in {**SUITE, **STRATIFIED}.items():
        for size in ((32, 32), (33, 150)):
            packed = pack(recipe.build(Stage(*size, 1)))
            truth, layers = kernels.trace(packed, 0.0, 0.0, np.arange(float(size[0])), size[1], 0.0, 1.0)
            assert (layers >= 0).all(), name
            assert np.isfinite(truth).all(), name


@pytest.mark.parametrize(
    ("arguments", "finding"),
    [
        ({"name": "nowhere"}, "scene 'nowhere' does not exist"),
        ({"size": 16}, "size is 16x16"),
        ({"size": (64, 20000)}, "size is 64x20000"),
        ({"views": 2}, "views is 2x2"),
        ({"views": (9, 19)}, "views is 9x19"),
        ({"seed": -1}, "seed is -1"),
        ({"noise": -0.5}, "noise is -0.5"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"samples": 0}, "samples is 0"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], finding: str) -> None:
    with pytest.raises(LightFieldError, match=finding) as caught:
        scenes.render(**{"name": "demo", **arguments})
    assert "\n" not in str(caught.value)
    assert "expected" in str(caught.value)


def test_only_what_comes_later_is_seen_through_a_hole() -> None:
    hole = rectangle(10, 8, 6, 4)
    before = Layer(Plane(-1.0), Paint(random_texture()))
    sheet = Layer(Plane(0.5, 0.01), Paint(random_texture()), holes=[hole])
    after = Layer(Plane(-0.4), Paint(random_texture()))
    y, x = np.mgrid[:16, :20]
    through = (abs(x - 10) <= 3) & (abs(y - 8) <= 2)
    for layers in ([before, sheet, after], [sheet, after, before]):
        truth, _ = kernels.trace(pack(Scene(layers)), 0.0, 0.0, np.arange(16.0), 20, 0.0, 1.0)
        np.testing.assert_allclose(truth, np.where(through, -0.4, 0.5 + 0.01 * x), atol=1e-6)


@pytest.mark.parametrize("radius", [0, 1, 2.5, 5, 23])
def test_dilation_is_a_distance(radius: float) -> None:
    mask = np.random.default_rng(0).random((40, 57)) < 0.004
    np.testing.assert_array_equal(masks.dilate(mask, radius), distance_transform_edt(~mask) <= radius)
    assert not masks.dilate(np.zeros((5, 6), dtype=bool), radius).any()


def test_pyramid_has_its_base_and_apex() -> None:
    for height in (0.6, -0.6):
        truth, _ = kernels.trace(
            pack(Scene([Layer(pyramid(10, 12, 8, 0.1, height), Paint(random_texture()))])),
            0.0,
            0.0,
            np.arange(25.0),
            21,
            0.0,
            1.0,
        )
        y, x = np.mgrid[:25, :21]
        expected = 0.1 + height * (1 - np.maximum(abs(x - 10), abs(y - 12)) / 8)
        np.testing.assert_allclose(truth, expected, atol=1e-6)


SAVED_SIZE = (40, 56)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, LightField]]:
    """Scenes in benchmark folders, each written once."""
    root = tmp_path_factory.mktemp("scenes")
    done: dict[str, tuple[Path, LightField]] = {}

    def save(name: str) -> tuple[Path, LightField]:
        if name not in done:
            # where the smallest disc still is a pixel, and surfaces go on beyond their boundaries
            size = (96, 104) if name in ("specks", "solids") else SAVED_SIZE
            done[name] = root / name, scenes.save(name, root / name, size=size, views=(3, 4), seed=2)
        return done[name]

    return save


Saved = Callable[[str], tuple[Path, LightField]]


@pytest.mark.parametrize("name", ["demo", "noise-2"])
def test_folder_reads_back_as_it_was_rendered(saved: Saved, name: str) -> None:
    path, lf = saved(name)
    again = read(path)
    np.testing.assert_array_equal(again.views, lf.views)
    np.testing.assert_array_equal(truth_of(again), truth_of(lf))
    assert again.camera == lf.camera
    assert again.disparity_range == lf.disparity_range
    for key, mask in lf.masks.items():
        np.testing.assert_array_equal(again.masks[key], mask)
    rendered = scenes.render(name, size=SAVED_SIZE, views=(3, 4), seed=2)
    np.testing.assert_array_equal(again.views, rendered.views)


def test_high_resolution_truth_divides_the_pixels(saved: Saved) -> None:
    path, lf = saved("bars")
    high = read_disparity(path / "gt_disp_highres.pfm")
    height, width = SAVED_SIZE
    assert high.shape == (10 * height, 10 * width)
    y, x = (np.mgrid[: 10 * height, : 10 * width] + 0.5) / 10 - 0.5
    wall = -1.5 + 1.0 * x / (width - 1) + 0.2 * y / (height - 1)
    bars = read_high_resolution(path)
    assert bars is not None
    behind = bars.masks["thin"] == 0
    np.testing.assert_allclose(high[behind], wall[behind], atol=1e-5)
    share = bars.masks["thin"].astype(bool).mean()
    assert share == pytest.approx(lf.masks["thin"].mean(), abs=0.02)


def test_high_resolution_of_a_name_is_what_a_folder_holds(saved: Saved) -> None:
    written = read_high_resolution(saved("solids")[0])
    made = scenes.high_resolution("solids", size=(96, 104), seed=2)
    assert written is not None
    np.testing.assert_array_equal(made.truth, written.truth)
    assert set(made.masks) == set(written.masks)
    for key, mask in made.masks.items():
        np.testing.assert_array_equal(mask > 0, written.masks[key] > 0)
    with pytest.raises(LightFieldError, match="'photo-boxes' is not procedural"):
        scenes.high_resolution("photo-boxes")


def test_a_steep_rim_is_a_boundary_at_both_resolutions() -> None:
    # Two surfaces that meet without a step, one rising by 0.5 px per pixel: neighbours differ by 0.5 at the
    # size of the views, by 0.05 at ten times that.
    for scale in (1, 10):
        x = (np.arange(12 * scale) + 0.5) / scale - 6.0
        truth = np.tile(np.maximum(0, 0.5 * x), (3, 1)).astype(np.float32)
        layers = (truth > 0).astype(np.int16)
        edge = masks.jumps(truth, layers, apart=scale)[1]
        assert edge.sum() == 2
        assert edge[6 * scale - 1 : 6 * scale + 1].all()
        assert not masks.jumps(truth, layers * 0, apart=scale).any()


def test_masks_of_the_benchmark(saved: Saved) -> None:
    path, lf = saved("bars")
    low, high = read(path), read_high_resolution(path)
    assert high is not None
    thin = lf.masks["thin"]
    np.testing.assert_array_equal(low.masks["fine"], thin)
    near = (distance_transform_edt(~thin) <= 5) & ~thin
    np.testing.assert_array_equal(low.masks["fine_surrounding"], near)
    fine = high.masks["fine"] > 0
    np.testing.assert_array_equal(
        high.masks["fine_surrounding"] > 0, (distance_transform_edt(~fine) <= 50) & ~fine
    )
    edge = masks.jumps(
        high.truth, (high.masks["thin"] > 0).astype(np.int16)
    )  # bars cross at other disparities
    assert (high.masks["discontinuities"][edge] > 0).all()
    demo = read(saved("demo")[0]).masks
    np.testing.assert_array_equal(demo["planes"], demo["slanted"] & ~demo["occlusion_boundary"])
    path, _ = saved("solids")
    assert (path / "mask_discontinuities_highres.png").exists()
    solids = read(path).masks
    np.testing.assert_array_equal(solids["smooth_surfaces"], solids["smooth"] & ~solids["occlusion_boundary"])


def test_wedges_fatten_and_thin_when_only_one_side_is_seen(saved: Saved) -> None:
    path, _ = saved("wedges")
    high = read_high_resolution(path)
    assert high is not None
    truth = high.truth
    y = (np.arange(truth.shape[0]) + 0.5) / 10 - 0.5
    sheet = 0.5 - 0.6 * y / SAVED_SIZE[0]
    np.testing.assert_allclose(truth[:, 140 * SAVED_SIZE[1] // 512], sheet, atol=1e-5)
    behind = np.where(
        y < 0.32 * (SAVED_SIZE[0] - 1), -1.6 + 0.5 * y / SAVED_SIZE[0], -0.9 + 0.6 * y / SAVED_SIZE[0]
    )
    np.testing.assert_allclose(truth[:, -11], behind, atol=1e-5)
    thinning, fattening = high.masks["foreground_thinning"] > 0, high.masks["foreground_fattening"] > 0
    np.testing.assert_allclose((truth - sheet[:, None])[thinning], 0, atol=1e-5)
    np.testing.assert_allclose((truth - behind[:, None])[fattening], 0, atol=1e-5)
    assert 0.2 < thinning.mean() < 0.6
    assert 0.2 < fattening.mean() < 0.6


def test_solids_have_one_mask_for_each_pixel(saved: Saved) -> None:
    lf = saved("solids")[1]
    kinds = ("sphere_in", "sphere_out", "pyramids", "plane")
    assert np.sum([lf.masks[kind] for kind in kinds], axis=0).max() == 1
    assert np.sum([lf.masks[kind] for kind in kinds], axis=0).min() == 1
    truth = truth_of(lf)
    np.testing.assert_allclose(truth[lf.masks["plane"]], -0.1, atol=1e-6)
    assert (truth[lf.masks["sphere_in"]] < -0.1).all()
    assert (truth[lf.masks["sphere_out"]] > -0.1).all()
    perfect = metrics.bumpiness(truth, truth, lf.masks["plane"])
    assert perfect == 0


def test_each_box_of_specks_has_a_disc_of_each_size(saved: Saved) -> None:
    path, _ = saved("specks")
    high = read_high_resolution(path)
    assert high is not None
    boxes, sizes = high.masks["boxes"], high.masks["dots_by_size"]
    pairs, areas = np.unique(np.stack([boxes[sizes > 0], sizes[sizes > 0]]), axis=1, return_counts=True)
    assert pairs.shape[1] == 16 * 8
    by_size = [areas[pairs[1] == size].mean() for size in range(1, 9)]
    assert (np.diff(by_size) > 0).all()
    background = high.masks["background"] > 0
    np.testing.assert_array_equal(background, sizes == 0)
    np.testing.assert_allclose(high.truth, np.where(background, -0.6, 0.8), atol=1e-6)
    assert metrics.missed_dots(high.truth, high.truth, boxes, sizes) == 0
    assert metrics.missed_dots(np.full_like(high.truth, -0.6), high.truth, boxes, sizes) == 100


def test_noise_of_specks_grows_from_box_to_box() -> None:
    options: dict[str, Any] = {"size": 128, "views": 3}
    noisy, clean = (scenes.render("specks", **options, noise=noise) for noise in (None, 0))
    difference = noisy.views.astype(float) - clean.views
    levels = [
        difference[:, :, 32 * i : 32 * i + 32, 32 * j : 32 * j + 32].std() for i in range(4) for j in range(4)
    ]
    assert levels[0] == 0
    assert (np.diff(levels) > 0).all()


def test_strips_differ_in_contrast_and_texture(saved: Saved) -> None:
    lf = scene("strips")
    luma = lf.reference @ np.array([0.299, 0.587, 0.114])
    front = truth_of(lf) > -0.7
    zones = {zone: lf.masks[zone] for zone in ("high_contrast", "low_contrast", "low_texture")}
    assert np.sum(list(zones.values()), axis=0).min() == 1
    step = {zone: abs(luma[mask & front].mean() - luma[mask & ~front].mean()) for zone, mask in zones.items()}
    assert step["high_contrast"] > 60
    assert step["low_contrast"] < 12
    behind = distance_transform_edt(~front) > 2
    inner = {zone: luma[mask & behind].std() for zone, mask in zones.items()}
    assert inner["low_texture"] < inner["low_contrast"]


def test_saving_leaves_all_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"size": 32, "views": 3}
    target = tmp_path / "scene"
    scenes.save("demo", target, **options)
    before = {file.name: file.read_bytes() for file in target.iterdir()}

    def fail(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(benchmark, "write_pfm", fail)
        with pytest.raises(KeyboardInterrupt):
            scenes.save("bars", target, **options)
        with pytest.raises(KeyboardInterrupt):
            scenes.save("bars", tmp_path / "other", **options)
    assert {file.name: file.read_bytes() for file in target.iterdir()} == before
    assert [file.name for file in tmp_path.iterdir()] == ["scene"]
    scenes.save("bars", target, **options)
    assert "mask_thin_lowres.png" in {file.name for file in target.iterdir()}
    assert "scene = bars" in (target / "parameters.cfg").read_text()


def test_saving_refuses_other_folders(tmp_path: Path) -> None:
    mine = tmp_path / "holiday"
    mine.mkdir()
    (mine / "photo.jpg").write_bytes(b"precious")
    with pytest.raises(LightFieldError, match="holiday"):
        scenes.save("demo", mine, size=32, views=3)
    with pytest.raises(LightFieldError, match="nowhere"):
        scenes.save("demo", tmp_path / "nowhere" / "scene", size=32, views=3)
    assert (mine / "photo.jpg").read_bytes() == b"precious"
    # Nor does a scene's own folder give way once something else lies in it.
    scenes.save("demo", tmp_path / "scene", size=32, views=3)
    (tmp_path / "scene" / "estimate.pfm").write_bytes(b"a map")
    with pytest.raises(LightFieldError, match="other content"):
        scenes.save("demo", tmp_path / "scene", size=32, views=3)
    assert (tmp_path / "scene" / "estimate.pfm").read_bytes() == b"a map"


def test_path_traced_scenes_need_mitsuba(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(LightFieldError, match=r"mitsuba: not installed.*lfdepth\[render\]"):
        scenes.render("photo-boxes", size=32, views=3)
    assert all(len(scenes.describe(name)) > 20 for name in scenes.PHOTOREAL)


def test_path_traced_cameras_are_shifted() -> None:
    mi = pytest.importorskip("mitsuba", reason="needs the extra `render`")
    mi.set_variant("scalar_rgb")
    camera = photoreal.camera((48, 64))
    for position in ((0, 0), (3, -2)):
        sensor = mi.load_dict(photoreal.sensor_of(mi, camera, position, 1))
        for disparity in (-1.5, 0.0, 1.2):
            z = float(camera.disparity_to_depth(disparity))
            for x, y in ((0, 0), (40, 31)):  # of the reference view
                point = camera.points(np.full((48, 64), disparity))[y, x]
                at = (x - disparity * position[0] + 0.5) / 64, (y - disparity * position[1] + 0.5) / 48
                ray, _ = sensor.sample_ray(0.0, 0.5, at, [0.5, 0.5])
                origin, direction = np.array(ray.o), np.array(ray.d)
                hit = origin + direction * (z - origin[2]) / direction[2]
                np.testing.assert_allclose(hit, point, atol=2e-5)


@pytest.mark.parametrize("name", ["photo-boxes", "photo-gloss"])
def test_path_traced_truth_fits_its_views(name: str) -> None:
    mi = pytest.importorskip("mitsuba", reason="needs the extra `render`")
    mi.set_variant("scalar_rgb")
    camera = photoreal.camera((72, 72))
    # Reflectance in place of light: the same geometry, without mirrored things that move by themselves.
    scene, _ = photoreal.build(mi, name, camera, 0)
    colours = mi.load_dict({"type": "aov", "aovs": "colour:albedo"})
    views = np.zeros((3, 3, 72, 72, 3), np.float32)
    for v, u in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)):
        sensor = mi.load_dict(photoreal.sensor_of(mi, camera, (u, v), 25))
        views[1 + v, 1 + u] = np.asarray(mi.render(scene, sensor=sensor, integrator=colours, spp=25))[
            ..., -3:
        ]
    mirror = views.max(axis=(0, 1, 4)) > 1  # metal has no colour of its own, only what it mirrors
    truth = camera.depth_to_disparity(photoreal.trace(mi, scene, camera)).astype(np.float32)
    pure = LightField(views.clip(0, 1), truth=truth)
    away = away_from_edges(pure, 1) & (distance_transform_edt(~mirror) > 5)
    assert away.sum() > 400
    offsets = np.array([-0.3, -0.15, 0, 0.15, 0.3], np.float32)
    errors = [
        np.mean(
            [warp_error(pure, truth + by, v, u)[away].mean() for v, u in ((0, 1), (0, -1), (1, 0), (-1, 0))]
        )
        for by in offsets
    ]
    square, linear, _ = np.polyfit(offsets, np.square(errors), 2)
    assert abs(-linear / (2 * square)) < 0.02  # where the error is least, in px from the truth


def test_noise_of_path_tracing_is_what_the_documentation_says() -> None:
    mi = pytest.importorskip("mitsuba", reason="needs the extra `render`")
    mi.set_variant("scalar_rgb")
    camera = photoreal.camera((40, 40))
    scene, _ = photoreal.build(mi, "photo-boxes", camera, 0)
    rough, fine = (
        photoreal._encoded(photoreal._light(mi, scene, camera, (1, 0), samples, samples))
        for samples in (3, 15)
    )
    assert (rough - fine).std() == pytest.approx(4, abs=1)  # grey levels


def test_path_tracing_tells_how_far_it_is_and_how_long_it_takes() -> None:
    pytest.importorskip("mitsuba", reason="needs the extra `render`")
    steps: list[tuple[int, int]] = []
    photoreal.render("photo-boxes", (32, 32), (3, 3), 0, None, 1, lambda i, n, what: steps.append((i, n)))
    assert steps == [(i, 9) for i in range(9)]
    seconds = scenes.expected_seconds("photo-boxes", size=64, views=3)
    assert seconds is not None
    assert 0.05 < seconds < 60
    assert scenes.expected_seconds("bars") is None


def test_path_traced_floor_is_where_it_was_put() -> None:
    pytest.importorskip("mitsuba", reason="needs the extra `render`")
    lf = scenes.render("photo-gloss", size=64, views=3, samples=1)
    assert lf.camera is not None
    floor = lf.camera.points(truth_of(lf))[..., 1] > 1.099
    assert floor.mean() > 0.03
    y = np.broadcast_to(np.arange(64)[:, None], (64, 64))[floor]
    depth = 1.1 / ((y - 31.5) * lf.camera.pixel_pitch_mm / lf.camera.focal_length_mm)
    np.testing.assert_allclose(truth_of(lf)[floor], lf.camera.depth_to_disparity(depth), atol=0.01)
    assert lf.masks["slanted"][floor].all()
    assert (lf.masks["slanted"] ^ lf.masks["smooth"]).all()
    jump = masks.jumps(truth_of(lf), lf.masks["smooth"].astype(np.int16))
    assert lf.masks["occlusion_boundary"][jump].all()
