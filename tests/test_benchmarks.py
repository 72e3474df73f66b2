"""The scripts under benchmarks/ run, at a tiny size, and their figures are whole."""

import importlib
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lfdepth.bench.plan import setting
from lfdepth.methods import method

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "benchmarks"


def run(script: str, *arguments: str) -> str:
    command = [sys.executable, str(SCRIPTS / f"{script}.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def measured(script: str, folder: Path, *arguments: str) -> tuple[str, dict[str, Any]]:
    """What a script printed, and the figures that it wrote."""
    file = folder / "figures.json"
    text = run(script, *arguments, "--json", str(file))
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return text, found


@pytest.mark.slow
def test_ablation(tmp_path: Path) -> None:
    options = ["--size", "48", "--scenes", "demo", "--variants", "fbs-vis", "no photo votes"]
    text, found = measured("ablation", tmp_path, *options)
    assert [row["variant"] for row in found["rows"]] == ["fbs-vis", "no photo votes"]
    # The variant without an ingredient is another method, not the same one under another name.
    one, other = (row["scores"]["mse_x100"] for row in found["rows"])
    assert one != other
    assert "## Depth edges and thin structures" in text
    assert run("ablation", "--from", str(tmp_path / "figures.json")).strip() == text.strip()


@pytest.mark.slow
def test_accuracy(tmp_path: Path) -> None:
    text, found = measured("accuracy", tmp_path, "--size", "48", "--scenes", "demo", "--methods", "fbs-sfa")
    scores = found["scenes"]["demo"]["fbs-sfa"]
    assert 0 < scores["badpix_0.07"] < 100
    assert "### demo, 48×48 px" in text


@pytest.mark.slow
def test_memory(tmp_path: Path) -> None:
    options = ["--size", "48", "--methods", "fbs", "--steps", "0.5", "0.1", "--warm"]
    _, found = measured("memory", tmp_path, *options)
    few, many = found["runs"]
    assert few["planes"] < many["planes"]
    assert 50 < few["peak"] < found["limit_mb"]


@pytest.mark.slow
def test_memory_of_a_large_light_field(tmp_path: Path) -> None:
    text, found = measured("memory", tmp_path, "--large", "--size", "128", "--views", "5")
    assert text.startswith("5×5 views of 128×128 px")
    parts = [each["read"] for each in found["runs"]]
    assert parts == [
        "",
        "--views 3x3",
        "--crop 32 32 64 64",
        "--scale 0.5",
    ]


@pytest.mark.slow
def test_startup(tmp_path: Path) -> None:
    _, found = measured("startup", tmp_path, "--size", "48", "--methods", "fbs", "--repeats", "1")
    assert found["starts_s"]["python"][0] < found["starts_s"]["lfdepth --help"][0]
    (first,) = found["first_runs_s"]
    assert first["cold_cpu"] > first["warm_cpu"]
    # All that was compiled, in whatever process, is in the cache.
    assert (first["cold_compiled"], first["warm_compiled"]) == (True, False)


@pytest.mark.slow
def test_whole(tmp_path: Path) -> None:
    options = ["--size", "48", "--rounds", "1", "--repeats", "1", "--against", str(ROOT / "src")]
    _, found = measured("whole", tmp_path, *options)
    seconds = found["seconds"]
    # The other version is this one; the machine may be busy with one of them.
    assert len(seconds) == 4
    assert 0.1 < seconds["the other version"] / seconds["with both, as is the default"] < 10


def test_ablation_spells_settings_as_the_command_line_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    variants = importlib.import_module("ablation").VARIANTS
    page = (ROOT / "docs" / "ablation.md").read_text(encoding="utf-8")
    table = page[page.index("| variant | what is different |") : page.index("BadPix and the columns")]
    rows = dict(re.findall(r"^\| ([^|]+?) \| (.*) \|$", table, re.MULTILINE)[1:])
    assert set(rows) == set(variants) - {"fbs-vis"}
    for name, words in rows.items():
        used, options = variants[name]
        if options:
            text = f"{used}:{re.findall('`([^`]+)`', words)[0]}"
            assert setting(text).resolve() == method(used, **options), name
        else:
            assert used == name


@pytest.mark.slow
def test_occluders() -> None:
    text = run("occluders", "--scenes", "fence", "--size", "48", "--labels", "9")
    rows = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("|")][2:]
    assert [row[0].strip() for row in rows] == ["fence"]
    assert all(0 < float(value) < 100 for row in rows for value in row[1:])
