"""Maps of all views against the truth of each, and of one other view."""

from __future__ import annotations

import errno
import shutil
import tracemalloc
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lfdepth
from lfdepth import scenes
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity
from lfdepth.lightfield import LightField
from lfdepth.result import ViewMaps
from lfdepth.scale import look as scale_look
from lfdepth.scale import views as scale_views
from lfdepth.scale.scratch import Scratch
from lfdepth.scale.views import consistency, estimate_views, estimate_views_to, outermost_views

SIZE, GRID = 96, 5
FAST: dict[str, Any] = {"threads": 1, "check": False, "effort": "fast"}


@cache
def scene(name: str = "leaves") -> LightField:
    return scenes.render(name, size=SIZE, views=GRID)


@cache
def truth(name: str = "leaves") -> Any:
    return scenes.truth_of_views(name, size=SIZE, views=GRID)


@cache
def maps(name: str = "leaves") -> ViewMaps:
    return estimate_views(scene(name), **FAST)


def bad(disparity: Any, expected: Any) -> float:
    return 100 * float(np.mean(np.abs(disparity - expected) > 0.07))


# Truth


def test_truths_of_all_views_hold_in_each_other() -> None:
    """A law: what one view shows is where the others show it, unless something nearer is there."""
    own = scene().truth
    assert own is not None
    np.testing.assert_array_equal(truth()[2, 2], own)
    assert consistency(truth(), scene()) > 0.999


def test_a_slanted_plane_has_its_closed_form_in_every_view() -> None:
    """D = a + b·x in the reference view is D = (a + b·x) / (1 − b·u) in view u."""
    from lfdepth.scenes.model import Layer as SceneLayer
    from lfdepth.scenes.model import Paint, Plane, Scene
    from lfdepth.scenes.rendering import truths

    a, b = 0.4, 0.02
    paint = Paint(np.zeros((4, 4, 3), np.float32))
    found = truths(Scene([SceneLayer(Plane(a, along_x=b), paint)]), (6, 12), (3, 5))
    x, u = np.arange(12), np.arange(-2, 3)[:, None, None]
    np.testing.assert_allclose(found[1], np.broadcast_to((a + b * x) / (1 - b * u), (5, 6, 12)), atol=1e-6)


# One other view


def test_another_view_is_estimated_as_well_as_its_place_allows() -> None:
    lf = lfdepth.from_view(scene(), (2, 3))
    assert lf.shape[:2] == (5, 7)
    assert lf.centre == (2, 3)
    np.testing.assert_array_equal(lf.reference, scene().views[2, 3])
    found = lfdepth.estimate(lf, **FAST).disparity
    assert bad(found, truth()[2, 3]) < 11.5  # 9.2 in the reference view


def test_the_reference_view_is_what_it_was() -> None:
    assert lfdepth.from_view(scene(), (2, 2)) is scene()


def test_views_off_the_grid_stay_where_they_are() -> None:
    rng = np.random.default_rng(0)
    positions = rng.uniform(-0.2, 0.2, (5, 5, 2))
    positions[2, 2] = 0
    from dataclasses import replace

    lf = replace(scene(), positions=positions)
    seen = lfdepth.from_view(lf, (0, 4))
    expected = lf.offsets - lf.offsets[0, 4]
    np.testing.assert_allclose(seen.offsets[seen.available].reshape(5, 5, 2), expected)


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ((5, 0), r"view 5,0 asked for; expected a row from 0 to 4 and a column from 0 to 4; .* view is 2,2"),
        ((0, -1), r"view 0,-1 asked for"),
        ((0, 1), r"view 0,1 is absent; expected one that exists"),
    ],
)
def test_views_that_are_not_there_are_refused(view: tuple[int, int], message: str) -> None:
    lf = scene()
    present = np.ones((5, 5), np.bool_)
    present[0, 1] = False
    some = LightField(lf.views, present=present)
    with pytest.raises(LightFieldError, match=message):
        lfdepth.from_view(some, view)


# All views


def test_all_views_are_nearly_as_good_as_the_reference_view() -> None:
    """At most 1.3 times as many bad pixels in the typical view; measured: 1.01."""
    errors = [bad(maps().disparity[at], truth()[at]) for at in np.ndindex(GRID, GRID)]
    reference = bad(maps().reference.disparity, scene().truth)
    assert np.mean(errors) < 1.15 * reference
    assert max(errors) < 1.5 * reference


def test_views_agree_with_each_other() -> None:
    """More than views that are estimated apart, of which 99.2 % of the pixels hold."""
    assert maps().consistency > 0.995
    assert consistency(maps().disparity, scene()) > 0.995


def test_what_the_reference_view_shows_is_told() -> None:
    visible = maps().visible
    assert visible[2, 2].all()
    assert 0.5 < visible[0, 0].mean() < 0.97  # a border, and what is hidden
    assert maps().confidence.min() >= 0
    assert maps().confidence.max() <= 1


