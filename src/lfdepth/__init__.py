"""Dense, sharp disparity maps from light fields by foreground-background separation.

>>> import lfdepth
>>> lf = lfdepth.read("cotton")  # doctest: +SKIP
>>> result = lfdepth.estimate(lf, method="fbsocc-sfa")  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lfdepth.camera import Camera
    from lfdepth.errors import LightFieldError
    from lfdepth.evaluation import evaluate
    from lfdepth.io import read, write
    from lfdepth.lightfield import LightField
    from lfdepth.methods import Method, method
    from lfdepth.sweep.run import Result, estimate

__version__ = "0.1.0"

# Where each public name lives; resolved on first use so that `import lfdepth` costs next to nothing.
_HOMES = {
    "Camera": "lfdepth.camera",
    "LightField": "lfdepth.lightfield",
    "LightFieldError": "lfdepth.errors",
    "Method": "lfdepth.methods",
    "Result": "lfdepth.sweep.run",
    "estimate": "lfdepth.sweep.run",
    "evaluate": "lfdepth.evaluation",
    "method": "lfdepth.methods",
    "read": "lfdepth.io",
    "write": "lfdepth.io",
}

__all__ = [
    "Camera",
    "LightField",
    "LightFieldError",
    "Method",
    "Result",
    "estimate",
    "evaluate",
    "method",
    "read",
    "write",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        globals()[name] = getattr(import_module(_HOMES[name]), name)
        return globals()[name]
    raise AttributeError(f"module 'lfdepth' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
