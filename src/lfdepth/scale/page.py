"""What a batch leaves to be looked at: a page of thumbnails, and a table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lfdepth.io.atomic import atomic
from lfdepth.scale.jobs import THUMBNAILS
from lfdepth.scale.work import Outcome
from lfdepth.table import Table
from lfdepth.templating import render
from lfdepth.version import __version__


def write_page(folder: Path, table: Table, outcomes: Sequence[Outcome], made_of: Mapping[str, Any]) -> None:
    """Write `index.html` and `results.csv` into a batch's folder.

    The page shows the thumbnails that workers wrote; browsers load those that are looked at.
    """
    method = {key: value for key, value in made_of.items() if key != "scene"}
    pictures = [
        {"name": Path(each.scene).name, "file": Path(each.target).name, "thumbnail": _thumbnail(each)}
        for each in outcomes
        if each.status != "failed"
    ]
    page = render(
        "batch.html",
        version=__version__,
        made_of=json.dumps(method, ensure_ascii=False),
        table=table,
        pictures=pictures,
        failures=[each for each in outcomes if each.status == "failed"],
        total=len(outcomes),
    )
    for name, text in (("index.html", page), ("results.csv", table.to_csv())):
        with atomic(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


def _thumbnail(outcome: Outcome) -> str:
    return f"{THUMBNAILS}/{Path(outcome.target).stem}.webp"
