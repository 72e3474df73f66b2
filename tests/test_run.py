"""The whole sweep against the oracle: algorithm 1 chain by chain, then every method end to end."""

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lfdepth
import naive
from fields import RANGE, scene
from lfdepth import estimation
from lfdepth.blocks.smoothing import GuidedFilter
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField
from lfdepth.methods import FAMILY, Method, method
from lfdepth.result import Result
from lfdepth.trace import Trace

OPTIONS: dict[str, Any] = {"step": 0.1, "radius": 3, "epsilon": 1e-3}


def rule_of(lf: LightField, chosen: Method) -> dict[str, Any]:
    names = ("delta", "threshold", "gradient", "normalise")
    return {"present": lf.present, **{name: getattr(chosen, name) for name in names}}


def oracle(lf: LightField, chosen: Method) -> tuple[naive.Array, naive.Array]:
    used = chosen.parameters()
    return naive.estimate(
        lf.views,
        RANGE,
        occlusion=chosen.name == "fbsocc-sfa",
        decoder="accumulate" if chosen.name == "fbs" else "sfa",
        step=used["step"],
        skip=used.get("skip", 1),
        radius=used["radius"],
        epsilon=used["epsilon"],
        guide=used["guide"],
        subplane=used.get("subplane", True),
        **rule_of(lf, chosen),
    )


def kept_by(lf: LightField, name: str, **options: Any) -> tuple[Result, naive.Array, naive.Array]:
    """An estimate, and the volumes (K, H, W) of its votes, before and after smoothing."""
    trace = Trace(keep=("votes", "smoothed"))
    result = estimate(lf, name, trace=trace, **options)
    return result, np.stack(trace.kept["votes"]), np.stack(trace.kept["smoothed"])


@pytest.mark.thin(7)
@pytest.mark.parametrize("skip", [1, 2, 3, 7, 40])
@pytest.mark.parametrize("normalise", [False, True])
@pytest.mark.parametrize(("grid", "dtype"), [((5, 5), "uint8"), ((4, 6), "uint16")])
def test_one_pass_is_the_papers_j_chains(
    skip: int, normalise: bool, grid: tuple[int, int], dtype: str
) -> None:
    """Algorithm 1 with the oracle's votes, masks and loops; the filter is shared, so no pixel may differ."""
    lf = scene(2, grid, dtype=dtype)
    result, votes, slices = kept_by(lf, "fbsocc-sfa", skip=skip, normalise=normalise, **OPTIONS)
    smooth = GuidedFilter(
        (lf.reference / lf.full_scale).astype(np.float32), OPTIONS["radius"], OPTIONS["epsilon"]
    )
    initial, smoothed = naive.algorithm_1(
        lf.views, naive.planes(RANGE, 0.1), skip, smooth, **rule_of(lf, result.method)
    )
    np.testing.assert_allclose(votes, initial, rtol=1e-6, atol=0)
    np.testing.assert_allclose(slices, smoothed, atol=1e-4)


@pytest.mark.thin(5)
@pytest.mark.parametrize("name", ["fbs", "fbs-sfa", "fbsocc-sfa"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"delta": "sign", "gradient": "sobel", "guide": "grey"},
        {"delta": "none", "skip": 2, "subplane": False, "normalise": False},
        {"threshold": 0.1, "skip": 1, "radius": 5, "normalise": False},
    ],
    ids=["defaults", "sign-sobel-grey", "none-quotient", "photo-quotient"],
)
@pytest.mark.parametrize(
    "lf",
    [
        scene(3),
        scene(4, (4, 3), (40, 70), 1, "uint16"),
        scene(5, (3, 6), (36, 31), 3, "float32", absent=True),
    ],
    ids=["5x5-uint8-colour", "4x3-uint16-grey", "3x6-float-absent"],
)
def test_methods_agree_with_the_oracle(name: str, options: dict[str, Any], lf: LightField) -> None:
    """Single precision decides `C̃ > 0` otherwise in the odd pixel, so the odd pixel may differ."""
    has = method(name).parameters()
    options = {key: value for key, value in options.items() if key in has}
    result, _, slices = kept_by(lf, name, **{**OPTIONS, **options})
    disparity, smoothed = oracle(lf, result.method)
    apart = np.abs(result.disparity - disparity)
    assert np.mean(apart > 1e-3) < 0.002
    assert np.mean(np.abs(slices - smoothed) > 1e-3) < 0.002
    confident = np.abs(result.confidence - naive.confidence(smoothed))
    assert np.mean(confident > 1e-3) < 0.002


def test_a_trace_keeps_what_the_estimate_was_made_of() -> None:
    lf = scene(6)
    result, votes, slices = kept_by(lf, "fbs-sfa", normalise=False, **OPTIONS)
    planes = naive.planes(RANGE, 0.1)
    assert votes.shape == slices.shape == (len(planes), 44, 50)
    assert result.planes == len(planes)
    expected = np.clip(naive.sign_step(slices, planes), *RANGE)
    np.testing.assert_allclose(result.disparity, expected, atol=1e-4)
    smooth = GuidedFilter(
        (lf.reference / lf.full_scale).astype(np.float32), OPTIONS["radius"], OPTIONS["epsilon"]
    )
    for k in (0, 7, len(planes) - 1):
        np.testing.assert_array_equal(smooth(votes[k]), slices[k])


