"""What every engine has to pass: each function of the protocol against the oracle, and whole methods.

A new engine needs its name in `lfdepth.engines.NAMES` and nothing here. Prepared views, surfaces and filters
are opaque, so they are tested by what comes of them.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fields
import naive
import naive_costs
import naive_edge_net
import naive_gloss
import naive_labels
import naive_photo
import naive_pictures
import naive_refine
import naive_sides
import naive_views
import naive_vis
from lfdepth import engines, scenes
from lfdepth.blocks.bilateral import bilateral_weights
from lfdepth.blocks.edges import DepthEdges, EdgeRule
from lfdepth.blocks.median import weighted_median
from lfdepth.blocks.refine import RefineRule, gather_evidence, refine_disparity
from lfdepth.blocks.surface import fit_surfaces
from lfdepth.engines.base import Engine
from lfdepth.engines.cpu.workers import bands
from lfdepth.engines.layout import ENERGY_SCALE as SCALE
from lfdepth.engines.layout import surface_levels
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.lightfield import LightField, grid_offsets
from lfdepth.result import Result

Array = fields.Array

GRIDS = [(3, 3), (4, 5), (1, 5), (7, 1)]
SIZES = [(6, 9), (5, 33), (1, 10), (10, 1), (34, 12)]


@pytest.fixture(scope="module", params=engines.NAMES)
def used(request: pytest.FixtureRequest) -> Iterator[Engine]:
    with engines.engine(request.param, threads=2) as started:
        yield started


def protocol() -> dict[str, Any]:
    """The protocol's functions."""
    return {name: each for name, each in vars(Engine).items() if name[0] != "_" and callable(each)}


# The protocol


@pytest.mark.parametrize("name", engines.NAMES)
def test_an_engine_is_the_protocol_and_nothing_else(name: str) -> None:
    """The same functions with the same parameters: names, kinds and defaults."""
    with engines.engine(name, threads=1) as started:
        kind, found = type(started), started.name
    public = {each for each in dir(kind) if each[0] != "_" and callable(getattr(kind, each))}
    assert public == set(protocol())
    assert found == name
    for each, function in protocol().items():
        expected, own = (
            [(p.name, p.kind, p.default) for p in inspect.signature(f).parameters.values()]
            for f in (function, getattr(kind, each))
        )
        assert own == expected, each


def test_every_function_is_tested_here() -> None:
    text = Path(__file__).read_text()
    missing = [name for name in protocol() if not re.search(rf"\b(used|started)\.{name}\(", text)]
    assert missing == []


@pytest.mark.parametrize("name", engines.NAMES)
def test_threads_below_one_are_refused(name: str) -> None:
    with pytest.raises(LightFieldError, match=r"^threads: found 0, expected at least 1"):
        engines.engine(name, threads=0)
    started = engines.engine(name)
    started.close()


@pytest.mark.parametrize(("rows", "count"), [(0, 3), (1, 3), (7, 3), (3, 7), (12, 4), (5, 1)])
def test_bands_hold_every_row_once(rows: int, count: int) -> None:
    """None where there are no rows; as even as can be."""
    found = bands(rows, count)
    assert [row for start, end in found for row in range(start, end)] == list(range(rows))
    sizes = [end - start for start, end in found]
    assert len(found) == min(rows, count)
    assert not sizes or max(sizes) - min(sizes) <= 1


# Arrays


def test_arrays_go_up_and_come_down(used: Engine) -> None:
    rng = np.random.default_rng(1)
    for host in (rng.random((3, 4, 5)).astype(np.float32), rng.integers(0, 9, (4, 5)).astype(np.uint8)):
        array = used.upload(host)
        assert (tuple(array.shape), np.dtype(array.dtype)) == (host.shape, host.dtype)
        np.testing.assert_array_equal(used.download(array), host)
        np.testing.assert_array_equal(used.download(array[1:3]), host[1:3])
        turned = used.upload(host.T)
        np.testing.assert_array_equal(used.download(turned), host.T)
    assert not used.download(used.zeros((3, 4), np.int32)).any()
    empty = used.empty((2, 3), np.float32)
    assert (tuple(empty.shape), np.dtype(empty.dtype)) == ((2, 3), np.dtype(np.float32))


