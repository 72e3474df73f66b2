"""Submissions to the 4D Light Field Benchmark: made, and checked.

A submission is a zip with ``disp_maps/SCENE.pfm`` (512×512, finite) and ``runtimes/SCENE.txt`` (seconds) for
the twelve scenes, all made with one parameter set. The disparity range of `parameters.cfg` may be used, masks
may not.
"""

from __future__ import annotations

import logging
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

import numpy as np

from lfdepth.bench.cache import Cache
from lfdepth.bench.external import read_runtime
from lfdepth.bench.plan import Setting, setting
from lfdepth.bench.results import Found, one_line
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import make_folder

log = logging.getLogger(__name__)

STRATIFIED = ("backgammon", "dots", "pyramids", "stripes")
TRAINING = ("boxes", "cotton", "dino", "sideboard")
TEST = ("bedroom", "bicycle", "herbs", "origami")
SCENES = (*STRATIFIED, *TRAINING, *TEST)
"""The benchmark's twelve scenes, in the order of its tables."""

SIZE = (512, 512)
"""(H, W) of every map."""

HOME = "https://lightfield-analysis.uni-konstanz.de"
"""Where the scenes can be downloaded and results submitted."""

_LARGEST = 4 * SIZE[0] * SIZE[1] + 1024  # bytes of a file that a zip may unfold to: one map and its header
_EPOCH = (1980, 1, 1, 0, 0, 0)  # a fixed date, so that equal maps make equal zips


@dataclass(frozen=True)
class Submission:
    """What `submit` made.

    Attributes
    ----------
    zip : Path or None
        The archive; None where it would not be accepted and `partial` was not asked for.
    scenes : tuple of str
        Scenes with a map.
    problems : tuple of str
        Why it would not be accepted: a line for each scene that is absent or failed.
    """

    zip: Path | None
    scenes: tuple[str, ...]
    problems: tuple[str, ...]


def find_scenes(data: Path | str) -> dict[str, Path]:
    """Folders of the benchmark's scenes at most two levels below a folder, in the order of its tables.

    Raises
    ------
    LightFieldError
        If the folder does not exist.
    """
    data = Path(data)
    if not data.is_dir():
        raise LightFieldError(
            f"{data}: no such folder; expected one with the benchmark's scenes; check the path"
        )
    found: dict[str, Path] = {}
    for folder in (data, *sorted(data.glob("*")), *sorted(data.glob("*/*"))):
        name = folder.resolve().name
        if name in SCENES and (folder / "input_Cam000.png").is_file():
            found.setdefault(name, folder)
    return {name: found[name] for name in SCENES if name in found}


