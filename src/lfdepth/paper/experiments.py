"""The paper's experiments by name, on whatever of its data is there.

Lee et al., IEEE Access 2021, DOI 10.1109/ACCESS.2021.3098819: table 1, figures 2 and 4 to 8, and the run
times of section IV, with the paper's parameters (step 0.02 and J = 7 on synthetic scenes, 0.05 and 5 on real
ones). Beside the paper's methods stand those that it compares with, and `fbs-vis`, the default of today,
each with its own parameters, and `epinet-s`, whose weights come along. Of the paper's learned methods the
rows are published ones.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lfdepth.bench.cache import Cache
from lfdepth.bench.external import read_external
from lfdepth.bench.plan import SceneSpec, Setting
from lfdepth.bench.published import published_rows
from lfdepth.bench.results import Bench, one_line
from lfdepth.bench.run import Progress, bench
from lfdepth.bench.submission import HOME, SCENES, find_scenes
from lfdepth.bench.tables import best
from lfdepth.bench.timing import timed_estimate
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import make_folder
from lfdepth.io.pixels import write_picture
from lfdepth.lightfield import LightField
from lfdepth.methods import Method, method
from lfdepth.paper.figures import (
    OCCLUSION,
    PLAIN,
    Study,
    figure2,
    figure4,
    figure5,
    figure8,
    range_of,
    study,
)
from lfdepth.pictures import PanelRow, difference_map, panel
from lfdepth.scoring.captions import score_line
from lfdepth.scoring.metrics import Array, mean_over_scenes
from lfdepth.scoring.scores import evaluate
from lfdepth.table import Cell, Column, Row, Table, Value

log = logging.getLogger(__name__)

SHOWN = ("boxes", "cotton", "backgammon", "pyramids")
"""Scenes of the paper's figures 6 and 7."""

SUITE = ("leaves", "demo", "wedges", "solids")
"""Procedural scenes that stand in for them where there is no data; the last two ask what those two ask."""

SUITE_REAL = ("room", "noise-2", "gloss")
"""Procedural scenes with noise or gloss that stand in for real ones."""

REAL_HOME = "http://lightfields.stanford.edu/LF2016.html"
"""Where Lytro Illum pictures with 14×14 views in ESLF layout can be downloaded."""

REAL_RANGE = (-1.5, 1.5)
"""Disparity range, px per view step, of real scenes that carry none; holds all of a Lytro Illum picture."""

SYNTHETIC: dict[str, Any] = {"preset": "paper-synthetic"}
REAL: dict[str, Any] = {"preset": "paper-real"}
PAPERS = ("fbs", PLAIN, OCCLUSION)
"""The paper's method and those it is built on."""

TABLE1 = ("spo", "spo-mo", "cae", "lf-occ", "omg", "ofsy", "oavc")
FIGURE6 = ("spo-mo", "cae", "lf-occ", "omg", "ofsy")
FIGURE8 = ("spo", "cae", "lf-occ", "omg")
"""What the paper compares its methods with, in its order; in table 1 with SPO and OAVC, which are newer or
only in figure 8."""

LEARNED = ("epinet-s",)
"""Learned methods whose weights come along."""

PUBLISHED_ONLY = ("EPINET", "LFAttNet")
"""Learned methods of the paper's table and figures, of which only published figures are shown."""

SUBSTITUTED = {
    "epinet-s": "EPINET with 30 filters, trained on procedural scenes alone, not on the benchmark's; it "
    "looks twice, and the views choose among its maps",
    "spo-mo": "parameters are ours; none are published",
    "cae": "scanline paths instead of graph cuts",
    "lf-occ": "scanline paths instead of graph cuts",
    "omg": "scanline paths instead of graph cuts; clusters and weights are ours",
    "ofsy": "scanline paths and a smooth surface instead of a joint optimisation with normals",
}
"""Steps of compared methods that are not the original's; docs/compared-methods.md has all of them."""

TODAY = "fbs-vis"
"""The default method, which is not the paper's; it keeps its own parameters."""

