"""Brightness that differs between views: what is found against what was put in, and the map against truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided

import lfdepth
from lfdepth import scenes
from lfdepth.engines import engine
from lfdepth.lightfield import LightField
from lfdepth.scenes.cameras import Imperfections, spoil, unspoil

NOISE = 0.002
TOGETHER = Imperfections(
    gain=0.1, offset=0.02, white_balance=0.05, falloff=0.6, vignetting=0.7, wandering=0.3, noise=NOISE
)


@pytest.fixture(scope="module")
def leaves() -> LightField:
    return scenes.render("leaves", size=128, views=9, seed=3, samples=2)


@pytest.fixture(scope="module")
def clean() -> dict[str, float]:
    """Bad pixels of each method where all views are equally bright, once they are known."""
    return {}


@pytest.fixture(scope="module")
def usual(leaves: LightField) -> float:
    """Bad pixels of the default method where all views are equally bright."""
    return bad_pixels(spoil(leaves, Imperfections(noise=NOISE)), "fbs-vis", equalise=False)


def bad_pixels(lf: LightField, method: str, *, equalise: bool = True) -> float:
    assert lf.truth is not None
    found = lfdepth.estimate(lf, method, equalise=equalise, threads=2).disparity
    return 100 * float((np.abs(found - lf.truth)[15:-15, 15:-15] > 0.07).mean())


@pytest.mark.thin(3)
@pytest.mark.parametrize("name", scenes.NAMES)
@pytest.mark.parametrize(
    ("size", "views", "seed"), [pytest.param(128, 9, 3, marks=pytest.mark.slow), (96, 5, 1)]
)
def test_views_that_agree_stay_the_very_same(name: str, size: int, views: int, seed: int) -> None:
    lf = scenes.render(name, size=size, views=views, seed=seed, samples=2)
    assert lfdepth.equalise(lf, lfdepth.measure_brightness(lf)) is lf


def test_nothing_is_read_from_arrays_that_are_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy's einsum reads an element of them all the same, whatever the memory happens to hold."""
    lf = scenes.render("bars", size=80, views=5, seed=1, samples=2)
    for each in (lf, spoil(lf, Imperfections(gain=0.05, vignetting=0.7))):
        expected = lfdepth.measure_brightness(each)
        with monkeypatch.context() as patched:
            patched.setattr(np, "einsum", partial(_without_elements, np.einsum))
            found = lfdepth.measure_brightness(each)
        np.testing.assert_array_equal(found.gain, expected.gain)
        np.testing.assert_array_equal(found.shading, expected.shading)


def _without_elements(einsum: Callable[..., Any], subscripts: str, *operands: Any, **options: Any) -> Any:
    """`einsum`, the memory of arrays that were made empty being that of a NaN."""
    nan = np.full(1, np.nan, np.float32)
    made = [each.size == 0 and each.base is None for each in operands]
    held = [
        as_strided(nan, each.shape, each.strides) if empty else each
        for each, empty in zip(operands, made, strict=True)
    ]
    return einsum(subscripts, *held, **options)


@pytest.mark.parametrize("name", ["cotton", "backgammon"])
def test_real_views_that_agree_stay_the_very_same(name: str, data_folder: Path) -> None:
    lf = lfdepth.read(data_folder / "hci4d" / name)
    assert lfdepth.equalise(lf, lfdepth.measure_brightness(lf)) is lf


def test_gains_are_found(leaves: LightField) -> None:
    rng = np.random.default_rng(0)
    gain = 1 + 0.05 * rng.standard_normal((9, 9, 3))
    gain[4, 4] = 1
    views = np.clip(leaves.views * gain[:, :, None, None], 0, 255)
    found = lfdepth.measure_brightness(replace(leaves, views=np.rint(views).astype(np.uint8)))
    assert found.needed
    np.testing.assert_allclose(found.gain, gain, atol=0.007)
    assert not found.offset.any()
    assert not found.shading.any()


def test_gains_of_channels_and_offsets_are_found(leaves: LightField) -> None:
    rng = np.random.default_rng(0)
    offset = 0.02 * rng.standard_normal((9, 9))
    offset[4, 4] = 0
    views = np.clip(leaves.views + 255 * offset[:, :, None, None, None], 0, 255)
    found = lfdepth.measure_brightness(replace(leaves, views=np.rint(views).astype(np.uint8)))
    error = found.offset.mean(axis=-1) - offset
    assert np.sqrt((error**2).mean()) < 0.0045


