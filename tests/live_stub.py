"""A stand-in for ``glint-aoa live --http``: answers by the interface, notes requests."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

SLOPE, INTERCEPT = 0.02, 12.0
SHAPE = (40, 120)


def reading(index, **other):
    return {
        "index": index,
        "time_s": index / 60,
        "unix_time_s": 1.79e9 + index / 60,
        "angle_deg": 2.1034,
        "u95_deg": 0.0031,
        "intercept_mm": 101.2,
        "slope": 0.0367,
        "slope_px": SLOPE,
        "intercept_px": INTERCEPT,
        "n_columns": 38,
        "flags": [],
        "point": None,
        "latency_ms": 0.8,
    } | other


class LiveStub:
    """Serves `readings` and `state`; `posted` holds what was asked for."""

    def __init__(self, token=None):
        self.token, self.posted, self.asked_since, self.hosts = token, [], [], []
        self.readings = [reading(k) for k in range(5)]
        self.extra = {}
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        ).start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()

    def state(self):
        return {
            "source": "stub",
            "rate_hz": 60.0,
            "fields": len(self.readings),
            "lost": 0,
            "armed": True,
            "point": None,
            "shaker_off": False,
            "latency_ms": {"p50": 0.8, "p99": 1.2},
            "reading": self.readings[-1] if self.readings else None,
            "angle_deg": {"mean": 2.1021, "std": 0.0123, "n": 60},
        } | self.extra


def _handler(stub):
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            path, _, query = self.path.partition("?")
            if self._refused():
                return
            if path == "/state":
                self._send(stub.state())
            elif path == "/readings":
                since = int(query.removeprefix("since="))
                stub.asked_since.append(since)
                self._send([each for each in stub.readings if each["index"] > since])
            elif path == "/field.png":
                field = np.full(SHAPE, 20, np.uint8)
                field[12:15] = 200
                png = cv2.imencode(".png", field)[1].tobytes()
                self._send(png, {"X-Field-Index": str(stub.readings[-1]["index"])})

        def do_POST(self):
            if self._refused():
                return
            stub.posted.append(self.path)
            said = {"/trigger": {"point": "live-0007"}, "/shaker-off": {"shaker_off": True}}
            self._send(said[self.path])

        def _refused(self):
            if stub.token and self.headers.get("Authorization") != f"Bearer {stub.token}":
                self._send({"error": "show the token that the session was given"}, status=401)
                return True
            return False

        def _send(self, content, headers=None, status=200):
            body = content if isinstance(content, bytes) else json.dumps(content).encode()
            self.send_response(status)
            for name, value in {"Content-Length": str(len(body)), **(headers or {})}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *arguments):
            pass

    return Handler
