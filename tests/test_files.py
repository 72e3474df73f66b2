"""Files as people have them: made by other libraries, or laid out by hand, and read back exactly."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import h5py  # type: ignore[import-untyped]
import imagecodecs
import numpy as np
import OpenEXR  # type: ignore[import-not-found]
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image
from scipy.io import savemat

import lfdepth
from fields import quantise, two_planes
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.io import read, read_truth
from lfdepth.lightfield import LightField

Views = NDArray[Any]


def random_views(*shape: int, dtype: str = "uint8", seed: int = 0, most: int | None = None) -> Views:
    largest = int(np.iinfo(dtype).max) if most is None else most
    return np.random.default_rng(seed).integers(0, largest, shape, dtype=dtype, endpoint=True)


VIEWS = random_views(5, 5, 12, 14, 3)
GREY = random_views(3, 5, 12, 16)


def save(path: Path, pixels: Views) -> None:
    path.parent.mkdir(exist_ok=True, parents=True)
    Image.fromarray(pixels).save(path)


def save_all(folder: Path, name: str, views: Views = VIEWS) -> None:
    """A picture for each view; `name` has the fields v, u and n (the running number)."""
    for n, (v, u) in enumerate(np.ndindex(*views.shape[:2])):
        save(folder / name.format(v=v, u=u, n=n), views[v, u])


# White level


@pytest.mark.parametrize(("bits", "white"), [(8, 255), (10, 1023), (12, 4095), (14, 16383)])
def test_white_of_fewer_bits_than_the_type_has(tmp_path: Path, bits: int, white: int) -> None:
    views = random_views(3, 3, 12, 14, 3, dtype="uint16", most=white)
    np.save(tmp_path / "lf.npy", views)
    lf = read(tmp_path / "lf.npy")
    assert lf.white_level == white
    np.testing.assert_array_equal(lf.views, np.rint(views * (65535 / white)))
    # Whole numbers stay different from each other: what was stored can be had back exactly.
    np.testing.assert_array_equal(np.rint(lf.views * (white / 65535)), views)
    assert any(f"white level {white}" in remark for remark in lf.remarks)


def test_white_of_all_bits_is_left_alone(tmp_path: Path) -> None:
    views = random_views(3, 3, 12, 14, dtype="uint16", most=20000)
    views[0, 0, 0, 0] = 20000  # 15 bits: no camera has them, and 16 hold them
    np.save(tmp_path / "lf.npy", views)
    lf = read(tmp_path / "lf.npy")
    assert (lf.white_level, lf.remarks) == (None, ())
    np.testing.assert_array_equal(lf.views[..., 0], views)


def test_white_is_that_of_all_views_and_whole_ones(tmp_path: Path) -> None:
    views = random_views(3, 3, 12, 14, dtype="uint16", most=900)
    views[0, 2, 11, 13] = 4000  # outside the crop, in the corner of a corner view
    for v, u in np.ndindex(3, 3):
        tifffile.imwrite(tmp_path / f"v{v}_u{u}.tif", views[v, u])
    lf = read(tmp_path, crop=(0, 0, 8, 8))
    assert lf.white_level == 4095
    np.testing.assert_array_equal(lf.views[..., 0], np.rint(views[..., :8, :8] * (65535 / 4095)))


def test_white_level_by_hand_overrules(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    views = random_views(3, 3, 12, 14, dtype="uint16", most=1000)
    np.save(tmp_path / "lf.npy", views)
    for level in (900, 3000):
        expected = np.rint(np.minimum(views / level, 1) * 65535)
        np.testing.assert_array_equal(read(tmp_path / "lf.npy", white_level=level).views[..., 0], expected)
    np.testing.assert_array_equal(read(tmp_path / "lf.npy", white_level=65535).views[..., 0], views)
    assert main(["info", str(tmp_path / "lf.npy"), "--no-check", "--white-level", "3000", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["white_level"] == 3000
    for impossible in (0, -1, float("nan"), 65536):
        with pytest.raises(LightFieldError, match="white level"):
            read(tmp_path / "lf.npy", white_level=impossible)


@pytest.mark.parametrize("white", [4095, 1023])
def test_maps_do_not_depend_on_the_bits(tmp_path: Path, white: int) -> None:
    """The same scene in all 16 bits, and in fewer of a 16-bit file: maps differ by what rounding does."""
    views, truth = two_planes(np.random.default_rng(4), (5, 5), (60, 72))
    found = {}
    for level in (65535, white):
        np.save(tmp_path / "lf.npy", np.rint(views * level).astype(np.uint16))
        found[level] = lfdepth.estimate(read(tmp_path / "lf.npy"), range=(-1, 1.2)).disparity
    difference = np.abs(found[white] - found[65535])
    assert np.quantile(difference, 0.98) < 0.0027
    for disparity in found.values():
        assert (np.abs(disparity - truth)[6:-6, 6:-6] > 0.07).mean() < 0.0112


def test_white_by_metadata(tmp_path: Path) -> None:
    views = random_views(3, 3, 12, 14, dtype="uint16", most=1000)
    expected = np.rint(views * (65535 / 4095))
    tagged = tmp_path / "tagged"
    tagged.mkdir()
    for v, u in np.ndindex(3, 3):
        # MaxSampleValue, one SHORT
        tifffile.imwrite(tagged / f"v{v}_u{u}.tif", views[v, u], extratags=[(281, 3, 1, 4095, False)])
    significant = tmp_path / "significant.ome.tif"
    tifffile.imwrite(significant, views.reshape(9, 12, 14), metadata={"axes": "ZYX", "SignificantBits": 12})
    paths = [tagged, significant]
    with suppress(NotImplementedError):  # of imagecodecs, whose older versions do not pack 12 bits
        packed = tmp_path / "packed.tif"
        tifffile.imwrite(packed, views.reshape(9, 12, 14), photometric="minisblack", bitspersample=12)
        paths.append(packed)
    for path in paths:
        lf = read(path)
        assert lf.white_level == 4095, path
        np.testing.assert_array_equal(lf.views[..., 0], expected)


@pytest.mark.parametrize("target", ["lf.npz", "lf.h5", "lf.tif", "folder"])
def test_converted_samples_are_full_range_and_stay_so(tmp_path: Path, target: str) -> None:
    views = random_views(3, 3, 12, 14, dtype="uint16", most=200)
    np.save(tmp_path / "dark.npy", views)
    lf = read(tmp_path / "dark.npy", white_level=4095)  # an exposure that uses a twentieth of 12 bits
    lfdepth.write(tmp_path / target, lf)
    again = read(tmp_path / target)
    np.testing.assert_array_equal(again.views, lf.views)
    assert again.white_level is None


def test_floats_that_are_whole_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "lf.npy", VIEWS.astype(np.float64))
    lf = read(tmp_path / "lf.npy")
    assert lf.white_level == 255
    np.testing.assert_allclose(lf.views, VIEWS / 255, atol=1e-7)


def test_floats_beyond_one(tmp_path: Path) -> None:
    """White is the power of two that 99.5 % of the reference view do not exceed; the rest is clipped."""
    views = np.random.default_rng(0).uniform(0, 3.5, (3, 3, 20, 20, 3)).astype(np.float32)
    views[1, 1, 3, 4] = 1000  # a lamp, 0.25 % of the reference view
    np.save(tmp_path / "lf.npy", views)
    lf = read(tmp_path / "lf.npy")
    assert lf.white_level == 4
    np.testing.assert_array_equal(lf.views, np.minimum(views / 4, 1))
    assert any("brighter and were clipped" in remark for remark in lf.remarks)
    np.testing.assert_allclose(read(tmp_path / "lf.npy", white_level=3).views, np.minimum(views / 3, 1), 1e-6)


def test_floats_of_which_few_exceed_one_are_clipped(tmp_path: Path) -> None:
    views = np.random.default_rng(0).uniform(0, 1, (3, 3, 20, 20, 3)).astype(np.float32)
    views[1, 1, 3, 4], views[0, 0, 0, 0] = 7, -0.01
    np.save(tmp_path / "lf.npy", views)
    lf = read(tmp_path / "lf.npy")
    assert lf.white_level == 1
    np.testing.assert_array_equal(lf.views, np.clip(views, 0, 1))


# Folders


def test_time_stamps_with_a_grid(tmp_path: Path) -> None:
    seconds = np.cumsum(np.random.default_rng(1).integers(2, 30, 25))
    for n, view in enumerate(VIEWS.reshape(25, *VIEWS.shape[2:])):
        save(tmp_path / f"IMG_{20260101_100000 + seconds[n]}.png", view)
    np.testing.assert_array_equal(read(tmp_path, grid=(5, 5)).views, VIEWS)
    with pytest.raises(LightFieldError, match=r"25 pictures with irregular numbers.*--grid COLUMNSxROWS"):
        read(tmp_path)


def test_numbers_that_go_together_count_once(tmp_path: Path) -> None:
    """Bursts of phones: both numbers count the pictures. They are no diagonal of a grid."""
    for n, view in enumerate(VIEWS.reshape(25, *VIEWS.shape[2:])):
        save(tmp_path / f"{n:05d}IMG_{n:05d}_BURST20260101{'_COVER' if n == 0 else ''}.png", view)
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


def test_times_in_two_numbers_are_no_huge_grid(tmp_path: Path) -> None:
    for n, time in enumerate([(20260101, 235959123), (20260101, 235959999), (20260102, 1000457)]):
        save(tmp_path / f"PXL_{time[0]}_{time[1]:09d}.png", VIEWS[0, n])
    with pytest.raises(LightFieldError, match=r"3 pictures whose names .*--grid COLUMNSxROWS"):
        read(tmp_path)
    np.testing.assert_array_equal(read(tmp_path, grid=(1, 3)).views[0], VIEWS[0, :3])


def test_dates_and_times_with_a_grid(tmp_path: Path) -> None:
    for n, view in enumerate(VIEWS.reshape(25, *VIEWS.shape[2:])):
        save(tmp_path / f"PXL_202601{1 + n // 10:02d}_{7 * n % 10 + 10 * n}{n}.png", view)
    lf = read(tmp_path, grid=(5, 5))
    names = sorted(file.name for file in tmp_path.iterdir())
    assert len(names) == 25
    by_time = sorted(tmp_path.iterdir(), key=lambda file: [int(n) for n in file.stem.split("_")[1:]])
    expected = np.stack([np.asarray(Image.open(file)) for file in by_time]).reshape(VIEWS.shape)
    np.testing.assert_array_equal(lf.views, expected)


def test_the_cover_of_a_burst_is_a_view(tmp_path: Path) -> None:
    for n, view in enumerate(VIEWS[0]):
        save(tmp_path / f"IMG_BURST{n:03d}{'_COVER' if n == 0 else ''}.png", view)
    np.testing.assert_array_equal(read(tmp_path, grid=(1, 5)).views[0], VIEWS[0])


def test_maps_and_masks_beside_the_views(tmp_path: Path) -> None:
    save_all(tmp_path, "{v}_{u}.png")
    save_all(tmp_path, "{v}_{u}_label.png", VIEWS[..., 0])
    save(tmp_path / "2_2_depth.png", VIEWS[2, 2, ..., 0])
    save(tmp_path / "mask.png", VIEWS[2, 2, ..., 0])
    np.save(tmp_path / "disparity.npy", np.zeros((12, 14)))
    lf = read(tmp_path)
    np.testing.assert_array_equal(lf.views, VIEWS)
    assert lf.remarks == ("27 pictures that are not views were ignored, such as 0_0_label.png",)


def test_others_among_the_views_are_named_or_left_out(tmp_path: Path) -> None:
    save_all(tmp_path, "shot_{v}_{u}.png")
    save(tmp_path / "board.png", VIEWS[0, 0])
    with pytest.raises(LightFieldError, match=r"board\.png: surplus picture.*--pattern 'shot_\*_\*\.png'"):
        read(tmp_path)
    np.testing.assert_array_equal(read(tmp_path, pattern="shot_*_*.png").views, VIEWS)
    np.testing.assert_array_equal(read(tmp_path, grid=(5, 5)).views, VIEWS)  # a count that fits decides
    with pytest.raises(LightFieldError, match=r"none of 26 pictures matches x\*; expected views"):
        read(tmp_path, pattern="x*")


def test_pictures_named_after_the_views(tmp_path: Path) -> None:
    """Masks by a name that nobody knows: a count that fits decides, and the pattern that is advised helps."""
    save_all(tmp_path, "{v}_{u}.png")
    save_all(tmp_path, "{v}_{u}_instances.png", VIEWS[..., 0])
    np.testing.assert_array_equal(read(tmp_path, grid=(5, 5)).views, VIEWS)
    with pytest.raises(LightFieldError, match=r"0_0_instances\.png: surplus picture") as refused:
        read(tmp_path)
    pattern = str(refused.value).split("--pattern '")[1].split("'")[0]
    np.testing.assert_array_equal(read(tmp_path, pattern=pattern).views, VIEWS)


@pytest.mark.parametrize(
    "name", ["view_{:d}_{:d}.png", "view_{:+d}_{:+d}.png", "v{:d}_u{:d}.png", "shot {:d} {:d}.png"]
)
def test_rows_and_columns_counted_from_the_middle(tmp_path: Path, name: str) -> None:
    for v, u in np.ndindex(5, 5):
        save(tmp_path / name.format(v - 2, u - 2), VIEWS[v, u])
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


@pytest.mark.parametrize("name", ["img-{:03d}.png", "img_-{:03d}.png", "2026-01-01 - {:d}.png"])
def test_hyphens_are_no_signs(tmp_path: Path, name: str) -> None:
    for n, (v, u) in enumerate(np.ndindex(5, 5)):
        save(tmp_path / name.format(n), VIEWS[v, u])
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


@pytest.mark.parametrize("name", ["v{0}_u{1}.png", "cam_{0:.2f}_{1:.3f}.png", "x{1:.2f}_y{0:.2f}.png"])
@pytest.mark.parametrize("start", [0, -0.5])
def test_rows_and_columns_with_decimals(tmp_path: Path, name: str, start: float) -> None:
    for v, u in np.ndindex(5, 5):
        save(tmp_path / name.format(start + 0.25 * v, start + 0.5 * u), VIEWS[v, u])
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


def test_what_is_not_recognised_says_where_to_look(tmp_path: Path) -> None:
    save_all(tmp_path / "scene" / "images", "{n:03d}.png")
    with pytest.raises(LightFieldError, match=r"the pictures in it are in .*images: read that"):
        read(tmp_path / "scene")
    save(tmp_path / "tiles.png", VIEWS[0, 0])
    with pytest.raises(LightFieldError, match=r"--format mosaic --grid COLUMNSxROWS"):
        read(tmp_path / "tiles.png")


def test_a_folder_for_each_view_with_frames(tmp_path: Path) -> None:
    for frame, views in enumerate([VIEWS, VIEWS[::-1]]):
        save_all(tmp_path / "a", f"{{v:02d}}_{{u:02d}}/{frame:03d}.png", views)
        save_all(tmp_path / "b", f"cam{{n}}/frame{frame}.png", views)
    np.testing.assert_array_equal(read(tmp_path / "a").views, VIEWS)
    np.testing.assert_array_equal(read(tmp_path / "a", pattern="*/001.png").views, VIEWS[::-1])
    np.testing.assert_array_equal(read(tmp_path / "b", grid=(5, 5)).views, VIEWS)
    assert "2 frames" in read(tmp_path / "a").remarks[0]


def test_a_folder_for_each_row(tmp_path: Path) -> None:
    save_all(tmp_path, "row{v}/col{u}.png")
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


def test_another_programs_notes(tmp_path: Path) -> None:
    save_all(tmp_path, "{v}_{u}.png")
    for text in ('{"width": 14, "cameras": [1, 2]}', "[]", "not JSON", '{"lfdepth": 3}'):
        (tmp_path / "lightfield.json").write_text(text)
        np.testing.assert_array_equal(read(tmp_path).views, VIEWS)


# Positions of the cameras


def off_grid(grid: tuple[int, int], size: float = 0.1) -> NDArray[np.float64]:
    """Offsets in view steps that no origin and no step of a grid explains."""
    rng = np.random.default_rng(3)
    offsets = rng.normal(0, size, (*grid, 2))
    for axis in (0, 1):
        place = np.indices(grid)[axis].ravel()
        found = np.polyfit(place, offsets[..., axis].ravel(), 1)
        offsets[..., axis] -= np.polyval(found, place).reshape(grid)
    return offsets


def counted_from_reference(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    from_reference: NDArray[np.float64] = offsets - offsets[offsets.shape[0] // 2, offsets.shape[1] // 2]
    return from_reference


@pytest.mark.parametrize("prefix", ["out_", "bunny_rig_"])
def test_positions_in_names(tmp_path: Path, prefix: str) -> None:
    offsets = off_grid((5, 5))
    for v, u in np.ndindex(5, 5):
        y, x = 40.0 * (v + offsets[v, u, 0]), -100.0 * (u + offsets[v, u, 1])
        save(tmp_path / f"{prefix}{v:02d}_{u:02d}_{y - 40:.6f}_{x:.6f}.png", VIEWS[v, u])
    lf = read(tmp_path)
    np.testing.assert_array_equal(lf.views, VIEWS)
    assert lf.positions is not None
    np.testing.assert_allclose(lf.positions, counted_from_reference(offsets), atol=1e-6)


def test_positions_of_a_regular_grid(tmp_path: Path) -> None:
    for v, u in np.ndindex(5, 5):
        save(tmp_path / f"rig_{v}_{u}_{-0.0 + 100 * v:.6f}_{400 - 100 * u:.6f}.png", VIEWS[v, u])
    (tmp_path / "rig_0_0_0.000000_400.000000.png").rename(tmp_path / "rig_0_0_-0.000000_400.000000.png")
    lf = read(tmp_path)
    np.testing.assert_array_equal(lf.views, VIEWS)
    assert lf.positions is None


@pytest.mark.parametrize("swapped", [False, True])
def test_positions_by_a_table(tmp_path: Path, swapped: bool) -> None:
    offsets = off_grid((3, 5))
    rows = ["u,x,v,y" if swapped else "v,u,y,x"]
    for v, u in np.ndindex(3, 5):
        y, x = 8 + 2 * (v + offsets[v, u, 0]), 3 * (u + offsets[v, u, 1])
        rows.append(f"{u},{x!r},{v},{y!r}" if swapped else f"{v},{u},{y!r},{x!r}")
    (tmp_path / "table.csv").write_text("\n".join(rows).replace("np.float64(", "").replace(")", ""))
    np.save(tmp_path / "lf.npy", GREY)
    lf = read(tmp_path / "lf.npy", positions=tmp_path / "table.csv")
    assert lf.positions is not None
    np.testing.assert_allclose(lf.positions, counted_from_reference(offsets), atol=1e-9)
    assert lf.remarks == ("according to the camera positions, a step down is 0.667 of a step to the right",)
    # They go with the views: reordered, and written and read back.
    turned = read(tmp_path / "lf.npy", positions=tmp_path / "table.csv", transpose=True, flip_u=True)
    assert turned.positions is not None
    expected = offsets.swapaxes(0, 1)[:, ::-1, ::-1] * (1, -1)
    np.testing.assert_allclose(turned.positions, counted_from_reference(expected), atol=1e-9)
    lfdepth.write(tmp_path / "again.npz", lf)
    again = read(tmp_path / "again.npz").positions
    assert again is not None
    np.testing.assert_allclose(again, lf.positions, atol=1e-9)


def test_a_table_beside_the_pictures(tmp_path: Path) -> None:
    offsets = off_grid((5, 5))
    save_all(tmp_path, "{v}_{u}.png")
    lines = [f"{v},{u},{v + offsets[v, u, 0]},{u + offsets[v, u, 1]}" for v, u in np.ndindex(5, 5)]
    (tmp_path / "positions.csv").write_text("\n".join(lines))
    lf = read(tmp_path)
    assert lf.positions is not None
    np.testing.assert_allclose(lf.positions, counted_from_reference(offsets), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0,1", r"line 1 is '0,0,1'; expected four numbers v,u,y,x"),
        ("v,u,y,x\n0,0,one,2", "line 2 is '0,0,one,2'"),
        ("0,7,1,2", r"view \(0, 7\); expected rows 0 to 2 and columns 0 to 4"),
        ("0,0,1,2\n0,0,1,2", r"view \(0, 0\) again"),
        ("0,0,1,2", r"14 views have no position, first view \(0, 1\)"),
        ("\n".join(f"{v},{u},0,0" for v, u in np.ndindex(3, 5)), "do not advance from view to view"),
    ],
)
def test_wrong_tables_are_named(tmp_path: Path, text: str, message: str) -> None:
    np.save(tmp_path / "lf.npy", GREY)
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(LightFieldError, match=message):
        read(tmp_path / "lf.npy", positions=tmp_path / "table.csv")


def test_positions_tell_that_views_are_out_of_order(tmp_path: Path) -> None:
    lines = [f"{v},{u},{v},{u if v % 2 == 0 else 4 - u}" for v, u in np.ndindex(3, 5)]
    (tmp_path / "table.csv").write_text("\n".join(lines))
    np.save(tmp_path / "lf.npy", GREY)
    with pytest.raises(
        LightFieldError, match=r"view steps .*; read every second row backwards \(--serpentine"
    ):
        read(tmp_path / "lf.npy", positions=tmp_path / "table.csv")
    assert read(tmp_path / "lf.npy", positions=tmp_path / "table.csv", serpentine=True).positions is None
    lines[3], lines[7] = "0,3,1,2", "1,2,0,3"  # two views that were swapped
    (tmp_path / "table.csv").write_text("\n".join(lines))
    with pytest.raises(LightFieldError, match=r"view steps .*; fix the order of the views, or the table"):
        read(tmp_path / "lf.npy", positions=tmp_path / "table.csv", serpentine=True)


def test_serpentine_order(tmp_path: Path) -> None:
    turned = VIEWS.copy()
    turned[1::2] = turned[1::2, ::-1]
    save_all(tmp_path, "{n:03d}.png", turned)
    np.testing.assert_array_equal(read(tmp_path, serpentine=True).views, VIEWS)
    # Columns that run up and down: rows of the grid as it is stored, which is then transposed.
    down = VIEWS.swapaxes(0, 1).copy()
    down[1::2] = down[1::2, ::-1]
    save_all(tmp_path / "columns", "{n:03d}.png", down)
    lf = read(tmp_path / "columns", serpentine=True, transpose=True)
    np.testing.assert_array_equal(lf.views, VIEWS)


# Pictures


@pytest.mark.parametrize(
    ("ending", "dtype", "grey"),
    [
        ("webp", "uint8", False),
        *(
            (ending, dtype, grey)
            for ending in ("png", "tif")
            for dtype in ("uint8", "uint16")
            for grey in (0, 1)
        ),
    ],
)
def test_opaque_alpha_is_dropped(tmp_path: Path, ending: str, dtype: str, grey: bool) -> None:
    views = random_views(3, 3, 12, 14, 1 if grey else 3, dtype=dtype)
    alpha = np.full((3, 3, 12, 14, 1), np.iinfo(dtype).max, dtype)
    both = np.concatenate([views, alpha], axis=-1)

    def write(folder: Path, pictures: Views) -> None:
        folder.mkdir()
        for v, u in np.ndindex(3, 3):
            path = folder / f"v{v}_u{u}.{ending}"
            if ending == "png":
                path.write_bytes(imagecodecs.png_encode(pictures[v, u]))
            elif ending == "webp":
                path.write_bytes(imagecodecs.webp_encode(pictures[v, u], lossless=True))
            else:
                photometric = "minisblack" if grey else "rgb"
                tifffile.imwrite(path, pictures[v, u], photometric=photometric, extrasamples=["unassalpha"])

    write(tmp_path / "opaque", both)
    np.testing.assert_array_equal(read(tmp_path / "opaque").views, views)
    both[1, 2, 3, 4:6, -1] = 1  # 2 of 168 pixels
    write(tmp_path / "hole", both)
    with pytest.raises(LightFieldError, match=r"v1_u2\.\w+: alpha is not opaque at 1\.19 % of the pixels"):
        read(tmp_path / "hole")


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_opaque_alpha_in_arrays(tmp_path: Path, dtype: str) -> None:
    views = (VIEWS / 255).astype(dtype) if dtype == "float32" else random_views(*VIEWS.shape, dtype=dtype)
    white = 1 if dtype == "float32" else np.iinfo(dtype).max
    both = np.concatenate([views, np.full((*views.shape[:4], 1), white, dtype)], axis=-1)
    np.save(tmp_path / "lf.npy", both)
    np.testing.assert_array_equal(read(tmp_path / "lf.npy").views, views)
    both[2, 3, 0, 0, 3] = 0
    np.save(tmp_path / "hole.npy", both)
    with pytest.raises(LightFieldError, match=r"hole\.npy: view \(2, 3\): alpha is not opaque"):
        read(tmp_path / "hole.npy")


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("dtype", "white"), [("uint8", 255), ("uint16", 65535), ("uint16", 1000)])
def test_ppm_and_pgm(tmp_path: Path, channels: int, dtype: str, white: int) -> None:
    views = random_views(3, 3, 12, 14, channels, dtype=dtype, most=white)
    ending = "ppm" if channels == 3 else "pgm"
    for v, u in np.ndindex(3, 3):
        header = f"P{6 if channels == 3 else 5}\n# of a rig\n14 12\n{white}\n".encode()
        (tmp_path / f"v{v}_u{u}.{ending}").write_bytes(
            header + views[v, u].astype(views.dtype.newbyteorder(">")).tobytes()
        )
    lf = read(tmp_path)
    np.testing.assert_array_equal(lf.views, np.rint(views * (np.iinfo(dtype).max / white)))
    if white != 1000:  # OpenCV writes full range only
        for v, u in np.ndindex(3, 3):
            cv2.imwrite(str(tmp_path / f"v{v}_u{u}.{ending}"), views[v, u, :, :, ::-1])
        np.testing.assert_array_equal(read(tmp_path).views, views)


def test_plain_ppm(tmp_path: Path) -> None:
    for v, u in np.ndindex(3, 3):
        text = "\n".join(" ".join(map(str, row)) for row in VIEWS[v, u].reshape(12, -1))
        (tmp_path / f"v{v}_u{u}.ppm").write_text(f"P3 14 12 # size\n255\n{text}\n")
    np.testing.assert_array_equal(read(tmp_path).views, VIEWS[:3, :3])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"P6 14 12 255\n" + bytes(100), r"100 samples; expected 504 for 14x12 px; the file is truncated"),
        (b"P6 14 12 99999\n", "damaged header"),
        (b"P5 14\n", "damaged header"),
        (b"P5 14 12 100\n" + bytes([101]) * 168, "sample 101; expected at most 100"),
        (b"P6 1000000 1000000 255\n", "unpacks to"),
    ],
)
def test_damaged_ppm(tmp_path: Path, data: bytes, message: str) -> None:
    for n in range(3):
        (tmp_path / f"u{n}.ppm").write_bytes(data)
    with pytest.raises(LightFieldError, match=message):
        read(tmp_path)


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("prefix", ["", "ViewLayer.Combined."])
def test_exr_views(tmp_path: Path, alpha: bool, prefix: str) -> None:
    views = (VIEWS / 256).astype(np.float16)
    for v, u in np.ndindex(5, 5):
        channels = {prefix + name: np.ascontiguousarray(views[v, u, ..., i]) for i, name in enumerate("RGB")}
        if alpha:
            channels[prefix + "A"] = np.ones((12, 14), np.float16)
        channels["ViewLayer.Depth.Z"] = np.full((12, 14), 7, np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, channels) as file:
            file.write(str(tmp_path / f"{v}_{u}.exr"))
    lf = read(tmp_path)
    assert lf.views.dtype == np.float32
    np.testing.assert_array_equal(lf.views, views.astype(np.float32))


def test_mosaic(tmp_path: Path) -> None:
    views = random_views(3, 5, 12, 14, 3)
    save(tmp_path / "tiles.png", views.transpose(0, 2, 1, 3, 4).reshape(36, 70, 3))
    np.testing.assert_array_equal(read(tmp_path / "tiles.png", format="mosaic", grid=(3, 5)).views, views)
    by_columns = views.transpose(1, 2, 0, 3, 4).reshape(60, 42, 3)
    save(tmp_path / "columns.png", by_columns)
    lf = read(tmp_path / "columns.png", format="mosaic", grid=(5, 3), transpose=True)
    np.testing.assert_array_equal(lf.views, views)
    interleaved = views.transpose(2, 0, 3, 1, 4).reshape(36, 70, 3)
    save(tmp_path / "lenses.png", np.maximum(interleaved, 100))  # dark views count as absent there
    lf = read(tmp_path / "lenses.png", format="eslf", grid=(3, 5))
    np.testing.assert_array_equal(lf.views, np.maximum(views, 100))
    with pytest.raises(LightFieldError, match=r"tiles\.png: a mosaic of views; .*give columns x rows"):
        read(tmp_path / "tiles.png", format="mosaic")
    with pytest.raises(LightFieldError, match="70x36 px; expected multiples of 4x3 views"):
        read(tmp_path / "tiles.png", format="mosaic", grid=(3, 4))


@pytest.mark.parametrize("above", [True, False])
def test_quilt_with_pixels_left_over(tmp_path: Path, above: bool) -> None:
    """5 x 9 tiles in a square whose side divides by neither."""
    side = 128  # tiles of 25 x 14 px, 3 and 2 left over
    views = random_views(45, 14, 25, 3)
    picture = np.zeros((side, side, 3), np.uint8)
    for number, view in enumerate(views):
        row, column = divmod(number, 5)  # from the bottom
        top = side - 14 * (row + 1) if above else 14 * (8 - row)
        picture[top : top + 14, 25 * column : 25 * (column + 1)] = view
    save(tmp_path / "x_qs5x9a1.png", picture)
    lf = read(tmp_path / "x_qs5x9a1.png")
    np.testing.assert_array_equal(lf.views[0], views)
    assert "not a multiple of 5x9 tiles" in lf.remarks[0]


def test_quilt_of_fractional_tiles(tmp_path: Path) -> None:
    """Rendered into equal shares of a picture: each tile starts at the nearest pixel."""
    side = 128
    picture = np.zeros((side, side, 3), np.uint8)
    column = np.round(np.arange(6) * side / 5).astype(int)
    row = np.round(np.arange(10) * side / 9).astype(int)
    for number in range(45):
        v, u = 8 - number // 5, number % 5
        picture[row[v] : row[v + 1], column[u] : column[u + 1]] = 10 + 5 * number
    save(tmp_path / "x_qs5x9a1.png", picture)
    views = read(tmp_path / "x_qs5x9a1.png").views[0]
    assert views.shape == (45, 14, 25, 3)
    np.testing.assert_array_equal(views.reshape(45, -1).min(axis=1), 10 + 5 * np.arange(45))
    np.testing.assert_array_equal(views.reshape(45, -1).max(axis=1), 10 + 5 * np.arange(45))


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_imagej_hyperstack_with_colour_as_grey_pages(tmp_path: Path, dtype: str) -> None:
    views = random_views(3, 5, 12, 14, 3, dtype=dtype)
    pages = views.transpose(0, 1, 4, 2, 3)  # T, Z, C, Y, X
    tifffile.imwrite(tmp_path / "stack.tif", pages, imagej=True, metadata={"axes": "TZCYX"})
    np.testing.assert_array_equal(read(tmp_path / "stack.tif").views, views)
    large = tmp_path / "large.tif"  # as ImageJ writes stacks of gigabytes: a single page is described
    tifffile.imwrite(large, pages, imagej=True, truncate=True, metadata={"axes": "TZCYX"})
    np.testing.assert_array_equal(read(large).views, views)
    one_by_one = tmp_path / "counted.tif"
    tifffile.imwrite(one_by_one, pages.reshape(15, 3, 12, 14), imagej=True, metadata={"axes": "TCYX"})
    np.testing.assert_array_equal(read(one_by_one, grid=(3, 5)).views, views)
    two = tmp_path / "two.tif"
    tifffile.imwrite(two, pages[:, :, :2], imagej=True, metadata={"axes": "TZCYX"})
    with pytest.raises(LightFieldError, match="2 channels; expected grey views, or red, green and blue"):
        read(two)


@pytest.mark.parametrize(
    ("axes", "order"), [("TZYXS", None), ("TZCYX", (0, 1, 4, 2, 3)), ("CTZYX", (4, 0, 1, 2, 3))]
)
def test_ome_tiff(tmp_path: Path, axes: str, order: tuple[int, ...] | None) -> None:
    views = random_views(3, 5, 12, 14, 3)
    stored = views if order is None else views.transpose(order)
    photometric = "rgb" if order is None else "minisblack"
    tifffile.imwrite(tmp_path / "a.ome.tif", stored, photometric=photometric, metadata={"axes": axes})
    np.testing.assert_array_equal(read(tmp_path / "a.ome.tif").views, views)


def test_grey_ome_tiff(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.ome.tif", GREY, photometric="minisblack", metadata={"axes": "TZYX"})
    np.testing.assert_array_equal(read(tmp_path / "a.ome.tif").views[..., 0], GREY)


@pytest.mark.parametrize("dtype", ["int16", "int32", "uint32", "int64"])
def test_whole_numbers_of_other_types(tmp_path: Path, dtype: str) -> None:
    views = random_views(3, 5, 12, 14, dtype="uint16", most=4095)
    np.save(tmp_path / "lf.npy", views.astype(dtype))
    paths = [tmp_path / "lf.npy"]
    if dtype != "int64":
        paths.append(tmp_path / "pages.tif")
        tifffile.imwrite(paths[-1], views.reshape(15, 12, 14).astype(dtype))
    for path in paths:
        lf = read(path, grid=(3, 5))
        assert lf.white_level == 4095
        np.testing.assert_array_equal(lf.views[..., 0], np.rint(views * (65535 / 4095)))
    if dtype != "uint32":
        negative = views.astype(dtype)
        negative[1, 2, 3, 4] = -1
        np.save(tmp_path / "negative.npy", negative)
        with pytest.raises(
            LightFieldError, match=r"view \(1, 2\): samples of type .* from -1 to \d+; expected 0"
        ):
            read(tmp_path / "negative.npy")


# HDF5 and MATLAB


TRUTH = np.random.default_rng(5).normal(0, 1, (5, 5, 12, 14)).astype(np.float32)


def test_hdf5_with_a_group_and_truth(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "lf.h5", "w") as file:
        file["LF/LF"] = VIEWS
        file["LF/disp_lowres_all"] = TRUTH
        file["LF/mask_all"] = np.zeros((5, 5, 12, 14), np.uint8)
    lf = read(tmp_path / "lf.h5")
    np.testing.assert_array_equal(lf.views, VIEWS)
    np.testing.assert_array_equal(lf.truth, TRUTH[2, 2])
    np.testing.assert_array_equal(read(tmp_path / "lf.h5", crop=(1, 2, 8, 9)).truth, TRUTH[2, 2, 2:11, 1:9])


def test_matlab_struct_with_truth(tmp_path: Path) -> None:
    savemat(tmp_path / "lf.mat", {"LF": {"LF": VIEWS, "disp_lowres_all": TRUTH, "name": "x"}})
    lf = read(tmp_path / "lf.mat")
    np.testing.assert_array_equal(lf.views, VIEWS)
    np.testing.assert_array_equal(lf.truth, TRUTH[2, 2])


def test_matlab_hdf5_with_truth(tmp_path: Path) -> None:
    """MATLAB 7.3: HDF5 whose axes run in reverse."""
    with h5py.File(tmp_path / "lf.mat", "w", userblock_size=512) as file:
        file["LF/LF"] = VIEWS.T
        file["LF/disp_lowres_all"] = TRUTH.T
    with (tmp_path / "lf.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    lf = read(tmp_path / "lf.mat")
    np.testing.assert_array_equal(lf.views, VIEWS)
    np.testing.assert_array_equal(lf.truth, TRUTH[2, 2])


@pytest.mark.parametrize("ending", ["h5", "npy"])
def test_reversed_axes_in_colour(tmp_path: Path, ending: str) -> None:
    """(C, W, H, U, V): what MATLAB's h5write makes of (V, U, H, W, C)."""
    views = random_views(3, 5, 12, 16, 3)
    path = tmp_path / f"lf.{ending}"
    if ending == "npy":
        np.save(path, views.T)
    else:
        with h5py.File(path, "w") as file:
            file["LF"] = views.T
    lf = read(path)
    np.testing.assert_array_equal(lf.views, views)
    assert "(C, W, H, U, V)" in lf.remarks[0]


