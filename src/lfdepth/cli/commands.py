"""The commands. Each one is a call of the library between reading its arguments and printing its result."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from lfdepth.cli.app import app
from lfdepth.cli.options import (
    AS_IT_IS,
    DEFAULT_METHOD,
    ESTIMATED,
    Flag,
    Json,
    MapSource,
    MapSources,
    Memory,
    Output,
    Range,
    Reading,
    ReadingParameters,
    View,
    check_picture,
    given,
    method_parameters,
)
from lfdepth.cli.printing import (
    conversion_facts,
    conversion_text,
    estimate_facts,
    estimate_text,
    mask_facts,
    mask_text,
    methods_facts,
    methods_text,
    refocus_facts,
    refocus_text,
    report,
    scene_facts,
    scene_text,
    tiled_facts,
    tiled_text,
)
from lfdepth.demo import SIZE, run_demo
from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField
    from lfdepth.methods import Method
    from lfdepth.probe.order import Orientation
    from lfdepth.result import Result

DEMO_FOLDER = Path("lfdepth-demo")

Quantity = Literal["disparity", "depth"]
Equalise = Literal["auto", "off"]


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
    engine: str = "cpu",
    threads: int | None = None,
    force: Flag = False,
    equalise: Equalise = "auto",
    aspect: float | None = None,
    refine_positions: Flag = False,
    view: View = None,
    all_views: Flag = False,
    memory: Memory = None,
    workers: int | None = None,
    scheduler: str | None = None,
    halo: int | None = None,
    as_json: Json = False,
    options: Any = None,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Estimate the disparity map of a light field's reference view.

    Disparity is in px per view step, positive = nearer than the focus distance. For example:

        lfdepth estimate cotton -o cotton.pfm --preview cotton.png
        lfdepth estimate cotton -o cotton.npz --range -1.6 1.5 --step 0.02
        lfdepth estimate cotton -o cotton.npy --method fbsocc-sfa --preset paper-synthetic
        lfdepth estimate cotton -o cotton.zarr --all-views
        lfdepth estimate gantry.zarr -o gantry.tif --memory 2GB
        lfdepth estimate gantry.zarr -o gantry.tif --memory 2GB --scheduler tcp://head:8786

    Parameters
    ----------
    scene
        Light field: a folder of views, such as a scene of the 4D Light Field Benchmark, or a file.
    output
        Map to write; the extension selects the format: .pfm, .npy, .tif, .exr, .png (16 bits, its scale in a
        .json beside it), .npz or .zarr (disparity, confidence, parameters), .ply (points in metres).
    method
        Name of the method; "lfdepth methods" lists them.
    preset
        Parameters of the paper's experiments: paper-synthetic (step 0.02, J 7), paper-real (step 0.05, J 5).
    range
        Smallest and largest disparity to search, px per view step. If neither this option nor the scene gives
        a range, lfdepth estimates it from the views.
    preview
        Also write a colour-mapped picture of the disparity with a scale bar, .png.
    quantity
        What the map holds: disparity, or depth in metres (the camera must be known).
    mesh
        .ply only: join the points into a triangle mesh, cut at depth edges.
    engine
        Engine that does the computing; "lfdepth methods" lists them.
    threads
        Number of threads; one per processor by default.
    force
        Run even with an extreme number of planes, or if memory seems too small.
    equalise
        auto: equalise the brightness of the views where it differs; off: use the views unchanged.
    aspect
        Vertical step between views divided by the horizontal step; 1 by default.
    refine_positions
        Estimate twice: the first map is used to measure where each camera really is, off the regular grid.
    view
        Estimate the map of another view than the reference view: its row and column in the grid, from 0. With
        --all-views, the map is the one that this view has among those of all.
    all_views
        Estimate the maps of all views, which agree with each other. The output is an .npz or .zarr with
        arrays (V, U, H, W), or a folder of .pfm files.
    memory
        Work by tiles and take no more memory than this, such as 2GB: for fields that do not fit. The output
        is a .zarr, .tif or .npy; after a break, the same command goes on.
    workers
        With --memory: number of processes among which tiles are divided, each of which takes that memory; 1
        by default.
    scheduler
        With --memory: address of a Dask scheduler whose workers do the tiles; they must see the same paths.
    halo
        With --memory: px around a tile that it is estimated from, beside the shifts of the views; 48 by
        default.
    """
    import lfdepth
    from lfdepth.cli.ahead import KernelsAhead
    from lfdepth.cli.progress import Progress
    from lfdepth.io import check_view_maps_writable, check_writable

    chosen = lfdepth.method(method, preset=preset, **given(options))
    if memory is not None:
        one_map = {"--preview": preview, "--mesh": mesh, "--aspect": aspect, "--view": view, "--force": force}
        one_map |= {"--refine-positions": refine_positions, "--all-views": all_views}
        _check_by_tiles(one_map | {"--quantity": quantity != "disparity"})
        settings: dict[str, Any] = {"threads": threads, "engine": engine, "equalise": equalise == "auto"}
        settings |= {"range": range, "workers": workers, "scheduler": scheduler}
        settings |= {} if halo is None else {"halo": halo}
        _estimate_by_tiles(scene, output, chosen, memory, settings, reading, as_json)
        return
    _check_whole({"--workers": workers, "--scheduler": scheduler, "--halo": halo})
    if all_views and view is None:
        _check_all_views(quantity, mesh)
        check_view_maps_writable(output)
    else:
        check_writable(output)
    if preview is not None:
        check_picture(preview, apart_from=output)
    settings = {
        "threads": threads,
        "force": force,
        "engine": engine,
        "equalise": equalise == "auto",
    }
    if all_views and not force:
        _check_all_fit(scene, reading, output)
    progress = Progress()
    with KernelsAhead(chosen, engine, progress.note_compilation) as kernels:
        lf = reading.read(scene)
        _check_output(output, lf, quantity, mesh)
        if range is None:
            reading.require_order(lf)
        if aspect is not None:
            lf = lfdepth.with_aspect(lf, aspect)
        kernels.settle(lf.views.dtype.name)
        with progress:
            if refine_positions:
                first = lfdepth.estimate(lf, chosen, range=range, progress=progress.step, **settings)
                lf, range = refined(lf, first), first.range
            maps, whole = None, lf
            if view is not None:
                lf = lfdepth.from_view(lf, view)
            settings |= {"range": range, "progress": progress.step}
            if not all_views:
                result = lfdepth.estimate(lf, chosen, **settings)
            elif view is None:
                maps = lfdepth.estimate_views_to(lf, output, chosen, **settings)
                result = maps.reference
            else:
                from lfdepth.scale.views import estimate_view_among_all

                folder = output.resolve().parent
                result, maps = estimate_view_among_all(whole, view, chosen, folder, **settings)
    if maps is None or view is not None:
        lfdepth.write(output, result, scene=lf, quantity=quantity, mesh=mesh)
    if preview is not None:
        from lfdepth.pictures import preview as write_preview

        write_preview(result.disparity, preview)
    written = [str(path) for path in (output, preview) if path is not None]
    checks = (result if maps is None else maps.reference).checks
    for warning in checks.warnings if checks else ():
        print(f"warning: {warning}", file=sys.stderr)
    report(estimate_facts(lf, result, progress, written, maps), as_json, estimate_text)