@pytest.mark.parametrize(
    ("name", "size", "seed", "limit"),
    [("leaves", 96, 1, 0.0015), pytest.param("fence", 192, 3, 0.0025, marks=pytest.mark.slow)],
)
def test_offsets_are_found_where_they_hardly_lessen_what_is_left(
    name: str, size: int, seed: int, limit: float
) -> None:
    """Two halves of the picture find the same ones. As gains they would leave up to 0.8 % of full scale."""
    lf = scenes.render(name, size=size, views=9, seed=seed, samples=2)
    spoiled = spoil(lf, Imperfections(offset=0.02, noise=NOISE))
    found = lfdepth.measure_brightness(spoiled)
    assert found.offset.any()
    mended = lfdepth.equalise(spoiled, found).views / 65535
    error = (mended - lf.views / 255).mean(axis=(2, 3, 4))
    assert np.sqrt((error**2).mean()) < limit
    without = (spoiled.views / 255.0 - lf.views / 255).mean(axis=(2, 3, 4))
    assert np.sqrt((without**2).mean()) > 0.015


def test_small_views_that_differ_are_told_from_others() -> None:
    """Views under 64 px are not equalised, but it is said that they differ."""
    for number, name in enumerate(scenes.NAMES):
        size, views = ((32, 5), (48, 3), (60, 5))[number % 3]
        lf = scenes.render(name, size=size, views=views, seed=number, samples=1)
        found = lfdepth.measure_brightness(lf)
        assert found.suspected == 0, name
        assert not found.left_out.any(), name
        for case in (Imperfections(gain=0.05, noise=NOISE), Imperfections(falloff=0.75, noise=NOISE)):
            assert 0.02 < lfdepth.measure_brightness(spoil(lf, case)).suspected < 0.27, name


def test_small_views_that_differ_warn() -> None:
    lf = scenes.render("leaves", size=48, views=9, seed=3, samples=2)
    spoiled = spoil(lf, Imperfections(gain=0.05, noise=NOISE))
    found = lfdepth.measure_brightness(spoiled)
    assert abs(found.suspected - 0.05) < 0.01
    assert "not equalised" in found.message
    checks = lfdepth.estimate(spoiled, "fbs", threads=1).checks
    assert checks is not None
    assert any("brightness seems to differ" in words for words in checks.warnings)
    assert lfdepth.estimate(lf, "fbs", threads=1).checks.warnings == ()  # type: ignore[union-attr]


def test_small_views_that_are_dark_are_left_out() -> None:
    lf = scenes.render("leaves", size=48, views=5, seed=3, samples=2)
    views = lf.views.copy()
    views[0, 0] = 1
    found = lfdepth.measure_brightness(replace(lf, views=views))
    assert np.argwhere(found.left_out).tolist() == [[0, 0]]
    assert found.suspected == 0


def test_equalised_views_are_what_they_would_have_been(leaves: LightField) -> None:
    spoiled = spoil(leaves, Imperfections(gain=0.1, offset=0.02, white_balance=0.05, falloff=0.6))
    mended = lfdepth.equalise(spoiled, lfdepth.measure_brightness(spoiled))
    intact = (spoiled.views > 0) & (spoiled.views < 255)
    error = (mended.views / 65535 - leaves.views / 255)[intact]
    assert np.sqrt((error**2).mean()) < 0.004
    assert np.sqrt(((spoiled.views - leaves.views.astype(float))[intact] ** 2).mean()) / 255 > 0.07


def test_samples_keep_their_kind(leaves: LightField) -> None:
    """8 bits become 16, so that rounding adds nothing; the same levels mean the same in all of them."""
    spoiled = spoil(leaves, Imperfections(gain=0.1))
    found = lfdepth.measure_brightness(spoiled)
    levels = {}
    for dtype in ("uint8", "uint16", "float32"):
        mended = lfdepth.equalise(spoiled.with_samples(dtype), found)
        assert mended.views.dtype == ("uint16" if dtype == "uint8" else dtype)
        levels[dtype] = mended.views / mended.full_scale
    np.testing.assert_allclose(levels["uint8"], levels["uint16"], atol=1.6e-5)
    np.testing.assert_allclose(levels["uint8"], levels["float32"], atol=2e-5)


