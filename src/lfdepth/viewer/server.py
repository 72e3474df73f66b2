"""The server of the page: on this machine only, behind a token, for pages of its own only.

A page of a stranger that is open in the same browser can send requests to this machine, too. It cannot guess
the token in the path; and requests that another page sends, or that reached this machine under another name
(DNS rebinding), are refused by their Origin, Sec-Fetch-Site and Host.
"""

from __future__ import annotations

import base64
import hmac
import json
import re
import secrets
import socket
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from lfdepth.errors import LightFieldError
from lfdepth.methods import method_class, names, parameters_of
from lfdepth.viewer.document import (
    ShownMap,
    as_bytes,
    check_showable,
    map_facts,
    shown_map,
    view_samples,
)
from lfdepth.viewer.evidence import Evidence, Explainer
from lfdepth.viewer.page import finite_json, page_html
from lfdepth.viewer.runs import Runs

if TYPE_CHECKING:
    from lfdepth.lightfield import LightField
    from lfdepth.result import Result

ADDRESS = "127.0.0.1"
_LARGEST_BODY = 1 << 16
_KEPT_EXPLAINERS = 4


class Viewer:
    """What is served: a light field, its maps, and runs that add to them.

    Parameters
    ----------
    lf
        Light field.
    maps
        Maps to begin with.
    threads
        Number of threads of estimates.
    """

    def __init__(self, lf: LightField, maps: Sequence[ShownMap], *, threads: int | None = None) -> None:
        check_showable(lf)
        self.lf = lf
        self.maps = {each.identity: each for each in maps}
        self.runs = Runs(lf, self._add, threads=threads)
        self._lock, self._explaining = threading.Lock(), threading.Lock()
        self._explainers: dict[int, Explainer] = {}

    def _add(self, result: Result) -> int:
        """A new map, of a run."""
        with self._lock:
            number = max(self.maps, default=-1) + 1
            self.maps[number] = shown_map(result, self.lf, number, result.method.name)
        return number

    def map(self, number: int) -> ShownMap:
        """A map by its number; KeyError where there is none."""
        with self._lock:
            return self.maps[number]

    def all_maps(self) -> list[ShownMap]:
        """All maps, oldest first."""
        with self._lock:
            return list(self.maps.values())

    def warm_up(self) -> None:
        """Make the first click as fast as the others: its noise measured, its kernels loaded."""
        for number in tuple(self.maps)[:1]:
            self.evidence(number, self.lf.width // 2, self.lf.height // 2)

    def evidence(self, number: int, x: int, y: int) -> Evidence:
        """The evidence of a pixel of a map."""
        source = self.map(number).source
        with self._explaining:
            if number not in self._explainers:
                while len(self._explainers) >= _KEPT_EXPLAINERS:
                    del self._explainers[next(iter(self._explainers))]
                self._explainers[number] = Explainer(self.lf, source)
            return self._explainers[number].at(x, y)  # one at a time: blocks share memory


class ViewerServer(ThreadingHTTPServer):
    """Serves a `Viewer` on 127.0.0.1.

    Parameters
    ----------
    viewer
        What to serve.
    port
        Port; 0 takes any that is free.

    Attributes
    ----------
    address : str
        Of the page, with the token.

    Raises
    ------
    LightFieldError
        If the port is taken or may not be used.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, viewer: Viewer, port: int = 0) -> None:
        self.viewer, self.token = viewer, secrets.token_urlsafe(24)
        self._connections: set[socket.socket] = set()
        try:
            super().__init__((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise LightFieldError(
                f"--port {port}: {reason}; expected a free port; choose another, or leave --port out"
            ) from None
        self.hosts = tuple(f"{name}:{self.server_port}" for name in (ADDRESS, "localhost"))
        self.address = f"http://{ADDRESS}:{self.server_port}/{self.token}/"

    def get_request(self) -> tuple[socket.socket, Any]:
        """A connection, which is remembered, as browsers keep them open."""
        connection, client = super().get_request()
        self._connections.add(connection)
        return connection, client

    def shutdown_request(self, request: Any) -> None:
        """A connection is over."""
        self._connections.discard(request)
        super().shutdown_request(request)

    def server_close(self) -> None:
        """Close the door, and the connections that are open."""
        super().server_close()
        for connection in tuple(self._connections):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves in the middle of an answer is no error; anything else is."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: ViewerServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "lfdepth", ""
    timeout = 60

    def do_GET(self) -> None:
        """Answer."""
        self._answer(
            {
                r"": self._page,
                r"view/(\d{1,6})/(\d{1,6})": self._view,
                r"map/(\d{1,6})/([a-z]+)": self._map,
                r"truth": self._truth,
                r"why": self._why,
                r"run": self._state,
                r"maps": self._maps,
                r"ping": lambda: self._json({"lfdepth": True}),
            }
        )

    def do_POST(self) -> None:
        """Answer."""
        self._answer({r"run": self._run, r"cancel": self._cancel})

    def log_message(self, format: str, *arguments: Any) -> None:
        """Say nothing: the token stands in every line."""

    def _answer(self, routes: dict[str, Any]) -> None:
        problem = self._refusal()
        if problem is not None:
            self.close_connection = True  # whatever it has sent is not read
            self._send(problem, b"", "text/plain")
            return
        path = urlsplit(self.path).path[len(self.server.token) + 2 :]
        matches = ((re.fullmatch(pattern, path, re.ASCII), route) for pattern, route in routes.items())
        found, route = next((each for each in matches if each[0]), (None, None))
        if found is None or route is None:
            self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")
            return
        try:
            route(*found.groups())
        except LightFieldError as error:
            self._json({"error": str(error)}, HTTPStatus.BAD_REQUEST)
        except (KeyError, IndexError):
            self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")
        except ConnectionError:
            raise
        except Exception as error:  # the page has to hear of it, and the terminal, too
            self.close_connection = True
            self._json({"error": f"{type(error).__name__}: {error}"}, HTTPStatus.INTERNAL_SERVER_ERROR)
            raise

    def _refusal(self) -> HTTPStatus | None:
        """Why a request is not answered; None if it is."""
        hosts = self.server.hosts
        if self.headers.get("Host") not in hosts:
            return HTTPStatus.FORBIDDEN
        origin = self.headers.get("Origin")
        if origin is not None and origin not in [f"http://{host}" for host in hosts]:
            return HTTPStatus.FORBIDDEN
        site = self.headers.get("Sec-Fetch-Site", "none")
        visit = self.headers.get("Sec-Fetch-Mode") == "navigate" and self.command == "GET"
        if site not in ("none", "same-origin") and not visit:
            return HTTPStatus.FORBIDDEN
        if self.command == "POST" and self.headers.get_content_type() != "application/json":
            return HTTPStatus.FORBIDDEN
        given = urlsplit(self.path).path.split("/")[1:]
        if len(given) < 2 or not hmac.compare_digest(given[0].encode(), self.server.token.encode()):
            return HTTPStatus.NOT_FOUND
        return None

    # --- answers

    def _page(self) -> None:
        viewer, nonce = self.server.viewer, secrets.token_urlsafe(16)
        html = page_html(
            viewer.lf, viewer.all_maps(), nonce=nonce, served=True, extra={"methods": methods_facts()}
        )
        self._send(HTTPStatus.OK, html.encode(), "text/html; charset=utf-8")

    def _view(self, row: str, column: str) -> None:
        lf, index = self.server.viewer.lf, (int(row), int(column))
        if not lf.available[index]:
            raise KeyError(index)
        self._send(HTTPStatus.OK, view_samples(lf, index).tobytes(), "application/octet-stream")

    def _map(self, number: str, layer: str) -> None:
        array = self.server.viewer.map(int(number)).layers()[layer]
        self._send(HTTPStatus.OK, as_bytes(array), "application/octet-stream")

    def _truth(self) -> None:
        truth = self.server.viewer.lf.truth
        if truth is None:
            raise KeyError("truth")
        self._send(HTTPStatus.OK, as_bytes(truth), "application/octet-stream")

    def _maps(self) -> None:
        self._json([map_facts(each) for each in self.server.viewer.all_maps()])

    def _why(self) -> None:
        query = parse_qs(urlsplit(self.path).query)
        asked = [query[name][0] for name in ("map", "x", "y")]
        if not all(re.fullmatch(r"-?\d{1,6}", each, re.ASCII) for each in asked):
            raise KeyError(asked)
        number, x, y = map(int, asked)
        viewer = self.server.viewer
        self._json(evidence_facts(viewer.evidence(number, x, y), viewer.lf.full_scale))

    def _state(self) -> None:
        self._json(self.server.viewer.runs.state())

    def _run(self) -> None:
        length = int(self.headers.get("Content-Length", 0))
        if not 0 <= length <= _LARGEST_BODY:
            self.close_connection = True
            raise LightFieldError("run: the request is too long; expected a method and its parameters")
        try:
            wanted = json.loads(self.rfile.read(length))
        except ValueError:
            raise LightFieldError("run: is not JSON; expected a method and its parameters") from None
        self._json(self.server.viewer.runs.start(wanted))

    def _cancel(self) -> None:
        self.rfile.read(min(int(self.headers.get("Content-Length", 0)), _LARGEST_BODY))
        self.server.viewer.runs.cancel()
        self._json({})

    def _json(self, facts: Any, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(status, finite_json(facts).encode(), "application/json")

    def _send(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


def methods_facts() -> list[dict[str, Any]]:
    """Methods and their parameters, for the page's panel; those that cannot be loaded are left out."""
    known = []
    for name in names():
        try:
            kind = method_class(name)
        except LightFieldError:  # another package's; `lfdepth methods` says what is wrong with it
            continue
        parameters = [each.as_dict() for each in parameters_of(kind).values()]
        known.append({"name": name, "summary": kind.info.summary, "parameters": parameters})
    return known


def evidence_facts(evidence: Evidence, full_scale: float) -> dict[str, Any]:
    """Evidence for JSON; colours in 8 bits, base64."""
    pictures = {}
    for name in ("colours", "epi_horizontal", "epi_vertical"):
        array = getattr(evidence, name)
        levels = np.rint(array.astype(np.float64) * (255 / full_scale)).clip(0, 255).astype(np.uint8)
        levels = np.broadcast_to(levels, (*levels.shape[:2], 3))
        pictures[name] = {
            "height": levels.shape[0],
            "width": levels.shape[1],
            "data": base64.b64encode(np.ascontiguousarray(levels).tobytes()).decode(),
        }
    profiles = ("planes", "signs", "photo", "photo_visible", "sign_energy", "energy")
    grids = ("states", "votes", "agrees")
    plain = (
        "x",
        "y",
        "disparity",
        "sigma",
        "confidence",
        "truth",
        "depth",
        "decided_by",
        "decision",
        "glossy",
    )
    return {
        **{name: getattr(evidence, name) for name in plain},
        **{name: getattr(evidence, name).astype(float).tolist() for name in profiles},
        **{name: getattr(evidence, name).astype(int).tolist() for name in grids},
        **pictures,
        "epi_start": list(evidence.epi_start),
        "window": list(evidence.window),
        "remarks": list(evidence.remarks),
        "stages": [{"name": each.name, "disparity": each.disparity} for each in evidence.stages],
    }
