"""The command line as a person or a script meets it: output, exit status, messages, files left behind."""

import inspect
import json
import math
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import lfdepth
from lfdepth import scenes
from lfdepth.cli import main
from lfdepth.cli.experiments import reproduce
from lfdepth.cli.options import DEFAULT_METHOD
from lfdepth.errors import LightFieldError
from lfdepth.io import read_disparity, write
from lfdepth.paper.experiments import Reproduced
from lfdepth.paper.experiments import reproduce as reproduce_experiments

SIZE = 48
GRID = 5
DISPARITY = 1.0
CONFIG = f"""[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = {SIZE}
image_resolution_y_px = {SIZE}
sensor_size_mm = 35.0
[extrinsics]
num_cams_x = {GRID}
num_cams_y = {GRID}
baseline_mm = 25.0
focus_distance_m = 4.25
[meta]
disp_min = -0.5
disp_max = 1.5
"""


def make_scene(folder: Path) -> Path:
    """A benchmark folder that shows a textured plane at `DISPARITY`, with truth."""
    folder.mkdir()
    noise = np.random.default_rng(0).integers(0, 256, (SIZE // 3, SIZE // 3, 3), dtype=np.uint8)
    reference = np.asarray(Image.fromarray(noise).resize((SIZE, SIZE), Image.Resampling.BICUBIC))
    for index in range(GRID * GRID):
        v, u = index // GRID - GRID // 2, index % GRID - GRID // 2
        shift = (round(-DISPARITY * v), round(-DISPARITY * u))
        Image.fromarray(np.roll(reference, shift, (0, 1))).save(folder / f"input_Cam{index:03d}.png")
    (folder / "parameters.cfg").write_text(CONFIG)
    write(folder / "gt_disp_lowres.pfm", np.full((SIZE, SIZE), DISPARITY, np.float32))
    return folder


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene named "scene" in the current folder, so that messages do not depend on the machine."""
    monkeypatch.chdir(tmp_path)
    make_scene(tmp_path / "scene")
    return Path("scene")


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command line in this process; exit status, standard output, standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        status = main(words)
        captured = capsys.readouterr()
        errors = captured.err.replace("compiling kernels (first run only)\n", "")
        return status, captured.out, errors

    return run


Run = Callable[..., tuple[int, str, str]]


def left_behind(folder: Path = Path()) -> list[str]:
    """Everything in a folder but the scene, hidden files included."""
    return sorted(path.name for path in folder.iterdir() if path.name != "scene")


# --- what works


@pytest.mark.parametrize("ending", [".pfm", ".png", ".npy", ".npz"])
def test_estimate_finds_the_plane(scene: Path, run: Run, ending: str) -> None:
    status, out, err = run("estimate", "scene", "-o", f"map{ending}", "--preview", "preview.png")
    assert (status, err) == (0, "")
    assert read_disparity(f"map{ending}")[10:-10, 10:-10] == pytest.approx(DISPARITY, abs=0.05)
    assert "scene, 5×5 views of 48×48 px, colour" in out
    step = lfdepth.method(DEFAULT_METHOD).parameters()["step"]
    assert step is not None
    assert f"-0.5 to 1.5 px per view step, {math.ceil(2 / step) + 1} planes" in out
    assert f"map{ending}, preview.png" in out
    sidecar = ["map.json"] if ending == ".png" else []
    assert left_behind() == sorted([f"map{ending}", "preview.png", *sidecar])


def test_estimate_json_holds_every_parameter_given(scene: Path, run: Run) -> None:
    command = (
        "estimate scene -o map.pfm --method fbsocc-sfa --range -1.25 1.5 --step 0.1 --skip 2 --delta sign "
        "--threshold 0.2 --gradient sobel --radius 3 --epsilon 1e-3 --guide grey --no-subplane --threads 1 "
        "--json"
    )
    status, out, _ = run(*command.split())
    facts = json.loads(out)
    assert status == 0
    assert facts["range"] == [-1.25, 1.5]
    assert facts["planes"] == 29  # 2.75 / 0.1, rounded up, and the first
    assert facts["written"] == ["map.pfm"]
    wanted = {
        "name": "fbsocc-sfa",
        "step": 0.1,
        "skip": 2,
        "delta": "sign",
        "threshold": 0.2,
        "gradient": "sobel",
        "radius": 3,
        "epsilon": 1e-3,
        "guide": "grey",
        "subplane": False,
    }
    assert {key: facts["method"][key] for key in wanted} == wanted


def test_planes_replace_the_step(scene: Path, run: Run) -> None:
    _, out, _ = run("estimate", "scene", "-o", "map.pfm", "--planes", "21", "--json")
    facts = json.loads(out)
    assert facts["planes"] == 21
    assert facts["method"]["step"] is None


def test_preset_is_the_papers(scene: Path, run: Run) -> None:
    words = "estimate scene -o map.pfm --method fbsocc-sfa --preset paper-synthetic --json"
    _, out, _ = run(*words.split())
    method = json.loads(out)["method"]
    assert (method["step"], method["skip"]) == (0.02, 7)  # section IV of the paper


def test_planes_replace_the_presets_step_too(scene: Path, run: Run) -> None:
    words = "estimate scene -o map.pfm --method fbsocc-sfa --preset paper-synthetic --planes 21 --json"
    facts = json.loads(run(*words.split())[1])
    assert (facts["planes"], facts["method"]["step"], facts["method"]["skip"]) == (21, None, 7)


def test_estimate_finds_the_range_that_nothing_tells(scene: Path, run: Run) -> None:
    without_parameters(scene)
    _, out, _ = run("estimate", "scene", "-o", "map.pfm", "--json")
    facts = json.loads(out)
    assert facts["range_found"]
    assert facts["range"] == pytest.approx([DISPARITY] * 2, abs=0.3)  # what the automatic range promises
    assert read_disparity("map.pfm")[10:-10, 10:-10] == pytest.approx(DISPARITY, abs=0.05)
    _, text, _ = run("estimate", "scene", "-o", "map.pfm")
    assert "px per view step (estimated from the views)" in text
    for words in (["--range", "-0.5", "1.5"], []):
        if not words:
            (scene / "parameters.cfg").write_text(CONFIG)
        facts = json.loads(run("estimate", "scene", "-o", "map.pfm", *words, "--json")[1])
        assert (facts["range_found"], facts["range"]) == (False, [-0.5, 1.5])


def without_parameters(scene: Path) -> None:
    (scene / "parameters.cfg").unlink()


def test_reading_options_reach_the_reader(scene: Path, run: Run) -> None:
    without_parameters(scene)
    options = (
        "--views 3x5 --crop 4 8 40 36 --scale 0.5 --baseline-mm 25 --focal-mm 100 --sensor-mm 35 --focus-m 4"
    )
    status, out, _ = run("info", "scene", *options.split(), "--json")
    facts = json.loads(out)
    assert status == 0
    assert facts["shape"] == [5, 3, 18, 20, 3]
    assert facts["truth_range"] == [DISPARITY / 2] * 2
    wanted = {"baseline_mm": 25, "focal_length_mm": 100, "focus_distance_m": 4, "width": 20, "height": 18}
    assert {key: facts["camera"][key] for key in wanted} == wanted


def test_depth_is_that_of_the_plane(scene: Path, run: Run) -> None:
    assert run("estimate", "scene", "-o", "map.pfm", "--quantity", "depth")[0] == 0
    # b·f/p = 25 mm · 100 mm / (35/48 mm) = 3.4286 px·m; 1/Z = 1 / 3.4286 + 1/4.25
    assert read_disparity("map.pfm")[10:-10, 10:-10] == pytest.approx(1.8978, abs=0.06)


def test_metres_need_a_camera(scene: Path, run: Run) -> None:
    without_parameters(scene)
    for words in (["-o", "map.pfm", "--quantity", "depth"], ["-o", "map.ply"]):
        outcome = run("estimate", "scene", "--range", "-0.5", "1.5", *words)
        assert_refused(outcome, [words[1], "camera is unknown", "--baseline-mm", "--focus-m"])
    assert left_behind() == []


def test_convert_keeps_the_map(scene: Path, run: Run) -> None:
    values = np.linspace(-0.5, 1.5, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE)
    write("map.pfm", values)
    assert run("convert", "map.pfm", "map.npy") == (0, "written  map.npy\n", "")
    np.testing.assert_array_equal(np.load("map.npy"), values)


def picture(path: str) -> npt.NDArray[np.float64]:
    return np.asarray(Image.open(path), float)


def test_refocus_on_the_plane_is_the_reference_view(scene: Path, run: Run) -> None:
    inside = np.s_[6:-6, 6:-6]
    reference = picture("scene/input_Cam012.png")
    status, out, err = run("refocus", "scene", "--disparity", "1", "-o", "on.png", "--json")
    assert (status, err, json.loads(out)["written"]) == (0, "", ["on.png"])
    np.testing.assert_array_equal(picture("on.png")[inside], reference[inside])
    assert run("refocus", "scene", "--disparity", "0", "-o", "off.png")[0] == 0
    assert picture("off.png")[inside].std() < 0.7 * reference[inside].std()
    write("map.pfm", np.full((SIZE, SIZE), DISPARITY, np.float32))
    _, text, _ = run("refocus", "scene", "--all-in-focus", "--map", "map.pfm", "-o", "all.png")
    assert "focus    everywhere" in text
    np.testing.assert_array_equal(picture("all.png")[inside], reference[inside])


def test_refocus_sees_behind_the_foreground(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    near_square(tmp_path)
    words = ["refocus", "scene", "--disparity", "-1", "-o", "through.png"]
    assert run(*words, "--without-foreground", "0", "--map", "map.pfm")[0] == 0
    assert (picture("through.png")[8:-8, 8:-8] == 200).all()
    assert run(*words)[0] == 0
    assert picture("through.png")[22, 22].max() < 200


def near_square(folder: Path) -> np.ndarray[Any, np.dtype[np.float32]]:
    """A grey wall at −1 behind a black square of 4×4 px at 1: views in `scene`, disparities in `map.pfm`."""
    near = np.full((SIZE, SIZE), -1, np.float32)
    near[20:24, 20:24] = 1
    write(folder / "map.pfm", near)
    (folder / "scene").mkdir()
    for v in range(GRID):
        for u in range(GRID):
            view = np.full((SIZE, SIZE, 3), 200, np.uint8)
            y, x = 20 - (v - GRID // 2), 20 - (u - GRID // 2)
            view[y : y + 4, x : x + 4] = 0
            Image.fromarray(view).save(folder / "scene" / f"view_v{v:02d}_u{u:02d}.png")
    return near


def test_masks_are_where_the_views_show_the_foreground(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    near = near_square(tmp_path)
    words = ["mask", "scene", "--foreground-of", "0", "--map", "map.pfm", "--json"]
    status, out, err = run(*words, "-o", "masks")
    facts = json.loads(out)
    assert (status, err, facts["masks"], facts["written"]) == (0, "", GRID * GRID, ["masks"])
    assert facts["foreground_share"] == pytest.approx(16 / SIZE**2)
    for mask in Path("masks").glob("*.png"):
        black = picture(f"scene/{mask.name.replace('mask', 'view')}").max(axis=2) == 0
        np.testing.assert_array_equal(picture(str(mask)) == 255, black)
    assert run(*words, "-o", "masks", "--at", "1")[0] == 0  # earlier masks give way
    for mask in Path("masks").glob("*.png"):
        np.testing.assert_array_equal(picture(str(mask)) == 255, near > 0)


def test_mask_estimates_the_map_that_is_not_given(scene: Path, run: Run) -> None:
    _, out, err = run("mask", "scene", "--foreground-of", "0.5", "-o", "masks")
    assert err == ""
    assert "25, nearer than 0.5 px per view step" in out
    assert picture("masks/mask_v02_u02.png")[10:-10, 10:-10].min() == 255


def test_default_method_is_the_librarys() -> None:
    assert inspect.signature(lfdepth.estimate).parameters["method"].default == DEFAULT_METHOD


def test_evaluate_scores_a_known_error(scene: Path, run: Run) -> None:
    write("map.pfm", np.full((SIZE, SIZE), DISPARITY + 0.05, np.float32))
    status, out, err = run("evaluate", "map.pfm", "scene", "--json", "--error-map", "error.png")
    scores = json.loads(out)["scores"]
    assert (status, err) == (0, "")
    assert [scores[f"badpix_{t}"] for t in (0.01, 0.03, 0.07)] == [100, 100, 0]
    assert scores["mse_x100"] == pytest.approx(0.25, rel=1e-4)
    assert scores["q25"] == pytest.approx(5, rel=1e-4)
    assert left_behind() == ["error.png", "map.pfm"]


def test_evaluate_scores_the_confidence_that_is_stored(scene: Path, run: Run) -> None:
    error = np.linspace(0, 0.2, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE)
    np.savez("map.npz", disparity=DISPARITY + error, confidence=1 - error)
    scores = json.loads(run("evaluate", "map.npz", "scene", "--json")[1])["scores"]
    assert scores["ause_absolute"] == pytest.approx(0, abs=1e-6)  # it orders pixels as their errors do
    np.savez("map.npz", disparity=DISPARITY + error)
    assert "ause_absolute" not in json.loads(run("evaluate", "map.npz", "scene", "--json")[1])["scores"]


def test_evaluate_prints_the_figures(scene: Path, run: Run) -> None:
    write("map.pfm", np.full((SIZE, SIZE), DISPARITY + 0.05, np.float32))
    _, out, _ = run("evaluate", "map.pfm", "scene")
    assert [line.split() for line in out.splitlines()[1:6]] == [
        ["BadPix", "0.01", "100", "%"],
        ["BadPix", "0.03", "100", "%"],
        ["BadPix", "0.07", "0", "%"],
        ["MSE×100", "0.250", "px²"],
        ["Q25", "5.00", "px/100"],
    ]


def test_methods_lists_them_all(run: Run) -> None:
    _, text, _ = run("methods")
    _, out, _ = run("methods", "--json")
    names = [method["name"] for method in json.loads(out)["methods"]]
    assert {"fbs", "fbs-sfa", "fbsocc-sfa"} <= set(names)
    assert all(f"{name}: " in text for name in names)


def test_info_describes_the_scene(scene: Path, run: Run) -> None:
    _, text, _ = run("info", "scene")
    _, out, _ = run("info", "scene", "--json")
    facts = json.loads(out)
    assert facts["shape"] == [5, 5, 48, 48, 3]
    assert facts["disparity_range"] == [-0.5, 1.5]
    # b·f/p = 25 mm · 100 mm / (35/48 mm) = 3.4286 px·m; 1/Z = D / 3.4286 + 1/4.25
    assert facts["depth_range_m"] == pytest.approx([1.48634, 11.1781], rel=1e-4)
    assert facts["truth_range"] == [DISPARITY, DISPARITY]
    assert "focal length 100 mm" in text


def test_info_without_camera_range_and_truth(scene: Path, run: Run) -> None:
    without_parameters(scene)
    (scene / "gt_disp_lowres.pfm").unlink()
    status, text, _ = run("info", "scene", "--no-check")
    assert status == 0
    assert text.count("unknown") == 3
    assert "order       not checked" in text


def test_info_finds_the_range_of_a_scene_that_has_none(scene: Path, run: Run) -> None:
    without_parameters(scene)
    facts = json.loads(run("info", "scene", "--json")[1])
    assert facts["range_found"]
    assert facts["disparity_range"] == pytest.approx([DISPARITY] * 2, abs=0.3)
    assert "px per view step (estimated from the views)" in run("info", "scene")[1]


def test_info_names_the_option_that_mends_the_order(scene: Path, run: Run) -> None:
    for v in range(GRID):
        for u in range(GRID // 2):
            left, right = (scene / f"input_Cam{v * GRID + each:03d}.png" for each in (u, GRID - 1 - u))
            one, other = left.read_bytes(), right.read_bytes()
            left.write_bytes(other)
            right.write_bytes(one)
    without_parameters(scene)
    facts = json.loads(run("info", "scene", "--json")[1])
    assert facts["order"]["wrong"]
    assert facts["disparity_range"] is None
    _, text, _ = run("info", "scene")
    assert "use --flip-" in text
    assert "range       unknown: the views have to be in order first" in text
    for words in (
        ["estimate", "scene", "-o", "map.pfm"],
        ["mask", "scene", "--foreground-of", "0", "-o", "map"],
    ):
        assert_refused(
            run(*words), ["scene: views are not in the expected order", "use --flip-", "--range MIN"]
        )
    assert left_behind() == []
    mended = json.loads(run("info", "scene", "--flip-u", "--json")[1])
    assert not mended["order"]["wrong"]
    assert mended["disparity_range"] == pytest.approx([DISPARITY] * 2, abs=0.3)


@pytest.mark.parametrize(
    "command",
    [
        [],
        *(
            [name]
            for name in ("estimate", "evaluate", "methods", "info", "convert", "refocus", "mask", "demo")
        ),
    ],
)
def test_help_pages(run: Run, command: list[str]) -> None:
    status, out, err = run(*command, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(" ".join(["Usage: lfdepth", *command]))


def test_help_states_units_and_defaults(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    _, out, _ = run("estimate", "--help")
    assert "px per view step" in out
    step = lfdepth.method(DEFAULT_METHOD).parameters()["step"]
    assert f"[default: {step:g}]" in next(
        line for line in out.splitlines() if "--step" in line and "│" in line
    )


@pytest.mark.parametrize("name", lfdepth.methods.NAMES)
def test_help_shows_the_parameters_of_one_method_in_words(
    run: Run, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each parameter with its range and unit; no other method's, and nothing that only the code calls so."""
    monkeypatch.setenv("COLUMNS", "300")
    _, out, _ = run("estimate", "--method", name, "--help")
    own = lfdepth.methods.parameters_of(lfdepth.methods.method_class(name))
    for other in map(lfdepth.methods.method_class, lfdepth.methods.NAMES):
        for parameter in lfdepth.methods.parameters_of(other).values():
            told = any(line.startswith(f"│ {parameter.option} ") for line in out.splitlines())
            assert told == (parameter.name in own), parameter.option
    for parameter in own.values():
        line = next(line for line in out.splitlines() if line.startswith(f"│ {parameter.option} "))
        assert parameter.spec.text.split(".")[0].split(";")[0] in line
        assert parameter.spec.unit in line
    assert "None" not in out
    assert "_" not in out.replace("d_step", "").replace("gt_disp", "")


# --- what does not: one line that names what was found, what was expected and what to do


def truncate(path: Path, share: float = 0.5) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def save_view(scene: Path, index: int, view: npt.NDArray[Any]) -> None:
    Image.fromarray(view).save(scene / f"input_Cam{index:03d}.png")


def edit_config(scene: Path, old: str, new: str) -> None:
    path = scene / "parameters.cfg"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


Spoil = Callable[[Path], object]
BAD_SCENES: dict[str, tuple[Spoil, list[str]]] = {
    "missing view": (
        lambda s: (s / "input_Cam007.png").unlink(),
        ["scene", "1 of 25 views missing, first input_Cam007.png", "5x5", "add them"],
    ),
    "surplus view": (
        lambda s: (s / "input_Cam025.png").write_bytes((s / "input_Cam000.png").read_bytes()),
        ["scene", "1 surplus views, first input_Cam025.png", "25 views in a grid of 5x5", "remove them"],
    ),
    "other size": (
        lambda s: save_view(s, 3, np.zeros((SIZE, SIZE + 1, 3), np.uint8)),
        ["scene/input_Cam003.png", "49x48 px", "48x48 px", "the same size"],
    ),
    "other mode": (
        lambda s: save_view(s, 3, np.zeros((SIZE, SIZE), np.uint8)),
        ["scene/input_Cam003.png", "grey", "colour", "the same size and kind"],
    ),
    "truncated picture": (lambda s: truncate(s / "input_Cam004.png"), ["scene/input_Cam004.png"]),
    "no picture": (
        lambda s: (s / "input_Cam004.png").write_text("hello"),
        ["scene/input_Cam004.png"],
    ),
    "truncated truth": (lambda s: truncate(s / "gt_disp_lowres.pfm"), ["scene/gt_disp_lowres.pfm"]),
    "garbled parameters": (
        lambda s: (s / "parameters.cfg").write_text("no section\n\0"),
        ["scene/parameters.cfg", "garbled", "[intrinsics]", "restore"],
    ),
    "parameters without a number": (
        lambda s: edit_config(s, "disp_min = -0.5", "disp_min = near"),
        ["scene/parameters.cfg", "[meta] disp_min is near", "expected a number"],
    ),
    "parameters with a range reversed": (
        lambda s: edit_config(s, "disp_min = -0.5", "disp_min = 2"),
        ["scene/parameters.cfg", "[2, 1.5]", "MIN below MAX"],
    ),
    "parameters against the number of views": (
        lambda s: edit_config(s, "num_cams_x = 5", "num_cams_x = 4"),
        ["scene", "5 surplus views", "20 views in a grid of 4x5", "num_cams_x"],
    ),
    "parameters against the size": (
        lambda s: edit_config(s, "image_resolution_x_px = 48", "image_resolution_x_px = 64"),
        ["scene/input_Cam000.png", "48x48 px", "64x48", "parameters.cfg"],
    ),
}


def nan_map() -> bytes:
    values = np.ones((SIZE, SIZE), "<f4")
    values[3, 4] = np.nan
    return f"Pf\n{SIZE} {SIZE}\n-1.0\n".encode() + values.tobytes()


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scene(scene: Path, run: Run, case: str) -> None:
    spoil, parts = BAD_SCENES[case]
    spoil(scene)
    assert_refused(run("estimate", "scene", "-o", "map.pfm"), parts)
    assert left_behind() == []


BAD_OPTIONS: dict[str, list[str]] = {
    "--range 1.5 -0.5": ["range", "[1.5, -0.5]", "MIN below MAX"],
    "--range 1 1": ["range", "[1, 1]", "MIN below MAX"],
    "--range nan 1": ["range", "nan", "finite"],
    "--range -1 inf": ["range", "inf", "finite"],
    "--range 1": ["--range", "2", "see lfdepth estimate --help"],
    "--range a b": ["--range", "a", "see lfdepth estimate --help"],
    "--step 0": ["step", "0", "above 0"],
    "--step -0.1": ["step", "-0.1", "above 0"],
    "--step 0.1 --planes 9": ["step=0.1", "planes=9", "exactly one"],
    "--step 0.0001": ["20001 planes", "at most 2000", "--force"],
    "--planes 1": ["planes", "1", "at least 2"],
    "--method fbsocc-sfa --skip 0": ["skip", "found 0", "at least 1"],
    "--radius 24": ["radius", "49 px", "48×48 px", "smaller --radius"],
    "--radius 0": ["radius", "0", "from 1 to 1000"],
    "--epsilon 0": ["epsilon", "0", "above 0"],
    "--threshold 1.5": ["threshold", "1.5", "above 0 and at most 1"],
    "--delta most": ["--delta", "most", "photo", "sign", "none"],
    "--gradient prewitt": ["--gradient", "prewitt", "central", "sobel"],
    "--threads 0": ["threads", "0", "at least 1"],
    "--method sgm": ["method", "'sgm'", "fbs, fbs-sfa, fbsocc-sfa"],
    "--method fbs --photo-weight 5": ["--photo-weight", "method fbs", "--radius", "--method fbs --help"],
    "--method fbs --no-subplane": ["--no-subplane", "method fbs"],
    "--radius 2.5": ["--radius", "found '2.5'", "a whole number"],
    "--jump-penalty 3": ["jump_penalty", "found 3", "from 0 to 2"],
    "--engine abacus": ["engine", "'abacus'", "cpu, numpy"],
    "--preset mine": ["preset", "'mine'", "paper-synthetic"],
    "--quantity width": ["--quantity", "width", "disparity", "depth"],
    "--mesh": ["map.pfm", "cannot hold a mesh", ".ply"],
    "--views 3x": ["--views", "'3x'", "COLUMNSxROWS"],
    "--views 7x5": ["scene", "7 views asked for", "1 to 5", "choose fewer"],
    "--crop 0 0 49 48": ["scene", "crop 0 0 49 48", "48x48 px"],
    "--scale 2": ["scale", "2", "at most 1"],
    "--format jpeg2000": ["format 'jpeg2000'", "benchmark"],
    "--colour": ["--colour", "see lfdepth estimate --method fbs-vis --help"],
    "--preview map.jpg": ["map.jpg", "PNG", "rename"],
    "--preview none/map.png": ["none/map.png", "folder none does not exist", "create it"],
}


@pytest.mark.parametrize("options", BAD_OPTIONS)
def test_bad_option(scene: Path, run: Run, options: str) -> None:
    assert_refused(run("estimate", "scene", "-o", "map.pfm", *options.split()), BAD_OPTIONS[options])
    assert left_behind() == []


BAD_COMMANDS: dict[str, list[str]] = {
    "estimate scene": ["--output", "see lfdepth estimate --help"],
    "estimate scene other -o map.pfm": ["other", "see lfdepth estimate --help"],
    "estimate nowhere -o map.pfm": ["nowhere", "no such file or folder", "check the path"],
    "estimate scene -o map.jpg": ["map.jpg", "unknown extension .jpg", ".pfm", ".png", ".npy", ".npz"],
    "estimate scene -o map": ["map", "unknown extension", ".pfm", ".png", ".npy", ".npz"],
    "estimate scene -o none/map.pfm": ["none/map.pfm", "folder none does not exist", "create it"],
    "estimate scene -o scene/parameters.cfg/map.pfm": ["folder scene/parameters.cfg does not exist"],
    "estimate scene -o map.png --preview map.png": ["map.png", "two different files", "rename"],
    "refocus scene -o out.png": ["--disparity D", "--all-in-focus", "give one"],
    "refocus scene --disparity 1 --all-in-focus -o out.png": ["either", "give one"],
    "refocus scene --all-in-focus --without-foreground 1 -o out.png": ["leave one out"],
    "refocus scene --all-in-focus --map map.pfm -o out.png": ["map.pfm", "no such file"],
    "refocus scene --disparity 1 --map map.pfm -o out.png": ["--map", "--without-foreground"],
    "refocus scene --disparity 900 -o out.png": ["disparity", "900", "less than 48 px", "lfdepth info"],
    "refocus scene --all-in-focus --method sgm -o out.png": ["method", "'sgm'", "fbs-vis"],
    "refocus scene --all-in-focus --map m.pfm --method fbs -o out.png": [
        "--method",
        "--map",
        "leave one out",
    ],
    "mask scene --foreground-of 0 --map m.pfm --range 0 1 -o out": ["--range", "--map", "leave one out"],
    "mask scene --foreground-of 0 --map scene/gt_disp_lowres.pfm --at -48 -o out": ["at", "-48", "48 px"],
    "refocus scene --disparity nan -o out.png": ["disparity", "nan", "finite"],
    "refocus scene --disparity 1 -o out.jpg": ["out.jpg", ".png", "rename"],
    "refocus scene --disparity 1 -o none/out.png": ["folder none does not exist"],
    "refocus scene --disparity 1 --without-foreground 0 -o out.png": ["without_foreground", "raise it"],
    "mask scene -o out": ["--foreground-of", "see lfdepth mask --help"],
    "mask scene --foreground-of 0 -o scene": ["scene", "is a folder with other content", "choose another"],
    "mask scene --foreground-of 0 -o scene/parameters.cfg": ["is a file", "choose another"],
    "mask scene --foreground-of 0 --map map.pfm -o out": ["map.pfm", "no such file"],
    "evaluate map.pfm scene": ["map.pfm", "no such file", "check the path"],
    "evaluate scene/input_Cam000.png scene": ["scene/input_Cam000.png", "16-bit grey", "preview"],
    "evaluate scene/parameters.cfg scene": ["scene/parameters.cfg", "unknown extension .cfg", ".pfm"],
    "info nowhere": ["nowhere", "no such file or folder", "check the path"],
    "estimat scene": ["estimat", "see lfdepth --help"],
    "bench -o out": ["nothing to run", "name them"],
    "bench scene -o out --methods sgm": ["sgm", "fbs-sfa"],
    "bench scene -o out --methods fbs:step": ["fbs:step", "METHOD:NAME=VALUE"],
    "bench --plan no.toml -o out": ["no.toml", "No such file"],
    "reproduce figure3 -o out": ["'figure3'", "figure2, figure4"],
    "submit": ["DATA", "--check ZIP"],
    "submit nowhere -o out": ["nowhere", "no such folder", "check the path"],
    "submit --check scene/parameters.cfg": ["scene/parameters.cfg", "not a readable zip"],
    "scenes render nowhere -o out": ["'nowhere'", "bars"],
    "demo --size 40": ["size", "40", "at least 64 px"],
    "demo -o scene/parameters.cfg": ["scene/parameters.cfg", "folder"],
}


@pytest.mark.parametrize("command", BAD_COMMANDS)
def test_bad_command(scene: Path, run: Run, command: str) -> None:
    assert_refused(run(*command.split()), BAD_COMMANDS[command])
    assert left_behind() == []


def test_range_is_asked_for_where_views_do_not_tell_it(scene: Path, run: Run) -> None:
    without_parameters(scene)
    for index in range(GRID * GRID):
        save_view(scene, index, np.full((SIZE, SIZE, 3), 128, np.uint8))
    assert_refused(run("estimate", "scene", "-o", "map.pfm"), ["scene", "texture", "--range MIN MAX"])
    assert run("estimate", "scene", "-o", "map.pfm", "--range", "-0.5", "1.5")[0] == 0
    status, text, _ = run("info", "scene")
    assert status == 0
    assert "range       unknown: scene: views agree on no disparity" in text


def test_missing_library_is_named_before_the_work(
    scene: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lfdepth, "read", None, raising=False)  # would be called next
    for ending, package in (
        (".tif", "tifffile"),
        (".exr", "OpenEXR"),
        (".zarr", "zarr"),
    ):
        monkeypatch.setitem(sys.modules, package, None)
        outcome = run("estimate", "scene", "-o", f"map{ending}")
        assert_refused(outcome, [f"map{ending}", package, "not installed", f"lfdepth[{ending[1:4]}"])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_pipes_and_devices_are_not_replaced(scene: Path, run: Run) -> None:
    os.mkfifo("pipe")
    Path("map.pfm").symlink_to("pipe")
    Path("null.pfm").symlink_to(os.devnull)
    for name in ("map.pfm", "null.pfm"):
        assert_refused(run("estimate", "scene", "-o", name), [name, "device or a pipe", "choose another"])
    assert Path("pipe").is_fifo()
    assert not Path(os.devnull).is_file()


@pytest.mark.slow
def test_force_allows_many_planes(scene: Path, run: Run) -> None:
    window = ("--crop", "12", "12", "24", "24")
    status, out, _ = run(
        "estimate", "scene", "-o", "map.pfm", *window, "--planes", "2001", "--force", "--json"
    )
    assert status == 0
    assert json.loads(out)["planes"] == 2001


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"Pf\n48 48\n-1.0\n" + b"\xff" * (4 * 48 * 48), ["scene", "no finite value"]),
        (nan_map()[:-9], ["map.pfm", "expected"]),
        (b"Pf\n8 8\n-1.0\n" + bytes(256), ["8x8 px", "48x48 px", "scene"]),
        (b"P6 no map", ["map.pfm", "expected"]),
    ],
    ids=["all NaN", "truncated", "other size", "no map"],
)
def test_bad_result(scene: Path, run: Run, content: bytes, parts: list[str]) -> None:
    Path("map.pfm").write_bytes(content)
    assert_refused(run("evaluate", "map.pfm", "scene", "--error-map", "error.png"), parts)
    assert left_behind() == ["map.pfm"]


