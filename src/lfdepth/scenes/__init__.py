"""Procedural light fields with exact truth.

Every view, the reference view included, is computed from the same continuous surfaces and textures; nothing
is interpolated from another picture, and the truth is the disparity of the nearest surface at each pixel's
centre.

>>> from lfdepth import scenes
>>> lf = scenes.render("bars", size=256, views=9, seed=0)  # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lfdepth.errors import LightFieldError
from lfdepth.scenes.suite import SUITE, Recipe, Stage

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField

__all__ = ["NAMES", "describe", "render"]

NAMES: tuple[str, ...] = tuple(SUITE)
"""Names of the scenes."""

SMALLEST = 32
"""Shortest side of a picture, px."""
MOST_VIEWS = 17
"""Most views along an axis: farther out, the steepest surfaces are seen from behind."""


def describe(name: str) -> str:
    """What a scene shows and which difficulty it holds, in a sentence.

    Raises
    ------
    LightFieldError
        If there is no scene of that name.
    """
    return _recipe(name).description


def render(
    name: str,
    *,
    size: int | tuple[int, int] = 256,
    views: int | tuple[int, int] = 9,
    seed: int = 0,
    noise: float | None = None,
    samples: int = 3,
) -> LightField:
    """Render a scene.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size : int or (H, W)
        Pixels, at least 32 on either side.
    views : int or (V, U)
        Number of views, 3 to 17 along either axis, odd or even.
    seed : int
        Not negative. Same seed, same bytes, whatever the number of threads.
    noise : float, optional
        Standard deviation of shot and read noise together at mid grey, grey levels, >= 0;
        None takes the scene's own, which is zero but for "room" and the "noise" scenes.
    samples : int
        A pixel is the mean over samples × samples points, >= 1.

    Returns
    -------
    LightField
        uint8 RGB views; `truth`: disparity of the reference view, px per view step; `disparity_range`: the
        truth's, widened by 0.1 px; a camera that fits; and those of the following masks that apply.

        - occlusion_boundary: within 5 px of a jump of more than 0.1 px per step between two layers;
        - textureless: no channel of the noise-free picture deviates by more than 1.5 grey levels (standard
          deviation) within 9×9 px;
        - thin: thin structures; slanted: planes not parallel to the picture; smooth: curved surfaces.

    Raises
    ------
    LightFieldError
        If an argument is out of its range.
    """
    recipe = _recipe(name)
    height, width = _pair(size, "size", SMALLEST, 1 << 14)
    grid = _pair(views, "views", 3, MOST_VIEWS)
    _check(seed >= 0, f"seed is {seed}; expected an integer >= 0")
    _check(noise is None or 0 <= noise < 256, f"noise is {noise}; expected 0 to 255 grey levels")
    _check(1 <= samples <= 16, f"samples is {samples}; expected 1 to 16")
    from lfdepth.scenes.rendering import light_field  # numba loads late

    scene = recipe.build(Stage(height, width, seed))
    return light_field(scene, name, (height, width), grid, seed, noise, samples)


def _recipe(name: str) -> Recipe:
    _check(name in SUITE, f"scene {name!r} does not exist; expected one of {', '.join(NAMES)}")
    return SUITE[name]


def _pair(value: int | tuple[int, int], what: str, least: int, most: int) -> tuple[int, int]:
    """One number for both axes, or two."""
    first, second = (value, value) if isinstance(value, int) else value
    _check(
        least <= min(first, second) and max(first, second) <= most,
        f"{what} is {first}x{second}; expected {least} to {most} along either axis",
    )
    return first, second


def _check(holds: bool, finding: str) -> None:
    if not holds:
        raise LightFieldError(f"scenes.render: {finding}; correct it")
