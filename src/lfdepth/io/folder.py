"""Folders of views whose names hold a row and a column, or a running number."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import gcd
from pathlib import Path

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic_folder
from lfdepth.io.layout import Layout, size
from lfdepth.io.limits import check_grid, check_inside
from lfdepth.io.notes import FILE, MASK, TRUTH, Notes, notes_of, read_notes
from lfdepth.io.pfm import read_pfm, write_pfm
from lfdepth.io.picture import ENDINGS, checked_name, read_picture, write_mask, write_picture
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

# Stanford (new) light field archive: out_ROW_COLUMN_Y_X.png with the camera's position on the gantry.
_STANFORD = re.compile(r"out_(\d+)_(\d+)_-?\d+(?:\.\d+)?_-?\d+(?:\.\d+)?_?")
# What `write_folder` calls views, the truth, and the folder of masks.
_OWN = re.compile(r"view_v(\d+)_u(\d+)\.(?:png|tif)")
_TRUTH, _MASKS = "truth.pfm", "masks"
_ROW_TAGS = {"v", "y", "r", "row"}
_COLUMN_TAGS = {"u", "x", "c", "col", "column"}


@dataclass(frozen=True)
class _Name:
    """A file name without its ending, taken apart: the texts around the whole numbers in it."""

    file: Path
    texts: tuple[str, ...]
    numbers: tuple[int, ...]

    @staticmethod
    def of(file: Path) -> _Name:
        if stanford := _STANFORD.fullmatch(file.stem):
            return _Name(file, ("out_", "_", "_"), (int(stanford[1]), int(stanford[2])))
        parts = re.split(r"(\d+)", file.stem)
        return _Name(file, tuple(parts[::2]), tuple(map(int, parts[1::2])))

    def tag(self, field: int) -> str:
        """Letters right before a number: u, v, row, ..."""
        return re.split(r"[^a-z]", self.texts[field].lower())[-1]


def recognise(path: Path) -> bool:
    """True for a folder with more than one picture, or with notes of lfdepth's own."""
    return path.is_dir() and ((path / FILE).is_file() or len(_pictures(path)) > 1)


def open_folder(path: Path, layout: Layout) -> ViewSource:
    """Open a folder of views, a picture each.

    The names are alike but for their numbers. Two numbers that differ between files are row and column, or
    column and row where letters before them say so (`u`, `x`, `c`, `col` and `v`, `y`, `r`, `row`). One
    number that differs counts the views row by row, or along a single row or column where a letter says so.
    Numbers may start anywhere and go in steps. Folders that lfdepth wrote have notes, which say more.

    Raises
    ------
    LightFieldError
        If names do not fit together, views are missing and it is not meant, or the grid is not the one
        asked for.
    """
    check_inside(path, [path / FILE])
    notes = read_notes(path / FILE)
    if notes is not None:
        return _open_own(path, layout, notes)
    names = [_Name.of(file) for file in _pictures(path)]
    _check_alike(path, names)
    fields = [i for i in range(len(names[0].numbers)) if len({name.numbers[i] for name in names}) > 1]
    if len(fields) == 2:
        positions, grid = _by_row_and_column(names, fields)
        _check_grid(path, grid, layout)
    elif len(fields) == 1:
        positions, grid = _by_number(path, names, fields[0], layout)
    else:
        raise LightFieldError(
            f"{path}: {len(names)} pictures whose names differ in {len(fields)} numbers; expected row and "
            "column, "
            "or a running number; rename them"
        )
    return _source(path, dict(_placed(names, positions, grid)), grid, layout)


def write_folder(path: Path, lf: LightField) -> None:
    """Write a picture for each view, `view_v00_u00.png`, and what else is known of the light field.

    Float views become TIFF. Notes are in `lightfield.json`, the truth in `truth.pfm`, masks in the folder
    `masks`. A folder is replaced if it is empty or was written so and holds nothing else.
    """
    ending = "tif" if lf.views.dtype == np.float32 else "png"
    digits = max(2, len(str(max(lf.shape[:2]) - 1)))
    with atomic_folder(path) as folder:
        for v, u in np.ndindex(*lf.shape[:2]):
            if lf.present is None or lf.present[v, u]:
                write_picture(folder / f"view_v{v:0{digits}d}_u{u:0{digits}d}.{ending}", lf.views[v, u])
        (folder / FILE).write_text(notes_of(lf).text(), encoding="utf-8")
        if lf.truth is not None:
            write_pfm(folder / _TRUTH, Record(lf.truth))
        if lf.masks:
            (folder / _MASKS).mkdir()
        for name, mask in lf.masks.items():
            write_mask(folder / _MASKS / f"{checked_name(name, path)}.png", mask)