@pytest.mark.parametrize("shape", [(3, 5, 24, 32), (5, 3, 24, 32), (3, 3, 28, 28), (9, 5, 64, 64)])
def test_reversed_axes_in_grey(tmp_path: Path, shape: tuple[int, ...]) -> None:
    views = random_views(*shape)
    with h5py.File(tmp_path / "lf.h5", "w") as file:
        file["LF"] = views.T
    lf = read(tmp_path / "lf.h5")
    np.testing.assert_array_equal(lf.views[..., 0], views)
    assert "(W, H, U, V)" in lf.remarks[0]
    assert "--axes HWVU" in lf.remarks[0]


def test_axes_by_hand(tmp_path: Path) -> None:
    upright = random_views(3, 5, 16, 12)
    with h5py.File(tmp_path / "lf.h5", "w") as file:
        file["LF"] = upright.transpose(2, 3, 0, 1)
    np.testing.assert_array_equal(read(tmp_path / "lf.h5", axes="hwvu").views[..., 0], upright)
    for axes in ("HWV", "HWVUX", "VUHH", "NVHW"):
        with pytest.raises(LightFieldError, match=f"axes '{axes}': unknown; expected V and U, or N"):
            read(tmp_path / "lf.h5", axes=axes)
    with pytest.raises(LightFieldError, match=r"array of shape .* or what HWVUC says; reorder the axes"):
        read(tmp_path / "lf.h5", axes="HWVUC")


