"""The live page in a real browser, and what its server refuses."""

import http.client
import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from extras import needs
from live_stub import LiveStub
from synthetic import line_fields

from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.tables import read_csv

needs("bokeh", "requests", "playwright", programs=["chromium"])
playwright = importlib.import_module("playwright.sync_api")
expect = playwright.expect

ROOT = Path(__file__).parents[1]
TOKEN = "a-token-for-the-tests-only"
SOON = 60_000  # ms; on a busy machine
HEADERS = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}

pytestmark = pytest.mark.timeout(280)


def drop(folder, name, *, slope=0.01, seed=1, lines=(60, 200)):
    """Put a point into a folder, whole at once, as a recorder does."""
    fields = line_fields(
        np.random.default_rng(seed), n_fields=8, shape=lines, slope=slope, row=30.0
    )
    info = FieldInfo(rate_hz=60.0, exposure_s=1e-3, interlaced=False)
    write_point(folder / name, RecordedPoint(fields=fields, info=info))


class Monitor:
    """The program itself, on a port of its own."""

    def __init__(self, folder, *options):
        self.folder = folder
        folder.mkdir()
        setup = folder.parent / "glint-aoa.toml"
        setup.write_text('[glint]\nnose = "right"\n')
        code = "from glint_aoa.cli import main; main()"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, "monitor", folder, "--setup", setup, "--port=0", *options],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )
        said = self._process.stderr.readline()
        assert said.startswith(f"Monitor of {folder} at http://"), said
        self.url = said.split(" at ")[1].split(" (")[0]
        self.port = urlsplit(self.url).port
        self.local = f"http://127.0.0.1:{self.port}/"

    def log(self):
        return read_csv(self.folder / "results" / "log.csv")

    def stop(self):
        self._process.terminate()
        self._process.wait(timeout=60)
        said = self._process.stderr.read()
        self._process.stderr.close()
        return self._process.returncode, said


@pytest.fixture(scope="module")
def stub():
    stub = LiveStub(token="live-token")
    yield stub
    stub.close()


@pytest.fixture(scope="module")
def monitor(tmp_path_factory, stub):
    """A page on localhost with a live session."""
    folder = tmp_path_factory.mktemp("local") / "points"
    monitor = Monitor(folder, "--live", stub.url, "--live-token", stub.token)
    yield monitor
    assert monitor.stop() == (0, "")


@pytest.fixture(scope="module")
def open_monitor(tmp_path_factory):
    """A page that listens everywhere, without a live session."""
    folder = tmp_path_factory.mktemp("open") / "points"
    monitor = Monitor(folder, "--listen", "0.0.0.0", "--token", TOKEN)
    yield monitor
    assert monitor.stop() == (0, "")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        yield browser
        browser.close()


def visit(browser, url, width, height):
    """Open a page; what it complains of and whom it asks is noted on it."""
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    page.complaints, page.asked = [], []
    page.on(
        "console",
        lambda said: said.type in {"error", "warning"} and page.complaints.append(said.text),
    )
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("websocket", lambda socket: page.asked.append(socket.url))
    page.goto(url)
    expect(page.get_by_text("points measured")).to_be_visible(timeout=SOON)
    return page


@pytest.fixture(scope="module")
def desk(browser, monitor):
    page = visit(browser, monitor.local, 1280, 900)
    yield page
    assert page.complaints == []


@pytest.fixture(scope="module")
def tablet(browser, monitor):
    page = visit(browser, monitor.local, 768, 1024)
    yield page
    assert page.complaints == []


def row_of(page, name):
    return page.locator(f'tr[data-point="{name}"]')


def shown(number):
    return number.replace("-", "\N{MINUS SIGN}")


def ask(monitor, path="/", *, method="GET", **headers):
    """Ask without a browser; returns status, headers and body."""
    connection = http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=30)
    connection.putrequest(method, path, skip_host=True)
    headers = {"Host": f"127.0.0.1:{monitor.port}"} | headers
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    said = answer.status, dict(answer.getheaders()), b"" if answer.status == 101 else answer.read()
    connection.close()
    return said


