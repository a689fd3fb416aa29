"""The session's control over HTTP: state, readings, newest field, trigger."""

import dataclasses
import json
import math
import socket
import socketserver
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from glint_aoa.access import Access
from glint_aoa.errors import GlintError, InputError
from glint_aoa.live.session import Session, State

__all__ = ["Control", "state_as_json"]

_MOST_BODY = 4096
_MOST_READINGS = 10_000
_PATIENCE_S = 10.0  # with a client that has connected and says nothing


class Control:
    """Serves a session's control in threads of its own; a context.

    Parameters
    ----------
    session : Session
        The session.
    port : int
        Port to listen on; 0 takes a free one.
    address : str, optional
        IP address to listen on.
    token : str, optional
        What every request must show, as ``Authorization: Bearer`` or as ``?token=``; made up if
        none is given and others could reach the address.

    Raises
    ------
    InputError
        As for `glint_aoa.access.Access.of`, or if the port cannot be had.
    """

    def __init__(
        self, session: Session, port: int, *, address: str = "127.0.0.1", token: str | None = None
    ) -> None:
        access = Access.of(address, port, token)
        try:
            self._server = _Server(session, access)
        except (OSError, OverflowError) as error:
            raise InputError(
                f"--http {port}: cannot listen on {address} ({error}); give another port or address"
            ) from None
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True
        )

    @property
    def url(self) -> str:
        """Where it listens, with the token."""
        return self._server.access.url

    def __enter__(self) -> "Control":
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, session: Session, access: Access) -> None:
        self.session = session
        self.address_family = socket.AF_INET6 if ":" in access.address else socket.AF_INET
        super().__init__((access.address, access.port), _Handler)
        self.access = access.at(self.server_port)

    def server_bind(self) -> None:
        """Bind without asking for the machine's name, which can take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_port = self.server_address[1]

    def handle_error(self, *_: object) -> None:
        """Stay silent: a client that left is no news."""


class _Refused(Exception):  # noqa: N818  an answer rather than an error
    def __init__(self, status: HTTPStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _PATIENCE_S
    server_version, sys_version = "glint-aoa", ""

    def do_GET(self) -> None:
        """Answer a question."""
        self._answer(
            {"/state": self._state, "/readings": self._readings, "/field.png": self._field}
        )

    def do_POST(self) -> None:
        """Do something."""
        self._answer({"/trigger": self._trigger, "/shaker-off": self._shaker_off})

    def log_message(self, *_: object) -> None:
        """Stay silent: the terminal shows the session."""

    def _answer(self, known: dict[str, Any]) -> None:
        try:
            self._check()
            known.get(self._url.path, self._unknown)()
        except _Refused as refused:
            self._send_json({"error": str(refused)}, refused.status)
        except GlintError as error:
            self._send_json({"error": str(error)}, HTTPStatus.CONFLICT)

    def _check(self) -> None:
        access, headers = self.server.access, self.headers
        try:
            self._url = urlsplit(self.path)
            self._query = parse_qs(self._url.query)
        except ValueError:
            raise _Refused(HTTPStatus.BAD_REQUEST, "the request names no page") from None
        hosts, origins = headers.get_all("Host", []), headers.get_all("Origin", [])
        if len(hosts) != 1 or not access.knows_host(hosts[0]):
            raise _Refused(
                HTTPStatus.FORBIDDEN,
                "the request was meant for another host; ask for the address that the session told",
            )
        if not all(access.knows_origin(each, hosts[0]) for each in origins):
            raise _Refused(HTTPStatus.FORBIDDEN, "the request comes from another page")
        if not access.knows_token(self._shown_token()):
            raise _Refused(HTTPStatus.UNAUTHORIZED, "show the token that the session was given")

    def _shown_token(self) -> str | None:
        kind, _, token = self.headers.get("Authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return str(token.strip())
        return self._query.get("token", [None])[0]

    def _unknown(self) -> None:
        raise _Refused(HTTPStatus.NOT_FOUND, f"{self._url.path} is not known here")

    def _state(self) -> None:
        session = self.server.session
        self._send_json(state_as_json(session.source.name, session.rate_hz, session.state()))

    def _readings(self) -> None:
        text = self._query.get("since", ["-1"])[0]
        try:
            since = int(text)
        except ValueError:
            raise _Refused(
                HTTPStatus.BAD_REQUEST, f"since is {text!r}; expected the index of a reading"
            ) from None
        newest = self.server.session.readings_since(since)[-_MOST_READINGS:]
        self._send_json([reading.plain() for reading in newest])

    def _field(self) -> None:
        newest = self.server.session.newest_field()
        if newest is None:
            raise _Refused(HTTPStatus.NOT_FOUND, "no field has come yet")
        number, field = newest
        png = _png(field, self.server.session.source.white_level)
        self._send(png, "image/png", extra={"X-Field-Index": str(number)})

    def _trigger(self) -> None:
        name = self._body().get("point")
        if name is not None and not isinstance(name, str):
            raise _Refused(HTTPStatus.BAD_REQUEST, "point is no text; give the point's name")
        self._send_json({"point": self.server.session.trigger(name)})

    def _shaker_off(self) -> None:
        self._body()
        self.server.session.mark_shaker_off()
        self._send_json({"shaker_off": True})

    def _body(self) -> dict[str, Any]:
        text = self.headers.get("Content-Length", "0")
        if not text.isdecimal() or int(text) > _MOST_BODY:
            raise _Refused(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a body of up to {_MOST_BODY} bytes is read"
            )
        content = self.rfile.read(int(text))
        try:
            body = json.loads(content) if content.strip() else {}
        except (ValueError, RecursionError):
            body = None
        if not isinstance(body, dict):
            raise _Refused(HTTPStatus.BAD_REQUEST, "the body is no JSON object")
        return body

    def _send_json(self, value: object, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(value, allow_nan=False).encode(), "application/json", status=status)

    def _send(
        self,
        content: bytes,
        kind: str,
        *,
        status: HTTPStatus = HTTPStatus.OK,
        extra: dict[str, str] | None = None,
    ) -> None:
        self.close_connection = True
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            **(extra or {}),
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def state_as_json(source: str, rate_hz: float, state: State) -> dict[str, Any]:
    """Return a session's state as ``GET /state`` tells it: null for what is not known."""
    middle, high, most = map(_known, state.latency_ms)
    mean, std, n = state.angle_deg
    said = {
        field.name: getattr(state, field.name)
        for field in dataclasses.fields(state)
        if field.name not in {"latency_ms", "reading", "angle_deg"}
    }
    return {
        "source": source,
        "rate_hz": _known(rate_hz),
        **said,
        "latency_ms": {"p50": middle, "p99": high, "max": most},
        "reading": None if state.reading is None else state.reading.plain(),
        "angle_deg": {"mean": _known(mean), "std": _known(std), "n": n},
    }


def _known(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def _png(field: NDArray[Any], white_level: int) -> bytes:
    """Return a field as a grey PNG of 8 bits."""
    import cv2  # noqa: PLC0415  half a second

    grey = field
    if field.dtype != np.uint8:
        grey = np.clip(field.astype(np.float32) * (255 / white_level), 0, 255).astype(np.uint8)
    return bytes(cv2.imencode(".png", grey, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1])
