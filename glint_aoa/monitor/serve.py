"""The server of the page: every request is judged before anything else looks at it."""

import csv
import io
import logging
import os
import re
import signal
import socket
from collections.abc import Callable
from types import FrameType
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.resources import Resources
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.views.static_handler import StaticHandler
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.web import OutputTransform, RequestHandler

from glint_aoa.access import Access
from glint_aoa.errors import InputError
from glint_aoa.monitor.page import Page, Shared
from glint_aoa.monitor.watch import FolderWatch
from glint_aoa.records.angles import LOG_COLUMNS

__all__ = ["serve"]

_SERVED = re.compile(r"/(ws|log\.csv|favicon\.ico|static/js/[\w.-]+\.js)?")
_METHODS = {"GET", "HEAD"}
_YEAR_S = 365 * 86400
_MOST_MESSAGE = 1 << 20  # of a browser [bytes]: clicks and widths
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def serve(
    shared: Shared,
    *,
    address: str = "127.0.0.1",
    port: int = 5007,
    token: str | None = None,
    announce: Callable[[str], None],
) -> None:
    """Serve the page until the program is told to end.

    Parameters
    ----------
    shared : Shared
        What the pages show; started here, and stopped at the end.
    address : str, optional
        IP address to listen on.
    port : int, optional
        Port; 0 takes a free one.
    token : str, optional
        What each request must know; made up if none is given and `address` is not localhost.
    announce : callable
        Called once with the page's address when it listens.

    Raises
    ------
    InputError
        If it cannot listen there.
    """
    access = Access.of(address, port, token)
    listening = _listening(access.address, port)
    access = access.at(listening.getsockname()[1])
    _quieten()
    loop = IOLoop.current()
    pages = _Pages(shared, access)
    http = HTTPServer(pages, max_body_size=_MOST_MESSAGE)
    http.add_socket(listening)
    server = BaseServer(loop, pages, http)
    for each in (shared.points, shared.live):
        if each is not None:
            each.start()
    server.start()
    _stop_on_signals(loop)
    announce(access.url)
    loop.start()
    server.stop(wait=False)
    for each in (shared.points, shared.live):
        if each is not None:
            each.stop()


def _listening(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listening = socket.create_server((address, port), family=family, backlog=128)
    except OSError as error:
        raise InputError(
            f"port {port} of {address} cannot be had ({os.strerror(error.errno or 0)}); "
            "give another --port"
        ) from None
    listening.setblocking(False)
    return listening


def log_csv(watch: FolderWatch) -> str:
    """Return the rows of the log of all points that are measured, as in ``log.csv``."""
    text = io.StringIO()
    writer = csv.DictWriter(text, LOG_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row.log for row in watch.rows() if row.log)
    return text.getvalue()


class _Pages(BokehTornado):  # type: ignore[misc]  # Bokeh is not looked into
    """Bokeh's server behind `Access`; only the page, its scripts and the table are there."""

    def __init__(self, shared: Shared, access: Access) -> None:
        self._access = access
        super().__init__(
            {"/": Application(FunctionHandler(lambda document: _open(document, shared)))},
            extra_patterns=[(r"/log\.csv", _Log, {"watch": shared.points.watch})],
            # Every request has been judged in `find_handler`; Bokeh cannot list what it allows.
            extra_websocket_origins=["*"],
            # A page tells its browser's scripts neither cookies nor headers.
            include_cookies=[],
            include_headers=[],
            use_index=False,
            websocket_max_message_size_bytes=_MOST_MESSAGE,
        )
        self.add_transform(_WithHeaders)

    def find_handler(self, request: HTTPServerRequest, **kwargs: Any) -> Any:
        """Return what answers a request: a refusal, the way in, or what was asked for."""
        status, why = self._judge(request)
        if status:
            return self.get_handler_delegate(request, _Refusal, {"status": status, "why": why})
        given = request.query_arguments.get("token")
        if request.path == "/" and given:
            return self.get_handler_delegate(request, _Entrance, {"access": self._access})
        return super().find_handler(request, **kwargs)

    def resources(self, absolute_url: str | bool | None = None) -> Resources:  # noqa: ARG002
        """Return scripts of this server, whatever the environment says: there is no other."""
        return Resources(mode="server", root_url="/", path_versioner=StaticHandler.append_version)

    def _judge(self, request: HTTPServerRequest) -> tuple[int, str]:
        access, headers = self._access, request.headers
        host, origins = headers.get("Host", ""), headers.get_list("Origin")
        if not access.knows_host(host):
            return 403, "This is not the name of this server."
        if any(not access.knows_origin(each, host) for each in origins):
            return 403, "The page that asks is not this server's."
        if not access.knows_token(_token(request, access.cookie)):
            return 403, "Open the address that the monitor printed when it started: it has a token."
        if request.method not in _METHODS:
            return 405, "There is nothing to send here."
        if not _SERVED.fullmatch(request.path):
            return 404, "There is nothing of that name."
        return 0, ""


def _open(document: Any, shared: Shared) -> None:
    Page(document, shared)


def _token(request: HTTPServerRequest, cookie: str) -> str | None:
    """Return the token that a request brings: as a header, in its address or as a cookie."""
    kind, _, value = request.headers.get("Authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return value.strip()
    if given := request.query_arguments.get("token"):
        return given[-1].decode("utf-8", errors="replace")
    kept = request.cookies.get(cookie)
    return None if kept is None else kept.value


class _Refusal(RequestHandler):
    def initialize(self, status: int, why: str) -> None:
        self._status, self._why = status, why

    def prepare(self) -> None:
        self.set_status(self._status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{self._why}\n")


class _Entrance(RequestHandler):
    """Takes the token out of the address, where histories keep it, into a cookie."""

    def initialize(self, access: Access) -> None:
        self._access = access

    def get(self) -> None:
        token = self._access.token
        if token is not None:
            self.set_cookie(
                self._access.cookie, token, max_age=_YEAR_S, httponly=True, samesite="Strict"
            )
        self.redirect("/", status=303)


class _Log(RequestHandler):
    def initialize(self, watch: FolderWatch) -> None:
        self._watch = watch

    def get(self) -> None:
        self.set_header("Content-Type", "text/csv; charset=utf-8")
        self.set_header("Content-Disposition", 'attachment; filename="log.csv"')
        self.write(log_csv(self._watch))


class _WithHeaders(OutputTransform):
    """Tells browsers to load nothing from elsewhere and to show the page in no other one."""

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        del finishing
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk


def _quieten() -> None:
    """Leave only errors of the page itself on stderr, none of those who ask for it wrongly."""
    for name in ("tornado.access", "bokeh"):
        logging.getLogger(name).setLevel(logging.ERROR)
    logging.getLogger("tornado.application").addFilter(
        lambda record: not record.getMessage().startswith("Uncaught exception GET /ws")
    )


def _stop_on_signals(loop: IOLoop) -> None:
    def stop(_number: int, _frame: FrameType | None) -> None:
        loop.add_callback_from_signal(loop.stop)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
