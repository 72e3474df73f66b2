"""Maps by tiles: what seams are left, what is read of a file, and going on after a break."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lfdepth
from clusters import Cluster
from lfdepth import scenes
from lfdepth.blocks.noise import Residual
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity
from lfdepth.lightfield import LightField
from lfdepth.methods.base import Measured
from lfdepth.methods.fbs_vis import FbsVis
from lfdepth.probe.brightness import Equalisation, equalise
from lfdepth.scale import survey, tiles
from lfdepth.scale.jobs import jobs_for
from lfdepth.scale.look import look
from lfdepth.scale.tiles import estimate_tiled

BENCHMARK = Path(__file__).parents[2] / "shared" / "data" / "hci4d"
FAST: dict[str, Any] = {"threads": 1, "effort": "fast", "gloss": False}


@cache
def field() -> LightField:
    return scenes.render("bars", size=(64, 150), views=3)


@cache
def whole() -> Any:
    return lfdepth.estimate(field(), check=False, **FAST).disparity


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "field.npy"
    lfdepth.write(path, field())
    return path


@pytest.mark.thin(3)
@pytest.mark.parametrize("ending", [".npy", ".zarr", ".tif"])
def test_tiles_make_the_whole_map(ending: str, saved: Path) -> None:
    """Further than 0.02 px off on less than 0.1 % of the pixels; and the halo has to be there for that."""
    out = saved.with_name(f"map{ending}")
    done = estimate_tiled(saved, out, tile=64, **FAST)
    assert (done.tiles, done.there) == (3, 0)
    assert np.mean(np.abs(read_disparity(out) - whole()) > 0.02) < 0.001
    assert not out.with_name(f"map{ending}.tiles").exists()


def test_without_a_halo_seams_show_and_are_told(saved: Path) -> None:
    out = saved.with_name("map.npy")
    done = estimate_tiled(saved, out, tile=64, halo=0, **FAST)
    assert np.mean(np.abs(read_disparity(out) - whole()) > 0.02) > 0.001
    assert done.off > tiles.MOST_OFF
    assert "allow more memory" in done.warnings[0]


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ((0, 0, 0, 0.2, 0.5, 0.8), 0),  # the tile ends, and all is well inside
        ((0, 0, 0.1, 0.2, 0.5, 0.8), 8 * 0.1),
        ((0.8, 0.5, 0.2, 0, 0, 0), 0),  # the neighbour's window ends
        ((0.3, 0.3, 0.3, 0.3, 0.3, 0.3), 0.3 * 64),  # on and on, to the middle
        ((0.2, 0.5, 0.4, 0.6, 0.3, 0.9), 0.2 * 48 + 8 * (0.3 + 0.3)),
    ],
)
def test_errors_fade_from_where_a_window_ends(shares: tuple[float, ...], expected: float) -> None:
    """Of a border of 1000 px, in a tile of 128 px across: the least share from each band outwards."""
    counts = np.repeat(1000 * np.array(shares), 8).astype(np.int64)
    assert tiles._spoilt(counts, -24, 128) == pytest.approx(1000 * expected)


def plain_walls() -> LightField:
    """A wall, of which only noise is seen over half of the width: paths decide."""
    rng = np.random.default_rng(3)
    texture = np.kron(rng.random((16, 48, 3)), np.ones((4, 4, 1)))
    texture[:, 50:150] = 0.5
    views = np.stack([[np.roll(texture, (v - 1, u - 1), (0, 1)) for u in range(3)] for v in range(3)])
    noisy = views * 200 + rng.normal(0, 4, views.shape) + 20
    return LightField(noisy.clip(0, 255).astype(np.uint8), disparity_range=(-1.5, 1.5))


def test_paths_go_on_where_tiles_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without texture, tiles differ from the whole map; done again with their neighbours' paths, hardly."""
    lf = plain_walls()
    lfdepth.write(tmp_path / "field.npy", lf)
    expected = lfdepth.estimate(lf, range=(-1.5, 1.5), check=False, equalise=False, **FAST).disparity
    found = {}
    for rounds in (0, 3):
        monkeypatch.setattr(tiles, "_ROUNDS", rounds)
        words: dict[str, Any] = {"tile": 64, "halo": 32, "range": (-1.5, 1.5), "equalise": False}
        done = estimate_tiled(tmp_path / "field.npy", tmp_path / "map.npy", **words, **FAST)
        off = np.mean(np.abs(read_disparity(tmp_path / "map.npy") - expected) > 0.02)
        found[rounds] = done.again, done.apart, off
    assert found[0][0] == 0
    assert found[0][1] > 0.01
    assert found[0][2] > 0.005
    assert found[3][0] > 0
    assert found[3][1] < 0.005
    assert found[3][2] < 0.001


