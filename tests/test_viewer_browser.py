"""The viewer's page in a real browser: the system's Chromium without a window, drawing in software."""

from __future__ import annotations

import base64
import http.server
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import lfdepth
from fields import quantise, two_planes
from lfdepth.lightfield import LightField
from lfdepth.pictures import disparity_colours
from lfdepth.viewer.document import shown_map
from lfdepth.viewer.page import export
from lfdepth.viewer.server import Viewer, ViewerServer

NEAR, FAR = 0.8, -0.6
HEIGHT, WIDTH = 72, 88
LEVELS = 2
"""8-bit levels that a picture of the page may differ by: graphics processors interpolate in 1/256 px."""

_FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def chromium() -> str | None:
    names = ("chromium", "chromium-browser", "google-chrome")
    return os.environ.get("LFDEPTH_BROWSER") or next(filter(None, map(shutil.which, names)), None)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = chromium()
    if program is None:
        pytest.skip("no Chromium on this machine; set LFDEPTH_BROWSER or install one")
    with playwright.sync_playwright() as running:
        started = running.chromium.launch(executable_path=program, args=_FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="module")
def lf() -> LightField:
    """A rectangle before a wall, in colour, with exact truth and a camera."""
    views, truth = two_planes(np.random.default_rng(5), (5, 5), (HEIGHT, WIDTH), NEAR, FAR)
    colours = np.stack([views, 0.2 + 0.6 * views[..., ::-1, :] * 0 + 0.6 * views**2, 1 - views], axis=-1)
    return LightField(
        quantise(colours, "uint8"),
        camera=lfdepth.Camera(100, 35, 90, 6.7, WIDTH, HEIGHT),
        truth=truth.astype(np.float32),
        disparity_range=(-1.0, 1.2),
        name="planes",
    )


