"""The viewer without a browser: who may read what, what a page holds, and the evidence of a pixel."""

from __future__ import annotations

import base64
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import lfdepth
from fields import light_field, quantise, two_planes
from lfdepth.cli import main
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.methods.fbs_vis import FbsVis
from lfdepth.viewer.document import shown_map
from lfdepth.viewer.evidence import HIDDEN, OUTSIDE, SEEN, Explainer
from lfdepth.viewer.page import export
from lfdepth.viewer.runs import Runs
from lfdepth.viewer.server import Viewer, ViewerServer

NEAR, FAR = 0.8, -0.6


def scene(grid: tuple[int, int] = (5, 5), size: tuple[int, int] = (64, 80)) -> LightField:
    """A rectangle before a wall, with exact truth."""
    views, truth = two_planes(np.random.default_rng(2), grid, size, NEAR, FAR)
    colours = np.stack([views, views**0.5, 1 - views], axis=-1)
    return LightField(
        quantise(colours, "uint8"), truth=truth.astype(np.float32), disparity_range=(-1.0, 1.2), name="planes"
    )


@pytest.fixture(scope="module")
def lf() -> LightField:
    return scene()


@pytest.fixture(scope="module")
def server(lf: LightField) -> Iterator[ViewerServer]:
    assert lf.truth is not None
    with ViewerServer(Viewer(lf, [shown_map(lf.truth, lf, 0, "truth.pfm")], threads=1)) as running:
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield running
        running.shutdown()


