"""What a light field says of itself beside its samples: grid, absent views, range and camera, as JSON.

Light fields that lfdepth writes carry it, so that they are read back as they were: in arrays' files under the
name `lfdepth`, in folders as `lightfield.json`, beside other files as `NAME.json`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import inf, isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.io.limits import read_text, readable
from lfdepth.io.record import checked_map
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField, check_range

KEY = "lfdepth"
"""Name of the array, dataset, variable or attribute that holds the JSON."""

FILE = "lightfield.json"
"""Name of the file that holds it in a folder."""

TRUTH, MASK = "truth", "mask_"
"""Name of the truth, and what comes before the names of masks, among the arrays of a file."""

_FORMAT = "light field"


@dataclass(frozen=True, eq=False)
class Notes:
    """What is known of a light field that its samples do not say.

    Attributes
    ----------
    shape
        (V, U, H, W, C), the order of axes of the array that the samples are in.
    present, disparity_range, camera, positions
        As in `LightField`.
    white
        Value of white among the samples, for types that many files fill only in part.
    """

    shape: tuple[int, int, int, int, int]
    present: npt.NDArray[np.bool_] | None = None
    disparity_range: tuple[float, float] | None = None
    camera: Camera | None = None
    positions: npt.NDArray[np.float64] | None = None
    white: float | None = None

    def text(self) -> str:
        """The same as JSON; an infinite focus distance is null there."""
        known: dict[str, Any] = {KEY: _FORMAT, "shape": list(self.shape)}
        if self.present is not None:
            known["present"] = ["".join("01"[int(there)] for there in row) for row in self.present]
        if self.disparity_range is not None:
            known["disparity_range"] = list(self.disparity_range)
        if self.camera is not None:
            known["camera"] = {key: _finite(value) for key, value in asdict(self.camera).items()}
        if self.positions is not None:
            known["positions"] = self.positions.tolist()
        if self.white is not None:
            known["white"] = self.white
        return json.dumps(known, indent=2, allow_nan=False) + "\n"

    def annotate(self, source: ViewSource, maps: Mapping[str, Any] | None = None) -> ViewSource:
        """Views with what is known of them.

        Parameters
        ----------
        source
            Views.
        maps
            Arrays (H, W) of the same file, among them `truth` and `mask_NAME`.
        """
        size = self.shape[2:4]
        maps = {} if maps is None else maps
        truth = _map(maps[TRUTH], size, f"{source.name}: {TRUTH}") if TRUTH in maps else None
        return replace(
            source,
            present=self.present,
            disparity_range=self.disparity_range,
            camera=self.camera,
            positions=self._absolute(),
            white=source.white if self.white is None else self.white,
            truth=truth,
            masks={
                name.removeprefix(MASK): _map(values, size, f"{source.name}: {name}") != 0
                for name, values in maps.items()
                if name.startswith(MASK)
            },
        )

    def _absolute(self) -> npt.NDArray[np.float64] | None:
        """Where cameras stand, in view steps from the first one's place."""
        if self.positions is None:
            return None
        return self.positions + np.moveaxis(np.indices(self.shape[:2]), 0, -1)


@dataclass(frozen=True, eq=False)
class Bundle:
    """A light field as named arrays: `LF` (V, U, H, W, C), `truth`, `mask_NAME`; and its notes."""

    arrays: Mapping[str, npt.NDArray[Any]]
    text: str = field(repr=False)

    @staticmethod
    def of(lf: LightField) -> Bundle:
        """Masks become uint8, 0 and 1: not every format has truth values."""
        arrays: dict[str, npt.NDArray[Any]] = {"LF": lf.views}
        if lf.truth is not None:
            arrays[TRUTH] = lf.truth
        arrays |= {f"{MASK}{name}": mask.astype(np.uint8) for name, mask in lf.masks.items()}
        return Bundle(arrays, notes_of(lf).text())


def notes_of(lf: LightField) -> Notes:
    """The notes of a light field."""
    white = lf.full_scale if lf.views.dtype == np.uint16 else None
    return Notes(lf.shape, lf.present, lf.disparity_range, lf.camera, lf.positions, white)


def parse_notes(text: object, what: str) -> Notes | None:
    """Notes from JSON; None if it is not about a light field.

    Raises
    ------
    LightFieldError
        If it is, and is garbled; `what` names it.
    """
    try:
        known = json.loads(str(text))
    except (ValueError, RecursionError):
        return None
    if not (isinstance(known, dict) and known.get(KEY) == _FORMAT):
        return None
    try:
        notes = Notes(
            _shape(known["shape"]),
            _present(known),
            _range(known),
            _camera(known),
            _positions(known),
            None if known.get("white") is None else float(known["white"]),
        )
        if notes.disparity_range is not None:
            check_range(notes.disparity_range, "disparity_range")
        if notes.present is not None and notes.present.shape != notes.shape[:2]:
            raise ValueError(f"present is {notes.present.shape}")
        if notes.positions is not None and notes.positions.shape != (*notes.shape[:2], 2):
            raise ValueError(f"positions are {notes.positions.shape}")
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise LightFieldError(
            f"{what}: garbled ({' '.join(str(error).split())[:100]}); expected shape, present, "
            "disparity_range and camera as lfdepth writes them; write the light field again"
        ) from None
    return notes


def read_notes(path: Path) -> Notes | None:
    """Notes in a JSON file; None if there is none, or it is about something else."""
    try:
        text = read_text(path)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, UnicodeDecodeError):
        return None
    return parse_notes(text, str(path))


def beside(path: Path) -> Path:
    """Where the notes of a file are that cannot hold them."""
    return path.with_suffix(".json")


def _map(values: Any, size: tuple[int, ...], what: str) -> npt.NDArray[np.float32]:
    """A map as (H, W), whatever axes of length 1 its format dropped or added."""
    if prod(values.shape) != size[0] * size[1]:
        raise LightFieldError(
            f"{what}: array of shape {values.shape}; expected {size}, the views' size; "
            "write the light field again"
        )
    with readable(what):
        array = np.asarray(values[...])
    return checked_map(array.reshape(size), what, finite=False)


def _shape(known: list[int]) -> tuple[int, int, int, int, int]:
    v, u, h, w, c = (int(length) for length in known)
    if min(v, u, h, w, c) < 1:
        raise ValueError(f"shape is {known}")
    return v, u, h, w, c


def _present(known: dict[str, Any]) -> npt.NDArray[np.bool_] | None:
    rows = known.get("present")
    return None if rows is None else np.array([[there == "1" for there in row] for row in rows], np.bool_)


def _positions(known: dict[str, Any]) -> npt.NDArray[np.float64] | None:
    offsets = known.get("positions")
    return None if offsets is None else np.array(offsets, np.float64)


def _range(known: dict[str, Any]) -> tuple[float, float] | None:
    if known.get("disparity_range") is None:
        return None
    low, high = known["disparity_range"]
    return float(low), float(high)


def _camera(known: dict[str, Any]) -> Camera | None:
    if known.get("camera") is None:
        return None
    values = dict(known["camera"])
    if values.get("focus_distance_m") is None:
        values["focus_distance_m"] = inf
    if values.get("centre") is not None:
        values["centre"] = tuple(values["centre"])
    return Camera(**values)


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value
