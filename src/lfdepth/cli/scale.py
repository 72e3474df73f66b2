"""Commands for more than one map: many scenes, fields larger than memory, videos."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lfdepth.cli.app import PARTLY_FAILED, app
from lfdepth.cli.commands import Equalise
from lfdepth.cli.options import AS_IT_IS, DEFAULT_METHOD, Flag, Json, Output, Range, ReadingParameters
from lfdepth.cli.printing import report

if TYPE_CHECKING:
    from lfdepth.scale.work import Outcome


@app.command(sort_key=9)
def batch(
    *scenes: str,
    output: Output,
    method: str = DEFAULT_METHOD,
    workers: int | None = None,
    scheduler: str | None = None,
    threads: int = 1,
    range: Range = None,
    engine: str = "cpu",
    equalise: Equalise = "auto",
    dry_run: Flag = False,
    as_json: Json = False,
    reading: ReadingParameters = AS_IT_IS,
) -> int:
    """Estimate the maps of many light fields, in several processes or on a Dask cluster.

    Each result is named after its scene's path and is either complete or absent. If interrupted, rerun the
    command: it does only what is missing. A scene that fails is reported, and the rest continues. For
    example:

        lfdepth batch scenes/* -o maps
        lfdepth batch scenes/* -o maps --method fbs-vis:effort=fast,step=0.1 --workers 4
        lfdepth batch scenes/* -o maps --scheduler tcp://head:8786
        lfdepth batch scenes/* -o maps --dry-run

    Parameters
    ----------
    scenes
        Light fields: folders of views, files, or addresses that fsspec knows, such as s3://bucket/scene.npz.
    output
        Folder for a map of each scene (NAME-xxxxxxxx.npz), index.html with thumbnails, and results.csv.
    method
        Name of the method, with parameters as in fbs-vis:effort=fast,step=0.1.
    workers
        Number of processes; one per processor by default.
    scheduler
        Address of a Dask scheduler to use instead of processes; its workers must see the same paths.
    threads
        Threads per estimate.
    range
        Smallest and largest disparity to search, px per view step; by default each scene's own or, if it has
        none, estimated from its views.
    engine
        Engine that does the computing; "lfdepth methods" lists them.
    equalise
        auto: equalise the brightness of the views where it differs; off: use the views unchanged.
    dry_run
        Only report the memory and time needed.
    """
    from lfdepth.bench.plan import setting
    from lfdepth.cli.progress import Progress
    from lfdepth.scale.batch import estimate_many, expect

    chosen = setting(method).resolve()
    common: dict[str, Any] = {
        "range": range,
        "engine": engine,
        "equalise": equalise == "auto",
        "reading": reading.given(),
    }
    if dry_run:
        expected = expect(scenes, chosen, output, **common)
        report(expected.as_dict(), as_json, lambda facts: _expected_text(facts, expected.table().to_text()))
        return _status(expected.failures)
    with Progress() as progress:
        found = estimate_many(
            scenes,
            chosen,
            output,
            workers=workers,
            scheduler=scheduler,
            threads=threads,
            progress=progress.step,
            **common,
        )
    table = found.table().to_text()
    report(found.as_dict(), as_json, lambda _: f"{table}\n\nwritten  {output / 'index.html'}")
    return _status(found.failures)


@app.command(sort_key=9)
def video(
    *frames: Path,
    output: Output,
    stabilise: Flag = False,
    method: str = DEFAULT_METHOD,
    range: Range = None,
    engine: str = "cpu",
    threads: int | None = None,
    equalise: Equalise = "auto",
    as_json: Json = False,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Estimate a map for each frame of a video.

    Range and brightness are found in the first frame and after cuts, and checked in every other one. If
    interrupted, rerun the command: it goes on after the last finished frame. For example:

        lfdepth video frames/* -o maps --stabilise
        lfdepth video frames -o maps --method fbs-vis:effort=fast
        lfdepth video video.zarr -o maps --range -1.5 2

    Parameters
    ----------
    frames
        Light fields, one for each frame, taken in the order of the numbers in their names; or one folder that
        holds them; or a .zarr, .h5 or .npy array (T, V, U, H, W, C).
    output
        Folder for a map of each frame (frame-0000.npz), index.json, index.csv and preview.webp.
    stabilise
        Where the scene stands still, take the mean of the maps over time, so that they do not flicker.
    method
        Name of the method, with parameters as in fbs-vis:effort=fast,step=0.1.
    range
        Smallest and largest disparity to search in all frames, px per view step; by default the frames' own
        or, if they have none, estimated from their views.
    engine
        Engine that does the computing; "lfdepth methods" lists them.
    threads
        Number of threads; one per processor by default.
    equalise
        auto: equalise the brightness of the views where it differs; off: use the views unchanged.
    """
    from lfdepth.bench.plan import setting
    from lfdepth.cli.progress import Progress
    from lfdepth.scale.video import PREVIEW, estimate_video

    chosen = setting(method).resolve()
    with Progress() as progress:
        found = estimate_video(
            frames,
            output,
            chosen,
            stabilise=stabilise,
            range=range,
            engine=engine,
            threads=threads,
            equalise=equalise == "auto",
            reading=reading.given(),
            progress=progress.step,
        )
    for each in found.outcomes:
        for warning in each.warnings:
            print(f"warning: {each.frame}: {warning}", file=sys.stderr)
    table = found.table().to_text()
    report(found.as_dict(), as_json, lambda _: f"{table}\n\nwritten  {output / PREVIEW}")


def _expected_text(facts: dict[str, Any], table: str) -> str:
    from lfdepth.memory import size_text

    return (
        f"{table}\n\n{len(facts['scenes'])} scenes to do, {facts['there']} done before: about "
        f"{_duration(facts['seconds'])} on one thread, and {size_text(facts['most_bytes'])} at most for each "
        "worker"
    )


def _duration(seconds: float) -> str:
    """A time in words."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _status(failures: Sequence[Outcome]) -> int:
    """Name what failed on standard error; the exit status."""
    for each in failures:
        named = each.message.startswith(each.scene)
        print(f"failed: {each.message if named else f'{each.scene}: {each.message}'}", file=sys.stderr)
    return PARTLY_FAILED if failures else 0
