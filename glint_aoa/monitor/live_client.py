"""A live session of ``glint-aoa live``, asked over HTTP: readings, newest field, trigger."""

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
import requests
from numpy.typing import NDArray

from glint_aoa.errors import InputError
from glint_aoa.monitor.details import Picture, grey_picture

__all__ = ["LiveClient", "LiveReading", "LiveView"]

SHOWN_S = 10.0
"""How much of the past the strip chart holds [s]."""

_ASK_S = 0.4  # between requests
_PATIENCE_S = 2.0  # for an answer
_MOST_BYTES = 64_000_000  # of an answer
_MOST_READINGS = 40_000
_WRONG = (
    requests.RequestException,
    InputError,
    ValueError,
    KeyError,
    TypeError,
    OverflowError,  # infinite numbers
    RecursionError,  # lists in lists
    cv2.error,  # pictures beyond all bounds
)
_NOTHING: Mapping[str, Any] = {}


@dataclass(frozen=True)
class LiveReading:
    """What was measured of one field; NaN where nothing was.

    Attributes
    ----------
    index : int
        Number of the field in the session.
    time_s, angle_deg, u95_deg, slope_px, intercept_px : float
        Time since the source began [s]; angle and half its 95 % interval [deg]; the line in
        the field's pixels, row = intercept_px + slope_px * column.
    flags : tuple of str
        Names.
    """

    index: int
    time_s: float
    angle_deg: float
    u95_deg: float
    slope_px: float
    intercept_px: float
    flags: tuple[str, ...]

    @classmethod
    def of(cls, said: Mapping[str, Any]) -> "LiveReading":
        """Read one from its JSON object."""
        flags = said.get("flags")
        return cls(
            index=int(said["index"]),
            time_s=_number(said.get("time_s")),
            angle_deg=_number(said.get("angle_deg")),
            u95_deg=_number(said.get("u95_deg")),
            slope_px=_number(said.get("slope_px")),
            intercept_px=_number(said.get("intercept_px")),
            flags=tuple(map(str, flags)) if isinstance(flags, list) else (),
        )


@dataclass(frozen=True, eq=False)
class LiveView:
    """What is known of a live session at a moment.

    Attributes
    ----------
    state : mapping
        Its answer to ``/state``; empty before the first.
    readings : sequence of LiveReading
        The newest, in order.
    picture : Picture or None
        The newest field, with its line where its reading is known.
    problem : str
        Why it does not answer; empty if it does.
    """

    state: Mapping[str, Any]
    readings: Sequence[LiveReading]
    picture: Picture | None
    problem: str

    @property
    def newest(self) -> LiveReading | None:
        """The newest reading."""
        return self.readings[-1] if self.readings else None

    def mean(self) -> tuple[float, float, int]:
        """Mean and standard deviation [deg] of the current or last point, and its fields."""
        said = self.state.get("angle_deg")
        said = said if isinstance(said, Mapping) else _NOTHING
        count = _number(said.get("n"))
        return (
            _number(said.get("mean")),
            _number(said.get("std")),
            int(count) if 0 < count < math.inf else 0,
        )