def submit(
    data: Path | str,
    out: Path | str,
    method: str | Setting,
    *,
    partial: bool = False,
    threads: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> Submission:
    """Run the benchmark's scenes with one parameter set and make a submission.

    Parameters
    ----------
    data : path
        Folder with the scenes, each in a folder of its name, at most two levels down.
    out : path
        Folder for `disp_maps`, `runtimes`, `submission.zip` and the cache; made if absent.
    method : str or Setting
        ``name`` or ``name:parameter=value,...``.
    partial : bool
        Make the zip also where some scenes are absent or failed.
    threads : int, optional
        Passed to `estimate`.
    progress : callable, optional
        Called with (scenes done, scenes in all, what comes next).

    Returns
    -------
    Submission

    Raises
    ------
    LightFieldError
        If there is no scene at all, the method is unknown, or `out` cannot be written. A scene that fails is
        a problem in the result, and the rest goes on.
    """
    chosen = setting(method) if isinstance(method, str) else method
    chosen.resolve()
    found = find_scenes(data)
    if not found:
        raise LightFieldError(
            f"{data}: none of the benchmark's scenes; expected folders such as cotton with input_Cam000.png; "
            f"download them from {HOME}"
        )
    out = make_folder(Path(out))
    cache = Cache(make_folder(out / "cache"))
    problems = [
        f"{name}: no folder of that name below {data}; get it from {HOME}"
        for name in SCENES
        if name not in found
    ]
    made: dict[str, list[Path]] = {}
    for number, (name, folder) in enumerate(found.items()):
        if progress:
            progress(number, len(found), name)
        try:
            made[name] = _run(name, folder, chosen, cache, out, threads)
        except Exception as error:  # one bad scene must not cost the others
            log.info("%s failed", name, exc_info=error)
            problems.append(f"{name}: {one_line(error)}")
    if not made or (problems and not partial):
        return Submission(None, tuple(made), tuple(problems))
    archive = out / "submission.zip"
    _zip(archive, [file for files in made.values() for file in files], out)
    return Submission(archive, tuple(made), tuple(problems))


def _run(
    name: str, folder: Path, chosen: Setting, cache: Cache, out: Path, threads: int | None
) -> list[Path]:
    """Estimate one scene, write its two files, and check them as one would check those of others."""
    from lfdepth.io import read

    lf = read(folder, unusable={})  # masks play no part
    files = [out / "disp_maps" / f"{name}.pfm", out / "runtimes" / f"{name}.txt"]
    _write(cache.estimate(lf, chosen.resolve(), threads=threads), *files)
    if found := [*_map_problems(files[0]), *_runtime_problems(files[1])]:
        raise LightFieldError("; ".join(found))
    return files


def _write(found: Found, disparities: Path, seconds: Path) -> None:
    from lfdepth.io import write
    from lfdepth.io.atomic import atomic

    for file in (disparities, seconds):
        make_folder(file.parent)
    write(disparities, found.disparity)
    with atomic(seconds) as temporary:
        temporary.write_text(f"{found.runtime:.4f}\n", encoding="ascii")


def _zip(archive: Path, files: list[Path], root: Path) -> None:
    from lfdepth.io.atomic import atomic

    with atomic(archive) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as target:
        for file in sorted(files):
            info = zipfile.ZipInfo(file.relative_to(root).as_posix(), _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            target.writestr(info, file.read_bytes())


# --- checking


def check_submission(archive: Path | str) -> tuple[str, ...]:
    """Everything about a zip that the benchmark would not accept, a line each; empty if it is fine.

    Parameters
    ----------
    archive : path
        Zip file, one's own or someone else's.

    Raises
    ------
    LightFieldError
        If the file is absent or no zip.
    """
    archive = Path(archive)
    try:
        with zipfile.ZipFile(archive) as source, TemporaryDirectory() as scratch:
            return tuple(_problems(source, Path(scratch)))
    except FileNotFoundError:
        raise LightFieldError(f"{archive}: no such file; expected a zip; check the path") from None
    except Exception as error:  # damaged archives make zipfile raise many kinds
        raise LightFieldError(
            f"{archive}: not a readable zip ({error}); expected a submission; create it again"
        ) from None


def _problems(source: zipfile.ZipFile, scratch: Path) -> Iterator[str]:
    wanted = _wanted()
    files = [info.filename for info in source.infolist() if not info.is_dir()]
    top = _enclosing_folder(files)
    if top:
        yield (
            f"{top}: holds all files; expected disp_maps and runtimes at the top of the zip; zip these two "
            "folders, not the one around them"
        )
    names = Counter(name.removeprefix(top) for name in files)
    for name in names - Counter(list(wanted)):
        found = "twice in the zip" if name in wanted else "not part of a submission"
        yield f"{name}: {found}; expected disp_maps/SCENE.pfm and runtimes/SCENE.txt once each; remove it"
    for name, check in wanted.items():
        if name not in names:
            yield f"{name}: missing; expected it for each of the twelve scenes; add it"
        elif (size := source.getinfo(top + name).file_size) > _LARGEST:
            yield f"{name}: {size} bytes; expected at most {_LARGEST}; write it again"
        elif source.getinfo(top + name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            yield f"{name}: not compressed by deflate; expected deflate; create the zip again"
        else:
            yield from _file_problems(source, top + name, scratch / PurePosixPath(name).name, name, check)


def _enclosing_folder(files: list[str]) -> str:
    """The folder, with its slash, that holds all files of a zip; empty where there is none."""
    folders = {name.partition("/")[0] for name in files if "/" in name}
    whole = len(folders) == 1 and all("/" in name for name in files)
    return f"{folders.pop()}/" if whole and not folders & {"disp_maps", "runtimes"} else ""


def _file_problems(
    source: zipfile.ZipFile, member: str, file: Path, name: str, check: Callable[[Path], Iterator[str]]
) -> Iterator[str]:
    """Unpack one file and check it; the problems name it as `name`."""
    try:
        file.write_bytes(source.read(member))
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        yield f"{name}: damaged in the zip ({error}); expected a complete file; create the zip again"
        return
    yield from (problem.replace(str(file), name) for problem in check(file))


def _wanted() -> Mapping[str, Callable[[Path], Iterator[str]]]:
    """Names of the files of a submission, and how each is checked."""
    maps = dict.fromkeys((f"disp_maps/{name}.pfm" for name in SCENES), _map_problems)
    return maps | dict.fromkeys((f"runtimes/{name}.txt" for name in SCENES), _runtime_problems)


def _map_problems(file: Path) -> Iterator[str]:
    from lfdepth.io.pfm import read_pfm

    try:
        disparity = read_pfm(file)
    except LightFieldError as error:
        yield str(error)
        return
    height, width = disparity.shape
    if (height, width) != SIZE:
        yield f"{file}: {width}x{height} px; expected {SIZE[1]}x{SIZE[0]} px; write the whole reference view"
    if bad := int(np.count_nonzero(~np.isfinite(disparity))):
        yield f"{file}: {bad} values are NaN or infinite; expected finite disparities; fill them"


def _runtime_problems(file: Path) -> Iterator[str]:
    try:
        if read_runtime(file) == 0:
            yield f"{file}: run time is 0; expected seconds above 0; measure it again"
    except LightFieldError as error:
        yield str(error)
