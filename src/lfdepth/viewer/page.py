"""The page itself: one HTML file with its styles, scripts and facts inside; exported, with the data, too."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.io.atomic import atomic
from lfdepth.lightfield import LightField
from lfdepth.version import __version__
from lfdepth.viewer.document import (
    ShownMap,
    as_bytes,
    as_jpeg,
    check_showable,
    colour_tables,
    map_facts,
    scene_facts,
    view_samples,
)

SCRIPTS = (
    "data.js",
    "gl.js",
    "software.js",
    "picture.js",
    "stage.js",
    "solid.js",
    "why.js",
    "live.js",
    "app.js",
)
"""In the order in which they run."""

QUALITY = 90
"""Of the JPEG pictures of an exported page."""

SIZE_LIMIT = 25 * 10**6
"""Bytes beyond which an exported page is called large."""


def page_html(
    lf: LightField,
    maps: Sequence[ShownMap],
    *,
    nonce: str,
    served: bool,
    extra: Mapping[str, Any] | None = None,
    blobs: str = "",
) -> str:
    """The page as text.

    Parameters
    ----------
    lf, maps
        What it shows.
    nonce
        Random word that allows the page's own scripts and styles, and no others.
    served
        Whether a server answers behind it.
    extra
        More facts for the scripts.
    blobs
        Elements that hold the data, of a page without a server.
    """
    facts = {
        "version": __version__,
        "served": served,
        "scene": scene_facts(lf),
        "maps": [map_facts(each) for each in maps],
        "colours": {name: _base64(table) for name, table in colour_tables().items()},
        **(extra or {}),
    }
    connect = "'self'" if served else "'none'"
    policy = (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
        f"img-src data: blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
    parts = {
        "POLICY": policy,
        "NONCE": nonce,
        "TITLE": _escaped(f"{lf.name} – lfdepth"),
        "STYLE": _part("style.css"),
        "FACTS": _json(facts),
        "BLOBS": blobs,
        "SCRIPTS": "\n".join(f'<script nonce="{nonce}">\n{_part(name)}</script>' for name in SCRIPTS),
    }
    # In one pass, so that nothing in what is put in is replaced in turn.
    return re.sub(r"@([A-Z]+)@", lambda found: parts[found[1]], _part("index.html"))


def exported_html(lf: LightField, maps: Sequence[ShownMap], *, quality: int = QUALITY) -> str:
    """A page that works from disk: pictures of all views and all maps are inside.

    Raises
    ------
    LightFieldError
        If the views are more than a browser holds.
    """
    check_showable(lf)
    return page_html(lf, maps, nonce="page", served=False, blobs="\n".join(_blobs(lf, maps, quality)))


def export(path: str | Path, lf: LightField, maps: Sequence[ShownMap], *, quality: int = QUALITY) -> int:
    """Write a page that works from disk.

    Parameters
    ----------
    path
        HTML file.
    lf, maps
        What it shows.
    quality
        Of the JPEG pictures, 1 to 95.

    Returns
    -------
    Bytes written.

    Raises
    ------
    LightFieldError
        If the views are more than a browser holds, or the file cannot be written.
    """
    data = exported_html(lf, maps, quality=quality).encode()
    with atomic(path) as temporary:
        temporary.write_bytes(data)
    return len(data)


def _blobs(lf: LightField, maps: Sequence[ShownMap], quality: int) -> Iterator[str]:
    """Elements with the data: JPEG views, and maps as deflated float32."""
    for row, column in np.argwhere(lf.available).tolist():
        yield _blob(f"view/{row}/{column}", as_jpeg(view_samples(lf, (row, column)), quality))
    for shown in maps:
        for name, array in shown.layers().items():
            yield _blob(f"map/{shown.identity}/{name}", zlib.compress(as_bytes(array), 6))
    if lf.truth is not None:
        yield _blob("truth", zlib.compress(as_bytes(lf.truth), 6))


def _blob(name: str, data: bytes) -> str:
    return f'<script type="text/plain" data-name="{name}">{_base64(data)}</script>'


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _part(name: str) -> str:
    return files("lfdepth.viewer").joinpath("page", name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    from html import escape

    return escape(text)


def _json(facts: Any) -> str:
    """JSON that can stand inside a script element, whatever the names in it."""
    return finite_json(facts).replace("<", "\\u003c")


def finite_json(facts: Any) -> str:
    """JSON with null for numbers that it cannot hold."""
    return json.dumps(_finite(facts), allow_nan=False, separators=(",", ":"))


def _finite(facts: Any) -> Any:
    if isinstance(facts, dict):
        return {key: _finite(value) for key, value in facts.items()}
    if isinstance(facts, list | tuple):
        return [_finite(value) for value in facts]
    return None if isinstance(facts, float) and not np.isfinite(facts) else facts