def test_colours_counted_last(tmp_path: Path) -> None:
    """Views stacked along a fourth axis, as MATLAB's cat(4, ...) does, and in reverse."""
    savemat(tmp_path / "lf.mat", {"LF": VIEWS.reshape(25, 12, 14, 3).transpose(1, 2, 3, 0)})
    np.testing.assert_array_equal(read(tmp_path / "lf.mat").views, VIEWS)
    np.save(tmp_path / "lf.npy", VIEWS.reshape(25, 12, 14, 3).transpose(3, 2, 1, 0))
    np.testing.assert_array_equal(read(tmp_path / "lf.npy").views, VIEWS)


def older_benchmark(path: Path, focal: float, distance: float, shift: float, depth: Views) -> None:
    with h5py.File(path, "w") as file:
        file["LF"] = VIEWS[:, ::-1]
        file["GT_DEPTH"] = depth[:, ::-1]
        file.attrs.update({"dH": distance, "dV": distance, "focalLength": focal, "shift": shift})


@pytest.mark.parametrize("in_widths", [True, False])
def test_camera_of_the_older_benchmark(tmp_path: Path, in_widths: bool) -> None:
    """A camera of 9.375 picture widths focal length, 0.8 m apart: by either way of counting."""
    width = 14
    focal = 9.375 if in_widths else 9.375 * 768
    distance = 0.8 * width if in_widths else 0.8
    depth = np.random.default_rng(0).uniform(18, 22, (5, 5, 12, width)).astype(np.float32)
    depth[2, 2, 0, 0] = np.nan
    older_benchmark(tmp_path / "lf.h5", focal, distance, 5.0, depth)
    lf = read(tmp_path / "lf.h5")
    if not in_widths:  # 7200 px of 14 px wide pictures: none that there can be
        assert lf.camera is None
        assert "metres is not available" in lf.remarks[0]
        return
    assert lf.camera is not None
    assert lf.camera.baseline_mm == pytest.approx(800)
    # Pinhole by hand: x in metres of a pixel at depth Z is (x - cx) Z / f, f in px.
    assert lf.truth is not None
    points = lf.camera.points(lf.truth)
    focal_px = 9.375 * width
    assert points[3, 7, 0] == pytest.approx((7 - 6.5) * depth[2, 2, 3, 7] / focal_px, rel=1e-4)
    np.testing.assert_allclose(points[1:, :, 2], depth[2, 2, 1:], rtol=1e-5)
    assert np.isnan(lf.truth[0, 0])
    # Neighbouring views see that point b f / Z apart, less the shift.
    np.testing.assert_allclose(lf.truth[1:], 0.8 * focal_px / depth[2, 2, 1:] - 5, rtol=1e-4)


