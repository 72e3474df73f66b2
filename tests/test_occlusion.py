"""4-D masks (eq. 7, algorithm 2) and the skip-J rule (algorithm 1) against the oracle and truth."""

import numpy as np
import pytest

import fields
import naive
from lfdepth.blocks.occlusion import SkipMask, mask_4d
from lfdepth.errors import LightFieldError


@pytest.mark.parametrize("views", [(3, 3), (4, 5), (5, 6), (1, 4)])
@pytest.mark.parametrize(("found_at", "wanted_at"), [(0.5, 0.35), (-1.0, 1.3), (2.0, -3.0), (0.2, 0.2)])
def test_masks_agree_with_the_oracle(views: tuple[int, int], found_at: float, wanted_at: float) -> None:
    mask = fields.random_mask(np.random.default_rng(1), (14, 19))
    found = mask_4d(mask, found_at=found_at, wanted_at=wanted_at, views=views)
    assert found.shape == (*views, 14, 19)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, naive.mask_4d(mask, wanted_at - found_at, views) / naive.UNIT)


def test_weights_are_carried_like_masks() -> None:
    weight = np.random.default_rng(2).random((11, 12))
    shifted = naive.reparameterise(np.broadcast_to(weight, (3, 4, 11, 12)), 0.7) / naive.UNIT
    found = mask_4d(weight, found_at=-0.3, wanted_at=0.4, views=(3, 4))
    np.testing.assert_allclose(found, shifted, atol=1e-6)


@pytest.mark.parametrize("found_at", [-1.4, 0.3, 2.0])
@pytest.mark.parametrize("wanted_at", [-0.7, 2.5])
def test_the_reference_view_keeps_its_mask(found_at: float, wanted_at: float) -> None:
    """The paper after eq. 6: the reference view is not warped."""
    mask = fields.random_mask(np.random.default_rng(3), (12, 13))
    masks = mask_4d(mask, found_at=found_at, wanted_at=wanted_at, views=(4, 5))
    np.testing.assert_array_equal(masks[2, 2], mask)
    same = mask_4d(mask, found_at=found_at, wanted_at=found_at, views=(4, 5))
    np.testing.assert_array_equal(same, np.broadcast_to(mask, same.shape))


@pytest.mark.parametrize("disparity", [1.0, -2.0])
def test_a_mask_finds_its_object_in_every_view(disparity: float) -> None:
    """Truth: an object at disparity D lies at x − D·u in view u (plane 0 is the view's own coordinates)."""
    mask = np.zeros((20, 24), bool)
    mask[8:13, 9:15] = True
    masks = mask_4d(mask, found_at=disparity, wanted_at=0.0, views=(5, 5))
    for i, j in np.ndindex(5, 5):
        u, v = j - 2, i - 2
        expected = np.roll(mask, (-int(disparity) * v, -int(disparity) * u), (0, 1))
        np.testing.assert_array_equal(masks[i, j], expected)


def test_a_mask_goes_there_and_back() -> None:
    """Over whole pixels, away from the border, nothing is lost between planes."""
    mask = np.zeros((30, 31), bool)
    mask[12:18, 11:19] = True
    masks = mask_4d(mask, found_at=1.0, wanted_at=3.0, views=(5, 4))
    back = naive.reparameterise(masks, -2.0) / naive.UNIT
    np.testing.assert_array_equal(back, np.broadcast_to(mask, back.shape))


def test_only_maps_of_the_reference_view_are_taken() -> None:
    with pytest.raises(LightFieldError, match="mask: found shape"):
        mask_4d(np.zeros((2, 5, 5), bool), found_at=0.0, wanted_at=1.0)


@pytest.mark.parametrize("skip", [1, 2, 5])
def test_plane_k_gets_the_foreground_of_plane_k_minus_j(skip: int) -> None:
    rng = np.random.default_rng(4)
    step = 0.06
    rule = SkipMask(skip, step)
    slices = rng.normal(size=(12, 6, 7)).astype(np.float32)
    slices[:, 0, 0] = 0  # no evidence is not foreground (eq. 7)
    working = np.empty((6, 7), np.float32)
    for k, smoothed in enumerate(slices):
        mask = rule.mask()
        if k < skip:
            assert mask is None
        else:
            assert mask is not None
            np.testing.assert_array_equal(mask.foreground, slices[k - skip] > 0)
            assert mask.offset == pytest.approx(-skip * step)
        working[:] = smoothed  # the sweep reuses its slice
        rule.update(working)
        working[:] = np.nan


@pytest.mark.parametrize("skip", [0, -2])
def test_a_skip_below_one_is_refused(skip: int) -> None:
    with pytest.raises(LightFieldError, match="skip: found J = "):
        SkipMask(skip, 0.05)
