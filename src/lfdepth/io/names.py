"""What names of pictures say: which of them are views, and where in the grid."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fnmatch import fnmatch
from math import gcd
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lfdepth.errors import LightFieldError
from lfdepth.io import limits
from lfdepth.io.layout import Layout, size
from lfdepth.io.picture import ENDINGS

# PREFIX_ROW_COLUMN_Y_X with the camera's position, as in the (new) Stanford light field archive, whose prefix
# is "out". Elsewhere, at least one of the positions has to have decimals: other numbers have none.
_POSITIONED = re.compile(r"(.*?)(\d+)_(\d+)_(-?\d+(?:\.\d+)?)_(-?\d+(?:\.\d+)?)_?")
# What phones add to the name of one picture of a burst.
_COVER = re.compile(r"_COVER$", re.IGNORECASE)
# Whole numbers; a sign belongs to one where no letter or digit comes right before it, but v, u, x, y, r or c.
_SIGNED = r"(?:(?<![0-9A-Za-z])|(?<=[^A-Za-z][vuxyrc])|(?<=^[vuxyrc]))[+-]"
_NUMBER = re.compile(rf"((?:{_SIGNED})?\d+)", re.IGNORECASE)
_DECIMAL = re.compile(r"(-?\d+\.\d+)")
_ROW_TAGS = {"v", "y", "r", "row"}
_COLUMN_TAGS = {"u", "x", "c", "col", "column"}
# Words in the names of pictures that belong to views and are none.
_BESIDE = re.compile(
    r"alpha|conf(idence)?|depths?|disp(arity|arities)?|edges?|errors?|flow|gt|ground|truth|index|labels?|"
    r"masks?|matte|normals?|preview|seg(mentation)?|semantic|thumb(nail)?s?|weights?"
)

Grid = tuple[int, int]


@dataclass(frozen=True)
class Name:
    """A file name without its ending, taken apart: the texts around the whole numbers in it.

    Attributes
    ----------
    file
        The picture.
    texts, numbers
        Alternating parts of the name.
    position
        (y, x) of the camera, if the name tells it.
    minus
        Which numbers have a minus before them.
    """

    file: Path
    texts: tuple[str, ...]
    numbers: tuple[int, ...]
    position: tuple[float, float] | None = None
    minus: tuple[bool, ...] = ()

    @staticmethod
    def of(file: Path, label: str | None = None) -> Name:
        """Take a file's name apart, or what else stands for it."""
        stem = _COVER.sub("", file.stem if label is None else label)
        found = _POSITIONED.fullmatch(stem)
        if found and (found[1] == "out_" or "." in found[4] + found[5]):
            place = int(found[2]), int(found[3])
            return Name(file, (found[1], "_", "_"), place, (float(found[4]), float(found[5])))
        parts = _NUMBER.split(stem)
        minus = tuple(part.startswith("-") for part in parts[1::2])
        return Name(file, tuple(parts[::2]), tuple(map(int, parts[1::2])), minus=minus)

    def tag(self, field: int) -> str:
        """Letters right before a number: u, v, row, ..."""
        return re.split(r"[^a-z]", self.texts[field].lower())[-1]

    @property
    def kind(self) -> tuple[tuple[str, ...], bool]:
        """What names of one set of pictures have in common."""
        return self.texts, self.file.suffix.lower() == ".exr"

    @property
    def is_beside(self) -> bool:
        """Whether a word of the name says that it is a map or a mask, not a view."""
        words = (word for text in self.texts for word in re.split(r"[^a-z]+", text.lower()))
        return any(_BESIDE.fullmatch(word) for word in words)


@dataclass(frozen=True)
class Found:
    """The pictures of a folder that are views.

    Attributes
    ----------
    names
        Their names.
    remarks
        What was left out, in words.
    """

    names: tuple[Name, ...]
    remarks: tuple[str, ...] = ()


def pictures(path: Path) -> list[Path]:
    """The pictures in a folder."""
    found = sorted(
        file for file in path.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")
    )
    limits.check_inside(path, found)
    return found


