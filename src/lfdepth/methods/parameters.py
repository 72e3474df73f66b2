"""Parameters of methods: type, range, unit, symbol and meaning stand once, at the field.

    radius: Annotated[int, Whole("Radius of the guided filter.", ge=1, unit="px")] = 4

From there they feed the check of every value, the help of the command line, `lfdepth methods --json`, the
docs, and the settings of comparisons. A field's type is float, int, bool, a Literal of words, or one of these
or None.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from math import isfinite
from numbers import Integral
from numbers import Real as RealNumber
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from lfdepth.errors import LightFieldError

_YES = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


@dataclass(frozen=True)
class Spec:
    """What is said of a parameter beside its type.

    Attributes
    ----------
    text
        What it means, one or two sentences.
    unit
        Its unit, such as "px".
    symbol
        Its symbol in the paper.
    without
        What None stands for, in words; None where the parameter has to have a value.
    """

    text: str
    unit: str = ""
    symbol: str = ""
    without: str | None = None


@dataclass(frozen=True)
class Real(Spec):
    """A finite number: above `gt`, at least `ge`, at most `le`."""

    gt: float | None = None
    ge: float | None = None
    le: float | None = None


@dataclass(frozen=True)
class Whole(Spec):
    """A whole number from `ge` to `le`; with `even`, an even one."""

    ge: int | None = None
    le: int | None = None
    even: bool = False


@dataclass(frozen=True)
class Word(Spec):
    """One of the words of the field's Literal."""


@dataclass(frozen=True)
class Switch(Spec):
    """On or off."""


@dataclass(frozen=True)
class Text(Spec):
    """Any text, such as the name of a file."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a method.

    Attributes
    ----------
    name
        Name of the field, and of the option with dashes for underscores.
    kind
        float, int, bool or str.
    spec
        Range, unit, symbol and meaning.
    default
        Its default.
    choices
        The words that it may be, where it is a word.
    """

    name: str
    kind: type
    spec: Spec
    default: Any
    choices: tuple[str, ...] = ()

    @property
    def option(self) -> str:
        """How the command line spells it."""
        return "--" + self.name.replace("_", "-")

    @property
    def range(self) -> str:
        """Which values it takes, in words."""
        spec = self.spec
        if isinstance(spec, Word):
            return "one of " + ", ".join(self.choices)
        if isinstance(spec, Switch):
            return "yes or no"
        if isinstance(spec, Text):
            return "a text"
        bounds = []
        if isinstance(spec, Real) and spec.gt is not None:
            bounds.append(f"above {spec.gt:g}")
        low, high = (getattr(spec, key, None) for key in ("ge", "le"))
        if low is not None and high is not None and not bounds:
            bounds.append(f"from {low:g} to {high:g}")
        else:
            bounds += [f"at least {low:g}"] if low is not None else []
            bounds += [f"at most {high:g}"] if high is not None else []
        if isinstance(spec, Whole):
            noun = "an even whole number" if spec.even else "a whole number"
        else:
            noun = "a number"
        return " ".join([noun, " and ".join(bounds)]).strip() + (f" ({spec.unit})" if spec.unit else "")

    def check(self, value: Any) -> Any:
        """The value in the field's own type.

        Raises
        ------
        LightFieldError
            If it is of another type, or out of range.
        """
        if value is None and self.spec.without is not None:
            return None
        found = _converted(value, self.kind)
        if found is None or not self._holds(found):
            raise LightFieldError(f"{self.name}: found {value!r}, expected {self.range}; change it")
        return found

    def parse(self, text: str) -> Any:
        """The value that a text stands for, checked.

        Raises
        ------
        LightFieldError
            If it stands for none.
        """
        word = text.strip().lower()
        if word == "none" and self.spec.without is not None:
            return None
        value: Any = text
        if self.kind is bool:
            value = _YES.get(word, text)
        elif self.kind in (int, float):
            try:
                value = self.kind(word)
            except ValueError:
                value = text
        return self.check(value)

    def as_dict(self) -> dict[str, Any]:
        """Everything about it, for JSON."""
        spec = self.spec
        bounds = {
            key: getattr(spec, key) for key in ("gt", "ge", "le") if getattr(spec, key, None) is not None
        }
        return {
            "name": self.name,
            "option": self.option,
            "type": self.kind.__name__,
            "default": self.default,
            "range": self.range,
            **bounds,
            "choices": list(self.choices),
            "unit": spec.unit,
            "symbol": spec.symbol,
            "text": spec.text,
            "without": spec.without,
        }

    def _holds(self, value: Any) -> bool:
        spec = self.spec
        if isinstance(spec, Word):
            return value in self.choices
        if isinstance(spec, Real | Whole):
            above = getattr(spec, "gt", None)
            even = not (isinstance(spec, Whole) and spec.even and value % 2)
            return (
                even
                and isfinite(value)
                and (above is None or value > above)
                and (spec.ge is None or value >= spec.ge)
                and (spec.le is None or value <= spec.le)
            )
        return True


def _converted(value: Any, kind: type) -> Any:
    """The value in a type it belongs to; None if it does not. True and False are no numbers."""
    if kind is bool:
        return value if isinstance(value, bool) else None
    if kind is str:
        return value if isinstance(value, str) else None
    if isinstance(value, bool):
        return None
    if kind is int:
        return int(value) if isinstance(value, Integral) else None
    return float(value) if isinstance(value, RealNumber) else None


_KNOWN: dict[Any, dict[str, Parameter]] = {}


def parameters_of(method: Any) -> Mapping[str, Parameter]:
    """The parameters of a method's class by name, in their order.

    Raises
    ------
    TypeError
        If a field is not annotated with a `Spec`, or its type is none that parameters may have: a mistake in
        the method.
    """
    if method not in _KNOWN:
        hints = get_type_hints(method, include_extras=True)
        _KNOWN[method] = {
            field.name: _parameter(method, field.name, hints[field.name], field.default)
            for field in fields(method)
        }
    return _KNOWN[method]


def _parameter(method: type, name: str, hint: Any, default: Any) -> Parameter:
    if get_origin(hint) is not Annotated or default is MISSING:
        raise TypeError(
            f"{method.__name__}.{name}: expected Annotated[type, Real|Whole|Word|Switch|Text(...)] = default"
        )
    base, *notes = get_args(hint)
    spec = next((note for note in notes if isinstance(note, Spec)), None)
    if spec is None:
        raise TypeError(
            f"{method.__name__}.{name}: expected a Real, Whole, Word, Switch or Text in its annotation"
        )
    kinds = (
        [each for each in get_args(base) if each is not NoneType] if NoneType in get_args(base) else [base]
    )
    choices = tuple(get_args(kinds[0])) if get_origin(kinds[0]) is Literal else ()
    kind = str if choices else kinds[0]
    if len(kinds) != 1 or kind not in (float, int, bool, str):
        raise TypeError(
            f"{method.__name__}.{name}: found {base}, expected float, int, bool or a Literal of words"
        )
    return Parameter(name, kind, spec, default, choices)
