"""What a method is: a frozen dataclass of its own parameters, and a `run` composed of blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.borders import PathBorders
from lfdepth.blocks.noise import Residual
from lfdepth.blocks.planes import disparity_planes
from lfdepth.engines.base import Engine
from lfdepth.lightfield import LightField
from lfdepth.methods.parameters import parameters_of
from lfdepth.trace import Trace

Shape = tuple[int, int, int, int, int]
"""(V, U, H, W, C)."""


@dataclass(frozen=True)
class MethodInfo:
    """What is said of a method.

    Attributes
    ----------
    name
        What it is called on the command line and in tables, such as "fbs-sfa".
    summary
        One sentence.
    reference
        Where it was published: a DOI, or an address.
    """

    name: str
    summary: str
    reference: str = ""


@dataclass(frozen=True)
class Measured:
    """What a method takes from the pixels of a whole light field, and would take otherwise from each piece.

    Attributes
    ----------
    exponent
        Of light over levels (`blocks.edge_net`).
    typical
        Squared difference of views that none counts as less than, in grey levels, for each round of
        refinement (`blocks.refine`).
    """

    exponent: float
    typical: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Problem:
    """What a method has to solve.

    Attributes
    ----------
    lf
        Light field, its parameters and grid checked.
    range
        (min, max) disparity, px per view step.
    planes
        (K,) disparities front to back, evenly spaced; for methods without planes, the two ends.
    noise
        How far views differ for no reason, where that was measured over more than this light field; None
        leaves it to the method.
    measured
        What `Method.measure` found, where `lf` is a window of a larger light field; None leaves it to the
        method.
    borders
        Where `lf` is a window of a larger light field: how paths enter it and leave it. Methods that know no
        such paths leave it alone.
    """

    lf: LightField
    range: tuple[float, float]
    planes: NDArray[np.float64]
    noise: Residual | None = None
    measured: Measured | None = None
    borders: PathBorders | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.lf.height, self.lf.width

    @property
    def step(self) -> float:
        """Distance of the planes, px per view step."""
        return float(self.planes[0] - self.planes[1])


@dataclass(frozen=True, eq=False)
class Work:
    """What a method works with: an engine, and a trace that it tells how far it is."""

    engine: Engine
    trace: Trace


@dataclass(frozen=True, eq=False)
class Maps:
    """What a method finds.

    Attributes
    ----------
    disparity
        (H, W) float32, px per view step.
    confidence
        (H, W) float32 in [0, 1].
    sigma
        (H, W) float32, standard error in px per view step of a pixel that is not wrong altogether; None from
        a method that does not tell.
    standing_out
        From pixels (N, 2), int64, to how much more of the views agree with the best disparity there than with
        others, (N,) float32 in [0, 1]; None from a method that does not tell.
    """

    disparity: NDArray[np.float32]
    confidence: NDArray[np.float32]
    sigma: NDArray[np.float32] | None = None
    standing_out: Callable[[NDArray[np.int64]], NDArray[np.float32]] | None = None


@dataclass(frozen=True, kw_only=True)
class Method:
    """Base of all methods.

    A subclass is a frozen, keyword-only dataclass with an `info`, fields that are annotated as
    `lfdepth.methods.parameters` says, and `run`. Values are checked when it is made.

    Raises
    ------
    LightFieldError
        For a value of another type, or out of its range.

    Examples
    --------
    >>> import lfdepth
    >>> chosen = lfdepth.method("fbs-vis", effort="best")
    >>> isinstance(chosen, lfdepth.Method), chosen.name, chosen.effort
    (True, 'fbs-vis', 'best')
    """

    info: ClassVar[MethodInfo]

    def __post_init__(self) -> None:
        for name, parameter in parameters_of(type(self)).items():
            object.__setattr__(self, name, parameter.check(getattr(self, name)))

    @property
    def name(self) -> str:
        """What it is called."""
        return self.info.name

    def parameters(self) -> dict[str, Any]:
        """Its parameters by name."""
        return asdict(self)

    def as_dict(self) -> dict[str, Any]:
        """Its name and parameters, as files and `--json` tell them."""
        return {"name": self.name, **self.parameters()}

    def planes_for(self, searched: tuple[float, float], *, force: bool = False) -> NDArray[np.float64]:
        """Planes (K,) for a range: from its parameters `step` and `planes`, or else the two ends.

        Raises
        ------
        LightFieldError
            If there are too many, unless forced.
        """
        if not self.has_planes:
            return np.array(searched[::-1], np.float64)
        step, count = getattr(self, "step", None), getattr(self, "planes", None)
        return disparity_planes(searched, step=step, count=count, force=force)

    @property
    def has_planes(self) -> bool:
        """Whether it searches planes: whether it has a parameter `step` or `planes`."""
        return not parameters_of(type(self)).keys().isdisjoint(("step", "planes"))

    def check(self, shape: Shape) -> None:
        """Raise LightFieldError where the method cannot work with views of a shape (V, U, H, W, C)."""

    def memory(self, shape: Shape, planes: NDArray[np.float64], sample_bytes: int) -> int:
        """Bytes that it takes at most beside the views, whose samples take `sample_bytes` each."""
        return 16 * shape[2] * shape[3]

    def halo(self) -> int:
        """Px around a pixel that have a say in its disparity, what moves with the views aside."""
        return 0

    def measure(self, samples: Iterable[Problem], work: Work) -> Measured | None:
        """What the method takes from a whole light field, by samples of it; None if there is no such thing.

        For light fields that are estimated piece by piece: pieces that measured it each for itself would show
        where they meet.
        """
        return None

    def run(self, problem: Problem, work: Work) -> Maps:
        """Estimate."""
        raise NotImplementedError
