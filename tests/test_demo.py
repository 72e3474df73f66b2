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
def said() -> list[str]:
    """What the demonstration announces."""
    return []


@pytest.fixture(scope="module")
def demo(said: list[str], tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """A quarter of the demonstration's pixels; what is claimed of all of them is watched by the slow test."""
    folder = tmp_path_factory.mktemp("demo") / "made" / "here"
    return run_demo(folder, size=SIZE // 2, announce=said.append)


@pytest.mark.slow
def test_every_method_is_near_the_truth(tmp_path: Path) -> None:
    for name, scores in run_demo(tmp_path).scores.items():
        assert scores["badpix_0.07"] < 12, name
        assert scores["mse_x100"] < 1.6, name


def test_occlusion_handling_helps_near_the_occluder(demo: Demo) -> None:
    plain, masked = (demo.scores[name]["badpix_0.07_boundaries"] for name in ("fbs-sfa", "fbsocc-sfa"))
    assert masked < plain


def test_sign_step_is_finer_than_counting_planes(demo: Demo) -> None:
    assert demo.scores["fbs-sfa"]["q25"] < demo.scores["fbs"]["q25"]


def test_it_says_what_it_does(demo: Demo, said: list[str]) -> None:
    assert list(demo.scores) == list(methods.FAMILY)
    assert said == ["rendering the scene", *(f"estimating with {name}" for name in methods.FAMILY)]


def test_table_has_a_line_per_method_with_its_figures(demo: Demo) -> None:
    lines = demo.table().splitlines()
    for line, (name, scores) in zip(lines[1:], demo.scores.items(), strict=False):
        assert line.split()[0] == name
        assert figures(scores["badpix_0.07"]) in line.split()
    assert len({len(line) for line in lines[: len(demo.scores) + 1]}) == 1


def test_picture_shows_the_reference_view(demo: Demo) -> None:
    pixels = np.asarray(Image.open(demo.picture).convert("RGB"))
    wanted = view_colours(demo.lf.reference).repeat(2, axis=0).repeat(2, axis=1)  # narrower than 300 px
    size = len(wanted)
    places = np.argwhere((pixels[: 1 - size, : 1 - size] == wanted[0, 0]).all(-1))
    assert any(np.array_equal(pixels[y : y + size, x : x + size], wanted) for y, x in places)


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