def test_a_pixel_without_a_value_is_bad_and_counted(scene: Path, run: Run) -> None:
    values = read_disparity(scene / "gt_disp_lowres.pfm")[::-1].astype("<f4")
    values[20, 24] = np.nan
    Path("map.pfm").write_bytes(f"Pf\n{SIZE} {SIZE}\n-1.0\n".encode() + values.tobytes())
    status, out, err = run("evaluate", "map.pfm", "scene", "--error-map", "error.png", "--json")
    assert (status, err) == (0, "")
    facts = json.loads(out)
    assert facts["invalid_pixels"] == 1
    assert facts["scores"]["badpix_0.07"] == pytest.approx(100 / (SIZE - 30) ** 2)
    assert Path("error.png").exists()


def test_a_mask_of_another_size_is_left_out_and_named(scene: Path, run: Run) -> None:
    write("map.pfm", np.zeros((SIZE, SIZE), np.float32))
    Image.new("L", (4, 5)).save(scene / "mask_planes_lowres.png")
    status, out, err = run("evaluate", "map.pfm", "scene", "--json")
    assert status == 0
    assert err == "mask left out: scene/mask_planes_lowres.png: 4x5 px; expected 48x48 px; replace it\n"
    assert "mask_planes_lowres.png: 4x5 px" in json.loads(out)["missing"]["bumpiness_planes"]


