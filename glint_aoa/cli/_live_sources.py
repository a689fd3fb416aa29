"""What SOURCE of ``glint-aoa live`` means: camera, folder, recording or simulator."""

import multiprocessing
import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import GlintError, RecordingError
from glint_aoa.live.sources import Arrival, Replay, Source, pause_until
from glint_aoa.records.fields import FieldInfo
from glint_aoa.setup import Setup
from glint_aoa.workers import deaf_to_interrupts

__all__ = ["Simulated", "open_source"]

_AHEAD_S = 2.0  # of the film that is ready before it starts
_BLOCK = 8
_DEVICE = re.compile(r"(?:/dev/video)?(\d{1,3})")
_URL = re.compile(r"[a-z][a-z0-9+]*://", re.IGNORECASE)


def open_source(source: str, setup: Setup, tell: Callable[[str], None]) -> Source:
    """Open what the user called SOURCE.

    Parameters
    ----------
    source : str
        Number or device of a camera, URL, ``camera:`` and what else OpenCV opens, folder, file of
        fields, ``replay:`` and a file or folder of fields, or ``sim:CAMPAIGN[:POINT]``.
    setup : Setup
        The setup.
    tell : callable
        Called with sentences about files that cannot be used.

    Raises
    ------
    InputError
        If it cannot be opened.
    """
    kind, _, rest = source.partition(":")
    if kind == "sim":
        return Simulated(rest or "paper")
    if kind == "replay":
        return _replay(Path(rest), setup, source)
    device = _DEVICE.fullmatch(source)
    if device or kind == "camera" or _URL.match(source):
        from glint_aoa.live.camera import Camera

        return Camera(
            int(device[1]) if device else _address(kind, rest, source), stated=setup.fields
        )
    path = Path(source)
    if path.is_dir():
        from glint_aoa.live.folder import Folder

        return Folder(path, stated=setup.fields, tell=tell)
    return _replay(path, setup, source)


def _address(kind: str, rest: str, source: str) -> int | str:
    if kind != "camera":
        return source
    return int(rest) if rest.isdigit() else rest


def _replay(path: Path, setup: Setup, name: str) -> Replay:
    from glint_aoa.records.formats import open_fields
    from glint_aoa.records.recording import resolve_recording

    stack = open_fields(path, setup.fields)
    return Replay(stack, name=name, rate_hz=resolve_recording(stack, setup).rate_hz)


class Simulated(Source):
    """A point of a simulated campaign, rendered ahead in a process of its own.

    Where rendering cannot keep up, fields come late; none is left out.

    Parameters
    ----------
    what : str
        ``CAMPAIGN`` or ``CAMPAIGN:POINT``, as for ``glint-aoa simulate``; without a point the first
        one with the shaker on.

    Attributes
    ----------
    truth : dict of int to float
        Glint's true angle by the field's number [deg].
    """

    def __init__(self, what: str) -> None:
        from render_sim.campaign import load_campaign
        from render_sim.endless import live_point, live_scene

        name, _, point_name = what.partition(":")
        campaign = load_campaign(name)
        point = live_point(campaign, point_name or None)
        scene = live_scene(campaign, point)
        self.name = f"sim:{name}:{point.name}"
        self.truth: dict[int, float] = {}
        self.meta = {"simulated_point": point.name, "tunnel_temperature_K": campaign.temperature}
        self.shape = (scene.sensor.rows, scene.sensor.columns)
        self.dtype = np.dtype(np.uint8 if scene.sensor.bits == 8 else np.uint16)
        self.white_level = (1 << scene.sensor.bits) - 1
        interlaced = scene.fields.interlaced is not False
        self._rate_hz = float(scene.fields.rate or 0.0)
        self.info = FieldInfo(
            rate_hz=self._rate_hz,
            exposure_s=scene.fields.exposure,
            first_line=scene.fields.first_line or 0,
            first_column=scene.fields.first_column or 0,
            first_parity=(scene.fields.first_parity or "even") if interlaced else "even",
            interlaced=interlaced,
        )
        fresh = multiprocessing.get_context("spawn")
        self._ahead = round(_AHEAD_S * self._rate_hz / _BLOCK)
        self._blocks: Any = fresh.Queue(2 * self._ahead)
        self._over = fresh.Event()
        self._process = fresh.Process(
            target=_render, args=(name, point.name, self._blocks, self._over), daemon=True
        )
        with deaf_to_interrupts():
            self._process.start()

    def ready(self, stop: threading.Event) -> bool:
        """Wait until the film is some seconds ahead."""
        while self._process.is_alive() and self._blocks.qsize() < self._ahead:
            if stop.wait(0.05):
                return False
        return True

    def arrivals(self, stop: threading.Event) -> Iterator[Arrival]:
        """Give field after field; see `Source`."""
        number, began = 0, None
        while not stop.is_set():
            block = self._next(stop)
            if block is None:
                return
            fields, truth = block
            began = time.perf_counter() if began is None else began
            for field, angle in zip(fields, truth, strict=True):
                start_s = number / self._rate_hz
                if not pause_until(began + start_s, stop):
                    return
                self.truth[number] = float(angle)
                self.truth.pop(number - 10_000, None)
                yield Arrival(number, field, start_s, time.perf_counter())
                number += 1

    def close(self) -> None:
        """End the process that renders."""
        self._over.set()
        self._process.terminate()
        self._process.join()

    def _next(self, stop: threading.Event) -> tuple[NDArray[Any], NDArray[np.float64]] | None:
        while not stop.is_set():
            try:
                block: Any = self._blocks.get(timeout=0.1)
            except queue.Empty:
                if not self._process.is_alive():
                    raise RecordingError(f"{self.name}: rendering broke off; start again") from None
                continue
            if isinstance(block, str):
                raise RecordingError(f"{self.name}: {block}")
            return block[0], block[1]
        return None


def _render(campaign: str, point: str, blocks: Any, over: Event) -> None:
    """Put blocks of fields into a queue until it is over; a process of its own."""
    from render_sim.campaign import load_campaign
    from render_sim.endless import endless_film, live_point

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    blocks.cancel_join_thread()
    try:
        plan = load_campaign(campaign)
        for filmed in endless_film(plan, live_point(plan, point), block=_BLOCK):
            block = filmed.fields, filmed.truth["glint_angle_deg"]
            while not over.is_set():
                try:
                    blocks.put(block, timeout=0.5)
                    break
                except queue.Full:
                    continue
            if over.is_set():
                return
    except GlintError as error:
        blocks.put(str(error))
