"""Finding methods by name: those of lfdepth, and those of other packages.

Another package offers a method through the entry-point group `lfdepth.methods`, in its pyproject.toml:

    [project.entry-points."lfdepth.methods"]
    my-method = "my_package.my_method:MyMethod"
"""

from __future__ import annotations

import logging
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from lfdepth.errors import LightFieldError
from lfdepth.methods.base import Method
from lfdepth.methods.own import DEFAULT, HOMES, LEARNED, NAMES, PRESETS
from lfdepth.methods.parameters import parameters_of

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "lfdepth.methods"
"""The entry-point group."""

_log = logging.getLogger(__name__)


@cache
def _offered() -> dict[str, EntryPoint]:
    """Methods of other packages by name; lfdepth's own names are not given away."""
    from importlib.metadata import entry_points  # takes long to load

    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=GROUP):
        if entry.name in HOMES or entry.name in found:
            _log.warning("method %s of %s: the name is taken; it is left out", entry.name, entry.value)
        else:
            found[entry.name] = entry
    return found


def names() -> tuple[str, ...]:
    """Names of all methods: lfdepth's own, learned ones last, then those of other packages."""
    return *NAMES, *LEARNED, *sorted(_offered())


def method_class(name: str) -> type[Method]:
    """The class of a method.

    Raises
    ------
    LightFieldError
        For an unknown name, or another package's method that cannot be loaded.
    """
    if name in HOMES:
        module, _, kind = HOMES[name].partition(":")
        found: type[Method] = getattr(import_module(module), kind)
        return found
    if name not in _offered():
        raise LightFieldError(f"method: found {name!r}, expected one of {', '.join(names())}; choose one")
    entry = _offered()[name]
    try:
        loaded = entry.load()
        problem = _problem(loaded, name)
    except Exception as error:  # whatever is wrong with it, it is that package's
        problem = f"{type(error).__name__}: {error}"
    if problem:
        raise LightFieldError(
            f"method {name}: {entry.value} cannot be used ({problem}); expected a Method as described in "
            "docs/write-a-method.md; fix or uninstall the package"
        )
    return loaded  # type: ignore[no-any-return]


def _problem(loaded: Any, name: str) -> str:
    """What is wrong with a class that another package offers; empty if nothing is."""
    if not (isinstance(loaded, type) and issubclass(loaded, Method)):
        return f"found {loaded!r}"
    if loaded.info.name != name:
        return f"calls itself {loaded.info.name!r}"
    loaded()  # its annotations and defaults are checked
    return ""


def method(name: str | Method = DEFAULT, **options: Any) -> Method:
    """Look a method up by name and set some of its parameters.

    Parameters
    ----------
    name
        One of `names()`, or a `Method`.
    **options
        Parameters of the method; `planes` replaces `step`. `preset` names an entry of `PRESETS`.

    Returns
    -------
    Method

    Raises
    ------
    LightFieldError
        For an unknown name, preset, or parameter, or a value of another type or out of range.

    Examples
    --------
    >>> import lfdepth
    >>> lfdepth.method("fbs-sfa", step=0.02).parameters()["step"]
    0.02
    >>> lfdepth.method("fbsocc-sfa", preset="paper-synthetic").skip
    7
    """
    chosen = name if isinstance(name, Method) else method_class(name)
    preset = options.pop("preset", None)
    if options.get("planes") is not None and options.get("step") is not None:
        raise LightFieldError(
            f"planes: found step={options['step']} and planes={options['planes']}, expected exactly one of "
            "them; give a distance between planes or a number of planes"
        )
    kind = type(chosen) if isinstance(chosen, Method) else chosen
    known = parameters_of(kind)
    if preset is not None:
        if preset not in PRESETS:
            raise LightFieldError(
                f"preset: found {preset!r}, expected one of {', '.join(PRESETS)}; choose one"
            )
        options = {**{key: value for key, value in PRESETS[preset].items() if key in known}, **options}
    for option in options:
        if option not in known:
            raise LightFieldError(
                f"{option}: method {kind.info.name} has no such parameter; "
                f"expected one of {', '.join(known)}; choose one of these, or another method"
            )
    if options.get("planes") is not None and "step" in known:
        options["step"] = None
    before = chosen.parameters() if isinstance(chosen, Method) else {}
    return kind(**{**before, **options})
