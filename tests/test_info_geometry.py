"""What `lfdepth info` says of brightness, white level and where views stand, in words and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfdepth.cli import main
from lfdepth.lightfield import grid_offsets
from lfdepth.scenes.cameras import Imperfections, spoil
from test_geometry import GRID, field, jittered


def info(path: Path, views: Any, capsys: pytest.CaptureFixture[str]) -> tuple[dict[str, Any], str]:
    np.save(path, views)
    assert main(["info", str(path), "--json"]) == 0
    facts: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert main(["info", str(path)]) == 0
    return facts, capsys.readouterr().out


def test_nothing_is_found_where_nothing_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts, text = info(tmp_path / "lf.npy", field(grid_offsets(GRID)).views, capsys)
    assert abs(facts["measured_aspect"] - 1) < 0.02
    assert facts["measured_off_grid"] < 0.02
    assert not facts["brightness"]["needed"]
    assert facts["white_level"] is None
    assert "regular grid, equal steps" in text


@pytest.mark.parametrize("aspect", [0.8, 0.5])
def test_the_ratio_of_steps(aspect: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts, text = info(tmp_path / "lf.npy", field(grid_offsets(GRID) * [aspect, 1]).views, capsys)
    assert abs(facts["measured_aspect"] - aspect) < 0.02
    assert "use --aspect 0." in text
    assert "--refine-positions" not in text


def test_cameras_off_the_grid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts, text = info(tmp_path / "lf.npy", field(jittered(0.15)).views, capsys)
    assert 0.1 < facts["measured_off_grid"] < 0.2
    assert "use --refine-positions" in text


def test_brightness_and_white(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lf = spoil(field(grid_offsets(GRID)), Imperfections(gain=0.1, noise=0.002))
    facts, text = info(tmp_path / "lf.npy", lf.views.astype(np.uint16) << 4, capsys)
    assert facts["brightness"]["needed"]
    assert facts["white_level"] == 4095
    assert "differs between views" in text
    assert "4095 in the file" in text
