"""Several processes that write to the same place: they share the work, take turns, or one is refused."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lfdepth
from clusters import Cluster, client_of
from lfdepth import scenes
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity
from lfdepth.scale import tiles
from lfdepth.scale.locks import Shared, alone, only
from lfdepth.scale.tiles import estimate_tiled

METHOD = "fbs-sfa"
SETTINGS: dict[str, Any] = {"threads": 1, "step": 0.14, "tile": 32}

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no locks")


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "field.npy"
    lfdepth.write(path, scenes.render("bars", size=(64, 96), views=3))
    return path


def test_the_last_one_removes_what_was_shared(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    with Shared(folder) as one, Shared(folder) as other:
        one.finish()
        assert folder.is_dir()
        other.finish()
        assert not folder.exists()
    with Shared(folder):  # made again
        assert folder.is_dir()


def test_one_that_comes_while_the_folder_is_removed_makes_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has opened the lock of the folder that then goes."""
    from lfdepth.scale import locks

    folder = tmp_path / "shared"
    first = Shared(folder)
    opened = locks._open

    def slow(*words: Any) -> Any:
        file = opened(*words)
        monkeypatch.setattr(locks, "_open", opened)
        first.finish()
        first.__exit__()
        assert not folder.exists()
        return file

    monkeypatch.setattr(locks, "_open", slow)
    with Shared(folder) as second:
        assert folder.is_dir()
        with Shared(folder) as third:
            second.finish()
            assert folder.is_dir()  # the lock is that of the new folder, which the third one has, too
            third.finish()
    assert not folder.exists()


def test_turns_are_taken(tmp_path: Path) -> None:
    order: list[str] = []

    def second() -> None:
        with alone(tmp_path, "a"):
            order.append("second")

    thread = threading.Thread(target=second)
    with alone(tmp_path, "a"), alone(tmp_path, "b"):
        thread.start()
        thread.join(timeout=0.2)
        order.append("first")
    thread.join(timeout=10)
    assert order == ["first", "second"]


def test_two_share_the_tiles_of_a_map(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every tile is done once, both find the map, and no tiles stay."""
    expected = estimate_tiled(saved, saved.with_name("expected.npy"), METHOD, **SETTINGS)
    out, done, ran = saved.with_name("map.npy"), {}, []
    both, plan, work = threading.Barrier(2, timeout=60), tiles._tiles, tiles._done

    def noted(job: Any) -> Any:
        ran.append(job.name)
        return work(job)

    def planned(*words: Any) -> Any:
        both.wait()  # both have joined, and nothing is done yet
        return plan(*words)

    monkeypatch.setattr(tiles, "_done", noted)
    monkeypatch.setattr(tiles, "_tiles", planned)

    def estimate(name: str) -> None:
        done[name] = estimate_tiled(saved, out, METHOD, **SETTINGS)

    threads = [threading.Thread(target=estimate, args=(name,)) for name in "ab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=120)
    assert {name: each.tiles for name, each in done.items()} == {"a": 6, "b": 6}
    assert out.read_bytes() == saved.with_name("expected.npy").read_bytes()
    assert not list(saved.parent.glob("*.tiles"))
    assert len(ran) == len(set(ran)) == expected.tiles


TILES = """
import sys, lfdepth
done = lfdepth.estimate_tiled(sys.argv[1], sys.argv[2], "fbs-sfa", threads=1, step=0.14, tile=32)
assert done.tiles == 6, done
"""


@pytest.mark.slow
def test_processes_share_the_tiles_of_a_map(saved: Path) -> None:
    """Three real ones, of which one is killed on the way."""
    estimate_tiled(saved, saved.with_name("expected.npy"), METHOD, **SETTINGS)
    out = saved.with_name("map.npy")
    words = [sys.executable, "-c", TILES, str(saved), str(out)]
    running = [subprocess.Popen(words) for _ in range(3)]
    folder = saved.with_name("map.npy.tiles")
    while not list(folder.glob("tile-*.npz")) and running[0].poll() is None:
        pass
    running[0].kill()
    running[0].wait()
    assert [each.wait(timeout=120) for each in running[1:]] == [0, 0]
    np.testing.assert_array_equal(read_disparity(out), read_disparity(saved.with_name("expected.npy")))
    assert not folder.exists()


@pytest.mark.slow
def test_tiles_are_done_on_a_cluster(saved: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """By two real workers of Dask: the same bytes; paths pass through files, as here."""
    pytest.importorskip("distributed")
    settings: dict[str, Any] = {"threads": 1, "effort": "fast", "tile": 32, "halo": 0}
    expected = estimate_tiled(saved, saved.with_name("expected.npy"), **settings)
    assert expected.again > 0
    with Cluster(tmp_path_factory.mktemp("cluster")) as cluster:
        for name in ("one", "two"):
            cluster.start_worker(name)
        with client_of(cluster) as client:
            client.wait_for_workers(2, timeout=60)
            done = estimate_tiled(saved, saved.with_name("map.npy"), client=client, **settings)
    assert (done.tiles, done.again, done.apart) == (expected.tiles, expected.again, expected.apart)
    assert saved.with_name("map.npy").read_bytes() == saved.with_name("expected.npy").read_bytes()


def test_a_video_that_another_process_writes_is_refused(tmp_path: Path) -> None:
    frames = [str(tmp_path / f"{number}.npz") for number in range(2)]
    for path in frames:
        lfdepth.write(path, scenes.render("bars", size=48, views=3))
    out = tmp_path / "maps"
    with only(out), pytest.raises(LightFieldError, match=r"maps: another process is writing there; expected"):
        lfdepth.estimate_video(frames, out, METHOD, threads=1, step=0.14)
    assert not list(out.glob("*.npz"))
    lfdepth.estimate_video(frames, out, METHOD, threads=1, step=0.14)
    assert len(list(out.glob("*.npz"))) == 2
