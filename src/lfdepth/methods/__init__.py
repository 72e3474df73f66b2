"""The methods by name, one file each. `lfdepth.methods.base.Method` says what a method is."""

from __future__ import annotations

from lfdepth.methods.base import Maps, Method, MethodInfo, Problem, Shape, Work
from lfdepth.methods.parameters import Parameter, Real, Switch, Whole, Word, parameters_of
from lfdepth.methods.registry import DEFAULT, NAMES, PRESETS, method, method_class, names

__all__ = [
    "DEFAULT",
    "NAMES",
    "PRESETS",
    "Maps",
    "Method",
    "MethodInfo",
    "Parameter",
    "Problem",
    "Real",
    "Shape",
    "Switch",
    "Whole",
    "Word",
    "Work",
    "method",
    "method_class",
    "names",
    "parameters_of",
]