class LiveClient:
    """Asks a live session for what is new, again and again, and passes the buttons on to it.

    Parameters
    ----------
    url : str
        Where ``glint-aoa live --http`` listens, such as ``http://127.0.0.1:8765``; as it prints
        it, with the token, or without.
    token : str, optional
        The session's token, where it is not in `url`.
    pixel_aspect : float, optional
        Pitch of a field line over that of a column, for the picture.

    Raises
    ------
    InputError
        If `url` is not that of an HTTP server.
    """

    def __init__(self, url: str, *, token: str | None = None, pixel_aspect: float = 1.0) -> None:
        self.url, shown = _checked(url)
        token = token or shown
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._pixel_aspect = pixel_aspect
        self._readings: deque[LiveReading] = deque(maxlen=_MOST_READINGS)
        self._view = LiveView(_NOTHING, (), None, f"{self.url} has not answered yet")
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._is_over.set()
        self._thread.join(timeout=5)

    def view(self) -> LiveView:
        """Return what is known now."""
        return self._view

    def ask(self) -> None:
        """Ask once for all that is new; a failure becomes the view's problem."""
        try:
            state = self._object(self._get("/state").json())
            # The field first: its reading is among those that are asked for after it.
            field = self._get("/field.png") if state.get("reading") else None
            self._take(state)
            picture = None if field is None else self._picture(field)
        except _WRONG as error:
            self._view = LiveView(
                self._view.state, self._view.readings, self._view.picture, self._said(error)
            )
            return
        self._view = LiveView(state, tuple(self._readings), picture, "")

    def trigger(self) -> str:
        """Start a point in the session.

        Raises
        ------
        InputError
            If the session does not answer or refuses.
        """
        said = self._post("/trigger")
        return f"Triggered {said.get('point') or 'a point'}"

    def shaker_off(self) -> str:
        """Mark in the session that the shaker is off.

        Raises
        ------
        InputError
            If the session does not answer or refuses.
        """
        self._post("/shaker-off")
        return "Shaker off marked in the live session"

    def _run(self) -> None:
        while not self._is_over.wait(_ASK_S):
            self.ask()

    def _take(self, state: Mapping[str, Any]) -> None:
        """Take in the readings that are new; a session that started again begins anew."""
        newest = self._readings[-1].index if self._readings else -1
        said = state.get("reading")
        if isinstance(said, Mapping) and int(said["index"]) < newest:
            self._readings.clear()
            newest = -1
        for each in self._list(self._get("/readings", since=newest).json()):
            self._readings.append(LiveReading.of(self._object(each)))
        while self._readings and self._readings[-1].time_s - self._readings[0].time_s > SHOWN_S:
            self._readings.popleft()

    def _picture(self, answer: requests.Response) -> Picture | None:
        encoded = np.frombuffer(answer.content, np.uint8)
        field = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE) if encoded.size else None
        if field is None:
            return None
        index = int(answer.headers.get("X-Field-Index", -1))
        reading = next((each for each in reversed(self._readings) if each.index == index), None)
        columns = np.arange(field.shape[1], dtype=np.float64)
        line: NDArray[np.float64] = np.full(columns.size, np.nan)
        if reading is not None:
            line = reading.intercept_px + reading.slope_px * columns
        shape = (field.shape[0], field.shape[1])
        levels = grey_picture(np.asarray(field, np.uint8), 255)
        return Picture(index, levels, shape, line, self._pixel_aspect)

    def _get(self, path: str, **query: Any) -> requests.Response:
        return self._answered("GET", path, query)

    def _post(self, path: str) -> Mapping[str, Any]:
        try:
            return self._object(self._answered("POST", path, {}).json())
        except (requests.RequestException, ValueError, RecursionError) as error:
            raise InputError(self._said(error)) from None

    def _answered(self, method: str, path: str, query: Mapping[str, Any]) -> requests.Response:
        """Ask; neither a proxy nor another server that this one points at is ever asked."""
        with requests.Session() as session:
            session.trust_env = False
            answer = session.request(
                method,
                f"{self.url}{path}",
                params=dict(query),
                headers=self._headers,
                timeout=_PATIENCE_S,
                allow_redirects=False,
                stream=True,
            )
            if int(answer.headers.get("Content-Length", 0)) > _MOST_BYTES:
                raise InputError(f"{self.url}{path}: the answer is too large for a live session")
            _ = answer.content
        if answer.status_code != requests.codes.ok:
            raise InputError(f"{self.url}{path}: {_refusal(answer)}")
        return answer

    def _object(self, said: Any) -> Mapping[str, Any]:
        if not isinstance(said, dict):
            raise InputError(f"{self.url}: the answer is none of glint-aoa live; check --live")
        return said

    def _list(self, said: Any) -> list[Any]:
        if not isinstance(said, list):
            raise InputError(f"{self.url}: the answer is none of glint-aoa live; check --live")
        return said

    def _said(self, error: Exception) -> str:
        if isinstance(error, InputError):
            return str(error)
        if isinstance(error, requests.ConnectionError | requests.Timeout):
            return f"{self.url} does not answer; is glint-aoa live running with --http?"
        return f"{self.url}: the answer is none of glint-aoa live; check --live"


def _checked(url: str) -> tuple[str, str | None]:
    """Return the address of a session, and the token that it was printed with."""
    query: dict[str, list[str]] = {}
    try:
        parts = urlsplit(url)
        is_server = parts.scheme in {"http", "https"} and bool(parts.hostname)
        _ = parts.port
        query = parse_qs(parts.query)
    except ValueError:
        is_server = False
    if not is_server or parts.path not in {"", "/"} or set(query) - {"token"} or parts.username:
        raise InputError(
            f"--live is {url}; give the address of glint-aoa live, such as http://127.0.0.1:8765"
        )
    return f"{parts.scheme}://{parts.netloc}", query.get("token", [None])[0]


def _refusal(answer: requests.Response) -> str:
    if answer.status_code == requests.codes.unauthorized:
        return "refused; check --live-token"
    try:
        return str(answer.json()["error"])
    except (ValueError, KeyError, TypeError):
        return f"answered {answer.status_code}, which glint-aoa live does not; check --live"


def _number(value: object) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else math.nan  # type: ignore[arg-type]