# Truth


def evaluate(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["evaluate", *words, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_truth_with_gaps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    views = random_views(3, 3, 40, 44)
    truth = np.linspace(-1, 1, 40 * 44, dtype=np.float32).reshape(40, 44)
    gaps = truth.copy()
    gaps[17, 20:30], gaps[20, 20:30] = np.nan, np.inf
    estimate = truth.copy()
    estimate[17, 20:30] += 9  # errors that do not count, as nothing is known there
    estimate[22, 20:24] += 9  # 4 that do
    np.savez(tmp_path / "lf.npz", LF=views, truth=gaps)
    np.save(tmp_path / "estimate.npy", estimate)
    lf = read(tmp_path / "lf.npz")
    np.testing.assert_array_equal(lf.truth, gaps)
    found = evaluate(capsys, str(tmp_path / "estimate.npy"), str(tmp_path / "lf.npz"))
    known = 10 * 14 - 2 * 9  # the metrics drop a border of 15 px
    assert found["scores"]["badpix_0.07"] == pytest.approx(100 * 4 / known)
    assert main(["info", str(tmp_path / "lf.npz"), "--no-check"]) == 0
    assert "for 98.9 % of the pixels" in capsys.readouterr().out


@pytest.mark.parametrize("ending", ["pfm", "npy", "npz", "tif", "exr", "zarr", "mat", "h5", "png"])
def test_truth_from_a_file(tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    views = random_views(3, 3, 40, 44)
    np.save(tmp_path / "lf.npy", views)
    truth = (np.arange(40 * 44, dtype=np.float32).reshape(40, 44) - 800) / 512
    path = tmp_path / f"truth.{ending}"
    words = []
    if ending == "mat":
        savemat(path, {"depth": truth + 3, "wanted": truth})
        words = ["--truth-variable", "wanted"]
    elif ending == "h5":
        with h5py.File(path, "w") as file:
            file["maps/disp"] = truth
    elif ending == "png":
        cv2.imwrite(str(path), np.rint((truth + 2) * 512).astype(np.uint16))
        words = ["--truth-scale", str(1 / 512), "--truth-offset", "-2"]
    else:
        lfdepth.write(path, truth)
    np.save(tmp_path / "estimate.npy", truth + np.float32(0.05))
    words = [str(tmp_path / "estimate.npy"), str(tmp_path / "lf.npy"), "--truth", str(path), *words]
    found = evaluate(capsys, *words)
    assert found["scores"]["badpix_0.07"] == 0
    assert found["scores"]["badpix_0.03"] == 100
    assert found["scores"]["mse_x100"] == pytest.approx(0.25, rel=1e-3)


def test_truth_that_cannot_be(tmp_path: Path) -> None:
    np.save(tmp_path / "lf.npy", random_views(3, 3, 40, 44))
    cv2.imwrite(str(tmp_path / "t.png"), np.zeros((40, 44), np.uint16))
    savemat(tmp_path / "t.mat", {"a": np.zeros((40, 44)), "b": np.zeros((40, 44))})
    np.save(tmp_path / "t.npy", np.zeros((39, 44)))
    for name, message in (
        ("t.png", r"t\.png: a picture without a scale; .*--truth-scale"),
        ("t.mat", r"t\.mat: holds a \(40, 44\), b \(40, 44\); expected one map \(H, W\); .*--truth-variable"),
        ("t.npy", "truth is 44x39 px; expected 44x40 px"),
        ("t.txt", r"t\.txt: no such file"),
    ):
        with pytest.raises(LightFieldError, match=message):
            read(tmp_path / "lf.npy", truth=tmp_path / name)
    os.mkfifo(tmp_path / "t.dat")
    with pytest.raises(LightFieldError, match=r"unknown extension \.dat"):
        read_truth(tmp_path / "t.dat")


@pytest.mark.parametrize(("given", "ending"), [("{file}", "tif"), ("hill={file}", "png"), ("{file}", "mat")])
def test_truth_for_a_bench(
    tmp_path: Path, given: str, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Scores of another program's map against truth that is known: half of the pixels are 0.2 px off."""
    truth = np.linspace(-1, 1, 40 * 44, dtype=np.float32).reshape(40, 44)
    told, options = tmp_path / f"truth.{ending}", []
    if ending == "png":
        cv2.imwrite(str(told), np.rint((truth + 2) * 16000).astype(np.uint16))
        options = ["--truth-scale", str(1 / 16000), "--truth-offset", "-2"]
    elif ending == "mat":
        savemat(told, {"depth": truth + 3, "wanted": truth})
        options = ["--truth-variable", "wanted"]
    else:
        lfdepth.write(told, truth)
    (tmp_path / "theirs").mkdir()
    lfdepth.write(tmp_path / "theirs" / "hill.pfm", truth + np.where(np.arange(44) < 22, 0, 0.2).astype("f4"))
    (tmp_path / "theirs" / "hill.txt").write_text("1.0")
    folder = tmp_path / "scene" / "hill"
    save_all(folder, "{v}_{u}.png", random_views(3, 3, 40, 44))
    words = [str(folder), "--truth", given.format(file=told), *options]
    words += ["--external", str(tmp_path / "theirs"), "--methods", "fbs:planes=3"]
    assert main(["bench", *words, "-o", str(tmp_path / "out"), "--json"]) in (0, 1)
    capsys.readouterr()
    results = json.loads((tmp_path / "out" / "results.json").read_text())["results"]
    scored = {each["method"]: each["scores"] for each in results}
    assert scored["theirs"]["badpix_0.07"] == pytest.approx(50)
    assert main(["bench", str(folder), "--truth", "dale=x.pfm", "-o", str(tmp_path / "out2")]) == 2
    assert "0 of 1 scenes fit; expected SCENE=FILE with one of hill" in capsys.readouterr().err


# Two views, and two by two


@pytest.mark.parametrize("grid", [(1, 2), (2, 1), (2, 2)])
@pytest.mark.parametrize("name", ["lf.npy", "lf.npz", "lf.h5", "lf.zarr", "lf.mat", "lf.tif", "folder"])
def test_two_views_are_read_and_written(
    tmp_path: Path, grid: tuple[int, int], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    views = random_views(*grid, 12, 14, 3)
    save_all(tmp_path / "pair", "v{v}_u{u}.png", views)
    source, target = str(tmp_path / "pair"), str(tmp_path / name)
    assert main(["convert", source, target]) == 0
    np.testing.assert_array_equal(read(target).views, views)
    capsys.readouterr()
    assert main(["info", target, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["shape"] == [*grid, 12, 14, 3]


@pytest.mark.parametrize("grid", [(1, 2), (2, 1), (2, 2)])
@pytest.mark.parametrize(
    ("method", "median", "wrong"),
    [("fbs", 0.03, 0.062), ("fbs-sfa", 0.03, 0.036), ("fbsocc-sfa", 0.03, 0.036), ("fbs-vis", 0.0115, 0.011)],
)
def test_two_views_are_estimated(grid: tuple[int, int], method: str, median: float, wrong: float) -> None:
    """A wall and a rectangle 1.4 px in front of it: found to a quarter of that but for a few pixels."""
    views, truth = two_planes(np.random.default_rng(4), grid, (72, 88))
    lf = LightField(quantise(views[..., None], "uint8"))
    found = lfdepth.estimate(lf, method, range=(-1.5, 1.5))
    error = np.abs(found.disparity - truth)[6:-6, 6:-6]
    assert np.median(error) < median
    assert (error > 0.35).mean() < wrong


def test_left_and_right(tmp_path: Path) -> None:
    save(tmp_path / "left.png", VIEWS[0, 0])
    save(tmp_path / "right.png", VIEWS[0, 1])
    np.testing.assert_array_equal(read(tmp_path, grid=(1, 2)).views[0], VIEWS[0, :2])
    with pytest.raises(
        LightFieldError, match=r"right\.png: surplus picture.*give the grid if all are \(--grid\)"
    ):
        read(tmp_path)


def test_the_range_of_two_views_is_found() -> None:
    views, truth = two_planes(np.random.default_rng(4), (1, 2), (72, 88))
    low, high = lfdepth.estimate(LightField(quantise(views[..., None], "uint8")), "fbs-sfa").range
    assert low < truth.min() < truth.max() < high
    assert high - low < 2
