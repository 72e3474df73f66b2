"""The pages of the reference that are made from the program itself: functions, commands, parameters.

They are written to `docs/_generated` before Sphinx reads its sources, so that they cannot be out of date.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lfdepth
from lfdepth import methods, scenes

GENERATED = "_generated"


@dataclass(frozen=True)
class Group:
    """Names that stand on one page."""

    title: str
    intro: str
    names: tuple[str, ...]


GROUPS = {
    "read-write": Group(
        "Read and write",
        "Formats are listed in {doc}`/formats`.",
        ("read", "write", "read_disparity", "read_confidence", "write_picture"),
    ),
    "light-field": Group(
        "Light field and camera",
        "What `read` returns, and what you make from arrays of your own.",
        ("LightField", "Camera", "LightFieldError"),
    ),
    "views": Group(
        "Before an estimate",
        "Are the views in order, equally bright, and where they should be? "
        "{doc}`/when-something-looks-wrong` lists "
        "what can be the matter.",
        (
            "check_orientation",
            "find_range",
            "measure_brightness",
            "equalise",
            "Equalisation",
            "with_aspect",
            "refine_positions",
        ),
    ),
    "estimate": Group(
        "Estimate",
        "The methods' own parameters are listed in {doc}`/_generated/parameters`.",
        ("estimate", "Result", "method", "Method", "Trace"),
    ),
    "more-maps": Group(
        "More than one map",
        "The maps of all views, the map of another view, and many light fields: {doc}`/scale`.",
        ("estimate_views", "ViewMaps", "estimate_views_to", "WrittenViews", "from_view", "estimate_many"),
    ),
    "look": Group(
        "Look and explain",
        "The viewer, as `lfdepth view` opens it, and the evidence of a pixel: {doc}`/viewer`.",
        ("view", "explain", "Evidence"),
    ),
    "use": Group(
        "After an estimate",
        "{doc}`/using` shows these in context.",
        ("refocus", "all_in_focus", "foreground_masks", "write_masks", "evaluate"),
    ),
}
"""Pages of public names; whatever is public and not here stands on a page of its own, "More"."""


def groups() -> dict[str, Group]:
    """All pages of functions and classes, with every public name on one of them."""
    known = {name for group in GROUPS.values() for name in group.names}
    more = tuple(name for name in lfdepth.__all__ if name not in known)
    rest = {"more": Group("More", "", more)} if more else {}
    return {**GROUPS, **rest}


def group_page(group: Group, module: str = "lfdepth") -> str:
    """A page of functions and classes, in MyST."""
    owner = lfdepth if module == "lfdepth" else scenes
    lines = [
        f"# {group.title}",
        "",
        group.intro,
        "",
        "```{eval-rst}",
        f".. currentmodule:: {module}",
        "",
    ]
    lines += [".. autosummary::", "", *(f"   {name}" for name in group.names), ""]
    for name in group.names:
        thing = getattr(owner, name)
        if not isinstance(thing, type):
            lines += [f".. autofunction:: {name}", ""]
            continue
        lines += [f".. autoclass:: {name}", *_members(thing), ""]
    return "\n".join([*lines, "```", ""])


def _members(kind: type) -> list[str]:
    """Methods and properties of a class that have something said of them."""
    if issubclass(kind, Exception):
        return []
    shown = [
        name
        for name, value in vars(kind).items()
        if not name.startswith("_")
        and (callable(value) or isinstance(value, property | classmethod))
        and (value.__doc__ or "").strip()
    ]
    return [f"   :members: {', '.join(shown)}"] if shown else []


def scenes_page() -> str:
    """The module of procedural scenes, and what the scenes show."""
    names = tuple(name for name in scenes.__all__ if callable(getattr(scenes, name)))
    intro = (
        "Procedural light fields with exact truth: `from lfdepth import scenes`. Nothing is interpolated; "
        "every view is computed from the same surfaces and textures."
    )
    lines = ["", "## The scenes", "", "| name | what it shows |", "|---|---|"]
    lines += [f"| `{name}` | {_cell(scenes.describe(name))} |" for name in (*scenes.NAMES, *scenes.PHOTOREAL)]
    return group_page(Group("Scenes", intro, names), "lfdepth.scenes") + "\n".join([*lines, ""])


def parameters_page() -> str:
    """Every parameter of every method, from the annotations that also check its values."""
    lines = [
        "# Parameters of the methods",
        "",
        "In Python: `lfdepth.estimate(lf, METHOD, step=0.02)`. On the command line: `lfdepth estimate SCENE "
        "--method METHOD --step 0.02 -o MAP`. In comparisons: `METHOD:step=0.02`. A value outside its range, "
        "or a parameter that the method does not have, is an error. Symbols are those of the method's paper; "
        "{doc}`/glossary` explains units.",
        "",
    ]
    for name in methods.names():
        kind = methods.method_class(name)
        lines += [f"## {name}", "", kind.info.summary, ""]
        if kind.info.reference:
            lines += [f"Source: {_linked(kind.info.reference)}.", ""]
        lines += [
            "| parameter | symbol | default | values | unit | meaning |",
            "|---|---|---|---|---|---|",
        ]
        for each in methods.parameters_of(kind).values():
            lines.append(f"| {' | '.join(_cell(text) for text in _row(each))} |")
        lines.append("")
    lines += [
        "## Presets",
        "",
        'Parameters of the paper\'s experiments: `--preset NAME`, `preset="NAME"`.',
        "",
    ]
    lines += ["| preset | parameters |", "|---|---|"]
    for name, values in methods.PRESETS.items():
        lines.append(f"| `{name}` | {', '.join(f'`{key}={value}`' for key, value in values.items())} |")
    return "\n".join([*lines, ""])


def _row(parameter: Any) -> tuple[str, ...]:
    unit = getattr(parameter.spec, "unit", "") or ""
    values = parameter.range.removesuffix(f" ({unit})") if unit else parameter.range
    default = parameter.default
    shown = {True: "yes", False: "no"}.get(default, default) if isinstance(default, bool) else default
    shown = parameter.spec.without if default is None else shown
    return (
        f"`{parameter.name}`",
        parameter.spec.symbol or "",
        f"{shown:g}" if isinstance(shown, float) else str(shown),
        values,
        unit,
        parameter.spec.text,
    )


def _linked(reference: str) -> str:
    doi = reference.removeprefix("doi:")
    return f"[{reference}](https://doi.org/{doi})" if doi != reference else reference


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*")


def commands_page() -> str:
    """Every command with its help, as the command line itself gives it."""
    from lfdepth.cli import commands, experiments, learned, scale, viewing  # noqa: F401  # these register themselves
    from lfdepth.cli.app import app

    commands.add_estimate(methods.DEFAULT)
    words, sys.argv = sys.argv, [app.name[0]]  # usage lines name the program that runs
    try:
        text = app.generate_docs(output_format="markdown", recursive=True)
    finally:
        sys.argv = words
    overview, *sections = text.split("**Commands**:", 1)[1].split("\n## ")
    order = re.findall(r"^\* \[`(\w+)`\]", overview, re.MULTILINE)
    sections.sort(key=lambda section: order.index(section.split()[1]))
    lines = [
        "# Commands",
        "",
        "The help of every command, as `lfdepth COMMAND --help` prints it. Those that print results take "
        "`--json`. Bad input ends with one line that says what was found, what was expected and what to do, "
        "and with exit status 2. "
        "`lfdepth estimate --method NAME --help` shows the parameters of another method; they are all in "
        "{doc}`/_generated/parameters`.",
        "",
        overview.strip(),
        "",
        *("## " + _examples(section) for section in sections),
    ]
    return "\n".join(lines)


def _examples(text: str) -> str:
    """Commands that are shown as examples, set as a shell would show them."""
    text = re.sub(r"((?:^    lfdepth .*\n)+)", lambda m: _fenced(m[1]), text, flags=re.MULTILINE)
    return text.replace("```console\n", "```sh\n")


def _fenced(lines: str) -> str:
    return "```sh\n" + "\n".join(line[4:] for line in lines.splitlines()) + "\n```\n"


def from_the_root(path: Path) -> str:
    """A page that lies beside the README: its links lead to the pages here, or nowhere."""
    text = path.read_text(encoding="utf-8").replace("](docs/", "](../")
    return re.sub(r"\[([^\]]+)\]\((?:README|LICENSE|CITATION)[^)]*\)", r"\1", text)


def for_the_site(text: str) -> str:
    """A page; a chart that is a chain, which would need a script from the network, becomes a list of its boxes."""
    return re.sub(r"```mermaid\n(.*?)```", lambda chart: _chain(chart[1]), text, flags=re.DOTALL)


def _chain(chart: str) -> str:
    boxes = dict.fromkeys(re.findall(r'\["([^"]+)"\]', chart))
    return "```text\n" + "\n  ↓\n".join(boxes) + "\n```"


def _read(app: Any, name: str, source: list[str]) -> None:
    if not name.startswith(GENERATED):
        source[0] = for_the_site(source[0])


def pages() -> Mapping[str, str]:
    """Names and texts of all generated pages."""
    found = {
        f"api-{number}-{key}": group_page(group) for number, (key, group) in enumerate(groups().items(), 1)
    }
    root = Path(__file__).parents[2]
    return {
        **found,
        "changes": from_the_root(root / "CHANGELOG.md"),
        "contributing": from_the_root(root / "CONTRIBUTING.md"),
        "api-9-scenes": scenes_page(),
        "commands": commands_page(),
        "parameters": parameters_page(),
    }


def write(docs: Path) -> None:
    """Write the pages, those that changed only, so that nothing else is built anew."""
    folder = docs / GENERATED
    folder.mkdir(exist_ok=True)
    made = pages()
    for old in folder.glob("*.md"):
        if old.stem not in made:
            old.unlink()
    for name, text in made.items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("source-read", _read)
    app.connect("builder-inited", lambda app: write(Path(app.srcdir)), priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
