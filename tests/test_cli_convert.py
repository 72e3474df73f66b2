"""`lfdepth convert` as a person meets it: what it writes, prints and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import h5py  # type: ignore[import-untyped]
import numpy as np
import pytest
from PIL import Image

import lfdepth
from lfdepth.cli import main
from lfdepth.io import read_confidence, read_record, write
from lfdepth.io.record import Record
from test_cli import SIZE, make_scene


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A benchmark folder named "scene" in the current folder."""
    monkeypatch.chdir(tmp_path)
    make_scene(tmp_path / "scene")
    return Path("scene")


class Run:
    """Runs a command line in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *words: str) -> str:
        """Standard output of a command that has to work, without complaints."""
        status = main(words)
        captured = self.capsys.readouterr()
        assert (status, captured.err.replace("compiling kernels (first run only)\n", "")) == (0, "")
        return captured.out

    def refused(self, *words: str) -> str:
        """The one line that explains why a command does not work."""
        status = main(words)
        captured = self.capsys.readouterr()
        assert (status, captured.out) == (2, "")
        assert captured.err.startswith("error: ")
        assert captured.err.count("\n") == 1
        return captured.err


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    return Run(capsys)


# --- light fields


@pytest.mark.parametrize(
    "name", ["x.npz", "x.npy", "x.h5", "x.zarr", "x.mat", "x.tif", "folder", "my folder ä/"]
)
def test_a_scene_keeps_views_camera_and_range(scene: Path, run: Run, name: str) -> None:
    out = run("convert", "scene", "-o", name)
    assert "scene, 5×5 views of 48×48 px, colour" in out
    found, lf = lfdepth.read(name), lfdepth.read(scene)
    np.testing.assert_array_equal(found.views, lf.views)
    assert (found.camera, found.disparity_range) == (lf.camera, lf.disparity_range)
    run("convert", "scene", name)  # replaces its own; the target may also come second


def test_a_part_of_a_scene(scene: Path, run: Run) -> None:
    words = ["--views", "3x5", "--crop", "8", "4", "20", "16", "--flip-u", "--json"]
    facts = json.loads(run("convert", "scene", "-o", "part.npz", *words))
    assert facts == {
        "scene": "scene",
        "shape": [5, 3, 16, 20, 3],
        "absent_views": 0,
        "white_level": None,
        "remarks": [],
        "written": ["part.npz"],
    }
    whole = lfdepth.read(scene).views[:, ::-1]
    np.testing.assert_array_equal(lfdepth.read("part.npz").views, whole[:, 1:4, 4:20, 8:28])


def test_one_number_is_a_square_grid_of_views(scene: Path, run: Run) -> None:
    run("convert", "scene", "-o", "square.npz", "--views", "3")
    np.testing.assert_array_equal(lfdepth.read("square.npz").views, lfdepth.read(scene).views[1:4, 1:4])
    run("scenes", "render", "bars", "-o", "rendered", "--size", "48", "--views", "3")
    assert lfdepth.read("rendered/bars").shape[:2] == (3, 3)


def test_hdf5_becomes_a_benchmark_folder(scene: Path, run: Run) -> None:
    with h5py.File("buddha.h5", "w") as file:
        file["LF"] = lfdepth.read(scene).views
    words = ["convert", "buddha.h5", "-o", "b", "--to", "benchmark"]
    assert "b: the camera is unknown, but parameters.cfg needs it" in run.refused(*words)
    camera = ["--baseline-mm", "10", "--focal-mm", "50", "--sensor-mm", "36", "--focus-m", "2"]
    run(*words, "--range", "-1", "2", *camera)
    lf = lfdepth.read("b", format="benchmark")
    np.testing.assert_array_equal(lf.views, lfdepth.read(scene).views)
    assert lf.disparity_range == (-1, 2)
    assert lf.camera is not None
    assert lf.camera.baseline_mm == 10
    np.testing.assert_array_equal(
        np.asarray(Image.open("b/input_Cam007.png")), np.asarray(Image.open("scene/input_Cam007.png"))
    )


def test_float_views_become_eight_bit_pictures(scene: Path, run: Run) -> None:
    lf = lfdepth.read(scene)
    write("float.npz", lf.with_samples("float32"))
    words = ["convert", "float.npz", "-o", "b", "--to", "benchmark"]
    assert "b: float views; expected 8 or 16 bits; convert them (--samples uint16)" in run.refused(*words)
    run(*words, "--samples", "uint8")
    np.testing.assert_array_equal(lfdepth.read("b").views, lf.views)
    assert "uint32" in run.refused(*words, "--samples", "uint32")


def test_a_range_that_is_needed_is_found(scene: Path, run: Run) -> None:
    lf = lfdepth.read(scene)
    write("plain.npz", lfdepth.LightField(lf.views, lf.camera))
    run("convert", "plain.npz", "-o", "b", "--to", "benchmark")
    assert lfdepth.read("b").disparity_range == pytest.approx((1, 1), abs=0.3)


def test_a_row_becomes_a_quilt(scene: Path, run: Run) -> None:
    assert "call it row_qs5x1a1.png" in run.refused("convert", "scene", "-o", "row.png", "--views", "5x1")
    run("convert", "scene", "-o", "row_qs5x1a1.png", "--views", "5x1")
    quilt = np.asarray(Image.open("row_qs5x1a1.png"))
    np.testing.assert_array_equal(quilt, np.hstack(list(lfdepth.read(scene).views[2])))


def test_estimates_of_both_are_the_same(scene: Path, run: Run) -> None:
    run("convert", "scene", "-o", "x.h5")
    for source in ("scene", "x.h5"):
        run("estimate", source, "-o", f"{Path(source).stem}.npy", "--method", "fbs-sfa")
    np.testing.assert_array_equal(np.load("scene.npy"), np.load("x.npy"))


# --- maps


RECORD = Record(
    np.linspace(-0.5, 1.5, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE),
    confidence=np.linspace(0, 1, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE),
    range=(-0.5, 1.5),
    runtime=2.5,
    parameters=json.dumps({"name": "fbs", "step": 0.02}),
)


def test_all_that_is_known_of_a_map_is_carried_along(scene: Path, run: Run) -> None:
    write("a.npz", RECORD)
    run("convert", "a.npz", "-o", "b.zarr")
    run("convert", "b.zarr", "-o", "c.npz")
    found = read_record("c.npz")
    assert (found.range, found.runtime, found.parameters) == (RECORD.range, RECORD.runtime, RECORD.parameters)
    np.testing.assert_array_equal(found.values, RECORD.values)
    run("convert", "c.npz", "-o", "d.exr")
    run("convert", "d.exr", "-o", "e.ply", "--scene", "scene")
    assert b"property float confidence" in Path("e.ply").read_bytes()[:500]


@pytest.mark.parametrize("ending", ["npz", "zarr", "exr"])
def test_confidence_is_read_from_every_format_that_has_it(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"map.{ending}"
    write(path, RECORD)
    np.testing.assert_array_equal(np.asarray(read_confidence(path)), np.asarray(RECORD.confidence))
    write(path, RECORD.values)
    assert read_confidence(path) is None


@pytest.mark.parametrize("ending", ["pfm", "png", "npy", "tif"])
def test_bare_maps_have_no_confidence(tmp_path: Path, ending: str) -> None:
    write(tmp_path / f"map.{ending}", RECORD)
    assert read_confidence(tmp_path / f"map.{ending}") is None


@pytest.mark.parametrize("ending", ["pfm", "png", "npy", "npz", "tif", "exr", "zarr"])
def test_maps_are_told_from_light_fields(scene: Path, run: Run, ending: str) -> None:
    write(f"map.{ending}", RECORD)
    run("convert", f"map.{ending}", "-o", "out.npy")
    scale = 2 / 65535 if ending == "png" else 0
    assert np.abs(np.load("out.npy") - RECORD.values).max() <= scale
    words = ["convert", f"map.{ending}", "-o", "out", "--to", "benchmark"]
    assert "is a map; --to, --samples and --range expected a light field" in run.refused(*words)
    assert "is a map" in run.refused("convert", f"map.{ending}", "-o", "out.npy", "--samples", "uint8")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("convert nowhere -o x.npz", "nowhere: no such file or folder"),
        ("convert scene -o x.jpg", "x.jpg: unknown extension .jpg for a light field; expected one of .npz"),
        ("convert scene -o scene", "scene: is a folder with other content"),
        ("convert scene -o x --to mov", "format 'mov': not written; expected one of folder, benchmark"),
        ("convert scene -o x.mat --mesh", "--mesh: the source is a light field; expected a disparity map"),
        ("convert scene -o x.h5 --quantity depth", "--quantity: the source is a light field"),
        ("convert scene -o x.npz --range 2 1", "found [2, 1], expected MIN below MAX"),
        ("convert scene -o none/x.npz", "folder none does not exist"),
        ("convert scene -o x.h5 --format npy", "scene: "),
    ],
)
def test_what_is_refused(scene: Path, run: Run, words: str, message: str) -> None:
    assert message in run.refused(*words.split())
    assert [entry.name for entry in Path().iterdir()] == ["scene"]