@pytest.mark.thin(4)
@pytest.mark.parametrize(
    ("case", "method"),
    [
        (Imperfections(gain=0.1, noise=NOISE), "fbs-vis"),
        (Imperfections(vignetting=0.7, noise=NOISE), "fbs-vis"),
        (Imperfections(vignetting=0.7, wandering=0.5, noise=NOISE), "fbs-vis"),
        (TOGETHER, "fbs-vis"),
        (Imperfections(gain=0.1, noise=NOISE), "fbs-sfa"),
        (Imperfections(gain=0.1, noise=NOISE), "fbs"),
        (Imperfections(gain=0.1, noise=NOISE), "fbsocc-sfa"),
    ],
)
def test_the_map_is_as_good_as_with_equal_brightness(
    case: Imperfections, method: str, leaves: LightField, clean: dict[str, float]
) -> None:
    if method not in clean:
        clean[method] = bad_pixels(spoil(leaves, Imperfections(noise=NOISE)), method, equalise=False)
    assert bad_pixels(spoil(leaves, case), method) < 1.25 * clean[method]


def test_without_it_the_map_is_lost(leaves: LightField) -> None:
    """Else the tests above would show nothing."""
    assert bad_pixels(spoil(leaves, Imperfections(gain=0.1)), "fbs-vis", equalise=False) > 30


@pytest.mark.thin(2)
@pytest.mark.parametrize("name", ["leaves", "range-4", "fence", "noise-2"])
def test_the_range_is_found(name: str) -> None:
    lf = scenes.render(name, size=128, views=9, seed=3, samples=2)
    assert lf.truth is not None
    spoiled = replace(spoil(lf, TOGETHER), disparity_range=None)
    low, high = lfdepth.estimate(spoiled, "fbs", step=None, planes=3).range
    assert abs(low - lf.truth.min()) < 0.3
    assert abs(high - lf.truth.max()) < 0.3


def test_dark_views_are_left_out(data_folder: Path) -> None:
    """The outer views of a plenoptic camera lie beyond the main lens's aperture."""
    lf = lfdepth.read(data_folder / "lytro_bikes_crop_eslf.png", views=(13, 13))
    full = replace(lf, present=None)
    found = lfdepth.measure_brightness(full)
    mean = full.views.mean(axis=(2, 3, 4)) / full.reference.mean()
    assert found.left_out[mean < 0.2].all()
    assert not found.left_out[mean > 0.6].any()
    mended = lfdepth.equalise(full, found)
    assert mended.present is not None
    np.testing.assert_array_equal(mended.present, ~found.left_out)


def test_empty_views_are_left_out(leaves: LightField) -> None:
    views = leaves.views.copy()
    for corner in ((0, 0), (0, 8), (8, 0), (8, 8)):
        views[corner] = 0
    found = lfdepth.measure_brightness(replace(leaves, views=views))
    assert found.left_out.sum() == 4
    assert found.left_out[[0, 0, 8, 8], [0, 8, 0, 8]].all()
    assert "4 dark" in found.message


@pytest.mark.parametrize(("idle", "level"), [((0, 2), 0), ((2,), 0), ((0,), 255)])
def test_channels_that_tell_nothing_are_left_alone(
    leaves: LightField, idle: tuple[int, ...], level: int
) -> None:
    rng = np.random.default_rng(0)
    gain = 1 + 0.05 * rng.standard_normal((9, 9, 1))
    gain[4, 4] = 1
    views = np.rint(np.clip(leaves.views * gain[:, :, None, None], 0, 255)).astype(np.uint8)
    views[..., idle] = level
    found = lfdepth.measure_brightness(replace(leaves, views=views))
    assert not found.left_out.any()
    others = [c for c in range(3) if c not in idle]
    np.testing.assert_allclose(found.gain[..., others], np.repeat(gain, len(others), axis=2), atol=0.01)
    even = lfdepth.equalise(replace(leaves, views=views), found)
    assert (even.views[..., idle] == level * even.full_scale / 255).all()


def test_a_picture_with_hardly_a_sample_that_tells_leaves_no_view_out(leaves: LightField) -> None:
    stars = np.where(leaves.views.max(axis=-1, keepdims=True) > 250, leaves.views, 0)
    found = lfdepth.measure_brightness(replace(leaves, views=stars))
    assert not found.needed
    assert not found.left_out.any()


def test_absent_views_are_not_looked_at(leaves: LightField) -> None:
    present = np.ones((9, 9), np.bool_)
    present[0] = False
    rest = np.where(present[:, :, None, None, None], leaves.views, 0)
    lf = replace(leaves, views=rest, present=present)
    found = lfdepth.measure_brightness(lf)
    assert not found.left_out.any()
    assert lfdepth.equalise(lf, found) is lf


