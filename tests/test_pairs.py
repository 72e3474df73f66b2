"""A picture or array and the file beside it: whenever the process ends, they do not contradict each other."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from lfdepth.errors import LightFieldError
from lfdepth.io import is_map, read, read_disparity, read_record, write
from lfdepth.io.beside import checksum
from lfdepth.lightfield import LightField
from test_io import without_text

VIEWS = np.random.default_rng(0).integers(0, 256, (3, 3, 6, 7, 3)).astype(np.uint8)
OLD_MAP = np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7)
NEW_MAP = 3 - OLD_MAP**2 * 40
OLD = LightField(VIEWS, disparity_range=(-1, 1))
NEW = LightField(255 - VIEWS, disparity_range=(-7, 8))


@contextmanager
def killed_at(monkeypatch: pytest.MonkeyPatch, step: int) -> Iterator[list[str]]:
    """The names that were given until the process ended, at the start of that step.

    What comes after a kill does not happen: neither clean-up nor anything else that renames or removes.
    """
    done: list[str] = []
    act, unlink = Path.replace, Path.unlink

    def move(self: Path, target: Path) -> Path:
        if len(done) >= step:
            raise KeyboardInterrupt
        done.append(Path(target).name)
        return act(self, target)

    def remove(self: Path, missing_ok: bool = False) -> None:
        if len(done) < step:
            unlink(self, missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", move)
        patch.setattr(Path, "unlink", remove)
        yield done


@pytest.mark.parametrize("step", range(4))
@pytest.mark.parametrize("first", [True, False])
def test_a_map_and_its_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int, first: bool) -> None:
    path = tmp_path / "map.png"
    if not first:
        write(path, OLD_MAP)
    with killed_at(monkeypatch, step) as done:
        try:
            write(path, NEW_MAP)
        except KeyboardInterrupt:
            assert len(done) == step
    if path.exists():
        expected = NEW_MAP if "map.png" in done else OLD_MAP
        np.testing.assert_allclose(read_disparity(path), expected, atol=4e-4)
        assert is_map(path)
        without_text(path)  # the scale beside it fits, or is refused
        if expected is OLD_MAP and "map.json" in done:
            with pytest.raises(LightFieldError, match="belongs to other samples"):
                read_disparity(path)
        else:
            np.testing.assert_allclose(read_disparity(path), expected, atol=4e-4)


@pytest.mark.parametrize("step", range(5))
@pytest.mark.parametrize("before", ["nothing", "views with notes", "views alone"])
@pytest.mark.parametrize("name", ["x.npy", "row_qs3x1a1.png"])
def test_views_and_their_notes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int, before: str, name: str
) -> None:
    path = tmp_path / name
    old, new = ((replace(lf, views=lf.views[:1]) if "row" in name else lf) for lf in (OLD, NEW))
    if before != "nothing":
        write(path, old)
    if before == "views alone":
        path.with_suffix(".json").unlink(missing_ok=True)
        if path.suffix == ".png":
            without_text(path)
    with killed_at(monkeypatch, step) as done:
        try:
            write(path, new)
        except KeyboardInterrupt:
            assert len(done) == step
    if not path.exists():
        return
    found = read(path)
    if name in done:
        np.testing.assert_array_equal(found.views, new.views)
        assert found.disparity_range == new.disparity_range
    else:
        np.testing.assert_array_equal(found.views, old.views)
        assert found.disparity_range == (old.disparity_range if before == "views with notes" else None)
    write(path, new)  # the same command finishes the work
    assert read(path).disparity_range == new.disparity_range


def test_notes_of_other_samples_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "x.npy", OLD)
    np.save(tmp_path / "x.npy", NEW.views)
    with pytest.raises(LightFieldError, match=r"x\.json: describes other samples than those in x\.npy"):
        read(tmp_path / "x.npy")


def test_notes_without_a_checksum_are_believed(tmp_path: Path) -> None:
    write(tmp_path / "x.npy", OLD)
    known = json.loads((tmp_path / "x.json").read_text())
    assert known.pop("samples") == checksum(tmp_path / "x.npy")
    (tmp_path / "x.json").write_text(json.dumps(known))
    assert read(tmp_path / "x.npy").disparity_range == (-1, 1)


def test_a_map_that_was_edited_does_not_take_the_old_scale(tmp_path: Path) -> None:
    write(tmp_path / "map.png", OLD_MAP)
    samples = imagecodecs.png_decode((tmp_path / "map.png").read_bytes())
    (tmp_path / "map.png").write_bytes(imagecodecs.png_encode(samples[::-1].copy()))
    with pytest.raises(LightFieldError, match=r"map\.json: belongs to other samples than those of map\.png"):
        read_disparity(tmp_path / "map.png")


def test_the_scale_is_in_the_picture_for_others_too(tmp_path: Path) -> None:
    write(tmp_path / "map.png", OLD_MAP)
    (tmp_path / "map.json").unlink()
    np.testing.assert_allclose(read_record(tmp_path / "map.png").values, OLD_MAP, atol=2e-5)
    with Image.open(tmp_path / "map.png") as picture:
        known: Any = json.loads(picture.text["lfdepth"])  # type: ignore[attr-defined]
        samples = np.asarray(picture)
    np.testing.assert_allclose(samples * known["scale"] + known["offset"], OLD_MAP, atol=2e-5)


def test_checksums_of_large_files_tell_blocks_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lfdepth.io.beside._WHOLE", 1 << 20)
    data = np.random.default_rng(0).integers(0, 256, 3 << 20).astype(np.uint8)
    found = set()
    for place in (None, 0, len(data) // 2, len(data) - 1):
        changed = data.copy()
        if place is not None:
            changed[max(0, place - 300_000) : place + 300_000] += 1
        (tmp_path / "x").write_bytes(changed.tobytes())
        found.add(checksum(tmp_path / "x"))
    (tmp_path / "x").write_bytes(data.tobytes() + b"x")
    assert len(found | {checksum(tmp_path / "x")}) == 5
