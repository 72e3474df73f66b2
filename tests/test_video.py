"""Videos: where frames come from, maps that keep still where the scene does, breaks, and what fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import lfdepth
from lfdepth import scenes
from lfdepth.blocks.steady import Past, changed, reference_of, steady
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.probe.brightness import measure_brightness
from lfdepth.scale.frames import find_frames

FAST: dict[str, Any] = {"effort": "fast", "gloss": False, "step": 0.14, "threads": 1}
SIZE: dict[str, Any] = {"size": 64, "views": 5, "noise": 4.0}
RANGE = (-1.5, 1.8)


def stored(path: Path, frames: list[LightField]) -> Path:
    """The views of all frames as one array with a time axis."""
    np.save(path, np.stack([lf.views for lf in frames]))
    return path


def maps_of(folder: Path) -> NDArray[np.float32]:
    return np.stack([lfdepth.io.read_disparity(each) for each in sorted(folder.glob("frame-*.npz"))])


def files_of(folder: Path) -> dict[str, bytes]:
    names = [*folder.glob("frame-*.npz"), folder / "preview.webp"]
    return {each.name: each.read_bytes() for each in names}


def flicker(maps: NDArray[np.float32]) -> float:
    return float(np.abs(np.diff(maps, axis=0)).mean())


def truth_of(lf: LightField) -> NDArray[np.float32]:
    assert lf.truth is not None
    return lf.truth


def errors(maps: NDArray[np.float32], frames: list[LightField]) -> NDArray[np.float32]:
    return np.abs(maps - np.stack([truth_of(lf) for lf in frames]))


def error(maps: NDArray[np.float32], frames: list[LightField]) -> float:
    return float(errors(maps, frames).mean())


def bad(maps: NDArray[np.float32], frames: list[LightField]) -> float:
    return float((errors(maps, frames) > 0.07).mean())


class Made:
    """A video, and its maps frame by frame and steadied."""

    def __init__(self, folder: Path, **kind: Any) -> None:
        self.frames = list(scenes.video(**kind, **SIZE))
        path = stored(folder / "video.npy", self.frames)
        self.done = lfdepth.estimate_video(
            path, folder / "maps", stabilise=True, range=RANGE, equalise=False, **FAST
        )
        self.steady = maps_of(folder / "maps")
        alone = {"range": RANGE, "check": False, "equalise": False, **FAST}
        self.apart = np.stack(
            [lfdepth.estimate(LightField(lf.views), **alone).disparity for lf in self.frames]
        )


@pytest.fixture(scope="module")
def resting(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("resting"), frames=4, motion=0)


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("moving"), frames=3, motion=3, cut=2)


# What is promised of stabilised maps


def test_a_scene_that_rests_flickers_less_than_half(resting: Made) -> None:
    assert flicker(resting.apart) > 0.005  # there is something to mend
    assert flicker(resting.steady) <= 0.4 * flicker(resting.apart)
    assert error(resting.steady, resting.frames) <= error(resting.apart, resting.frames)
    assert bad(resting.steady, resting.frames) <= bad(resting.apart, resting.frames)


def test_nothing_is_dragged_by_what_moves_and_over_a_cut(moving: Made) -> None:
    assert error(moving.steady, moving.frames) <= error(moving.apart, moving.frames)
    assert bad(moving.steady, moving.frames) <= bad(moving.apart, moving.frames)
    assert [each.cut for each in moving.done.outcomes] == [True, False, True]
    np.testing.assert_array_equal(moving.steady[2], moving.apart[2])  # nothing of the scene before
    truth = truth_of(moving.frames[1])
    where = np.abs(truth - truth_of(moving.frames[0])) > 0.3  # where the board came or went
    assert where.sum() > 50
    apart, steadied = (np.abs(maps[1] - truth)[where].mean() for maps in (moving.apart, moving.steady))
    assert steadied <= apart + 1e-6


def test_without_stabilising_maps_are_those_of_estimate(moving: Made, tmp_path: Path) -> None:
    path = stored(tmp_path / "one.npy", moving.frames[1:2])
    lfdepth.estimate_video(path, tmp_path / "maps", range=RANGE, **FAST)
    np.testing.assert_array_equal(maps_of(tmp_path / "maps"), moving.apart[1:2])


# The rule itself


def field(level: float) -> LightField:
    """A field without texture: its views support every disparity alike."""
    return LightField(np.full((3, 3, 32, 32, 3), level, np.float32))


def plane(value: float) -> NDArray[np.float32]:
    return np.full((32, 32), value, np.float32)


def carried(maps: list[NDArray[np.float32]], levels: list[float]) -> list[NDArray[np.float32]]:
    past: Past | None = None
    out = []
    for disparity, level in zip(maps, levels, strict=True):
        kept, past = steady(field(level), disparity, plane(1), None, past, 0.01)
        out.append(kept)
    return out


def test_estimates_of_one_surface_give_their_mean() -> None:
    values = [0.50, 0.53, 0.49, 0.55, 0.48]
    kept = carried([plane(value) for value in values], [0.5] * 5)
    for number, each in enumerate(kept, 1):
        np.testing.assert_allclose(each, np.mean(values[:number]), atol=1e-6)


def test_precise_estimates_weigh_more() -> None:
    first, second, even = plane(0.50), plane(0.53), field(0.5)
    _, past = steady(even, first, plane(1), plane(0.3), None, 0.01)
    kept, _ = steady(even, second, plane(1), plane(0.01), past, 0.01)
    assert (kept > 0.525).all()


def test_what_most_frames_say_stays() -> None:
    values = [0.2, 0.2, 1.0, 0.2, 1.0, 0.2]
    assert [float(each.mean()) for each in carried([plane(v) for v in values], [0.5] * 6)] == pytest.approx(
        [0.2] * 6
    )
    # and goes when most frames say something else
    assert carried([plane(v) for v in [0.2, 1, 1, 1, 1]], [0.5] * 5)[-1].mean() == pytest.approx(1)


def test_views_overrule_the_past() -> None:
    frame = scenes.render("bars", size=64, views=5)
    assert frame.truth is not None
    wrong = (frame.truth - 0.6).astype(np.float32)
    certain = np.ones_like(wrong)
    past = Past(wrong, 12 * certain, reference_of(frame))
    kept, _ = steady(frame, frame.truth, certain, None, past, 0.002)
    assert np.mean(np.abs(kept - frame.truth) < 0.01) > 0.7  # elsewhere is no texture


def test_the_past_goes_where_the_picture_changed() -> None:
    kept = carried([plane(0.50), plane(0.56)], [0.5, 0.6])
    np.testing.assert_array_equal(kept[1], plane(0.56))


def test_what_rests_beside_what_moved_keeps_its_mean() -> None:
    """Unless it lies at a disparity of what moved, of which it may be a part that looks as it did."""
    rng = np.random.default_rng(2)
    first, second = (rng.random((1, 1, 48, 48, 3)).astype(np.float32).repeat(3, axis=1) for _ in range(2))
    board, strip = (slice(16, 32), slice(16, 28)), (slice(16, 32), slice(29, 33))
    moved = first.copy()
    moved[:, :, *board] = second[:, :, *board]
    before, after = (np.full((48, 48), value, np.float32) for value in (0.50, 0.53))
    before[board], after[board] = 1.50, 1.56
    before[strip], after[strip] = 1.40, 1.44
    certain = np.ones((48, 48), np.float32)
    _, past = steady(LightField(first), before, certain, None, None, 0.01)
    kept, _ = steady(LightField(moved), after, certain, None, past, 0.01)
    expected = np.full((48, 48), 0.515, np.float32)
    expected[board], expected[strip] = 1.56, 1.44
    beside = np.ones((48, 48), np.bool_)
    beside[15:33, 15:34] = False  # a window of 3x3 px touches the board
    beside[board] = beside[strip] = True
    np.testing.assert_allclose(kept[beside], expected[beside], atol=1e-6)
    assert beside[12:15].all()  # nearer than `spread` and a window: nothing of it counted as resting before


@pytest.mark.slow
@pytest.mark.parametrize("kind", [{}, {"cut": 4}])
def test_a_moving_scene_flickers_less_than_half(tmp_path: Path, kind: dict[str, Any]) -> None:
    """From each frame to the next of its scene, where the truth stays: measured 0.40 and 0.45."""
    made = Made(tmp_path, frames=8, motion=3, **kind)
    truth = np.stack([truth_of(lf) for lf in made.frames])
    rests = np.diff(truth, axis=0) == 0
    rests[[cut - 1 for cut in kind.values()]] = False
    apart, steadied = (np.abs(np.diff(maps, axis=0))[rests].mean() for maps in (made.apart, made.steady))
    assert steadied <= 0.5 * apart
    assert error(made.steady, made.frames) <= error(made.apart, made.frames)
    assert bad(made.steady, made.frames) <= bad(made.apart, made.frames)


def test_change_is_told_from_noise() -> None:
    rng = np.random.default_rng(1)
    sigma = 0.02
    level = 1.13 * sigma  # mean absolute difference of two noisy values
    one, other = (np.float32(0.5) + rng.normal(0, sigma, (96, 96, 3)).astype(np.float32) for _ in range(2))
    assert changed(other, one, level).mean() < 0.002
    other[30:60, 30:60] += np.float32(4 * sigma)
    found = changed(other, one, level)
    assert found[32:58, 32:58].mean() > 0.95
    assert found[:25].mean() < 0.002


# Where frames come from


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[LightField]]:
    """Four small frames, as files in a folder."""
    folder = tmp_path_factory.mktemp("frames")
    frames = list(scenes.video(4, size=48, views=3, motion=2))
    for number, lf in zip((1, 2, 9, 10), frames, strict=True):
        lfdepth.write(folder / f"shot_{number}.npz", lf)
    return folder, frames


def views_of(paths: list[Path]) -> list[NDArray[Any]]:
    return [frame.read(None).views for frame in find_frames(paths, {})]


def test_frames_of_all_kinds_are_the_same(two: tuple[Path, list[LightField]], tmp_path: Path) -> None:
    folder, frames = two
    views = np.stack([lf.views for lf in frames])
    for number, lf in enumerate(frames, 7):
        lfdepth.write(tmp_path / "folders" / f"{number}", lf) if number > 7 else _first(tmp_path, lf)
    np.save(tmp_path / "a.npy", views)
    zarr, h5py = pytest.importorskip("zarr"), pytest.importorskip("h5py")
    zarr.save_array(str(tmp_path / "a.zarr"), views)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["LF"] = views
    paths = [folder / f"shot_{number}.npz" for number in (10, 2, 1)]
    for given in (["a.npy"], ["a.zarr"], ["a.h5"], ["folders"]):
        np.testing.assert_array_equal(views_of([tmp_path / each for each in given]), views)
    with pytest.raises(LightFieldError, match=r"shot_3\.npz: is missing between shot_2"):
        views_of(paths)
    np.testing.assert_array_equal(views_of(paths[1:]), views[:2])  # by number, not as given


def _first(folder: Path, lf: LightField) -> None:
    (folder / "folders").mkdir()
    lfdepth.write(folder / "folders" / "7", lf)


def test_wrong_frames_are_one_line(two: tuple[Path, list[LightField]], tmp_path: Path) -> None:
    folder, frames = two
    np.save(tmp_path / "a.npy", np.stack([lf.views for lf in frames]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(LightFieldError, match="maps: lies in"):
        lfdepth.estimate_video(folder, folder / "maps")
    cases: list[tuple[list[Path], dict[str, Any], str]] = [
        ([], {}, "no frames"),
        ([tmp_path / "empty"], {}, "holds no folders"),
        ([folder], {}, r"shot_3\.npz: is missing"),
        ([tmp_path / "a.npy"], {"grid": (3, 3)}, "grid is given"),
    ]
    for paths, reading, told in cases:
        with pytest.raises(LightFieldError, match=told) as raised:
            find_frames(paths, reading)
        assert "\n" not in str(raised.value)


# What stays, and what is done again

QUICK: dict[str, Any] = {"method": "fbs-sfa", "planes": 12, "threads": 1, "stabilise": True}


def numbered(folder: Path, frames: list[LightField]) -> list[Path]:
    folder.mkdir()
    paths = [folder / f"{number}.npz" for number in range(len(frames))]
    for path, lf in zip(paths, frames, strict=True):
        lfdepth.write(path, lf)
    return paths


def test_a_video_goes_on_where_it_stopped(two: tuple[Path, list[LightField]], tmp_path: Path) -> None:
    paths = numbered(tmp_path / "in", two[1])
    whole = lfdepth.estimate_video(paths, tmp_path / "whole", **QUICK)
    assert [each.status for each in whole.outcomes] == ["done"] * 4
    lost = paths[2].read_bytes()
    paths[2].write_bytes(lost[:3000])
    with pytest.raises(LightFieldError, match=r"2\.npz"):
        lfdepth.estimate_video(paths, tmp_path / "parts", **QUICK)
    assert len(list((tmp_path / "parts").glob("frame-*.npz"))) == 2  # nothing finished is lost
    paths[2].write_bytes(lost)
    parts = lfdepth.estimate_video(paths, tmp_path / "parts", **QUICK)
    assert [each.status for each in parts.outcomes] == ["there"] * 2 + ["done"] * 2
    assert files_of(tmp_path / "parts") == files_of(tmp_path / "whole")
    again = lfdepth.estimate_video(paths, tmp_path / "parts", **QUICK)
    assert [each.status for each in again.outcomes] == ["there"] * 4
    with pytest.raises(LightFieldError, match=r"frame-0000\.npz: exists, made with other settings \(planes"):
        lfdepth.estimate_video(paths, tmp_path / "parts", **{**QUICK, "planes": 13})
    (tmp_path / "parts" / "frame-0003.npz").unlink()
    for state in (tmp_path / "parts" / ".lfdepth-video").iterdir():
        state.write_bytes(b"")
    lfdepth.estimate_video(paths, tmp_path / "parts", **QUICK)  # from the first frame on
    assert files_of(tmp_path / "parts") == files_of(tmp_path / "whole")


def test_frames_of_another_size_are_named(two: tuple[Path, list[LightField]], tmp_path: Path) -> None:
    smaller = two[1][1].crop(0, 0, 40, 48)
    paths = numbered(tmp_path / "in", [two[1][0], smaller])
    with pytest.raises(LightFieldError, match=r"1\.npz: 3x3 views of 40x48 px.*expected 3x3 views of 48x48"):
        lfdepth.estimate_video(paths, tmp_path / "out", **QUICK)
    assert (tmp_path / "out" / "frame-0000.npz").exists()


def test_a_range_grows_with_what_comes_nearer(two: tuple[Path, list[LightField]], tmp_path: Path) -> None:
    """The range of the first frame does not hold the second, whose only surface lies elsewhere."""
    from dataclasses import replace

    lf = two[1][0]
    nearer = replace(lf, disparity_range=(-0.5, 2.5))
    video = lfdepth.estimate_video(numbered(tmp_path / "in", [lf, nearer]), tmp_path / "out", **QUICK)
    assert lf.disparity_range is not None
    assert video.outcomes[0].range == pytest.approx(lf.disparity_range)
    assert video.outcomes[1].range == pytest.approx((lf.disparity_range[0], 2.5))


def test_a_range_that_is_found_holds_every_frame(tmp_path: Path) -> None:
    frames = list(scenes.video(2, size=64, views=5, motion=20, noise=0))
    path = stored(tmp_path / "v.npy", frames)  # which says nothing of the range
    video = lfdepth.estimate_video(path, tmp_path / "out", **QUICK)
    for each, lf in zip(video.outcomes, frames, strict=True):
        assert each.range[0] < truth_of(lf).min()
        assert each.range[1] > np.quantile(truth_of(lf), 0.99)
    assert not video.outcomes[1].cut
    assert video.outcomes[1].range[1] > video.outcomes[0].range[1]


def test_brightness_is_found_once_and_checked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    frames = list(scenes.video(2, size=64, views=5, motion=0, noise=0))
    views = np.stack([lf.views for lf in frames]).astype(np.float32)
    views[:, 1::2] *= np.float32(0.9)
    path = tmp_path / "v.npy"
    np.save(path, np.rint(views).astype(np.uint8))
    measured = []

    def counted(*words: Any, **named: Any) -> Any:
        measured.append(words)
        return measure_brightness(*words, **named)

    monkeypatch.setattr("lfdepth.scale.video.measure_brightness", counted)
    lfdepth.estimate_video(path, tmp_path / "out", range=RANGE, **FAST)
    assert len(measured) == 1
    assert bad(maps_of(tmp_path / "out"), frames) < 0.15


# The command


def test_the_command(
    two: tuple[Path, list[LightField]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(path) for path in numbered(tmp_path / "in", two[1][:2])]
    words = ["--method", "fbs-sfa:planes=12", "--threads", "1", "--stabilise", "--json"]
    assert main(["video", *paths, "-o", str(tmp_path / "out"), *words]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [each["file"] for each in facts["frames"]] == ["frame-0000.npz", "frame-0001.npz"]
    assert json.loads((tmp_path / "out" / "index.json").read_text())["frames"] == facts["frames"]
    assert (tmp_path / "out" / "index.csv").read_text().count("\n") == 3
    with Image.open(tmp_path / "out" / "preview.webp") as preview:
        assert (getattr(preview, "n_frames", 1), preview.size) == (2, (96, 48))
    lfdepth.estimate_video(paths, tmp_path / "python", **QUICK)
    assert maps_of(tmp_path / "out").tobytes() == maps_of(tmp_path / "python").tobytes()
    assert main(["video", str(tmp_path / "none"), "-o", str(tmp_path / "out2")]) == 2
    assert "none: no such file or folder" in capsys.readouterr().err
