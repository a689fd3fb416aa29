"""The control over HTTP: what it tells and does, and whom it refuses."""

import http.client
import json
import threading
from contextlib import contextmanager
from types import SimpleNamespace
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from live_fields import Fed, setup_of, some_fields, until

from glint_aoa.errors import InputError
from glint_aoa.live.control import Control
from glint_aoa.live.session import PointLength, Session
from glint_aoa.records.formats import open_fields

TOKEN = "a-token-for-the-tests-only"
READING_KEYS = {
    "index",
    "time_s",
    "unix_time_s",
    "angle_deg",
    "u95_deg",
    "intercept_mm",
    "slope",
    "slope_px",
    "intercept_px",
    "n_columns",
    "flags",
    "point",
    "latency_ms",
}


class Asked:
    """A control of a running session, and a client of it."""

    def __init__(self, session, source, control):
        self.session, self.source = session, source
        self.host, self.port = "127.0.0.1", urlsplit(control.url).port

    def __call__(self, method, path, body=None, *, host=None, **headers):
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        connection.putrequest(method, path, skip_host=True)
        content = (
            b"" if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
        )
        sent = {"Host": host or f"{self.host}:{self.port}", "Content-Length": str(len(content))}
        for name, value in {**sent, **{k.replace("_", "-"): v for k, v in headers.items()}}.items():
            connection.putheader(name, value)
        connection.endheaders(content)
        answer = connection.getresponse()
        got = answer.read()
        connection.close()
        is_json = answer.getheader("Content-Type") == "application/json"
        return answer.status, json.loads(got) if is_json else got, answer.headers


def session_with(out, **how):
    source = Fed(some_fields(30))
    return Session(source, setup_of(), out, length=lambda _: PointLength(4, 6), **how), source


@contextmanager
def controlled(out):
    """Run a session whose control is asked."""
    session, source = session_with(out)
    thread = threading.Thread(target=session.run)
    with pytest.MonkeyPatch.context() as patch, Control(session, 0) as control:
        patch.setattr("glint_aoa.live.schooling.warm_up", lambda _: True)
        thread.start()
        yield Asked(session, source, control)
        session.stop()
        thread.join()


@pytest.fixture
def asked(tmp_path):
    with controlled(tmp_path) as asked:
        yield asked


@pytest.fixture(scope="module")
def refusing(tmp_path_factory):
    """A session with a field, of which nothing is asked that it would do."""
    with controlled(tmp_path_factory.mktemp("refusing")) as asked:
        asked.source.feed(0)
        came(asked, 0)
        yield asked
        assert asked("GET", "/state")[1]["point"] is None


def came(asked, number):
    until(lambda: bool(asked.session.readings_since(number - 1)))


def test_state_readings_and_field(asked):
    status, before, _ = asked("GET", "/state")
    assert (status, before["fields"], before["reading"]) == (200, 0, None)
    assert asked("GET", "/field.png")[0] == 404
    asked.source.feed(*range(12))
    came(asked, 11)
    _, state, _ = asked("GET", "/state")
    assert {"source", "rate_hz", "fields", "lost", "armed", "point", "shaker_off"} <= set(state)
    assert (state["source"], state["rate_hz"], state["fields"], state["lost"]) == (
        "fed",
        60.0,
        12,
        0,
    )
    assert state["armed"]
    assert set(state["reading"]) == READING_KEYS
    assert {"p50", "p99"} <= set(state["latency_ms"])
    _, readings, _ = asked("GET", "/readings?since=8")
    assert [each["index"] for each in readings] == [9, 10, 11]
    assert len(asked("GET", "/readings")[1]) == 12
    status, png, headers = asked("GET", "/field.png")
    assert headers["X-Field-Index"] == "11"
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(picture, asked.source.fields[11])


def test_a_point_is_triggered_and_marked(asked, tmp_path):
    asked.source.feed(*range(12))
    came(asked, 11)
    assert asked("POST", "/trigger", {"point": "run-7"})[:2] == (200, {"point": "run-7"})
    status, answer, _ = asked("POST", "/trigger", {"point": "run-8"})
    assert status == 409
    assert answer["error"] == "point run-7 is being recorded; trigger again after it"
    assert asked("POST", "/shaker-off")[:2] == (200, {"shaker_off": True})
    state = asked("GET", "/state")[1]
    assert (state["point"], state["shaker_off"], state["armed"]) == ("run-7", True, False)
    asked.source.feed(*range(12, 18))
    until((tmp_path / "run-7.h5").exists)
    assert len(open_fields(tmp_path / "run-7.h5")) == 10
    until(lambda: asked("GET", "/state")[1]["angle_deg"]["n"] == 10)
    assert asked("POST", "/trigger")[1] == {"point": "live-0001"}


