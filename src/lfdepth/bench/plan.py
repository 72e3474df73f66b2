"""What a comparison runs: scenes, methods with parameters, folders with results of other programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.truth import HighResolution

if TYPE_CHECKING:
    from lfdepth.methods import Method


@dataclass(frozen=True)
class Setting:
    """A method, its parameters, and its name in the tables."""

    name: str
    method: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def resolve(self) -> Method:
        """The method with its parameters; LightFieldError for an unknown one."""
        from lfdepth.methods import method, method_class, parameters_of

        known = parameters_of(method_class(self.method))
        given = {
            name: known[name].parse(value) if isinstance(value, str) and name in known else value
            for name, value in self.options.items()
        }
        return method(self.method, **given)


def setting(text: str) -> Setting:
    """Read a setting such as ``fbsocc-sfa`` or ``fbsocc-sfa:step=0.02,skip=7``.

    Raises
    ------
    LightFieldError
        If a parameter is not of the form name=value.
    """
    method, _, rest = text.partition(":")
    return Setting(text, method, parameters(rest, named=text))


def parameters(text: str, *, named: str | None = None) -> dict[str, str]:
    """Read parameters such as ``step=0.02,skip=7``.

    Raises
    ------
    LightFieldError
        If one is not of the form name=value; it calls the whole `named`.
    """
    options = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if not (name and equals and value):
            raise LightFieldError(
                f"setting {named or text!r}: found {part!r}; expected {'METHOD:' if named else ''}"
                "NAME=VALUE,NAME=VALUE; rewrite it"
            )
        options[name.strip()] = value.strip()
    return options


@dataclass(frozen=True, eq=False)
class SceneSpec:
    """A scene to run, and what to change about it.

    Attributes
    ----------
    source : Path, str or LightField
        What `lfdepth.read` reads; the name of a scene of `lfdepth.scenes`; a light field.
    name : str, optional
        Name in the tables instead of its own.
    range : (float, float), optional
        Disparity range in px per view step instead of its own.
    views : int, optional
        Keep this many views along both axes.
    truth : Path, optional
        Disparity of the reference view, over what the scene says; what `lfdepth.io.read_truth` reads.
    truth_scale, truth_offset, truth_variable
        As of `lfdepth.read`: disparity = offset + scale · sample, and the name in a file with several arrays.
    """

    source: Path | str | LightField
    name: str | None = None
    range: tuple[float, float] | None = None
    views: int | None = None
    truth: Path | None = None
    truth_scale: float | None = None
    truth_offset: float = 0.0
    truth_variable: str | None = None

    def label(self) -> str:
        """Name before it is read."""
        if self.name:
            return self.name
        return self.source.name if isinstance(self.source, LightField) else Path(self.source).resolve().name

    def load(self) -> LightField:
        """Read or render the light field."""
        return self.load_with_masks()[0]

    def load_with_masks(self) -> tuple[LightField, dict[str, str]]:
        """The light field, and why some of its masks could not be used."""
        lf, unusable = (self.source, {}) if isinstance(self.source, LightField) else _read(self.source)
        if self.views:
            lf = lf.angular_crop(self.views, self.views)
        if self.truth is not None:
            from lfdepth.io import read_truth

            told = read_truth(
                self.truth, scale=self.truth_scale, offset=self.truth_offset, variable=self.truth_variable
            )
            lf = replace(lf, truth=told)
        changed = replace(lf, name=self.name or lf.name, disparity_range=self.range or lf.disparity_range)
        return changed, unusable

    def high(self) -> HighResolution | None:
        """High-resolution truth beside the views, or of a procedural scene, where there is one."""
        from lfdepth import io, scenes

        if isinstance(self.source, LightField) or self.truth is not None:
            return None
        if _is_procedural(self.source):
            return scenes.high_resolution(str(self.source))
        return io.read_high_resolution(self.source) if Path(self.source).is_dir() else None


def _read(source: Path | str) -> tuple[LightField, dict[str, str]]:
    from lfdepth import io, scenes

    unusable: dict[str, str] = {}
    lf = scenes.render(str(source)) if _is_procedural(source) else io.read(source, unusable=unusable)
    return lf, unusable


def _is_procedural(source: Path | str) -> bool:
    from lfdepth import scenes

    return isinstance(source, str) and source in scenes.NAMES and not Path(source).exists()


@dataclass(frozen=True)
class Plan:
    """What `bench` runs, as a TOML file says."""

    scenes: tuple[SceneSpec, ...]
    settings: tuple[Setting, ...]
    external: tuple[Path, ...] = ()


def read_plan(path: Path | str) -> Plan:
    """Read a plan from TOML.

    Its keys: `scenes`, a list of paths (relative to the file), names of procedural scenes, "suite" for all of
    them, or tables with `path`, `name`, `range`, `views`, `truth`; `methods`, a list of settings as text
    (`setting`) or tables with `method`, `name` and parameters; `settings`, a list of tables of parameters,
    each tried with every method; `external`, a list of folders with results.

    Raises
    ------
    LightFieldError
        If the file cannot be read, or a key is unknown or of another kind.
    """
    import tomllib

    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LightFieldError(
            f"{path}: {error}; expected a TOML file with scenes and methods; fix the syntax"
        ) from None
    known = {"scenes", "methods", "settings", "external"}
    if unknown := set(data) - known:
        raise LightFieldError(
            f"{path}: unknown key {sorted(unknown)[0]!r}; expected {', '.join(sorted(known))}; remove it"
        )
    try:
        scenes = tuple(each for entry in data["scenes"] for each in _plan_scenes(entry, path.parent))
        settings = cross(map(_plan_setting, data["methods"]), data.get("settings", [{}]))
        external = tuple(path.parent / folder for folder in data.get("external", []))
    except LightFieldError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise LightFieldError(
            f"{path}: missing or unexpected {error}; expected lists of scenes and methods; see the "
            "documentation"
        ) from None
    return Plan(scenes, settings, external)


def _plan_scenes(entry: str | dict[str, Any], folder: Path) -> Iterator[SceneSpec]:
    table: dict[str, Any] = {"path": entry} if isinstance(entry, str) else dict(entry)
    if "range" in table:
        low, high = table["range"]
        table["range"] = float(low), float(high)
    if "truth" in table:
        table["truth"] = folder / table["truth"]
    for source in scene_names(table.pop("path")):
        beside = folder / source
        yield SceneSpec(beside if beside.exists() else source, **table)


def with_truth(scenes: Sequence[str], truth: Sequence[str], **reading: Any) -> list[SceneSpec]:
    """Scenes with the truth that is given for them: SCENE=FILE each, or FILE for a single scene.

    `reading` are `truth_scale`, `truth_offset` and `truth_variable` of each.

    Raises
    ------
    LightFieldError
        If truth is given for a scene that is not among them, or without a scene for several.
    """
    specs = [SceneSpec(each) for name in scenes for each in scene_names(name)]
    for text in truth:
        name, equals, file = text.rpartition("=")
        matching = [
            i for i, spec in enumerate(specs) if not equals or name in (spec.label(), str(spec.source))
        ]
        if len(matching) != 1:
            known = ", ".join(spec.label() for spec in specs[:8]) or "no scenes"
            raise LightFieldError(
                f"truth {text!r}: {len(matching)} of {len(specs)} scenes fit; expected SCENE=FILE with "
                f"one of {known}; name one of them"
            )
        specs[matching[0]] = replace(specs[matching[0]], truth=Path(file), **reading)
    return specs


def scene_names(name: str) -> tuple[str, ...]:
    """The name itself, or all procedural scenes for "suite"."""
    from lfdepth import scenes

    return tuple(scenes.NAMES) if name == "suite" and not Path(name).exists() else (name,)


def _plan_setting(entry: str | dict[str, Any]) -> Setting:
    if isinstance(entry, str):
        return setting(entry)
    options = dict(entry)
    method, name = options.pop("method"), options.pop("name", None)
    return Setting(name or _named(method, options), method, options)


def cross(methods: Iterable[Setting], settings: Sequence[Mapping[str, Any]]) -> tuple[Setting, ...]:
    """Every method with every table of parameters; the table has the last word on a parameter."""
    return tuple(
        Setting(_named(each.name, extra), each.method, {**each.options, **extra})
        for each in methods
        for extra in settings
    )


def _named(name: str, options: Mapping[str, Any]) -> str:
    return " ".join([name, *(f"{key}={value}" for key, value in options.items())])
