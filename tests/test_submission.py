"""Submissions: a complete one is accepted, and each thing that would be refused is named."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lfdepth.bench import submission
from lfdepth.bench.cache import Cache
from lfdepth.bench.results import Found
from lfdepth.bench.submission import SCENES, check_submission, find_scenes, submit
from lfdepth.errors import LightFieldError

DATA = Path(__file__).parents[2] / "shared" / "data" / "hci4d"


def pfm(values: NDArray[Any]) -> bytes:
    return f"Pf\n{values.shape[1]} {values.shape[0]}\n-1\n".encode() + values[::-1].astype("<f4").tobytes()


def complete() -> dict[str, bytes]:
    """The files of a submission that is fine."""
    flat = pfm(np.zeros((512, 512)))
    return {f"disp_maps/{name}.pfm": flat for name in SCENES} | {
        f"runtimes/{name}.txt": b"3.5" for name in SCENES
    }


def zipped(files: dict[str, bytes], path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def test_a_complete_submission_is_fine(tmp_path: Path) -> None:
    assert check_submission(zipped(complete(), tmp_path / "s.zip")) == ()


def with_nan() -> bytes:
    values = np.zeros((512, 512))
    values[3, :7] = np.nan
    return pfm(values)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("disp_maps/dots.pfm", pfm(np.zeros((512, 511))), "disp_maps/dots.pfm: 511x512 px; expected 512x512"),
        ("disp_maps/dots.pfm", with_nan(), "disp_maps/dots.pfm: 7 values are NaN"),
        ("disp_maps/dots.pfm", b"P5\n1 1\n255\n0", "disp_maps/dots.pfm: no valid PFM header"),
        ("disp_maps/dots.pfm", pfm(np.zeros((512, 512)))[:-9], "disp_maps/dots.pfm: .*truncated"),
        ("disp_maps/dots.pfm", None, "disp_maps/dots.pfm: missing"),
        ("disp_maps/dots.pfm", bytes(1 << 22), "disp_maps/dots.pfm: 4194304 bytes; expected at most"),
        ("runtimes/herbs.txt", b"fast", "runtimes/herbs.txt: found 'fast'"),
        ("runtimes/herbs.txt", b"-1", "runtimes/herbs.txt: found '-1'"),
        ("runtimes/herbs.txt", b"0", "runtimes/herbs.txt: run time is 0"),
        ("runtimes/herbs.txt", None, "runtimes/herbs.txt: missing"),
        ("notes.txt", b"hello", "notes.txt: not part of a submission"),
        ("../evil.pfm", b"", "../evil.pfm: not part of a submission"),
    ],
)
def test_what_would_be_refused_is_named(name: str, data: bytes | None, message: str, tmp_path: Path) -> None:
    files = complete() | ({} if data is None else {name: data})
    if data is None:
        del files[name]
    problems = check_submission(zipped(files, tmp_path / "s.zip"))
    assert len(problems) == 1
    with pytest.raises(LightFieldError, match=message):
        raise LightFieldError(problems[0])


def test_a_folder_around_everything_is_one_problem(tmp_path: Path) -> None:
    nested = {f"mine/{name}": data for name, data in complete().items()}
    (problem,) = check_submission(zipped(nested, tmp_path / "s.zip"))
    assert problem.startswith("mine/: holds all files; expected disp_maps and runtimes at the top")
    del nested["mine/runtimes/dots.txt"]
    assert [each.split(":")[0] for each in check_submission(zipped(nested, tmp_path / "s.zip"))] == [
        "mine/",
        "runtimes/dots.txt",
    ]
    only_maps = {name: data for name, data in complete().items() if name.startswith("disp_maps")}
    assert len(check_submission(zipped(only_maps, tmp_path / "s.zip"))) == 12
    assert len(check_submission(zipped({}, tmp_path / "s.zip"))) == 24


def test_one_damaged_file_does_not_hide_the_others(tmp_path: Path) -> None:
    file = zipped(
        complete() | {"runtimes/dots.txt": b"fast", "disp_maps/dino.pfm": with_nan()}, tmp_path / "s.zip"
    )
    with zipfile.ZipFile(file) as source:
        start = source.getinfo("disp_maps/cotton.pfm").header_offset
    data = bytearray(file.read_bytes())
    data[start + 60 : start + 120] = bytes(60)
    file.write_bytes(data)
    problems = check_submission(file)
    assert {each.split(":")[0] for each in problems} == {
        "disp_maps/cotton.pfm",
        "disp_maps/dino.pfm",
        "runtimes/dots.txt",
    }


def test_what_is_no_zip_is_named(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match="no such file"):
        check_submission(tmp_path / "none.zip")
    (tmp_path / "bad.zip").write_bytes(b"PK")
    with pytest.raises(LightFieldError, match="not a readable zip"):
        check_submission(tmp_path / "bad.zip")


@pytest.fixture
def benchmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Folder with named scenes (of 32 px); the estimates are 512 px and take 1.25 s."""
    from PIL import Image

    def make(*names: str) -> Path:
        for number, name in enumerate(names):
            folder = tmp_path / "data" / ("training" if number % 2 else "") / name
            folder.mkdir(parents=True)
            for view in range(9):
                Image.new("RGB", (32, 32)).save(folder / f"input_Cam{view:03d}.png")
        return tmp_path / "data"

    def estimate(self: Cache, *arguments: Any, **options: Any) -> Found:
        return Found(np.zeros((512, 512), np.float32), None, 1.25)

    monkeypatch.setattr(Cache, "estimate", estimate)
    return make