def test_a_point_that_is_dropped_in_is_measured_once_and_shown_to_all(monitor, desk, tablet):
    drop(monitor.folder, "drop.h5", slope=0.02)
    for page in (desk, tablet):
        expect(row_of(page, "drop.h5")).to_contain_text("8/8", timeout=SOON)
        log = monitor.log()
        place = log["point"].index("drop")
        mean, std = float(log["mean_angle_deg"][place]), float(log["std_angle_deg"][place])
        row_of(page, "drop.h5").click()
        expect(page.locator(".title")).to_have_text("Mean of drop", timeout=SOON)
        expect(page.locator(".mean .value")).to_have_text(shown(f"{mean:+.4f}"))
        expect(page.locator(".std .value")).to_have_text(f"{std:.4f}")
        expect(row_of(page, "drop.h5")).to_contain_text(shown(f"{mean:+.4f}"))
        expect(page.get_by_text("No onboard sensor with this point.")).to_be_visible(timeout=SOON)
    assert log["point"].count("drop") == 1
    assert mean == pytest.approx(-np.degrees(np.arctan(0.02)), abs=0.02)


def test_flags_are_words_in_table_and_chips(monitor, desk):
    drop(monitor.folder, "flagged.h5")
    words = "no camera in the setup: the angle is that of the image plane"
    expect(row_of(desk, "flagged.h5")).to_contain_text(f"UNCALIBRATED: {words}", timeout=SOON)
    row_of(desk, "flagged.h5").click()
    chip = desk.locator(".chip.doubt")
    expect(chip).to_contain_text("UNCALIBRATED", timeout=SOON)
    expect(chip).to_contain_text(words)


def test_a_broken_point_is_a_row_with_its_sentence_whatever_its_name(monitor, desk):
    name = "<img src=x>&'.npy"
    (monitor.folder / name).write_text("no array")
    os.utime(monitor.folder / name, (1e9, 1e9))
    row = desk.locator("tr", has_text="<img src=x>")
    expect(row).to_contain_text("not a NumPy array", timeout=SOON)
    row.click()
    expect(desk.locator(".notice.bad")).to_have_text(
        re.compile(f"^✕ {re.escape(name)}: "), timeout=SOON
    )
    assert desk.locator("img").count() == 0


def test_the_page_is_quiet_and_asks_nobody_else(monitor, desk):
    assert desk.complaints == []
    assert any(url.startswith("ws://") for url in desk.asked)
    own = re.compile(rf"(http|ws)://127\.0\.0\.1:{monitor.port}/|data:|blob:")
    assert [url for url in desk.asked if not own.match(url)] == []


def test_nothing_is_wider_than_the_screen(monitor, desk, tablet):
    drop(monitor.folder, "a-point-with-a-rather-long-name-for-a-narrow-table.h5")
    for page in (desk, tablet):
        expect(page.locator("tr[data-point^=a-point]")).to_be_visible(timeout=SOON)
        width = page.viewport_size["width"]
        assert page.evaluate("document.documentElement.scrollWidth") == width
        boxes = page.locator("section").all()
        assert len(boxes) == 8
        for box in boxes:
            assert box.evaluate("each => each.scrollWidth <= each.clientWidth")


def test_the_csv_is_the_log(monitor, desk):
    drop(monitor.folder, "table.h5", seed=4)
    expect(row_of(desk, "table.h5")).to_contain_text("8/8", timeout=SOON)
    with desk.expect_download() as download:
        desk.get_by_role("link", name="Download CSV").click()
    assert download.value.suggested_filename == "log.csv"
    saved = Path(download.value.path()).read_bytes()
    written = (monitor.folder / "results" / "log.csv").read_bytes()
    assert sorted(saved.splitlines()) == sorted(written.splitlines())
    assert saved.splitlines()[0] == written.splitlines()[0]


