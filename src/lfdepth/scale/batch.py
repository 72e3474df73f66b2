"""Many scenes, on one machine or a cluster.

>>> import lfdepth
>>> lfdepth.estimate_many(["a", "b"], "fbs-vis", "maps")  # doctest: +SKIP

Paths travel to the workers, and pixels do not. A result has a name that follows from its scene's path, and is
whole or not there; so the same call does only what is missing, and several may run at once.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

from lfdepth.io.atomic import check_target, make_folder
from lfdepth.lightfield import LightField, check_range
from lfdepth.memory import size_text
from lfdepth.methods import Method
from lfdepth.methods import method as named_method
from lfdepth.scale import pools
from lfdepth.scale.jobs import Job, at_hand, jobs_for
from lfdepth.scale.look import look
from lfdepth.scale.page import write_page
from lfdepth.scale.work import Outcome, failed
from lfdepth.table import Column, Table
from lfdepth.trace import Progress

_USUAL_RANGE = (-2.0, 2.0)
"""Px per view step, for what a scene without a range will take."""
_TRIAL = (96, 5, 0.1)
"""Side in px, views along an axis, and contrast of the field on which a machine's speed is measured."""


@dataclass(frozen=True)
class Batch:
    """What became of many scenes.

    Attributes
    ----------
    outcomes
        One for each scene, in the order of the scenes.
    seconds
        From the first to the last.
    """

    outcomes: tuple[Outcome, ...]
    seconds: float

    @property
    def failures(self) -> list[Outcome]:
        """The scenes that failed."""
        return [each for each in self.outcomes if each.status == "failed"]

    def table(self) -> Table:
        """A row for each scene."""
        heads = [Column("scene", words=True), Column("result", words=True), Column("status", words=True)]
        heads += [Column("views", words=True), Column("range", words=True), Column("time", unit="s")]
        return Table.of([*heads, Column("message", words=True)], [_row(each) for each in self.outcomes])

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return {
            "seconds": self.seconds,
            "scenes": [vars(each) for each in self.outcomes],
            "failed": len(self.failures),
        }


