"""Scenes × methods: run, remember, score, compare, report.

>>> from lfdepth.bench.run import bench
>>> bench(["cotton", "leaves"], ["fbs-sfa", "fbsocc-sfa:step=0.02"], "out")  # doctest: +SKIP
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from lfdepth.bench.cache import Cache
from lfdepth.bench.external import external_runtime, read_external
from lfdepth.bench.plan import SceneSpec, Setting, cross, scene_names, setting
from lfdepth.bench.report import write_reports
from lfdepth.bench.results import Bench, Entry, Failure, Found, Origin, SceneResult, one_line
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import make_folder
from lfdepth.lightfield import LightField
from lfdepth.scoring.scores import Scores, evaluate
from lfdepth.truth import HighResolution

log = logging.getLogger(__name__)

Progress = Callable[[int, int, str], None]
"""Called with (runs done, runs in all, what comes next)."""


def bench(
    scenes: Sequence[Path | str | LightField | SceneSpec],
    methods: Sequence[str | Setting],
    out: Path | str,
    *,
    settings: Sequence[Mapping[str, Any]] = ({},),
    external: Sequence[Path | str] = (),
    published: bool = True,
    compare: Sequence[tuple[str, str]] | None = None,
    cache: Path | str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Bench:
    """Run every method on every scene and write tables and a report.

    Parameters
    ----------
    scenes : sequence
        Paths, names of procedural scenes ("suite" for all), light fields, or `SceneSpec`.
    methods : sequence of str or Setting
        ``name`` or ``name:parameter=value,...``.
    out : path
        Folder for `results.json`, `results.csv`, `results.md`, `report.html` and the cache; made if absent.
    settings : sequence of mapping
        Parameters; each is tried with every method.
    external : sequence of path
        Folders with results of other programs: `SCENE.pfm` and `SCENE.txt` with the run time in seconds, side
        by side or as `disp_maps/` and `runtimes/`. The folder's name is the method's.
    published : bool
        Put published rows beside the measured ones.
    compare : sequence of (str, str), optional
        Pairs of methods for the pictures of the difference of their errors (the paper's figure 7): the first
        is blue where it is better. Each method with the one before it by default.
    cache : path, optional
        Folder of the cache; ``out/cache`` by default.
    threads : int, optional
        Passed to `estimate`.
    progress : callable, optional
        Called with (runs done, runs in all, what comes next).

    Returns
    -------
    Bench

    Raises
    ------
    LightFieldError
        If nothing is asked for, a method or a name is wrong, or `out` cannot be written. A scene that cannot
        be read, or a method that fails on one, is a `Failure` in the result and in the report, and the rest
        goes on.

    Notes
    -----
    Runs are remembered in the cache with their run time (`Cache`). So a bench that was interrupted goes
    on where it stopped, and one that was complete writes the same bytes again.
    """
    specs = [each for scene in scenes for each in _specs(scene)]
    chosen = cross([each if isinstance(each, Setting) else setting(each) for each in methods], settings)
    folders = [Path(folder) for folder in external]
    _check_plan(specs, chosen, folders)
    out = make_folder(Path(out))
    remembered = Cache(make_folder(Path(cache or out / "cache")))
    runner = _Runner(chosen, folders, remembered, threads, progress, len(specs) * len(chosen))
    found = [scene for spec in specs if (scene := runner.run(spec))]
    runner.announce("report")
    origins: dict[str, Origin] = {each.name: "measured" for each in chosen}
    origins |= {folder.name: "external" for folder in folders}
    result = Bench(tuple(found), origins, chosen, tuple(runner.failures))
    write_reports(result, out, published=published, compare=compare)
    return result


def _specs(scene: Path | str | LightField | SceneSpec) -> list[SceneSpec]:
    if isinstance(scene, SceneSpec):
        return [scene]
    return [SceneSpec(each) for each in scene_names(scene)] if isinstance(scene, str) else [SceneSpec(scene)]


def _check_plan(specs: Sequence[SceneSpec], settings: Sequence[Setting], external: Sequence[Path]) -> None:
    if not specs or not (settings or external):
        raise LightFieldError("bench: nothing to run; expected at least one scene and one method; name them")
    for each in settings:
        each.resolve()
    for folder in external:
        if not folder.is_dir():
            raise LightFieldError(f"{folder}: no such folder; expected results SCENE.pfm; check the path")
    for what, names in (
        ("scenes", [spec.label() for spec in specs]),
        ("methods", [each.name for each in settings] + [folder.name for folder in external]),
    ):
        if twice := {name for name in names if names.count(name) > 1}:
            raise LightFieldError(
                f"bench: two {what} are called {sorted(twice)[0]!r}; expected distinct names; rename one"
            )


@dataclass(eq=False)
class _Runner:
    """Runs one scene after the other and keeps count of what is done and what went wrong."""

    settings: Sequence[Setting]
    external: Sequence[Path]
    cache: Cache
    threads: int | None
    progress: Progress | None
    total: int
    done: int = 0
    failures: list[Failure] = field(default_factory=list)

    def announce(self, what: str) -> None:
        if self.progress:
            self.progress(self.done, self.total, what)

    def fail(self, scene: str, method: str | None, error: Exception) -> None:
        """Take down what went wrong; where it happened stands in the log."""
        failure = Failure(scene, method, one_line(error))
        log.info("%s", failure, exc_info=None if isinstance(error, LightFieldError) else error)
        self.failures.append(failure)

    def run(self, spec: SceneSpec) -> SceneResult | None:
        """All methods on a scene; None, and a failure, where it cannot be read."""
        finished = self.done + len(self.settings)
        self.announce(f"reading {spec.label()}")
        try:
            return self._run(*spec.load_with_masks(), spec.high())
        except Exception as error:  # one bad scene, whatever is wrong with it, must not cost the others
            self.fail(spec.label(), None, error)
            return None
        finally:
            self.done = finished

    def _run(self, lf: LightField, unusable: Mapping[str, str], high: HighResolution | None) -> SceneResult:
        reasons = [*unusable.values(), *(high.unusable.values() if high else ())]
        self.failures += [Failure(lf.name, None, reason) for reason in reasons]
        score = (
            partial(evaluate, lf_or_truth=lf, high=high, unusable=unusable) if lf.truth is not None else None
        )
        entries: dict[str, Entry] = {}
        for each in self.settings:
            self.announce(f"{lf.name}: {each.name}")
            get = partial(self.cache.estimate, lf, each.resolve(), threads=self.threads)
            entry = self._attempt(lf, each.name, get, score)
            entries |= {each.name: entry} if entry else {}
            self.done += 1
        for folder in self.external:
            entry = self._attempt(lf, folder.name, partial(read_external, folder, lf.name), score)
            entries |= {folder.name: self._timed(entry, folder, lf.name)} if entry else {}
        return SceneResult(
            lf.name,
            lf.reference.copy(),
            lf.truth,
            lf.disparity_range,
            entries,
            lf.shape[:2],
            high is not None,
        )

    def _timed(self, entry: Entry, folder: Path, scene: str) -> Entry:
        """Another program's result with its run time; one that is missing or no number is named."""
        try:
            return replace(entry, found=replace(entry.found, runtime=external_runtime(folder, scene)))
        except LightFieldError as error:
            self.failures.append(Failure(scene, folder.name, f"{error} (the map is scored anyway)"))
            return entry

    def _attempt(
        self, lf: LightField, name: str, get: Callable[[], Found], score: Callable[..., Scores] | None
    ) -> Entry | None:
        try:
            found = get()
            return Entry(found, score(found.disparity, confidence=found.confidence) if score else None)
        except Exception as error:  # as in `run`
            self.fail(lf.name, name, error)
            return None
