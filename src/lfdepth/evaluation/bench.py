"""Scenes × methods: run, remember, score, compare, report.

>>> from lfdepth.evaluation.bench import bench
>>> bench(["cotton", "leaves"], ["fbs-sfa", "fbsocc-sfa:step=0.02"], "out")  # doctest: +SKIP
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.evaluation.metrics import Array
from lfdepth.evaluation.plan import SceneSpec, Setting, cross, scene_names, setting
from lfdepth.evaluation.scores import Scores, evaluate
from lfdepth.evaluation.truth import HighResolution
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.methods import Method

Progress = Callable[[int, int, str], None]
"""Called with (runs done, runs in all, what comes next)."""

Origin = Literal["measured", "external"]


@dataclass(frozen=True)
class Failure:
    """A scene, or a method on a scene, that gave no result."""

    scene: str
    method: str | None
    message: str

    def __str__(self) -> str:
        return " / ".join(filter(None, [self.scene, self.method])) + f": {self.message}"


@dataclass(frozen=True, eq=False)
class Entry:
    """The result of one method on one scene; `scores` is None without truth."""

    disparity: Array
    confidence: Array | None
    runtime: float | None
    scores: Scores | None


@dataclass(frozen=True, eq=False)
class SceneResult:
    """One scene and every method's result on it, by the method's name."""

    name: str
    reference: Array
    truth: Array | None
    range: tuple[float, float] | None
    entries: Mapping[str, Entry]


@dataclass(frozen=True, eq=False)
class Bench:
    """All results.

    Attributes
    ----------
    scenes : tuple of SceneResult
        Those that could be read.
    methods : mapping of str to {"measured", "external"}
        Names in the order of the tables.
    settings : tuple of Setting
        What the measured ones are.
    failures : tuple of Failure
        What went wrong, in the order it did.
    """

    scenes: tuple[SceneResult, ...]
    methods: Mapping[str, Origin]
    settings: tuple[Setting, ...] = ()
    failures: tuple[Failure, ...] = ()


def bench(
    scenes: Sequence[Path | str | LightField | SceneSpec],
    methods: Sequence[str | Setting],
    out: Path | str,
    *,
    settings: Sequence[Mapping[str, Any]] = ({},),
    external: Sequence[Path | str] = (),
    published: bool = True,
    compare: Sequence[tuple[str, str]] | None = None,
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
    A run is remembered in ``out/cache`` under a hash of the views, the disparity range, the method with all
    its parameters and the version of the package, and its run time with it. So a bench that was interrupted
    goes on where it stopped, and one that was complete writes the same bytes again.
    """
    from lfdepth.evaluation.report import write_reports

    specs = [each for scene in scenes for each in _specs(scene)]
    chosen = cross([each if isinstance(each, Setting) else setting(each) for each in methods], settings)
    folders = [Path(folder) for folder in external]
    _check_plan(specs, chosen, folders)
    cache = make_folder(Path(out) / "cache")
    runner = _Runner(chosen, folders, cache, threads, progress, len(specs) * len(chosen))
    found = [scene for spec in specs if (scene := runner.run(spec))]
    runner.announce("report")
    origins: dict[str, Origin] = {each.name: "measured" for each in chosen}
    origins |= {folder.name: "external" for folder in folders}
    result = Bench(tuple(found), origins, chosen, tuple(runner.failures))
    write_reports(result, Path(out), published=published, compare=compare)
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


Found = tuple[Array, Array | None, float | None]
"""Disparity, confidence, run time in s."""