def refined(lf: LightField, first: Result) -> LightField:
    """The light field with its views where a first estimate says that they stand."""
    import lfdepth

    equal = lf if first.equalisation is None else lfdepth.equalise(lf, first.equalisation)
    return replace(lf, positions=lfdepth.refine_positions(equal, first.disparity).positions)


def add_estimate(method: str | None) -> None:
    """Register `estimate` with the options of one method, or without: what the command line itself says."""
    if method is not None:
        kind, unchanged = method_parameters(method)
        estimate.__annotations__["options"] = kind
        assert estimate.__kwdefaults__ is not None
        estimate.__kwdefaults__["options"] = unchanged
    if "estimate" in app:  # as an earlier command line in this process left it
        del app["estimate"]
    app.command(estimate, sort_key=1)


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
        Disparity map of the reference view: .pfm, .npy, .npz, .tif, .exr, .zarr, or .png with its .json. If
        the file also holds a confidence (.npz, .zarr, .exr), that is scored as well.
    scene
        Light field with truth, such as a benchmark folder with gt_disp_lowres.pfm, or with --truth FILE.
    error_map
        Also write the signed error as a picture, .png: red = too near, blue = too far.
    """
    import lfdepth
    from lfdepth.io import read_confidence, read_disparity, read_high_resolution

    if error_map is not None:
        check_picture(error_map, apart_from=result)
    disparity = read_disparity(result, finite=False)
    unusable: dict[str, str] = {}
    lf = reading.read(scene, unusable)
    beside = scene.is_dir() and reading.keeps_size and reading.truth is None
    high = read_high_resolution(scene) if beside else None
    scores = lfdepth.evaluate(disparity, lf, confidence=read_confidence(result), high=high, unusable=unusable)
    for reason in [*unusable.values(), *(high.unusable.values() if high else ())]:
        print(f"mask left out: {reason}", file=sys.stderr)
    if error_map is not None:
        from lfdepth.pictures import error_map as write_error_map
        from lfdepth.scoring.captions import score_lines

        assert lf.truth is not None  # or it could not have been scored
        write_error_map(disparity, lf.truth, error_map, caption=score_lines(scores))
    report(scores.as_dict(), as_json, lambda _: scores.table())


@app.command(name="methods", sort_key=3)
def list_methods(*, as_json: Json = False) -> None:
    """List the methods and their parameters."""
    report(methods_facts(), as_json, methods_text)


@app.command(sort_key=4)
def info(
    scene: Path, /, *, check: bool = True, as_json: Json = False, reading: ReadingParameters = AS_IT_IS
) -> None:
    """Describe a light field: views, their order, disparity range, camera, truth.

    Checks on the pixels whether the views are in order and, if they are not, says which options fix it. If
    the scene gives no disparity range, lfdepth estimates it from the views.

    Parameters
    ----------
    scene
        Light field: a folder of views, such as a scene of the 4D Light Field Benchmark, or a file.
    check
        Check the pixels too; takes a second or two.
    """
    import lfdepth

    lf = reading.read(scene)
    orientation = reading.check_order(lf) if check else None
    brightness = lfdepth.measure_brightness(lf) if orientation and not orientation.wrong else None
    equal = lf if brightness is None else lfdepth.equalise(lf, brightness)
    found, problem = _search_range(equal, orientation)
    ends = lf.disparity_range or found
    geometry = _geometry(equal, ends) if orientation and not orientation.wrong and ends else None
    report(scene_facts(lf, orientation, found, problem, brightness, geometry), as_json, scene_text)


@app.command(sort_key=5)
def convert(
    source: Path,
    /,
    output: Output,
    *,
    to: str | None = None,
    samples: Literal["uint8", "uint16", "float32"] | None = None,
    range: Range = None,
    scene: Path | None = None,
    quantity: Quantity = "disparity",
    mesh: Flag = False,
    as_json: Json = False,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Convert a light field to another format, or a disparity map to another format, metres or a point cloud.

    For example:

        lfdepth convert IMG_0001_eslf.png -o bikes
        lfdepth convert buddha.h5 -o buddha --to benchmark
        lfdepth convert cotton -o row_qs9x1a1.png --views 9x1
        lfdepth convert cotton.pfm -o cotton.tif
        lfdepth convert cotton.pfm -o cotton.ply --scene cotton

    Parameters
    ----------
    source
        A light field (folder or file) or a disparity map (.pfm, .npy, .npz, .tif, .exr, .zarr, or .png with
        its .json).
    output
        What to write; the extension selects the format. For a light field: .npz, .npy, .h5, .zarr, .mat, .tif
        (one page per view), NAME_qsCxRaA.png (a quilt), or, without an extension, a folder of views. For a
        map: as for "lfdepth estimate".
    to
        Light fields: the format, where the extension does not determine it, such as benchmark for a folder in
        the layout of the 4D Light Field Benchmark.
    samples
        Light fields: sample type to convert to, scaled so that white stays white; unchanged by default.
    range
        Light fields: disparity range to store, px per view step; the scene's own by default. The benchmark's
        layout needs one, so there it is estimated from the views if the scene has none.
    scene
        Maps: the light field that supplies the camera (for metres) and the reference view (for colours).
    quantity
        Maps: write disparity, or depth in metres.
    mesh
        Maps to .ply only: join the points into a triangle mesh, cut at depth edges.
    """
    import lfdepth
    from lfdepth.io import check_light_field_writable, check_writable, is_map, read_record

    if scene is None and (reading.format is not None or not is_map(source)):
        _check_map_options(quantity, mesh)
        check_light_field_writable(output, to)
        lf = _with_range(reading.read(source), range, reading, needed=to == "benchmark")
        lf = lf if samples is None else lf.with_samples(samples)
        lfdepth.write(output, lf, format=to)
        report(conversion_facts(lf, output), as_json, conversion_text)
        return
    if to is not None or range is not None or samples is not None:
        raise LightFieldError(
            f"{source}: is a map; --to, --samples and --range expected a light field; leave them out"
        )
    check_writable(output)
    view = None if scene is None else reading.read(scene)
    lfdepth.write(output, read_record(source), scene=view, quantity=quantity, mesh=mesh)
    report(conversion_facts(None, output), as_json, conversion_text)


