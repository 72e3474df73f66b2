"""What notebooks show of light fields and results, and the viewer inside a notebook."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic
from lfdepth.io.pixels import encode_png
from lfdepth.pictures import disparity_colours, span, view_colours
from lfdepth.viewer.document import colour_tables, shown_map
from lfdepth.viewer.page import exported_html

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField
    from lfdepth.result import Result

_LARGEST = 320
"""Px of the longer side of a picture beside facts."""


@dataclass(frozen=True, eq=False)
class Page:
    """The viewer as one page: a notebook shows it, and `save` writes it.

    Attributes
    ----------
    text
        The page, HTML.
    height
        Px that it takes in a notebook.
    """

    text: str
    height: int

    def _repr_html_(self) -> str:
        """The page in a frame of its own."""
        return (
            f'<iframe srcdoc="{html.escape(self.text)}" width="100%" height="{self.height}" '
            'style="border:1px solid #8888" title="lfdepth view"></iframe>'
        )

    def __repr__(self) -> str:
        return f'<page of {len(self.text) / 1e6:.1f} MB; a notebook shows it, .save("page.html") writes it>'

    def save(self, path: str | Path) -> None:
        """Write the page; it works from disk.

        Raises
        ------
        LightFieldError
            If the file cannot be written.
        """
        with atomic(path) as temporary:
            temporary.write_text(self.text, encoding="utf-8")


def view(
    lf: LightField,
    *maps: Result | NDArray[Any],
    names: tuple[str, ...] = (),
    height: int = 720,
    quality: int = 85,
) -> Page:
    """Look at a light field and maps of it, inside a notebook or as a page of their own.

    Parameters
    ----------
    lf
        Light field. ``lf.angular_crop(5, 5)`` makes a smaller page.
    *maps
        Results of `estimate`, or bare (H, W) disparity maps; the first is shown, the second compared with it.
    names
        What the maps are called; by default after their methods.
    height
        Px that it takes in a notebook.
    quality
        Of the JPEG pictures of the views, 1 to 95.

    Returns
    -------
    Page
        Shows itself in a notebook; its `save` writes it.

    Raises
    ------
    LightFieldError
        If a map is not finite or of another size than the views, or the views are more than a browser holds.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("demo", size=64, views=3)
    >>> lfdepth.view(lf, lf.truth, names=("truth",))
    <page of 0... MB; a notebook shows it, .save("page.html") writes it>
    """
    if not 1 <= quality <= 95:
        raise LightFieldError(f"quality: found {quality}, expected 1 to 95; choose such a value")
    shown = []
    for number, each in enumerate(maps):
        usual = f"map {number + 1}" if isinstance(each, np.ndarray) else each.method.name
        shown.append(shown_map(each, lf, number, names[number] if number < len(names) else usual))
    return Page(exported_html(lf, shown, quality=quality), height)


def light_field_html(lf: LightField) -> str:
    """The reference view of a light field and what is known of it."""
    v, u, height, width, channels = lf.shape
    absent = int((~lf.available).sum())
    facts = {
        "views": f"{u}×{v}{f', {absent} absent' if absent else ''}",
        "size": f"{width}×{height} px, {'grey' if channels == 1 else 'colour'}, {lf.views.dtype}",
        "range": _range(lf.disparity_range) if lf.disparity_range else "unknown",
        "camera": "known" if lf.camera else "unknown",
        "truth": "none" if lf.truth is None else _range(span(lf.truth)),
    }
    return _figure(lf.name, view_colours(lf.reference), facts)


def light_field_png(lf: LightField) -> bytes:
    """The reference view as PNG."""
    return encode_png(np.ascontiguousarray(view_colours(lf.reference)))


def result_html(result: Result) -> str:
    """The map of a result with its bar, and how it came about."""
    height, width = result.disparity.shape
    facts = {
        "method": result.method.name,
        "size": f"{width}×{height} px",
        "searched": _range(result.range) + (" (found in the views)" if result.range_found else ""),
        "planes": str(result.planes or "none"),
        "time": f"{result.runtime:.2f} s, engine {result.engine}",
        "confidence": f"median {float(np.median(result.confidence)):.2f}",
        "checks": "not made"
        if result.checks is None
        else " ".join(result.checks.warnings) or "nothing to warn of",
    }
    low, high = span(result.disparity)
    bar = np.frombuffer(colour_tables()["viridis"], np.uint8).reshape(1, 256, 3)
    scale = (
        f'<div style="display:flex;gap:6px;align-items:center">{low:.3g}<img alt="viridis" '
        f'src="{_data_url(bar)}" style="width:120px;height:10px">{high:.3g} px per view step</div>'
    )
    return _figure("disparity", disparity_colours(result.disparity), facts, scale)


def result_png(result: Result) -> bytes:
    """The colour-mapped disparity as PNG."""
    return encode_png(disparity_colours(result.disparity))


def _figure(title: str, pixels: NDArray[np.uint8], facts: Mapping[str, str], below: str = "") -> str:
    """A picture beside a table."""
    step = -(-max(pixels.shape[:2]) // _LARGEST)
    small = np.ascontiguousarray(pixels[::step, ::step])
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(key)}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for key, value in facts.items()
    )
    return (
        '<div style="display:flex;gap:16px;align-items:flex-start"><div>'
        f'<img alt="{html.escape(title)}" src="{_data_url(small)}">{below}</div>'
        f"<div><b>{html.escape(title)}</b><table>{rows}</table></div></div>"
    )


def _data_url(pixels: NDArray[np.uint8]) -> str:
    return "data:image/png;base64," + base64.b64encode(encode_png(np.ascontiguousarray(pixels))).decode()


def _range(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.4g} to {ends[1]:.4g} px per view step"
