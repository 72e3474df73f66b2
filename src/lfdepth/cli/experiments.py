"""Commands that run many estimates: comparisons, the paper's experiments, submissions, procedural scenes."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from lfdepth import methods as known_methods
from lfdepth.cli.app import PARTLY_FAILED, app
from lfdepth.cli.options import DEFAULT_METHOD, Flag, Json, NumberOfViews, Output
from lfdepth.cli.printing import report
from lfdepth.errors import LightFieldError

Several = Parameter(consume_multiple=True, show_default=False)

MAIN_METRICS = ("badpix_0.07", "mse_x100", "q25", "runtime")
"""Metrics whose tables are printed; the report has all."""


@app.command(sort_key=10)
def bench(
    *scenes: str,
    output: Output,
    methods: Annotated[tuple[str, ...], Several] = (),
    settings: Annotated[tuple[str, ...], Several] = (),
    plan: Path | None = None,
    truth: Annotated[tuple[str, ...], Several] = (),
    truth_scale: float | None = None,
    truth_offset: float = 0.0,
    truth_variable: str | None = None,
    external: Annotated[tuple[Path, ...], Several] = (),
    compare: Annotated[tuple[str, str] | None, Parameter(metavar="A B")] = None,
    published: Annotated[bool, Parameter(show_default=lambda _: "yes")] = True,
    threads: int | None = None,
    as_json: Json = False,
) -> int:
    """Compare methods over scenes: tables in JSON, CSV and Markdown, and a report in one HTML file.

    Finished runs are kept in the output folder: if interrupted, rerun the same command and it resumes. A
    scene or method that fails is reported, and the rest continues. For example:

        lfdepth bench path/to/cotton path/to/dino -o compared
        lfdepth bench suite --methods fbs-sfa fbsocc-sfa:step=0.02,skip=7 -o compared
        lfdepth bench suite --methods fbs-sfa fbsocc-sfa --settings step=0.02 step=0.05 -o compared
        lfdepth bench --plan plan.toml -o compared

    Parameters
    ----------
    scenes
        Light fields with truth, names of procedural scenes ("lfdepth scenes list"), or "suite" for all of
        those.
    output
        Folder for the tables, report.html and the finished runs.
    methods
        Methods, with parameters as in fbsocc-sfa:step=0.02,skip=7, or all. By default lfdepth's own methods
        and those of installed packages, without the slower published methods that they are compared with.
    settings
        Parameters as in step=0.02,skip=7; every set is run with every method.
    plan
        TOML file with scenes, methods, settings and external, in addition to those given here.
    truth
        Truth stored elsewhere than beside the views: SCENE=FILE for each scene, or FILE if there is only one.
    truth_scale
        Disparity per unit of the truth's samples: disparity = offset + scale · sample.
    truth_offset
        Disparity of sample 0; see --truth-scale.
    truth_variable
        Name of the truth in files with several arrays.
    external
        Folders with other programs' maps, SCENE.pfm, and run times in seconds, SCENE.txt.
    compare
        Two methods to compare pixel by pixel; in the pictures, blue means A is better.
    published
        Show published results beside the measured ones.
    threads
        Number of threads; one per processor by default.
    """
    from lfdepth.bench.plan import Plan, cross, parameters, read_plan, setting, with_truth
    from lfdepth.bench.run import bench as run_bench
    from lfdepth.bench.tables import tables
    from lfdepth.cli.progress import Progress

    planned = read_plan(plan) if plan else Plan((), ())
    named = _named(methods) if methods or plan else _usual()
    tried = cross(map(setting, named), [parameters(each) for each in settings] or [{}])
    specs = with_truth(
        scenes, truth, truth_scale=truth_scale, truth_offset=truth_offset, truth_variable=truth_variable
    )
    with Progress() as progress:
        result = run_bench(
            [*planned.scenes, *specs],
            [*planned.settings, *tried],
            output,
            external=[*planned.external, *external],
            compare=[compare] if compare else None,
            published=published,
            threads=threads,
            progress=progress.step,
        )

    def text(_: dict[str, Any]) -> str:
        shown = [table for table in tables(result, published=False) if table.key in MAIN_METRICS]
        texts = [table.table().to_markdown() + "\n" for table in shown]
        return "\n".join([*texts, f"written  {output / 'report.html'}"])

    report(json.loads((output / "results.json").read_text(encoding="utf-8")), as_json, text)
    return _status(list(map(str, result.failures)))


@app.command(sort_key=11)
def reproduce(
    *experiments: str,
    output: Output,
    data: Path | None = None,
    external: Annotated[tuple[Path, ...], Several] = (),
    real_range: Annotated[
        tuple[float, float], Parameter(metavar="MIN MAX", show_default=lambda _: "-1.5 1.5")
    ] = (-1.5, 1.5),
    threads: int | None = None,
    as_json: Json = False,
) -> int:
    """Reproduce the paper's experiments: table1, figure2, figure4 to figure8, runtime.

    They run on whatever part of the paper's data is available; the rest is listed with where to get it.
    Without any data, procedural scenes are used instead. For example:

        lfdepth reproduce -o reproduced
        lfdepth reproduce table1 figure7 --data path/to/benchmark -o reproduced

    Parameters
    ----------
    experiments
        Experiments to run; all by default.
    output
        Folder for pictures and tables; index.md lists them.
    data
        Folder with scenes of the 4D Light Field Benchmark, each in a folder of its name, and Lytro pictures
        named *eslf*.png, at most two levels down.
    external
        Folders with other programs' maps for table1 and figure6: SCENE.pfm, and run times in SCENE.txt.
    real_range
        Smallest and largest disparity of Lytro pictures, px per view step.
    threads
        Number of threads; one per processor by default. Run times are taken on one thread, as in the paper.
    """
    from lfdepth.cli.progress import Progress
    from lfdepth.paper.experiments import reproduce as run_experiments

    with Progress() as progress:
        made = run_experiments(
            experiments,
            output,
            data=data,
            external=external,
            real_range=real_range,
            threads=threads,
            progress=progress.step,
        )
    facts = {
        "written": [str(file) for file in made.files],
        "missing": made.missing,
        "failures": made.failures,
    }
    report(
        facts, as_json, lambda _: "\n".join([*(f"missing  {each}" for each in made.missing), _written(facts)])
    )
    return _status(made.failures)


@app.command(sort_key=12)
def submit(
    data: Path | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    method: str = DEFAULT_METHOD,
    partial: Flag = False,
    check: Path | None = None,
    threads: int | None = None,
    as_json: Json = False,
) -> int:
    """Make a submission to the 4D Light Field Benchmark, or check one.

    Runs the benchmark's twelve scenes with one parameter set, then writes, checks and zips the maps and run
    times. For example:

        lfdepth submit path/to/benchmark -o submission --method fbsocc-sfa:step=0.02
        lfdepth submit --check submission.zip

    Parameters
    ----------
    data
        Folder with the scenes, each in a folder of its name, at most two levels down.
    output
        Folder for disp_maps, runtimes and submission.zip.
    method
        Method, with parameters as in fbsocc-sfa:step=0.02,skip=7.
    partial
        Make the zip even if scenes are missing or failed.
    check
        Only check this zip file.
    threads
        Number of threads; one per processor by default.
    """
    from lfdepth.bench.submission import check_submission
    from lfdepth.bench.submission import submit as run_submit
    from lfdepth.cli.progress import Progress

    if check is not None:
        problems = check_submission(check)
        report({"zip": str(check), "problems": problems}, as_json, lambda _: _verdict(check, problems))
        return _status(problems)
    if data is None or output is None:
        raise LightFieldError("submit: expected DATA and -o OUTPUT, or --check ZIP; give one or the other")
    with Progress() as progress:
        made = run_submit(data, output, method, partial=partial, threads=threads, progress=progress.step)
    facts = {"zip": made.zip and str(made.zip), "scenes": made.scenes, "problems": made.problems}
    report(facts, as_json, lambda _: f"written  {made.zip}" if made.zip else "no zip written")
    return _status(made.problems)


def _verdict(archive: Path, problems: Sequence[str]) -> str:
    return f"{archive}: " + (f"{len(problems)} problem(s)" if problems else "would be accepted")


scenes_app = App(name="scenes", help="Procedural light fields with exact truth.", sort_key=13)
app.command(scenes_app)


@scenes_app.command(name="list")
def list_scenes(*, as_json: Json = False) -> None:
    """List the scenes and what they are for."""
    from lfdepth import scenes

    facts = {name: scenes.describe(name) for name in (*scenes.NAMES, *scenes.PHOTOREAL)}
    width = max(map(len, facts))
    report(facts, as_json, lambda _: "\n".join(f"{name:<{width}}  {what}" for name, what in facts.items()))


@scenes_app.command
def render(
    *names: str,
    output: Output,
    size: int = 512,
    views: NumberOfViews = (9, 9),
    samples: int = 3,
    seed: int = 0,
    noise: float | None = None,
    as_json: Json = False,
) -> None:
    """Render scenes into folders in the benchmark's layout: views, parameters.cfg, truth at two sizes, masks.

    For example:

        lfdepth scenes render bars leaves -o rendered
        lfdepth scenes render all -o rendered --size 256
        lfdepth scenes render photo-gloss -o rendered --size 256 --views 5x5

    Parameters
    ----------
    names
        Names of scenes, or "all" for all but the path-traced ones. Those need the extra "render" and take
        minutes; the expected time is printed first.
    output
        Folder in which each scene gets its own folder; created if missing.
    size
        Side of the views, px.
    views
        Grid of views; 5 means 5x5.
    samples
        Each pixel averages SAMPLES² points. Path-traced scenes average (SAMPLES + 1)² paths per pixel, which
        leaves noise of about 4 grey levels at 3 samples and 2 at 5.
    seed
        Random seed.
    noise
        Standard deviation of the sensor noise at mid grey, in grey levels of 255; the scene's own by default.
    """
    from lfdepth import scenes
    from lfdepth.cli.progress import Progress
    from lfdepth.io.atomic import make_folder

    if not names:
        raise LightFieldError('scenes render: no scene named; expected names of scenes or "all"; give one')
    several = (scenes.NAMES if name == "all" else (name,) for name in names)
    chosen = list(dict.fromkeys(chain.from_iterable(several)))
    for each in chosen:
        scenes.describe(each)  # raises for an unknown one
    folders = [make_folder(output) / each for each in chosen]
    for number, (each, folder) in enumerate(zip(chosen, folders, strict=True)):
        seconds = scenes.expected_seconds(each, size=size, views=views, samples=samples)
        if seconds is not None:
            print(f"{each}: path-traced, about {_duration(seconds)}", file=sys.stderr)
        with Progress() as progress:
            if seconds is None:
                progress.step(number, len(chosen), each)
            scenes.save(
                each,
                folder,
                size=size,
                views=views,
                seed=seed,
                noise=noise,
                samples=samples,
                progress=progress.step,
            )
    report({"written": [str(folder) for folder in folders]}, as_json, _written)


def _usual() -> tuple[str, ...]:
    """Methods that are compared where none is named."""
    apart = (*known_methods.COMPARED, *known_methods.LEARNED)
    return tuple(each for each in known_methods.names() if each not in apart)


def _named(methods: Sequence[str]) -> tuple[str, ...]:
    """Methods as they are named, all that need no weights of one's own for "all"."""
    every = tuple(each for each in known_methods.names() if each not in known_methods.WITHOUT_WEIGHTS)
    return tuple(chain.from_iterable(every if each == "all" else (each,) for each in methods))


def _duration(seconds: float) -> str:
    return f"{max(1, round(seconds))} s" if seconds < 90 else f"{round(seconds / 60)} min"


def _written(facts: dict[str, Any]) -> str:
    return "\n".join(f"written  {path}" for path in facts["written"])


def _status(problems: Sequence[str]) -> int:
    """Name problems on standard error; the exit status."""
    for problem in problems:
        print(f"failed: {problem}", file=sys.stderr)
    return PARTLY_FAILED if problems else 0
