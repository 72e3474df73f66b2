"""The command that shows a light field and its map in the browser."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from lfdepth.cli.app import app
from lfdepth.cli.options import (
    AS_IT_IS,
    DEFAULT_METHOD,
    ESTIMATED,
    Flag,
    MapSource,
    MapSources,
    Reading,
    ReadingParameters,
)
from lfdepth.errors import LightFieldError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lfdepth.lightfield import LightField
    from lfdepth.viewer.document import ShownMap

Port = Annotated[int, Parameter(show_default=lambda _: "any that is free")]


@app.command(sort_key=9)
def view(
    scene: Path,
    /,
    *,
    compare: Path | None = None,
    port: Port = 0,
    no_browser: Flag = False,
    export: Path | None = None,
    threads: int | None = None,
    source: MapSources = ESTIMATED,
    reading: ReadingParameters = AS_IT_IS,
) -> None:
    """Look at a light field and its disparity map in the browser, or export them as a single page.

    Move through the views, refocus, compare maps, click a pixel to see why it has its disparity, turn the
    scene in 3-D, run methods. For example:

        lfdepth view cotton
        lfdepth view cotton --map cotton.pfm --compare other.pfm
        lfdepth view cotton --map cotton.pfm --export cotton.html

    Parameters
    ----------
    scene
        Light field: a folder of views, such as a scene of the 4D Light Field Benchmark, or a file.
    compare
        A second disparity map to compare with.
    port
        Port on which to serve the page; only this machine can reach it.
    no_browser
        Print the address and open no browser.
    export
        Write one page that works from disk, without a server, instead: .html.
    threads
        Number of threads; one per processor by default.
    """
    from lfdepth.io.atomic import check_target

    if export is not None:
        if export.suffix.lower() not in (".html", ".htm"):
            raise LightFieldError(
                f"{export}: pages are HTML files; expected a name ending in .html; rename it"
            )
        if port or no_browser:
            option = "--port" if port else "--no-browser"
            raise LightFieldError(f"{option}: found with --export, which serves nothing; leave one out")
        check_target(export)
    if not 0 <= port <= 65535:
        raise LightFieldError(f"--port: found {port}, expected 0 to 65535; choose one from 1024 on")
    lf = reading.read(scene)
    if export is not None:
        _export(export, lf, _maps(lf, source, compare, reading, threads))
        return
    from lfdepth.viewer.document import check_showable
    from lfdepth.viewer.server import Viewer, ViewerServer

    check_showable(lf)
    with ViewerServer(Viewer(lf, [], threads=threads), port) as server:  # the port first: estimates take long
        for shown in _maps(lf, source, compare, reading, threads):
            server.viewer.maps[shown.identity] = shown
        _serve(server, browser=not no_browser)


def _maps(
    lf: LightField, source: MapSource, compare: Path | None, reading: Reading, threads: int | None
) -> list[ShownMap]:
    """The map of the options, and the one to compare with; files are read before anything is estimated."""
    from lfdepth.io import read_record
    from lfdepth.viewer.document import shown_map

    second = [] if compare is None else [shown_map(read_record(compare), lf, 1, compare.name)]
    if source.map is not None:
        return [shown_map(read_record(source.map), lf, 0, source.map.name), *second]
    result = source.result(lf, reading, threads)
    for warning in result.checks.warnings if result.checks else ():
        print(f"warning: {warning}", file=sys.stderr)
    return [shown_map(result, lf, 0, source.method or DEFAULT_METHOD), *second]


def _export(path: Path, lf: LightField, maps: Sequence[ShownMap]) -> None:
    from lfdepth.viewer.page import SIZE_LIMIT, export

    size = export(path, lf, maps)
    if size > SIZE_LIMIT:
        print(
            f"warning: {path}: has {size / 1e6:.0f} MB, more than the {SIZE_LIMIT / 1e6:.0f} MB that "
            "browsers and mail take easily; use --views or --scale for a smaller one",
            file=sys.stderr,
        )
    print(f"written  {path} ({size / 1e6:.1f} MB)")


def _serve(server: object, *, browser: bool) -> None:
    """Serve until Ctrl-C."""
    from lfdepth.viewer.server import ViewerServer

    assert isinstance(server, ViewerServer)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    Thread(target=server.viewer.warm_up, daemon=True).start()
    print(f"page     {server.address}", flush=True)
    print("Ctrl-C ends it.", file=sys.stderr)
    if browser and not _open(server.address):
        print("no browser found: open the address above in one", file=sys.stderr)
    try:
        while thread.is_alive():
            time.sleep(0.2)
    finally:
        server.viewer.runs.cancel()
        server.shutdown()


def _open(address: str) -> bool:
    """Open a browser with a window; browsers in a terminal cannot show the page."""
    windows = (
        sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    if not windows:
        return False
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
