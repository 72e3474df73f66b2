"""Procedural light fields with exact truth.

Every view, the reference view included, is computed from the same continuous surfaces and textures; nothing
is interpolated from another picture, and the truth is the disparity of the nearest surface at each pixel's
centre.

>>> from lfdepth import scenes
>>> lf = scenes.render("bars", size=256, views=9, seed=0)  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from lfdepth.errors import LightFieldError
from lfdepth.scenes import photoreal
from lfdepth.scenes.stratified import STRATIFIED
from lfdepth.scenes.suite import SUITE, Recipe, Stage

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lfdepth.lightfield import LightField
    from lfdepth.scenes.model import Scene
    from lfdepth.scenes.rendering import Rendering
    from lfdepth.truth import HighResolution

__all__ = [
    "NAMES",
    "PHOTOREAL",
    "describe",
    "expected_seconds",
    "high_resolution",
    "render",
    "save",
    "truth_of_views",
    "video",
]

_RECIPES = {**SUITE, **STRATIFIED}
NAMES: tuple[str, ...] = tuple(_RECIPES)
"""Names of the procedural scenes."""
PHOTOREAL: tuple[str, ...] = tuple(photoreal.MOTIFS)
"""Names of the path-traced scenes; they need Mitsuba 3 (the extra `render`) and minutes."""

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

    Examples
    --------
    >>> from lfdepth import scenes
    >>> scenes.describe("leaves")
    '130 leaves, pointed or round, at random angles and depths, half of them slanted; D from -1.6 to 1.6.'
    """
    return _described(name).description


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
        One of `NAMES` or `PHOTOREAL`.
    size : int or (H, W)
        Pixels, at least 32 on either side.
    views : int or (V, U)
        Number of views, 3 to 17 along either axis, odd or even.
    seed : int
        Not negative. Same seed, same bytes, whatever the number of threads.
    noise : float, optional
        Standard deviation of shot and read noise together at mid grey, grey levels, >= 0;
        None takes the scene's own, which is zero but for "room", "specks" and the "noise" scenes.
    samples : int
        A pixel is the mean over samples × samples points (of path-traced scenes: (samples + 1)² paths);
        1 to 16.

    Returns
    -------
    LightField
        uint8 RGB views; `truth`: disparity of the reference view, px per view step; `disparity_range`: the
        truth's, widened by 0.1 px; a camera that fits; and those of the following masks that apply.

        - occlusion_boundary: within 5 px of a jump of more than 0.1 px per step between two layers;
        - textureless: no channel of the noise-free picture deviates by more than 1.5 grey levels (standard
          deviation) within 9×9 px;
        - thin: thin structures; slanted: planes not parallel to the picture; smooth: curved surfaces;
        - the 4D Light Field Benchmark's, made of these: discontinuities, planes, smooth_surfaces, fine,
          fine_surrounding; and in the scenes after its stratified ones the masks of their metrics.

    Raises
    ------
    LightFieldError
        If an argument is out of its range, or a path-traced scene is asked for without Mitsuba.

    Examples
    --------
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> lf.shape, lf.truth.shape
    ((5, 5, 64, 64, 3), (64, 64))
    """
    return _rendered(name, size, views, seed, noise, samples).lf


def save(
    name: str,
    folder: str | Path,
    *,
    size: int | tuple[int, int] = 512,
    views: int | tuple[int, int] = 9,
    seed: int = 0,
    noise: float | None = None,
    samples: int = 3,
    progress: photoreal.Progress | None = None,
) -> LightField:
    """Render a scene into a folder in the layout of the 4D Light Field Benchmark, all of it or nothing.

    The folder holds `input_CamNNN.png`, `parameters.cfg`, the truth at the size of the views and at ten times
    that (`gt_disp_lowres.pfm`, `gt_disp_highres.pfm`), and masks of both sizes (`mask_NAME_lowres.png`,
    `mask_NAME_highres.png`), which are those of `render`. Masks are 0 and 255, but `boxes` and
    `dots_by_size`, which hold labels from 1.

    Parameters
    ----------
    name, size, views, seed, noise, samples
        As in `render`.
    folder : str or Path
        To be created; its parent has to exist. An empty folder or an earlier scene is replaced.
    progress : callable, optional
        Called with (views done, views in all, what comes next) while a path-traced scene is rendered.

    Returns
    -------
    LightField
        What was written, at low resolution.

    Raises
    ------
    LightFieldError
        If an argument is out of its range, or the folder cannot be written or holds something else.

    Examples
    --------
    >>> import tempfile
    >>> from lfdepth import scenes
    >>> scenes.save("bars", tempfile.mkdtemp() + "/bars", size=64, views=5).shape
    (5, 5, 64, 64, 3)
    """
    from lfdepth.io.atomic import check_target
    from lfdepth.io.benchmark import write_benchmark
    from lfdepth.truth import FACTOR, HighResolution

    folder = Path(folder)
    check_target(folder, folder=True)
    rendering = _rendered(name, size, views, seed, noise, samples, progress)
    high = HighResolution(*rendering.geometry(FACTOR))
    labels = rendering.geometry(1)[1]
    write_benchmark(folder, rendering.lf, high=high, labels=labels, category="procedural")
    return rendering.lf


def high_resolution(name: str, *, size: int | tuple[int, int] = 256, seed: int = 0) -> HighResolution:
    """Truth and masks of a procedural scene at ten times the size of its views, as `save` writes them.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size, seed
        As in `render`.

    Raises
    ------
    LightFieldError
        If the scene is none of `NAMES`, or an argument is out of its range.

    Examples
    --------
    >>> from lfdepth import scenes
    >>> scenes.high_resolution("bars", size=32).truth.shape
    (320, 320)
    """
    scene, pixels = _procedural(name, size, seed)
    from lfdepth.scenes import rendering
    from lfdepth.truth import FACTOR, HighResolution

    return HighResolution(*rendering.geometry(scene, pixels, FACTOR))


def truth_of_views(
    name: str, *, size: int | tuple[int, int] = 256, views: int | tuple[int, int] = 9, seed: int = 0
) -> NDArray[np.float32]:
    """Truth of every view of a procedural scene, (V, U, H, W) float32, px per view step.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size, views, seed
        As in `render`.

    Raises
    ------
    LightFieldError
        If the scene is none of `NAMES`, or an argument is out of its range.

    Examples
    --------
    >>> from lfdepth import scenes
    >>> truths = scenes.truth_of_views("bars", size=64, views=5)
    >>> truths.shape
    (5, 5, 64, 64)
    >>> bool((truths[2, 2] == scenes.render("bars", size=64, views=5).truth).all())
    True
    """
    grid = _pair(views, "views", 3, MOST_VIEWS)
    scene, pixels = _procedural(name, size, seed)
    from lfdepth.scenes import rendering

    return rendering.truths(scene, pixels, grid)


def _procedural(name: str, size: int | tuple[int, int], seed: int) -> tuple[Scene, tuple[int, int]]:
    """A procedural scene and its (height, width)."""
    _check(name in NAMES, f"scene {name!r} is not procedural; expected one of {', '.join(NAMES)}")
    height, width = _pixels(size)
    _check(seed >= 0, f"seed is {seed}; expected an integer >= 0")
    return _RECIPES[name].build(Stage(height, width, seed)), (height, width)


def video(
    frames: int,
    *,
    size: int | tuple[int, int] = 256,
    views: int | tuple[int, int] = 9,
    seed: int = 0,
    noise: float = 3.0,
    motion: float = 2.0,
    cut: int | None = None,
    samples: int = 3,
) -> Iterator[LightField]:
    """Render the frames of a video with exact truth, one after the other.

    A tilted wall, a box and a ball stand still; a slanted board crosses in front of them and comes nearer.
    The noise of every frame is its own.

    Parameters
    ----------
    frames : int
        Number of frames, at least 1.
    size, views, seed, samples
        As in `render`.
    noise : float
        Standard deviation of shot and read noise together at mid grey, grey levels, 0 to 255.
    motion : float
        How far the board moves from frame to frame, px, not negative; 0: nothing moves.
    cut : int, optional
        The first frame, counted from 0, of another scene: other paint, and the board comes from the other
        side.

    Yields
    ------
    LightField
        Views with `truth` and `disparity_range` as those of `render`, which are each frame's own.

    Raises
    ------
    LightFieldError
        If an argument is out of its range.

    Examples
    --------
    >>> from lfdepth import scenes
    >>> first, second = scenes.video(2, size=64, views=5, motion=3)
    >>> first.shape, bool((first.truth == second.truth).all())
    ((5, 5, 64, 64, 3), False)
    """
    _check(frames >= 1, f"frames is {frames}; expected at least 1")
    _check(seed >= 0, f"seed is {seed}; expected an integer >= 0")
    _check(0 <= noise < 256, f"noise is {noise}; expected 0 to 255 grey levels")
    _check(0 <= motion < 1 << 14, f"motion is {motion}; expected px from 0")
    _check(1 <= samples <= 16, f"samples is {samples}; expected 1 to 16")
    from lfdepth.scenes import moving

    grid = _pair(views, "views", 3, MOST_VIEWS)
    return moving.frames(frames, _pixels(size), grid, seed, noise, motion, cut, samples)


def expected_seconds(
    name: str,
    *,
    size: int | tuple[int, int] = 512,
    views: int | tuple[int, int] = 9,
    samples: int = 3,
) -> float | None:
    """How long `save` will take for a path-traced scene on this machine, s; None for others, which are quick.

    A small picture is rendered to tell.

    Raises
    ------
    LightFieldError
        If there is no scene of that name, an argument is out of its range, or Mitsuba is not installed.

    Examples
    --------
    >>> from lfdepth import scenes
    >>> scenes.expected_seconds("bars") is None  # only path-traced scenes take long enough to say
    True
    """
    if isinstance(_described(name), Recipe):
        return None
    grid = _pair(views, "views", 3, MOST_VIEWS)
    _check(1 <= samples <= 16, f"samples is {samples}; expected 1 to 16")
    return photoreal.expected_seconds(name, _pixels(size), grid, samples)


def _rendered(
    name: str,
    size: int | tuple[int, int],
    views: int | tuple[int, int],
    seed: int,
    noise: float | None,
    samples: int,
    progress: photoreal.Progress | None = None,
) -> Rendering:
    """Check the arguments of `render`; build and render the scene."""
    recipe = _described(name)
    height, width = _pixels(size)
    grid = _pair(views, "views", 3, MOST_VIEWS)
    _check(seed >= 0, f"seed is {seed}; expected an integer >= 0")
    _check(noise is None or 0 <= noise < 256, f"noise is {noise}; expected 0 to 255 grey levels")
    _check(1 <= samples <= 16, f"samples is {samples}; expected 1 to 16")
    if not isinstance(recipe, Recipe):
        return photoreal.render(name, (height, width), grid, seed, noise, samples, progress)
    from lfdepth.scenes import rendering  # numba loads late

    scene = recipe.build(Stage(height, width, seed))
    return rendering.render(scene, name, (height, width), grid, seed, noise, samples)


def _described(name: str) -> Recipe | photoreal.Motif:
    known = _RECIPES | photoreal.MOTIFS
    _check(name in known, f"scene {name!r} does not exist; expected one of {', '.join(known)}")
    return known[name]


def _pixels(size: int | tuple[int, int]) -> tuple[int, int]:
    return _pair(size, "size", SMALLEST, 1 << 14)


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
        raise LightFieldError(f"scenes: {finding}; change it")
