"""The methods by name, one file each. `lfdepth.methods.base.Method` says what a method is."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lfdepth.methods.own import COMPARED, DEFAULT, FAMILY, LEARNED, NAMES, PRESETS, WITHOUT_WEIGHTS

if TYPE_CHECKING:
    from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
    from lfdepth.methods.parameters import Parameter, Real, Switch, Text, Whole, Word, parameters_of
    from lfdepth.methods.registry import method, method_class, names

# What loads NumPy is resolved on first use, so that help appears at once.
_HOMES = {
    "base": ("Maps", "Method", "MethodInfo", "Problem", "Shape", "Work"),
    "parameters": ("Parameter", "Real", "Switch", "Text", "Whole", "Word", "parameters_of"),
    "registry": ("method", "method_class", "names"),
}

__all__ = [
    "COMPARED",
    "DEFAULT",
    "FAMILY",
    "LEARNED",
    "NAMES",
    "PRESETS",
    "WITHOUT_WEIGHTS",
    "Maps",
    "Method",
    "MethodInfo",
    "Parameter",
    "Problem",
    "Real",
    "Shape",
    "Switch",
    "Text",
    "Whole",
    "Word",
    "Work",
    "method",
    "method_class",
    "names",
    "parameters_of",
]


def __getattr__(name: str) -> Any:
    for home, names_there in _HOMES.items():
        if name in names_there:
            globals()[name] = getattr(import_module(f"{__name__}.{home}"), name)
            return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
