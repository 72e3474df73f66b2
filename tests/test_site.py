"""The documentation site, without building it: nothing is left out, nothing is shown that is not there."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from dataclasses import fields
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path
from types import ModuleType

import pytest

import lfdepth
from lfdepth import methods

DOCS = Path(__file__).parents[1] / "docs"
SCRIPTS = sorted([*DOCS.glob("gallery/*.py"), *DOCS.glob("method/*.py")])
PAGES = sorted(page.stem for page in DOCS.glob("*.md"))


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    """The extension that makes pages from the program; it needs no Sphinx for that."""
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        return import_module("reference")
    finally:
        sys.path.pop(0)


def listed(page: str) -> set[str]:
    """Pages that the tables of contents of a page name, patterns spelt out."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    tables = re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    names = [line.strip() for table in tables for line in table.splitlines() if line and line[0] not in ":\n"]
    return {match.stem for name in names for match in DOCS.glob(f"{name}.md")} | {
        name for name in names if "*" not in name
    }


def test_every_page_is_in_the_table_of_contents() -> None:
    seen, left = set[str](), ["index"]
    while left:
        page = left.pop()
        seen.add(page)
        if (DOCS / f"{page}.md").is_file():
            left += listed(page) - seen
    assert set(PAGES) <= seen
    assert {"_generated/gallery/index", "_generated/method/index", "_generated/commands"} <= seen
    assert {"_generated/parameters", "_generated/changes", "_generated/contributing"} <= seen


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    """In the repository's own view, which knows no Sphinx."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (DOCS / target).exists(), target


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_scripts_call_public_names(script: Path) -> None:
    """Whatever a script takes from lfdepth is there, and is not private."""
    tree = ast.parse(script.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "lfdepth":
            exec(compile(ast.Module([node], []), script.name, "exec"), {})
            assert not [name.name for name in node.names if name.name.startswith("_")]
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "lfdepth"
        ):
            assert node.attr in lfdepth.__all__, node.attr


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_scripts_end_in_pictures(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert text.count("plt.subplots(") >= 1
    assert (ast.get_docstring(ast.parse(text)) or "").splitlines()[1].startswith("===")


def test_every_public_name_is_on_one_page(reference: ModuleType) -> None:
    shown = [name for group in reference.groups().values() for name in group.names]
    assert sorted(shown) == sorted(lfdepth.__all__)
    text = "\n".join(reference.pages().values())
    for name in lfdepth.__all__:
        assert re.search(rf"^\.\. auto(function|class):: {name}$", text, re.MULTILINE), name


def test_every_command_and_option_is_on_the_page(reference: ModuleType) -> None:
    from lfdepth.cli.app import app
    from lfdepth.cli.options import MapSource, Reading

    text = reference.commands_page()
    commands = {f"lfdepth {name}": app[name] for name in app if not name.startswith("-")}
    for group in [name for name, command in commands.items() if command.default_command is None]:
        members = commands.pop(group)
        commands |= {f"{group} {name}": members[name] for name in members if name[0] != "-"}
    assert {"lfdepth batch", "lfdepth scenes render", "lfdepth train", "lfdepth view"} <= commands.keys()
    groups = {"reading": fields(Reading), "source": fields(MapSource)}
    others = {"as_json": "json", "options": "step"}
    for name, command in commands.items():
        section = re.split(r"^##+ ", text.split(f"# {name}\n")[1], flags=re.MULTILINE)[0]
        assert command.default_command is not None
        for parameter in signature(command.default_command).parameters.values():
            if parameter.kind is not Parameter.KEYWORD_ONLY:
                continue
            own = [others.get(parameter.name, parameter.name)]
            for option in [each.name for each in groups.get(parameter.name, ())] or own:
                assert re.search(rf"--{option.replace('_', '-')}[ `,]", section), (name, option)
    assert "sphinx" not in text.lower()


def test_every_parameter_is_on_the_page(reference: ModuleType) -> None:
    page = reference.parameters_page()
    for name in methods.names():
        section = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in methods.parameters_of(methods.method_class(name)).values():
            row = re.search(rf"^\| `{parameter.name}` \|.*$", section, re.MULTILINE)
            assert row, (name, parameter.name)
            unit = getattr(parameter.spec, "unit", "") or ""
            for part in (unit, parameter.spec.symbol or ""):
                assert part in row[0]


def test_a_chart_becomes_a_list_of_its_boxes(reference: ModuleType) -> None:
    chart = '```mermaid\nflowchart TB\n    a["cli: words"] --> b["io"]\n    b --> c["camera"]\n```'
    assert reference.for_the_site(chart) == "```text\ncli: words\n  ↓\nio\n  ↓\ncamera\n```"


@pytest.mark.slow
def test_the_site_is_built_without_warnings(tmp_path: Path) -> None:
    """With the gallery's scripts, which takes minutes; in a copy, as pages are generated beside them."""
    pytest.importorskip("sphinx_gallery", reason="the extra docs is not installed")
    root = DOCS.parent
    for name in ("docs", "CHANGELOG.md", "CONTRIBUTING.md"):
        copy = shutil.copytree if (root / name).is_dir() else shutil.copy
        copy(root / name, tmp_path / name)
    shutil.rmtree(tmp_path / "docs/_generated", ignore_errors=True)
    command = [sys.executable, "-m", "sphinx", "-W", "-b", "html", "docs", "html"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("index", "_generated/gallery/08_refocus_video", "_generated/commands"):
        assert (tmp_path / f"html/{name}.html").is_file()
    network = re.compile(r'(?:src|href)="https?://[^"]*\.(?:js|css|woff2?)"')
    for page in (tmp_path / "html").rglob("*.html"):
        assert not network.search(page.read_text(encoding="utf-8")), page
