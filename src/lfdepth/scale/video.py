"""The frames of a video: what is found once, carried along, and left as a map for each.

>>> import lfdepth
>>> lfdepth.estimate_video(["frame-0", "frame-1"], "maps", stabilise=True)  # doctest: +SKIP

A frame is done when its map is there, whole; what the next one needs is written before it, so that the same
call goes on after a break, and gives the same bytes.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.noise import residual
from lfdepth.blocks.steady import Past, changed, reference_of, steady
from lfdepth.engines import engine as start_engine
from lfdepth.errors import LightFieldError
from lfdepth.estimation import estimate
from lfdepth.io.atomic import atomic, check_target, make_folder
from lfdepth.io.record import as_record
from lfdepth.lightfield import LightField, check_range
from lfdepth.methods import DEFAULT, Method
from lfdepth.methods import method as named_method
from lfdepth.probe.brightness import Equalisation, equalise, measure_brightness
from lfdepth.probe.checks import MOST_UNEVEN
from lfdepth.probe.ranges import find_range
from lfdepth.result import Result
from lfdepth.scale.frames import Frame, find_frames
from lfdepth.scale.jobs import THUMBNAILS, check_made_of, told_by
from lfdepth.scale.locks import only
from lfdepth.table import Column, Table
from lfdepth.trace import Progress
from lfdepth.version import __version__

Range = tuple[float, float]

PREVIEW, INDEX, TABLE = "preview.webp", "index.json", "index.csv"
_STATE, _BRIGHTNESS = ".lfdepth-video", "brightness_"
_MADE_OF, _FACTS = "video", "frame"
"""Names of the arrays in a map that say what it was made of, and what was found in its frame."""
_CUT = 0.5
"""Share of the reference view that changes in a cut."""
_SLACK = 0.1
"""By how much a range that was found is wider, so that surfaces may move a little, px per view step."""
_UNEVEN = 1.5
"""How many times the first frame's unevenness makes brightness be measured anew."""
_THUMBNAIL = 320  # px, the longer side
_FRAME_MS = 200


