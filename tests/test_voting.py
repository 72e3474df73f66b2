"""Disparity signs and votes (eq. 2-6) against the oracle and truth: signs and counts agree exactly."""

from typing import Any, get_args

import numpy as np
import pytest

import fields
import naive
from lfdepth.blocks.voting import Mask, VoteCount, VoteRule, disparity_signs, vote
from lfdepth.engines import single
from lfdepth.engines.base import Delta, Gradient
from lfdepth.engines.cpu.layout import grey_stack
from lfdepth.engines.cpu.workers import Workers
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField

DELTAS: tuple[Delta, ...] = get_args(Delta)
GRADIENTS: tuple[Gradient, ...] = get_args(Gradient)

# Grid, size, disparity, and the mask's offset. Sizes lie around multiples of 32, where blocks of columns
# begin, and above 32 rows, where bands may begin; some shifts leave the image.
CASES: list[tuple[tuple[int, int], tuple[int, int], float, float]] = [
    ((3, 3), (8, 9), 0.3, -0.15),
    ((4, 5), (21, 33), -1.21, -0.3),
    ((5, 4), (20, 64), 0.0, 0.4),
    ((6, 3), (35, 31), 3.6, -0.06),
    ((5, 5), (40, 100), -0.47, -1.7),
    ((6, 6), (12, 130), -5.25, -2.3),
    ((3, 6), (70, 45), 1.013, 1.0),
    ((1, 5), (11, 37), 0.37, -0.5),
    ((4, 1), (18, 20), -0.37, -0.5),
    ((3, 3), (1, 5), 20.0, 7.3),
    ((3, 4), (9, 1), 0.5, -0.5),
]


def assert_votes_agree(lf: LightField, disparity: float, mask: Mask | None, rule: VoteRule) -> None:
    """Sums and numbers of votes exactly, their quotient but for rounding."""
    options: dict[str, Any] = {"delta": rule.delta, "threshold": rule.threshold, "gradient": rule.gradient}
    masking: dict[str, Any] = {} if mask is None else {"foreground": mask.foreground, "offset": mask.offset}
    total, weight, possible = naive.count(lf.views, disparity, present=lf.present, **options, **masking)
    count = VoteCount(single(), single().grey_views(lf, disparity), rule)
    count.plane(disparity, mask)
    for found, expected in ((count.votes, total), (count.evidence, weight)):
        counted = found.astype(np.float64) * possible
        np.testing.assert_array_equal(np.rint(counted), expected)
        assert np.abs(counted - expected).max() < 0.02
    np.testing.assert_allclose(
        vote(lf, disparity, rule=rule, mask=mask), naive.quotient(total, weight), rtol=1e-6, atol=0
    )


@pytest.mark.thin(5)
@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("gradient", GRADIENTS)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("masked", [False, True])
def test_votes_agree_with_the_oracle(
    delta: Delta, gradient: Gradient, dtype: str, channels: int, masked: bool
) -> None:
    rng = np.random.default_rng([7, len(delta), len(gradient), channels, masked])
    for index, (grid, size, disparity, offset) in enumerate(CASES):
        present = fields.random_present(rng, grid) if index % 3 == 1 else None
        kind = fields.TEXTURES[(index + channels) % 3]
        lf = fields.light_field(rng, grid, size, channels, dtype, kind, present)
        mask = Mask(fields.random_mask(rng, size), offset) if masked else None
        rule = VoteRule(delta, float(rng.choice([0.02, 0.1, 0.4])), gradient)
        assert_votes_agree(lf, disparity, mask, rule)


@pytest.mark.thin(5)
@pytest.mark.parametrize("gradient", GRADIENTS)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("kind", fields.TEXTURES)
def test_signs_agree_with_the_oracle(gradient: Gradient, dtype: str, kind: str) -> None:
    rng = np.random.default_rng(8)
    for index, (grid, size, disparity, _) in enumerate(CASES):
        present = fields.random_present(rng, grid) if index % 3 == 1 else None
        lf = fields.light_field(rng, grid, size, 1 + 2 * (index % 2), dtype, kind, present)
        expected = naive.signs(lf.views, disparity, present, gradient)
        for found, wanted in zip(disparity_signs(lf, disparity, gradient=gradient), expected, strict=True):
            assert found.dtype == np.int8
            np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("fill", [False, True])