def test_evaluate_without_truth(scene: Path, run: Run) -> None:
    write("map.pfm", np.zeros((SIZE, SIZE), np.float32))
    (scene / "gt_disp_lowres.pfm").unlink()
    assert_refused(run("evaluate", "map.pfm", "scene"), ["scene", "no truth", "gt_disp_lowres.pfm"])


def assert_refused(outcome: tuple[int, str, str], parts: list[str]) -> None:
    """Exit status 2, nothing on standard output, one line on standard error that holds the parts."""
    status, out, err = outcome
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    for part in parts:
        assert part in err


# --- many estimates


def test_bench_goes_on_past_a_scene_that_fails(scene: Path, run: Run) -> None:
    methods = ["--methods", "fbs", "fbs-sfa:step=0.1"]
    status, out, err = run("bench", "scene", "nowhere", "-o", "out", *methods, "--no-published", "--json")
    assert status == 1
    assert err.startswith("failed: nowhere: ")
    assert err.count("\n") == 1
    results = json.loads(out)["results"]
    assert [(each["scene"], each["method"]) for each in results] == [
        ("scene", "fbs"),
        ("scene", "fbs-sfa:step=0.1"),
    ]
    _, scores, _ = run_scores(run)
    assert results[0]["scores"]["badpix_0.07"] == pytest.approx(scores["badpix_0.07"])
    assert {"report.html", "results.csv", "results.json", "results.md"} <= {
        path.name for path in Path("out").iterdir()
    }


