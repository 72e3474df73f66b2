"""A real Lytro picture from the file to points and pictures, on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import plyfile  # type: ignore[import-untyped]
import pytest
from PIL import Image

from lfdepth.cli import main

# Windows of the reference view, (rows, columns): of the wheel in front, the one behind it, and the meadow.
FRONT, BEHIND, MEADOW = np.s_[170:200, 150:270], np.s_[80:110, 150:175], np.s_[95:125, 118:128]
SIZE = 288, 208
CAMERA = ["--baseline-mm", "0.5", "--focal-mm", "30", "--sensor-mm", "10", "--focus-m", "0.3"]


@pytest.mark.slow
def test_from_the_file_to_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], data_folder: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = str(data_folder / "lytro_bikes_crop_eslf.png")

    assert main(["info", scene, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["shape"] == [9, 9, 208, 288, 3]
    assert not facts["order"]["wrong"]
    assert facts["range_found"]

    assert main(["estimate", scene, "-o", "map.npz", "--preview", "map.png", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["range"] == pytest.approx(facts["disparity_range"])
    disparity = np.load("map.npz")["disparity"]
    front, behind, meadow = (float(np.median(disparity[window])) for window in (FRONT, BEHIND, MEADOW))
    assert front > behind + 0.3
    assert behind > meadow + 0.3
    assert result["range"][0] < meadow < front < result["range"][1]

    assert main(["convert", "map.npz", "-o", "points.ply", "--scene", scene, *CAMERA]) == 0
    vertices = plyfile.PlyData.read("points.ply")["vertex"]
    depth = np.asarray(vertices["z"]).reshape(SIZE[::-1])
    assert np.median(depth[FRONT]) < np.median(depth[BEHIND]) < np.median(depth[MEADOW])

    assert main(["refocus", scene, "--disparity", str(front), "-o", "front.png"]) == 0
    assert main(["refocus", scene, "--disparity", str(meadow), "-o", "far.png"]) == 0
    near, far = (sharpness(name) for name in ("front.png", "far.png"))
    assert near > 1.5 * far
    with Image.open("map.png") as preview:
        assert preview.size[0] > SIZE[0] / 2


def sharpness(name: str) -> float:
    """How much grey levels change from row to row on the wheel in front."""
    with Image.open(name) as picture:
        return float(np.abs(np.diff(np.asarray(picture.convert("L"), float)[FRONT], axis=0)).mean())