@pytest.mark.parametrize("name", FAMILY)
def test_a_trace_accounts_for_the_time_and_counts_every_step(name: str) -> None:
    """Blocks take most of a step's time, and never more than all of it.

    In half of the steps at least: a busy machine may interrupt the others between two blocks, for longer.
    """
    seen: list[tuple[int, int, str]] = []
    trace = Trace(progress=lambda *step: seen.append(step))
    result = estimate(scene(18, size=(120, 130)), name, trace=trace, threads=1)
    assert [done for done, _, _ in seen] == list(range(1, len(seen) + 1))
    assert {total for _, total, _ in seen} == {len(seen)}
    assert sum(trace.times().values()) <= result.runtime
    assert np.median([sum(lap.blocks.values()) / lap.wall for lap in trace.laps]) > 0.5
    assert {"voting", "smoothing", "decoding"} <= trace.times().keys()


@pytest.mark.parametrize("name", FAMILY)
def test_a_result_says_how_it_came_about(name: str) -> None:
    lf = scene(7)
    result = estimate(lf, name, **OPTIONS)
    assert isinstance(result, Result)
    assert result.disparity.shape == result.confidence.shape == (44, 50)
    assert result.disparity.dtype == result.confidence.dtype == np.float32
    assert RANGE[0] <= result.disparity.min() <= result.disparity.max() <= np.float32(RANGE[1])
    assert 0 <= result.confidence.min() <= result.confidence.max() <= 1
    assert result.range == RANGE
    assert result.runtime > 0
    assert result.planes == len(naive.planes(RANGE, 0.1))
    assert (result.engine, result.version) == ("cpu", lfdepth.__version__)
    assert result.method.parameters() == {**method(name).parameters(), **OPTIONS}


def test_the_given_range_goes_before_the_light_fields() -> None:
    result = estimate(scene(8), "fbs-sfa", range=(-0.2, 0.3), **OPTIONS)
    assert result.range == (-0.2, 0.3)
    assert result.planes == len(naive.planes((-0.2, 0.3), 0.1))
    assert result.disparity.min() >= np.float32(-0.2)


def test_a_last_plane_beyond_the_range_does_not_widen_it() -> None:
    result = estimate(scene(9), "fbs-sfa", range=(-0.95, 1.2), **OPTIONS)
    assert result.disparity.min() >= np.float32(-0.95)


def test_a_number_of_planes_is_spread_over_the_range() -> None:
    np.testing.assert_allclose(
        method("fbsocc-sfa", planes=9).planes_for(RANGE), np.linspace(RANGE[1], RANGE[0], 9)
    )
    assert estimate(scene(10), "fbsocc-sfa", planes=9, radius=3).planes == 9


@pytest.mark.parametrize(("preset", "step", "skip"), [("paper-synthetic", 0.02, 7), ("paper-real", 0.05, 5)])
def test_presets_are_the_papers_parameters(preset: str, step: float, skip: int) -> None:
    """Section IV of the paper."""
    chosen = method("fbsocc-sfa", preset=preset).parameters()
    assert (chosen["step"], chosen["skip"]) == (step, skip)
    assert method("fbsocc-sfa", preset=preset, skip=2).parameters()["skip"] == 2
    assert method("fbs-sfa", preset=preset).parameters()["step"] == step


def test_progress_counts_the_planes() -> None:
    seen: list[tuple[int, int, str]] = []
    estimate(scene(11), "fbsocc-sfa", progress=lambda *step: seen.append(step), **OPTIONS)
    assert seen == [(k + 1, 23, "plane") for k in range(23)]


def test_memory_does_not_grow_with_the_planes() -> None:
    """Streaming: ten times the planes must not take a tenth of a volume more."""
    lf = scene(12, (3, 3), (96, 128), 1)

    def peak(planes: int) -> int:
        tracemalloc.start()
        estimate(lf, "fbsocc-sfa", planes=planes, threads=1)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    peak(8)  # what is kept between calls, such as compiled code
    assert peak(80) - peak(8) < 0.1 * 72 * 96 * 128 * 4


def test_the_light_field_is_left_alone() -> None:
    lf = scene(13)
    before = lf.views.copy()
    estimate(lf, "fbsocc-sfa", **OPTIONS)
    np.testing.assert_array_equal(lf.views, before)


def test_views_in_any_memory_order() -> None:
    lf = scene(14)
    moved = np.moveaxis(np.ascontiguousarray(np.moveaxis(lf.views, (0, 1), (2, 3))), (2, 3), (0, 1))
    other = LightField(moved, disparity_range=RANGE)
    assert not other.views.flags.c_contiguous
    np.testing.assert_array_equal(
        estimate(other, "fbsocc-sfa", **OPTIONS).disparity, estimate(lf, "fbsocc-sfa", **OPTIONS).disparity
    )


