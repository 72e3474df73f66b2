"""The demonstration: every method near the exact truth, and a picture of it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfdepth import methods, scenes
from lfdepth.demo import PICTURE, SIZE, Demo, run_demo
from lfdepth.errors import LightFieldError
from lfdepth.pictures import view_colours
from lfdepth.table import figures


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    return run_demo(tmp_path_factory.mktemp("demo") / "made" / "here")


@pytest.mark.slow
@pytest.mark.parametrize("name", methods.FAMILY)
def test_every_method_is_near_the_truth(demo: Demo, name: str) -> None:
    assert demo.scores[name]["badpix_0.07"] < 12
    assert demo.scores[name]["mse_x100"] < 1.6


def test_occlusion_handling_helps_near_the_occluder(demo: Demo) -> None:
    plain, masked = (demo.scores[name]["badpix_0.07_boundaries"] for name in ("fbs-sfa", "fbsocc-sfa"))
    assert masked < plain


def test_sign_step_is_finer_than_counting_planes(demo: Demo) -> None:
    assert demo.scores["fbs-sfa"]["q25"] < demo.scores["fbs"]["q25"]


def test_table_has_a_line_per_method_with_its_figures(demo: Demo) -> None:
    lines = demo.table().splitlines()
    for line, (name, scores) in zip(lines[1:], demo.scores.items(), strict=False):
        assert line.split()[0] == name
        assert figures(scores["badpix_0.07"]) in line.split()
    assert len({len(line) for line in lines[: len(demo.scores) + 1]}) == 1


def test_picture_shows_the_reference_view(demo: Demo) -> None:
    pixels = np.asarray(Image.open(demo.picture).convert("RGB"))
    wanted = view_colours(demo.lf.reference)
    places = np.argwhere((pixels[: -SIZE + 1, : -SIZE + 1] == wanted[0, 0]).all(-1))
    assert any(np.array_equal(pixels[y : y + SIZE, x : x + SIZE], wanted) for y, x in places)


def test_demo_speaks_of_what_it_does(tmp_path: Path) -> None:
    words: list[str] = []
    run_demo(tmp_path, size=64, announce=words.append)
    assert words == ["rendering the scene", *(f"estimating with {name}" for name in methods.FAMILY)]


def test_interrupted_demo_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(scenes, "render", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_demo(tmp_path / "new" / "demo")
    assert list(tmp_path.iterdir()) == []


def test_interrupted_demo_keeps_a_folder_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(scenes, "render", interrupt)
    (tmp_path / PICTURE).write_bytes(b"of yesterday")
    with pytest.raises(KeyboardInterrupt):
        run_demo(tmp_path)
    assert (tmp_path / PICTURE).read_bytes() == b"of yesterday"


def test_too_small_or_not_a_folder(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match="size: found 63, expected at least 64 px"):
        run_demo(tmp_path, size=63)
    (tmp_path / "file").touch()
    with pytest.raises(LightFieldError, match="file: cannot be created"):
        run_demo(tmp_path / "file")
