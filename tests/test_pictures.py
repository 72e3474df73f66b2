"""Pictures: map pixels arrive unchanged, colours mean what the legend says, files are whole or absent."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from lfdepth import pictures
from lfdepth.errors import LightFieldError
from lfdepth.pictures import PanelRow
from lfdepth.scoring import evaluate
from lfdepth.scoring.captions import score_line, score_lines

Array = NDArray[Any]
RAMP = np.linspace(-1, 1, 320 * 310).reshape(310, 320)


def read(path: Path) -> Array:
    return np.asarray(Image.open(path))


def contains(picture: Array, block: Array) -> bool:
    """Whether a block of pixels is somewhere in the picture, unchanged."""
    starts = np.argwhere((picture[..., :3] == block[0, 0]).all(-1))
    height, width = block.shape[:2]
    return any(np.array_equal(picture[y : y + height, x : x + width], block) for y, x in starts)


def test_a_preview_shows_every_pixel_beside_a_scale_bar(tmp_path: Path) -> None:
    pictures.preview(RAMP, tmp_path / "p.png", range=(-2, 2), title="ramp")
    picture = read(tmp_path / "p.png")
    assert contains(picture, pictures.disparity_colours(RAMP, (-2, 2)))
    assert picture.shape[1] < 320 + 150  # picture, bar, numbers and label, and no more
    bar = pictures.disparity_colours(np.linspace(2, -2, 310)[:, None] * np.ones(16), (-2, 2))
    assert contains(picture, bar)


def test_small_maps_are_enlarged_by_a_whole_factor(tmp_path: Path) -> None:
    pictures.preview(RAMP[:20, :70], tmp_path / "p.png")
    block = pictures.disparity_colours(RAMP[:20, :70]).repeat(5, 0).repeat(5, 1)
    assert contains(read(tmp_path / "p.png"), block)


def test_colours_of_errors_are_red_when_too_near_and_blue_when_too_far() -> None:
    truth = np.zeros((1, 4))
    red, blue, white, grey = pictures.error_colours(np.array([[0.2, -0.2, 0.0, np.nan]]), truth)[0].astype(
        int
    )
    assert red[0] > red[2] + 50
    assert blue[2] > blue[0] + 50
    assert white.min() > 240
    assert len(set(grey)) == 1


def test_errors_beyond_the_limit_have_the_colour_of_the_end() -> None:
    near = pictures.error_colours(np.array([[0.3, 5.0]]), np.zeros((1, 2)))
    np.testing.assert_array_equal(near[0, 0], near[0, 1])


def test_the_difference_is_blue_where_the_first_map_is_better() -> None:
    truth, good, bad = np.zeros((1, 2)), np.array([[0.0, -0.2]]), np.array([[-0.2, 0.0]])
    blue, red = pictures.difference_colours(good, bad, truth)[0].astype(int)
    assert blue[2] > blue[0] + 50
    assert red[0] > red[2] + 50


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        (np.full((2, 2, 3), 100, np.uint8), 100),
        (np.full((2, 2, 1), 100 * 257, np.uint16), 100),
        (np.full((2, 2, 3), 100 / 255, np.float32), 100),
    ],
)
def test_views_of_every_type_become_eight_bit_colours(view: Array, expected: int) -> None:
    np.testing.assert_array_equal(pictures.view_colours(view), np.full((2, 2, 3), expected))


def test_error_and_difference_maps_are_pixel_exact(tmp_path: Path) -> None:
    truth = np.zeros_like(RAMP)
    pictures.error_map(RAMP, truth, tmp_path / "e.png", title="error")
    assert contains(read(tmp_path / "e.png"), pictures.error_colours(RAMP, truth))
    pictures.difference_map(RAMP, RAMP / 2, truth, tmp_path / "d.png")
    assert contains(read(tmp_path / "d.png"), pictures.difference_colours(RAMP, RAMP / 2, truth))


def test_a_caption_names_the_scores() -> None:
    scores = evaluate(np.full((40, 40), 0.1), np.zeros((40, 40)))
    assert score_line(scores) == "BadPix 0.07 100 %, MSE×100 1.00"
    assert score_lines(scores)[1] == "15 px border not scored"
    assert score_lines({"runtime": 1.0}) == ()


def test_a_panel_has_every_view_map_and_error(tmp_path: Path) -> None:
    view = np.random.default_rng(0).integers(0, 255, (310, 320, 3), np.uint8)
    truth = RAMP
    maps = {"one": RAMP + 0.1, "two": np.zeros_like(RAMP)}
    path = tmp_path / "panel.png"
    pictures.panel(PanelRow(view, maps, truth, "scene"), PanelRow(view, maps, name="real"), path=path)
    picture = read(path)
    assert contains(picture, view)
    for each in maps.values():
        assert contains(picture, pictures.disparity_colours(each, (-1, 1)))
        assert contains(picture, pictures.error_colours(each, truth))


def test_a_map_without_finite_values_is_grey(tmp_path: Path) -> None:
    pictures.preview(np.full((300, 300), np.nan), tmp_path / "p.png")
    assert contains(read(tmp_path / "p.png"), np.full((300, 300, 3), 160, np.uint8))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((RAMP, "p.jpg"), r"p\.jpg: pictures are PNG files"),
        ((RAMP, "nowhere/p.png"), "nowhere"),
        ((RAMP[0], "p.png"), "expected .* \\(H, W\\)"),
    ],
)
def test_unusable_arguments_are_named_and_leave_no_file(
    arguments: tuple[Array, str], message: str, tmp_path: Path
) -> None:
    with pytest.raises(LightFieldError, match=message):
        pictures.preview(arguments[0], tmp_path / arguments[1])
    assert not list(tmp_path.iterdir())


def test_maps_of_another_size_and_empty_ranges_are_named(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match=r"expected \(310, 320\) like the truth"):
        pictures.error_map(RAMP[:5], RAMP, tmp_path / "e.png")
    with pytest.raises(LightFieldError, match="range: 1 to 1"):
        pictures.preview(RAMP, tmp_path / "p.png", range=(1, 1))
    with pytest.raises(LightFieldError, match="panel: no scene"):
        pictures.panel(path=tmp_path / "p.png")
    assert not list(tmp_path.iterdir())