def _open_own(path: Path, layout: Layout, notes: Notes) -> ViewSource:
    """A folder that `write_folder` wrote: names are positions in the grid that the notes tell."""
    grid = notes.shape[:2]
    check_grid(path, grid)
    _check_grid(path, grid, layout)
    source = _source(path, _own_files(path, grid), grid, Layout(partial=True))
    if source.present is not None:
        missing = ~source.present if notes.present is None else ~source.present & notes.present
        row, column = divmod(int(np.argmax(missing)), grid[1])
        layout.checked(~missing, str(path), f"row {row}, column {column}")
    mask_files = sorted((path / _MASKS).glob("*.png"))
    check_inside(path, [path / _TRUTH, path / _MASKS, *mask_files])
    truth = {TRUTH: read_pfm(path / _TRUTH)} if (path / _TRUTH).exists() else {}
    masks = {f"{MASK}{file.stem}": read_picture(file) for file in mask_files}
    return replace(notes.annotate(source, truth | masks), present=source.present)


def _own_files(path: Path, grid: tuple[int, int]) -> dict[tuple[int, int], Path]:
    files = {}
    for file in _pictures(path):
        named = _OWN.fullmatch(file.name)
        position = (int(named[1]), int(named[2])) if named else grid
        if position[0] >= grid[0] or position[1] >= grid[1]:
            raise LightFieldError(
                f"{file}: surplus picture; expected view_vROW_uCOLUMN in a grid of {size(grid)}, as {FILE} "
                "says; move it elsewhere"
            )
        files[position] = file
    return files


def _pictures(path: Path) -> list[Path]:
    found = sorted(
        file for file in path.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")
    )
    check_inside(path, found)
    return found


def _check_alike(path: Path, names: Sequence[_Name]) -> None:
    patterns = Counter(name.texts for name in names)
    if not patterns:
        raise LightFieldError(
            f"{path}: holds no pictures; expected {', '.join(ENDINGS)} files; check the path"
        )
    usual, _ = patterns.most_common(1)[0]
    for name in names:
        if name.texts != usual:
            example = next(other.file.name for other in names if other.texts == usual)
            raise LightFieldError(
                f"{name.file}: surplus picture; expected names that differ from {example} only in their "
                "numbers; "
                "move it elsewhere"
            )


def _by_row_and_column(
    names: Sequence[_Name], fields: Sequence[int]
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    first, second = fields
    if names[0].tag(first) in _COLUMN_TAGS and names[0].tag(second) not in _COLUMN_TAGS:
        first, second = second, first
    rows, columns = (_ranks([name.numbers[field] for name in names]) for field in (first, second))
    return list(zip(rows, columns, strict=True)), (max(rows) + 1, max(columns) + 1)


def _by_number(
    path: Path, names: Sequence[_Name], field: int, layout: Layout
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    ranks = _ranks([name.numbers[field] for name in names])
    count = max(ranks) + 1
    tag = names[0].tag(field)
    if layout.grid is None and tag in _COLUMN_TAGS | _ROW_TAGS:
        grid = (1, count) if tag in _COLUMN_TAGS else (count, 1)
    else:
        grid = layout.of_count(count, str(path))
    return [divmod(rank, grid[1]) for rank in ranks], grid


def _ranks(numbers: Sequence[int]) -> list[int]:
    """Count from the smallest, in steps of the greatest common difference: gaps stay gaps."""
    start = min(numbers)
    step = gcd(*(number - start for number in numbers)) or 1
    return [(number - start) // step for number in numbers]


def _check_grid(path: Path, grid: tuple[int, int], layout: Layout) -> None:
    if layout.grid not in (None, grid):
        raise LightFieldError(
            f"{path}: names give a grid of {size(grid)}; expected {size(layout.grid or grid)} as asked for; "
            "leave the grid out or correct it"
        )


def _placed(
    names: Sequence[_Name], positions: Sequence[tuple[int, int]], grid: tuple[int, int]
) -> list[tuple[tuple[int, int], Path]]:
    seen: dict[tuple[int, int], Path] = {}
    for name, position in zip(names, positions, strict=True):
        if position in seen:
            raise LightFieldError(
                f"{name.file}: at the same place in the grid as {seen[position].name}; expected one "
                "picture for "
                "each view; move one elsewhere"
            )
        if position[0] >= grid[0]:
            raise LightFieldError(
                f"{name.file}: outside the grid of {size(grid)}; expected {grid[0] * grid[1]} views; "
                "correct the grid"
            )
        seen[position] = name.file
    return list(seen.items())


def _source(
    path: Path, files: dict[tuple[int, int], Path], grid: tuple[int, int], layout: Layout
) -> ViewSource:
    check_grid(path, grid)
    present = np.zeros(grid, dtype=bool)
    for position in files:
        present[position] = True
    row, column = divmod(int(np.argmin(present)), grid[1])
    return ViewSource(
        grid=grid,
        read_view=lambda v, u: read_picture(files[v, u]),
        describe=lambda v, u: str(files.get((v, u), f"{path}: view in row {v}, column {u}")),
        present=layout.checked(present, str(path), f"row {row}, column {column}"),
        name=path.resolve().name,
    )