class Served:
    """A server in a thread."""

    def __init__(self, lf: LightField) -> None:
        assert lf.truth is not None
        self.server = ViewerServer(Viewer(lf, [shown_map(lf.truth, lf, 0, "truth.pfm")], threads=1))
        self.address = self.server.address
        self._thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.05})
        self._thread.start()

    def stop(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        self._thread.join()


@pytest.fixture(scope="module")
def served(lf: LightField) -> Iterator[Served]:
    running = Served(lf)
    yield running
    running.stop()


def until(page: Any, what: str, seconds: float = 20) -> None:
    """Wait for an expression of the page to be true."""
    end = time.monotonic() + seconds
    while not page.evaluate(f"!!({what})"):
        assert time.monotonic() < end, f"never true: {what}"
        time.sleep(0.03)


Open = Callable[..., Any]


def opened(context: Any, address: str) -> Any:
    """A page, its views loaded; what the browser complains of is in its `complaints`."""
    page = context.new_page()
    page.complaints = []
    page.on("console", lambda message: page.complaints.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: page.complaints.append(f"error: {error}"))
    page.goto(address)
    until(page, "LF.app.ready")
    return page


@pytest.fixture
def open_page(browser: Any) -> Iterator[Open]:
    """Opens a page in a browser of its own, as far as the page can tell."""
    contexts = []

    def open_context(address: str, **options: Any) -> Any:
        contexts.append(browser.new_context(**{"viewport": {"width": 1000, "height": 640}, **options}))
        return opened(contexts[-1], address)

    yield open_context
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def page(served: Served, browser: Any) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    yield opened(context, served.address)
    context.close()


def picture(page: Any) -> NDArray[np.int64]:
    """The exact picture that the page shows, (H, W, 3)."""
    page.evaluate("LF.app.picture.quick(LF.app.look)")
    return (
        samples(page, "LF.app.picture.read(LF.app.look)", "u1").reshape(HEIGHT, WIDTH, 4)[..., :3].astype(int)
    )


def samples(page: Any, array: str, dtype: str) -> NDArray[Any]:
    """A typed array of the page."""
    code = f"(() => {{ const b = new Uint8Array({array}.buffer); let t = ''; "
    code += "for (let i = 0; i < b.length; i += 8192) t += String.fromCharCode(...b.subarray(i, i + 8192)); "
    return np.frombuffer(base64.b64decode(page.evaluate(code + "return btoa(t); })()")), dtype)


def look(page: Any, **values: Any) -> None:
    """Set what is looked at, from the state that the page begins with."""
    begin = {"camera": [0, 0], "focus": 0, "aperture": 0, "shape": "square", "all": False, "mode": "plane"}
    page.evaluate("(values) => { Object.assign(LF.app.look, values); LF.app.touch(true); }", begin | values)


def set_slider(page: Any, name: str, value: float) -> None:
    page.evaluate(
        "([name, value]) => { const input = document.getElementById(name); input.value = value;"
        " input.dispatchEvent(new Event('input')); }",
        [name, value],
    )


def place_of(page: Any, x: int, y: int) -> tuple[float, float]:
    """Where on the window the middle of a pixel of the first pane is."""
    left, top = page.evaluate(
        "([x, y]) => LF.app.stage.toStage(x + 0.5, y + 0.5, LF.app.stage.places(LF.app.state.layout)[0])",
        [x, y],
    )
    box = page.locator("#canvas").bounding_box()
    return box["x"] + left, box["y"] + top


# --- the page


def test_it_loads_without_complaints_and_reads_out_what_is_under_the_pointer(
    page: Any, lf: LightField
) -> None:
    assert lf.truth is not None
    assert page.title() == "planes – lfdepth"
    assert "5×5 views of 88×72 px, colour" in page.inner_text("#summary")
    for x, y in [(40, 36), (3, 70)]:
        page.mouse.move(*place_of(page, x, y))
        depth = lf.camera.disparity_to_depth(lf.truth[y, x]) if lf.camera else None
        words = " ".join(page.inner_text("#readout").split())
        assert words.startswith(f"x {x} y {y} disparity {lf.truth[y, x]:.4f} px depth {depth:.3f} m")
        assert f"truth {lf.truth[y, x]:.4f} px error 0.0000" in words
    assert page.complaints == []


def test_the_picture_is_the_view_at_every_place_of_the_grid(page: Any, lf: LightField) -> None:
    for v, u in [(-2, -2), (0, 0), (1, -1), (2, 2)]:
        look(page, camera=[v, u])
        np.testing.assert_array_equal(picture(page), lf.views[2 + v, 2 + u])


def test_between_views_both_count(page: Any, lf: LightField) -> None:
    look(page, camera=[0, 0.25])
    between = 0.75 * lf.views[2, 2] + 0.25 * lf.views[2, 3]
    assert np.abs(picture(page) - between).max() <= 1


def test_dragging_moves_the_camera_and_the_parallax_is_right(page: Any, lf: LightField) -> None:
    """Dragging to the right moves what is near to the right: the camera goes to the left."""
    look(page)
    x, y = place_of(page, 44, 36)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y, steps=4)
    page.mouse.up()
    v, u = page.evaluate("LF.app.look.camera")
    assert v == 0
    assert -2 < u < 0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 900, y, steps=3)
    page.mouse.up()
    assert page.evaluate("LF.app.look.camera") == [0, -2]
    shown = picture(page)
    np.testing.assert_array_equal(shown, lf.views[2, 0])
    # The rectangle lies D·2 px further right than in the reference view; the truth says where.
    assert lf.truth is not None
    inner = np.argwhere(lf.truth == np.float32(NEAR))[[0, -1]] + [[4, 4], [-4, -4]]
    (top, left), (bottom, right) = inner
    reference = lf.reference.astype(float)
    costs = [
        np.abs(reference[top:bottom, left:right] - shown[top:bottom, left + s : right + s]).mean()
        for s in range(-3, 4)
    ]
    assert int(np.argmin(costs)) - 3 == round(2 * NEAR)


def test_the_keyboard_moves_it_too(page: Any, lf: LightField) -> None:
    look(page)
    page.locator("#canvas").focus()
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate("LF.app.look.camera") == [1, 1]
    page.keyboard.press("0")
    assert page.evaluate("LF.app.look.camera") == [0, 0]


@pytest.mark.parametrize("disparity", [-0.6, 0.0, 0.37, 0.8])
def test_refocusing_is_that_of_lfdepth_refocus(page: Any, lf: LightField, disparity: float) -> None:
    look(page)
    set_slider(page, "aperture", 2)
    set_slider(page, "focus", disparity)
    focus = page.evaluate("LF.app.look.focus")  # what the slider rounds to
    assert focus == pytest.approx(disparity, abs=0.002)
    wanted = lfdepth.refocus(lf, focus).astype(int)
    assert np.abs(picture(page) - wanted).max() <= LEVELS


