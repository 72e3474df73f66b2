"""What a worker of a batch does: one scene, from its path to its file."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.io import read
from lfdepth.io.atomic import atomic, make_folder
from lfdepth.io.record import as_record
from lfdepth.lightfield import LightField
from lfdepth.memory import available_memory, size_text
from lfdepth.result import Result
from lfdepth.scale.jobs import PROVENANCE, Job, at_hand
from lfdepth.scale.locks import alone

_THUMBNAIL = 160  # px, the longer side


class CrowdedError(LightFieldError):
    """There is no memory for a job here and now; elsewhere or later there may be."""


@dataclass(frozen=True)
class Outcome:
    """What became of a scene.

    Attributes
    ----------
    scene, target
        Path of the light field, and of the result.
    status
        "done"; "there", where it had been done before; or "failed".
    message
        Why it failed.
    shape
        (V, U, H, W, C).
    range
        (min, max) disparity, px per view step.
    seconds
        For reading, estimate and writing.
    worker
        Host and process that did it.
    """

    scene: str
    target: str
    status: str
    message: str = ""
    shape: tuple[int, ...] = ()
    range: tuple[float, float] | None = None
    seconds: float | None = None
    worker: str = ""


def run_job(job: Job) -> Outcome:
    """Estimate a scene, unless that has been done; what goes wrong is part of the outcome.

    Raises
    ------
    CrowdedError
        If what is free of the memory does not suffice, so that another worker may try.
    """
    return run_alone(job, _done)


def run_alone(job: Job, do: Callable[[Job], Outcome]) -> Outcome:
    """Do a job, unless it has been done or another process is about it; what goes wrong is an outcome.

    Raises
    ------
    CrowdedError
        If what is free of the memory does not suffice, so that another worker may try.
    """
    try:
        with alone(Path(job.folder), job.name):
            if job.is_done():
                return Outcome(job.scene, str(job.target), "there")
            return do(job)
    except CrowdedError:
        raise
    except Exception as error:  # one bad scene, whatever is wrong with it, must not cost the others
        return failed(job, error)


def failed(job: Job, error: BaseException) -> Outcome:
    """The outcome of a job that could not be done."""
    text = " ".join(str(error).split())
    message = text if isinstance(error, LightFieldError) else f"{type(error).__name__}: {text[:200]}"
    return Outcome(job.scene, str(job.target), "failed", message, worker=this_worker())


def _done(job: Job) -> Outcome:
    started = time.perf_counter()
    with at_hand(job.scene) as path:
        lf = read(path, **job.reading)
        chosen = job.chosen()
        ends = job.settings.get("range") or lf.disparity_range
        if ends is not None:
            planes = chosen.planes_for((float(ends[0]), float(ends[1])))
            check_room(job, chosen.memory(lf.shape, planes, lf.views.itemsize))
        result = estimate(lf, chosen, threads=job.threads, **job.settings)
    _write(job, result)
    return finished(job, lf, result.range, started)


def finished(job: Job, lf: LightField, range: tuple[float, float], started: float) -> Outcome:
    """The outcome of a job whose result is written."""
    return Outcome(
        job.scene,
        str(job.target),
        "done",
        shape=lf.shape,
        range=range,
        seconds=time.perf_counter() - started,
        worker=this_worker(),
    )


def check_room(job: Job, needed: int) -> None:
    """Raise CrowdedError where fewer than the bytes needed beside the views are free."""
    free = available_memory()
    if free is not None and needed > free and not job.settings.get("force"):
        raise CrowdedError(
            f"{job.scene}: needs {size_text(needed)} beside the views, {size_text(free)} are free on "
            f"{this_worker()}; expected enough memory; start fewer workers, or larger ones"
        )


def _write(job: Job, result: Result) -> None:
    """Write the thumbnail, then the result: where that is, all is.

    The result holds nothing that changes from run to run, such as a run time.
    """
    record = as_record(result)
    facts = {
        "range": np.asarray(result.range),
        "parameters": np.asarray(record.parameters),
        PROVENANCE: job.stamp(),
    }
    make_folder(job.thumbnail.parent)
    with atomic(job.thumbnail) as temporary:
        _thumbnail(result, temporary)
    with atomic(job.target) as temporary:
        np.savez(temporary, allow_pickle=False, **record.arrays(), **facts)


def _thumbnail(result: Result, path: Path) -> None:
    from PIL import Image

    from lfdepth.pictures import disparity_colours

    picture = Image.fromarray(disparity_colours(result.disparity))
    picture.thumbnail((_THUMBNAIL, _THUMBNAIL))
    picture.save(path, "WEBP", quality=80)


def this_worker() -> str:
    """Host and process."""
    return f"{socket.gethostname()}:{os.getpid()}"
