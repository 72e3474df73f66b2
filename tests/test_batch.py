"""Many scenes: names, what is there, processes, a real Dask cluster, and what goes wrong on the way."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lfdepth
from clusters import Cluster, client_of
from lfdepth import scenes
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.scale import batch as batches
from lfdepth.scale import pools, work
from lfdepth.scale.batch import estimate_many, expect
from lfdepth.scale.jobs import Job

METHOD = "fbs-sfa"
FAST: dict[str, Any] = {"step": 0.14}
COUNT = 5


@pytest.fixture(scope="module")
def fields(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Paths of light fields; one is damaged."""
    folder = tmp_path_factory.mktemp("fields")
    paths = [folder / f"s{seed}.npz" for seed in range(COUNT)]
    for seed, path in enumerate(paths):
        lfdepth.write(path, scenes.render("bars", size=48, views=3, seed=seed))
    (folder / "damaged.npz").write_bytes(paths[0].read_bytes()[:5000])
    return [*map(str, paths), str(folder / "damaged.npz")]


@pytest.fixture(scope="module")
def serial(fields: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, batches.Batch]:
    """The maps that one process makes."""
    out = tmp_path_factory.mktemp("serial")
    return out, estimate_many(fields, METHOD, out, workers=1, **FAST)


def same_maps(one: Path, other: Path) -> bool:
    """Whether two folders hold the same results to the last byte, and there is one of each scene."""
    found, expected = (
        {file.name: file.read_bytes() for file in folder.glob("*.npz")} for folder in (one, other)
    )
    assert sorted(found) == sorted(expected)
    return len(found) == COUNT and found == expected


# One process


def test_maps_are_those_of_estimate(fields: list[str], serial: tuple[Path, batches.Batch]) -> None:
    out, done = serial
    outcome = done.outcomes[0]
    assert outcome.status == "done"
    expected = lfdepth.estimate(lfdepth.read(fields[0]), METHOD, threads=1, **FAST)
    np.testing.assert_array_equal(lfdepth.io.read_disparity(outcome.target), expected.disparity)
    assert Path(outcome.target).parent == out.resolve()


def test_a_damaged_scene_is_named_and_the_rest_goes_on(serial: tuple[Path, batches.Batch]) -> None:
    out, done = serial
    assert [each.status for each in done.outcomes] == ["done"] * COUNT + ["failed"]
    assert len(done.failures) == 1
    assert "damaged.npz" in done.failures[0].message
    page = (out / "index.html").read_text()
    assert page.count("<img ") == COUNT
    assert "damaged.npz" in page
    for picture in re.findall(r'<img src="([^"]+)"', page):
        assert (out / picture).stat().st_size > 100
    assert (out / "results.csv").read_text().count("\n") == COUNT + 2


def test_what_is_there_is_not_done_again(
    fields: list[str], serial: tuple[Path, batches.Batch], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, done = serial
    missing = Path(done.outcomes[2].target)
    before = missing.read_bytes()
    missing.unlink()
    ran: list[str] = []
    run = work._done

    def noted(job: Job) -> work.Outcome:
        ran.append(job.scene)
        return run(job)

    monkeypatch.setattr(work, "_done", noted)
    again = estimate_many(fields[:COUNT], METHOD, out, workers=1, **FAST)
    assert ran == [fields[2]]
    assert [each.status for each in again.outcomes] == ["there", "there", "done", "there", "there"]
    assert missing.read_bytes() == before


def test_names_follow_from_paths() -> None:
    """Equal last parts do not meet; trailing slashes and other settings change nothing."""
    one, other = Job("/a/cotton", "out", "fbs"), Job("/b/cotton", "out", "fbs")
    assert one.name != other.name
    assert one.name.startswith("cotton-")
    assert Job("/a/cotton", "out", "spo", {"step": 1}).name == one.name
    assert Job("/a/cotton", "out", "spo", {"step": 1}).key != one.key


def test_other_settings_are_refused(fields: list[str], serial: tuple[Path, batches.Batch]) -> None:
    out, _ = serial
    with pytest.raises(
        LightFieldError, match=r"exists, made with other settings \(step 0.14 instead of 0.1\)"
    ):
        estimate_many(fields, METHOD, out, workers=1, step=0.1)


def test_strangers_files_are_left_alone(fields: list[str], tmp_path: Path) -> None:
    target = Job(str(Path(fields[0]).resolve()), str(tmp_path), METHOD).target
    target.write_text("mine")
    with pytest.raises(LightFieldError, match="is not a result of a batch"):
        estimate_many(fields[:1], METHOD, tmp_path, workers=1, **FAST)
    assert target.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scenes": []}, "batch: no scenes"),
        ({"scenes": ["a", "./a"]}, "is named twice"),
        ({"workers": 0}, "workers: found 0, expected at least 1"),
        ({"workers": 2, "scheduler": "tcp://x"}, "one of client, scheduler and workers"),
        ({"range": (1, 0)}, "expected MIN below MAX"),
        ({"step": -1.0}, "step"),
    ],
)
def test_what_cannot_be_is_refused(arguments: dict[str, Any], message: str, tmp_path: Path) -> None:
    words = {"scenes": ["a"], "method": METHOD, "out": tmp_path / "out", **arguments}
    with pytest.raises(LightFieldError, match=re.escape(message)):
        estimate_many(**words)


