"""Compiled kernels are kept, and made anew when anything that they use changes."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core import caching

import lfdepth
from lfdepth.engines.cpu import compilation

PROGRAM = """
import numpy as np
from lfdepth.engines.cpu import compilation
from lfdepth.engines.cpu.kernels import energy, noise

compiled = []
with compilation.on_compilation(lambda: compiled.append(1)):
    levels = np.zeros((1, 1), np.uint8)
    energy.store_photo_kernel(0, 1, np.ones((1, 1), np.float32), levels)
    views = np.zeros((1, 1, 2, 2, 1), np.uint8)
    views[0, 0] = 8
    others = (np.ones((1, 1), np.bool_), np.zeros((1, 1, 2)))
    nowhere, plane, least = np.zeros(1, np.int64), np.zeros(1), np.full(1, np.inf, np.float32)
    noise.residual_kernel(0, 1, views, np.zeros((2, 2, 1), np.uint8), others, nowhere, nowhere, plane, least)
print(int(levels[0, 0]), float(least[0]), bool(compiled))
"""
"""Prints the level of share 1, the difference of grey level 8 to 0, and whether anything was compiled."""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package."""
    there = tmp_path / "there" / "lfdepth"
    shutil.copytree(Path(lfdepth.__file__).parent, there, ignore=shutil.ignore_patterns("__pycache__"))
    return there


def run(package: Path, **variables: str) -> tuple[float, float, bool]:
    env = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    env |= {"PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1", **variables}
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM], env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    level, difference, compiled = done.stdout.split()
    return float(level), float(difference), compiled == "True"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
def test_a_changed_constant_or_callee_in_another_file_counts(package: Path, tmp_path: Path) -> None:
    """Level and difference follow from what the files say: 255·1, |8 − 0|; then 100·1, |2·8 − 0|."""
    cache = tmp_path / "kernels"
    assert run(package, NUMBA_CACHE_DIR=str(cache)) == (255, 8, True)
    assert run(package, NUMBA_CACHE_DIR=str(cache)) == (255, 8, False)
    edit(package / "engines" / "layout.py", "SHARE_LEVELS = 255", "SHARE_LEVELS = 100")
    sampling = package / "engines" / "cpu" / "kernels" / "sampling.py"
    edit(sampling, "upper + fy * (lower - upper)", "2 * (upper + fy * (lower - upper))")
    earlier = list(cache.iterdir())
    assert len(earlier) == 1
    os.utime(earlier[0], (time.time() - 30 * 86400,) * 2)
    assert run(package, NUMBA_CACHE_DIR=str(cache)) == (100, 16, True)
    # The folder of the earlier state, unused for a month, is gone.
    assert len(list(cache.iterdir())) == 1
    assert list(cache.iterdir()) != earlier


def test_kernels_lie_beside_the_package(package: Path) -> None:
    assert run(package)[2]
    kept = package / "engines" / "cpu" / "kernels" / "__pycache__"
    assert [folder.name.split("-")[0] for folder in kept.iterdir() if any(folder.rglob("*.nbi"))] == [
        "lfdepth"
    ]


@pytest.mark.skipif(os.name == "nt", reason="a file cannot stand in for a folder that is not writable")
def test_kernels_of_an_installation_that_cannot_be_written(package: Path, tmp_path: Path) -> None:
    """They go to the user's caches; where these cannot be written either, numba says so."""
    (package / "engines" / "cpu" / "kernels" / "__pycache__").write_text("no folder")
    (tmp_path / "mine").mkdir()
    assert run(package, XDG_CACHE_HOME=str(tmp_path / "mine"))[2]
    assert list((tmp_path / "mine" / "lfdepth").rglob("*.nbi"))
    nowhere = {"XDG_CACHE_HOME": str(tmp_path / "file"), "HOME": str(tmp_path / "file")}
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(AssertionError, match="cannot cache function"):
        run(package, **nowhere)


def test_the_digest_covers_all_that_kernels_import() -> None:
    """Kernels take nothing from files of the package that are not part of the digest."""
    sources = {path.resolve() for path in compilation.sources()}
    package = Path(lfdepth.__file__).parent
    for path in (package / "engines" / "cpu" / "kernels").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lfdepth."):
                assert (
                    package.parent.joinpath(*str(node.module).split(".")).with_suffix(".py").resolve()
                    in sources
                )


def test_kernels_that_two_processes_compile_at_once_keep_apart(tmp_path: Path) -> None:
    """One saves while the other is half done, by an index that it read before: neither gets the other's."""
    kind = compilation.one_file_each(caching.IndexDataCacheFile)
    one, other, later = (kind(str(tmp_path), "kernel", "stamp") for _ in range(3))
    save_data, other._load_index = one._save_data, dict

    def save_and_wait(name: str, data: str) -> None:
        other.save("float32", "code for float32")
        save_data(name, data)

    one._save_data = save_and_wait
    one.save("uint8", "code for uint8")
    assert later.load("float32") == "code for float32"
    assert later.load("uint8") == "code for uint8"