def test_tiles_are_told_what_light_levels_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The exponent of all of a field decides at its depth edges: told another one, tiles make another map."""
    lf = scenes.render("bars", size=(64, 150), views=5)
    roots = np.rint(255 * (lf.views / 255) ** (1 / 2.2)).astype(np.uint8)
    lfdepth.write(tmp_path / "field.npy", LightField(roots))
    words: dict[str, Any] = {**FAST, "range": lf.disparity_range, "equalise": False}
    expected = lfdepth.estimate(LightField(roots), check=False, **words).disparity
    measure: Any = FbsVis.measure
    told: list[Measured] = []

    def measured(self: FbsVis, *samples: Any) -> Measured:
        told.append(measure(self, *samples))
        return told[-1]

    monkeypatch.setattr(FbsVis, "measure", measured)
    off = {}
    for exponent in (2.2, 1.0):
        estimate_tiled(tmp_path / "field.npy", tmp_path / "map.npy", tile=64, **words)
        off[exponent] = np.mean(np.abs(read_disparity(tmp_path / "map.npy") - expected) > 0.02)
        monkeypatch.setattr(FbsVis, "measure", lambda *_: Measured(1.0, told[0].typical))
    assert told[0].exponent == 2.2
    assert off[2.2] < 0.001 < off[1.0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cotton", "backgammon"])
def test_tiles_of_the_benchmark_make_the_whole_map(name: str, tmp_path: Path) -> None:
    if not (BENCHMARK / name).is_dir():
        pytest.skip(f"needs ../shared/data/hci4d/{name}")
    whole_map = lfdepth.estimate(lfdepth.read(BENCHMARK / name), check=False).disparity
    estimate_tiled(BENCHMARK / name, tmp_path / "map.npy", tile=192)
    assert np.mean(np.abs(read_disparity(tmp_path / "map.npy") - whole_map) > 0.02) < 0.001


def uneven_halves() -> LightField:
    """Texture on the left, and on the right hardly any: views differ there ten times less."""
    lf = scenes.render("bars", size=(64, 150), views=5)
    views = lf.views.astype(np.float64)
    views[..., 75:, :] = 110 + 0.1 * (views[..., 75:, :] - 110)
    return LightField(np.rint(views).astype(np.uint8), disparity_range=lf.disparity_range)


def test_what_the_refinement_takes_from_a_field_is_measured_once(tmp_path: Path) -> None:
    """The views' typical difference is that of the whole field in all of its tiles.

    Each tile with its own would be more than 0.003 px off on 1.5 % of the pixels.
    """
    lf = uneven_halves()
    lfdepth.write(tmp_path / "field.npy", lf)
    words: dict[str, Any] = {"range": lf.disparity_range, "equalise": False, "threads": 1}
    expected = lfdepth.estimate(lf, check=False, **words).disparity
    estimate_tiled(tmp_path / "field.npy", tmp_path / "map.npy", tile=64, **words)
    assert np.mean(np.abs(read_disparity(tmp_path / "map.npy") - expected) > 0.003) < 0.001


@pytest.mark.parametrize("shape", [(400, 500), (513, 900), (2000, 300), (8192, 8192)])
def test_samples_are_spread_over_the_field(shape: tuple[int, int], saved: Path) -> None:
    """All of a small field; of a large one windows that lie in it, on either side of the middle, and fit."""
    job = jobs_for([saved], saved.parent, lfdepth.method("fbs-vis"), reading={}, settings={}, threads=1)[0]
    seen = replace(look(saved, {}), shape=(9, 9, *shape, 3))
    probe = survey.Probe((-2.0, 2.0), None, Residual(0, 0), None)
    for memory in (4e9, 7e8):
        windows = survey.sample_windows(job, seen, probe, memory)
        if memory == 4e9 and max(shape) <= 512:
            assert windows == [(0, 0, shape[1], shape[0])]
            continue
        for x, y, width, height in windows:
            assert 0 <= x <= x + width <= shape[1]
            assert 0 <= y <= y + height <= shape[0]
            assert survey.process_bytes(job, seen, probe, max(width, height)) <= memory
        middles = np.array([(y + height / 2, x + width / 2) for x, y, width, height in windows])
        assert (middles.min(axis=0) <= np.array(shape) / 2).all()
        assert (middles.max(axis=0) >= np.array(shape) / 2).all()
        assert len(windows) >= 3


def test_a_break_costs_one_tile(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time, only what is missing is done; and the map is the same to the last byte."""
    estimate_tiled(saved, saved.with_name("expected.npy"), tile=64, **FAST)
    out = saved.with_name("map.npy")

    def stop(done: int, total: int, what: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_tiled(saved, out, tile=64, progress=stop, **FAST)
    assert not out.exists()
    done = estimate_tiled(saved, out, tile=64, **FAST)
    assert (done.tiles, done.there) == (3, 2)
    assert out.read_bytes() == saved.with_name("expected.npy").read_bytes()


def test_tiles_of_other_settings_are_refused(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = saved.with_name("map.npy")

    def stop(done: int, total: int, what: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_tiled(saved, out, tile=64, progress=stop, **FAST)
    with pytest.raises(LightFieldError, match=r"map\.npy\.tiles: has tiles of other settings"):
        estimate_tiled(saved, out, tile=64, **FAST, step=0.1)


def test_tiles_are_as_large_as_the_memory_allows(saved: Path) -> None:
    job = jobs_for([saved], saved.parent, lfdepth.method("fbs-vis"), reading={}, settings={}, threads=1)[0]
    seen = replace(look(saved, {}), shape=(9, 9, 8192, 8192, 3))
    probe = survey.Probe((-2.0, 2.0), None, Residual(0, 0), None)
    small, large = (tiles._largest_tile(job, seen, probe, 48, memory) for memory in (1e9, 4e9))
    assert 1.6 < large / small < 4  # the halo takes its part of the smaller one
    assert survey.process_bytes(job, seen, probe, large + 2 * (48 + 9)) <= 4e9
    with pytest.raises(LightFieldError, match=r"memory: 300 MB for .* expected at least .* smallest tile"):
        tiles._largest_tile(job, seen, probe, 48, 3e8)


@pytest.mark.parametrize("ending", [".npy", ".tif", ".zarr", ".h5"])
def test_windows_are_read_without_the_rest(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of files that hold views as they are, no more rows are read than asked for."""
    lf = LightField(np.random.default_rng(0).integers(0, 256, (3, 3, 64, 40, 3), np.uint8))
    path = tmp_path / f"field{ending}"
    lfdepth.write(path, lf)
    counts: list[int] = []
    fromfile = np.fromfile

    def counted(*words: Any, **options: Any) -> Any:
        found = fromfile(*words, **options)
        counts.append(found.size)
        return found

    monkeypatch.setattr(np, "fromfile", counted)
    part = lfdepth.read(path, crop=(5, 10, 20, 8), white_level=255)
    np.testing.assert_array_equal(part.views, lf.views[:, :, 10:18, 5:25])
    if ending in (".npy", ".tif"):
        assert sum(counts) == (9 + 1) * 8 * 40 * 3  # the reference view twice, to see what it is


def test_a_window_is_equalised_as_the_whole_is() -> None:
    rng = np.random.default_rng(1)
    lf = LightField(rng.integers(0, 256, (3, 3, 20, 30, 1), np.uint8))
    found = Equalisation(
        gain=rng.uniform(0.8, 1.2, (3, 3, 1)),
        offset=rng.uniform(-0.05, 0.05, (3, 3, 1)),
        shading=rng.uniform(-0.3, 0.1, (3, 3, 5)),
        left_out=np.zeros((3, 3), np.bool_),
        effect=np.ones((3, 3)),
        samples=100,
        needed=True,
    )
    part = slice(4, 15), slice(7, 30)
    expected = equalise(lf, found).views[:, :, 4:15, 7:30]
    window = lf.crop(7, 4, 23, 11)
    np.testing.assert_array_equal(equalise(window, found, part=part, size=(20, 30)).views, expected)


# The command line


def test_tiles_from_the_command_line(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = saved.with_name("map.npy")
    words = ["estimate", str(saved), "-o", str(out), "--memory", "1GB", "--effort", "fast", "--json"]
    assert main([*words, "--threads", "1"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["shape"] == [3, 3, 64, 150, 3]
    assert read_disparity(out).shape == (64, 150)


def test_tiles_on_a_cluster_from_the_command_line(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A worker of a scheduler makes the same map, to the last byte, as this process."""
    pytest.importorskip("distributed")
    alone, shared = tmp_path / "alone.npy", tmp_path / "shared.npy"
    common = ["estimate", str(saved), "--memory", "353MB", "--halo", "16", "--method", "fbs-sfa", "--json"]
    common += ["--step", "0.14"]
    assert main([*common, "-o", str(alone), "--workers", "1", "--threads", "1"]) == 0
    one = json.loads(capsys.readouterr().out)
    with Cluster(tmp_path) as cluster:
        cluster.start_worker("a")
        assert main([*common, "-o", str(shared), "--scheduler", cluster.address]) == 0
    other = json.loads(capsys.readouterr().out)
    assert one["tiles"] == other["tiles"] > 1
    assert one["halo_px"] == 16
    assert shared.read_bytes() == alone.read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["-o", "a.pfm", "--memory", "2GB"],
            "a.pfm: cannot be written tile by tile; expected a name ending in",
        ),
        (["-o", "a.npy", "--memory", "much"], "expected a size such as 2GB or 500MB"),
        (["-o", "a.npy", "--memory", "2GB", "--preview", "a.png"], "--preview: found with --memory"),
        (["-o", "a.npy", "--memory", "2GB", "--all-views"], "--all-views: found with --memory"),
        (["-o", "a.npy", "--memory", "2GB", "--scale", "0.5"], "scale: found with tiles"),
        (["-o", "a.npy", "--scheduler", "tcp://head:8786"], "--scheduler: found without --memory; expected"),
        (["-o", "a.npy", "--workers", "2"], "--workers: found without --memory; expected it with tiles; add"),
        (["-o", "a.npy", "--halo", "16"], "--halo: found without --memory; expected it with tiles; add"),
        (["-o", "a.npy", "--memory", "2GB", "--workers", "0"], "workers: found 0, expected at least 1"),
        (["-o", "a.npy", "--memory", "2GB", "--halo", "-1"], "halo: found -1, expected 0 px or more"),
        (
            ["-o", "a.npy", "--memory", "2GB", "--workers", "2", "--scheduler", "tcp://head:8786"],
            "expected one of client, scheduler and workers; leave the others out",
        ),
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
