"""The page on what looks wrong has every warning of the code, and none that the code does not give."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/when-something-looks-wrong.md").read_text(encoding="utf-8")
PROBE = ROOT / "src/lfdepth/probe"

# Where the code makes its warnings: module, functions.
SOURCES = {
    "checks": ("_warnings", "_measured"),
    "order": ("message",),
    "ranges": ("find_range",),
}
# What these say that is no warning, or follows one.
OTHERS = (
    "views are in order",
    "use …",
    "leave out …",
    "…, or, if near and far come out swapped, …",
    "…",
    "limit",
    "the range, ",
)


def text_of(node: ast.expr) -> str:
    """A string or f-string of the code, … for what is put in."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    assert isinstance(node, ast.JoinedStr)
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)


def said_by(module: str, names: tuple[str, ...]) -> list[str]:
    """The first part of every message that functions make, up to what to do."""
    found = []
    for function in ast.walk(ast.parse((PROBE / f"{module}.py").read_text(encoding="utf-8"))):
        if not (isinstance(function, ast.FunctionDef) and function.name in names):
            continue
        inside = {
            part for node in ast.walk(function) if isinstance(node, ast.JoinedStr) for part in node.values
        }
        for node in ast.walk(ast.Module(function.body[1:], [])):
            if isinstance(node, ast.JoinedStr) or (
                isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in inside
            ):
                found.append(re.sub(r"^…: ", "", text_of(node)).split(";")[0])
    return [text for text in found if len(text) > 20 and text not in OTHERS and "found …" not in text]


MESSAGES = sorted({text for module, names in SOURCES.items() for text in said_by(module, names)})
HEADINGS = re.findall(r'^### "(.*)"$', PAGE, re.MULTILINE)


def test_there_are_messages() -> None:
    assert len(MESSAGES) >= 12


@pytest.mark.parametrize("message", MESSAGES)
def test_every_warning_is_on_the_page(message: str) -> None:
    if message.startswith("…, or, if near and far"):
        return  # a second piece of advice within one
    assert any(message.startswith(heading) for heading in HEADINGS), message


@pytest.mark.parametrize("heading", HEADINGS)
def test_every_heading_is_a_warning(heading: str) -> None:
    assert any(message.startswith(heading) for message in MESSAGES)


@pytest.mark.parametrize("heading", HEADINGS)
def test_every_heading_has_symptom_cause_and_remedy(heading: str) -> None:
    entry = PAGE.split(f'### "{heading}"')[1].split("\n#")[0]
    for part in ("**Seen as**", "**Cause**", "**Remedy**"):
        assert part in entry


def test_options_exist() -> None:
    commands = (ROOT / "src/lfdepth/cli").glob("*.py")
    code = " ".join(path.read_text(encoding="utf-8") for path in commands)
    for option in set(re.findall(r"--([a-z-]+)", PAGE)):
        assert option.replace("-", "_") in code, option


def test_the_example_runs() -> None:
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert code
    for block in code:
        exec(compile(block, "page", "exec"), {})
