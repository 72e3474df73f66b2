"""Folders of views whose names hold a row and a column, or a running number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.io import limits
from lfdepth.io.atomic import atomic_folder
from lfdepth.io.layout import Layout, size
from lfdepth.io.names import (
    Name,
    camera_positions,
    check_grid,
    find_views,
    pictures,
    place_views,
    subfolders,
    view_name,
)
from lfdepth.io.notes import FILE, MASK, TRUTH, Notes, notes_of, read_notes
from lfdepth.io.pfm import read_pfm, write_pfm
from lfdepth.io.picture import checked_name, read_picture, stated_white, write_mask, write_picture
from lfdepth.io.positions import TABLE, read_positions
from lfdepth.io.record import Record
from lfdepth.io.source import ViewSource
from lfdepth.lightfield import LightField

# What `write_folder` calls views, the truth, and the folder of masks.
_OWN = re.compile(r"view_v(\d+)_u(\d+)\.(?:png|tif)")
_TRUTH, _MASKS = "truth.pfm", "masks"


def recognise(path: Path) -> bool:
    """True for a folder with several pictures, numbered folders of them, or notes of lfdepth's own."""
    return path.is_dir() and (
        len(pictures(path)) > 1 or read_notes(path / FILE) is not None or len(subfolders(path)) > 1
    )


def open_folder(path: Path, layout: Layout) -> ViewSource:
    """Open a folder of views, a picture each.

    The names are alike but for their numbers. Two numbers that differ between files are row and column, or
    column and row where letters before them say so (`u`, `x`, `c`, `col` and `v`, `y`, `r`, `row`). One
    number that differs counts the views row by row, or along a single row or column where a letter says so.
    Numbers may start anywhere and go in steps. Where a grid is asked for that takes as many views as there
    are, other names are views in their order. Names that end in row, column, y and x tell where the cameras
    stand, and so does a table beside them (`positions.csv`).

    Views may lie in folders of their own, of which the first picture is read, or in folders of a row each.
    Maps and masks that are named so are left out. Folders that lfdepth wrote have notes, which say more.

    Raises
    ------
    LightFieldError
        If names do not fit together, views are missing and it is not meant, or the grid is not the one
        asked for.
    """
    limits.check_inside(path, [path / FILE, path / TABLE])
    notes = read_notes(path / FILE)
    if notes is not None:
        return _open_own(path, layout, notes)
    found = find_views(path, layout)
    places, grid = place_views(path, found.names, layout)
    files = dict(_placed(found.names, places, grid))
    table = path / TABLE
    positions = (
        read_positions(table, grid) if table.is_file() else camera_positions(found.names, places, grid)
    )
    source = _source(path, files, grid, layout)
    white = stated_white(next(iter(files.values())))
    return replace(source, positions=positions, remarks=found.remarks, white=white)


def write_folder(path: Path, lf: LightField) -> None:
    """Write a picture for each view, `view_v00_u00.png`, and what else is known of the light field.

    Float views become TIFF. Notes are in `lightfield.json`, the truth in `truth.pfm`, masks in the folder
    `masks`. A folder is replaced if it is empty or was written so and holds nothing else.
    """
    ending = "tif" if lf.views.dtype == np.float32 else "png"
    with atomic_folder(path) as folder:
        for v, u in np.ndindex(*lf.shape[:2]):
            if lf.present is None or lf.present[v, u]:
                write_picture(folder / view_name("view", (v, u), lf.shape[:2], ending), lf.views[v, u])
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
    limits.check_grid(path, grid)
    check_grid(path, grid, layout)
    source = _source(path, _own_files(path, grid), grid, Layout(partial=True))
    if source.present is not None:
        missing = ~source.present if notes.present is None else ~source.present & notes.present
        row, column = divmod(int(np.argmax(missing)), grid[1])
        layout.checked(~missing, str(path), f"row {row}, column {column}")
    mask_files = sorted((path / _MASKS).glob("*.png"))
    limits.check_inside(path, [path / _TRUTH, path / _MASKS, *mask_files])
    truth = {TRUTH: read_pfm(path / _TRUTH)} if (path / _TRUTH).exists() else {}
    masks = {f"{MASK}{file.stem}": read_picture(file) for file in mask_files}
    return replace(notes.annotate(source, truth | masks), present=source.present)


def _own_files(path: Path, grid: tuple[int, int]) -> dict[tuple[int, int], Path]:
    files = {}
    for file in pictures(path):
        named = _OWN.fullmatch(file.name)
        position = (int(named[1]), int(named[2])) if named else grid
        if position[0] >= grid[0] or position[1] >= grid[1]:
            raise LightFieldError(
                f"{file}: surplus picture; expected view_vROW_uCOLUMN in a grid of {size(grid)}, as {FILE} "
                "says; move it elsewhere"
            )
        files[position] = file
    return files


def _placed(
    names: Sequence[Name], positions: Sequence[tuple[int, int]], grid: tuple[int, int]
) -> list[tuple[tuple[int, int], Path]]:
    seen: dict[tuple[int, int], Path] = {}
    for name, position in zip(names, positions, strict=True):
        if position in seen:
            raise LightFieldError(
                f"{name.file}: has the same place in the grid as {seen[position].name}; expected one picture "
                "per view; move one elsewhere"
            )
        if position[0] >= grid[0]:
            raise LightFieldError(
                f"{name.file}: outside the grid of {size(grid)}; expected {grid[0] * grid[1]} views; change "
                "the grid"
            )
        seen[position] = name.file
    return list(seen.items())


def _source(
    path: Path, files: dict[tuple[int, int], Path], grid: tuple[int, int], layout: Layout
) -> ViewSource:
    limits.check_grid(path, grid)
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
