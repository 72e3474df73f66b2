"""Which views show a point, and what that is worth where the brightness of views is measured."""

from __future__ import annotations

import numpy as np
import pytest

import lfdepth
from lfdepth import scenes
from lfdepth.engines import engine
from lfdepth.lightfield import LightField
from lfdepth.probe.visibility import hidden, of_one_surface
from lfdepth.scenes.cameras import Imperfections, spoil, unspoil

NOISE = 0.002


@pytest.mark.parametrize("name", ["cpu", "numpy"])
@pytest.mark.parametrize("shrink", [1, 2])
def test_points_behind_a_square_are_hidden_where_it_stands_before_them(name: str, shrink: int) -> None:
    """A square at 1 px before a wall at -1 px: against the wall it moves by 2 px per view step."""
    side = 40
    surface = np.full((side, side), -1.0, np.float32)
    surface[15:25, 15:25] = 1
    lf = LightField(np.full((5, 5, side * shrink, side * shrink, 1), 90, np.uint8))
    y, x = np.mgrid[6:34, 6:34]
    points = np.stack([y.ravel(), x.ravel()], axis=1)
    d = surface[points[:, 0], points[:, 1]].astype(np.float64) * shrink
    found = hidden(lf, surface * shrink, 0.5 * shrink, points * shrink, d, engine(name, threads=1))
    for view, (down, across) in enumerate(np.argwhere(np.ones((5, 5))) - 2):
        # where a point of the wall would appear, less where the square begins in that view, and ends
        from_top, from_left = y + down - (15 - down), x + across - (15 - across)
        behind = (from_top >= -1) & (from_top <= 10) & (from_left >= -1) & (from_left <= 10)
        expected = (behind & (surface[y, x] < 0)).ravel()
        np.testing.assert_array_equal(found[view], expected, str((down, across)))


def test_absent_views_hide_nothing() -> None:
    surface = np.full((20, 20), -1.0, np.float32)
    surface[5:15, 5:15] = 1
    present = np.ones((3, 3), np.bool_)
    present[0, 0] = False
    lf = LightField(np.full((3, 3, 20, 20, 1), 90, np.uint8), present=present)
    points = np.argwhere(surface < 0)
    d = np.full(len(points), -1.0)
    found = hidden(lf, surface, 1.0, points, d, engine("cpu", threads=1))
    assert not found[0].any()
    assert found[8].any()


def test_points_at_edges_are_of_two_surfaces() -> None:
    surface = np.full((12, 12), -1.0, np.float32)
    surface[4:8, 4:8] = 1
    kept = np.isfinite(of_one_surface(surface, 0.5))
    expected = np.ones((12, 12), np.bool_)
    expected[3:9, 3:9] = False
    expected[5:7, 5:7] = True
    np.testing.assert_array_equal(kept, expected)


def test_wires_do_not_pass_for_brightness() -> None:
    """Fitted to all windows alike, every view but the reference view is off by 1.3 thousandths one way."""
    lf = scenes.render("fence", size=96, views=9, seed=3, samples=1)
    case = Imperfections(gain=0.05, noise=NOISE)
    error = _means(spoil(lf, case), case)
    assert abs(error.mean()) < 0.18e-3
    assert error.std() < 0.4e-3


def test_offsets_are_found_behind_wires() -> None:
    """Windows that wires hide in part do not tell them: without these, two halves of the picture agree."""
    lf = scenes.render("fence", size=96, views=9, seed=3, samples=1)
    case = Imperfections(offset=0.02, noise=NOISE)
    spoiled = spoil(lf, case)
    assert lfdepth.measure_brightness(spoiled).offset.any()
    assert np.sqrt((_means(spoiled, case) ** 2).mean()) < 0.33e-3


def test_white_balance_does_not_pass_for_shading() -> None:
    """What is red would seem darker in views of less red, wherever it lies: 1.8 thousandths were left."""
    lf = scenes.render("demo", size=128, views=5, seed=3, samples=1)
    case = Imperfections(white_balance=0.08, vignetting=0.7, wandering=0.3, noise=NOISE)
    spoiled = spoil(lf, case)
    mended = _blocks(lfdepth.equalise(spoiled, lfdepth.measure_brightness(spoiled)))
    ratio = mended / _blocks(unspoil(spoiled, case))
    assert np.sqrt(((ratio / ratio[2, 2] - 1) ** 2).mean()) < 1.15e-3


def _means(spoiled: LightField, case: Imperfections) -> np.ndarray:
    """What equalising leaves of the mean level of each view."""
    mended = lfdepth.equalise(spoiled, lfdepth.measure_brightness(spoiled)).views / 65535
    return np.asarray((mended - unspoil(spoiled, case).views / 65535).mean(axis=(2, 3, 4)))


def _blocks(lf: LightField) -> np.ndarray:
    """Means of 16×16 px of every view."""
    v, u, height, width, channels = lf.shape
    shape = (v, u, height // 16, 16, width // 16, 16, channels)
    return np.asarray((lf.views / 65535).reshape(shape).mean(axis=(3, 5)))
