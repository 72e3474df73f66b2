"""The bench: its scores are those of evaluate, it resumes, goes on past what fails, its report is whole."""

import base64
import csv
import io
import json
import re
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba import njit
from PIL import Image

import lfdepth
from lfdepth import estimation as run
from lfdepth import scenes
from lfdepth.bench import cache
from lfdepth.bench import page as html_page
from lfdepth.bench.cache import Cache
from lfdepth.bench.charts import Axis
from lfdepth.bench.plan import SceneSpec, Setting, cross, read_plan, setting
from lfdepth.bench.published import published_rows
from lfdepth.bench.results import Bench, Entry, Found, SceneResult
from lfdepth.bench.run import bench
from lfdepth.bench.tables import MetricTable, tables
from lfdepth.bench.timing import timed_estimate
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.scoring import evaluate
from lfdepth.scoring.scores import Scores
from lfdepth.table import figures

METHODS = ["fbs:step=0.2", "fbs-sfa:step=0.2"]


@pytest.fixture(scope="module")
def scene() -> LightField:
    return scenes.render("demo", size=64, views=3)


@pytest.fixture
def fixed_clock(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every estimate takes one second; lists what was estimated, warm-up excluded."""
    true, called = run.estimate, list[str]()

    def estimate(lf: LightField, method: Any, **options: Any) -> run.Result:
        if "range" not in options:
            called.append(f"{lf.name}/{method.name}")
        return replace(true(lf, method, **options), runtime=1.0)

    monkeypatch.setattr(run, "estimate", estimate)
    return called


def outputs(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


def test_scores_are_those_of_evaluate(scene: LightField, tmp_path: Path) -> None:
    bench([scene], METHODS, tmp_path)
    results = json.loads((tmp_path / "results.json").read_text())["results"]
    for each in results:
        method = each["method"].split(":")[0]
        expected = evaluate(lfdepth.estimate(scene, method, step=0.2), scene)
        assert {**each["scores"], "runtime": 0} == {**expected, "runtime": 0}
    table = list(csv.DictReader(io.StringIO((tmp_path / "results.csv").read_text())))
    chosen = [row for row in table if row["metric"] == "mse_x100" and row["origin"] == "measured"]
    assert [float(row["value"]) for row in chosen if row["scene"] == "demo"] == [
        each["scores"]["mse_x100"] for each in results
    ]


def test_an_interrupted_bench_goes_on_and_ends_in_the_same_bytes(
    scene: LightField, tmp_path: Path, fixed_clock: list[str]
) -> None:
    pair = [scene, replace(scene, views=scene.views[:, :, ::-1], name="other")]
    bench(pair, METHODS, tmp_path / "whole")
    assert len(fixed_clock) == 4

    def stop(done: int, total: int, what: str) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bench(pair, METHODS, tmp_path / "broken", progress=stop)
    assert outputs(tmp_path / "broken") == {}
    assert len(fixed_clock) == 7
    bench(pair, METHODS, tmp_path / "broken")
    assert len(fixed_clock) == 8
    assert outputs(tmp_path / "broken") == outputs(tmp_path / "whole")


def test_the_cache_tells_parameters_ranges_and_views_apart(
    scene: LightField, tmp_path: Path, fixed_clock: list[str]
) -> None:
    for variant, count in (
        (scene, 1),
        (scene, 1),
        (replace(scene, disparity_range=(-2.0, 2.0)), 2),
        (replace(scene, views=255 - scene.views), 3),
    ):
        bench([variant], ["fbs:step=0.2"], tmp_path)
        assert len(fixed_clock) == count
    bench([scene], ["fbs:step=0.3"], tmp_path)
    assert len(fixed_clock) == 4


def test_a_run_time_is_that_of_the_machine_and_the_threads(
    scene: LightField, tmp_path: Path, fixed_clock: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    remembered, method = Cache(tmp_path), lfdepth.method("fbs", step=0.2)
    for threads, machine, count in ((1, "a", 1), (1, "a", 1), (2, "a", 2), (1, "b", 3), (2, "a", 3)):
        monkeypatch.setattr(cache, "machine", lambda name=machine: name)
        assert remembered.estimate(scene, method, threads=threads).runtime == 1.0
        assert len(fixed_clock) == count
    assert len(list(tmp_path.glob("*.npz"))) == 1  # the map does not depend on them
    facts = [json.loads(file.read_text()) for file in tmp_path.glob("*.json")]
    assert {(each["machine"], each["threads"]) for each in facts} == {("a", 1), ("a", 2), ("b", 1)}


def test_other_code_is_another_run(
    scene: LightField, tmp_path: Path, fixed_clock: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    method = lfdepth.method("fbs", step=0.2)
    Cache(tmp_path).estimate(scene, method)
    monkeypatch.setattr(cache, "code_digest", lambda package: "of the code after a change")
    Cache(tmp_path).estimate(scene, method)
    assert len(fixed_clock) == 2
    assert len(list(tmp_path.glob("*.npz"))) == 2


def test_the_digest_of_the_code_is_that_of_every_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a copy of the package, so that its files can be changed; a method's own package counts, too."""
    package = tmp_path / "lfdepth"
    shutil.copytree(Path(lfdepth.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "other_method.py").write_text("ONE = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(lfdepth, "__file__", str(package / "__init__.py"))

    def digest(of: str = "lfdepth") -> str:
        cache.code_digest.cache_clear()
        return cache.code_digest(of)

    digests = [digest(), digest("other_method")]
    assert digest() == digests[0]
    for change in ("lfdepth/estimation.py", "lfdepth/engines/cpu/workers.py", "other_method.py"):
        with (tmp_path / change).open("a") as file:
            file.write("# changed\n")
        digests.append(digest("other_method"))
    monkeypatch.setattr(numba, "__version__", "0.0")
    digests.append(digest("other_method"))
    assert len(set(digests)) == len(digests)
    monkeypatch.undo()
    cache.code_digest.cache_clear()


def test_a_key_knows_name_parameters_and_engine(scene: LightField) -> None:
    keys = {
        cache.key(lf, name, parameters, engine, code)
        for lf in (scene, replace(scene, present=np.eye(3, dtype=bool) | np.eye(3, dtype=bool)[::-1]))
        for name, parameters, engine, code in (
            ("fbs", {"step": 0.2}, "cpu", "1"),
            ("fbs", {"step": 0.3}, "cpu", "1"),
            ("fbs", {"planes": 0.2}, "cpu", "1"),
            ("fbs-sfa", {"step": 0.2}, "cpu", "1"),
            ("fbs", {"step": 0.2}, "other", "1"),
            ("fbs", {"step": 0.2}, "cpu", "2"),
        )
    }
    assert len(keys) == 12


def test_wide_windows_do_not_stumble_over_the_warm_up() -> None:
    lf = scenes.render("demo", size=100, views=3, samples=1)
    for options in ({"radius": 40}, {"radius": 3, "photo_radius": 45}):
        assert timed_estimate(lf, lfdepth.method("fbs-vis", planes=5, **options)).runtime > 0
    with pytest.raises(LightFieldError, match="101 px for images of 100×100"):
        timed_estimate(lf, lfdepth.method("fbs", planes=5, radius=50))


def test_run_times_hold_no_compilation(scene: LightField, monkeypatch: pytest.MonkeyPatch) -> None:
    true, called = run.estimate, list[bool]()

    def estimate(lf: LightField, method: Any, **options: Any) -> run.Result:
        called.append(lf is whole)
        if called == [False, True]:  # a kernel that the small piece had no need of
            njit(lambda x: x + 1)(1)
        return true(lf, method, **options)

    monkeypatch.setattr(run, "estimate", estimate)
    whole = replace(scene, disparity_range=None)
    timed_estimate(whole, lfdepth.method("fbs", step=0.2))
    assert called == [False, True, True]
    timed_estimate(whole, lfdepth.method("fbs", step=0.2))
    assert called[3:] == [False, True]


def test_a_damaged_run_in_the_cache_is_made_anew(
    scene: LightField, tmp_path: Path, fixed_clock: list[str]
) -> None:
    bench([scene], ["fbs:step=0.2"], tmp_path)
    before = outputs(tmp_path)
    (run_file,) = (tmp_path / "cache").glob("*.npz")
    run_file.write_bytes(run_file.read_bytes()[:99])
    assert bench([scene], ["fbs:step=0.2"], tmp_path).failures == ()
    assert outputs(tmp_path) == before
    assert len(fixed_clock) == 2


def test_where_something_unforeseen_went_wrong_stands_in_the_log(
    scene: LightField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def stumble(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(run, "estimate", stumble)
    with caplog.at_level("INFO", "lfdepth"):
        (failure,) = bench([scene], ["fbs"], tmp_path).failures
    assert str(failure) == "demo / fbs: ZeroDivisionError: by nothing"
    assert "in stumble" in caplog.text


def test_it_goes_on_past_what_fails_and_names_it(scene: LightField, tmp_path: Path) -> None:
    rangeless = replace(scene, disparity_range=None, views=np.full_like(scene.views, 99), name="rangeless")
    result = bench([tmp_path / "absent", rangeless, scene], ["fbs:step=0.2"], tmp_path / "out")
    assert [each.name for each in result.scenes] == ["rangeless", "demo"]
    assert [(each.scene, each.method) for each in result.failures] == [
        ("absent", None),
        ("rangeless", "fbs:step=0.2"),
    ]
    for name in ("report.html", "results.md", "results.json"):
        text = (tmp_path / "out" / name).read_text()
        assert "absent: " in text or "absent" in json.loads(text)["failures"][0]["message"]
        assert "rangeless" in text


def test_other_programs_results_join(scene: LightField, tmp_path: Path) -> None:
    assert scene.truth is not None
    maps = {"good": scene.truth, "small": scene.truth[:5], "empty": np.full_like(scene.truth, np.nan)}
    for name, values in maps.items():
        folder = tmp_path / name / "disp_maps"
        folder.mkdir(parents=True)
        header = f"Pf\n{values.shape[1]} {values.shape[0]}\n-1\n".encode()
        (folder / "demo.pfm").write_bytes(header + values[::-1].astype("<f4").tobytes())
    (tmp_path / "good" / "runtimes").mkdir()
    (tmp_path / "good" / "runtimes" / "demo.txt").write_text("12.5\n")
    result = bench([scene], [], tmp_path / "out", external=[tmp_path / name for name in maps])
    entries = result.scenes[0].entries
    assert set(entries) == {"good"}
    scores = entries["good"].scores
    assert scores is not None
    assert (scores["badpix_0.01"], entries["good"].found.runtime) == (0.0, 12.5)
    messages = [str(each) for each in result.failures]
    assert "demo / small: demo: estimate is 64x5 px; expected 64x64 px" in messages[0]
    assert "demo / empty: demo: estimate has no finite value" in messages[1]
    assert len(messages) == 2


def test_a_missing_run_time_is_named_and_the_map_scored(scene: LightField, tmp_path: Path) -> None:
    folder = tmp_path / "quick"
    folder.mkdir()
    assert scene.truth is not None
    lfdepth.write(folder / "demo.pfm", scene.truth)
    result = bench([scene], [], tmp_path / "out", external=[folder])
    assert "quick: no demo.txt; expected a run time in seconds" in str(result.failures[0])
    (folder / "demo.txt").write_text("soon")
    other = bench([scene], [], tmp_path / "out", external=[folder])
    assert "demo.txt: found 'soon'; expected a run time in seconds" in str(other.failures[0])
    for each in (result, other):
        entry = each.scenes[0].entries["quick"]
        assert entry.scores is not None
        assert (entry.scores["badpix_0.07"], entry.found.runtime) == (0, None)


def test_a_mask_that_cannot_be_used_is_named_and_the_rest_is_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))  # nothing is copied
    folder = tmp_path / "wedges"
    scenes.save("wedges", folder, size=64, views=3)
    for name in ("planes_lowres", "foreground_thinning_highres"):
        Image.fromarray(np.zeros((4, 5), np.uint8)).save(folder / f"mask_{name}.png")
    (folder / "mask_textureless_lowres.png").write_bytes(b"junk")
    result = bench([folder], ["fbs:step=0.2"], tmp_path / "out")
    scores = result.scenes[0].entries["fbs:step=0.2"].scores
    assert scores is not None
    assert scores["backgammon_fattening"] >= 0
    for key, name in (
        ("bumpiness_planes", "mask_planes_lowres.png: 5x4 px; expected 64x64 px"),
        ("badpix_0.07_textureless", "mask_textureless_lowres.png: not a readable picture"),
    ):
        assert name in scores.missing[key]
        assert any(name in str(failure) for failure in result.failures)
    # The low-resolution mask stands in for the high-resolution one that cannot be used, and the cell says so.
    assert scores.notes["backgammon_thinning"] == "low-resolution truth"
    assert any("mask_foreground_thinning_highres.png: 5x4 px" in str(each) for each in result.failures)
    (folder / "input_Cam004.png").write_bytes(b"junk")
    assert bench([folder], ["fbs:step=0.2"], tmp_path / "out").scenes == ()


def test_a_scene_without_truth_has_maps_and_no_scores(scene: LightField, tmp_path: Path) -> None:
    result = bench([replace(scene, truth=None, masks={}, name="real")], METHODS, tmp_path)
    assert all(entry.scores is None for entry in result.scenes[0].entries.values())
    assert len(pictures_in((tmp_path / "report.html").read_text())) == 3


# --- the report


def pictures_in(page: str) -> list[Image.Image]:
    found = re.findall(r'src="data:image/webp;base64,([^"]*)"', page)
    return [Image.open(io.BytesIO(base64.b64decode(each))) for each in found]


def test_the_page_needs_no_other_file_and_its_pictures_load(scene: LightField, tmp_path: Path) -> None:
    named = replace(scene, name="<b>&demo")
    bench([named], [METHODS[0], Setting("<i>sfa", "fbs-sfa", {"step": 0.2})], tmp_path)
    page = (tmp_path / "report.html").read_text()
    images = pictures_in(page)
    assert len(images) == 1 + 2 + 1 + 2 + 1  # view, maps; truth, errors; one difference
    for image in images:
        image.load()
        assert image.size == (64, 64)
    assert "<b>&" not in page
    assert "<i>" not in page
    assert "{{" not in page
    assert "{%" not in page
    assert not re.findall(r'(?:src|href)="(?!data:)', page)


def test_pictures_carry_the_scores_of_the_tables_and_the_page_says_what_was_run(
    scene: LightField, tmp_path: Path
) -> None:
    scenes.save("wedges", tmp_path / "wedges", size=64, views=3)
    result = bench([tmp_path / "wedges", scene], METHODS, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    for each in result.scenes:
        for name, entry in each.entries.items():
            assert entry.scores is not None
            assert f"{name}: BadPix 0.07 {figures(entry.scores['badpix_0.07'])} %, MSE×100" in page
    means = page[page.index("Means over the scenes") : page.index("BadPix 0.07 <small>")]
    for row in next(each for each in tables(result) if each.key == "badpix_0.07").rows[:2]:
        assert row.mean.value is not None
        assert figures(row.mean.value) in means
    assert '<tr><th>wedges</th><td class="words">3×3</td><td class="words">64×64</td>' in page
    assert "low and high resolution" in page
    assert "step 0.2, delta photo, threshold 0.03" in page


def result_of(scores: dict[str, dict[str, float]], size: int = 32) -> Bench:
    """Bench with a score by method and scene, of maps of noise."""
    rng = np.random.default_rng(0)
    names = list(next(iter(scores.values())))
    scenes = [
        SceneResult(
            name,
            rng.integers(0, 255, (size, size, 3), np.uint8),
            np.zeros((size, size)),
            (-1.0, 1.0),
            {
                method: Entry(
                    Found(rng.normal(0, 0.3, (size, size)), runtime=1.0),
                    Scores(name, {"badpix_0.07": values[name]}, {"badpix_0.07": "low"}),
                )
                for method, values in scores.items()
                if name in values
            },
        )
        for name in names
    ]
    return Bench(tuple(scenes), dict.fromkeys(scores, "measured"))


def badpix_table(result: Bench, *, published: bool = True) -> MetricTable:
    return next(each for each in tables(result, published=published) if each.key == "badpix_0.07")


def test_pictures_are_compressed_to_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    result = result_of({"a": {"one": 1.0}, "b": {"one": 1.0}}, 128)
    whole = len(html_page.html_text(result, ()))
    monkeypatch.setattr(html_page, "BUDGET", whole // 5)
    assert len(html_page.html_text(result, ())) < whole * 0.5


def test_published_rows_rank_only_on_the_same_truth() -> None:
    table = badpix_table(result_of({"mine": {"cotton": 0.3, "backgammon": 3.0}}))
    mine = table.rows[0]
    # Below 0.3 on cotton: SubFocal 0.26, LFAttNet 0.271. On backgammon, where only low-resolution truth
    # compares: SubFocal 1.63, SPO 2.55, OACC-Net 2.57.
    assert [cell.rank for cell in mine.cells] == [3, 4]
    attention = next(row for row in table.rows if row.method == "LFAttNet")
    assert [cell.cell.text for cell in attention.cells] == ["0.271", "3.13 (high)"]
    assert attention.mean.rank == 0
    assert next(row for row in table.rows if row.method == "SubFocal").mean.rank == 1


@pytest.mark.parametrize(("count", "bold"), [(1, 0), (2, 1), (3, 2), (4, 3), (9, 3)])
def test_the_best_three_are_bold_but_never_the_last(count: int, bold: int) -> None:
    table = badpix_table(result_of({f"m{i}": {"x": float(i)} for i in range(count)}), published=False)
    assert [row.cells[0].best for row in table.rows] == [i < bold for i in range(count)]


def test_a_mean_over_fewer_scenes_says_so_and_is_not_ranked() -> None:
    table = badpix_table(result_of({"a": {"x": 1.0, "y": 3.0}, "b": {"x": 1.0}}), published=False)
    assert table.rows[0].mean.cell.text == "2.00"
    assert (table.rows[1].mean.rank, table.rows[1].mean.note) == (0, "1 of 2 scenes")
    assert table.rows[1].cells[1].cell.text == "failed"


def test_scenes_without_the_metric_play_no_part_in_its_mean() -> None:
    result = result_of({"a": {"x": 1.0, "y": 3.0}, "b": {"x": 2.0, "y": 2.5}})
    real = replace(result.scenes[0], name="real", truth=None)
    entries = {name: replace(each, scores=None) for name, each in real.entries.items()}
    slow = {name: replace(each, found=replace(each.found, runtime=99.0)) for name, each in entries.items()}
    result = replace(result, scenes=(*result.scenes, replace(real, entries=slow)))
    table = badpix_table(result, published=False)
    assert [cell.cell.text for cell in table.rows[0].cells] == ["1.00", "3.00", "no truth"]
    assert [(row.mean.value, row.mean.note, row.mean.rank) for row in table.rows] == [
        (2.0, "", 1),
        (2.25, "", 2),
    ]
    # Both points of the scatter lie at the run time, 1 s, of the scenes whose errors were averaged.
    page = html_page.html_text(result, tables(result, published=False))
    assert "<title>a: 1, 2</title>" in page


def test_run_times_come_in_seconds_and_as_their_logarithm() -> None:
    result = result_of({"a": {"x": 1.0}, "b": {"x": 2.0}})
    entry = result.scenes[0].entries["b"]
    entries = {**result.scenes[0].entries, "b": replace(entry, found=replace(entry.found, runtime=0.01))}
    result = replace(result, scenes=(replace(result.scenes[0], entries=entries),))
    seconds, logarithms = tables(result)[-2:]
    assert [row.cells[0].value for row in seconds.rows[:2]] == [1.0, 0.01]
    assert [row.cells[0].value for row in logarithms.rows[:2]] == [0.0, -2.0]
    assert [row.cells[0].rank for row in logarithms.rows[:2]] == [2, 1]
    spo = next(row for row in logarithms.rows if row.method == "SPO")
    assert spo.mean.value == pytest.approx(np.log10(2130))


def test_published_averages_are_the_means_of_their_rows() -> None:
    checked = 0
    for row in published_rows():
        for key, average in row.averages.items():
            if len(row.scores.get(key, {})) == 12:
                assert np.mean(list(row.scores[key].values())) == pytest.approx(average, abs=0.01)
                checked += 1
    assert checked == 10


def test_axes_have_round_ticks_inside() -> None:
    assert Axis("", 0.0, 9.0).ticks() == [0, 2, 4, 6, 8]
    assert Axis("", 0.5, 20.0, log=True).ticks() == [0.5, 1, 2, 5, 10, 20]
    assert Axis("", 1.0, 100.0, log=True).place(10.0) == pytest.approx(0.5)


# --- what to run


def test_settings_are_read_from_text_and_crossed() -> None:
    each = setting("fbsocc-sfa:step=0.02,skip=7,guide=grey,subplane=false")
    used = each.resolve().parameters()
    expected = {"step": 0.02, "skip": 7, "guide": "grey", "subplane": False}
    assert {key: used[key] for key in expected} == expected
    crossed = cross([setting("fbs"), setting("fbs-sfa")], [{"step": 0.1}, {"step": 0.2}])
    assert [one.name for one in crossed] == [
        "fbs step=0.1",
        "fbs step=0.2",
        "fbs-sfa step=0.1",
        "fbs-sfa step=0.2",
    ]
    assert crossed[3].resolve().parameters()["step"] == 0.2
    with pytest.raises(LightFieldError, match="found 'step'; expected METHOD:NAME=VALUE"):
        setting("fbs:step")
    for word in ("False", "false", "no", "off"):
        assert setting(f"fbs-vis:gloss={word}").resolve().parameters()["gloss"] is False
    for text, message in (
        ("fbs-vis:gloss=maybe", "gloss: found 'maybe', expected yes or no"),
        ("fbs:photo_weight=5", "photo_weight: method fbs has no such parameter"),
        ("fbs:radius=2.5", "radius: found '2.5', expected a whole number"),
    ):
        with pytest.raises(LightFieldError, match=message):
            setting(text).resolve()


def test_a_plan_is_read_from_toml(tmp_path: Path) -> None:
    (tmp_path / "near").mkdir()
    plan = tmp_path / "plan.toml"
    plan.write_text(
        'scenes = ["near", "leaves", { path = "far", name = "renamed", range = [-1, 2], views = 5 }]\n'
        'methods = ["fbs", { method = "fbsocc-sfa", name = "J = 5", skip = 5 }]\n'
        'external = ["others"]\n[[settings]]\nstep = 0.1\n'
    )
    found = read_plan(plan)
    assert [spec.source for spec in found.scenes] == [tmp_path / "near", "leaves", "far"]
    assert found.scenes[2].range == (-1.0, 2.0)
    assert [each.name for each in found.settings] == ["fbs step=0.1", "J = 5 step=0.1"]
    assert found.settings[1].resolve().parameters()["skip"] == 5
    assert found.external == (tmp_path / "others",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenes = [", "plan.toml: .*expected a TOML file"),
        ('scenes = []\nmethod = "fbs"', "unknown key 'method'"),
        ("methods = []", "missing or unexpected 'scenes'"),
        ('scenes = [{ path = "a", colour = 1 }]\nmethods = []', "colour"),
        ('scenes = ["a"]\nmethods = ["fbs:step"]', "expected METHOD:NAME=VALUE"),
    ],
)
def test_an_unusable_plan_is_named(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(LightFieldError, match=message):
        read_plan(tmp_path / "plan.toml")


def test_unusable_arguments_are_named_before_anything_runs(scene: LightField, tmp_path: Path) -> None:
    for lfs, methods, message in (
        ([], METHODS, "nothing to run"),
        ([scene], [], "nothing to run"),
        ([scene], ["fbx"], "found 'fbx'"),
        ([scene], ["fbs", "fbs"], "two methods are called 'fbs'"),
        ([scene, scene], ["fbs"], "two scenes are called 'demo'"),
    ):
        with pytest.raises(LightFieldError, match=message):
            bench(lfs, methods, tmp_path / "out")
    with pytest.raises(LightFieldError, match="no such folder; expected results"):
        bench([scene], [], tmp_path / "out", external=[tmp_path / "none"])
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    with pytest.raises(LightFieldError, match="cannot be created"):
        bench([scene], METHODS, tmp_path / "file" / "out")


def test_a_scene_can_be_renamed_cropped_and_given_a_range(scene: LightField) -> None:
    lf = SceneSpec(scenes.render("bars", size=32, views=5), "new", (-1.0, 1.0), 3).load()
    assert (lf.name, lf.disparity_range, lf.shape[:2]) == ("new", (-1.0, 1.0), (3, 3))
