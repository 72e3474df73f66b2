"""Who does the jobs of a batch: this process, several processes here, or the workers of a Dask cluster.

Each yields outcomes as they come, one for each job, whatever happens to workers on the way.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from lfdepth.engines.cpu.workers import default_threads
from lfdepth.errors import LightFieldError
from lfdepth.scale.jobs import Job
from lfdepth.scale.work import CrowdedError, Outcome, failed, run_job

_TRIES = 3
"""Workers that may die over one job."""
_PATIENCE = 60.0
"""Seconds that a scheduler may be away once it was there."""
_ANSWER = 10.0
"""Seconds in which a scheduler has to answer."""
_PAUSE = 1.0
"""Seconds before a job that found no memory is tried again."""
_WAITS = 60
"""How often a worker tries to find memory for a job."""

_LIBRARIES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""By which libraries of linear algebra are told, when they are loaded, how many threads to take."""

Run = Callable[[Job], Outcome]
"""Does a job; raises CrowdedError for want of memory."""


def in_this_process(jobs: Sequence[Job], run: Run = run_job) -> Iterator[Outcome]:
    """One after the other."""
    for job in jobs:
        yield _waiting(job, run)


def in_processes(jobs: Sequence[Job], workers: int, run: Run = run_job) -> Iterator[Outcome]:
    """In a few processes of this machine; where one is killed, its jobs are done again."""
    tries = dict.fromkeys(range(len(jobs)), 0)
    while tries:
        yield from _in_pool(jobs, workers, run, tries)


def _in_pool(jobs: Sequence[Job], workers: int, run: Run, tries: dict[int, int]) -> Iterator[Outcome]:
    """Outcomes of the jobs that `tries` counts, which leave it; the others stay there if a worker dies.

    No more are handed out than are at work, so that only these are suspected of having killed it; and those
    that were suspected before are done one by one.
    """
    waiting = sorted(tries, key=lambda number: -tries[number])
    running: dict[Future[Outcome], int] = {}
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        while waiting or running:
            while waiting and len(running) < (1 if tries[waiting[0]] else workers):
                number = waiting.pop(0)
                with _libraries_on(jobs[number].threads):  # processes start when there is a job for them
                    running[pool.submit(_waiting, jobs[number], run)] = number
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(future)
                try:
                    outcome = future.result()
                except BrokenProcessPool as error:
                    waiting.clear()  # to be done in another pool
                    tries[number] += 1
                    if tries[number] < _TRIES:
                        continue
                    outcome = failed(jobs[number], _killed(jobs[number], error))
                del tries[number]
                yield outcome


@contextmanager
def _libraries_on(threads: int | None) -> Iterator[None]:
    """Have the libraries of processes that start in the context take so many threads, unless told already."""
    ours = {} if threads is None else {name: str(threads) for name in _LIBRARIES if name not in os.environ}
    os.environ.update(ours)
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _waiting(job: Job, run: Run) -> Outcome:
    """The outcome of a job; while others take the memory, it waits."""
    for _ in range(_WAITS):
        try:
            return run(job)
        except CrowdedError as error:
            last = error
            time.sleep(_PAUSE)
    return failed(job, last)


def _killed(job: Job, error: BaseException) -> LightFieldError:
    return LightFieldError(
        f"{job.scene}: {_TRIES} workers died over it ({' '.join(str(error).split())[:100]}); expected one to "
        "survive; if memory ran out, start fewer workers, or use --scale or --crop"
    )


def check_who(client: Any, scheduler: str | None, workers: int | None) -> None:
    """Raise LightFieldError if more than one is named to do jobs, or no worker."""
    if workers is not None and workers < 1:
        raise LightFieldError(f"workers: found {workers}, expected at least 1")
    if sum(each is not None for each in (client, scheduler, workers)) > 1:
        raise LightFieldError("expected one of client, scheduler and workers; leave the others out")


def done_by(
    jobs: Sequence[Job], client: Any, scheduler: str | None, workers: int | None, run: Run = run_job
) -> Iterator[Outcome]:
    """By whoever is asked to: a client's cluster, a scheduler's, or a number of processes.

    Raises
    ------
    LightFieldError
        As `check_who` does, or if there is none to do it.
    """
    check_who(client, scheduler, workers)
    if not jobs:
        return
    if client is not None:
        yield from on_cluster(jobs, client, run=run)
    elif scheduler is not None:
        with connect(scheduler) as ours:
            yield from on_cluster(jobs, ours, scheduler, run)
    else:
        count = min(workers or default_threads(), len(jobs))
        yield from in_this_process(jobs, run) if count == 1 else in_processes(jobs, count, run)


