"""Paths that go on across the border of a window: what enters makes up for what was cut off, exactly."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from lfdepth import engines
from lfdepth.blocks.borders import PathBorders, Side

PLANES, HEIGHT, WIDTH = 7, 40, 44
PENALTIES: dict[str, Any] = {"slope": 0.3, "jump": 2.0, "sharpness": 20.0, "noise": 0.01}


def field() -> tuple[Any, ...]:
    """Energies that say little, so that paths bring much along, and a guide: the engine's and the host's."""
    rng = np.random.default_rng(5)
    signs = rng.normal(0, 0.05, (PLANES, HEIGHT, WIDTH)).astype(np.float32)
    signs[:, :, :4] += np.linspace(0, 1, PLANES, dtype=np.float32)[:, None, None]
    signs[:, :4] += np.linspace(1, 0, PLANES, dtype=np.float32)[:, None, None]
    shares = rng.integers(0, 256, (PLANES, HEIGHT, WIDTH)).astype(np.uint8)
    weight = rng.random((HEIGHT, WIDTH)).astype(np.float32) * np.float32(0.1)
    guide = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32) * np.float32(0.02)
    return signs, shares, weight, guide


@pytest.mark.parametrize("name", engines.NAMES)
@pytest.mark.parametrize("side", ["right", "left", "bottom", "top"])
def test_paths_in_a_window_are_those_of_the_whole(side: Side, name: str) -> None:
    """Two windows, of which the second takes what leaves the first: equal beyond where paths begin."""
    arrays = field()
    if side in ("left", "top"):  # the same, mirrored
        arrays = tuple(np.ascontiguousarray(_mirrored(each, side)) for each in arrays)
    forth = side in ("right", "bottom")
    length = WIDTH if side in ("right", "left") else HEIGHT
    first = slice(0, 30) if forth else slice(length - 30, length)
    second = slice(20, length) if forth else slice(0, length - 20)
    opposite: dict[Side, Side] = {"right": "left", "left": "right", "top": "bottom", "bottom": "top"}
    begins = 23 if forth else length - 1 - 23
    with engines.engine(name, threads=1) as engine:
        paths: Any = partial(engine.paths, **PENALTIES)

        def cut(part: slice) -> tuple[Any, ...]:
            found = [_part(each, side, part) for each in arrays]
            return engine.upload(found[0].copy()), engine.upload(found[1].copy()), found[2].copy(), found[3]

        whole = engine.download(paths(*cut(slice(0, length))))
        leaver = PathBorders({}, {side: begins - first.start})
        signs, shares, weight, guide = cut(first)
        with leaver.open(signs, weight, guide, engine) as led:
            leaver.note(signs, shares, weight, led, paths, engine)
        signs, shares, weight, guide = cut(second)
        found = {}
        for entering in ([], [{opposite[side]: leaver.leaving[0][side]}]):
            entries = {opposite[side]: begins - second.start} if entering else {}
            enterer = PathBorders(entries, {}, entering)
            with enterer.open(signs, weight, guide, engine) as led:
                found[len(entering)] = engine.download(paths(signs, shares, weight, led))
        np.testing.assert_array_equal(engine.download(signs), cut(second)[0])  # as they were
        np.testing.assert_array_equal(weight, cut(second)[2])
    beyond = slice(24 - second.start, None) if forth else slice(0, begins)
    axis = 1 if side in ("right", "left") else 0
    inner = (slice(None),) * axis + (beyond,)
    expected = whole[(slice(None),) * axis + (second,)][inner]
    assert (np.abs(found[0][inner].astype(int) - expected) > 0).mean() > 0.2
    np.testing.assert_array_equal(found[1][inner], expected)


def _part(array: Any, side: Side, part: slice) -> Any:
    """Columns or rows of a volume, an image, or an image of channels."""
    axis = (array.ndim == 3 and len(array) == PLANES) + (side in ("right", "left"))
    return np.ascontiguousarray(array[(slice(None),) * axis + (part,)])


def _mirrored(array: Any, side: Side) -> Any:
    return np.flip(array, (array.ndim == 3 and len(array) == PLANES) + (side == "left"))
