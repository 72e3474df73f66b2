"""The commands. Each one is a call of the library between reading its arguments and printing its result."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lfdepth import methods
from lfdepth.cli.app import app
from lfdepth.cli.options import (
    AS_IT_IS,
    DEFAULT_METHOD,
    UNCHANGED,
    Flag,
    Json,
    MethodParameters,
    Output,
    Range,
    ReadingParameters,
    check_picture,
    given,
)
from lfdepth.cli.printing import estimate_facts, estimate_text, methods_text, report, scene_facts, scene_text
from lfdepth.demo import SIZE, run_demo
from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField

DEMO_FOLDER = Path("lfdepth-demo")

Quantity = Literal["disparity", "depth"]


@app.command(sort_key=1)
def estimate(
    scene: Path,
    /,
    *,
    output: Output,
    method: str = DEFAULT_METHOD,
    preset: str | None = None,
    range: Range = None,
    preview: Path | None = None,
    quantity: Quantity = "disparity",
    mesh: Flag = False,
    threads: int | None = None,
    force: Flag = False,
    as_json: Json = False,
    options: MethodParameters = UNCHANGED,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Estimate the disparity map of a light field's reference view.

    Disparity is in px per view step, positive = nearer than the focus distance. For example:

        lfdepth estimate cotton -o cotton.pfm --preview cotton.png
        lfdepth estimate cotton -o cotton.npz --range -1.6 1.5 --step 0.02
        lfdepth estimate cotton -o cotton.npy --preset paper-synthetic

    Parameters
    ----------
    scene
        Light field: a folder of views such as those of the 4D Light Field Benchmark, or a file.
    output
        Map to write; the ending picks the format: .pfm, .npy, .tif, .exr, .png (16 bits, its scale in a .json
        beside it), .npz or .zarr (disparity, confidence, parameters), .ply (points in metres).
    method
        Name of the method; "lfdepth methods" lists them.
    preset
        Parameters of the paper's experiments: paper-synthetic (step 0.02, J 7), paper-real (step 0.05, J 5).
    range
        Smallest and largest disparity, px per view step; the scene's own by default.
    preview
        Also write a colour-mapped picture of the disparity with a scale bar, .png.
    quantity
        What the map holds: disparity, or depth in metres, for which the camera has to be known.
    mesh
        .ply only: connect the points by triangles, cut at occlusion boundaries.
    threads
        Number of threads; every processor by default.
    force
        Allow an extreme number of planes.
    """
    import lfdepth
    from lfdepth.cli.progress import Progress
    from lfdepth.io import check_writable

    chosen = lfdepth.method(method, preset=preset, **given(options))
    check_writable(output)
    if preview is not None:
        check_picture(preview, apart_from=output)
    lf = reading.read(scene)
    _check_output(output, lf, quantity, mesh)
    with Progress() as progress:
        result = lfdepth.estimate(lf, chosen, range=range, threads=threads, progress=progress, force=force)
    lfdepth.write(output, result, scene=lf, quantity=quantity, mesh=mesh)
    if preview is not None:
        from lfdepth.pictures import preview as write_preview

        write_preview(result.disparity, preview)
    written = [str(path) for path in (output, preview) if path is not None]
    report(estimate_facts(lf, result, progress, written), as_json, estimate_text)


@app.command(sort_key=2)
def evaluate(
    result: Path,
    scene: Path,
    /,
    *,
    error_map: Path | None = None,
    as_json: Json = False,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Score a disparity map against a scene's truth with the benchmark's metrics.

    For example:

        lfdepth evaluate cotton.pfm cotton
        lfdepth evaluate cotton.pfm cotton --error-map error.png

    Parameters
    ----------
    result
        Disparity map of the reference view: .pfm, .npy, .npz, .tif, .exr, .zarr, or .png with its .json.
    scene
        Light field with truth, such as a benchmark folder with gt_disp_lowres.pfm.
    error_map
        Also write the signed error as a picture, .png: red = too near, blue = too far.
    """
    import lfdepth
    from lfdepth.evaluation import read_high_resolution
    from lfdepth.io import read_disparity

    if error_map is not None:
        check_picture(error_map, apart_from=result)
    disparity = read_disparity(result)
    lf = reading.read(scene)
    high = read_high_resolution(scene) if scene.is_dir() and reading.keeps_size else None
    scores = lfdepth.evaluate(disparity, lf, high=high)
    if error_map is not None:
        from lfdepth.pictures import error_map as write_error_map

        assert lf.truth is not None  # or it could not have been scored
        write_error_map(disparity, lf.truth, error_map)
    report(scores.as_dict(), as_json, lambda _: scores.table())


@app.command(name="methods", sort_key=3)
def list_methods(*, as_json: Json = False) -> None:
    """List the methods and their parameters."""
    known = [asdict(methods.method(name)) for name in methods.NAMES]
    report({"methods": known, "presets": methods.PRESETS}, as_json, methods_text)


@app.command(sort_key=4)
def info(scene: Path, /, *, as_json: Json = False, reading: ReadingParameters = AS_IT_IS) -> None:
    """Describe a light field: views, disparity range, camera, truth.

    Parameters
    ----------
    scene
        Light field: a folder of views such as those of the 4D Light Field Benchmark, or a file.
    """
    report(scene_facts(reading.read(scene)), as_json, scene_text)


@app.command(sort_key=5)
def convert(
    source: Path,
    target: Path,
    /,
    *,
    scene: Path | None = None,
    quantity: Quantity = "disparity",
    mesh: Flag = False,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Convert a disparity map to another format, to depth in metres, or to points.

    For example:

        lfdepth convert cotton.pfm cotton.tif
        lfdepth convert cotton.pfm cotton.ply --scene cotton

    Parameters
    ----------
    source
        Disparity map: .pfm, .npy, .npz, .tif, .exr, .zarr, or .png with its .json.
    target
        Map to write; the ending picks the format, as for "lfdepth estimate".
    scene
        Light field of the map, whose camera gives metres and whose reference view gives colours.
    quantity
        What the new map holds: disparity, or depth in metres.
    mesh
        .ply only: connect the points by triangles, cut at occlusion boundaries.
    """
    import lfdepth
    from lfdepth.io import check_writable, read_disparity

    check_writable(target)
    lf = None if scene is None else reading.read(scene)
    lfdepth.write(target, read_disparity(source), scene=lf, quantity=quantity, mesh=mesh)


@app.command(sort_key=6)
def demo(*, output: Output = DEMO_FOLDER, size: int = SIZE, as_json: Json = False) -> None:
    """Make a light field with exact truth, estimate it with every method, and compare. Needs no data.

    Prints a table of errors and writes demo.png: reference view, truth, each method's map and its error.

    Parameters
    ----------
    output
        Folder for the picture; made if it is missing.
    size
        Side of the views, px.
    """
    from lfdepth.cli.progress import Progress

    with Progress() as progress:
        shown = run_demo(output, size=size, announce=progress.announce, progress=progress)
    report(shown.as_dict(), as_json, lambda _: f"{shown.table()}\n\nwritten  {shown.picture}")


def _check_output(output: Path, lf: LightField, quantity: Quantity, mesh: bool) -> None:
    """Raise LightFieldError, before long work, if `write` would refuse what is asked for."""
    points = output.suffix.lower() == ".ply"
    if mesh and not points:
        raise LightFieldError(f"{output}: holds no meshes; expected the ending .ply; choose it")
    if lf.camera is None and (quantity == "depth" or points):
        raise LightFieldError(
            f"{output}: the camera is unknown; expected it for metres; give --baseline-mm, --focal-mm, "
            "--sensor-mm and --focus-m"
        )