def subfolders(path: Path) -> list[Path]:
    """The folders in a folder whose names hold a number and which hold pictures."""
    return sorted(
        (each for each in path.iterdir() if each.is_dir() and re.search(r"\d", each.name) and pictures(each)),
        key=lambda each: natural(each.name),
    )


def find_views(path: Path, layout: Layout) -> Found:
    """The pictures of a folder, or of the folders in it, that are views.

    Raises
    ------
    LightFieldError
        If there are none, or others are among them.
    """
    direct = pictures(path)
    nested = not direct or (layout.pattern is not None and "/" in layout.pattern)
    files = [file for folder in subfolders(path) for file in pictures(folder)] if nested else direct
    if layout.pattern is not None:
        chosen = [file for file in files if fnmatch(file.relative_to(path).as_posix(), layout.pattern)]
        if not chosen:
            raise LightFieldError(
                f"{path}: none of {len(files)} pictures matches {layout.pattern}; expected views; change the "
                "pattern (--pattern, * matches anything)"
            )
        files = chosen
    if not files:
        raise LightFieldError(
            f"{path}: holds no pictures; expected {', '.join(ENDINGS)} files; check the path"
        )
    found = _in_folders(path, files, layout) if nested else Found(tuple(map(Name.of, files)))
    return _without_others(found, layout)


def place_views(path: Path, names: Sequence[Name], layout: Layout) -> tuple[list[Grid], Grid]:
    """Row and column of each view, and the grid.

    Raises
    ------
    LightFieldError
        If the numbers in the names do not tell, or the grid is not the one asked for.
    """
    alike = len({name.texts for name in names}) == 1
    fields = _varying(names) if alike else []
    if (decimals := _as_decimals(names)) is not None:
        names, fields = decimals, [0, 1]
    if len(fields) == 2:
        positions, grid = _by_row_and_column(names, fields)
        complete = grid[0] * grid[1] == len(set(positions)) == len(names)
        # A cross of n views has a grid of less than n² places; more are dates and times.
        if complete or (not _fits(layout, len(names)) and grid[0] * grid[1] <= len(names) ** 2):
            check_grid(path, grid, layout)
            return positions, grid
    elif len(fields) == 1 and not _uneven(names, fields[0], layout):
        return _by_number(path, names, fields[0], layout)
    if _fits(layout, len(names)):
        return _in_order(names, layout)
    raise LightFieldError(
        f"{path}: {len(names)} pictures whose names differ in {len(fields)} numbers; expected row and "
        "column, or a running number; rename them, or give the grid they fill, in the order of their names "
        "(--grid COLUMNSxROWS)"
    )


def camera_positions(
    names: Sequence[Name], places: Sequence[Grid], grid: Grid
) -> npt.NDArray[np.float64] | None:
    """Where the cameras of views stand by their names, (V, U, 2), NaN where a view is absent; or None."""
    if any(name.position is None for name in names):
        return None
    limits.check_grid(names[0].file.parent, grid)
    positions = np.full((*grid, 2), np.nan)
    for name, place in zip(names, places, strict=True):
        positions[place] = name.position
    return positions


def _in_folders(path: Path, files: Sequence[Path], layout: Layout) -> Found:
    """Pictures in folders: a folder for each view with frames inside, or for each row of views."""
    inside: dict[Path, list[Path]] = defaultdict(list)
    for file in files:
        inside[file.parent].append(file)
    folders = [Name.of(folder, folder.name) for folder in inside]
    most = max(map(len, inside.values()))
    numbers = len(_varying(folders)) if len({name.texts for name in folders}) == 1 else 0
    if most > 1 and numbers < 2 and not _fits(layout, len(folders)):
        return Found(tuple(Name.of(file, f"{file.parent.name}/{file.stem}") for file in files))
    common = set.intersection(*({file.name for file in each} for each in inside.values()))
    names = []
    for folder, each in inside.items():
        frames = [file for file in each if file.name in common] or each
        names.append(Name.of(min(frames, key=lambda file: natural(file.name)), folder.name))
    if most == 1:
        return Found(tuple(names))
    first = names[0].file.name
    return Found(
        tuple(names),
        (f"each view's folder holds up to {most} frames, of which {first} was read (--pattern '*/{first}')",),
    )


