"""Ways out: a pipe that is slow or closed, UDP to a true socket, EPICS to a true client."""

import json
import math
import os
import re
import socket
import threading
from dataclasses import replace

import pytest
from extras import needs
from live_fields import until

from glint_aoa.errors import InputError
from glint_aoa.flags import Flag
from glint_aoa.live.outputs import LineSender, Output, Sender, UdpSender
from glint_aoa.live.readings import Reading

READING = Reading(
    index=7,
    time_s=0.5,
    unix_time_s=1_790_000_000.125,
    angle_deg=2.1034,
    u95_deg=0.0031,
    intercept_mm=101.2,
    slope=0.0367,
    slope_px=0.015,
    intercept_px=40.0,
    n_columns=38,
    flags=0,
    point="live-0001",
    latency_ms=0.8,
)


class Held(Sender):
    """Sends only while it is let."""

    name = "held"

    def __init__(self):
        self.may, self.sent = threading.Event(), []

    def send(self, reading):
        self.may.wait()
        self.sent.append(reading.index)


def test_a_slow_reader_holds_nobody_up_and_what_it_misses_is_counted():
    sender, told = Held(), []
    output = Output(sender, tell=told.append, waiting=4)
    for index in range(20):
        output.offer(replace(READING, index=index))
    sender.may.set()
    output.close()
    # Four wait, and one may be on its way already.
    assert len(sender.sent) + output.dropped == 20
    assert len(sender.sent) in (4, 5)
    assert sender.sent == list(range(len(sender.sent)))
    assert told == []


def test_lines_come_whole_through_a_pipe():
    read, write = os.pipe()
    output = Output(LineSender(write), tell=print)
    for index in range(3):
        output.offer(replace(READING, index=index))
    output.close()
    os.close(write)
    with os.fdopen(read) as file:
        lines = [json.loads(line) for line in file]
    assert [line["index"] for line in lines] == [0, 1, 2]
    assert lines[0]["angle_deg"] == 2.1034


def test_a_reader_that_leaves_is_told_of_once():
    read, write = os.pipe()
    os.close(read)
    told, gone = [], threading.Event()
    output = Output(LineSender(write), tell=told.append, gone=gone.set)
    output.offer(READING)
    assert gone.wait(60)
    output.offer(READING)
    output.close()
    os.close(write)
    assert told == ["stdout: no more readings can be sent (Broken pipe)"]


def test_datagrams_reach_a_socket():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60)
        output = Output(UdpSender(f"127.0.0.1:{receiver.getsockname()[1]}"), tell=print)
        output.offer(READING)
        got = json.loads(receiver.recv(65536))
        output.close()
    assert got == READING.plain()


def test_that_nobody_listens_is_no_error():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    told = []
    output = Output(UdpSender(f"127.0.0.1:{port}"), tell=told.append)
    for _ in range(5):
        output.offer(READING)
    output.close()
    assert told == []


@pytest.mark.parametrize("address", ["here", "here:", ":5", "here:0", "here:70000", "here:port"])
def test_what_is_no_address_is_refused(address):
    expected = f"--udp {address}: expected HOST:PORT, such as 192.168.0.7:5005"
    with pytest.raises(InputError, match=f"^{re.escape(expected)}$"):
        UdpSender(address)


def test_a_host_that_is_not_known_is_refused():
    with pytest.raises(
        InputError, match=r"^--udp no\.such\.host\.invalid:5: the host is not known"
    ):
        UdpSender("no.such.host.invalid:5")


@pytest.mark.parametrize(
    ("changed", "severity", "message"),
    [
        ({}, 0, ""),
        ({"flags": int(Flag.UNCALIBRATED)}, 0, "UNCALIBRATED"),
        ({"flags": int(Flag.FADING)}, 1, "FADING"),
        ({"u95_deg": 0.02}, 1, "u95 0.0200 deg"),
        ({"flags": int(Flag.REPEATED)}, 3, "REPEATED"),
        ({"angle_deg": math.nan, "flags": int(Flag.NO_GLINT)}, 3, "NO_GLINT"),
        ({"angle_deg": math.nan}, 3, "not measured"),
    ],
)
def test_alarms_follow_flags_and_uncertainty(changed, severity, message):
    from glint_aoa.live.outputs.epics import alarm_of

    assert alarm_of(replace(READING, **changed), 0.01) == (severity, message)


def test_a_client_gets_and_monitors_the_angle():
    needs("p4p")
    from p4p.client.thread import Context

    from glint_aoa.live.outputs.epics import EpicsSender

    sender = EpicsSender("TUNNEL:AOA", local=True)
    output = Output(sender, tell=print)
    client = Context("pva", conf=sender.server.conf(), useenv=False)
    try:
        blank = client.get("TUNNEL:AOA:angle")
        assert math.isnan(blank)
        assert blank.raw.alarm.severity == 3
        seen = []
        watching = client.monitor("TUNNEL:AOA:angle", seen.append)
        until(lambda: len(seen) == 1)
        output.offer(READING)
        until(lambda: len(seen) == 2)
        watching.close()
        values = {name: client.get(f"TUNNEL:AOA:{name}") for name in ("angle", "u95", "intercept")}
        assert values == {"angle": 2.1034, "u95": 0.0031, "intercept": 101.2}
        raw = values["angle"].raw
        assert raw.getID() == "epics:nt/NTScalar:1.0"
        assert (raw.timeStamp.secondsPastEpoch, raw.timeStamp.nanoseconds) == (
            1790000000,
            125000000,
        )
        assert (raw.alarm.severity, raw.alarm.message) == (0, "")
        assert raw.display.units == "deg"
        assert raw.display.description == "pitch angle after calibration, nose up"
        assert values["intercept"].raw.display.units == "mm"
        output.offer(replace(READING, angle_deg=math.nan, flags=int(Flag.NO_GLINT)))
        until(lambda: math.isnan(client.get("TUNNEL:AOA:angle")))
        alarm = client.get("TUNNEL:AOA:angle").raw.alarm
        assert (alarm.severity, alarm.status, alarm.message) == (3, 1, "NO_GLINT")
    finally:
        client.close()
        output.close()