def test_absent_views_have_no_map() -> None:
    lf = scenes.render("bars", size=48, views=(3, 5))
    present = np.ones((3, 5), np.bool_)
    present[0, 0] = present[1, 4] = False
    found = estimate_views(LightField(lf.views, present=present, disparity_range=lf.disparity_range), **FAST)
    np.testing.assert_array_equal(np.isfinite(found.disparity).all(axis=(2, 3)), present)
    assert not found.confidence[~present].any()
    assert outermost_views(LightField(lf.views, present=present)) == [(0, 1), (0, 4), (2, 0), (2, 4)]


def test_too_many_maps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale_views, "available_memory", lambda: 10_000_000 // 5)
    with pytest.raises(
        LightFieldError, match=r"maps of all 25 views need .* enough memory; write them one by one"
    ):
        estimate_views(scene(), **FAST)


# Files


def _zarr(path: Path) -> Any:
    return pytest.importorskip("zarr").open_group(str(path), mode="r")["disparity"][...]


def _folder(path: Path) -> Any:
    shape = maps().disparity.shape[:2]
    return np.array(
        [[read_disparity(path / f"disparity_v{v:02d}_u{u:02d}.pfm") for u in range(5)] for v in range(5)]
    ).reshape(*shape, SIZE, SIZE)


@pytest.mark.parametrize(
    ("name", "read"),
    [("a.npz", lambda path: np.load(path)["disparity"]), ("a.zarr", _zarr), ("a", _folder)],
)
def test_maps_are_read_back_as_they_were(name: str, read: Callable[[Path], Any], tmp_path: Path) -> None:
    lfdepth.write(tmp_path / name, maps())
    lfdepth.write(tmp_path / name, maps())  # over what it wrote itself
    np.testing.assert_array_equal(read(tmp_path / name), maps().disparity)


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match=r"\.npz or \.zarr, or a folder, without ending"):
        lfdepth.write(tmp_path / "a.pfm", maps())


# Written one by one

QUICK: dict[str, Any] = {"threads": 1, "check": False, "method": "fbs-sfa", "planes": 12}


@cache
def holed() -> LightField:
    """A light field without two of its views."""
    lf = scenes.render("bars", size=48, views=(3, 5))
    present = np.ones((3, 5), np.bool_)
    present[0, 0] = present[1, 4] = False
    return LightField(lf.views, present=present, disparity_range=lf.disparity_range)