def run_scores(run: Run) -> tuple[int, dict[str, float], str]:
    """Scores of `fbs` on the scene by the two usual commands."""
    run("estimate", "scene", "-o", "fbs.npy", "--method", "fbs")
    status, out, err = run("evaluate", "fbs.npy", "scene", "--json")
    return status, json.loads(out)["scores"], err


def test_bench_prints_its_main_tables(scene: Path, run: Run) -> None:
    _, out, err = run("bench", "scene", "-o", "out", "--methods", "fbs")
    assert err == ""
    assert "### BadPix 0.07 (%)" in out
    assert "### MSE×100 (px²)" in out
    assert out.endswith(f"written  {Path('out/report.html')}\n")


def test_bench_reads_a_plan(scene: Path, run: Run) -> None:
    Path("plan.toml").write_text('scenes = ["scene"]\nmethods = ["fbs"]\n')
    status, out, _ = run("bench", "--plan", "plan.toml", "-o", "out", "--json")
    assert status == 0
    assert [each["method"] for each in json.loads(out)["results"]] == ["fbs"]


def test_reproduce_says_what_was_made_and_what_not(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def pretend(experiments: Sequence[str], out: Path, **options: object) -> Reproduced:
        asked.extend([*experiments, out, options["data"], options["external"]])
        return Reproduced([out / "table1.md"], ["dino: get it there"], ["figure8: bikes: too dark"])

    monkeypatch.setattr("lfdepth.paper.experiments.reproduce", pretend)
    command = "reproduce table1 figure8 -o out --data there --external a b"
    status, out, err = run(*command.split())
    assert asked == ["table1", "figure8", Path("out"), Path("there"), (Path("a"), Path("b"))]
    assert out == f"missing  dino: get it there\nwritten  {Path('out/table1.md')}\n"
    assert (status, err) == (1, "failed: figure8: bikes: too dark\n")


def test_default_range_of_real_scenes_is_the_librarys() -> None:
    library = inspect.signature(reproduce_experiments).parameters["real_range"].default
    assert inspect.signature(reproduce).parameters["real_range"].default == library


def test_submit_checks_a_zip(scene: Path, run: Run) -> None:
    with zipfile.ZipFile("mine.zip", "w") as archive:
        archive.writestr("runtimes/cotton.txt", "soon")
    status, out, err = run("submit", "--check", "mine.zip")
    assert status == 1
    assert "mine.zip: " in out
    assert "failed: runtimes/cotton.txt: found 'soon'" in err
    assert "failed: disp_maps/dino.pfm: missing" in err


def test_submit_names_the_scenes_that_are_absent(scene: Path, run: Run) -> None:
    Path("data").mkdir()
    scene.rename("data/cotton")
    status, out, err = run("submit", "data", "-o", "out", "--method", "fbs", "--json")
    assert status == 1
    assert json.loads(out)["zip"] is None
    assert "failed: dino: no folder of that name below data" in err


def test_scenes_are_listed_and_written(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _, out, _ = run("scenes", "list", "--json")
    assert list(json.loads(out)) == [*scenes.NAMES, *scenes.PHOTOREAL]
    command = "scenes render bars -o new/rendered --size 48 --views 3x5 --seed 2 --noise 1"
    status, out, err = run(*command.split())
    assert (status, out, err) == (0, f"written  {Path('new/rendered/bars')}\n", "")
    wanted = scenes.render("bars", size=48, views=(5, 3), seed=2, noise=1)
    np.testing.assert_array_equal(lfdepth.read("new/rendered/bars").views, wanted.views)


# --- breaks: nothing half-written stays, and what was there before does


def test_full_disk(scene: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("map.npy").write_text("of yesterday")

    def save(file: IO[bytes], _: object) -> None:
        file.write(b"half a ma")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", save)
    parts = ["map.npy", "No space left on device", "free space"]
    assert_refused(run("estimate", "scene", "-o", "map.npy"), parts)
    assert left_behind() == ["map.npy"]
    assert Path("map.npy").read_text() == "of yesterday"


def test_folder_that_may_not_be_written(scene: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    parts = ["map.pfm", "Permission denied", "writable folder"]
    assert_refused(run("estimate", "scene", "-o", "map.pfm"), parts)


def test_file_error_from_anywhere_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, **_: object) -> None:
        raise OSError(5, "Input/output error", str(path))

    monkeypatch.setattr(lfdepth, "read", fail, raising=False)
    assert_refused(run("info", "scene"), ["scene: Input/output error"])


def test_too_little_memory_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, **_: object) -> None:
        raise MemoryError("Unable to allocate 64 GiB")

    monkeypatch.setattr(lfdepth, "read", fail, raising=False)
    assert_refused(run("info", "scene"), ["not enough memory", "64 GiB", "smaller views"])


def test_nowhere_to_keep_kernels_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, **_: object) -> None:
        raise RuntimeError("cannot cache function 'vote': no locator available for file 'voting.py'")

    monkeypatch.setattr(lfdepth, "read", fail, raising=False)
    assert_refused(run("info", "scene"), ["compiled kernels", "set NUMBA_CACHE_DIR"])


def test_interrupted_while_writing(scene: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def save(file: IO[bytes], _: object) -> None:
        file.write(b"half a ma")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "save", save)
    assert run("estimate", "scene", "-o", "map.npy") == (130, "", "interrupted\n")
    assert left_behind() == []


class Finalized:
    """What a library may have at work when Ctrl-C is pressed: Python goes on after what is raised in it."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def lost_in_a_finalizer(*_: object, **__: object) -> None:
    began = time.perf_counter()
    Finalized()
    while time.perf_counter() < began + 20:
        time.sleep(1)


def caught_by_a_library(*_: object, **__: object) -> None:
    with suppress(BaseException):
        signal.raise_signal(signal.SIGINT)
    raise LightFieldError("scene: not readable")


@pytest.mark.parametrize("act", [lost_in_a_finalizer, caught_by_a_library])
def test_ctrl_c_is_never_lost(scene: Path, run: Run, monkeypatch: pytest.MonkeyPatch, act: Any) -> None:
    handler, hook = signal.signal(signal.SIGINT, signal.default_int_handler), sys.unraisablehook
    monkeypatch.setattr(lfdepth, "read", act, raising=False)
    began = time.perf_counter()
    try:
        assert run("info", "scene") == (130, "", "interrupted\n")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert sys.unraisablehook is hook
    finally:
        signal.signal(signal.SIGINT, handler)
    assert time.perf_counter() < began + 10  # at once, and not when the work was done


# --- as a process of its own


def process(*words: str, **variables: str) -> subprocess.Popen[str]:
    # A bare interpreter may have cwd first on its path: -P keeps it out.
    command = [sys.executable, "-P", "-c", "import sys; from lfdepth.cli import main; sys.exit(main())"]
    return subprocess.Popen(
        [*command, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONUTF8": "1", **variables},
    )


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for a single process")
def test_ctrl_c_while_kernels_compile(scene: Path, tmp_path: Path) -> None:
    cold = str(tmp_path / "scene" / "cache")
    child = process("estimate", "scene", "-o", "map.pfm", NUMBA_CACHE_DIR=cold)
    assert child.stderr is not None
    assert child.stderr.readline() == "compiling kernels (first run only)\n"
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=120)
    assert (child.returncode, out, err) == (130, "", "interrupted\n")
    assert left_behind() == []


def test_json_is_all_there_is_on_standard_output(scene: Path) -> None:
    child = process("estimate", "scene", "-o", "map.pfm", "--json")
    out, _ = child.communicate(timeout=300)
    assert child.returncode == 0
    assert json.loads(out)["written"] == ["map.pfm"]


def test_reader_that_leaves_early(scene: Path) -> None:
    child = process("methods")
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.close()
    assert child.stderr.read() == ""
    child.wait(timeout=60)


@pytest.mark.parametrize("words", ["--help", "estimate --help", "methods"])
def test_help_loads_nothing_heavy(words: str) -> None:
    heavy = "{'numba', 'matplotlib', 'scipy', 'PIL', 'imagecodecs', 'h5py'}"
    code = (
        f"import sys; from lfdepth.cli import main; main({words.split()}); print({heavy} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "set()"