def _without_others(found: Found, layout: Layout) -> Found:
    """Leave maps and masks out; the rest has to be of one kind, unless its number is what the grid takes."""
    views = [name for name in found.names if not name.is_beside] or list(found.names)
    remarks = list(found.remarks)
    if left_out := [name.file.name for name in found.names if name not in views]:
        remarks.append(f"{len(left_out)} pictures that are not views were ignored, such as {left_out[0]}")
    kinds: dict[object, list[Name]] = defaultdict(list)
    for name in views:
        kinds[name.kind].append(name)
    if len(kinds) > 1 and not _fits(layout, len(views)):
        fitting = [names for names in kinds.values() if _fits(layout, len(names))]
        fitting = [names for names in fitting if all(_is_named_after(each, names) for each in fitting)]
        if len(fitting) != 1:
            raise _others(kinds.values())
        remarks.append(
            f"{len(views) - len(fitting[0])} pictures were ignored because they are not named like "
            f"{fitting[0][0].file.name}"
        )
        views = fitting[0]
    return Found(tuple(_without_hyphens(views)), tuple(remarks))


def _is_named_after(others: Sequence[Name], names: Sequence[Name]) -> bool:
    """Whether names are others' beginnings, as `0_0` is of `0_0_instances`."""
    stems = tuple(name.file.stem for name in names)
    return all(other.file.stem.startswith(stems) for other in others)


def _without_hyphens(names: Sequence[Name]) -> list[Name]:
    """The same where a minus that all names have before a number is none."""
    if len({name.texts for name in names}) != 1:
        return list(names)
    hyphens = [all(signs) for signs in zip(*(name.minus for name in names), strict=True)]
    return [
        replace(name, numbers=tuple(abs(n) if h else n for n, h in zip(name.numbers, hyphens, strict=False)))
        if hyphens
        else name
        for name in names
    ]


def _as_decimals(names: Sequence[Name]) -> list[Name] | None:
    """Names that tell two numbers with decimals each, as whole numbers in units of their last decimal."""
    parts = [_DECIMAL.split(name.file.stem) for name in names]
    if len({tuple(part[::2]) for part in parts}) != 1 or len(parts[0]) != 5:
        return None
    unit = 10 ** max(len(number.partition(".")[2]) for part in parts for number in part[1::2])
    return [
        Name(name.file, tuple(part[::2]), tuple(int(Decimal(number) * unit) for number in part[1::2]))
        for name, part in zip(names, parts, strict=True)
    ]


def _others(kinds: Iterable[list[Name]]) -> LightFieldError:
    """The error for a folder whose pictures have names of several kinds."""
    groups = sorted(kinds, key=len, reverse=True)
    usual = groups[0][0].file
    others = [name.file for names in groups[1:] for name in names]
    named = ", ".join(file.name for file in others[1:3])
    more = f" (so are {named}{' and others' if len(others) > 3 else ''})" if named else ""
    return LightFieldError(
        f"{others[0]}: surplus picture{more}; expected names that differ from {usual.name} only in their "
        f"numbers; move it elsewhere, {_pattern_of(groups[0], others)}"
        "or give the grid if all are (--grid)"
    )


def _pattern_of(names: Sequence[Name], others: Sequence[Path]) -> str:
    """Advice to select names of one kind, by a pattern that fits none of the others if there is one."""

    def fits(file: Path, pattern: str) -> bool:
        return fnmatch(file.name, pattern) or fnmatch(f"{file.parent.name}/{file.name}", pattern)

    texts, suffix = names[0].texts, names[0].file.suffix
    digits = re.sub(r"\d", "[0-9]", names[0].file.stem)
    for pattern in ("*".join(texts) + suffix, digits + suffix):
        if all(fits(name.file, pattern) for name in names) and not any(fits(f, pattern) for f in others):
            return f"select the views (--pattern '{pattern}'), "
    return "select the views (--pattern), "