@pytest.mark.parametrize("name", FAMILY)
def test_an_area_without_texture_gets_one_disparity_and_no_confidence(name: str) -> None:
    """Rounding left over from textured rows is no evidence: beyond the windows' reach, pixels are alike."""
    lf = scene(15, size=(100, 50))
    views = lf.views.copy()
    views[:, :, 30:] = 255
    result = estimate(LightField(views, disparity_range=RANGE), name, **OPTIONS)
    # 30 rows of texture, 4 for shifts and gradients, 3 and 3 for the filter's windows.
    empty = result.disparity[41:]
    assert result.confidence[41:].max() < 1e-5
    if name != "fbs-vis":  # which fills such areas from their neighbours
        assert np.unique(empty).size == 1


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"method": "fbs-occ"}, "method: found 'fbs-occ'"),
        ({"range": (1.0, -1.0)}, "range: found"),
        ({"range": (0.0, float("nan"))}, "range: found"),
        ({"step": 0.0}, "step: found"),
        ({"step": 1e-5}, "step: "),
        ({"method": "fbsocc-sfa", "skip": 0}, "skip: found"),
        ({"radius": 0}, "radius: found"),
        ({"radius": 30}, "radius: found"),
        ({"epsilon": 0.0}, "epsilon: found"),
        ({"threshold": 0.0}, "threshold: found"),
        ({"delta": "signs"}, "delta: found"),
        ({"guide": "color"}, "guide: found"),
        ({"method": "fbs", "photo_weight": 1.0}, "photo_weight: method fbs has no such parameter"),
        ({"skip": 5}, "skip: method fbs-vis has no such parameter"),
        ({"radius": 3.5}, "radius: found 3.5"),
        ({"radius": True}, "radius: found True"),
        ({"step": "0.1"}, "step: found '0.1'"),
        ({"gloss": "False"}, "gloss: found 'False'"),
        ({"gloss": 0}, "gloss: found 0"),
        ({"engine": "cuda"}, "engine: found 'cuda'"),
        ({"gradient": "scharr"}, "gradient: found"),
        ({"fit_radius": -2}, "fit_radius: found -2"),
        ({"fit_radius": 7}, "fit_radius: found 7"),
        ({"fit_radius": 52}, "fit_radius: found 52"),
        ({"edge_passes": -1}, "edge_passes: found -1"),
        ({"edge_passes": 2.5}, "edge_passes: found 2.5"),
        ({"photo_radius": 0}, "photo_radius: found 0"),
        ({"threads": 0}, "threads: found"),
        ({"stepsize": 0.1}, "stepsize: method fbs-vis has no such parameter"),
        ({"preset": "paper"}, "preset: found 'paper'"),
        ({"planes": 1}, "planes: found"),
    ],
)
def test_senseless_arguments_are_refused_in_one_line(arguments: dict[str, Any], named: str) -> None:
    with pytest.raises(LightFieldError) as error:
        estimate(scene(16), **arguments)
    message = str(error.value)
    assert message.startswith(named)
    assert "expected" in message
    assert "\n" not in message


def test_a_light_field_without_range_gets_one_found() -> None:
    lf = scene(17, size=(96, 96))
    result = estimate(replace(lf, disparity_range=None), "fbs", **OPTIONS)
    assert result.range_found
    assert not estimate(lf, "fbs", **OPTIONS).range_found
    with pytest.raises(LightFieldError, match=r"range"):
        estimate(replace(lf, disparity_range=None, views=np.full_like(lf.views, 99)), "fbs", **OPTIONS)


@pytest.mark.parametrize("name", FAMILY)
def test_what_does_not_fit_in_memory_is_refused_in_one_line(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lf = scene(19)
    chosen = method(name, **OPTIONS)
    needed = chosen.memory(lf.shape, chosen.planes_for(RANGE), 1)
    monkeypatch.setattr(estimation, "available_memory", lambda: needed - 1)
    with pytest.raises(LightFieldError, match=rf"{name} with 23 planes needs .* --crop, --scale") as error:
        estimate(lf, chosen)
    assert "\n" not in str(error.value)
    assert estimate(lf, chosen, force=True).planes == 23
    monkeypatch.setattr(estimation, "available_memory", lambda: needed)
    assert estimate(lf, chosen).planes == 23


def test_the_default_methods_memory_is_that_measured() -> None:
    """17×17 views of 1024×1024 px, 16 bits, 47 planes: peaks of 4.0 and 3.2 GB beside the views."""
    shape, ends = (17, 17, 1024, 1024, 3), (-1.6, 1.6)
    for options, measured in (({}, 4.03e9), ({"effort": "fast"}, 3.21e9)):
        chosen = method("fbs-vis", **options)
        assert chosen.memory(shape, chosen.planes_for(ends), 2) == pytest.approx(measured, rel=0.1)
