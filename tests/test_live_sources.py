"""Sources: a camera by OpenCV (file and network), a watched folder, the simulator."""

import functools
import http.server
import re
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from live_fields import SHAPE, info_of, some_fields, until

from glint_aoa.cli._live_sources import open_source
from glint_aoa.errors import RecordingError
from glint_aoa.live import folder
from glint_aoa.live.camera import Camera, split_frame
from glint_aoa.live.folder import Folder
from glint_aoa.live.learning import learn_stack
from glint_aoa.live.readings import Measurer
from glint_aoa.live.sources import Replay
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.recording import resolve_recording
from glint_aoa.setup import Setup, load_setup

ROOT = Path(__file__).parents[1]


def fields_section(**said):
    return Setup.model_validate({"fields": said}).fields


def all_of(source):
    arrivals = [
        (each.number, each.field.copy(), each.start_s)
        for each in source.arrivals(threading.Event())
    ]
    source.close()
    numbers, fields, starts = zip(*arrivals, strict=True)
    return list(numbers), np.stack(fields), np.array(starts)


def test_a_recording_comes_as_it_is():
    fields = some_fields(5)
    times = np.array([0.5, 0.51, 0.52, 0.54, 0.55])
    source = Replay(FieldStack.from_array(fields, info_of(), times_s=times), name="r", rate_hz=60.0)
    numbers, found, starts = all_of(source)
    assert numbers == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(found, fields)
    np.testing.assert_allclose(starts, times - 0.5)