@dataclass(frozen=True)
class Outcome:
    """What became of a frame.

    Attributes
    ----------
    frame, file
        Where it came from, and its map.
    status
        "done", or "there", where it had been done before.
    range
        (min, max) disparity that was searched, px per view step.
    cut
        Whether it shows another scene than the frame before, or is the first one.
    still
        Share of its reference view that is as in the frame before.
    warnings
        What `lfdepth.estimate` found in the views.
    """

    frame: str
    file: str
    status: str
    range: Range
    cut: bool
    still: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Video:
    """The maps of a video.

    Attributes
    ----------
    outcomes
        One for each frame, in order.
    seconds
        For all of it.
    """

    outcomes: tuple[Outcome, ...]
    seconds: float

    def table(self) -> Table:
        """A row for each frame."""
        heads = [Column(each, words=True) for each in ("frame", "map", "status", "range", "cut")]
        rows = [
            (each.frame, each.file, each.status, _shown(each.range), "yes" if each.cut else "", each.still)
            for each in self.outcomes
        ]
        return Table.of([*heads, "still"], rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return {"seconds": self.seconds, "frames": [asdict(each) for each in self.outcomes]}


@dataclass(frozen=True, eq=False)
class Known:
    """What a frame leaves to the next one.

    Attributes
    ----------
    shape
        (V, U, H, W, C).
    white
        Value of white in the files; None where it is that of their type.
    range
        (min, max) disparity, px per view step.
    noise
        Mean absolute difference of views that noise makes, of full scale.
    uneven
        Largest difference in brightness that the frame was left with, of full scale.
    equalisation
        How the brightness of views differs; None if that is not looked at.
    past
        The map, its weight, and the reference view.
    """

    shape: tuple[int, ...]
    white: float | None
    range: Range
    noise: float
    uneven: float
    equalisation: Equalisation | None
    past: Past


def estimate_video(
    frames: str | Path | Sequence[str | Path],
    out: str | Path,
    method: str | Method = DEFAULT,
    *,
    stabilise: bool = False,
    range: Range | None = None,
    engine: str = "cpu",
    threads: int | None = None,
    equalise: bool = True,
    reading: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Video:
    """Estimate a disparity map for each frame of a video.

    Range and brightness are found in the first frame, and again after a cut. In every other one they are
    checked, and the range is widened where a frame needs it.

    Parameters
    ----------
    frames
        Paths of light fields, one for each frame, taken in the order of the numbers in their names; or one
        folder of them; or a Zarr, HDF5 or NPY array (T, V, U, H, W, C).
    out
        Folder for `frame-NNNN.npz` of every frame (what `lfdepth.write` puts into an NPZ file, but the run
        time), `index.json`, `index.csv`, and `preview.webp`, which shows views and maps; made if missing.
    method
        Name of a method, or a `Method`.
    stabilise
        Carry maps along: where the reference view is as before, up to noise, the map is a mean over frames,
        and does not flicker. What moves gets the map of its own frame.
    range, engine, threads, equalise, **options
        As for `lfdepth.estimate`; a range that is given stays.
    reading
        How frames are read: arguments of `lfdepth.read`; for arrays with a time axis those that select and
        reorder views, and white_level.
    progress
        Called with (frames done, frames in all, what was done last).

    Returns
    -------
    Video

    Raises
    ------
    LightFieldError
        If a frame is missing in a numbered series, cannot be read, or has another size than the first; if
        maps of other settings are in the folder, another process is writing to it, or it cannot be written.
        Maps that are finished stay, and the same call goes on after them.

    Examples
    --------
    >>> import tempfile
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> folder = tempfile.mkdtemp()
    >>> for number, lf in enumerate(scenes.video(2, size=64, views=3)):
    ...     lfdepth.write(f"{folder}/{number}.npz", lf)
    >>> video = lfdepth.estimate_video(
    ...     folder, f"{folder}-maps", "fbs-sfa", planes=10, stabilise=True
    ... )
    >>> [each.file for each in video.outcomes]
    ['frame-0000.npz', 'frame-0001.npz']
    """
    started = time.perf_counter()
    reading = {key: value for key, value in (reading or {}).items() if value is not None}
    paths = [frames] if isinstance(frames, (str, Path)) else list(frames)
    _check_outside(Path(out), paths)
    found = find_frames(paths, reading)
    run = _Run(
        out=Path(out),
        method=named_method(method, **options),
        stabilise=stabilise,
        range=range and check_range(range),
        engine=engine,
        threads=threads,
        equalise=equalise,
        reading=reading,
    )
    with only(make_folder(run.out)):  # every frame needs the one before, so that work cannot be shared
        outcomes = run.all_of(found, progress)
        video = Video(tuple(outcomes), time.perf_counter() - started)
        _write_index(run.out, video)
    return video


@dataclass(frozen=True, eq=False)
class _Run:
    """How frames are done."""

    out: Path
    method: Method
    stabilise: bool
    range: Range | None
    engine: str
    threads: int | None
    equalise: bool
    reading: Mapping[str, Any]

    def all_of(self, frames: Sequence[Frame], progress: Progress | None) -> list[Outcome]:
        """Do what is missing."""
        check_target(self.out / INDEX)
        outcomes, known = self._there(frames)
        if progress is not None:
            progress(len(outcomes), len(frames), "what is there")
        for number, frame in enumerate(frames[len(outcomes) :], len(outcomes)):
            lf = frame.read(None if known is None else known.white)
            _check_alike(lf, frame, known, frames[0])
            result, known, facts = self.step(lf, known)
            self._write(number, frame, lf, result, known, facts)
            outcomes.append(_outcome(frame, self.target(number), "done", facts))
            if progress is not None:
                progress(number + 1, len(frames), "frame")
        return outcomes

    # --- one frame

    def step(self, lf: LightField, known: Known | None) -> tuple[Result, Known, dict[str, Any]]:
        """The map of a frame, what it leaves to the next, and what was found."""
        reference, still = reference_of(lf), 0.0
        white, shape = (known.white, known.shape) if known is not None else (lf.white_level, lf.shape)
        if known is not None:
            still = 1 - float(changed(reference, known.past.reference, known.noise).mean())
        cut = known is None or still < 1 - _CUT
        if known is None or cut:
            even, equalisation = self._evened(lf)
            result = self._estimate(even, self._found(even))
            noise, uneven, past = self._noise(even, result.range), _uneven(result), None
        else:
            equalisation, noise, uneven, past = known.equalisation, known.noise, known.uneven, known.past
            even = lf if equalisation is None else equalise(lf, equalisation)
            searched = self._widened(even, known.range)
            result = self._estimate(even, searched)
            if self.equalise and _uneven(result) > max(MOST_UNEVEN, _UNEVEN * uneven):
                even, equalisation = self._evened(lf)
                result = self._estimate(even, searched)
        kept = Past(result.disparity, np.ones_like(result.disparity), reference)
        if self.stabilise:
            carried, kept = steady(even, result.disparity, result.confidence, result.sigma, past, noise)
            result = replace(result, disparity=np.clip(carried, *result.range).astype(np.float32))
        facts = {
            "range": list(result.range),
            "cut": cut,
            "still": still,
            "warnings": list(result.checks.warnings if result.checks else ()),
        }
        return result, Known(shape, white, result.range, noise, uneven, equalisation, kept), facts

    def _evened(self, lf: LightField) -> tuple[LightField, Equalisation | None]:
        """A frame with its brightness measured and equalised."""
        if not self.equalise:
            return lf, None
        given = self.range or lf.disparity_range
        with start_engine(self.engine, threads=self.threads) as used:
            found = measure_brightness(lf, range=given, engine=used)
        return equalise(lf, found), found

    def _found(self, lf: LightField) -> Range:
        """The range that is given, or the frame's own, or what its views show, and a little more."""
        if self.range is not None:
            return self.range
        if lf.disparity_range is not None:
            return lf.disparity_range
        with start_engine(self.engine, threads=self.threads) as used:
            low, high = find_range(lf, engine=used)
        return low - _SLACK, high + _SLACK

    def _widened(self, lf: LightField, before: Range) -> Range:
        """The range before, with what this frame needs beyond it."""
        if self.range is not None:
            return before
        needed = lf.disparity_range
        if needed is None:
            try:
                with start_engine(self.engine, threads=self.threads) as used:
                    needed = find_range(lf, engine=used)
            except LightFieldError:  # a frame without texture has no say
                return before
        low, high = before
        more = 0.0 if lf.disparity_range else _SLACK
        return (
            min(low, needed[0] - more) if needed[0] < low else low,
            max(high, needed[1] + more) if needed[1] > high else high,
        )

    def _estimate(self, lf: LightField, searched: Range) -> Result:
        return estimate(
            lf, self.method, range=searched, engine=self.engine, threads=self.threads, equalise=False
        )

    def _noise(self, lf: LightField, searched: Range) -> float:
        planes = np.linspace(searched[1], searched[0], max(int((searched[1] - searched[0]) / 0.07), 2))
        with start_engine(self.engine, threads=self.threads) as used:
            return residual(lf, planes, engine=used).noise

    # --- files

    def target(self, number: int) -> Path:
        """The map of a frame."""
        return self.out / f"frame-{number:04d}.npz"

    def _state(self, number: int) -> Path:
        return self.out / _STATE / f"{number:04d}.npz"

    def made_of(self, frame: Frame) -> dict[str, Any]:
        """What a map says that it was made of."""
        plain = {
            "frame": frame.name,
            "lfdepth": __version__,
            "method": self.method.as_dict(),
            "stabilise": self.stabilise,
            "range": self.range,
            "engine": self.engine,
            "equalise": self.equalise,
            "reading": self.reading,
        }
        return dict(json.loads(json.dumps(plain, default=str)))

    def _there(self, frames: Sequence[Frame]) -> tuple[list[Outcome], Known | None]:
        """The frames that are done, and what they leave to the next one.

        Raises
        ------
        LightFieldError
            If a map is there that was made of something else.
        """
        done = [self._done(number, frame) for number, frame in enumerate(frames)]
        count = next((number for number, each in enumerate(done) if each is None), len(done))
        outcomes = [each for each in done[:count] if each is not None]
        if count in (0, len(frames)):
            return outcomes, None
        known = _read_state(self._state(count - 1))
        return (outcomes, known) if known is not None else ([], None)  # all again: it gives the same

    def _done(self, number: int, frame: Frame) -> Outcome | None:
        path = self.target(number)
        found = told_by(path, (_MADE_OF, _FACTS), "a map of a video")
        if found is None:
            return None
        made_of, facts = found
        check_made_of(path, made_of, self.made_of(frame))
        return _outcome(frame, path, "there", facts)

    def _write(
        self,
        number: int,
        frame: Frame,
        lf: LightField,
        result: Result,
        known: Known,
        facts: Mapping[str, Any],
    ) -> None:
        """Write what the next frame needs, then the map: where that is, all is."""
        from PIL import Image

        from lfdepth.pictures import view_colours

        make_folder(self._state(number).parent)
        with atomic(self._state(number)) as temporary:
            np.savez(temporary, allow_pickle=False, **_state_arrays(known))
        view = Image.fromarray(np.ascontiguousarray(view_colours(lf.reference)))
        view.thumbnail((_THUMBNAIL, _THUMBNAIL))
        make_folder(self.out / THUMBNAILS)
        with atomic(_thumbnail(self.target(number))) as temporary:
            view.save(temporary, "WEBP", quality=90)
        record = as_record(result)
        words = {
            "parameters": record.parameters,
            _MADE_OF: json.dumps(self.made_of(frame), sort_keys=True),
            _FACTS: json.dumps(facts, sort_keys=True),
        }
        with atomic(self.target(number)) as temporary:
            np.savez(
                temporary,
                allow_pickle=False,
                range=np.asarray(result.range),
                **record.arrays(),
                **{key: np.asarray(value) for key, value in words.items()},
            )
        if number:
            with suppress(OSError):
                self._state(number - 1).unlink()


def _check_outside(out: Path, paths: Sequence[str | Path]) -> None:
    """Raise LightFieldError where maps would lie among the frames, and be taken for frames later."""
    for path in paths:
        if out.resolve().is_relative_to(Path(path).resolve()):
            raise LightFieldError(
                f"{out}: lies in {path}; expected a folder beside the frames; choose another"
            )


def _uneven(result: Result) -> float:
    return result.checks.uneven if result.checks else 0.0


def _check_alike(lf: LightField, frame: Frame, known: Known | None, first: Frame) -> None:
    """Raise LightFieldError unless a frame has the size of the one before."""
    if known is not None and lf.shape != known.shape:
        raise LightFieldError(
            f"{frame.name}: {_size(lf.shape)}; expected {_size(known.shape)} as in {first.name}; give all "
            "frames the same size (crop, scale, views)"
        )


def _size(shape: Sequence[int]) -> str:
    v, u, height, width, channels = shape
    return f"{u}x{v} views of {width}x{height} px, {channels} channels"


def _shown(ends: Range) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}"


def _outcome(frame: Frame, path: Path, status: str, facts: Mapping[str, Any]) -> Outcome:
    low, high = facts["range"]
    return Outcome(
        frame=frame.name,
        file=path.name,
        status=status,
        range=(float(low), float(high)),
        cut=bool(facts["cut"]),
        still=float(facts["still"]),
        warnings=tuple(facts["warnings"]),
    )


# --- what a frame leaves to the next one


def _state_arrays(known: Known) -> dict[str, NDArray[Any]]:
    arrays: dict[str, Any] = {
        "shape": known.shape,
        "white": np.nan if known.white is None else known.white,
        "range": known.range,
        "noise": known.noise,
        "uneven": known.uneven,
    }
    arrays |= {f"past_{each.name}": getattr(known.past, each.name) for each in fields(Past)}
    if (found := known.equalisation) is not None:
        arrays |= {f"{_BRIGHTNESS}{name}": array for name, array in found.arrays().items()}
    return {key: np.asarray(value) for key, value in arrays.items()}


def _read_state(path: Path) -> Known | None:
    """What a frame left; None where that is missing or damaged."""
    try:
        with np.load(path) as found:
            arrays = dict(found)
        parts = {
            name.removeprefix(_BRIGHTNESS): each
            for name, each in arrays.items()
            if name.startswith(_BRIGHTNESS)
        }
        low, high = arrays["range"].tolist()
        white = float(arrays["white"])
        return Known(
            shape=tuple(arrays["shape"].tolist()),
            white=None if np.isnan(white) else white,
            range=(low, high),
            noise=float(arrays["noise"]),
            uneven=float(arrays["uneven"]),
            equalisation=Equalisation.of_arrays(parts) if parts else None,
            past=Past(**{each.name: arrays[f"past_{each.name}"] for each in fields(Past)}),
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile):
        return None


# --- what is looked at


def _thumbnail(path: Path) -> Path:
    return path.parent / THUMBNAILS / f"{path.stem}.webp"


def _write_index(folder: Path, video: Video) -> None:
    texts = {INDEX: json.dumps(video.as_dict(), indent=1) + "\n", TABLE: video.table().to_csv()}
    for name, text in texts.items():
        with atomic(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    pictures = _pictures(folder, video)
    with atomic(folder / PREVIEW) as temporary:
        next(pictures).save(
            temporary,
            "WEBP",
            save_all=True,
            append_images=pictures,
            duration=_FRAME_MS,
            loop=0,
            quality=80,
        )


def _pictures(folder: Path, video: Video) -> Iterator[Any]:
    """View and map side by side, of each frame, in the colours of one scale."""
    from PIL import Image

    from lfdepth.pictures import disparity_colours

    low = min(each.range[0] for each in video.outcomes)
    high = max(each.range[1] for each in video.outcomes)
    for each in video.outcomes:
        path = folder / each.file
        with np.load(path) as found:
            colours = Image.fromarray(disparity_colours(found["disparity"], (low, high)))
        with Image.open(_thumbnail(path)) as opened:
            view = opened.convert("RGB")
        both = Image.new("RGB", (2 * view.width, view.height))
        both.paste(view, (0, 0))
        both.paste(colours.resize(view.size, Image.Resampling.NEAREST), (view.width, 0))
        yield both