def test_a_uniform_mask_votes_with_all_views(delta: Delta, fill: bool) -> None:
    """Where every view's mask equals the reference's, eq. 4 and 5 are the vote without a mask."""
    lf = fields.light_field(np.random.default_rng(9), (5, 5), (22, 70))
    rule = VoteRule(delta)
    mask = Mask(np.full((22, 70), fill), -0.45)
    np.testing.assert_array_equal(vote(lf, 0.1, rule=rule, mask=mask), vote(lf, 0.1, rule=rule))


@pytest.mark.parametrize("column", [31, 32, 33, 63, 64])
@pytest.mark.parametrize("offset", [-0.15, 0.3, -1.6, 4.0])
def test_mask_edges_at_block_borders(column: int, offset: float) -> None:
    rng = np.random.default_rng(10)
    lf = fields.light_field(rng, (5, 4), (12, 97), kind="noise")
    foreground = np.zeros((12, 97), bool)
    foreground[:, column:] = True
    assert_votes_agree(lf, 0.2, Mask(foreground, offset), VoteRule("none"))
    foreground[:] = True
    foreground[5, column] = False
    assert_votes_agree(lf, 0.2, Mask(foreground, offset), VoteRule("photo", 0.3))


@pytest.mark.parametrize("threshold", [1 / 255, 0.02, 0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("kind", ["noise", "coarse"])
def test_photo_thresholds_are_strict(threshold: float, kind: str) -> None:
    """Levels exactly τ apart do not count; at τ = 1 black beside white does not either."""
    lf = fields.light_field(np.random.default_rng(11), (3, 4), (10, 40), kind=kind)
    for disparity in (0.0, 1.0, 0.33):
        assert_votes_agree(lf, disparity, None, VoteRule("photo", threshold))


def test_a_large_grid_of_views_does_not_overflow() -> None:
    lf = fields.light_field(np.random.default_rng(12), (17, 17), (6, 8), kind="noise")
    for delta in DELTAS:
        assert_votes_agree(lf, -0.4, None, VoteRule(delta))
        assert_votes_agree(lf, -0.4, Mask(np.arange(48).reshape(6, 8) % 3 == 0, -0.2), VoteRule(delta))


def test_more_votes_than_16_bits_count() -> None:
    """Truth: a ramp in register at 0 is foreground for a plane behind it; every view and axis says so."""
    ramp = 10.0 * np.arange(5) + 10.0 * np.arange(4)[:, None]
    v, u = np.ogrid[:130, :130]
    views = ramp + (u[..., None, None] + v[..., None, None]) * 0.5 + 20
    lf = LightField(np.rint(views * 257).astype(np.uint16)[..., None])
    for mask in (None, Mask(np.ones((4, 5), bool), 0.0)):
        assert (vote(lf, 0.0, rule=VoteRule("none"), mask=mask)[1:-1, 1:-1] == 1).all()


@pytest.mark.parametrize("disparity", [-1e6, -37.3, 31.0, 1e6])
def test_shifts_beyond_the_image_need_no_memory(disparity: float) -> None:
    lf = fields.light_field(np.random.default_rng(18), (4, 3), (12, 20), kind="noise")
    assert grey_stack(Workers(1), lf, abs(disparity)).data.nbytes < 20 * lf.views.nbytes
    mask = Mask(fields.random_mask(np.random.default_rng(19), (12, 20)), disparity)
    for chosen in (None, mask):
        assert_votes_agree(lf, disparity, chosen, VoteRule("none"))
        assert_votes_agree(lf, 0.2, chosen, VoteRule("none", gradient="sobel"))


def test_absent_views_are_never_looked_at() -> None:
    rng = np.random.default_rng(13)
    present = fields.random_present(rng, (5, 6))
    lf = fields.light_field(rng, (5, 6), (14, 40), present=present)
    other = lf.views.copy()
    other[~present] = rng.integers(0, 256, other[~present].shape)
    changed = LightField(other, present=present)
    for mask in (None, Mask(fields.random_mask(rng, (14, 40)), -0.3)):
        np.testing.assert_array_equal(vote(lf, 0.3, mask=mask), vote(changed, 0.3, mask=mask))


def test_a_view_without_neighbours_has_no_vote() -> None:
    present = np.zeros((3, 5), bool)
    present[1, 2] = present[0, 0] = True
    lf = fields.light_field(np.random.default_rng(14), (3, 5), (9, 9), present=present)
    for delta in DELTAS:
        assert (vote(lf, 0.2, rule=VoteRule(delta)) == 0).all()


def test_an_even_area_is_no_evidence() -> None:
    lf = LightField(np.full((5, 5, 10, 40, 3), 200, np.uint8))
    for delta in DELTAS:
        assert (vote(lf, 0.37, rule=VoteRule(delta)) == 0).all()


@pytest.mark.parametrize("grid", [(3, 3), (4, 6), (5, 5), (1, 5), (5, 1)])
@pytest.mark.parametrize("gradient", GRADIENTS)
@pytest.mark.parametrize("delta", DELTAS)
def test_votes_tell_front_from_back(grid: tuple[int, int], gradient: Gradient, delta: Delta) -> None:
    """Truth: a smooth picture at disparity 0.4 is foreground for planes behind it, background for others."""
    paint = fields.texture(np.random.default_rng(15), shortest=14.0, longest=40.0)
    views = fields.plane_views(paint, 0.4, grid, (40, 44))
    lf = LightField(fields.quantise(views[..., None], "uint16"))
    rule = VoteRule(delta, 0.2, gradient)
    inner = (slice(4, -4), slice(4, -4))
    behind, before = (vote(lf, plane, rule=rule)[inner] for plane in (0.15, 0.65))
    # Where the picture is level along x or y its sign is undefined, so a few votes are lost.
    assert np.mean(behind > 0) > 0.97
    assert np.mean(before < 0) > 0.97
    assert behind.mean() > 0.85
    assert before.mean() < -0.85


def test_the_mask_keeps_an_occluder_out_of_the_background_vote() -> None:
    """Truth: beside a near rectangle, with its mask, the wall is seen to lie behind a plane in between."""
    rng = np.random.default_rng(16)
    views, truth = fields.two_planes(rng, (7, 7), (50, 60), near=1.5, far=-0.5)
    lf = LightField(fields.quantise(views[..., None], "uint16"))
    foreground = truth > 0
    beside = np.zeros_like(foreground)
    for shift in (1, 2):
        for axis in (0, 1):
            beside |= np.roll(foreground, shift, axis) | np.roll(foreground, -shift, axis)
    beside &= ~foreground
    without = vote(lf, 0.0, rule=VoteRule("none"))[beside]
    # The rectangle's mask, carried from its own plane to this one, hides it in every view.
    masked = vote(lf, 0.0, rule=VoteRule("none"), mask=Mask(foreground, 0.0 - 1.5))[beside]
    assert (masked < 0).all()
    assert masked.mean() < without.mean() - 0.2


def test_bad_rules_and_masks_are_refused() -> None:
    with pytest.raises(LightFieldError, match="delta: found 'sgn'"):
        VoteRule("sgn")  # type: ignore[arg-type]
    with pytest.raises(LightFieldError, match="gradient: found 'prewitt'"):
        VoteRule(gradient="prewitt")  # type: ignore[arg-type]
    for threshold in (0.0, -0.1, 1.5, float("nan")):
        with pytest.raises(LightFieldError, match="threshold: found"):
            VoteRule(threshold=threshold)
    lf = fields.light_field(np.random.default_rng(17), (3, 3), (6, 7))
    with pytest.raises(LightFieldError, match=r"mask: found shape \(7, 6\)"):
        vote(lf, 0.0, mask=Mask(np.zeros((7, 6), bool), 0.0))