def estimate_many(
    scenes: Sequence[str | Path],
    method: str | Method,
    out: str | Path,
    *,
    client: Any = None,
    scheduler: str | None = None,
    workers: int | None = None,
    threads: int | None = 1,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    equalise: bool = True,
    reading: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Batch:
    """Estimate the disparity maps of many light fields.

    Parameters
    ----------
    scenes
        Paths of light fields, or addresses that fsspec knows, such as `s3://bucket/scene.npz`. A cluster's
        workers have to see paths as this process does.
    method
        Name of a method, or a `Method` that `lfdepth.methods` knows by its name.
    out
        Folder for `NAME-xxxxxxxx.npz` of every scene (what `lfdepth.write` puts into an NPZ file, but the run
        time), `index.html`, `results.csv` and thumbnails; made if it is missing.
    client
        A `distributed.Client`: its cluster does the work.
    scheduler
        Address of a Dask scheduler, such as `tcp://host:8786`, in place of a client.
    workers
        Number of processes, where there is no cluster; by default one for each processor. 1: this process.
        A script that starts several has to have its calls under ``if __name__ == "__main__":``.
    threads
        Threads of each estimate. One is best, as long as there are more scenes than processors.
    range, engine, equalise, **options
        As for `lfdepth.estimate`.
    reading
        How scenes are read: arguments of `lfdepth.read`.
    progress
        Called with (scenes done, scenes in all, what was done last).

    Returns
    -------
    Batch
        A scene that fails is one of its `failures`, and the rest goes on.

    Raises
    ------
    LightFieldError
        If nothing is asked for, a result exists that was made with other settings, the folder cannot be
        written, or the scheduler does not answer within ten seconds, or is lost.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> folder = tempfile.mkdtemp()
    >>> lfdepth.write(f"{folder}/bars.npz", scenes.render("bars", size=64, views=3))
    >>> batch = lfdepth.estimate_many(
    ...     [f"{folder}/bars.npz"], "fbs-sfa", f"{folder}/maps", workers=1, planes=10
    ... )
    >>> len(batch.outcomes), len(batch.failures)
    (1, 0)
    """
    started = time.perf_counter()
    out = make_folder(Path(out))
    check_target(out / "index.html")
    jobs = _jobs(scenes, method, out, range, engine, equalise, reading, threads, options)
    found = {job.scene: outcome for job, outcome in zip(jobs, map(_known, jobs), strict=True) if outcome}
    left = [job for job in jobs if job.scene not in found]
    if progress is not None:
        progress(len(found), len(jobs), "what is there")
    for outcome in pools.done_by(left, client, scheduler, workers):
        found[outcome.scene] = outcome
        if progress is not None:
            progress(len(found), len(jobs), Path(outcome.scene).name)
    batch = Batch(tuple(found[job.scene] for job in jobs), time.perf_counter() - started)
    write_page(out, batch.table(), batch.outcomes, jobs[0].provenance())
    return batch


def _jobs(
    scenes: Sequence[str | Path],
    method: str | Method,
    out: Path,
    range: tuple[float, float] | None,
    engine: str,
    equalise: bool,
    reading: Mapping[str, Any] | None,
    threads: int | None,
    options: Mapping[str, Any],
) -> list[Job]:
    settings: dict[str, Any] = {"engine": engine, "equalise": equalise}
    if range is not None:
        settings["range"] = list(check_range(range))
    chosen = named_method(method, **options)
    return jobs_for(scenes, out, chosen, reading=reading or {}, settings=settings, threads=threads)


def _known(job: Job) -> Outcome | None:
    """What is known of a job before any work; LightFieldError where its result is of other settings."""
    return Outcome(job.scene, str(job.target), "there") if job.is_done() else None


def _row(outcome: Outcome) -> tuple[str | float | None, ...]:
    v, u, height, width = outcome.shape[:4] if outcome.shape else (0, 0, 0, 0)
    low, high = outcome.range or (None, None)
    return (
        outcome.scene,
        Path(outcome.target).name,
        outcome.status,
        f"{u}x{v} views, {width}x{height} px" if outcome.shape else "",
        f"{low:.3g} to {high:.3g}" if outcome.range else "",
        outcome.seconds,
        outcome.message,
    )


# --- what it will take


@dataclass(frozen=True)
class Expected:
    """What a batch will take.

    Attributes
    ----------
    rows
        For each scene that has not been done: its path, shape, bytes in all, and seconds.
    there
        How many have been done.
    failures
        Scenes that cannot be read.
    """

    rows: tuple[tuple[str, tuple[int, ...], int, float], ...]
    there: int
    failures: tuple[Outcome, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        scenes = [
            {"scene": scene, "shape": list(shape), "bytes": needed, "seconds": seconds}
            for scene, shape, needed, seconds in self.rows
        ]
        return {
            "scenes": scenes,
            "there": self.there,
            "failed": [vars(each) for each in self.failures],
            "seconds": sum(row[3] for row in self.rows),
            "most_bytes": max((row[2] for row in self.rows), default=0),
        }

    def table(self) -> Table:
        """A row for each scene."""
        heads = [Column(each, words=True) for each in ("scene", "views", "memory")]
        rows = [
            (scene, f"{u}x{v} views, {width}x{height} px", size_text(needed), seconds)
            for scene, (v, u, height, width, _), needed, seconds in self.rows
        ]
        return Table.of([*heads, Column("time", unit="s")], rows)


def expect(
    scenes: Sequence[str | Path],
    method: str | Method,
    out: str | Path,
    *,
    range: tuple[float, float] | None = None,
    engine: str = "cpu",
    equalise: bool = True,
    reading: Mapping[str, Any] | None = None,
    **options: Any,
) -> Expected:
    """What `estimate_many` would take: memory and time of each scene, on one thread of this machine.

    The time is that of a small field on this machine, times the pixels, views and planes; the memory is what
    the method says of itself, and the views. Nothing is written, and of each scene two views are read.

    Raises
    ------
    LightFieldError
        As `estimate_many` does.
    """
    jobs = _jobs(scenes, method, Path(out), range, engine, equalise, reading, 1, options)
    left = [job for job in jobs if not job.is_done()]
    rows, failures, speed = [], [], None
    for job in left:
        try:
            with at_hand(job.scene) as path:
                seen = look(path, job.reading)
            chosen = job.chosen()
            ends = job.settings.get("range") or seen.range or _USUAL_RANGE
            planes = chosen.planes_for((float(ends[0]), float(ends[1])))
            speed = speed or _speed(chosen, engine)
            needed = seen.itemsize * prod(seen.shape) + chosen.memory(seen.shape, planes, seen.itemsize)
            rows.append((job.scene, seen.shape, needed, prod(seen.shape[:4]) * len(planes) * speed))
        except Exception as error:  # as in `run_job`
            failures.append(failed(job, error))
    return Expected(tuple(rows), len(jobs) - len(left), tuple(failures))


def _speed(method: Method, engine: str) -> float:
    """Seconds per view, pixel and plane of a method, on one thread of this machine."""
    import numpy as np

    from lfdepth.estimation import estimate

    side, views, contrast = _TRIAL
    rng = np.random.default_rng(0)
    texture = np.kron(rng.random((side // 4, side // 4, 3)), np.ones((4, 4, 1))) * contrast + 0.4
    noise = rng.normal(0, 0.004, (views, views, side, side, 3))
    field = LightField((texture + noise).astype(np.float32), disparity_range=(-1.0, 1.0))
    field = field.with_samples("uint8")
    settings: dict[str, Any] = {"threads": 1, "engine": engine, "check": True}
    estimate(field, method, **settings)  # kernels are compiled or loaded here
    started = time.perf_counter()
    result = estimate(field, method, **settings)
    seconds = time.perf_counter() - started
    return seconds / (views * views * side * side * max(result.planes, 2))
