"""Files that change while they are read: an error or the old content, never a mixture without a word."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfdepth.errors import LightFieldError
from lfdepth.io import read, read_record, source, write
from lfdepth.lightfield import LightField

VIEWS = np.random.default_rng(0).integers(0, 256, (3, 3, 6, 7, 3)).astype(np.uint8)
MAP = np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7)
NAMES = ["x.npy", "x.npz", "x.h5", "x.zarr", "x.mat", "x.tif", "x"]


def during(monkeypatch: pytest.MonkeyPatch, act: Callable[[], Any]) -> None:
    """Do something when a light field is open and the first of its views was read."""
    original = source._Window.of

    def late(*arguments: Any) -> Any:
        monkeypatch.undo()
        act()
        return original(*arguments)

    monkeypatch.setattr(source._Window, "of", staticmethod(late))


@pytest.mark.parametrize("name", NAMES)
def test_replaced_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    write(tmp_path / name, LightField(VIEWS))
    during(monkeypatch, lambda: write(tmp_path / name, LightField(255 - VIEWS)))
    with pytest.raises(LightFieldError, match=r"changed while it was being read; .* read it again"):
        read(tmp_path / name)
    np.testing.assert_array_equal(read(tmp_path / name).views, 255 - VIEWS)


@pytest.mark.parametrize("name", ["x.npy", "x.npz", "x.h5", "x.tif"])
def test_cut_short_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    views = np.random.default_rng(0).integers(0, 256, (3, 3, 90, 90, 3)).astype(np.uint8)
    write(tmp_path / name, LightField(views))

    def cut() -> None:
        with (tmp_path / name).open("rb+") as file:
            file.truncate(5000)

    during(monkeypatch, cut)
    with pytest.raises(LightFieldError):
        read(tmp_path / name)


def test_a_view_that_vanishes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "x", LightField(VIEWS))
    during(monkeypatch, (tmp_path / "x/view_v02_u02.png").unlink)
    with pytest.raises(LightFieldError):
        read(tmp_path / "x")


def test_what_is_not_read_may_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "x", LightField(VIEWS))
    (tmp_path / "x/log.txt").write_text("line")

    def change() -> None:
        (tmp_path / "x/log.txt").write_text("line\nline")
        (tmp_path / "x/new.pfm").write_text("map")

    during(monkeypatch, change)
    np.testing.assert_array_equal(read(tmp_path / "x").views, VIEWS)


@pytest.mark.parametrize("name", ["map.npz", "map.zarr"])
def test_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    from lfdepth.io import maps

    write(tmp_path / name, MAP)
    original = maps._array

    def late(*arguments: Any) -> Any:
        monkeypatch.undo()
        write(tmp_path / name, MAP + 1)
        return original(*arguments)

    monkeypatch.setattr(maps, "_array", late)
    with pytest.raises(LightFieldError, match="changed while it was being read"):
        read_record(tmp_path / name)