def test_clipped_pixels_are_not_looked_at(leaves: LightField) -> None:
    views = leaves.views.astype(float)
    views[..., 20:60, :, :] = views[..., 20:60, :, :] * 3  # a bright band, white in the brighter views
    gain = np.linspace(0.8, 1.2, 9)[:, None, None, None, None]
    spoiled = np.rint(np.clip(views * gain / gain[4], 0, 255)).astype(np.uint8)
    found = lfdepth.measure_brightness(replace(leaves, views=spoiled))
    np.testing.assert_allclose(found.gain[:, 4, 1], gain.ravel() / gain.ravel()[4], rtol=0.01)


def test_without_texture_nothing_is_changed() -> None:
    lf = LightField(np.full((5, 5, 64, 64, 3), 90, np.uint8))
    found = lfdepth.measure_brightness(lf)
    assert found.samples == 0
    assert lfdepth.equalise(lf, found) is lf


def test_the_number_of_threads_makes_no_difference(leaves: LightField) -> None:
    spoiled = spoil(leaves, TOGETHER)
    one, two = (lfdepth.measure_brightness(spoiled, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.gain, two.gain)
    np.testing.assert_array_equal(one.shading, two.shading)


def test_windows_are_averaged_alike_by_both_engines(leaves: LightField) -> None:
    rng = np.random.default_rng(0)
    present = rng.random((9, 9)) > 0.2
    present[4, 4] = True
    lf = replace(leaves, present=present)
    points = rng.integers(3, 125, (60, 2))
    disparity = rng.uniform(-2, 2, 60)
    fast, plain = (
        used.window_means(used.views(lf), points, disparity, 2)
        for used in (engine("cpu", threads=1), engine("numpy"))
    )
    np.testing.assert_allclose(fast[0], plain[0], atol=1e-3)
    np.testing.assert_array_equal(fast[1], plain[1])


def test_vignetting_is_found_that_falls_as_a_real_lens_does(leaves: LightField) -> None:
    """cos⁴ of the angle to the axis, as far as 70 % in the corners, whose middle moves from view to view."""
    y, x = np.meshgrid(np.linspace(-1, 1, leaves.height), np.linspace(-1, 1, leaves.width), indexing="ij")
    squared = 0.7**-0.5 - 1  # of the tangent of the angle in the corners
    rng = np.random.default_rng(0)
    factor = np.empty((*leaves.shape[:2], leaves.height, leaves.width))
    for v, u in np.ndindex(9, 9):
        away = ((y - 0.05 * (v - 4)) ** 2 + (x - 0.05 * (u - 4)) ** 2) / 2
        factor[v, u] = (1 + squared * away) ** -2
    values = leaves.views * factor[..., None] + 255 * NOISE * rng.standard_normal(leaves.shape)
    spoiled = replace(leaves, views=np.rint(np.clip(values, 0, 255)).astype(np.uint8))
    mended = lfdepth.equalise(spoiled, lfdepth.measure_brightness(spoiled)).views / 65535
    ratio = _blocks(mended) / _blocks(leaves.views / 255)
    off = ratio / ratio[4, 4] - 1
    assert np.sqrt((off**2).mean()) < 0.006
    without = _blocks(spoiled.views / 255) / _blocks(leaves.views / 255)
    assert np.sqrt(((without / without[4, 4] - 1) ** 2).mean()) > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("name", ["demo", "leaves"])
@pytest.mark.parametrize(
    "case", [Imperfections(vignetting=0.7, wandering=0.5, noise=NOISE), TOGETHER], ids=["wandering", "all"]
)
def test_what_is_left_of_shading(name: str, case: Imperfections) -> None:
    lf = scenes.render(name, size=192, views=9, seed=3, samples=1)
    spoiled = spoil(lf, case)
    mended = lfdepth.equalise(spoiled, lfdepth.measure_brightness(spoiled)).views / 65535
    ratio = _blocks(mended) / _blocks(unspoil(spoiled, case).views / 65535)
    assert np.sqrt(((ratio / ratio[4, 4] - 1) ** 2).mean()) < 0.0009


def _blocks(views: Any) -> Any:
    """Means of 16×16 px of every view."""
    v, u, height, width, channels = views.shape
    return views.reshape(v, u, height // 16, 16, width // 16, 16, channels).mean(axis=(3, 5, 6))


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        Imperfections(white_balance=0.05, noise=NOISE),
        Imperfections(falloff=0.95, noise=NOISE),
        Imperfections(falloff=0.8, noise=NOISE),
        Imperfections(falloff=0.6, noise=NOISE),
        Imperfections(offset=0.02, noise=NOISE),
        Imperfections(gain=0.05, vignetting=0.7, noise=NOISE),
    ],
)
def test_each_difference_alone(case: Imperfections, leaves: LightField, usual: float) -> None:
    assert bad_pixels(spoil(leaves, case), "fbs-vis") < 1.25 * usual
