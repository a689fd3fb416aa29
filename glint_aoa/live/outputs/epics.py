"""Readings as EPICS process variables by PVAccess (p4p)."""

import math
from typing import Any

from glint_aoa.errors import MissingLibraryError
from glint_aoa.flags import Flag
from glint_aoa.live.outputs.queued import Sender
from glint_aoa.live.readings import Reading

__all__ = ["EpicsSender", "alarm_of"]

_VARIABLES = {
    "angle": ("angle_deg", "deg", 4, "pitch angle after calibration, nose up"),
    "u95": ("u95_deg", "deg", 4, "half the 95 % interval of the angle"),
    "intercept": ("intercept_mm", "mm", 4, "Z of the glint's line at X = 0"),
}
_NONE, _MINOR, _INVALID = 0, 1, 3
_DEVICE = 1  # alarm status: the device is the cause
_STATED = int(Flag.UNCALIBRATED)  # of the setup, not of the field


def alarm_of(reading: Reading, u95_limit_deg: float) -> tuple[int, str]:
    """Return severity and message of a reading's alarm.

    Parameters
    ----------
    reading : Reading
        The reading.
    u95_limit_deg : float
        Half the 95 % interval beyond which an angle is a minor alarm [deg].

    Returns
    -------
    int
        3 (invalid) where nothing was measured or ``process`` would leave the field out of the
        mean; 1 (minor) with another flag than `UNCALIBRATED`, or an uncertainty beyond the limit;
        else 0.
    str
        The flags' names.
    """
    names = " ".join(reading.flag_names)
    if not reading.is_good:
        return _INVALID, names or "not measured"
    if reading.u95_deg > u95_limit_deg:
        return _MINOR, f"u95 {reading.u95_deg:.4f} deg {names}".strip()
    if reading.flags & ~_STATED:
        return _MINOR, names
    return _NONE, names


class EpicsSender(Sender):
    """Serves ``PREFIX:angle``, ``PREFIX:u95`` and ``PREFIX:intercept`` as NTScalar.

    Each has value, alarm, timestamp (the middle of the field's exposure) and display. A field that
    was not measured keeps the value NaN and an invalid alarm.

    Parameters
    ----------
    prefix : str
        Stands before the names, with a colon between.
    u95_limit_deg : float, optional
        As for `alarm_of`.
    local : bool, optional
        Whether to serve this machine only, on ports of its own choice; for tests.

    Raises
    ------
    MissingLibraryError
        If p4p is not installed, or does not start.
    """

    def __init__(self, prefix: str, *, u95_limit_deg: float = 0.01, local: bool = False) -> None:
        try:
            from p4p.nt import NTScalar  # noqa: PLC0415  an extra
            from p4p.server import Server, StaticProvider  # noqa: PLC0415
            from p4p.server.thread import SharedPV  # noqa: PLC0415
        except ImportError:
            raise MissingLibraryError(
                "--epics needs p4p, which is not installed; install it with: "
                'pip install "glint-aoa[epics]"'
            ) from None
        self.name, self._limit = f"epics {prefix}", u95_limit_deg
        self._kind = NTScalar("d", display=True, form=True)
        self._variables = {}
        provider = StaticProvider(prefix)
        for name in _VARIABLES:
            blank = self._value(name, math.nan, 0.0, (_INVALID, "no field yet"))
            self._variables[name] = SharedPV(nt=self._kind, initial=blank)
            provider.add(f"{prefix}:{name}", self._variables[name])
        try:
            self.server = Server(providers=[provider], isolate=local)
        except RuntimeError as error:
            raise MissingLibraryError(
                f"--epics: the PVAccess server does not start ({error}); "
                "check EPICS_PVAS_* in the environment"
            ) from None

    def send(self, reading: Reading) -> None:
        """Post one to all of its variables."""
        alarm = alarm_of(reading, self._limit)
        for name, (attribute, *_) in _VARIABLES.items():
            value = getattr(reading, attribute)
            self._variables[name].post(self._value(name, value, reading.unix_time_s, alarm))

    def close(self) -> None:
        """End the server."""
        self.server.stop()

    def _value(self, name: str, value: float, time_s: float, alarm: tuple[int, str]) -> Any:
        _, units, digits, description = _VARIABLES[name]
        wrapped = self._kind.wrap(value, timestamp=time_s)
        severity, message = alarm
        wrapped["alarm"] = {
            "severity": severity,
            "status": _DEVICE if severity else 0,
            "message": message,
        }
        wrapped["display.units"] = units
        wrapped["display.description"] = description
        wrapped["display.precision"] = digits
        return wrapped
