"""The viewer in figures: frames per second, size of an exported page, time of the evidence of a pixel.

python benchmarks/viewer.py [SCENE]
python benchmarks/viewer.py --picture docs/images/viewer.jpg

Without a scene, one of 9×9 views of 512×512 px is made up. Frames are drawn by the system's Chromium, as here
by default in software (SwiftShader). A frame is timed until its pixels can be read; processor time is that of
all of Chromium. The picture is that of docs/viewer.md, of the demo's scene.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import psutil

import lfdepth
from lfdepth import scenes
from lfdepth.lightfield import LightField
from lfdepth.viewer.document import ShownMap, shown_map
from lfdepth.viewer.evidence import Explainer
from lfdepth.viewer.page import export
from lfdepth.viewer.server import Viewer, ViewerServer

FLAGS = ["--no-sandbox", "--ignore-gpu-blocklist", "--no-first-run", "--disable-background-networking"]
SOFTWARE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

FRAMES = """(frames) => {
  const { app } = LF, { picture, look } = app, spent = [];
  Object.assign(look, { aperture: 4, all: true, camera: [0, 0], mode: "plane" });
  const [low, high] = LF.scene.range || [-1, 1], pixel = new Uint8Array(4), { gl } = app.stage;
  for (let k = 0; k < frames; k++) {
    look.focus = low + (high - low) * k / frames;
    const began = performance.now();
    picture.quick(look);
    app.render(true);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    spent.push(performance.now() - began);
  }
  return { spent, quality: picture.quality };
}"""


EXACT = """() => {
  const began = performance.now();
  LF.app.picture.read(LF.app.look);
  return performance.now() - began;
}"""


def made_up() -> LightField:
    """Noise of several scales on two planes, which compresses badly."""
    rng = np.random.default_rng(0)
    base = np.kron(rng.integers(0, 200, (160, 160, 3)), np.ones((4, 4, 1))) + rng.integers(
        0, 55, (640, 640, 3)
    )
    views = np.stack([[base[64 - v : 576 - v, 64 - u : 576 - u] for u in range(-4, 5)] for v in range(-4, 5)])
    truth = np.ones((512, 512), np.float32)
    return LightField(views.astype(np.uint8), truth=truth, disparity_range=(-1.6, 1.5), name="made up")


def _spent(processes: list[psutil.Process]) -> float:
    """Processor time of processes, s."""
    return sum(sum(each.cpu_times()[:2]) for each in processes if each.is_running())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", nargs="?")
    parser.add_argument(
        "--gpu", action="store_true", help="draw with the graphics processor, if Chromium finds one"
    )
    parser.add_argument(
        "--picture", type=Path, help="take this picture of the page, .jpg, and measure nothing"
    )
    arguments = parser.parse_args()
    if arguments.picture:
        _take_picture(arguments.picture)
        return
    lf = lfdepth.read(arguments.scene) if arguments.scene else made_up()
    known = np.zeros(lf.shape[2:4], np.float32) if lf.truth is None else np.nan_to_num(lf.truth)
    v, u, height, width, _ = lf.shape
    print(f"{lf.name}: {u}×{v} views of {width}×{height} px")
    with tempfile.TemporaryDirectory() as folder:
        size = export(Path(folder) / "page.html", lf, [shown_map(known, lf, 0, "truth")])
    print(f"exported page: {size / 1e6:.1f} MB")
    _time_evidence(lf, known)
    _time_frames(lf, known, [*FLAGS, *([] if arguments.gpu else SOFTWARE)])


def _time_evidence(lf: LightField, known: np.ndarray) -> None:
    explainer = Explainer(lf, known)
    explainer.at(lf.width // 2, lf.height // 2)  # kernels are loaded
    spent, computed = [], []
    for x, y in np.random.default_rng(1).integers(0, (lf.width, lf.height), (15, 2)).tolist():
        began = time.perf_counter(), time.process_time()
        explainer.at(x, y)
        spent.append(time.perf_counter() - began[0])
        computed.append(time.process_time() - began[1])
    print(
        f"evidence of a pixel: median {statistics.median(spent):.3f} s, fastest {min(spent):.3f} s; "
        f"processor time {statistics.median(computed):.3f} s"
    )


@contextmanager
def _open_page(lf: LightField, shown: ShownMap, flags: list[str]) -> Iterator[Any]:
    """A page of a light field in Chromium, its views loaded."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    with ViewerServer(Viewer(lf, [shown])) as server, sync_playwright() as playwright:
        Thread(target=server.serve_forever, daemon=True).start()
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        page.goto(server.address, timeout=120000)
        while not page.evaluate("!!LF.app.ready"):
            time.sleep(0.1)
        yield page
        browser.close()
        server.shutdown()


def _take_picture(path: Path) -> None:
    """The page as docs/viewer.md shows it: a view, its map, and the evidence of a pixel beside an edge."""
    lf = scenes.render("demo", size=320)
    result = lfdepth.estimate(lf)
    with _open_page(lf, shown_map(result, lf, 0, "fbs-vis"), [*FLAGS, *SOFTWARE]) as page:
        edges = np.abs(np.diff(result.disparity, axis=1)) > 0.3
        y, x = np.argwhere(edges[100:220, 60:260])[0] + (100, 60)
        x += 2 if result.disparity[y, x] > result.disparity[y, x + 1] else -1  # on the side that is hidden
        page.evaluate("([x, y]) => { LF.app.state.pixel = [x, y]; return LF.app.why(); }", [int(x), int(y)])
        page.evaluate("document.getElementById('why-panel').scrollIntoView()")
        page.evaluate("([x, y]) => { LF.app.readout(x, y); LF.app.touch(); }", [int(x), int(y)])
        page.wait_for_timeout(3000)
        page.screenshot(path=path, type="jpeg", quality=85)


def _time_frames(lf: LightField, known: np.ndarray, flags: list[str]) -> None:
    with _open_page(lf, shown_map(known, lf, 0, "truth"), flags) as page:
        page.evaluate(FRAMES, 30)  # learns what a sample costs
        processes = psutil.Process().children(recursive=True)
        before = _spent(processes)
        found: dict[str, Any] = page.evaluate(FRAMES, 60)
        per_frame = (_spent(processes) - before) / 60
        exact = page.evaluate(EXACT)
    typical, quality = statistics.median(found["spent"]), found["quality"]
    print(
        f"refocusing: {1000 / typical:.0f} frames per second while the focus moves ({typical:.0f} ms a "
        f"frame, {1000 * per_frame:.0f} ms of processor time), of {quality['views']} of {quality['of']} "
        f"views at 1/{quality['share'] ** -0.5:.0f} of the width; exact {exact:.0f} ms after it rests"
    )


if __name__ == "__main__":
    main()