PAPER_SECONDS = {
    (PLAIN, "synthetic"): 2.110,
    (OCCLUSION, "synthetic"): 3.347,
    (PLAIN, "real"): 1.592,
    (OCCLUSION, "real"): 2.607,
}
"""Seconds per slice in the paper: MATLAB, one thread."""

PAPER_PIXELS = {"synthetic": 512 * 512, "real": 541 * 375}
"""Pixels of a view in the paper."""


@dataclass(eq=False)
class Reproduced:
    """What `reproduce` made.

    Attributes
    ----------
    files : list of Path
    missing : list of str
        What of the paper's data is not there, and where to get it.
    failures : list of str
        What went wrong, by experiment and scene.
    """

    files: list[Path] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def reproduce(
    experiments: Sequence[str],
    out: Path | str,
    *,
    data: Path | str | None = None,
    external: Sequence[Path | str] = (),
    real_range: tuple[float, float] = REAL_RANGE,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Reproduced:
    """Redo experiments of the paper.

    Parameters
    ----------
    experiments : sequence of str
        Names out of `EXPERIMENTS`; empty for all.
    out : path
        Folder for pictures and tables; made if absent.
    data : path, optional
        Folder with scenes of the 4D Light Field Benchmark, each in a folder of its name, and Lytro pictures
        named `*eslf*.png`, at most two levels down. What is missing is listed and the rest runs. Without a
        folder, or with nothing in it, procedural scenes stand in: the whole suite in table 1, and some of it
        in the figures.
    external : sequence of path
        Folders with maps of other programs, as for `bench`, for table 1 and figure 6.
    real_range : (float, float)
        Disparity range, px per view step, for Lytro pictures, which carry none.
    threads : int, optional
        Passed to `estimate`; the run times are always taken on one thread, as in the paper.
    progress : callable, optional
        Called with (experiments done, experiments in all, what comes next).

    Returns
    -------
    Reproduced

    Raises
    ------
    LightFieldError
        If an experiment is unknown, or `out` or `data` cannot be used.
    """
    chosen = list(dict.fromkeys(experiments)) or list(EXPERIMENTS)
    if unknown := [name for name in chosen if name not in EXPERIMENTS]:
        raise LightFieldError(
            f"experiment: found {unknown[0]!r}; expected one of {', '.join(EXPERIMENTS)}; choose one of these"
        )
    synthetic, real = _find(Path(data) if data else None)
    lab = _Laboratory(
        make_folder(Path(out)), synthetic, real, [Path(each) for each in external], real_range, threads
    )
    lab.result.missing += _missing(chosen, synthetic, real)
    for number, name in enumerate(chosen):
        if progress:
            progress(number, len(chosen), name)
        try:
            EXPERIMENTS[name].run(lab)
        except Exception as error:  # one experiment must not cost the others
            log.info("%s failed", name, exc_info=error)
            lab.result.failures.append(f"{name}: {one_line(error)}")
    lab.write_index()
    return lab.result


def _find(data: Path | None) -> tuple[dict[str, SceneSpec], dict[str, SceneSpec]]:
    """Synthetic and real scenes below a folder; the procedural ones where there is none of either."""
    synthetic = {name: SceneSpec(folder, name) for name, folder in find_scenes(data).items()} if data else {}
    pictures = [file for depth in ("*", "*/*") for file in sorted(data.glob(depth))] if data else []
    real = {
        file.stem: SceneSpec(file, file.stem)
        for file in pictures
        if "eslf" in file.stem.lower() and file.suffix.lower() == ".png"
    }
    if synthetic or real:
        return synthetic, real
    from lfdepth import scenes

    return {name: SceneSpec(name) for name in scenes.NAMES}, {name: SceneSpec(name) for name in SUITE_REAL}


def _missing(chosen: Sequence[str], synthetic: dict[str, SceneSpec], real: dict[str, SceneSpec]) -> list[str]:
    """What of the paper's data the chosen experiments would need and do not have."""
    missing = []
    if "table1" in chosen:
        wanted: Sequence[str] = SCENES
    else:
        wanted = SHOWN if {"figure6", "figure7"} & set(chosen) else ()
    if absent := [name for name in wanted if name not in synthetic]:
        missing.append(f"4D Light Field Benchmark: {', '.join(absent)}; get them from {HOME}")
    if {"figure8", "runtime"} & set(chosen) and not any(
        isinstance(spec.source, Path) for spec in real.values()
    ):
        missing.append(f"Lytro Illum pictures, 14×14 views, named *eslf*.png; get them from {REAL_HOME}")
    return missing


@dataclass(eq=False)
class _Laboratory:
    """Scenes, and where results go."""

    out: Path
    synthetic: dict[str, SceneSpec]
    real: dict[str, SceneSpec]
    external: list[Path]
    real_range: tuple[float, float]
    threads: int | None
    result: Reproduced = field(default_factory=Reproduced)
    study: Study | None = None
    rendered: dict[str, LightField] = field(default_factory=dict)

    @property
    def cache(self) -> Cache:
        return Cache(make_folder(self.out / "cache"))

    def shown(self) -> dict[str, SceneSpec]:
        """Scenes of figures 6 and 7: the paper's that are there, else their stand-ins, else all that are."""
        found = self.synthetic
        known = ({name: found[name] for name in names if name in found} for names in (SHOWN, SUITE))
        return next(filter(None, known), found)

    def each(self, specs: dict[str, SceneSpec], experiment: str) -> Iterator[LightField]:
        """Light fields; those that cannot be read are named."""
        for name, spec in specs.items():
            try:
                yield self._load(spec)
            except Exception as error:  # one bad scene must not cost the others
                log.info("%s: %s failed", experiment, name, exc_info=error)
                self.result.failures.append(f"{experiment}: {name}: {one_line(error)}")

    def _load(self, spec: SceneSpec) -> LightField:
        """Read a scene; procedural ones, which are small and take seconds to render, only once."""
        if not isinstance(spec.source, str):
            return spec.load()
        if spec.source not in self.rendered:
            self.rendered[spec.source] = spec.load()
        return self.rendered[spec.source]

    def maps(self, lf: LightField, names: Sequence[str], options: dict[str, Any]) -> dict[str, Array]:
        """Disparity maps of a light field by method."""
        found = [self.cache.estimate(lf, _chosen(name, options), threads=self.threads) for name in names]
        return {name: each.disparity for name, each in zip(names, found, strict=True)}

    def others(self, lf: LightField) -> dict[str, Array]:
        """Maps of other programs that fit the light field."""
        maps = {}
        for folder in self.external:
            try:
                disparity = read_external(folder, lf.name).disparity
            except LightFieldError as error:
                self.result.failures.append(str(error))
                continue
            if disparity.shape == lf.views.shape[2:4]:
                maps[folder.name] = disparity
        return maps

    def intermediate(self) -> Study:
        """Volumes in a window of the first scene that has truth, shared by figures 2, 4 and 5."""
        if self.study is None:
            specs = self.shown() | self.synthetic
            scene = next((lf for lf in self.each(specs, "figures 2, 4, 5") if lf.truth is not None), None)
            if scene is None:
                from lfdepth import scenes

                scene = scenes.render(SUITE[0])
            self.study = study(scene, threads=self.threads, **SYNTHETIC)
        return self.study

    def add(self, name: str) -> Path:
        """Path of a result, entered into the list."""
        self.result.files.append(self.out / name)
        return self.out / name

    def write(self, name: str, lines: Sequence[str]) -> None:
        """Write a text."""
        from lfdepth.io.atomic import atomic

        with atomic(self.add(name)) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")

    def write_index(self) -> None:
        """Write what was made, with the pictures in place, what is missing and what failed."""
        lines = ["# The paper's experiments", ""]
        for name, experiment in EXPERIMENTS.items():
            made = [each for each in self.made if re.match(rf"{name}\b", each)]
            if made:
                lines += [f"## {name}", "", experiment.description, ""]
                lines += [f"{'!' if each.endswith('.png') else '- '}[{each}]({each})" for each in made] + [""]
        for title, entries in (("Missing", self.result.missing), ("Failed", self.result.failures)):
            if entries:
                lines += [f"## {title}", "", *(f"- {entry}" for entry in entries), ""]
        self.write("index.md", lines[:-1])

    @property
    def made(self) -> list[str]:
        """Names of the results, relative to the folder."""
        return sorted({file.relative_to(self.out).as_posix() for file in self.result.files})


def _chosen(name: str, options: dict[str, Any]) -> Method:
    """A method with the paper's parameters, if it is one of the paper's."""
    return method(name, **(options if name in PAPERS else {}))


# --- the experiments


def _table1(lab: _Laboratory) -> None:
    """BadPix 0.07, MSE, discontinuities and run time, means over the scenes."""
    settings = [
        Setting(name, name, SYNTHETIC if name in PAPERS else {})
        for name in (*TABLE1, *LEARNED, *PAPERS, TODAY)
    ]
    found = bench(
        list(lab.synthetic.values()),
        settings,
        lab.out / "table1",
        external=[folder for folder in lab.external if folder.is_dir()],
        compare=[(OCCLUSION, PLAIN), (TODAY, OCCLUSION)],
        cache=lab.out / "cache",
        threads=lab.threads,
    )
    lab.result.failures += [f"table1: {failure}" for failure in found.failures]
    lab.add("table1/report.html")
    lines = [
        f"Means over {len(found.scenes)} scenes: {', '.join(scene.name for scene in found.scenes)}.",
        "Discontinuities: over the scenes that have its mask. All metrics and scenes: table1/report.html.",
        f"The best of the rows measured here are bold. {TODAY} is not the paper's, but the default of today.",
        f"{' and '.join(PUBLISHED_ONLY)} are learned, and their rows are published ones.",
        "",
        Table(
            (Column("method"), *_TABLE1.values()), (*_measured_rows(found), *_published_rows())
        ).to_markdown(),
        "",
        *(f"* {name}: {what}." for name, what in SUBSTITUTED.items()),
    ]
    lab.write("table1.md", ["# Table 1", "", *lines])


_TABLE1 = {
    "badpix_0.07": Column("BadPix 0.07", "%"),
    "mse_x100": Column("MSE×100"),
    "discontinuities": Column("Discontinuities", "%"),
    "runtime": Column("run time", "s"),
}


def _measured_rows(found: Bench) -> Iterator[Row]:
    """Rows of table 1, the best of each column in bold."""
    columns = []
    for key in _TABLE1:
        means = [_mean(found, name, key) for name in found.methods]
        columns.append([Cell(mean, best=bold) for mean, bold in zip(means, best(means), strict=True)])
    for name, *cells in zip(found.methods, *columns, strict=True):
        yield Row((Cell(f"{name} *" if name in SUBSTITUTED else name), *cells))


def _published_rows() -> Iterator[Row]:
    for row in published_rows():
        if row.averages:
            shown = [row.averages.get(key) for key in list(_TABLE1)[:-1]] + [row.runtime]
            name = Cell(row.method, "published, all twelve scenes")
            yield Row((name, *map(Cell, shown)), "published")


def _mean(found: Bench, name: str, key: str) -> float:
    entries = [scene.entries[name] for scene in found.scenes if name in scene.entries]
    if key == "runtime":
        return mean_over_scenes([entry.found.runtime for entry in entries])
    return mean_over_scenes([entry.scores.get(key) for entry in entries if entry.scores])


def _intermediate(name: str, draw: Callable[[Study], Array]) -> Callable[[_Laboratory], None]:
    def run(lab: _Laboratory) -> None:
        pixels = draw(lab.intermediate())
        write_picture(lab.add(f"{name}.png"), pixels)

    return run


def _figure6(lab: _Laboratory) -> None:
    for lf in lab.each(lab.shown(), "figure6"):
        maps = lab.others(lf) | lab.maps(lf, (*FIGURE6, *LEARNED, *PAPERS[1:], TODAY), SYNTHETIC)
        scored = maps if lf.truth is not None else {}
        captions = {name: score_line(evaluate(each, lf)) for name, each in scored.items()}
        row = PanelRow(lf.reference, maps, lf.truth, lf.name, range_of(lf, maps), captions)
        panel(row, path=lab.add(f"figure6-{lf.name}.png"))


def _figure7(lab: _Laboratory) -> None:
    for lf in lab.each(lab.shown(), "figure7"):
        if lf.truth is not None:
            maps = lab.maps(lf, (PLAIN, OCCLUSION, TODAY), SYNTHETIC)
            for a, b, ending in ((OCCLUSION, PLAIN, ""), (TODAY, OCCLUSION, f"-{TODAY}")):
                path = lab.add(f"figure7-{lf.name}{ending}.png")
                difference_map(maps[a], maps[b], lf.truth, path, names=(a, b), title=lf.name)


def _figure8(lab: _Laboratory) -> None:
    for lf in lab.each(lab.real, "figure8"):
        scene = replace(lf, disparity_range=lf.disparity_range or lab.real_range)
        maps = lab.others(scene) | lab.maps(scene, (*FIGURE8, PLAIN, OCCLUSION, TODAY), REAL)
        pixels = figure8(scene.reference, maps, range_of(scene, maps), apart=(PLAIN, OCCLUSION))
        write_picture(lab.add(f"figure8-{lf.name}.png"), pixels)


def _runtime(lab: _Laboratory) -> None:
    lines = [
        "# Seconds per slice, one thread",
        "",
        "Run time of a map, kernels compiled before, by its number of planes. The paper: MATLAB, one thread,",
        "4.1 GHz, on 9×9 views of 512×512 px (synthetic) and 541×375 px (real); its figures are scaled to",
        f"the number of pixels here. {TODAY} is not the paper's: fewer planes, and each is seen twice.",
        "",
    ]
    rows = []
    for kind, specs, options in (("synthetic", lab.synthetic, SYNTHETIC), ("real", lab.real, REAL)):
        first = dict(list(specs.items())[:1])
        for lf in lab.each(first, "runtime"):
            scene = replace(lf, disparity_range=lf.disparity_range or lab.real_range)
            share = lf.height * lf.width / PAPER_PIXELS[kind]
            for name in (PLAIN, OCCLUSION, TODAY):
                of_paper = PAPER_SECONDS.get((name, kind))
                times = _run_times(scene, _chosen(name, options), of_paper and of_paper * share)
                rows.append((lf.name, "×".join(map(str, lf.shape[:4])), name, *times))
    columns = (
        Column("scene"),
        Column("V×U×H×W", words=True),
        Column("method", words=True),
        *map(Column, ("planes", "map (s)", "seconds per slice", "the paper's", "times faster")),
    )
    lab.write("runtime.md", [*lines, Table.of(columns, rows).to_markdown()])


def _run_times(lf: LightField, chosen: Method, paper: float | None) -> tuple[Value, ...]:
    """Planes, seconds for the map and for a slice, the paper's for a slice, and how many times as long."""
    result = timed_estimate(lf, chosen, threads=1)
    seconds = result.runtime / result.planes
    return result.planes, result.runtime, seconds, paper, paper and paper / seconds


@dataclass(frozen=True)
class Experiment:
    """What to run, and what it shows."""

    run: Callable[[_Laboratory], None]
    description: str


EXPERIMENTS: dict[str, Experiment] = {
    "table1": Experiment(_table1, "BadPix 0.07, MSE, discontinuities and run time, means over the scenes."),
    "figure2": Experiment(
        _intermediate("figure2", figure2),
        "Foreground fattening: slices of the volume along x and disparity, and along x and y, and the maps "
        "that come of them.",
    ),
    "figure4": Experiment(
        _intermediate("figure4", figure4),
        "Disparity sign voting and smoothing of one plane, without and with the paper's mask.",
    ),
    "figure5": Experiment(
        _intermediate("figure5", figure5),
        "The 4-D mask over the centre view and a corner view, all brought to one plane.",
    ),
    "figure6": Experiment(_figure6, "Maps of all methods, and their signed errors."),
    "figure7": Experiment(
        _figure7, "Differences of absolute errors: blue where the first method is better, red where worse."
    ),
    "figure8": Experiment(_figure8, "Real scenes, with two windows enlarged."),
    "runtime": Experiment(_runtime, "Seconds per slice on one thread, beside the paper's."),
}
"""The experiments by name."""