@app.command(sort_key=6)
def refocus(
    scene: Path,
    /,
    *,
    output: Output,
    disparity: float | None = None,
    all_in_focus: Flag = False,
    without_foreground: float | None = None,
    threads: int | None = None,
    as_json: Json = False,
    source: MapSources = ESTIMATED,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Refocus on a plane, see past an occluder, or make a picture that is in focus everywhere.

    For example:

        lfdepth refocus cotton --disparity -0.8 -o far.png
        lfdepth refocus cotton --all-in-focus --map cotton.pfm -o sharp.png
        lfdepth refocus fence --disparity -1 --without-foreground 0.5 -o through.png

    Parameters
    ----------
    scene
        Light field: a folder of views, such as a scene of the 4D Light Field Benchmark, or a file.
    output
        Picture to write, .png.
    disparity
        Plane to focus on, px per view step.
    all_in_focus
        Focus every pixel at its own disparity; uses a disparity map.
    without_foreground
        Remove everything nearer than this, px per view step: a pixel is averaged only over the views in which
        nothing nearer covers it. Uses a disparity map to find the foreground.
    threads
        Number of threads; one per processor by default.
    """
    _check_focus(disparity, all_in_focus, without_foreground, source)
    from lfdepth.io.pixels import write_picture
    from lfdepth.render import refocus as focusing

    check_picture(output, apart_from=source.map)
    lf = reading.read(scene)
    if disparity is None:
        picture = focusing.all_in_focus(lf, source.of(lf, reading, threads), threads=threads)
    else:
        focusing.check_reach(lf, disparity, "disparity")
        near = None if without_foreground is None else source.of(lf, reading, threads)
        picture = focusing.refocus(
            lf, disparity, without_foreground=without_foreground, disparity_map=near, threads=threads
        )
    write_picture(output, picture)
    report(refocus_facts(lf, disparity, without_foreground, output), as_json, refocus_text)


@app.command(sort_key=7)
def mask(
    scene: Path,
    /,
    *,
    output: Output,
    foreground_of: float,
    at: float | None = None,
    threads: int | None = None,
    as_json: Json = False,
    source: MapSources = ESTIMATED,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Write the 4-D foreground mask: for every view, the pixels nearer than a given disparity.

    For example:

        lfdepth mask cotton --foreground-of 0.5 -o mask
        lfdepth mask cotton --foreground-of 0.5 --map cotton.pfm -o mask

    Parameters
    ----------
    scene
        Light field: a folder of views, such as a scene of the 4D Light Field Benchmark, or a file.
    output
        Folder for mask_v00_u00.png and so on, white = foreground; must be new, empty, or hold earlier masks.
    foreground_of
        Disparity above which a pixel is foreground, px per view step.
    at
        Align all masks at this plane, px per view step; by default each mask lines up with its own view.
    threads
        Number of threads; one per processor by default.
    """
    from lfdepth.io.atomic import check_target
    from lfdepth.render.refocus import foreground_masks, write_masks

    check_target(output, folder=True)
    lf = reading.read(scene)
    masks = foreground_masks(lf, source.of(lf, reading, threads), foreground_of, at=at)
    write_masks(output, masks, lf)
    report(mask_facts(lf, masks, foreground_of, output), as_json, mask_text)


@app.command(sort_key=8)
def demo(*, output: Output = DEMO_FOLDER, size: int = SIZE, as_json: Json = False) -> None:
    """Render a light field with exact truth, estimate it with each of lfdepth's own methods, and compare.

    Needs no data. Prints a table of errors and writes demo.png: reference view, truth, each method's map and
    its error.

    Parameters
    ----------
    output
        Folder for the picture; created if missing.
    size
        Side of the views, px.
    """
    from lfdepth.cli.progress import Progress

    with Progress() as progress:
        shown = run_demo(output, size=size, announce=progress.announce, progress=progress.step)
    report(shown.as_dict(), as_json, lambda _: f"{shown.table()}\n\nwritten  {shown.picture}")


def _check_focus(
    disparity: float | None, all_in_focus: bool, without_foreground: float | None, source: MapSource
) -> None:
    """Raise LightFieldError unless the options of `refocus` ask for one thing."""
    if (disparity is None) != all_in_focus:
        raise LightFieldError("refocus: expected either --disparity D or --all-in-focus; give one of them")
    if all_in_focus and without_foreground is not None:
        raise LightFieldError(
            "--without-foreground: found with --all-in-focus, expected with --disparity D; leave one out"
        )
    if source != ESTIMATED and not all_in_focus and without_foreground is None:
        raise LightFieldError(
            "--map, --method, --range: nothing here uses a disparity map; expected them only with "
            "--without-foreground D or --all-in-focus; leave them out"
        )


def _check_map_options(quantity: Quantity, mesh: bool) -> None:
    if quantity != "disparity" or mesh:
        option = "--mesh" if mesh else "--quantity"
        raise LightFieldError(
            f"{option}: the source is a light field; expected a disparity map; estimate one first"
        )


def _with_range(
    lf: LightField, range: tuple[float, float] | None, reading: Reading, *, needed: bool
) -> LightField:
    """The light field with a range: the one given, its own, or if it is needed the one found in the views."""
    from lfdepth.probe.ranges import find_range

    if range is None and needed and lf.disparity_range is None:
        reading.require_order(lf)
        range = find_range(lf)
    return lf if range is None else replace(lf, disparity_range=range)


def _search_range(
    lf: LightField, orientation: Orientation | None
) -> tuple[tuple[float, float] | None, str | None]:
    """The range that a scene without one has, by its views, or else why there is none to find."""
    from lfdepth.probe.ranges import find_range

    if orientation is None or lf.disparity_range is not None:
        return None, None
    if orientation.wrong:
        return None, "the views have to be in order first"
    try:
        return find_range(lf), None
    except LightFieldError as error:
        return None, str(error)


def _geometry(lf: LightField, range: tuple[float, float]) -> tuple[float | None, float]:
    """Vertical over horizontal steps, None where the views do not tell, and how far off the grid they are."""
    from lfdepth.probe.geometry import measure_aspect, stray

    aspect = measure_aspect(lf, range)
    straight = lf if aspect is None or lf.positions is not None else _with_measured(lf, aspect)
    return aspect, stray(straight, range)


def _with_measured(lf: LightField, aspect: float) -> LightField:
    """The light field with the ratio of steps that was measured, where it is one."""
    import lfdepth

    return lf if aspect == 1 else lfdepth.with_aspect(lf, aspect)


def _check_by_tiles(options: dict[str, Any]) -> None:
    """Raise LightFieldError where an option asks for what needs a whole map at once."""
    for name, value in options.items():
        if value not in (None, False):
            raise LightFieldError(f"{name}: found with --memory, which works by tiles; leave one out")


def _check_whole(options: dict[str, Any]) -> None:
    """Raise LightFieldError where an option is about tiles, and the map is estimated as a whole."""
    for name, value in options.items():
        if value is not None:
            raise LightFieldError(
                f"{name}: found without --memory; expected it with tiles; add --memory 2GB, or leave it out"
            )


def _estimate_by_tiles(
    scene: Path,
    output: Path,
    method: Method,
    memory: float,
    settings: dict[str, Any],
    reading: Reading,
    as_json: bool,
) -> None:
    """Estimate a map tile by tile, and say what was done."""
    from lfdepth.cli.progress import Progress
    from lfdepth.scale.tiles import estimate_tiled

    with Progress() as progress:
        done = estimate_tiled(
            scene,
            output,
            method,
            memory=memory,
            reading=reading.given(),
            progress=progress.step,
            **settings,
        )
    for warning in done.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    report(tiled_facts(scene, done), as_json, tiled_text)


def _check_all_views(quantity: Quantity, mesh: bool) -> None:
    """Raise LightFieldError where an option is about one map, and all are written."""
    if quantity != "disparity" or mesh:
        option = "--mesh" if mesh else "--quantity"
        raise LightFieldError(f"{option}: found with --all-views; expected it with one map; leave one out")


def _check_all_fit(scene: Path, reading: Reading, output: Path) -> None:
    """Raise LightFieldError, before views are read, where maps of all will not fit in memory, or on disk."""
    from lfdepth.scale.look import look
    from lfdepth.scale.views import check_disk, check_memory

    seen = look(scene, reading.given())
    check_memory(str(scene), seen.shape, seen.itemsize, views=True)
    check_disk(str(scene), seen.shape, output)


def _check_output(output: Path, lf: LightField, quantity: Quantity, mesh: bool) -> None:
    """Raise LightFieldError, before long work, if `write` would refuse what is asked for."""
    points = output.suffix.lower() == ".ply"
    if mesh and not points:
        raise LightFieldError(f"{output}: cannot hold a mesh; expected a name ending in .ply; rename it")
    if lf.camera is None and (quantity == "depth" or points):
        raise LightFieldError(
            f"{output}: the camera is unknown, but metres need it; give --baseline-mm, --focal-mm, "
            "--sensor-mm and --focus-m"
        )