@pytest.mark.parametrize("by", [1, 2])
def test_previews_of_slow_machines_are_exact_on_whole_disparities(page: Any, lf: LightField, by: int) -> None:
    """They shift views by whole pixels, and take every so many pixels."""
    look(page, aperture=2, all=True, focus=1)
    page.evaluate("while (!LF.app.picture.software.ready(LF.app.look, LF.app.picture.chosen(LF.app.look)));")
    page.evaluate(
        """(by) => {
          const { picture, look } = LF.app, target = by === 1 ? picture.finest : picture.coarser[0];
          picture.software.draw(look, target, picture.chosen(look));
          picture.testing = target.sums.out;
        }""",
        by,
    )
    size = HEIGHT // by, WIDTH // by, 4
    preview = samples(page, "LF.app.picture.testing", "u1").reshape(size)[..., :3].astype(int)
    wanted = lfdepth.refocus(lf, 1)[by // 2 :: by, by // 2 :: by].astype(int)
    assert np.abs(preview - wanted).max() <= 1


def test_a_smaller_aperture_takes_the_views_inside(page: Any, lf: LightField) -> None:
    look(page, aperture=1, focus=0.5)
    assert np.abs(picture(page) - lfdepth.refocus(lf.angular_crop(3, 3), 0.5).astype(int)).max() <= LEVELS


def test_in_focus_everywhere_and_past_the_occluder(page: Any, lf: LightField) -> None:
    """As the library does it, but for a few pixels where a disparity lies on the edge of rounding."""
    assert lf.truth is not None
    look(page)
    page.check("#sharp")
    until(page, "LF.app.look.mode === 'sharp'")
    apart = np.abs(picture(page) - lfdepth.all_in_focus(lf, lf.truth).astype(int)).max(axis=2)
    assert np.mean(apart > LEVELS) < 0.002
    page.check("#past")
    until(page, "LF.app.look.mode === 'past'")
    set_slider(page, "past-limit", 0.2)
    set_slider(page, "focus", FAR)
    focus, limit = page.evaluate("[LF.app.look.focus, LF.app.look.limit]")
    behind = lfdepth.refocus(lf, focus, without_foreground=limit, disparity_map=lf.truth).astype(int)
    apart = np.abs(picture(page) - behind).max(axis=2)
    assert np.mean(apart > LEVELS) < 0.002
    page.uncheck("#past")
    until(page, "LF.app.look.mode === 'plane'")


def test_a_click_shows_the_evidence_of_the_library(page: Any, lf: LightField) -> None:
    assert lf.truth is not None
    look(page)
    page.evaluate("LF.app.stage.fit(2); LF.app.touch()")
    page.mouse.click(*place_of(page, 26, 30))
    until(page, "LF.app.evidence && LF.app.evidence.x === 26 && document.querySelector('#why polyline')")
    found = page.evaluate("LF.app.evidence")
    wanted = lfdepth.explain(lf, lf.truth, 26, 30)
    np.testing.assert_allclose(found["signs"], wanted.signs, atol=1e-6)
    np.testing.assert_allclose(found["photo_visible"], wanted.photo_visible, atol=1e-6)
    # What is drawn is what was sent: the profile's height in the chart, from its two ends.
    points = page.evaluate("document.querySelector('#why polyline').getAttribute('points')").split()
    heights = np.array([float(point.split(",")[1]) for point in points])
    np.testing.assert_allclose(heights, 6 + (1 - wanted.signs) / 2 * (120 - 6 - 18), atol=0.06)
    hatched = page.evaluate("document.querySelectorAll('#why rect[fill=\"url(#hidden)\"]').length")
    assert hatched == int((wanted.states == 2).sum())
    assert wanted.decision in page.inner_text("#why")


def test_a_click_focuses_on_the_pixel(page: Any, lf: LightField) -> None:
    assert lf.truth is not None
    look(page)
    page.check("#click-focus")
    page.evaluate("LF.app.stage.fit(2); LF.app.touch()")
    page.mouse.click(*place_of(page, 40, 36))
    assert page.evaluate("LF.app.look.focus") == pytest.approx(NEAR)
    assert page.evaluate("LF.app.look.all")
    page.uncheck("#click-focus")


def test_colours_of_a_map_are_those_of_previews(page: Any, lf: LightField) -> None:
    """Viridis from the truth's least to its largest: what the canvas shows at a pixel."""
    assert lf.truth is not None
    colours = disparity_colours(lf.truth)
    page.evaluate(
        "LF.app.state.layers = ['a/disparity', 'truth']; LF.app.setLayout('one'); LF.app.resetRanges()"
    )
    page.evaluate("LF.app.render()")
    for x, y in [(40, 36), (3, 3)]:
        found = page.evaluate(
            """([x, y]) => {
              const { stage } = LF.app, { gl, canvas, density } = stage, out = new Uint8Array(4);
              const [left, top] = stage.toStage(x + .5, y + .5, stage.places('one')[0]);
              const place = [left * density, canvas.height - top * density];
              gl.readPixels(...place, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, out);
              return Array.from(out);
            }""",
            [x, y],
        )
        assert found[:3] == colours[y, x].tolist()
    page.evaluate("LF.app.state.layers = ['picture', 'a/disparity']; LF.app.setLayout('two')")


def test_zooming_keeps_the_pixel_under_the_pointer_in_both_panes(page: Any) -> None:
    page.evaluate("LF.app.stage.fit(2); LF.app.touch()")
    x, y = place_of(page, 30, 20)
    page.mouse.move(x, y)
    before = page.inner_text("#readout")
    page.mouse.wheel(0, -900)
    until(page, "LF.app.stage.zoom > 2 * LF.app.stage.fitZoom")
    page.mouse.move(x + 1, y)
    page.mouse.move(x, y)
    assert page.inner_text("#readout") == before
    half = page.evaluate("LF.app.stage.places('two')[1][0]")
    page.mouse.move(x + half, y)
    assert page.inner_text("#readout") == before
    page.click("#whole")


def test_the_mesh_seen_from_the_reference_camera_is_the_reference_view(page: Any, lf: LightField) -> None:
    page.evaluate("LF.app.setMode('solid')")
    drawn = """(cut) => {
      const { solid, stage, state, picture } = LF.app, { gl, canvas } = stage;
      solid.cut = cut;
      solid.draw(state.a, picture, canvas.width, canvas.height, [1, 0, 1]);
      const out = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, out);
      const w = canvas.width, h = canvas.height, m = solid.matrix(w / h), found = [];
      const c = LF.scene.camera, z = (d) => 1 / (d / c.scale + c.inverse_focus);
      for (const [x, y] of [[20, 12], [44, 36], [70, 60], [40, 30]]) {
        const depth = z(state.a.disparity[y * LF.scene.width + x]);
        const p = [(x - c.cx) * c.step * depth, (y - c.cy) * c.step * depth, depth, 1];
        const q = [0, 1, 2, 3].map((r) => p.reduce((sum, v, k) => sum + m[4 * k + r] * v, 0));
        const px = Math.floor((q[0] / q[3] + 1) / 2 * w), py = Math.floor((q[1] / q[3] + 1) / 2 * h);
        found.push([x, y, ...out.slice(4 * (py * w + px), 4 * (py * w + px) + 3)]);
      }
      let empty = 0;
      for (let i = 0; i < out.length; i += 4)
        empty += out[i] === 255 && out[i + 1] === 0 && out[i + 2] === 255;
      return { found, empty: empty / (w * h) };
    }"""
    whole = page.evaluate(drawn, 10)
    for x, y, *colour in whole["found"]:
        around = lf.reference[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).astype(int)
        low, high = around.min(axis=0) - LEVELS, around.max(axis=0) + LEVELS
        assert (low <= colour).all(), (x, y, colour)
        assert (colour <= high).all(), (x, y, colour)
    cut = page.evaluate(drawn, 0.5)  # the jump between the planes is 1.4 px
    assert cut["empty"] > whole["empty"] + 0.002
    page.evaluate("LF.app.setMode('pictures')")


def test_a_run_from_the_panel_is_compared_with_the_map_before(page: Any, lf: LightField) -> None:
    page.evaluate("document.getElementById('run-panel').open = true")
    page.select_option("#run select[name=method]", "fbs")
    page.fill("#run input[name=step]", "0.2")
    page.click("#run button.main")
    until(page, "LF.app.state.b", 30)
    wanted = lfdepth.estimate(lf, "fbs", step=0.2, threads=1).disparity
    found = samples(page, "LF.app.state.a.disparity", "<f4")
    np.testing.assert_array_equal(found.reshape(HEIGHT, WIDTH), wanted)
    assert page.evaluate("[LF.app.state.b.id, LF.app.state.layers]") == [0, ["a/disparity", "b/disparity"]]
    page.fill("#run input[name=step]", "-1")
    page.click("#run button.main")
    until(page, "document.querySelector('#run .error')")
    assert "step: found -1" in page.inner_text("#run .error")
    page.complaints[:] = [each for each in page.complaints if "status of 400" not in each]
    assert page.complaints == []


# --- other pages


def test_two_browsers_at_once(page: Any, served: Served, open_page: Open, lf: LightField) -> None:
    other = open_page(served.address)
    look(page, camera=[2, 0])
    look(other, camera=[0, 2])
    np.testing.assert_array_equal(picture(page), lf.views[4, 2])
    np.testing.assert_array_equal(picture(other), lf.views[2, 4])
    assert other.complaints == []


def test_an_exported_page_works_from_disk(open_page: Open, lf: LightField, tmp_path: Path) -> None:
    assert lf.truth is not None
    export(tmp_path / "page.html", lf, [shown_map(lf.truth, lf, 0, "truth.pfm")])
    page = open_page((tmp_path / "page.html").as_uri())
    look(page, aperture=2, all=True, focus=0.8)
    # JPEG's errors average out over the views.
    assert np.abs(picture(page) - lfdepth.refocus(lf, 0.8).astype(int)).mean() < 2
    values = samples(page, "LF.app.state.a.disparity", "<f4")
    np.testing.assert_array_equal(values.reshape(HEIGHT, WIDTH), lf.truth)
    assert "An exported page holds no evidence" in page.inner_text("#why")
    assert not page.is_visible("#run-panel")
    assert page.complaints == []


@pytest.mark.parametrize(
    "kind",
    [pytest.param("row", marks=pytest.mark.slow), pytest.param("column", marks=pytest.mark.slow), "gaps"],
)
def test_other_grids_without_map_camera_or_truth(open_page: Open, kind: str, tmp_path: Path) -> None:
    """One row or column of grey views, and a grid with views that are absent, in 16 bits."""
    grid = {"row": (1, 7), "column": (6, 1), "gaps": (3, 4)}[kind]
    present = np.ones(grid, np.bool_)
    if kind == "gaps":
        present[0, 1] = present[2, 3] = False
    views, _ = two_planes(np.random.default_rng(7), grid, (HEIGHT, WIDTH), NEAR, FAR)
    views[~present] = 0
    grey = LightField(quantise(views[..., None], "uint16"), present=present, name=kind)
    lfdepth.view(grey, quality=95).save(tmp_path / "page.html")
    page = open_page((tmp_path / "page.html").as_uri())
    look(page, aperture=6, all=True, focus=0.4)
    wanted = lfdepth.refocus(grey, 0.4).astype(float) / 257
    assert np.abs(picture(page) - wanted).mean() < 1.5
    look(page, camera=[0, -1])
    row, column = grey.centre
    if kind != "column":
        assert np.abs(picture(page) - grey.views[row, column - 1] / 257.0).mean() < 1.5
    look(page, camera=[-1, -1])  # where a view is absent, the nearest one that is there
    picture(page)
    page.evaluate("LF.app.click([60, 200])")
    page.evaluate("LF.app.focusOn(3, 3)")
    assert "no map" in page.inner_text("#message")
    assert page.complaints == []


def test_a_phone_shows_everything_without_scrolling_sideways(open_page: Open, served: Served) -> None:
    page = open_page(
        served.address, viewport={"width": 390, "height": 844}, has_touch=True, color_scheme="dark"
    )
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    first, second = page.evaluate("LF.app.stage.places(LF.app.state.layout)")
    assert second[1] >= first[1] + first[3]  # one above the other
    page.locator("#grid").scroll_into_view_if_needed()
    page.locator("#grid").tap()
    assert page.complaints == []


def test_a_server_that_vanished_is_reported(open_page: Open, lf: LightField) -> None:
    own = Served(lf)
    page = open_page(own.address)
    own.stop()
    until(page, "!document.getElementById('message').hidden")
    assert "The server has gone" in page.inner_text("#message")
    look(page, camera=[0, 1])
    np.testing.assert_array_equal(picture(page), lf.views[2, 3])  # what is on the page stays


def test_a_page_of_a_stranger_reads_nothing(browser: Any, served: Served) -> None:
    """Even one that knows the token, from another port of this machine."""

    class Stranger(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<title>stranger</title>")

        def log_message(self, *_: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stranger) as stranger:
        threading.Thread(target=stranger.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{stranger.server_port}/")
        outcome = page.evaluate(
            """async (address) => {
              const tried = {};
              for (const mode of ["cors", "no-cors"]) try {
                const answer = await fetch(address + "view/2/2", { mode });
                tried[mode] = (await answer.arrayBuffer()).byteLength;
              } catch { tried[mode] = "refused"; }
              const posted = { method: "POST", mode: "no-cors", body: '{"method": "fbs"}' };
              const answered = fetch(address + "run", posted);
              tried.post = await answered.then((answer) => answer.status, () => "refused");
              return tried;
            }""",
            served.address,
        )
        assert outcome["cors"] == "refused"
        assert outcome["no-cors"] in ("refused", 0)
        assert outcome["post"] in ("refused", 0)  # opaque: sent, and answered 403
        assert not served.server.viewer.runs.state()["running"]
        page.close()
        stranger.shutdown()