def _varying(names: Sequence[Name]) -> list[int]:
    """Which numbers differ between names that are alike otherwise; those that go together count once."""
    fields: list[int] = []
    counts: list[list[int]] = []
    for field in range(len(names[0].numbers)):
        ranks = _ranks([name.numbers[field] for name in names])
        if max(ranks) > 0 and ranks not in counts:
            fields.append(field)
            counts.append(ranks)
    return fields


def _fits(layout: Layout, count: int) -> bool:
    return layout.grid is not None and layout.grid[0] * layout.grid[1] == count


def _in_order(names: Sequence[Name], layout: Layout) -> tuple[list[Grid], Grid]:
    assert layout.grid is not None
    order = sorted(range(len(names)), key=lambda i: natural(names[i].file.as_posix()))
    places: list[Grid] = [(0, 0)] * len(names)
    for rank, i in enumerate(order):
        row, column = divmod(rank, layout.grid[1])
        places[i] = row, column
    return places, layout.grid


def view_name(prefix: str, index: Grid, grid: Grid, ending: str) -> str:
    """Name of a file of view (v, u), such as `view_v00_u00.png`."""
    digits = max(2, len(str(max(grid) - 1)))
    return f"{prefix}_v{index[0]:0{digits}d}_u{index[1]:0{digits}d}.{ending}"


def natural(text: str) -> list[tuple[bool, int, str]]:
    """Order in which people count: 2 before 10."""
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", text)]


def _by_row_and_column(names: Sequence[Name], fields: Sequence[int]) -> tuple[list[Grid], Grid]:
    first, second = fields
    if names[0].tag(first) in _COLUMN_TAGS and names[0].tag(second) not in _COLUMN_TAGS:
        first, second = second, first
    rows, columns = (_ranks([name.numbers[field] for name in names]) for field in (first, second))
    return list(zip(rows, columns, strict=True)), (max(rows) + 1, max(columns) + 1)


def _uneven(names: Sequence[Name], field: int, layout: Layout) -> bool:
    """Whether a number has gaps although there are as many views as the grid takes: a time, not a count."""
    return _fits(layout, len(names)) and max(_ranks([name.numbers[field] for name in names])) >= len(names)


def _by_number(path: Path, names: Sequence[Name], field: int, layout: Layout) -> tuple[list[Grid], Grid]:
    ranks = _ranks([name.numbers[field] for name in names])
    count = max(ranks) + 1
    tag = names[0].tag(field)
    if layout.grid is None and tag in _COLUMN_TAGS | _ROW_TAGS:
        grid = (1, count) if tag in _COLUMN_TAGS else (count, 1)
    elif layout.grid is None and count > 2 * len(names):
        raise LightFieldError(
            f"{path}: {len(names)} pictures with irregular numbers, such as times; expected row and "
            "column, or a running number; give the grid they fill, in the order of their names (--grid "
            "COLUMNSxROWS)"
        )
    else:
        grid = layout.of_count(count, str(path))
    return [(rank // grid[1], rank % grid[1]) for rank in ranks], grid


def _ranks(numbers: Sequence[int]) -> list[int]:
    """Count from the smallest, in steps of the greatest common difference: gaps stay gaps."""
    start = min(numbers)
    step = gcd(*(number - start for number in numbers)) or 1
    return [(number - start) // step for number in numbers]


def check_grid(path: Path, grid: Grid, layout: Layout) -> None:
    """Raise LightFieldError if another grid was asked for than the names give."""
    if layout.grid not in (None, grid):
        raise LightFieldError(
            f"{path}: names give a grid of {size(grid)}; expected {size(layout.grid or grid)} as asked for; "
            "change the grid or leave it out"
        )
