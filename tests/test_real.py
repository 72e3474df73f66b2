"""The methods on real benchmark scenes with low-resolution truth; skipped where the data is absent.

Limits are BadPix in % and MSE×100, in the benchmark's frame, for default parameters, one set for both scenes.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import lfdepth
from against_truth import Scene, check_confidence

FBSOCC_SFA = {"cotton": (4.5, 0.56), "backgammon": (6.4, 3.1)}
"""BadPix 0.07, MSE×100."""

FBS_VIS = {"cotton": (0.85, 2.74, 12.8, 0.38), "backgammon": (1.18, 2.13, 8.1, 0.92)}
"""BadPix 0.07, 0.03, 0.01, MSE×100: within a fifth of what the README claims."""


@pytest.fixture(scope="module", params=FBS_VIS)
def name(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.fixture(scope="module")
def scene(name: str, data_folder: Path) -> Scene:
    folder = data_folder / "hci4d" / name
    if not folder.is_dir():
        pytest.skip(f"real data is absent: {folder}")
    return Scene(lfdepth.read(folder))


def test_fbsocc_sfa_reaches_its_limits(name: str, scene: Scene) -> None:
    badpix, mse = FBSOCC_SFA[name]
    assert scene.badpix("fbsocc-sfa") <= badpix
    assert scene.mse("fbsocc-sfa") <= mse


def test_fbsocc_sfa_is_no_worse_than_fbs_sfa(scene: Scene) -> None:
    """The paper's claim (Table 1, Fig. 7)."""
    assert scene.badpix("fbsocc-sfa") <= scene.badpix("fbs-sfa")
    assert scene.mse("fbsocc-sfa") <= scene.mse("fbs-sfa")


def test_fbs_sfa_is_better_than_fbs(scene: Scene) -> None:
    assert scene.badpix("fbs-sfa") < scene.badpix("fbs")


def test_fbs_vis_reaches_its_limits(name: str, scene: Scene) -> None:
    *badpix, mse = FBS_VIS[name]
    for threshold, limit in zip((0.07, 0.03, 0.01), badpix, strict=True):
        assert scene.badpix("fbs-vis", threshold=threshold) <= limit, threshold
    assert scene.mse("fbs-vis") <= mse


def test_fbs_vis_has_a_third_fewer_bad_pixels_than_fbsocc_sfa(scene: Scene) -> None:
    assert scene.badpix("fbs-vis") < 2 / 3 * scene.badpix("fbsocc-sfa")
    assert scene.mse("fbs-vis") <= scene.mse("fbsocc-sfa")


def test_confidence_sorts_the_pixels(scene: Scene) -> None:
    check_confidence(scene, "fbs-vis")