def test_twelve_scenes_make_a_submission_that_is_accepted(
    benchmark: Callable[..., Path], tmp_path: Path
) -> None:
    made = submit(benchmark(*SCENES), tmp_path / "out", "fbs-sfa")
    assert made.scenes == SCENES
    assert made.problems == ()
    assert made.zip is not None
    assert check_submission(made.zip) == ()
    first = made.zip.read_bytes()
    submit(tmp_path / "data", tmp_path / "out", "fbs-sfa")
    assert made.zip.read_bytes() == first
    assert (tmp_path / "out" / "runtimes" / "cotton.txt").read_text() == "1.2500\n"


def test_absent_and_damaged_scenes_are_named_and_the_rest_is_made(
    benchmark: Callable[..., Path], tmp_path: Path
) -> None:
    data = benchmark("cotton", "dots")
    (find_scenes(data)["dots"] / "input_Cam004.png").write_bytes(b"")
    made = submit(data, tmp_path / "out", "fbs-sfa")
    assert (made.zip, made.scenes) == (None, ("cotton",))
    assert len(made.problems) == 11
    assert any(each.startswith("dots: ") and "input_Cam004.png" in each for each in made.problems)
    assert not (tmp_path / "out" / "submission.zip").exists()
    partial = submit(data, tmp_path / "out", "fbs-sfa", partial=True)
    assert partial.zip is not None
    assert len(check_submission(partial.zip)) == 22


def test_unusable_arguments_are_named(benchmark: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match="no such folder"):
        submit(tmp_path / "none", tmp_path / "out", "fbs")
    (tmp_path / "empty").mkdir()
    with pytest.raises(LightFieldError, match=f"download them from {submission.HOME}"):
        submit(tmp_path / "empty", tmp_path / "out", "fbs")
    with pytest.raises(LightFieldError, match="found 'fbx'"):
        submit(benchmark("cotton"), tmp_path / "out", "fbx")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not DATA.exists(), reason="no ../shared/data beside the repository")
def test_the_benchmarks_folders_are_found() -> None:
    assert list(find_scenes(DATA)) == ["backgammon", "cotton"]
    assert list(find_scenes(DATA.parent)) == ["backgammon", "cotton"]
    assert list(find_scenes(DATA / "cotton")) == ["cotton"]