def test_fields_are_fetched_from_addresses(fields: list[str], tmp_path: Path) -> None:
    """Any address that fsspec knows; here one of the memory."""
    fsspec = pytest.importorskip("fsspec")
    address = "memory://lab/s0.npz"
    with fsspec.open(address, "wb") as file:
        file.write(Path(fields[0]).read_bytes())
    done = estimate_many([address, "memory://lab/none.npz"], METHOD, tmp_path, workers=1, **FAST)
    assert [each.status for each in done.outcomes] == ["done", "failed"]
    assert "memory://lab/none.npz: cannot be fetched" in done.failures[0].message
    expected = lfdepth.estimate(lfdepth.read(fields[0]), METHOD, threads=1, **FAST)
    found = lfdepth.io.read_disparity(done.outcomes[0].target)
    np.testing.assert_array_equal(found, expected.disparity)


def test_expectations_grow_with_the_work(fields: list[str], tmp_path: Path) -> None:
    """Twice the side, four times the pixels: memory and time by that, less what does not depend on them."""
    large = tmp_path / "large.npz"
    lfdepth.write(large, scenes.render("bars", size=96, views=3))
    found = expect([fields[0], large, fields[-1]], METHOD, tmp_path / "out", range=(-1.0, 1.0), **FAST)
    small, big = found.rows
    assert small[1] == (3, 3, 48, 48, 3)
    assert big[3] == pytest.approx(4 * small[3])
    assert 2 < big[2] / small[2] < 4
    assert len(found.failures) == 1
    assert not (tmp_path / "out").exists()


