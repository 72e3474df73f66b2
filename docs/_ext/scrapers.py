"""Animated pictures for the gallery: a script names the file that it wrote `animation`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

_shown: set[Path] = set()


def animations(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Copy a new animation beside the pictures of the page, and show it."""
    path = block_vars["example_globals"].get("animation")
    if not isinstance(path, Path) or path in _shown or not path.is_file():
        return ""
    _shown.add(path)
    target = Path(next(block_vars["image_path_iterator"])).with_suffix(path.suffix)
    shutil.copy(path, target)
    return str(figure_rst([str(target)], gallery_conf["src_dir"]))
