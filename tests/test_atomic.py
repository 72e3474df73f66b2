"""What was there before is never lost, and what is not ours is never deleted."""

import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfdepth import scenes
from lfdepth.errors import LightFieldError
from lfdepth.io import atomic as module
from lfdepth.io import check_writable, write
from lfdepth.io.atomic import MANIFEST, atomic, atomic_folder, check_target, foreign_entry

MAP = np.linspace(-1, 1, 30, dtype=np.float32).reshape(5, 6)


def write_folder(path: Path, text: str) -> None:
    with atomic_folder(path) as folder:
        (folder / "file.txt").write_text(text)
        (folder / "below").mkdir()
        (folder / "below/file.txt").write_text(text)


def content(folder: Path) -> dict[str, str]:
    """Text by name of all files, but for the manifest."""
    return {
        file.relative_to(folder).as_posix(): file.read_text()
        for file in folder.rglob("*")
        if file.is_file() and file.name != MANIFEST
    }


OLD, NEW = (dict.fromkeys(("file.txt", "below/file.txt"), text) for text in ("old", "new"))


@pytest.fixture(params=["swap", "two steps"])
def replacing(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Replacing folders in one step, and as it is done where the system has none."""
    if request.param == "two steps":
        monkeypatch.setattr(module, "_exchange", lambda first, second: False)
    return str(request.param)


@pytest.mark.parametrize("failing", [1, 2])
@pytest.mark.parametrize("exception", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_a_folder_is_never_lost(
    tmp_path: Path, replacing: str, monkeypatch: pytest.MonkeyPatch, failing: int, exception: Any
) -> None:
    write_folder(tmp_path / "scene", "old")
    calls = 0

    def interrupted(original: Any) -> Any:
        def act(*arguments: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == failing:
                raise exception
            return original(*arguments)

        return act

    monkeypatch.setattr(Path, "rename", interrupted(Path.rename))
    if replacing == "swap":
        monkeypatch.setattr(module, "_exchange", interrupted(module._exchange))
    if replacing == "swap" and failing == 2:  # a single step: there is no second one to fail
        write_folder(tmp_path / "scene", "new")
        assert content(tmp_path / "scene") == NEW
    else:
        with pytest.raises((KeyboardInterrupt, LightFieldError)):
            write_folder(tmp_path / "scene", "new")
        assert content(tmp_path / "scene") == OLD
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene"]


def test_ctrl_c_right_after_the_old_folder_was_moved_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_exchange", lambda first, second: False)
    write_folder(tmp_path / "scene", "old")
    original = Path.rename

    def interrupted(self: Path, target: Path) -> Path:
        moved = original(self, target)
        if self == tmp_path / "scene":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_folder(tmp_path / "scene", "new")
    assert content(tmp_path / "scene") == OLD


def test_what_is_put_into_the_folder_meanwhile_is_not_deleted(tmp_path: Path, replacing: str) -> None:
    write_folder(tmp_path / "scene", "old")

    def meanwhile() -> None:
        with atomic_folder(tmp_path / "scene") as folder:
            (folder / "file.txt").write_text("new")
            (tmp_path / "scene/letter.txt").write_text("dear")

    with pytest.raises(LightFieldError, match=r"is a folder with other content \(letter\.txt\)"):
        meanwhile()
    assert content(tmp_path / "scene") == {**OLD, "letter.txt": "dear"}
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene"]


def test_what_is_put_into_the_folder_at_the_last_moment_is_not_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_folder(tmp_path / "scene", "old")
    original = module._exchange

    def late(first: Path, second: Path) -> bool:
        (second / "letter.txt").write_text("dear")
        monkeypatch.setattr(module, "_exchange", original)
        return original(first, second)

    monkeypatch.setattr(module, "_exchange", late)
    with pytest.raises(LightFieldError, match=r"is a folder with other content \(letter\.txt\)"):
        write_folder(tmp_path / "scene", "new")
    assert content(tmp_path / "scene") == {**OLD, "letter.txt": "dear"}


def add_file(folder: Path) -> None:
    (folder / "letter.txt").write_text("dear")


def add_file_below(folder: Path) -> None:
    (folder / "below/letter.txt").write_text("dear")


def add_folder(folder: Path) -> None:
    (folder / "letters").mkdir()


def write_over(folder: Path) -> None:
    (folder / "file.txt").write_text("a dear letter")


def turn_into_link(folder: Path) -> None:
    (folder / "file.txt").unlink()
    (folder / "file.txt").symlink_to("below/file.txt")


def lose_manifest(folder: Path) -> None:
    (folder / MANIFEST).unlink()


def garble_manifest(folder: Path) -> None:
    (folder / MANIFEST).write_text('{"written by lfdepth": ["file.txt"]}')


@pytest.mark.parametrize(
    "change",
    [
        add_file,
        add_file_below,
        add_folder,
        write_over,
        turn_into_link,
        lose_manifest,
        garble_manifest,
    ],
)
def test_folders_that_somebody_changed_are_left_alone(tmp_path: Path, change: Any) -> None:
    write_folder(tmp_path / "scene", "old")
    assert foreign_entry(tmp_path / "scene") is None
    change(tmp_path / "scene")
    before = content(tmp_path / "scene")
    with pytest.raises(LightFieldError, match="is a folder with other content"):
        check_target(tmp_path / "scene", folder=True)
    with pytest.raises(LightFieldError, match="is a folder with other content"):
        write_folder(tmp_path / "scene", "new")
    assert content(tmp_path / "scene") == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene"]


def test_a_folder_around_ours_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / "scenes").mkdir()
    write_folder(tmp_path / "scenes/one", "old")
    with pytest.raises(LightFieldError, match="is a folder with other content"):
        write_folder(tmp_path / "scenes", "new")
    assert content(tmp_path / "scenes/one") == OLD


def test_empty_folders_and_folders_with_less_are_replaced(tmp_path: Path, replacing: str) -> None:
    (tmp_path / "scene").mkdir()
    write_folder(tmp_path / "scene", "old")
    (tmp_path / "scene/file.txt").unlink()
    write_folder(tmp_path / "scene", "new")
    assert content(tmp_path / "scene") == NEW


def test_a_map_saved_among_a_rendered_scene_stays(tmp_path: Path) -> None:
    scenes.save("wedges", tmp_path / "wedges", size=64, views=3)
    scenes.save("wedges", tmp_path / "wedges", size=64, views=3, seed=1)  # ours alone: replaced
    write(tmp_path / "wedges/mine.pfm", MAP)
    before = (tmp_path / "wedges/mine.pfm").read_bytes()
    with pytest.raises(LightFieldError, match=r"is a folder with other content \(mine\.pfm\)"):
        scenes.save("wedges", tmp_path / "wedges", size=64, views=3)
    assert (tmp_path / "wedges/mine.pfm").read_bytes() == before


def test_somebody_elses_zarr_stays(tmp_path: Path) -> None:
    zarr: Any = pytest.importorskip("zarr")
    group = zarr.open_group(str(tmp_path / "mine.zarr"), mode="w")
    group.create_array("years_of_work", data=MAP)
    for act in (check_writable, lambda path: write(path, MAP)):
        with pytest.raises(LightFieldError, match=r"mine\.zarr: is a folder with other content"):
            act(tmp_path / "mine.zarr")
    for _ in range(2):  # ours alone: replaced
        write(tmp_path / "ours.zarr", MAP)
    zarr.open_group(str(tmp_path / "ours.zarr"), mode="a").create_array("years_of_work", data=MAP)
    with pytest.raises(LightFieldError, match=r"ours\.zarr: is a folder with other content \(years"):
        write(tmp_path / "ours.zarr", MAP)
    for name in ("mine", "ours"):
        kept = zarr.open_group(str(tmp_path / f"{name}.zarr"), mode="r")["years_of_work"]
        np.testing.assert_array_equal(kept[:], MAP)


@contextmanager
def recorded_calls(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """What is flushed and renamed, in order."""
    calls: list[str] = []
    fsync, replace, rename = os.fsync, Path.replace, Path.rename

    def flush(file: int) -> None:
        calls.append(f"flush {Path(f'/proc/self/fd/{file}').readlink().name}")
        fsync(file)

    def record(act: Any) -> Any:
        def move(self: Path, target: Path) -> Any:
            calls.append(f"name {Path(target).name}")
            return act(self, target)

        return move

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", flush)
        patch.setattr(Path, "replace", record(replace))
        patch.setattr(Path, "rename", record(rename))
        yield calls


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="the system does not name open files")
def test_content_is_on_the_disk_before_it_gets_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with recorded_calls(monkeypatch) as calls, atomic(tmp_path / "map.pfm") as temporary:
        temporary.write_text("new")
    assert calls == [f"flush {temporary.name}", "name map.pfm", f"flush {tmp_path.name}"]
    with recorded_calls(monkeypatch) as calls, atomic_folder(tmp_path / "scene") as folder:
        (folder / "below").mkdir()
        (folder / "below/file.txt").write_text("new")
    assert calls[-2:] == ["name scene", f"flush {tmp_path.name}"]
    files = ["file.txt", "below", MANIFEST, folder.name]
    assert sorted(calls[:-2]) == sorted(f"flush {name}" for name in files)


def test_another_process_between_the_two_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder takes the name that the old one has just given up; the work goes on, and leaves nothing."""
    write_folder(tmp_path / "scene", "old")
    rename, others = Path.rename, ["old"]

    def renamed(self: Path, target: Path) -> Path:
        if Path(target).name == "scene" and others:
            write_folder(tmp_path / "scene", others.pop())
        return rename(self, target)

    monkeypatch.setattr(module, "_exchange", lambda first, second: False)
    monkeypatch.setattr(Path, "rename", renamed)
    write_folder(tmp_path / "scene", "new")
    assert content(tmp_path / "scene") == NEW
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene"]


def test_of_two_that_write_the_same_folder_one_wins(tmp_path: Path, replacing: str) -> None:
    problems: list[BaseException] = []

    def write_many(text: str) -> None:
        try:
            for _ in range(20):
                write_folder(tmp_path / "scene", text)
        except BaseException as error:
            problems.append(error)

    threads = [threading.Thread(target=write_many, args=(text,)) for text in ("old", "new")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems
    assert content(tmp_path / "scene") in (OLD, NEW)
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene"]
    assert set(json.loads((tmp_path / "scene" / MANIFEST).read_text())["written by lfdepth"]) == set(NEW)