@pytest.mark.parametrize("name", ["a.npz", "a.zarr", "a"])
def test_maps_that_are_written_one_by_one_are_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracle is the road through memory: the same bits, with bands of rows that cut everything."""
    whole = estimate_views(holed(), **QUICK)
    monkeypatch.setattr(scale_views, "_BAND_BYTES", 0)
    monkeypatch.setattr(scale_views, "_LEAST_ROWS", 7)
    made = estimate_views_to(holed(), tmp_path / name, **QUICK)
    assert made.consistency == whole.consistency
    assert [path.name for path in tmp_path.iterdir()] == [name]
    lfdepth.write(tmp_path / f"b{name[1:]}", whole)
    found, expected = (_all_arrays(tmp_path / each) for each in (name, f"b{name[1:]}"))
    assert sorted(found) == sorted(expected)
    assert len(found) == (26 if name == "a" else 3)  # files of disparity and confidence for each of 13 views
    for key, array in expected.items():
        assert found[key].dtype == array.dtype
        np.testing.assert_array_equal(found[key], array)
    if name != "a":
        np.testing.assert_array_equal(found["disparity"], whole.disparity)
        np.testing.assert_array_equal(found["visible"], whole.visible)


def _all_arrays(path: Path) -> dict[str, Any]:
    if path.suffix == ".npz":
        with np.load(path) as file:
            return {key: array for key, array in file.items() if array.ndim == 4}
    if path.suffix == ".zarr":
        group = pytest.importorskip("zarr").open_group(str(path), mode="r")
        assert group.attrs["unit"] == "px per view step"
        return {key: group[key][...] for key in ("disparity", "confidence", "visible")}
    return {each.name: read_disparity(each) for each in path.glob("*.pfm")}


@pytest.mark.parametrize("name", ["a.npz", "a.zarr", "a"])
def test_a_full_disk_is_named_and_nothing_stays(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    lfdepth.write(tmp_path / name, estimate_views(holed(), **QUICK))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    monkeypatch.setattr("lfdepth.scale.scratch._Filed.put", full)
    with pytest.raises(LightFieldError, match=rf"{name}: cannot be written \(No space left on device\)"):
        estimate_views_to(holed(), tmp_path / name, **QUICK)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_what_is_interrupted_leaves_nothing(tmp_path: Path) -> None:
    def stop(_done: int, _total: int, what: str) -> None:
        if what == "agreement":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_views_to(holed(), tmp_path / "a.npz", progress=stop, **QUICK)
    assert not list(tmp_path.iterdir())


def test_memory_is_what_is_reckoned_with(tmp_path: Path) -> None:
    """From the first splat on: `_KEPT` bytes for each pixel and view, or `_AT_ONCE` for each pixel alone."""
    lf = scene()

    def follow(done: int, _total: int, _what: str) -> None:
        if done == 2:  # anchors are among what is counted
            tracemalloc.start()
        elif done == 6:
            tracemalloc.reset_peak()

    peaks = []
    for estimated in (estimate_views, partial(estimate_views_to, out=tmp_path / "a")):
        try:
            made = estimated(lf, **QUICK, progress=follow)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        del made
    kept, at_once = (scale_views._KEPT * SIZE**2 * GRID**2, scale_views._AT_ONCE * SIZE**2)
    assert 0.8 * kept < peaks[0] < kept + at_once
    assert 0.8 * at_once < peaks[1] < at_once


def test_memory_of_what_was_looked_at_is_given_back(tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil")
    resident = psutil.Process().memory_info
    if not hasattr(__import__("mmap").mmap, "madvise"):
        pytest.skip("this system does not offer to give memory back")
    with Scratch(tmp_path) as scratch:
        maps = scratch.maps((60, 500, 500), np.float32)
        for index in range(60):
            maps.put(index, np.full((500, 500), index, np.float32))
        before = resident().rss
        assert maps.whole().sum(dtype=np.float64) == 500 * 500 * sum(range(60))
        looked_at = resident().rss - before
        assert looked_at > 50e6  # of 60 MB
        maps.let_go()
        assert resident().rss - before < 0.2 * looked_at
        assert maps.whole()[59, 499, 499] == 59
    assert not list(tmp_path.iterdir())


# The command line


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "scene.npz"
    lfdepth.write(path, scenes.render("bars", size=48, views=3))
    return path


def test_all_views_from_the_command_line(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = saved.with_name("all.npz")
    words = ["estimate", str(saved), "-o", str(out), "--all-views", "--effort", "fast", "--threads", "1"]
    assert main(words) == 0
    assert "of the pixels hold in the views they were compared with" in capsys.readouterr().out
    assert np.load(out)["disparity"].shape == (3, 3, 48, 48)


def test_what_does_not_fit_is_refused_before_views_are_read(
    saved: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """17x17 views of 2048x2048 px in 8 bits are 3.64 GB, read and copied; maps need 289 · 2048² · 34."""
    shape = (17, 17, 2048, 2048, 3)
    words = ["estimate", str(saved), "-o", str(saved.with_name("all.zarr")), "--all-views"]
    monkeypatch.setattr(scale_look, "look", lambda *_: scale_look.Look(shape, 1, None, None))
    monkeypatch.setattr(scale_views, "available_memory", lambda: 7_000_000_000)
    monkeypatch.setattr(lfdepth, "read", lambda *_, **__: pytest.fail("views were read"))
    assert main(words) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1
    assert "289 views, and the maps of a few, need 8.1 GB, 7 GB are free; expected enough memory" in error[0]
    monkeypatch.setattr(scale_views, "available_memory", lambda: 9_000_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 31_000_000_000))
    assert main(words) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1
    assert "maps of all 289 views" in error[0]
    assert "need 41 GB of disk while they are made, 31 GB are free; expected enough room" in error[0]


def test_one_view_from_the_command_line(saved: Path) -> None:
    out = saved.with_name("one.pfm")
    words = ["estimate", str(saved), "-o", str(out), "--view", "0,2", "--effort", "fast", "--threads", "1"]
    assert main(words) == 0
    lf = lfdepth.from_view(lfdepth.read(saved), (0, 2))
    expected = lfdepth.estimate(lf, threads=1, effort="fast").disparity
    np.testing.assert_array_equal(read_disparity(out), expected)


def test_one_view_of_all_from_the_command_line(saved: Path) -> None:
    """By the road of all views: the map that the view has among theirs."""
    out = saved.with_name("one.pfm")
    words = ["estimate", str(saved), "-o", str(out), "--view", "0,2", "--all-views", "--effort", "fast"]
    assert main([*words, "--threads", "1"]) == 0
    expected = lfdepth.estimate_views(lfdepth.read(saved), threads=1, effort="fast").disparity[0, 2]
    np.testing.assert_array_equal(read_disparity(out), expected)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.pfm", "--view", "7,0"], "view 7,0 asked for; expected a row from 0 to 2"),
        (["-o", "a.pfm", "--view", "7"], "expected V,U (row and column from 0)"),
        (["-o", "a.pfm", "--all-views"], "expected a name ending in .npz or .zarr, or a folder"),
        (["-o", "a.npz", "--all-views", "--view", "0,7"], "view 0,7 asked for; expected a row from 0 to 2"),
        (["-o", "a.npz", "--all-views", "--quantity", "depth"], "--quantity: found with --all-views"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(
    words: list[str], message: str, saved: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.chdir(saved.parent)
    assert main(["estimate", str(saved), *words]) == 2
    error = capsys.readouterr().err.replace("compiling kernels (first run only)\n", "").splitlines()
    assert len(error) == 1
    assert message in error[0]
