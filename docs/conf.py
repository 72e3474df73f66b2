"""Sphinx: `python -m sphinx -W -b html docs docs/_build/html`, in the repository, with the extra `docs`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "2")
sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import lfdepth

project = "lfdepth"
author = "The lfdepth developers"
copyright = "The lfdepth developers"
version = release = lfdepth.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "reference",
]
exclude_patterns = ["_build", "_ext", "gallery", "method", "requirements*.txt"]
suppress_warnings = ["config.cache"]  # the settings of the gallery hold functions
smartquotes = False  # options begin with two hyphens

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autosummary_generate = False
autodoc_typehints = "none"  # the docstrings say the types
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

sphinx_gallery_conf = {
    "examples_dirs": ["gallery", "method"],
    "gallery_dirs": ["_generated/gallery", "_generated/method"],
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib", "scrapers.animations"),
    "plot_gallery": os.environ.get("DOCS_GALLERY", "1") != "0",  # 0: do not run the scripts
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 3600,
    "remove_config_comments": True,
    "thumbnail_size": (480, 220),
    "capture_repr": (),
    "show_signature": False,
}

html_theme = "pydata_sphinx_theme"
html_title = f"lfdepth {version}"
html_static_path = ["_static"]
html_css_files = ["lfdepth.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_prev_next": False,
    "header_links_before_dropdown": 7,
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
