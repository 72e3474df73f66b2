"""The demonstration: a light field with exact truth, our own methods on it, and one picture of them all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lfdepth.errors import LightFieldError
from lfdepth.methods import FAMILY
from lfdepth.table import Table

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField
    from lfdepth.scoring import Scores
    from lfdepth.trace import Progress

SIZE = 320
"""Side of the demo's views, px."""

SMALLEST = 64
"""Shortest side that leaves pixels to score inside the metrics' border, px."""

PICTURE = "demo.png"
"""File name of the picture."""

_COLUMNS = {
    "badpix_0.01": "BadPix 0.01",
    "badpix_0.03": "0.03",
    "badpix_0.07": "0.07",
    "badpix_0.07_boundaries": "boundaries",
    "mse_x100": "MSE×100",
    "q25": "Q25",
    "runtime": "seconds",
}
_LEGEND = """\
BadPix: % of pixels whose error exceeds 0.01, 0.03, 0.07 px per view step;
boundaries: BadPix 0.07 within 5 px of occlusion boundaries"""

Announce = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Demo:
    """What a demonstration found.

    Attributes
    ----------
    lf : LightField
        The scene, with truth.
    scores : mapping of str to Scores
        By method.
    picture : Path
        Reference view, truth, each method's map and its signed error.
    """

    lf: LightField
    scores: Mapping[str, Scores]
    picture: Path

    def table(self) -> str:
        """Text table, a line per method: percentages of bad pixels, MSE×100, Q25, seconds; and a legend."""
        rows = [(name, *(scores.get(key) for key in _COLUMNS)) for name, scores in self.scores.items()]
        return "\n".join([Table.of(("method", *_COLUMNS.values()), rows).to_text(), "", _LEGEND])

    def as_dict(self) -> dict[str, Any]:
        """Plain dictionary that JSON can hold."""
        return {
            "scene": self.lf.name,
            "shape": list(self.lf.shape),
            "disparity_range": self.lf.disparity_range,
            "methods": {name: scores.as_dict() for name, scores in self.scores.items()},
            "picture": str(self.picture),
        }


def run_demo(
    folder: str | Path,
    *,
    size: int = SIZE,
    announce: Announce | None = None,
    progress: Progress | None = None,
) -> Demo:
    """Render the demo scene, estimate it with each of our own methods, score the maps and write one picture.

    Parameters
    ----------
    folder : str or Path
        Where `demo.png` is written; made if it is missing.
    size : int
        Side of the views, px, at least 64.
    announce : callable, optional
        Called with a few words before each part of the work.
    progress : callable, optional
        Called with (steps done, steps in all, what was done) while a method works.

    Raises
    ------
    LightFieldError
        If the size is too small or the folder cannot be written.
    """
    if size < SMALLEST:
        raise LightFieldError(f"size: found {size}, expected at least {SMALLEST} px; choose a larger one")
    from lfdepth import evaluate, scenes
    from lfdepth.bench.timing import timed_estimate
    from lfdepth.io.atomic import check_target
    from lfdepth.methods import method
    from lfdepth.pictures import PanelRow, panel
    from lfdepth.scoring.captions import score_line

    say = announce or (lambda words: None)
    with _folder(Path(folder)) as made:
        picture = made / PICTURE
        check_target(picture)
        say("rendering the scene")
        lf = scenes.render("demo", size=size)
        maps, scores, captions = {}, {}, {}
        for name in FAMILY:
            say(f"estimating with {name}")
            result = timed_estimate(lf, method(name), progress=progress)
            maps[name], scores[name] = result.disparity, evaluate(result, lf)
            captions[name] = score_line(scores[name])
        row = PanelRow(lf.reference, maps, lf.truth, lf.name, lf.disparity_range, captions)
        panel(row, path=picture)
    return Demo(lf, scores, picture)


@contextmanager
def _folder(path: Path) -> Iterator[Path]:
    """Make a folder where it is missing, and remove it again if the work fails before it holds anything."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LightFieldError(
            f"{path}: cannot be created ({error.strerror}); expected a writable folder; choose another"
        ) from error
    try:
        yield path
    except BaseException:
        for folder in missing:
            if any(folder.iterdir()):
                break
            folder.rmdir()
        raise
