"""Commands that are killed or run out of disk: a few rounds of benchmarks/survival.py."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

import survival_run
from lfdepth.io import atomic
from survival_run import COMMANDS, Report, Trial, changing_input, disk_sizes, prepare, random_fates, read_only

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks, pipes and limits as Linux has them")
FEW = (
    "estimate map.png",
    "estimate map.zarr",
    "convert x.npy",
    "convert x.h5",
    "convert folder",
    "bench",
    "scenes render",
)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return prepare(tmp_path_factory.mktemp("survival"))


@pytest.mark.thin(2)
@pytest.mark.parametrize("name", FEW)
def test_the_old_result_or_the_new_one(data: Path, tmp_path: Path, name: str) -> None:
    trial, report, random = Trial(COMMANDS[name], data, tmp_path), Report(), Random(name)
    for what, fate in random_fates(trial, 1, 2, random):
        trial.kill(fate, report, what)
    for size in disk_sizes(trial, 2, random):
        trial.fill_disk(size, report)
    trial.race(report)
    assert report.problems == []
    assert report.outcomes["killed"] >= 2
    assert report.outcomes["neither"] == 0


def test_input_that_changes(data: Path, tmp_path: Path) -> None:
    report = Report()
    changing_input(data, tmp_path, 2, report)
    assert report.problems == []
    assert report.outcomes["read"] + report.outcomes["refused"] == 10


def test_read_only_folders(data: Path, tmp_path: Path) -> None:
    report = Report()
    read_only(data, tmp_path, report)
    assert report.problems == []


def test_a_zarr_without_space_is_one_line(tmp_path: Path) -> None:
    """As a process that ends as others do: Zarr leaves nothing behind that Python complains of at the end."""
    np.save(tmp_path / "x.npy", np.random.default_rng(0).integers(0, 256, (5, 5, 60, 60, 3)).astype(np.uint8))
    code = "import sys; from lfdepth.cli import main; sys.exit(main())"
    words = ["convert", str(tmp_path / "x.npy"), "-o", str(tmp_path / "x.zarr")]
    for size in (0, 700):
        done = subprocess.run(
            [sys.executable, "-c", code, *words],
            preexec_fn=survival_run.little_disk(size),
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["x.npy"]


def write_in_place(path: Any) -> Any:
    """What `atomic` must not be: a context that gives the target itself."""

    class InPlace:
        def __enter__(self) -> Path:
            return Path(path)

        def __exit__(self, *_: object) -> None:
            return None

    return InPlace()


def test_writing_in_place_is_seen(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from lfdepth.io import pfm

    trial, report = Trial(COMMANDS["estimate map.pfm"], data, tmp_path), Report()
    monkeypatch.setattr(pfm, "atomic", write_in_place)
    trial.fill_disk(100, report)
    assert any("neither" in problem for problem in report.problems)


def test_a_folder_that_is_replaced_in_two_steps_is_seen(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atomic, "_exchange", lambda first, second: False)
    trial, report = Trial(COMMANDS["convert folder"], data, tmp_path), Report()
    for operation in range(trial.operations - 10, 0, -1):  # the last ones remove the old folder
        trial.kill(survival_run.killed_before(operation), report, str(operation))
        if report.problems:
            break
    assert any("neither" in problem for problem in report.problems)