def test_a_live_session_is_shown_and_its_buttons_work(monitor, stub, desk):
    desk.get_by_role("button", name="Live").click()
    expect(desk.locator(".title")).to_have_text("Mean of the last point", timeout=SOON)
    expect(desk.locator(".mean .value")).to_have_text("+2.1021")
    expect(desk.locator(".std .value")).to_have_text("0.0123")
    expect(desk.locator(".u95")).to_have_text("now +2.1034 ± 0.0031 deg (95 %)")
    expect(desk.locator(".live.good")).to_contain_text("live, 60 Hz, 0 fields lost, armed")
    before = len(stub.posted)
    desk.get_by_role("button", name="Trigger a point").click()
    expect(desk.locator(".notice.good")).to_contain_text("Triggered live-0007", timeout=SOON)
    desk.get_by_role("button", name="Mark shaker off").click()
    expect(desk.locator(".notice.good")).to_contain_text("Shaker off marked", timeout=SOON)
    assert stub.posted[before:] == ["/trigger", "/shaker-off"]
    assert not (monitor.folder / "trigger").exists()


def test_the_token_opens_a_page_that_listens_everywhere(open_monitor, browser):
    assert open_monitor.url.endswith(f":{open_monitor.port}/?token={TOKEN}")
    page = visit(browser, f"{open_monitor.local}?token={TOKEN}", 1280, 900)
    assert page.url == open_monitor.local
    assert TOKEN not in page.content()
    assert page.evaluate("document.cookie") == ""
    page.get_by_role("button", name="Trigger a point").click()
    expect(page.locator(".notice.good")).to_contain_text("Trigger written", timeout=SOON)
    assert (open_monitor.folder / "trigger").read_bytes() == b""
    page.get_by_role("button", name="Trigger a point").click()
    expect(page.locator(".notice.bad")).to_contain_text("nothing has taken the last trigger")
    page.get_by_role("button", name="Mark shaker off").click()
    expect(page.locator(".notice.good")).to_contain_text("Shaker off marked", timeout=SOON)
    assert read_csv(open_monitor.folder / "marks.csv")["mark"] == ["shaker off"]
    assert page.complaints == []


REQUESTS = ["/", "/log.csv", "/static/js/bokeh.min.js", "/ws"]


@pytest.mark.parametrize("path", REQUESTS)
def test_other_hosts_origins_and_tokens_are_refused(monitor, open_monitor, path):
    key = {"Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    headers = (HEADERS | key) if path == "/ws" else {}
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    for which, known in ((monitor, {}), (open_monitor, bearer)):
        own = {"Origin": f"http://127.0.0.1:{which.port}"}
        evil = f"evil.example:{which.port}"
        assert ask(which, path, **headers, **known, **own)[0] in {101, 200}
        assert ask(which, path, **headers, **known, Host=evil)[0] == 403
        assert ask(which, path, **headers, **known, Host=evil, Origin=f"http://{evil}")[0] == 403
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{which.port}"):
            assert ask(which, path, **headers, **known, Origin=origin)[0] == 403
    for wrong in ({}, {"Authorization": "Bearer other"}, {"Cookie": "glint-aoa-0=x"}):
        assert ask(open_monitor, path, **headers, **wrong)[0] == 403
    assert ask(open_monitor, f"{path}?token=other", **headers)[0] == 403


@pytest.mark.parametrize(
    "path",
    [
        "/../glint-aoa.toml",
        "/%2e%2e/glint-aoa.toml",
        "/static/../../../../../../../../etc/passwd",
        "/static/js/..%2f..%2f..%2f__init__.py",
        "/static/js/%2e%2e/%2e%2e/tornado.py",
        "/static/css/../../settings.py",
        "/static/extensions/panel/x.js",
        "/static//etc/passwd",
        "//etc/passwd",
        "/results/log.csv",
        "/drop.h5",
        "/metadata",
        "/autoload.js",
        "/log.csv/",
    ],
)
def test_nothing_but_the_page_is_served(monitor, path):
    status, _, body = ask(monitor, path)
    assert (status, body) == (404, b"There is nothing of that name.\n")


def test_nothing_can_be_sent(monitor):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(monitor, "/", method=method)[0] == 405


def test_browsers_are_told_to_load_and_frame_nothing_from_elsewhere(monitor):
    status, headers, body = ask(monitor)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Frame-Options"] == "DENY"
    assert "Access-Control-Allow-Origin" not in headers
    assert not re.search(rb"https?://(?!www\.w3\.org)", body)
