"""What the documentation tells people to paste, pasted."""

from __future__ import annotations

import re
import shlex
import tomllib
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, metadata
from itertools import chain
from pathlib import Path

import numpy as np
import plyfile  # type: ignore[import-untyped]
import pytest
from cyclopts import CycloptsError, MissingArgumentError
from PIL import Image

from lfdepth.cli import main

DOCS = Path(__file__).parents[1] / "docs"


def blocks(name: str, heading: str | None = None) -> list[tuple[str, str]]:
    """(language, text) of every code block of a page, or of one chapter of it."""
    text = (DOCS / name).read_text(encoding="utf-8")
    if heading is not None:
        text = re.split(r"^## ", text.split(f"## {heading}")[1], flags=re.MULTILINE)[0]
    found = re.findall(r"^( *)```(\w+)\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [(kind, re.sub(rf"^{indent}", "", code, flags=re.MULTILINE)) for indent, kind, code in found]


def paste(page: list[tuple[str, str]], capsys: pytest.CaptureFixture[str]) -> str:
    """Run commands and Python of a page one after another; what they printed."""
    names: dict[str, object] = {}
    printed = ""
    for language, code in page:
        if language == "python":
            exec(compile(code, "page", "exec"), names)
        for line in code.splitlines() if language == "sh" else ():
            if line.startswith("lfdepth "):
                assert main(shlex.split(line)[1:]) == 0, (line, capsys.readouterr().err)
                printed += capsys.readouterr().out
    return printed


def test_my_own_camera_array(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pictures are a tenth of the size, so their pixels are ten times as large, and distances a tenth."""
    monkeypatch.chdir(tmp_path)
    Path("shots").mkdir()
    noise = np.random.default_rng(0).integers(0, 256, (44, 59), np.uint8)
    wall = Image.fromarray(noise).resize((472, 348), Image.Resampling.BICUBIC)
    for v, u in np.ndindex(5, 7):  # a wall at 12 px per view step
        view = wall.crop((12 * u, 12 * v, 12 * u + 400, 12 * v + 300))
        view.save(f"shots/row{v + 1}_col{u + 1}.jpg", quality=95)
    printed = paste(blocks("formats.md", "My own camera array"), capsys)
    assert "7×5 views of 100×75 px, grey" in printed
    assert "(estimated from the views)" in printed
    middle = np.load("shots.npz")["disparity"][15:-15, 15:-15]
    assert np.abs(middle - 3).mean() < 0.1
    cloud, surface = (plyfile.PlyData.read(name) for name in ("shots.ply", "surface.ply"))
    assert len(cloud["vertex"].data) == 7500
    assert np.median(cloud["vertex"]["z"]) == pytest.approx(10e-3 * 4.2 / (5.6 / 100) / 3, rel=0.02)
    assert len(surface["face"].data) > 10000


def test_using(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    page = [(language, code.replace("--size 256", "--size 128")) for language, code in blocks("using.md")]
    printed = paste(page, capsys)
    told = next(code for language, code in page if language == "text")
    assert told.strip() in printed  # what the page says that is printed
    for picture in ("wall.png", "sharp.png", "through.png"):
        assert Image.open(picture).size == (128, 128)
    assert len(list(Path("masks").glob("*.png"))) == 81
    assert Path("fence.ply").stat().st_size > 128 * 128 * 15


def test_the_licence_of_every_dependency_is_listed() -> None:
    """As the packages themselves state it, where they state it in the usual words."""
    rows = re.findall(
        r"^\| (\w+)[^|]*\|[^|]*\| ([^|]+) \|$", (DOCS / "dependencies.md").read_text(), re.MULTILINE
    )
    licences = {name: licence for name, licence in rows if name != "package"}
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())["project"]
    extras = {
        name: each
        for name, each in project["optional-dependencies"].items()
        if name not in ("all", "dev", "docs")
    }
    needed = {re.split(r"[>=<\[ ]", each)[0] for each in [*project["dependencies"], *chain(*extras.values())]}
    assert set(licences) == needed
    for name, licence in licences.items():
        with suppress(PackageNotFoundError):
            stated = metadata(name)
            if "License-Expression" in stated:
                assert licence == stated["License-Expression"], name


def commands_of(page: Path) -> tuple[list[str], list[str]]:
    """What a page tells people to run: whole lines of its blocks, and what stands between back ticks."""
    text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
    code = "\n".join(re.findall(r"^ *```(?:sh|bash)\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL))
    lines = re.findall(r"^ *(?:\.venv/bin/)?(lfdepth .*)$", code, re.MULTILINE)
    return lines, re.findall(r"`(lfdepth [a-z][^`\n]*)`", text)


def parse(line: str) -> None:
    """As the command line parses it, running nothing; capital letters stand for a number."""
    from lfdepth.cli import commands, experiments, learned, scale, viewing  # noqa: F401  # they register themselves
    from lfdepth.cli.app import app
    from lfdepth.cli.options import method_named_in

    words = shlex.split(re.split(r"\s(?:#|>|2>|&&|\|)", line)[0])[1:]
    words = ["1" if re.fullmatch("[A-Z]", word) else word for word in words if word != "--help"]
    commands.add_estimate(method_named_in(words) if "estimate" in words else None)
    app.parse_args(words, exit_on_error=False, print_error=False)


PAGES = [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_pages_are_such(page: Path) -> None:
    """Commands, options and values are what the command line takes; in running text they may be cut short."""
    lines, mentioned = commands_of(page)
    for line in lines:
        parse(line)
    for line in mentioned:
        with suppress(MissingArgumentError):
            parse(line)


def test_a_wrong_command_fails() -> None:
    for line in (
        "lfdepth estimat x",
        "lfdepth estimate x -o y --steps 2",
        "lfdepth refocus x --disparity near",
    ):
        with pytest.raises(CycloptsError):
            parse(f"lfdepth {line}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_scripts_that_pages_name_have_these_options(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for script, options in re.findall(r"python (benchmarks/\w+\.py)([^`\n]*)", text):
        source = (DOCS.parent / script).read_text(encoding="utf-8")
        for option in re.findall(r"(?<!\S)--[a-z][\w-]*", options):
            assert f'"{option}"' in source, (script, option)