# --- Dask


def connect(address: str, patience: float = _ANSWER) -> Any:
    """A client of the scheduler at an address such as `tcp://host:8786`.

    Raises
    ------
    LightFieldError
        If Dask is not installed, or no scheduler answers within ten seconds.
    """
    try:
        from distributed import Client
    except ImportError:
        raise LightFieldError(
            f"{address}: needs the package distributed, which is not installed; expected the extra "
            "'cluster'; run: pip install \"lfdepth[cluster]\""
        ) from None
    try:
        return Client(address, timeout=patience, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise LightFieldError(
            f"{address}: no scheduler answered within {patience:g} s ({type(error).__name__}); expected one; "
            "start it with: dask scheduler"
        ) from None


def on_cluster(
    jobs: Sequence[Job], client: Any, address: str | None = None, run: Run = run_job
) -> Iterator[Outcome]:
    """On the workers of a cluster; with its address, a scheduler that is started again is waited for.

    Raises
    ------
    LightFieldError
        If the scheduler is lost; what was finished stays.
    """
    from distributed import as_completed

    left = {job.key: job for job in jobs}
    ours = None
    losses = 0
    try:
        while left:
            problem: Exception | None = None
            try:
                asked = {client.submit(_on_worker, job, run, key=key): job for key, job in left.items()}
                crowded: dict[str, list[str]] = {}
                done = as_completed(asked, loop=client.loop)
                for future in done:
                    job = asked.pop(future)
                    outcome = _outcome(future, job)
                    if isinstance(outcome, _Crowded) and len(crowded.get(job.key, ())) < _WAITS:
                        full = crowded.setdefault(job.key, [])
                        full.append(outcome.address)
                        again = client.submit(
                            _on_worker, job, run, key=f"{job.key}-{len(full)}", **_elsewhere(client, full)
                        )
                        asked[again] = job
                        done.add(again)
                    elif outcome is not None:
                        del left[job.key]
                        yield outcome.failure if isinstance(outcome, _Crowded) else outcome
            except Exception as error:  # whatever a closed connection makes of it
                problem = error
            if not left:
                break
            losses += 1
            if address is None or losses > _TRIES:
                raise _lost(address or "scheduler", problem, len(left))
            if client.status != "running":
                if ours is not None:
                    ours.close()
                ours = client = connect(address, _PATIENCE)
    finally:
        if ours is not None:
            ours.close()


@dataclass(frozen=True)
class _Crowded:
    """A worker, by its address, that had no memory for a job; and the failure that this is in the end."""

    address: str
    failure: Outcome


def _elsewhere(client: Any, full: Sequence[str]) -> dict[str, Any]:
    """Where to try a job again: on workers that have not had too little memory for it, if there are any."""
    others = sorted(set(client.scheduler_info(n_workers=-1)["workers"]) - set(full))
    return {"workers": others, "allow_other_workers": True} if others else {}


def _outcome(future: Any, job: Job) -> Outcome | _Crowded | None:
    """What became of a job; None where the scheduler forgot it, and it has to be asked for again."""
    if future.status in ("cancelled", "lost"):
        return None
    if future.status == "error":
        error = future.exception()
        return failed(job, _killed(job, error))
    found: Outcome | _Crowded = future.result()
    return found


def _lost(address: str, error: Exception | None, left: int) -> LightFieldError:
    reason = "" if error is None else f" ({' '.join(str(error).split())[:100]})"
    return LightFieldError(
        f"{address}: scheduler lost with {left} still to do{reason}; expected it to stay up; rerun the same "
        "command, which does only what is missing"
    )


def _on_worker(job: Job, run: Run) -> Outcome | _Crowded:
    """Do a job on a worker of Dask; where there is no memory, hand it back, so that another may try."""
    try:
        return run(job)
    except CrowdedError as error:
        from distributed import get_worker

        time.sleep(_PAUSE)
        return _Crowded(get_worker().address, failed(job, error))