@pytest.mark.parametrize(
    ("method", "path", "body", "status"),
    [
        ("GET", "/", None, 404),
        ("GET", "/../../etc/passwd", None, 404),
        ("GET", "/trigger", None, 404),
        ("POST", "/state", None, 404),
        ("GET", "/readings?since=x", None, 400),
        ("POST", "/trigger", b"{", 400),
        ("POST", "/trigger", b"[" * 4000, 400),
        ("POST", "/trigger", [1], 400),
        ("POST", "/trigger", {"point": 7}, 400),
        ("POST", "/trigger", b"x" * 5000, 413),
        ("POST", "/trigger", {"point": "../../x"}, 409),
        ("GET", "http://[", None, 400),
        ("DELETE", "/state", None, 501),
    ],
)
def test_what_makes_no_sense_is_refused(refusing, method, path, body, status):
    assert refusing(method, path, body)[0] == status
    assert refusing("GET", "/state")[1]["point"] is None


@pytest.mark.parametrize(
    "hosts",
    [
        ["evil.example"],
        ["evil.example:{port}"],
        [""],
        ["["],
        ["localhost.evil.example:{port}"],
        ["127.0.0.1:1"],
        [],
        ["127.0.0.1:{port}", "evil.example:{port}"],
    ],
)
def test_another_host_is_refused(refusing, hosts):
    connection = http.client.HTTPConnection(refusing.host, refusing.port, timeout=60)
    connection.putrequest("GET", "/state", skip_host=True)
    for host in hosts:
        connection.putheader("Host", host.format(port=refusing.port))
    connection.endheaders()
    assert connection.getresponse().status == 403
    connection.close()


def test_names_of_this_machine_are_known(refusing):
    for host in ("localhost", "127.0.0.1", "[::1]"):
        assert refusing("GET", "/state", host=f"{host}:{refusing.port}")[0] == 200


def test_a_page_of_another_origin_cannot_trigger(asked):
    asked.source.feed(0)
    came(asked, 0)
    own = f"http://{asked.host}:{asked.port}"
    for origin in ("http://evil.example", "null", "https" + own[4:], f"{own}0"):
        assert asked("POST", "/trigger", {}, Origin=origin)[0] == 403
    assert asked("GET", "/state")[1]["point"] is None
    assert asked("POST", "/trigger", {}, Origin=own)[0] == 200


def test_a_token_must_be_shown(tmp_path):
    session, source = session_with(tmp_path)
    with Control(session, 0, token=TOKEN) as control:
        asked = Asked(session, source, control)
        assert control.url.endswith(f"/?token={TOKEN}")
        for path, headers, status in (
            ("/state", {}, 401),
            (f"/state?token={TOKEN[:-1]}", {}, 401),
            (f"/state?token={TOKEN}", {}, 200),
            ("/state", {"Authorization": f"Bearer {TOKEN}"}, 200),
            ("/state", {"Authorization": f"Bearer {TOKEN}2"}, 401),
            ("/state", {"Authorization": f"Basic {TOKEN}"}, 401),
            ("/field.png", {}, 401),
            ("/nothing", {}, 401),
        ):
            assert asked("GET", path, **headers)[0] == status, path
        assert asked("POST", "/trigger", {})[0] == 401


def test_others_are_let_in_with_a_token_only(tmp_path):
    session, source = session_with(tmp_path)
    with Control(session, 0, address="0.0.0.0") as control:
        asked = Asked(session, source, control)
        token = control.url.partition("?token=")[2]
        assert len(token) >= 32
        assert asked("GET", "/state")[0] == 401
        assert asked("GET", "/state", Authorization=f"Bearer {token}")[0] == 200
    with pytest.raises(InputError, match=r"^--token must be 16 or more letters, digits, - and _"):
        Control(session, 0, address="0.0.0.0", token="t")


def test_before_the_first_field_nothing_is_triggered_or_marked(tmp_path):
    session, source = session_with(tmp_path)
    with Control(session, 0) as control:
        asked = Asked(session, source, control)
        for path, what in (("trigger", "trigger"), ("shaker-off", "mark the shaker off")):
            status, answer, _ = asked("POST", f"/{path}")
            assert status == 409
            assert answer["error"] == f"no field comes yet; {what} while the source runs"


def test_a_port_that_is_taken_is_named(tmp_path):
    session, _ = session_with(tmp_path)
    with Control(session, 0) as control:
        port = urlsplit(control.url).port
        with pytest.raises(InputError, match=f"^--http {port}: cannot listen on 127.0.0.1"):
            Control(session, port)


def test_sixteen_bits_are_shown_in_eight():
    field = some_fields(1, dtype=np.uint16, white=4095, peak=2700.0, black=160.0)[0]
    source = SimpleNamespace(white_level=4095)
    session = SimpleNamespace(source=source, newest_field=lambda: (7, field))
    with Control(session, 0) as control:
        _, png, headers = Asked(session, source, control)("GET", "/field.png")
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert headers["X-Field-Index"] == "7"
    assert picture.dtype == np.uint8
    np.testing.assert_allclose(picture, field * (255 / 4095), atol=1)