@pytest.mark.parametrize("name", engines.NAMES)
@pytest.mark.parametrize("count", [0, 1, 2, 9])
def test_what_is_done_for_each_comes_back_in_order(name: str, count: int) -> None:
    """Every item is done once, whichever thread does it; what goes wrong there is raised here."""
    with engines.engine(name, threads=3) as started:
        done: list[int] = []

        def act(item: int) -> int:
            done.append(item)
            return item * item

        assert started.each(act, iter(range(count))) == [item**2 for item in range(count)]
        assert sorted(done) == list(range(count))
        with pytest.raises(ZeroDivisionError):
            started.each(lambda item: 1 // item, [1, 2, 0, 3])


# A first look


@pytest.mark.parametrize("halves", [False, True])
def test_matches_agree_with_the_oracle(used: Engine, halves: bool) -> None:
    rng = np.random.default_rng(halves)
    margin, size, planes = 6, (7, 9), np.arange(-1.5, 1.6, 0.37)
    reference, views = (rng.uniform(0, 60, shape).astype(np.float32) for shape in (size, (5, *size)))
    grid = np.array([(-2, 0), (0, 2), (1, 1), (0, -1), (2, -2)])
    shifts = np.outer(-planes, grid[:, 0]), np.outer(-planes, grid[:, 1])
    sides = np.sign(grid).astype(np.int32)
    counts = np.array([5, 3, 3, 3, 4], np.float32)
    apertures = ((1 / (9 * counts)).astype(np.float32), np.array([0, 1.0, 1.5, np.inf, 0.5], np.float32))
    chosen = apertures[0][: 5 if halves else 1], apertures[1][: 5 if halves else 1]
    padded = np.pad(views, ((0, 0), (0, 0), (margin, margin)), "edge")
    best, beside = used.match(reference, padded, shifts, sides, chosen, margin=margin, apart=2, limit=20.0)
    costs = naive_pictures.matching_costs(reference, views, shifts, sides, chosen, 20.0)
    expected_best, expected_beside = naive_pictures.best_planes(costs, 2)
    np.testing.assert_array_equal(best, expected_best)
    np.testing.assert_allclose(beside, expected_beside, rtol=1e-5)


# The vote of the signs

VOTES: list[dict[str, Any]] = [
    {},
    {"gradient": "sobel"},
    {"delta": "sign"},
    {"delta": "none"},
    {"threshold": 0.2},
]


@pytest.mark.parametrize("options", VOTES, ids=lambda each: " ".join(map(str, each.values())) or "default")
@pytest.mark.parametrize("grid", GRIDS)
def test_votes_agree_with_the_oracle(used: Engine, grid: tuple[int, int], options: dict[str, Any]) -> None:
    """Counts are whole numbers: none may differ, with a mask or without, absent views or none."""
    rng = np.random.default_rng([*grid, len(options)])
    size, planes = (9, 35), (-1.3, 0.0, 0.61)
    present = fields.random_present(rng, grid)
    for kind, held in (("scene", present), ("coarse", None)):
        lf = fields.light_field(rng, grid, size, 3, "uint8", kind, held)
        views = used.grey_views(lf, 1.3)
        assert views.size == size
        votes, evidence = used.empty(size, np.float32), used.empty(size, np.float32)
        foreground, offset = fields.random_mask(rng, size), -0.35
        for plane in planes:
            for mask in (None, (used.upload(foreground), offset)):
                used.vote(views, plane, votes, evidence, mask=mask, **options)
                rule: Any = {} if mask is None else {"foreground": foreground, "offset": offset}
                *sums, possible = naive.count(lf.views, plane, present=held, **options, **rule)
                for found, expected in zip((votes, evidence), sums, strict=True):
                    parts = used.download(found).astype(np.float64) * max(possible, 1)
                    np.testing.assert_allclose(parts, expected, rtol=3e-7, atol=1e-9)
                divided = used.download(used.quotient(votes, evidence))
                np.testing.assert_allclose(divided, naive.quotient(*sums), rtol=1e-6)


@pytest.mark.parametrize("gradient", ["central", "sobel"])
def test_signs_agree_with_the_oracle(used: Engine, gradient: Any) -> None:
    rng = np.random.default_rng(2)
    for grid in GRIDS:
        present = fields.random_present(rng, grid)
        lf = fields.light_field(rng, grid, (8, 34), 1, "uint16", "coarse", present)
        found = used.signs(used.grey_views(lf, -0.8), -0.8, gradient=gradient)
        for one, expected in zip(found, naive.signs(lf.views, -0.8, present, gradient), strict=True):
            np.testing.assert_array_equal(used.download(one), expected)


def test_foreground_is_what_lies_above_zero(used: Engine) -> None:
    values = np.array([[-1, -1e-9, 0, 1e-9, 1]], np.float32)
    found = used.download(used.foreground(used.upload(values)))
    np.testing.assert_array_equal(found, [[False, False, False, True, True]])


def test_planes_beyond_what_views_were_prepared_for_are_refused(used: Engine) -> None:
    lf = fields.light_field(np.random.default_rng(3), (3, 3), (6, 8), 3)
    out, limits = (used.zeros((6, 8), np.float32) for _ in "12")
    for reach, plane in ((1.0, 1.1), (-1.0, -1.1), (0.0, 0.2), (2.0, 400.0)):
        grey, colour = used.grey_views(lf, reach), used.colour_views(lf, reach)
        with pytest.raises(
            LightFieldError, match=r"^disparity: found a plane at .* prepare them for a larger range"
        ):
            used.vote(grey, plane, out, out)
        with pytest.raises(LightFieldError, match=r"^disparity: found a plane at"):
            used.signs(grey, plane, gradient="central")
        with pytest.raises(LightFieldError, match=r"^disparity: found a plane at"):
            used.photo(colour, plane, limits, out)


@pytest.mark.parametrize("plane", [30.0, -75.0])
def test_planes_beyond_the_picture_are_counted_in_its_border(used: Engine, plane: float) -> None:
    """No memory is read that views do not have, however far a plane is."""
    lf = fields.light_field(np.random.default_rng(4), (3, 4), (7, 9), 3)
    out, other = (used.zeros((7, 9), np.float32) for _ in "12")
    used.vote(used.grey_views(lf, plane), plane, out, other)
    total, _, possible = naive.count(lf.views, plane)
    np.testing.assert_allclose(used.download(out), total / possible, rtol=1e-6)
    limits = np.full((7, 9), 0.1, np.float32)
    used.photo(used.colour_views(lf, plane), plane, used.upload(limits), out)
    np.testing.assert_array_equal(used.download(out), naive_photo.photo_consistency(lf.views, plane, limits))


# Smoothing


@pytest.mark.parametrize(("epsilon", "tolerance"), [(1e-2, 5e-7), (1e-4, 4e-6), (2e-6, 1.25e-4)])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("size", "radius"), [((9, 11), 1), ((12, 33), 2), ((33, 20), 3), ((40, 65), 4)])
def test_filters_agree_with_the_oracle(
    used: Engine, size: tuple[int, int], radius: int, channels: int, epsilon: float, tolerance: float
) -> None:
    """At fbs-vis's own ε, 2e-6, to a thirtieth of the 1/255 in which shares are kept, in single precision."""
    rng = np.random.default_rng([*size, channels])
    guide = fields.light_field(rng, (3, 3), size, channels, "float32").reference.copy()
    guide[: size[0] // 3, : size[1] // 3] = 0.5
    image = np.where(fields.random_mask(rng, size), 0.8, -0.7) + rng.normal(0, 0.3, size)
    image[size[0] // 2 :, size[1] // 2 :] = 0
    votes = np.clip(image, -1, 1).astype(np.float32)
    evidence = (np.abs(votes) * rng.uniform(1, 1.5, size)).astype(np.float32)
    prepared, out = used.guided_filter(guide, radius, epsilon), used.empty(size, np.float32)
    oracle = naive.GuidedFilter(guide, radius, epsilon)
    used.smooth(prepared, used.upload(votes), out)
    np.testing.assert_allclose(used.download(out), oracle(votes), rtol=0, atol=tolerance)
    used.smooth_quotient(prepared, used.upload(votes), used.upload(evidence), out)
    expected = naive.normalised(oracle, votes, evidence)
    bound = 2 * tolerance / np.maximum(oracle(evidence), 1e-3)
    assert (np.abs(used.download(out) - expected) <= bound).all()


# Streaming decoders


@pytest.mark.parametrize("planes", [2, 7, 30])
def test_streamed_sums_agree_with_the_oracle(used: Engine, planes: int) -> None:
    """In quarters, so that sums are exact and tie."""
    rng = np.random.default_rng(planes)
    volume = (rng.integers(-4, 5, (planes, 6, 35)) / 4).astype(np.float32)
    state = tuple(used.zeros((6, 35), np.float32) for _ in "12")
    at = used.upload(np.full((6, 35), -1, np.int32))
    total, lowest, before, after = *state, *(used.zeros((6, 35), np.float32) for _ in "12")
    count = used.zeros((6, 35), np.int32)
    for k, smoothed in enumerate(volume):
        used.sign_step(k, used.upload(smoothed), (total, lowest, at, before, after))
        used.accumulate(used.upload(smoothed), count)
    np.testing.assert_array_equal(used.download(count), (volume > 0).sum(axis=0))
    found = [used.download(each) for each in (total, lowest, at, before, after)]
    for p in np.ndindex(6, 35):
        profile = volume[:, *p]
        sums = naive.running_sums(profile)
        turn = int(np.argmin(sums))
        expected: list[float] = [sums[-1], sums[turn], turn - 1]
        if turn > 0:
            expected += [profile[turn - 1], *profile[turn : turn + 1]]
        np.testing.assert_array_equal([each[p] for each in found][: len(expected)], expected)


# Photo-consistency and visibility


def rough_map(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Two uneven surfaces with ragged edges, in sixty-fourths."""
    near = fields.random_mask(rng, size)
    disparity = np.where(near, 1.0, -1.0) + rng.uniform(-0.7, 0.7, size)
    return np.asarray(np.rint(disparity * 64) / 64, np.float32)


@pytest.mark.thin(5)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("grid", GRIDS)
def test_shares_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """Of all views that vote, and of those that see the plane; of views held but silent, nothing."""
    rng = np.random.default_rng([*grid, len(dtype)])
    for channels, size in ((1, (9, 33)), (3, (34, 12))):
        lf = fields.light_field(rng, grid, size, channels, dtype, "scene", fields.random_present(rng, grid))
        limits, disparity = rng.uniform(0.005, 0.3, size).astype(np.float32), rough_map(rng, size)
        voting = lf.available & fields.random_present(rng, grid)
        held = used.colour_views(lf, 1.2, lf.available)
        np.testing.assert_array_equal(held.present, lf.available)
        np.testing.assert_array_equal(held.offsets, lf.offsets)
        spare = None
        for views, present in ((held, lf.available), (used.voting(held, voting), voting)):
            surfaces = spare = used.nearest_surfaces(disparity, views, spare)
            out = used.empty(size, np.float32)
            for plane in (-0.9, 0.33, 1.2):
                used.photo(views, plane, used.upload(limits), out)
                expected = naive_photo.photo_consistency(lf.views, plane, limits, present)
                np.testing.assert_allclose(used.download(out), expected, rtol=2e-7)
                used.photo(views, plane, used.upload(limits), out, surfaces=surfaces)
                expected = naive_vis.visible_share(lf.views, plane, limits, disparity, present)
                np.testing.assert_allclose(used.download(out), expected, rtol=1e-6)
            disparity = disparity[::-1].copy()


def test_some_rows_are_counted_alone(used: Engine) -> None:
    lf = fields.light_field(np.random.default_rng(5), (3, 3), (40, 33), 3)
    limits, out = np.full((40, 33), 0.05, np.float32), used.upload(np.full((40, 33), -1, np.float32))
    used.photo(used.colour_views(lf, 1.0), -0.45, used.upload(limits), out, rows=(3, 38))
    expected = naive_photo.photo_consistency(lf.views, -0.45, limits)
    expected[:3] = expected[38:] = -1
    np.testing.assert_array_equal(used.download(out), expected)


def test_a_part_of_the_grid_is_a_light_field(used: Engine) -> None:
    lf = fields.light_field(np.random.default_rng(6), (5, 7), (9, 20), 3)
    part = used.subgrid(used.colour_views(lf, 0.8), slice(0, 5, 2), slice(1, 6))
    limits, out = np.full((9, 20), 0.06, np.float32), used.empty((9, 20), np.float32)
    cut = lf.views[::2, 1:6]
    used.photo(part, 0.4, used.upload(limits), out)  # rows stand two steps apart
    expected = naive_photo.photo_consistency(cut[:, :, :, :], 0.0, limits)
    assert part.present.shape == (3, 5)
    np.testing.assert_array_equal(part.offsets, lf.offsets[::2, 1:6])
    used.photo(part, 0.0, used.upload(limits), out)
    np.testing.assert_array_equal(used.download(out), expected)


@pytest.mark.thin(4)
@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("columns", [(0, 30), (4, 17), (29, 30)])
def test_high_passed_shares_agree_with_the_oracle(used: Engine, columns: tuple[int, int], dtype: str) -> None:
    """In a box: all rows that are looked at lie in it, columns beside it are there all the same."""
    rng = np.random.default_rng([*columns, len(dtype)])
    for kind, size in (("noise", (16, 30)), ("scene", (20, 30))):
        lf = fields.light_field(rng, (3, 5), size, 3, dtype, kind, fields.random_present(rng, (3, 5)))
        limits, disparity = rng.uniform(0.005, 0.3, size).astype(np.float32), rough_map(rng, size)
        views = used.colour_views(lf, 0.8)
        surfaces = used.nearest_surfaces(disparity, views)
        filtered = naive_gloss.high_passed(lf.views)
        shares = {
            plane: naive_vis.visible_share(filtered, plane, limits, disparity, lf.present)
            for plane in (-0.8, 0.0, 0.55)
        }
        for rows in ((0, size[0]), (3, 15)):
            box = slice(*rows), slice(*columns)
            inner = slice(rows[0] if rows[0] == 0 else rows[0] + 2, rows[1] if rows[0] == 0 else rows[1] - 2)
            part, near = used.high_passed(views, box), used.surfaces_in(surfaces, box)
            assert part.size == (rows[1] - rows[0], columns[1] - columns[0])
            out = used.empty(part.size, np.float32)
            for plane, expected in shares.items():
                used.photo(part, plane, used.upload(limits[box].copy()), out, surfaces=near)
                found = used.download(out)[inner.start - rows[0] : inner.stop - rows[0]]
                np.testing.assert_allclose(found, expected[inner, box[1]], rtol=1e-6)


def test_peaks_along_rows_agree_with_the_oracle(used: Engine) -> None:
    rng = np.random.default_rng(7)
    lf = fields.light_field(rng, (3, 4), (17, 29), 3)
    planes, rows, limits = (
        np.array([0.9, 0.3, -0.5]),
        np.array([0, 4, 16]),
        np.full((17, 29), 0.04, np.float32),
    )
    found = used.photo_peaks(used.colour_views(lf, 0.9), planes, used.upload(limits), rows)
    shares = [naive_photo.photo_consistency(lf.views, plane, limits)[rows] for plane in planes]
    expected = np.max([naive_gloss._mean(share, 0, naive_gloss.ALONG) for share in shares], axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


# The energy of signs and photo-consistency


@pytest.mark.parametrize("planes", [3, 17])
def test_sign_energies_agree_with_the_oracle(used: Engine, planes: int) -> None:
    rng = np.random.default_rng(planes)
    volume = rng.uniform(-1, 1, (planes, 5, 33)).astype(np.float32)
    running, lowest = used.zeros((5, 33), np.float32), used.zeros((5, 33), np.float32)
    signs = used.empty(volume.shape, np.float32)
    for k in range(planes):
        used.store_signs(used.upload(volume[k]), 0.06, running, lowest, signs[k])
    np.testing.assert_allclose(used.download(signs), naive_vis.sign_energy(volume, 0.06), atol=1e-6)
    sums = np.cumsum(volume.astype(np.float64), axis=0)
    np.testing.assert_allclose(used.download(running), 0.06 * sums[-1], atol=1e-6)
    np.testing.assert_allclose(used.download(lowest), 0.06 * np.minimum(sums.min(axis=0), 0), atol=1e-6)


def test_shares_are_kept_in_255ths(used: Engine) -> None:
    share = np.array([[-0.2, 0.0, 0.49 / 255, 0.51 / 255, 0.5, 254.6 / 255, 1.0, 1.3]], np.float32)
    kept = used.empty((2, *share.shape), np.uint8)
    used.store_shares(used.upload(share), kept[1])
    np.testing.assert_array_equal(used.download(kept[1]), [[0, 0, 0, 1, 128, 255, 255, 255]])


def test_shares_along_the_planes(used: Engine) -> None:
    shares = np.random.default_rng(8).integers(0, 256, (9, 5, 34)).astype(np.uint8)
    volume = used.upload(shares)
    for part, step in ((shares, 1), (shares[::2], 2)):
        np.testing.assert_array_equal(used.peak(volume[::step]), part.max(axis=0))
        expected = (part.max(axis=0) - part.mean(axis=0)) / 255
        np.testing.assert_allclose(used.contrast(volume[::step]), expected, atol=1e-6)


def test_pixels_are_replaced_in_all_planes(used: Engine) -> None:
    """In a volume and in a box of one, by a number and by other values; all others stay."""
    rng = np.random.default_rng(9)
    host, other = (rng.integers(0, 256, (4, 6, 7)).astype(np.uint8) for _ in "12")
    mask, expected = rng.random((6, 7)) < 0.4, host.copy()
    volume = used.upload(host.copy())
    used.put_where(volume, mask, used.upload(other))
    for k, y, x in np.ndindex(*host.shape):
        expected[k, y, x] = other[k, y, x] if mask[y, x] else host[k, y, x]
    np.testing.assert_array_equal(used.download(volume), expected)
    used.put_where(volume[:, 2:5, 1:4], mask[2:5, 1:4], 7)
    for k, y, x in np.ndindex(4, 3, 3):
        expected[k, y + 2, x + 1] = 7 if mask[y + 2, x + 1] else expected[k, y + 2, x + 1]
    np.testing.assert_array_equal(used.download(volume), expected)


def exact_energies(rng: np.random.Generator, size: tuple[int, int], planes: int) -> Array:
    """(K, H, W) in sixteenths, exact as whole energies; some pixels flat, some values beyond the cut."""
    values = rng.integers(0, 40, (planes, *size)) * rng.choice([0, 1], size, p=[0.2, 0.8])
    return np.asarray(values / 16 - 1, np.float32)


def sums_over_paths(used: Engine, signs: Array, guide: Array, **penalties: float) -> Any:
    """Without photo-consistency; the engine's."""
    none = used.upload(np.zeros(signs.shape, np.uint8))
    return used.paths(used.upload(signs), none, np.zeros(signs.shape[1:], np.float32), guide, **penalties)


NO_PENALTY = {"slope": 0.0, "jump": 0.0, "sharpness": 1.0, "noise": 0.0}


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("weight", [0.0, 0.7, 3.0])
def test_joint_energies_agree_with_the_oracle(used: Engine, weight: float, stride: int) -> None:
    """Without penalties each of four paths sums a pixel's own. Rounding may fall to either side."""
    rng = np.random.default_rng(3)
    signs = np.cumsum(rng.uniform(-0.4, 0.4, (13, 6, 35)), axis=0).astype(np.float32)
    shares = rng.integers(0, 256, (13, 6, 35)).astype(np.uint8)
    weights = (weight * rng.random((6, 35))).astype(np.float32)
    kept = used.upload(signs)[::stride], used.upload(shares)[::stride]
    found = used.download(used.paths(*kept, weights, np.zeros((6, 35, 3), np.float32), **NO_PENALTY))
    joint = naive_vis.joint_energy(signs[::stride].astype(np.float64), shares[::stride] / 255, weights)
    assert np.abs(found - 4 * naive_vis.whole(joint)).max() <= 4
    assert found.min(axis=-1).max() == 0


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("slope", "jump"), [(0.1255, 0.6505), (0.2415, 2.0), (0.4505, 0.15)])
def test_paths_agree_with_the_oracle(
    used: Engine, size: tuple[int, int], slope: float, jump: float, channels: int
) -> None:
    """Whole numbers: no cost may differ."""
    rng = np.random.default_rng([*size, channels])
    signs = exact_energies(rng, size, 4 + size[0] % 3)
    guide = (rng.choice([0, 0, 0, 1, 2, 8], (*size, channels)) / 64).astype(np.float32)
    energy = naive_vis.whole(naive_vis.joint_energy(signs, np.zeros_like(signs), np.zeros(size)))
    for sharpness, noise in ((0.0, 0.0), (40.0, 0.0), (2.1, 1 / 64), (7.3, 5 / 128)):
        found = sums_over_paths(used, signs, guide, slope=slope, jump=jump, sharpness=sharpness, noise=noise)
        expected = naive_vis.four_paths(energy, guide, SCALE * slope, SCALE * jump, sharpness, noise)
        np.testing.assert_array_equal(used.download(found), expected)


def test_four_paths_of_the_dearest_energies_do_not_overflow(used: Engine) -> None:
    """Every path pays the largest jump, and then the dearest energy; all others are free elsewhere."""
    signs = np.full((5, 9, 9), 2, np.float32)
    signs[0] = 0
    signs[:, 4, 4] = [2, 2, 2, 2, 0]
    total = sums_over_paths(
        used, signs, np.zeros((9, 9, 1), np.float32), slope=2, jump=2, sharpness=0, noise=0
    )
    assert used.download(total).max() == 4 * 2 * 2 * SCALE


@pytest.mark.parametrize("planes", [3, 4, 30])
def test_minima_agree_with_the_oracle(used: Engine, planes: int) -> None:
    rng = np.random.default_rng(planes)
    signs = exact_energies(rng, (6, 35), planes)
    signs[:, 0] = rng.integers(0, 3, (planes, 35)) / 16  # ties: the first minimum counts
    total = sums_over_paths(used, signs, np.zeros((6, 35, 1), np.float32), **NO_PENALTY)
    np.testing.assert_allclose(used.least(total), naive_vis.parabola(used.download(total)), atol=1e-5)


@pytest.mark.parametrize("largest", [1, 2, 5])
@pytest.mark.parametrize("size", [(9, 11), (1, 14), (13, 1), (1, 1), (20, 33)])
def test_islands_agree_with_the_oracle(used: Engine, size: tuple[int, int], largest: int) -> None:
    """Ends of the range in single pixels, lines and patches, and slopes that lead up to them."""
    rng, planes = np.random.default_rng([*size, largest]), 12
    for ends in (0.1, 0.3, 0.7):
        position = rng.uniform(0, planes - 1, size)
        position = np.where(rng.random(size) < ends, rng.choice([0, planes - 1], size), position)
        found = position.astype(np.float32)
        expected = naive_vis.fill_islands(found, planes, largest)
        used.fill_islands(found, planes, largest)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("step", [0.03, 0.07, 0.3])
@pytest.mark.parametrize(
    ("size", "radius"), [((9, 14), 8), ((17, 33), 4), ((1, 31), 6), ((32, 1), 2), ((3, 2), 8)]
)
def test_fitted_planes_agree_with_the_oracle(
    used: Engine, size: tuple[int, int], radius: int, step: float, channels: int
) -> None:
    """Two surfaces, ends of the range, energies with and without a minimum; by way of the block's rule."""
    rng, planes = np.random.default_rng([*size, radius, channels]), 14
    near = fields.random_mask(rng, size)
    drawn = np.where(near, 9, 3) + rng.normal(0, 0.7, size)
    position: Array = np.where(rng.random(size) < 0.1, rng.choice([0, planes - 1], size), drawn)
    position = position.astype(np.float32)
    minimum = position + rng.normal(0, 0.5, size)
    signs = rng.uniform(-0.02, 0.1, size) * (np.arange(planes)[:, None, None] - minimum) ** 2
    signs = (signs + rng.normal(0, 0.03, signs.shape)).astype(np.float32)
    shares = rng.integers(0, 256, signs.shape).astype(np.uint8)
    weight = (rng.uniform(0, 0.3, size) * (rng.random(size) < 0.7)).astype(np.float32)
    guide = (0.3 * near[..., None] + rng.uniform(0, 0.1, (*size, channels))).astype(np.float32)
    energy = used.upload(signs), used.upload(shares), weight
    found = fit_surfaces(position, energy, guide, step, radius, engine=used)  # calls used.fit_planes(...)
    joint = np.moveaxis(signs.astype(np.float64) - weight * (shares / 255), 0, -1)
    expected = naive_vis.fit_surfaces(position, joint, guide, step, radius)
    np.testing.assert_allclose(found, expected, atol=1e-3)


# Depth edges, noise and the median


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("grid", GRIDS)
def test_decisions_at_edges_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """By way of the block's rule; used.decide_edges(...) and used.surfaces_of(...) are what it calls."""
    rng = np.random.default_rng([*grid, len(dtype)])
    pixels = wrong = changed = 0
    for rule, channels in ((EdgeRule(), 3), (EdgeRule(jump=0.02, spread=0.1, inertia=0.5), 1)):
        size = (int(rng.integers(9, 16)), int(rng.choice([11, 24, 33])))
        lf = fields.light_field(rng, grid, size, channels, dtype, "scene", fields.random_present(rng, grid))
        disparity = rough_map(rng, size)
        edges = DepthEdges(lf, rule, engine=used)
        found = edges.move(disparity)
        expected = naive_vis.move_edges(disparity, lf.views, rule, lf.present)
        np.testing.assert_array_equal(edges.found, naive_vis.edge_pixels(disparity, rule))
        pixels, wrong = pixels + found.size, wrong + int(np.sum(found != expected))
        changed += int(np.sum(found != disparity))
    assert wrong <= 0.002 * pixels
    assert changed > 0 or grid != (4, 5)


@pytest.mark.parametrize(("grid", "dtype"), [((5, 5), "uint8"), ((3, 4), "float32")])
def test_colours_at_edges_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """Counts may differ by one where a splat or a threshold is a matter of the last digit."""
    rng = np.random.default_rng([*grid, 3])
    lf = fields.light_field(rng, grid, (14, 24), 3, dtype, "scene", fields.random_present(rng, grid))
    disparity = rough_map(rng, (14, 24))
    expected = naive_edge_net.edge_colours(disparity, lf.views, lf.present)
    places = np.array(list(expected))
    sides = np.array([naive_vis.surfaces(disparity, y, x) for y, x in places], np.float32)
    views = used.views(lf)
    limits = (255 * naive_vis.thresholds(lf.views)).astype(np.float32)
    shown = used.edge_colours(views, disparity, places, sides, used.surfaces_of(disparity, views), limits)
    seen = list(expected.values())
    same = np.all(shown.counts == np.array([each.counts for each in seen]), axis=1)
    assert np.mean(same) > 0.97
    np.testing.assert_allclose(shown.front, [each.front for each in seen], atol=2e-3)
    np.testing.assert_allclose(shown.back[same], np.array([each.back for each in seen])[same], atol=2e-3)
    spreads = np.array(
        [(-1 if each.front_variance is None else each.front_variance, each.back_variance) for each in seen]
    )
    np.testing.assert_allclose(shown.spreads[same], spreads[same], rtol=2e-3, atol=0.05)


def test_residuals_agree_with_the_oracle(used: Engine) -> None:
    rng = np.random.default_rng(10)
    planes = np.arange(1.2, -1.1, -0.26)
    for dtype, channels in (("uint8", 3), ("uint16", 1), ("float32", 3)):
        lf = fields.light_field(
            rng, (5, 4), (12, 15), channels, dtype, "noise", fields.random_present(rng, (5, 4))
        )
        places = [(0, 0), (11, 14), (5, 7), (0, 14), (6, 3)]
        rows, columns = np.array(places).T
        least = used.residuals(used.views(lf), rows, columns, planes)
        expected = naive_vis.residuals(lf.views, planes, places, lf.present)
        np.testing.assert_allclose(least / lf.full_scale, expected, rtol=1e-5)


def test_pixels_that_no_view_shows_have_no_residual(used: Engine) -> None:
    lf = fields.light_field(np.random.default_rng(11), (3, 3), (6, 7), 1)
    found = used.residuals(used.views(lf), np.array([2]), np.array([3]), np.array([40.0]))
    assert np.isinf(found).all()


@pytest.mark.parametrize("dtype", fields.DTYPES)
def test_window_means_agree_with_the_oracle(used: Engine, dtype: str) -> None:
    rng = np.random.default_rng([16, len(dtype)])
    present = fields.random_present(rng, (4, 5))
    lf = fields.light_field(rng, (4, 5), (14, 17), 3, dtype, "noise", present)
    lf.views[0, 0, 5, 6], lf.views[2, 2, 9, 3, 1] = 0, lf.full_scale
    points, disparity = rng.integers(0, 14, (40, 2)), rng.uniform(-2, 2, 40)
    means, usable = used.window_means(used.views(lf), points, disparity, 2)
    expected = naive_pictures.window_means(lf.views, present, points, disparity, 2, lf.full_scale)
    np.testing.assert_array_equal(usable, expected[1])
    np.testing.assert_allclose(means[usable], expected[0][usable], rtol=1e-6)
    assert 0 < usable.mean() < 1


@pytest.mark.parametrize("radius", [1, 3])
@pytest.mark.parametrize("weighed", [False, True])
def test_medians_agree_with_the_oracle(used: Engine, radius: int, weighed: bool) -> None:
    """But where rounding a weight to 2⁻²⁰ may decide. used.median(...) is what the block calls."""
    rng = np.random.default_rng([radius, weighed])
    for size, colour, space in (((12, 15), 0.05, 2.0), ((3, 30), 0.3, 1.0), ((15, 2), 0.02, 5.0)):
        values = (rng.integers(-6, 7, size) / 4 + rng.integers(0, 2, size) * rng.normal(size=size)).astype(
            np.float32
        )
        guide = np.clip(rng.random((3, 3))[rng.integers(0, 3, size)] + rng.normal(0, 0.03, (*size, 3)), 0, 1)
        weight = rng.random(size).astype(np.float32) if weighed else None
        options: dict[str, Any] = {"radius": radius, "sigma_colour": colour, "sigma_space": space}
        found = weighted_median(values, guide.astype(np.float32), weight=weight, engine=used, **options)
        low, high = naive_photo.weighted_median(
            values, guide.astype(np.float32), radius, colour, space, weight, 1e-4
        )
        assert ((found >= low) & (found <= high)).all()
        assert np.mean(low == high) > 0.97


# Costs of planes


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("grid", GRIDS)
def test_truncated_differences_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """Of the views, and of the reference view moved in their stead."""
    rng = np.random.default_rng([*grid, len(dtype)])
    for channels, size in ((1, (9, 33)), (3, (34, 12))):
        lf = fields.light_field(rng, grid, size, channels, dtype, "scene", fields.random_present(rng, grid))
        limits = rng.uniform(0.005, 0.5, size).astype(np.float32)
        limits[0, 0] = 2
        views, out = used.colour_views(lf, 1.2), used.empty(size, np.float32)
        for plane in (-0.9, 0.33, 1.2):
            for itself in (False, True):
                used.differences(views, plane, used.upload(limits), out, beyond=0.75, itself=itself)
                expected = naive_costs.differences(lf.views, plane, limits, 0.75, lf.available, itself)
                np.testing.assert_allclose(used.download(out), expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("sigma", [0.7, 10.0, 20.0])
def test_entropies_agree_with_the_oracle(used: Engine, dtype: str, sigma: float) -> None:
    rng = np.random.default_rng([int(sigma), len(dtype)])
    for channels, kind in ((3, "scene"), (1, "noise")):
        lf = fields.light_field(
            rng, (5, 4), (7, 33), channels, dtype, kind, fields.random_present(rng, (5, 4))
        )
        views, out = used.colour_views(lf, 1.2), used.empty((7, 33), np.float32)
        for plane in (-0.9, 1.2):
            used.angular_entropy(views, plane, sigma, out)
            expected = naive_costs.entropy(lf.views, plane, sigma, lf.available)
            np.testing.assert_allclose(used.download(out), expected, atol=1e-4)


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_focal_stacks_agree_with_the_oracle(used: Engine, dtype: str, channels: int) -> None:
    """Levels of stacks may be rounded to 1/128 of an 8-bit level; rows of a band are written, no others."""
    rng = np.random.default_rng([channels, len(dtype)])
    present = np.ones((5, 5), np.bool_)
    present[2, 0] = present[3, 2] = False
    lf = fields.light_field(rng, (5, 5), (9, 70), channels, dtype, "scene", present)
    v, u = np.mgrid[-2:3, -2:3]
    stacks = np.array([(v == 0) & (u < 0), (v == 0) & (u > 0), (u == 0) & (v < 0), (u == 0) & (v > 0)])
    planes, views = np.linspace(1.2, -0.6, 9), used.colour_views(lf, 1.2)
    for pairs, stride in (([(0, 1), (2, 3)], 1), ([(3, 3)], 2)):
        out = used.upload(np.full((5, 9, 70), -1, np.float32))
        place = (views, planes, stacks, np.array(pairs), 2, 0.05, out)
        used.focal_symmetry(*place, rows=(1, 8), stride=stride)
        expected = naive_costs.focal_symmetry(lf.views, planes, stacks, pairs, 2, 0.05, present, stride)
        expected[:, [0, 8]] = -1
        np.testing.assert_allclose(used.download(out), expected, atol=1e-3)


# Cost volumes


@pytest.mark.parametrize("labels", [2, 3, 17])
def test_least_costs_agree_with_the_oracle(used: Engine, labels: int) -> None:
    """In quarters, so that costs tie and stretches of labels are level."""
    volume = (np.random.default_rng(labels).integers(-4, 5, (labels, 6, 35)) / 4).astype(np.float32)
    volume[:, 0, 0] = 0.5
    index, beside = used.minima(used.upload(volume))
    for y, x in np.ndindex(6, 35):
        costs = volume[:, y, x].tolist()
        least = costs.index(min(costs))
        around = costs[least], costs[max(least - 1, 0)], costs[min(least + 1, labels - 1)]
        assert index[y, x] == least
        assert beside[:, y, x].tolist() == [*around, naive_labels.runner_up(costs)]


@pytest.mark.parametrize("size", [(5, 9), (7, 4), (1, 6), (6, 1)])
@pytest.mark.parametrize("table", [[0.0], [0, 0.25], [0, 0.5, 0.75], [0, 0.125, 0.25, 0.5, 0.5, 2]])
@pytest.mark.parametrize("sides", [4, 8])
def test_paths_of_any_penalty_agree_with_the_oracle(
    used: Engine, size: tuple[int, int], table: list[float], sides: int
) -> None:
    """In parts of two, so that sums are exact and none may differ; few labels for a long table among them."""
    for labels in (2, 4, 11):
        rng = np.random.default_rng([*size, labels, sides])
        host = (rng.integers(0, 16, (labels, *size)) / 4).astype(np.float32)
        weights = rng.choice([0, 0.5, 1, 2], (sides // 2, *size)).astype(np.float32)
        penalties = np.array(table, np.float32)
        volume = used.upload(host.copy())
        used.line_paths(volume, weights, penalties)
        expected = naive_labels.path_sums(host, weights, penalties)
        np.testing.assert_array_equal(used.download(volume), expected)


@pytest.mark.parametrize("radius", [1, 3])
@pytest.mark.parametrize("size", [(9, 12), (2, 7), (8, 1)])
def test_bilateral_means_agree_with_the_oracle(used: Engine, size: tuple[int, int], radius: int) -> None:
    rng = np.random.default_rng([*size, radius])
    guide, volume = rng.random((*size, 3)).astype(np.float32), rng.random((2, *size)).astype(np.float32)
    rules: list[Any] = [(0.1, 3.0, "euclidean", "square"), (0.5, None, "sum", "disc")]
    for colour, space, distance, window in rules:
        weights = bilateral_weights(
            guide, radius, sigma_colour=colour, sigma_space=space, colours=distance, window=window
        )
        out = used.empty(volume.shape, np.float32)
        used.local_means(used.upload(volume), *weights, out)
        for found, image in zip(used.download(out), volume, strict=True):
            expected = naive_labels.bilateral(image, guide, radius, colour, space, distance, window)
            np.testing.assert_allclose(found, expected, atol=2e-6)


# Two sides of a line, and two groups of views


@pytest.mark.parametrize("walk", [(0, 1), (1, 0), (1, -1)])
@pytest.mark.parametrize(("bins", "channels"), [(64, 3), (3, 1)])
def test_histograms_agree_with_the_oracle(
    used: Engine, walk: tuple[int, int], bins: int, channels: int
) -> None:
    rng = np.random.default_rng([bins, channels])
    pictures = rng.integers(0, bins, (3, channels, 5, 7)).astype(np.uint8)
    pictures[:, :, 3:] = 1
    corners = rng.integers(-6, 3, (3, 2))
    weights, out = rng.normal(size=(3, 4, 5)).astype(np.float32), used.empty((5, 5, 7), np.float32)
    used.histogram_distances(used.upload(pictures), bins, walk, corners, weights, out)
    expected = naive_sides.histogram_distances(pictures, bins, np.array(walk), corners, weights)
    np.testing.assert_allclose(used.download(out), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("grid", GRIDS)
def test_groups_of_views_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """Groups of no view and of one among them, and views that are absent."""
    rng = np.random.default_rng([*grid, len(dtype)])
    size, present = (11, 33), fields.random_present(rng, grid)
    lf = fields.light_field(rng, grid, size, 3, dtype, "scene", present)
    groups = (rng.random((2, present.size, *size)) > 0.4).astype(np.uint8)
    groups[0, :, 0], groups[1, 1:, 1] = 0, 0
    views = used.colour_views(lf, 1.2)
    means, variances = used.empty((2, 3, *size), np.float32), used.empty((2, *size), np.float32)
    used.view_groups(views, -0.77, used.upload(groups), means, variances)
    white = 255 * naive_photo.UNIT
    levels = np.zeros((present.size, *size, 3))
    for (v, u), image in naive_costs.moved(lf.views, -0.77, present):
        levels[(v + grid[0] // 2) * grid[1] + u + grid[1] // 2] = image / white
    own = naive_photo.levels(lf.views)[lf.centre] / white
    there = groups * present.reshape(-1, 1, 1)
    expected = naive_sides.groups_shown(levels, there, own)
    np.testing.assert_allclose(used.download(means), expected[0], atol=1e-6)
    np.testing.assert_allclose(used.download(variances), expected[1], atol=1e-6)


@pytest.mark.parametrize("clusters", [2, 3])
def test_regions_of_patches_agree_with_the_oracle(used: Engine, clusters: int) -> None:
    """Of three colours and a little noise; in 1/256, so that sums are exact."""
    rng = np.random.default_rng(clusters)
    base = rng.choice([0.1, 0.5, 0.9], (3, 4, 3)).repeat(3, 0).repeat(3, 1) + rng.normal(0, 0.02, (9, 12, 3))
    picture = (np.rint(base * 256) / 256).astype(np.float32)
    points = np.argwhere(rng.random((9, 12)) > 0.5)
    for alike in (0.05, 0.7):
        rule = {"radius": 2, "clusters": clusters, "alike": alike, "rounds": 10}
        found = used.patch_regions(picture, points, **rule)  # type: ignore[arg-type]
        for point, one in zip(points, found, strict=True):
            expected = naive_sides.region(picture, tuple(point), 2, clusters, alike, 10)
            np.testing.assert_array_equal(one, expected)


# Maps of several views


def maps_of_views(rng: np.random.Generator, grid: tuple[int, int], size: tuple[int, int]) -> Array:
    """(V, U, H, W) maps of all views, as a rough map of the reference view lands in them; NaN: unknown."""
    disparity, lf_offsets = rough_map(rng, size), grid_offsets(grid)
    maps = np.full((*grid, *size), np.nan, np.float32)
    for index in np.ndindex(*grid):
        seen = naive_pictures.seen(disparity, tuple(lf_offsets[index]), 0.0)
        maps[index] = np.where(np.isfinite(seen), seen, np.nan)
    return maps


@pytest.mark.parametrize("offset", [(0.0, 0.0), (2.0, -3.0), (-0.7, 1.4)])
def test_carried_maps_agree_with_the_oracle(used: Engine, offset: tuple[float, float]) -> None:
    rng = np.random.default_rng(20)
    ramp = np.add.outer(0.05 * np.arange(11), -0.08 * np.arange(14))
    for disparity in (rough_map(rng, (11, 14)), ramp.astype(np.float32)):
        beside = rng.random(disparity.shape).astype(np.float32)
        seen = naive_pictures.seen(disparity, offset, 0.0).astype(np.float32)
        found, found_beside = used.carry(disparity, beside, offset)
        expected, expected_beside = naive_views.carry(disparity, beside, seen, offset)
        np.testing.assert_allclose(found, expected, atol=1e-5)
        assert np.mean(found_beside != expected_beside.astype(np.float32)) < 0.02  # halves, rounded


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("at", [(0, 0), (1, 2), (2, 4)])
def test_support_agrees_with_the_oracle(used: Engine, at: tuple[int, int], dtype: str) -> None:
    """From another view, with what all maps hide."""
    rng = np.random.default_rng([21, *at, len(dtype)])
    grid, size = (3, 5), (12, 17)
    lf = fields.light_field(rng, grid, size, 3, dtype)
    maps = maps_of_views(rng, grid, size)
    views = used.views(lf)
    surfaces = used.known_surfaces(surface_levels(maps), views)
    places = np.argwhere(rng.random(size) < 0.3)
    candidates = rng.uniform(-1.5, 1.5, (len(places), 3)).astype(np.float32)
    candidates[::4, 1] = np.nan
    thresholds = rng.uniform(2, 20, size).astype(np.float32)
    found = used.support(used.from_view(views, at), surfaces, places, candidates, thresholds, margin=0.2)
    levels = lf.views.astype(np.float64) * (255 / lf.full_scale)
    expected = naive_views.support(levels, at, lf.offsets, maps, places, candidates, thresholds, 0.2)
    # A place on a pixel's border may fall to either side in single precision.
    assert np.mean(np.abs(found - expected) > 1e-3) < 0.01
    assert ((found > 0) & (found < 1)).mean() > 0.5


def test_agreement_agrees_with_the_oracle(used: Engine) -> None:
    rng = np.random.default_rng(22)
    grid, size = (3, 3), (12, 15)
    maps = np.nan_to_num(maps_of_views(rng, grid, size), nan=-1.0).reshape(9, *size)
    maps[4, 3:6, 4:8] += np.float32(0.8)  # what nobody else shows
    partners = np.array([0, 2, 3, 5, 7])
    steps = grid_offsets(grid).reshape(-1, 2)[partners]
    found = used.agree(maps, 4, partners, steps, tolerance=0.1)
    expected = naive_views.agree(maps, 4, partners, steps, 0.1)
    for one, other in zip(found, expected, strict=True):
        assert np.mean(one != other.astype(one.dtype)) < 0.02
    assert (found[0] != maps[4])[3:6, 4:8].mean() > 0.5


# Pictures from many views


@pytest.mark.parametrize("offset", [(0.0, 0.0), (2.0, -3.0), (-0.7, 1.4)])
@pytest.mark.parametrize("plane", [0.0, 0.5])
def test_what_a_view_shows_agrees_with_the_oracle(
    used: Engine, offset: tuple[float, float], plane: float
) -> None:
    disparity = rough_map(np.random.default_rng(12), (11, 14))
    found = used.seen(disparity, offset, plane=plane)
    np.testing.assert_array_equal(found, naive_pictures.seen(disparity, offset, plane))


@pytest.mark.parametrize("offset", [(2.0, -3.0), (-0.7, 1.4)])
@pytest.mark.parametrize("width", [64, 75])
def test_what_a_view_shows_of_wide_surfaces_agrees_with_the_oracle(
    used: Engine, offset: tuple[float, float], width: int
) -> None:
    """Side by side for long, with breaks and gaps between; in whatever order the map lies in memory."""
    x = np.arange(width, dtype=np.float32)
    disparity = np.tile(0.004 * x + np.where(x % 29 > 20, 1.3, 0), (6, 1)).astype(np.float32)
    disparity[4:, 30:] -= 0.8
    expected = naive_pictures.seen(disparity, offset, 0.0)
    np.testing.assert_array_equal(used.seen(disparity, offset), expected)
    np.testing.assert_array_equal(used.seen(np.asfortranarray(disparity), offset), expected)
    np.testing.assert_array_equal(used.seen(np.repeat(disparity, 2, 1)[:, ::2], offset), expected)


@pytest.mark.parametrize("dtype", fields.DTYPES)
@pytest.mark.parametrize("offset", [(0.0, 0.0), (2.0, -3.0), (-0.7, 1.4)])
def test_gathered_views_agree_with_the_oracle(used: Engine, offset: tuple[float, float], dtype: str) -> None:
    rng = np.random.default_rng([13, len(dtype)])
    lf = fields.light_field(rng, (3, 3), (11, 14), 3, dtype)
    disparity = rough_map(rng, (11, 14))
    front = naive_pictures.seen(disparity, offset, 0.0).astype(np.float32)
    limit = disparity + np.float32(0.4)
    total, count = np.ones((11, 14, 3), np.float32), np.ones((11, 14), np.float32)
    used.gather(lf.views[0, 1], offset, disparity, total, count, front=front, limit=limit)
    expected, shown = naive_pictures.gathered(lf.views[0, 1], offset, disparity, front, limit)
    np.testing.assert_allclose(total, 1 + expected, rtol=1e-5)
    np.testing.assert_array_equal(count, 1 + shown)
    assert shown.any()


# Refinement between planes

REFINEMENT = RefineRule(radius=4, wide_radius=6, wide_spacing=3, high_pass=0.8)


@pytest.mark.parametrize(("grid", "dtype"), [((3, 3), "uint8"), ((3, 4), "float32"), ((1, 9), "uint16")])
def test_refinements_agree_with_the_oracle(used: Engine, grid: tuple[int, int], dtype: str) -> None:
    """By way of the block, which calls used.spline_views(...), used.ask_views(...), used.fit_steps(...)
    and used.even_lattices(...). A view that rounding hides or shows moves a pixel and what is around it.
    """
    lf = fields.scene(3, grid, (15, 19), 3, dtype)
    y, x = np.mgrid[:15, :19]
    inside = (abs(x - 0.45 * 19) < 0.2 * 19) & (abs(y - 7.5) < 3.75)
    disparity: Array = np.where(inside, 0.8, -0.6) + np.random.default_rng(14).normal(0, 0.02, (15, 19))
    disparity = disparity.astype(np.float32)
    found = gather_evidence(lf, disparity, REFINEMENT, used)
    step, weight, trusted = naive_refine.evidence(lf.views, disparity, REFINEMENT)
    alike = abs(found.weight - weight) <= 0.01 * weight + 0.01
    assert alike.mean() > 0.97
    np.testing.assert_allclose(found.step[alike], step[alike], atol=1e-3)
    np.testing.assert_allclose(found.trusted[alike], trusted[alike], rtol=0.02, atol=0.02)
    refined = refine_disparity(lf, disparity, REFINEMENT, engine=used)
    expected = naive_refine.refined(lf.views, disparity, REFINEMENT)
    assert np.mean(abs(refined - expected) > 5e-4) < 0.03


@pytest.mark.parametrize("deviation", [0.7, 1.5, 2.0])
def test_gaussian_means_agree_with_the_oracle(used: Engine, deviation: float) -> None:
    image = np.random.default_rng(15).normal(size=(9, 31)).astype(np.float32)
    expected = naive_refine.blurred(image.astype(np.float64), deviation)
    np.testing.assert_allclose(used.blur(image, deviation), expected, atol=1e-6)


# Whole methods


@cache
def scene(name: str) -> LightField:
    if name == "gloss":
        return scenes.render("gloss", size=64, views=5)
    if name == "odd":
        return fields.scene(2, (3, 4), (13, 37), absent=True)
    return fields.scene(1, (5, 5), (64, 64))


@cache
def found(name: str, engine: str, of: str, **options: Any) -> Result:
    return estimate(scene(of), name, engine=engine, **options)


OTHERS = [name for name in engines.NAMES if name != "cpu"]


def shares_apart(engine: str, name: str, of: str, **options: Any) -> tuple[float, float]:
    """Share of pixels whose disparity, and whose confidence, is more than 1e-3 from the cpu engine's."""
    own, expected = (found(name, each, of, **options) for each in (engine, "cpu"))
    pairs = (own.disparity, expected.disparity), (own.confidence, expected.confidence)
    disparity, confidence = (float(np.mean(np.abs(a - b) > 1e-3)) for a, b in pairs)
    return disparity, confidence


@pytest.mark.thin(4)
@pytest.mark.parametrize("of", ["gloss", "layers", "odd"])
@pytest.mark.parametrize("name", ["fbs", "fbs-sfa", "fbsocc-sfa", "fbs-vis", "fbs-vis without gloss"])
@pytest.mark.parametrize("engine", OTHERS)
def test_methods_give_one_map_on_all_engines(engine: str, name: str, of: str) -> None:
    method, _, without = name.partition(" ")
    options: dict[str, Any] = {"step": 0.1, "epsilon": 1e-4}
    if without:
        options["gloss"] = False
    assert max(shares_apart(engine, method, of, **options)) <= 0.001


@pytest.mark.thin(2)
@pytest.mark.parametrize("of", ["gloss", "layers"])
@pytest.mark.parametrize("engine", OTHERS)
def test_the_default_method_gives_about_one_map(engine: str, of: str) -> None:
    """At its own ε of 2e-6 the cpu engine's filter, in single precision, is off by up to 1e-4.

    A share near the middle between two 255ths is then kept as the other one, which moves a few pixels in a
    thousand by some thousandths of a px; at ε = 1e-4 (above) hardly any.
    """
    assert max(shares_apart(engine, "fbs-vis", of)) <= 0.0025
    own, expected = (found("fbs-vis", each, of).disparity for each in (engine, "cpu"))
    assert np.quantile(np.abs(own - expected), 0.999) < 0.005


def test_gloss_is_found_in_the_glossy_scene() -> None:
    """Or nothing would have been said of it above."""
    rule: dict[str, Any] = {"step": 0.1, "epsilon": 1e-4}
    with_it, without = (
        found("fbs-vis", "cpu", "gloss", **rule),
        found("fbs-vis", "cpu", "gloss", gloss=False, **rule),
    )
    assert np.mean(np.abs(with_it.disparity - without.disparity) > 0.1) > 0.05