def test_frames_are_split_in_the_order_of_exposure():
    frame = np.arange(7)[:, None] * np.ones(3, int)
    even, odd = split_frame(frame, odd_first=False)
    assert (even[:, 0].tolist(), odd[:, 0].tolist()) == ([0, 2, 4], [1, 3, 5])
    assert split_frame(frame, odd_first=True)[0][:, 0].tolist() == [1, 3, 5]


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A film without loss: grey frames, and their file."""
    frames = some_fields(6, shape=(64, 128))
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30.0, (128, 64))
    assert writer.isOpened()
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    return frames, path


def test_a_camera_gives_frames(film):
    frames, path = film
    camera = Camera(str(path), stated=fields_section())
    assert (camera.shape, camera.dtype, camera.info.rate_hz) == ((64, 128), np.uint8, 30.0)
    numbers, found, starts = all_of(camera)
    assert numbers == list(range(6))
    np.testing.assert_allclose(found.astype(int), frames, atol=1)
    np.testing.assert_allclose(starts, np.arange(6) / 30)


@pytest.mark.parametrize("first_parity", ["even", "odd"])
def test_a_camera_s_frames_are_split_where_the_setup_says_interlaced(film, first_parity):
    frames, path = film
    camera = Camera(str(path), stated=fields_section(first_parity=first_parity))
    assert (camera.shape, camera.info.rate_hz) == ((32, 128), 60.0)
    numbers, found, starts = all_of(camera)
    assert numbers == list(range(12))
    lines = slice(0 if first_parity == "even" else 1, None, 2)
    np.testing.assert_allclose(found[::2].astype(int), frames[:, lines], atol=1)
    np.testing.assert_allclose(starts, np.arange(12) / 60)


class Stream(http.server.BaseHTTPRequestHandler):
    """Motion JPEG as network cameras send it."""

    def __init__(self, pictures, *arguments):
        self.pictures = pictures
        super().__init__(*arguments)

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for picture in self.pictures:
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            self.wfile.write(head.encode() + picture + b"\r\n")

    def log_message(self, *_):
        pass


def test_a_network_camera(film):
    frames, _ = film
    pictures = [bytes(cv2.imencode(".jpg", frame, [1, 100])[1]) for frame in frames]
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Stream, pictures))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        url = f"http://127.0.0.1:{server.server_address[1]}/stream.mjpg"
        camera = open_source(url, Setup.model_validate({"fields": {"rate": "50 Hz"}}), print)
        assert (camera.shape, camera.info.rate_hz) == ((64, 128), 50.0)
        numbers, found, _ = all_of(camera)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 5  # FFmpeg may keep the last picture of a stream that breaks off
    np.testing.assert_allclose(found.astype(int), frames[: len(found)], atol=12)


def test_a_camera_that_is_not_there():
    expected = (
        "camera 97: there is no /dev/video97; list the cameras with ls /dev/video*, or check the "
        "cable"
    )
    with pytest.raises(RecordingError, match=f"^{re.escape(expected)}$"):
        open_source("97", Setup(), print)


def test_a_camera_that_gives_no_picture(tmp_path):
    (tmp_path / "no.avi").write_bytes(b"nothing")
    with pytest.raises(RecordingError, match=r"^camera .*no\.avi: gives no picture; check its"):
        open_source(f"camera:{tmp_path / 'no.avi'}", Setup(), print)


class Watched:
    """A folder that is watched by a thread."""

    def __init__(self, folder, **said):
        self.told, self.stop, self.came = [], threading.Event(), []
        self.source = Folder(folder, stated=fields_section(**said), tell=self.told.append)
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self._thread.join()

    def _watch(self):
        if self.source.ready(self.stop):
            for arrival in self.source.arrivals(self.stop):
                self.came.append((arrival.number, arrival.field.copy(), arrival.start_s))


def put(path, content):
    """Write a file, whole at once: what is half written is not yet there."""
    part = path.with_name(f".{path.name}")
    content(part)
    part.rename(path)


def picture(path, field):
    put(path, lambda part: part.write_bytes(bytes(cv2.imencode(".png", field)[1])))


def test_pictures_are_taken_as_they_appear(tmp_path):
    fields = some_fields(5)
    picture(tmp_path / "before.png", fields[0])
    with Watched(tmp_path, rate="50 Hz") as watched:
        for k in (1, 2, 3):
            picture(tmp_path / f"f{k + 7}.png", fields[k])
        until(lambda: len(watched.came) == 3)
        (tmp_path / "notes.txt").write_text("no picture")
        (tmp_path / "bad.png").write_bytes(b"nothing")
        until(lambda: watched.told)
        picture(tmp_path / "other.png", fields[4][:20])
        until(lambda: len(watched.told) == 2)
        picture(tmp_path / "last.png", fields[4])
        until(lambda: len(watched.came) == 4)
    numbers, found, starts = zip(*watched.came, strict=True)
    assert numbers == (0, 1, 2, 3)
    assert {each.tobytes() for each in found} == {each.tobytes() for each in fields[1:]}
    np.testing.assert_allclose(starts, np.arange(4) / 50)
    assert watched.source.shape == SHAPE
    assert watched.told == [
        f"{tmp_path / 'bad.png'}: its pixels cannot be unpacked; it is left out",
        f"{tmp_path / 'other.png'}: uint8 [20, 400], expected uint8 [60, 400] like the first; "
        "it is left out",
    ]


def test_a_file_whose_writer_pauses_is_taken_once_it_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("glint_aoa.live.folder._YOUNG_S", 250.0)
    (field,) = some_fields(1)
    content = bytes(cv2.imencode(".png", field)[1])
    tried, read = threading.Event(), folder._read

    def noted(*what):
        try:
            return read(*what)
        finally:
            tried.set()

    monkeypatch.setattr(folder, "_read", noted)
    with Watched(tmp_path, rate="50 Hz") as watched, (tmp_path / "a.png").open("wb") as file:
        file.write(content[:300])
        file.flush()
        assert tried.wait(250)
        file.write(content[300:])
        file.flush()
        until(lambda: watched.came)
    np.testing.assert_array_equal(watched.came[0][1], field)
    assert watched.told == []


def test_files_of_fields_are_taken_whole(tmp_path):
    fields = some_fields(6)
    with Watched(tmp_path, rate="60 Hz") as watched:
        for name, some in (("a", fields[:4]), ("b", fields[4:])):
            write_point(tmp_path / f"{name}.h5", RecordedPoint(fields=some, info=info_of()))
            until(lambda some=some: len(watched.came) >= len(some))
        until(lambda: len(watched.came) == 6)
    np.testing.assert_array_equal([field for _, field, _ in watched.came], fields)


def test_a_folder_needs_a_rate(tmp_path):
    with pytest.raises(RecordingError, match=r"pictures do not say their rate; give fields\.rate"):
        Folder(tmp_path, stated=fields_section(), tell=print)


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ("sim:nothing", "no campaign is called nothing; choose paper, demo or a TOML file"),
        ("sim:demo:no", "campaign demo has no point no; its first is"),
        ("replay:/no/such.h5", "/no/such.h5: no such file; check its name and folder"),
        ("/no/such.h5", "/no/such.h5: no such file; check its name and folder"),
    ],
)
def test_what_is_not_there_is_named(what, expected):
    from glint_aoa.errors import InputError

    with pytest.raises(InputError, match=f"^{re.escape(expected)}"):
        open_source(what, Setup(), print)


def test_the_simulator_has_a_truth_and_the_live_angle_holds_it(monkeypatch):
    monkeypatch.setattr("glint_aoa.cli._live_sources._AHEAD_S", 0.25)  # films no more than is used
    shipped = load_setup(ROOT / "glint_aoa" / "data" / "paper-test.toml")
    setup = shipped.model_copy(update={"calibration": type(shipped.calibration)()})
    source = open_source("sim:paper", setup, print)
    stop, fields = threading.Event(), []
    assert source.ready(stop)
    for arrival in source.arrivals(stop):
        assert arrival.number == len(fields)
        assert arrival.start_s == pytest.approx(arrival.number / 60)
        fields.append(arrival.field.copy())
        if len(fields) == 48:
            stop.set()
    source.close()
    stack = FieldStack.from_array(np.array(fields), source.info)
    measurer = Measurer(learn_stack(stack, setup, resolve_recording(stack, setup)))
    number = np.arange(48)
    readings = measurer.measure(stack.read(0, 48), number, number / 60, number / 60)
    truth = np.array([source.truth[each.index] for each in readings])
    off = np.array([each.angle_deg for each in readings]) - truth
    u95 = np.array([each.u95_deg for each in readings])
    assert (np.abs(off) < 5 * u95).all()
    assert np.sqrt(np.mean((off / u95) ** 2)) < 1
    assert np.ptp(truth) > 0.001