def test_memory_is_waited_for(fields: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = iter([0, 0, 1 << 40, 1 << 40])
    monkeypatch.setattr(work, "available_memory", lambda: next(free))
    monkeypatch.setattr(pools, "_PAUSE", 0.01)
    done = estimate_many(fields[:1], METHOD, tmp_path, workers=1, **FAST)
    assert done.outcomes[0].status == "done"
    monkeypatch.setattr(work, "available_memory", lambda: 0)
    done = estimate_many(fields[1:2], METHOD, tmp_path, workers=1, **FAST)
    assert "0 MB are free on" in done.failures[0].message


# The command line


def test_a_batch_from_the_command_line(
    fields: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["batch", fields[0], fields[-1], "-o", str(out), "--method", "fbs-sfa:step=0.2"]
    assert main([*words, "--workers", "1", "--json"]) == 1
    captured = capsys.readouterr()
    facts = json.loads(captured.out)
    assert [each["status"] for each in facts["scenes"]] == ["done", "failed"]
    assert captured.err.splitlines()[-1].startswith("failed: ")
    assert "damaged.npz" in captured.err
    assert main([*words, "--dry-run"]) == 1
    assert "0 scenes to do, 1 done before" in capsys.readouterr().out


def test_a_scheduler_that_does_not_answer_is_named(
    fields: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(pools.connect, "__defaults__", (1.0,))
    words = ["batch", fields[0], "-o", str(tmp_path), "--scheduler", "tcp://127.0.0.1:1"]
    assert main(words) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: tcp://127.0.0.1:1: no scheduler answered within 1 s")


# Processes


def _deadly(job: Job) -> work.Outcome:
    """Instead of an estimate: kill the process over one job, until a file says that it is enough."""
    if job.method == "fbs":
        time.sleep(0.3)
        left = Path(job.folder) / job.name
        count = int(left.read_text()) if left.exists() else job.options["deaths"]
        if count:
            left.write_text(str(count - 1))
            os.kill(os.getpid(), signal.SIGKILL)
    return work.Outcome(job.scene, "", "done")


@pytest.mark.thin(2)
@pytest.mark.skipif(os.name == "nt", reason="kill -9")
@pytest.mark.parametrize(("deaths", "status"), [(1, "done"), (9, "failed")])
def test_a_job_that_kills_its_process_costs_no_other(deaths: int, status: str, tmp_path: Path) -> None:
    """Once, and it is done again; every time, and it is given up after three, and named."""
    deadly = Job("/deadly", str(tmp_path), "fbs", {"deaths": deaths})
    jobs = [deadly, *[Job(f"/{i}", str(tmp_path), "spo") for i in range(4)]]
    done = {each.scene: each for each in pools.in_processes(jobs, 2, _deadly)}
    assert {scene: each.status for scene, each in done.items()} == {
        "/deadly": status,
        **{f"/{i}": "done" for i in range(4)},
    }
    if status == "failed":
        assert "/deadly: 3 workers died over it" in done["/deadly"].message


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="kill -9")
def test_processes_that_are_killed_cost_nothing(
    fields: list[str], serial: tuple[Path, batches.Batch], tmp_path: Path
) -> None:
    """The first worker is killed when the first result is there; its job is done again."""
    import multiprocessing

    killed = []

    def kill(done: int, total: int, what: str) -> None:
        if done == 1:
            child = multiprocessing.active_children()[0]
            assert child.pid is not None
            os.kill(child.pid, signal.SIGKILL)
            killed.append(child.pid)

    done = estimate_many(fields, METHOD, tmp_path, workers=2, progress=kill, **FAST)
    assert len(killed) == 1
    assert [each.status in ("done", "there") for each in done.outcomes] == [True] * COUNT + [False]
    assert same_maps(tmp_path, serial[0])


FULL = """
import resource, sys
import lfdepth
resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000))  # maps take more, and all else less
done = lfdepth.estimate_many(sys.argv[2:], "fbs-sfa", sys.argv[1], workers=1, step=0.14)
assert len(done.failures) == 1, done
assert "cannot be written" in done.failures[0].message, done.failures[0].message
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="limits of processes")
def test_a_full_disk_is_named_and_what_is_finished_stays(
    fields: list[str], serial: tuple[Path, batches.Batch], tmp_path: Path
) -> None:
    estimate_many(fields[:1], METHOD, tmp_path, workers=1, **FAST)
    before = {file: file.read_bytes() for file in tmp_path.glob("*.npz")}
    environment = {**os.environ, "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR", "")}
    subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path), *fields[:2]], check=True, env=environment, timeout=120
    )
    assert {file: file.read_bytes() for file in tmp_path.glob("*.npz")} == before
    assert not list(tmp_path.glob(".*.npz"))


# Dask


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    with Cluster(tmp_path_factory.mktemp("cluster")) as started:
        yield started


def test_two_clients_and_a_worker_that_is_killed(
    fields: list[str], serial: tuple[Path, batches.Batch], cluster: Cluster, tmp_path: Path
) -> None:
    """A real scheduler, two workers, two clients at once that ask for the same: each scene is done once.

    When the first results are there, a worker is killed in the middle of its work.
    """
    for name in ("one", "two"):
        cluster.start_worker(name)
    results: dict[str, batches.Batch] = {}
    killed = threading.Event()

    def kill(done: int, total: int, what: str) -> None:
        if done == 2 and not killed.is_set():
            killed.set()
            cluster.kill("one")

    def ask(name: str) -> None:
        with client_of(cluster) as client:
            results[name] = estimate_many(fields, METHOD, tmp_path, client=client, progress=kill, **FAST)

    threads = [threading.Thread(target=ask, args=(name,)) for name in ("a", "b")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=180)
    assert killed.is_set()
    assert same_maps(tmp_path, serial[0])
    runs: dict[str, set[tuple[str, float | None]]] = {}
    for each in [*results["a"].outcomes, *results["b"].outcomes]:
        assert each.status == ("failed" if "damaged" in each.scene else each.status)
        if each.status == "done":
            runs.setdefault(each.scene, set()).add((each.worker, each.seconds))
    assert all(len(each) == 1 for each in runs.values())
    assert [len(results[name].failures) for name in "ab"] == [1, 1]


@pytest.mark.slow
def test_a_scheduler_that_is_started_again(
    fields: list[str], serial: tuple[Path, batches.Batch], cluster: Cluster, tmp_path: Path
) -> None:
    cluster.start_worker("one")

    def restart(done: int, total: int, what: str) -> None:
        if done == 1 and "two" not in cluster.workers:
            cluster.scheduler.kill()
            cluster.scheduler.wait()
            cluster.kill("one")
            cluster.start_scheduler()
            cluster.start_worker("two")

    done = estimate_many(fields, METHOD, tmp_path, scheduler=cluster.address, progress=restart, **FAST)
    assert "two" in cluster.workers
    assert len(done.failures) == 1
    assert same_maps(tmp_path, serial[0])


PRELOAD = """
from lfdepth.scale import work
work.available_memory = lambda: 0
"""


@pytest.mark.slow
def test_a_worker_without_free_memory_hands_its_jobs_on(
    fields: list[str], serial: tuple[Path, batches.Batch], cluster: Cluster, tmp_path: Path
) -> None:
    preload = cluster.folder / "full.py"
    preload.write_text(PRELOAD)
    cluster.start_worker("full", "--preload", str(preload))
    cluster.start_worker("free")
    with client_of(cluster) as client:
        client.wait_for_workers(2, timeout=60)
        done = estimate_many(fields, METHOD, tmp_path, client=client, **FAST)
    assert len(done.failures) == 1
    assert same_maps(tmp_path, serial[0])
    pid = str(cluster.workers["full"].pid)
    assert not [each for each in done.outcomes if each.status == "done" and each.worker.endswith(pid)]


def test_a_lost_scheduler_is_named() -> None:
    class Client:
        status = "closed"

        def submit(self, *words: Any, **options: Any) -> Any:
            raise OSError("connection closed")

    pytest.importorskip("distributed")
    with pytest.raises(LightFieldError, match=r"scheduler lost with 1 still to do .*rerun the same command"):
        list(pools.on_cluster([Job("/a", "out", "fbs")], Client()))