@dataclass(eq=False)
class _Runner:
    """Runs one scene after the other and keeps count of what is done and what went wrong."""

    settings: Sequence[Setting]
    external: Sequence[Path]
    cache: Path
    threads: int | None
    progress: Progress | None
    total: int
    done: int = 0
    failures: list[Failure] = field(default_factory=list)

    def announce(self, what: str) -> None:
        if self.progress:
            self.progress(self.done, self.total, what)

    def run(self, spec: SceneSpec) -> SceneResult | None:
        """All methods on a scene; None, and a failure, where it cannot be read."""
        finished = self.done + len(self.settings)
        self.announce(f"reading {spec.label()}")
        try:
            return self._run(spec.load(), spec.high())
        except Exception as error:  # one bad scene, whatever is wrong with it, must not cost the others
            self.failures.append(Failure(spec.label(), None, one_line(error)))
            return None
        finally:
            self.done = finished

    def _run(self, lf: LightField, high: HighResolution | None) -> SceneResult:
        views = content_hash(lf)
        entries: dict[str, Entry] = {}
        for each in self.settings:
            self.announce(f"{lf.name}: {each.name}")
            entry = self._attempt(lf, high, each.name, partial(self._estimate, lf, views, each))
            entries |= {each.name: entry} if entry else {}
            self.done += 1
        for folder in self.external:
            entry = self._attempt(lf, high, folder.name, partial(read_external, folder, lf.name))
            entries |= {folder.name: entry} if entry else {}
            if entry and entry.runtime is None:
                self.failures.append(
                    Failure(lf.name, folder.name, "no run time; the map is scored all the same")
                )
        return SceneResult(lf.name, lf.reference.copy(), lf.truth, lf.disparity_range, entries)

    def _attempt(
        self, lf: LightField, high: HighResolution | None, name: str, get: Callable[[], Found]
    ) -> Entry | None:
        try:
            disparity, confidence, runtime = get()
            scores = (
                evaluate(disparity, lf, confidence=confidence, high=high) if lf.truth is not None else None
            )
            return Entry(disparity, confidence, runtime, scores)
        except Exception as error:  # as in `run`
            self.failures.append(Failure(lf.name, name, one_line(error)))
            return None

    def _estimate(self, lf: LightField, views: str, each: Setting) -> Found:
        """The run from the cache, or a new one that is put there."""
        from lfdepth.io import write
        from lfdepth.sweep.run import estimate

        method = each.resolve()
        key = f"{views} {json.dumps(asdict(method), sort_keys=True, default=str)}"
        file = self.cache / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
        if not file.exists():
            _warm_up(lf, method)
            write(file, estimate(lf, method, threads=self.threads))
        with np.load(file) as data:
            return data["disparity"], data["confidence"], float(data["runtime"])


def content_hash(lf: LightField) -> str:
    """Hash of what an estimate depends on: views, which of them are there, disparity range, version."""
    from lfdepth import __version__

    digest = hashlib.sha256(f"{__version__} {lf.views.dtype} {lf.shape} {lf.disparity_range}".encode())
    digest.update(np.ascontiguousarray(lf.views).data)
    if lf.present is not None:
        digest.update(np.ascontiguousarray(lf.present).data)
    return digest.hexdigest()


def _warm_up(lf: LightField, method: Method) -> None:
    """Compile what the method needs, so that run times are those of the method alone."""
    from lfdepth.sweep.run import estimate

    height, width = min(lf.height, 64), min(lf.width, 64)
    estimate(lf.crop(0, 0, width, height), method, planes=3, step=None)


def read_external(folder: Path, scene: str) -> tuple[Array, None, float | None]:
    """Read the map and the run time, in seconds, of another program's result for a scene.

    Raises
    ------
    LightFieldError
        If there is no map or it cannot be read, or the run time is not a number.
    """
    from lfdepth.io import read_disparity

    maps = [folder / "disp_maps" / f"{scene}.pfm", folder / f"{scene}.pfm"]
    times = [folder / "runtimes" / f"{scene}.txt", folder / f"{scene}.txt"]
    found = next((file for file in maps if file.exists()), None)
    if found is None:
        raise LightFieldError(f"{folder}: no {scene}.pfm; expected it there or in disp_maps; add the map")
    time = next((file for file in times if file.exists()), None)
    return read_disparity(found, finite=False), None, read_runtime(time) if time else None


def read_runtime(file: Path) -> float:
    """Read a run time in seconds; LightFieldError if it is no positive finite number."""
    text = file.read_text(encoding="utf-8", errors="replace").strip()
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < float("inf"):
        raise LightFieldError(f"{file}: found {text[:40]!r}; expected a run time in seconds; correct it")
    return seconds


def one_line(error: Exception) -> str:
    """Message of an error that a user can act on; others keep the name of their kind."""
    text = " ".join(str(error).split())
    return text if isinstance(error, LightFieldError) else f"{type(error).__name__}: {text}"


def make_folder(folder: Path) -> Path:
    """Make a folder and those above it; LightFieldError where that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LightFieldError(
            f"{folder}: cannot be made ({error.strerror}); expected a writable folder; choose another"
        ) from None
    return folder
