"""A method in a package of its own appears everywhere without a line changed in lfdepth."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fields
import lfdepth
from lfdepth import engines
from lfdepth.io import read_disparity
from lfdepth.lightfield import LightField

PACKAGE = Path(__file__).parent / "plugin"
PAGE = Path(__file__).parents[1] / "docs" / "write-a-method.md"

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package in a folder of its own, laid out as installers do: the code, and its entry points."""
    site = tmp_path_factory.mktemp("site")
    shutil.copytree(PACKAGE / "src" / "lfdepth_nearest", site / "lfdepth_nearest")
    described = (PACKAGE / "pyproject.toml").read_text(encoding="utf-8")
    entries = re.search(r'\[project.entry-points."lfdepth.methods"\]\n(.+?)\n\n', described, re.DOTALL)
    assert entries is not None
    info = site / "lfdepth_nearest-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lfdepth-nearest\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lfdepth.methods]\n" + entries[1].replace('"', "") + "\n")
    return site


@pytest.fixture
def run(installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command line where the package is installed, in a folder with a scene."""
    source = Path(lfdepth.__file__).parents[1]
    monkeypatch.setenv("PYTHONPATH", f"{installed}:{source}")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)
    paint = fields.texture(np.random.default_rng(1))
    views = fields.plane_views(paint, 0.4, (5, 5), (48, 48))[..., None].repeat(3, axis=-1)
    lfdepth.write("scene.npz", LightField(fields.quantise(views, "uint8"), disparity_range=(-0.5, 1.0)))

    def command(*words: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "-c", "import sys; from lfdepth.cli import main; sys.exit(main())", *words]
        return subprocess.run(program, capture_output=True, text=True, check=False)

    return command


def test_it_is_listed_with_its_parameters(run: Run) -> None:
    assert "nearest: The plane on which most views agree" in run("methods").stdout
    listed = {each["name"]: each for each in json.loads(run("methods", "--json").stdout)["methods"]}
    parameters = {each["name"]: each for each in listed["nearest"]["parameters"]}
    assert list(parameters) == ["step", "radius"]
    assert parameters["step"]["unit"] == "px per view step"
    assert (parameters["radius"]["ge"], parameters["radius"]["le"]) == (1, 100)


def test_its_help_shows_its_own_parameters(run: Run) -> None:
    shown = run("estimate", "--method", "nearest", "--help").stdout
    assert "Parameters of nearest" in shown
    assert "A whole number from 1 to 100 (px). [default: 3]" in shown
    assert "--epsilon" not in shown


@pytest.mark.thin(2)
@pytest.mark.parametrize("engine", engines.NAMES)
def test_it_estimates_and_says_how(run: Run, engine: str) -> None:
    """Truth: a plane at 0.4, which is one of the planes that are searched."""
    words = "estimate scene.npz -o map.npy --method nearest --step 0.1 --radius 2 --json --engine"
    done = run(*words.split(), engine)
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["method"] == {"name": "nearest", "step": 0.1, "radius": 2}
    assert (facts["planes"], facts["engine"]) == (16, engine)
    assert np.mean(np.abs(read_disparity("map.npy")[6:-6, 6:-6] - 0.4) < 0.01) > 0.99


@pytest.mark.slow
def test_it_is_compared_with_settings(run: Run) -> None:
    done = run("bench", "scene.npz", "--methods", "nearest:step=0.2", "fbs", "-o", "out", "--json")
    assert done.returncode == 0, done.stderr
    names = {each["method"] for each in json.loads(done.stdout)["results"]}
    assert names == {"nearest:step=0.2", "fbs"}
    assert "nearest" in (Path("out") / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--gloss", ["--gloss", "method nearest", "--step, --radius"]),
        ("--radius 0", ["--radius", "found 0", "from 1 to 100"]),
        ("--radius 30", ["windows of 61 px", "48×48 px"]),
    ],
)
def test_its_parameters_are_checked_like_all_others(run: Run, words: str, parts: list[str]) -> None:
    done = run("estimate", "scene.npz", "-o", "map.npy", "--method", "nearest", *words.split())
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert all(part in done.stderr for part in parts), done.stderr
    assert not Path("map.npy").exists()


@pytest.mark.slow
def test_a_package_that_cannot_be_loaded_is_named_and_the_others_work(run: Run, installed: Path) -> None:
    code = installed / "lfdepth_nearest" / "__init__.py"
    whole = code.read_text(encoding="utf-8")
    try:
        code.write_text("import nothing_of_this_name\n", encoding="utf-8")
        done = run("estimate", "scene.npz", "-o", "map.npy", "--method", "nearest")
        assert done.returncode == 2
        assert "nothing_of_this_name" in done.stderr
        assert done.stderr.count("\n") == 1
        listed = run("methods")
        assert listed.returncode == 0, listed.stderr
        assert "fbs-vis: " in listed.stdout
        assert "nearest: cannot be used" in listed.stdout
        assert run("estimate", "scene.npz", "-o", "map.npy", "--method", "fbs").returncode == 0
    finally:
        code.write_text(whole, encoding="utf-8")


def test_the_page_shows_the_packages_own_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for file in (PACKAGE / "pyproject.toml", PACKAGE / "src" / "lfdepth_nearest" / "__init__.py"):
        assert file.read_text(encoding="utf-8").strip() in page, file.name
