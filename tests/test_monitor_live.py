"""A live session asked over HTTP, held against a stand-in that speaks the written interface."""

import importlib
import re

import cv2
import numpy as np
import pytest
from extras import needs
from live_stub import INTERCEPT, SHAPE, SLOPE, LiveStub, reading

from glint_aoa.errors import InputError

needs("requests")
LiveClient = importlib.import_module("glint_aoa.monitor.live_client").LiveClient


@pytest.fixture
def stub():
    stub = LiveStub()
    yield stub
    stub.close()


def test_a_session_is_seen(stub):
    client = LiveClient(stub.url, pixel_aspect=2.35)
    client.ask()
    view = client.view()
    assert view.problem == ""
    assert view.mean() == (2.1021, 0.0123, 60)
    assert view.newest.index == 4
    assert (view.newest.angle_deg, view.newest.u95_deg) == (2.1034, 0.0031)
    assert view.picture.number == 4
    assert view.picture.shape == SHAPE
    assert view.picture.pixel_aspect == 2.35
    np.testing.assert_allclose(view.picture.line_row, INTERCEPT + SLOPE * np.arange(SHAPE[1]))
    assert view.picture.levels.max() == 200


def test_only_new_readings_are_asked_for_and_old_ones_are_dropped(stub):
    client = LiveClient(stub.url)
    client.ask()
    stub.readings += [reading(5), reading(6, time_s=100.0, angle_deg=None, flags=["NO_GLINT"])]
    client.ask()
    assert stub.asked_since == [-1, 4]
    (newest,) = client.view().readings
    assert newest.index == 6
    assert np.isnan(newest.angle_deg)
    assert newest.flags == ("NO_GLINT",)


def test_a_session_that_began_again_is_seen_anew(stub):
    client = LiveClient(stub.url)
    client.ask()
    stub.readings = [reading(0), reading(1)]
    client.ask()
    assert [each.index for each in client.view().readings] == [0, 1]


def test_before_the_first_field_there_is_no_picture(stub):
    stub.readings = []
    stub.extra = {"angle_deg": {"mean": None, "std": None, "n": 0}}
    client = LiveClient(stub.url)
    client.ask()
    view = client.view()
    assert view.problem == ""
    assert view.picture is None
    assert view.newest is None
    assert view.mean()[2] == 0


def test_the_buttons_are_passed_on(stub):
    client = LiveClient(stub.url)
    assert client.trigger() == "Triggered live-0007"
    assert client.shaker_off() == "Shaker off marked in the live session"
    assert stub.posted == ["/trigger", "/shaker-off"]


def test_the_token_is_shown_and_a_wrong_one_is_told(monkeypatch):
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")  # never asked
    stub = LiveStub(token="known")
    right, wrong = LiveClient(stub.url, token="known"), LiveClient(stub.url, token="other")
    printed = LiveClient(f"{stub.url}/?token=known")
    for each in (right, wrong, printed):
        each.ask()
    assert right.view().problem == printed.view().problem == ""
    assert wrong.view().problem == f"{stub.url}/state: refused; check --live-token"
    with pytest.raises(InputError, match="/trigger: refused; check --live-token"):
        wrong.trigger()
    assert stub.posted == []
    stub.close()


def test_a_session_that_has_gone_is_told_and_its_last_words_stay(stub):
    client = LiveClient(stub.url)
    client.ask()
    stub.close()
    client.ask()
    sentence = f"{stub.url} does not answer; is glint-aoa live running with --http?"
    assert client.view().problem == sentence
    assert client.view().newest.index == 4
    with pytest.raises(InputError, match=re.escape(sentence)):
        client.trigger()


def test_a_picture_that_cannot_be_unpacked_is_told(stub, monkeypatch):
    def refuse(*_):
        raise cv2.error("too large")

    monkeypatch.setattr(cv2, "imdecode", refuse)
    client = LiveClient(stub.url)
    client.ask()
    assert client.view().problem == (
        f"{stub.url}: the answer is none of glint-aoa live; check --live"
    )


@pytest.mark.parametrize(
    "said", [{"reading": {"index": "x"}}, {"reading": {}}, {"reading": {"index": float("inf")}}]
)
def test_a_server_that_speaks_otherwise_is_told(stub, said):
    stub.extra = said
    client = LiveClient(stub.url)
    client.ask()
    assert client.view().problem == (
        f"{stub.url}: the answer is none of glint-aoa live; check --live"
    )


@pytest.mark.parametrize(
    "url",
    [
        "127.0.0.1:8765",
        "file:///etc",
        "http://",
        "http://h:99999",
        "http://h/live",
        "http://h/?x=1",
        "http://u@h",
    ],
)
def test_an_address_of_no_server_is_refused(url):
    sentence = f"--live is {url}; give the address of glint-aoa live, such as http://127.0.0.1:8765"
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        LiveClient(url)
