"""The methods on procedural scenes, whose truth is exact: stated errors, and what each system adds."""

from typing import NamedTuple

import numpy as np
import pytest

import fields
from lfdepth import scenes
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods import FAMILY


class Errors(NamedTuple):
    """Absolute errors of one map, by region of the reference view."""

    open: fields.Array  # textured and away from occlusions
    boundary: fields.Array  # near the edge of an occluder


Found = tuple[str, dict[str, Errors]]


@pytest.fixture(scope="module", params=["demo", "bars"])
def found(request: pytest.FixtureRequest) -> Found:
    lf = scenes.render(request.param, size=128, views=9, seed=0)
    return request.param, {name: errors(lf, name) for name in FAMILY}


def errors(lf: LightField, name: str) -> Errors:
    assert lf.truth is not None
    error = np.abs(estimate(lf, name).disparity - lf.truth)
    boundary = lf.masks["occlusion_boundary"]
    textureless = lf.masks.get("textureless", np.zeros_like(boundary))
    return Errors(error[~boundary & ~textureless], error[boundary])


def badpix(error: fields.Array) -> float:
    return 100 * float(np.mean(error > 0.07))


@pytest.mark.thin(5)
@pytest.mark.parametrize(("name", "typical"), [("fbs", 0.02), ("fbs-sfa", 0.012), ("fbsocc-sfa", 0.012)])
def test_open_surfaces_are_found_to_a_fraction_of_the_step(found: Found, name: str, typical: float) -> None:
    scene, by_method = found
    error = by_method[name].open
    assert np.median(error) < typical, scene
    assert badpix(error) < 4, scene


@pytest.mark.parametrize("name", FAMILY)
def test_errors_near_occluders_stay_within_bounds(found: Found, name: str) -> None:
    """The scene "bars" is all edges: 95 % of its pixels lie near one."""
    scene, by_method = found
    assert badpix(by_method[name].boundary) < {"demo": 20, "bars": 30}[scene]


def test_sign_function_approximation_beats_accumulation(found: Found) -> None:
    _, by_method = found
    assert np.median(by_method["fbs-sfa"].open) < np.median(by_method["fbs"].open)
    assert badpix(by_method["fbs-sfa"].boundary) < badpix(by_method["fbs"].boundary)


def test_the_mask_helps_near_the_occluder(found: Found) -> None:
    """The paper's claim: fewer errors around occlusion boundaries than FBS-SFA."""
    _, by_method = found
    with_mask, without = by_method["fbsocc-sfa"].boundary, by_method["fbs-sfa"].boundary
    assert badpix(with_mask) < badpix(without)
    assert with_mask.mean() < without.mean()
