"""The application that commands are registered with."""

from __future__ import annotations

from cyclopts import App, Parameter

from lfdepth.version import __version__

PARTLY_FAILED = 1
"""Exit status where some of the work failed, was named, and the rest was done."""

app = App(
    name="lfdepth",
    version=__version__,
    help="Dense, sharp disparity maps from light fields by foreground-background separation.",
    help_format="markdown",
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(negative_iterable=()),
)