def ask(
    server: ViewerServer,
    path: str,
    *,
    token: str | None = None,
    method: str = "GET",
    body: str | None = None,
    **headers: str,
) -> tuple[int, bytes]:
    """Status and body of an answer; `path` stands behind the token."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    sent = {"Host": f"127.0.0.1:{server.server_port}"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection.putrequest(
        method,
        f"/{server.token if token is None else token}/{path}",
        skip_host=True,
        skip_accept_encoding=True,
    )
    for name, value in sent.items():
        connection.putheader(name, value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(None if body is None else body.encode())
    answer = connection.getresponse()
    read = answer.read()
    connection.close()
    return answer.status, read


# --- who may read


def test_page_views_and_maps_are_those_of_the_light_field(server: ViewerServer, lf: LightField) -> None:
    status, page = ask(server, "")
    assert status == 200
    assert b"planes" in page
    for row, column in [(0, 0), (2, 3), (4, 4)]:
        status, body = ask(server, f"view/{row}/{column}")
        assert status == 200
        np.testing.assert_array_equal(np.frombuffer(body, np.uint8).reshape(64, 80, 3), lf.views[row, column])
    for path in ("map/0/disparity", "truth"):
        np.testing.assert_array_equal(np.frombuffer(ask(server, path)[1], "<f4").reshape(64, 80), lf.truth)


@pytest.mark.parametrize("token", ["", "x", "x" * 32, "view"])
def test_nothing_without_the_token(server: ViewerServer, token: str) -> None:
    for path in ("", "view/0/0", "map/0/disparity", "why?map=0&x=1&y=1", "run"):
        assert ask(server, path, token=token) == (404, b"")
    assert (
        ask(server, "run", token=token, method="POST", body="{}", Content_Type="application/json")[0] == 404
    )


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site", "Sec_Fetch_Mode": "no-cors"},
    ],
)
def test_nothing_for_pages_of_strangers(server: ViewerServer, headers: dict[str, str]) -> None:
    """DNS rebinding comes with a foreign Host, a foreign page with its Origin or as cross-site."""
    for path in ("", "view/0/0", "truth"):
        assert ask(server, path, **headers) == (403, b"")
    posted = {"Content_Type": "application/json"} | headers
    assert ask(server, "run", method="POST", body="{}", **posted)[0] == 403


def test_a_form_of_a_stranger_starts_nothing(server: ViewerServer) -> None:
    """Forms need no permission to post, but cannot send JSON."""
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert ask(server, "run", method="POST", body='{"method": "fbs"}', Content_Type=kind)[0] == 403
    assert json.loads(ask(server, "run")[1]) == {"running": False}


def test_own_requests_are_answered(server: ViewerServer) -> None:
    own = f"http://127.0.0.1:{server.server_port}"
    assert ask(server, "ping", Origin=own, Sec_Fetch_Site="same-origin")[0] == 200
    assert ask(server, "", Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate")[0] == 200  # a link to it
    assert ask(server, "ping", Host=f"localhost:{server.server_port}")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "../../etc/passwd",
        "..%2f..%2fetc/passwd",
        "view/../../../etc/passwd",
        "page/index.html",
        "view/0/9",
        "view/9/0",
        "view/-1/0",
        "map/7/disparity",
        "map/0/record",
        "map/0/__class__",
        "why?map=0&x=1",
        "why?map=0&x=one&y=1",
        "view/0/0/",
    ],
)
def test_there_is_nothing_else(server: ViewerServer, path: str) -> None:
    assert ask(server, path)[0] == 404


def test_it_listens_on_this_machine_only(server: ViewerServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    with socket.socket() as other:  # another address of this very machine
        other.settimeout(2)
        assert other.connect_ex(("127.0.0.2", server.server_port)) != 0


def test_answers_are_kept_from_caches_and_frames(server: ViewerServer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port)
    connection.request("GET", f"/{server.token}/")
    answer = connection.getresponse()
    page = answer.read().decode()
    connection.close()
    assert answer.getheader("Cache-Control") == "no-store"
    assert answer.getheader("X-Frame-Options") == "DENY"
    assert answer.getheader("Referrer-Policy") == "no-referrer"
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy
    assert "default-src 'none'" in policy[1]
    assert "unsafe" not in policy[1]


def test_a_port_in_use_is_an_error_of_one_line(server: ViewerServer, lf: LightField) -> None:
    with pytest.raises(LightFieldError, match=rf"--port {server.server_port}: .*; expected a free port"):
        ViewerServer(Viewer(lf, []), server.server_port)


# --- evidence


def test_profiles_are_those_of_a_whole_run() -> None:
    """What is computed in a window around a pixel is what the method itself had there."""
    wide = scene((5, 5), (112, 128))
    kept = ("first map", "smoothed", "shares", "sign energies", "joint energies")
    trace = lfdepth.Trace(keep=kept)
    result = lfdepth.estimate(wide, effort="fast", gloss=False, threads=1, trace=trace, check=False)
    # The second count of a run sees by the first map.
    seen_by = replace(result, disparity=trace.kept["first map"][0])
    explainer = Explainer(wide, seen_by)
    smoothed = np.array(trace.kept["smoothed"])
    for x, y in [(0, 0), (64, 56), (33, 28), (127, 111), (84, 84), (40, 60)]:
        found = explainer.at(x, y)
        np.testing.assert_allclose(found.planes, np.sort(found.planes)[::-1])
        np.testing.assert_allclose(found.signs, smoothed[:, y, x], atol=2e-4)
        np.testing.assert_allclose(found.photo_visible, trace.kept["shares"][1][:, y, x], atol=1.5 / 255)
        np.testing.assert_allclose(found.sign_energy, trace.kept["sign energies"][1][:, y, x], atol=5e-4)
        np.testing.assert_allclose(found.energy, trace.kept["joint energies"][1][:, y, x], atol=8e-3)


def test_views_that_an_occluder_covers_are_those_of_the_geometry(lf: LightField) -> None:
    """A wall pixel left of the rectangle is hidden in the views that look past it from the left."""
    assert lf.truth is not None
    explainer = Explainer(lf, lf.truth)
    height, width = lf.truth.shape
    y = height // 2
    x = int(np.flatnonzero(lf.truth[y] == np.float32(NEAR))[0]) - 2
    found = explainer.at(x, y)
    for v, u in np.ndindex(5, 5):
        row, column = y - FAR * (v - 2), x - FAR * (u - 2)
        covered = (
            abs(column + NEAR * (u - 2) - 0.45 * width) < 0.2 * width
            and abs(row + NEAR * (v - 2) - 0.5 * height) < 0.25 * height
        )
        beside = abs(abs(column + NEAR * (u - 2) - 0.45 * width) - 0.2 * width) < 1  # within rounding
        assert beside or found.states[v, u] == (HIDDEN if covered else SEEN), (v, u)
    assert (found.states == HIDDEN).any()
    assert found.truth == pytest.approx(FAR)
    assert explainer.at(0, 0).states[4, 4] == SEEN
    assert explainer.at(0, 0).states[0, 0] == OUTSIDE


def test_views_that_agree_show_the_same_colour() -> None:
    """On a plane, every view agrees at the plane's disparity, and the samples are the reference view's."""
    rng = np.random.default_rng(4)
    flat = light_field(rng, (5, 5), (48, 56))
    disparity = np.zeros((48, 56), np.float32)
    same = replace(
        flat, views=np.broadcast_to(flat.reference, flat.shape).copy(), disparity_range=(-0.7, 0.7)
    )
    found = Explainer(same, disparity).at(20, 30)
    assert found.agrees.all()
    np.testing.assert_array_equal(found.colours, same.views[:, :, 30, 20])
    assert found.stages[0].disparity == pytest.approx(0, abs=0.02)
    assert found.stages[2].disparity == pytest.approx(0, abs=0.02)
    assert found.decided_by == "energy of both"
    np.testing.assert_array_equal(found.epi_horizontal, same.epi_horizontal(30)[:, :53])
    assert found.epi_start == (0, 0)


REFINED, FAINT, SIDES = "refinement between planes", "signs on faint surfaces", "network at depth edges"


@pytest.mark.parametrize(
    ("method", "later"),
    [
        (FbsVis(), [REFINED, FAINT, SIDES]),
        (FbsVis(faint=False), [REFINED, SIDES]),
        (FbsVis(effort="fast", edge_net=False), []),
    ],
)
def test_every_block_of_the_method_is_shown(lf: LightField, method: FbsVis, later: list[str]) -> None:
    """The blocks that make the map leave its disparity; those that a method leaves out are not shown."""
    whole = lfdepth.estimate(lf, method, check=False)
    found = Explainer(lf, whole).at(30, 20)
    names = [stage.name for stage in found.stages]
    assert names[names.index("depth edges") + 1 : -1] == later
    assert found.stages[-2].disparity == pytest.approx(float(whole.disparity[20, 30]), abs=0.01)


def test_a_wrong_map_is_told_from_what_the_blocks_say(lf: LightField) -> None:
    assert lf.truth is not None
    found = lfdepth.explain(lf, np.full_like(lf.truth, 1.0), 70, 10)
    assert found.disparity == 1.0
    assert found.stages[-2].disparity == pytest.approx(FAR, abs=0.05)
    assert len(found.remarks) == 1
    assert "the map comes from elsewhere" in found.remarks[0]
    assert found.decision.startswith("Whoever made the map")


@pytest.mark.parametrize(("x", "y"), [(-1, 0), (80, 0), (0, 64)])
def test_pixels_outside_are_refused(lf: LightField, x: int, y: int) -> None:
    assert lf.truth is not None
    with pytest.raises(LightFieldError, match="expected x from 0 to 79 and y from 0 to 63"):
        lfdepth.explain(lf, lf.truth, x, y)


def test_maps_of_another_size_are_refused(lf: LightField, tmp_path: Path) -> None:
    small = np.zeros((64, 79), np.float32)
    for refused in (lambda: lfdepth.explain(lf, small, 0, 0), lambda: shown_map(small, lf, 0, "small.pfm")):
        with pytest.raises(LightFieldError, match=r"79x64 px.*expected 80x64"):
            refused()


def test_evidence_is_served(server: ViewerServer, lf: LightField) -> None:
    assert lf.truth is not None
    found = json.loads(ask(server, "why?map=0&x=30&y=20")[1])
    wanted = lfdepth.explain(lf, lf.truth, 30, 20)
    np.testing.assert_allclose(found["energy"], wanted.energy, rtol=1e-6)
    np.testing.assert_array_equal(found["states"], wanted.states)
    colours = np.frombuffer(base64.b64decode(found["colours"]["data"]), np.uint8).reshape(5, 5, 3)
    np.testing.assert_array_equal(colours, wanted.colours)
    status, body = ask(server, "why?map=0&x=80&y=20")
    assert status == 400
    assert "expected x from 0 to 79" in json.loads(body)["error"]


# --- runs


def run_to_its_end(runs: Runs, wanted: Any) -> dict[str, Any]:
    runs.start(wanted)
    runs.join()
    return runs.state()


def test_a_run_gives_the_map_of_its_method(lf: LightField) -> None:
    found: list[lfdepth.Result] = []
    runs = Runs(lf, lambda result: found.append(result) or 5, threads=1)  # type: ignore[func-returns-value]
    state = run_to_its_end(runs, {"method": "fbs", "options": {"step": "0.2"}, "range": ["-0.9", 1.1]})
    assert state == {"running": False, "map": 5}
    wanted = lfdepth.estimate(lf, "fbs", step=0.2, range=(-0.9, 1.1), threads=1)
    np.testing.assert_array_equal(found[0].disparity, wanted.disparity)


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ([], "found no method"),
        ({"method": "nonsense"}, "nonsense"),
        ({"method": "fbs", "options": {"depth": 1}}, "depth: method fbs has no such parameter"),
        ({"method": "fbs", "options": {"radius": "-1"}}, "radius: found"),
        ({"method": "fbs", "range": ["a", 1]}, "range: found"),
        ({"method": "fbs", "range": 3}, "range: found"),
    ],
)
def test_what_cannot_be_run_is_refused(lf: LightField, wanted: Any, message: str) -> None:
    runs = Runs(lf, lambda _: 0)
    with pytest.raises(LightFieldError, match=message):
        runs.start(wanted)
    assert runs.state() == {"running": False}


def test_a_run_that_fails_says_why(lf: LightField) -> None:
    state = run_to_its_end(Runs(lf, lambda _: 0), {"method": "fbs", "range": [1, -1]})
    assert "expected MIN below MAX" in state["error"]


def test_one_run_at_a_time_and_it_can_be_stopped(lf: LightField) -> None:
    runs = Runs(lf, lambda _: 0, threads=1)
    runs.start({"method": "fbs", "options": {"step": "0.002"}})
    with pytest.raises(LightFieldError, match="one is going on"):
        runs.start({"method": "fbs"})
    runs.cancel()
    runs.join()
    assert runs.state() == {"running": False, "cancelled": True}


# --- the exported page


def blobs_of(page: str) -> dict[str, bytes]:
    found = re.findall(r'<script type="text/plain" data-name="([^"]+)">([^<]*)</script>', page)
    return {name: base64.b64decode(data) for name, data in found}


def test_an_exported_page_holds_everything_and_asks_for_nothing(lf: LightField, tmp_path: Path) -> None:
    assert lf.truth is not None
    size = export(tmp_path / "page.html", lf, [shown_map(lf.truth, lf, 0, "truth")])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert size == (tmp_path / "page.html").stat().st_size
    blobs = blobs_of(page)
    assert len([name for name in blobs if name.startswith("view/")]) == 25
    view = np.asarray(Image.open(BytesIO(blobs["view/1/3"])))
    assert np.abs(view.astype(int) - lf.views[1, 3]).mean() < 4  # of strong colours, as JPEG keeps them
    for name in ("map/0/disparity", "truth"):
        values = np.frombuffer(zlib.decompress(blobs[name]), "<f4").reshape(64, 80)
        np.testing.assert_array_equal(values, lf.truth)
    without = re.sub(r"http://www\.w3\.org/2000/svg", "", page)  # a name, no address
    assert "http://" not in without
    assert "https://" not in without
    assert not re.search(r"<(link|script|img|iframe)[^>]+(src|href)=(?!\"data:)", without)
    assert "connect-src 'none'" in page


def test_names_cannot_break_out_of_the_page(lf: LightField) -> None:
    """A folder's name is a stranger's word: here one that would end the element it stands in."""
    name = '</script><script>alert("@SCRIPTS@")</script>'
    page = lfdepth.view(replace(lf, name=name)).text
    assert "<script>alert" not in page
    facts = re.search(r'id="page-facts">([^<]*)</script>', page)
    assert facts
    assert json.loads(facts[1])["scene"]["name"] == name


def test_camera_facts_lead_to_the_depths_of_the_camera(lf: LightField) -> None:
    camera = lfdepth.Camera(100, 35, 90, 6.7, lf.width, lf.height)
    page = lfdepth.view(replace(lf, camera=camera)).text
    facts = re.search(r'id="page-facts">([^<]*)</script>', page)
    assert facts
    given = json.loads(facts[1])["scene"]["camera"]
    disparity = np.array([-0.6, 0, 0.8])
    np.testing.assert_allclose(
        1 / (disparity / given["scale"] + given["inverse_focus"]), camera.disparity_to_depth(disparity)
    )
    points = camera.points(np.full((lf.height, lf.width), 0.3))
    x = (7 - given["cx"]) * given["step"] * points[5, 7, 2]
    assert x == pytest.approx(points[5, 7, 0])


# --- the command


@pytest.fixture(scope="module")
def files(lf: LightField, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("scene")
    lfdepth.write(folder / "planes.npz", lf)
    assert lf.truth is not None
    lfdepth.write(folder / "map.pfm", lf.truth)
    return folder / "planes.npz", folder / "map.pfm"


def test_the_command_serves_until_interrupted(files: tuple[Path, Path]) -> None:
    code = "import sys; from lfdepth.cli import main; sys.exit(main())"
    words = ["view", str(files[0]), "--map", str(files[1]), "--no-browser"]
    with subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        try:
            found = re.search(r"http://127\.0\.0\.1:(\d+)/([\w-]{32})/", process.stdout.readline())
            assert found
            connection = http.client.HTTPConnection("127.0.0.1", int(found[1]), timeout=20)
            connection.request("GET", f"/{found[2]}/map/0/disparity")
            assert len(connection.getresponse().read()) == 4 * 64 * 80
            connection.close()
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(20) == 130


def test_the_command_writes_a_page(files: tuple[Path, Path], tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    assert (
        main(["view", str(files[0]), "--map", str(files[1]), "--export", str(target), "--views", "3x3"]) == 0
    )
    assert len([name for name in blobs_of(target.read_text()) if name.startswith("view/")]) == 9


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--export", "page.pdf"], "expected a name ending in .html"),
        (["--export", "page.html", "--port", "8000"], "--port: found with --export"),
        (["--export", "none/page.html"], "none"),
        (["--port", "70000"], "expected 0 to 65535"),
        (["--scale", "0.5"], "is a map of 80x64 px; expected 40x32"),
    ],
)
def test_wrong_words_are_explained(
    files: tuple[Path, Path],
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    quiet = [] if "--export" in words else ["--no-browser"]
    assert main(["view", str(files[0]), "--map", str(files[1]), *quiet, *words]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
