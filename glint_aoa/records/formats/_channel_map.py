"""Channels from what a file says of them and what the channel map of the setup says.

The setup completes a record and never overrules it: where both speak and differ, that is an error.
"""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel, LazySamples
from glint_aoa.setup import Inertial, InertialChannel
from glint_aoa.units import convert

__all__ = [
    "CHANNEL_KEYS",
    "EAGER_BYTES",
    "Recorded",
    "channel_map",
    "check_present",
    "known_unit",
    "mapped_channel",
    "mapped_record",
    "split_unit",
    "stated_rate_and_start",
]

CHANNEL_KEYS = ("quantity", "units", "scale", "station_m", "axis", "range")
"""What record and setup may both say of a channel."""

EAGER_BYTES = 1 << 26
"""Records whose samples take no more than this are read at once; longer ones stay in their file."""

_SINGLE_PRECISION = 1e-6  # relative; attributes are often stored as float32
_UNIT_AT_END = re.compile(r"^(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*$")
_SPELLINGS = {
    # An acquisition channel in "g" counts in gravity; pint would read gram.
    "g": "g_0", "gn": "g_0", "g's": "g_0", "gee": "g_0",
    "m/s2": "m/s^2", "m/s²": "m/s^2", "m/s/s": "m/s^2", "m/sec^2": "m/s^2",
    "°": "deg", "degs": "deg", "volts": "V", "volt": "V",
    "°c": "degC", "deg c": "degC", "°f": "degF", "deg f": "degF",
    "in-lb": "lbf*in", "in-lbs": "lbf*in", "in-lbf": "lbf*in", "in lbf": "lbf*in",
    "lb-in": "lbf*in", "lbf-in": "lbf*in", "lb": "lbf", "lbs": "lbf",
    "nm": "N*m", "n-m": "N*m", "n m": "N*m",
    "sec": "s", "secs": "s", "msec": "ms",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Recorded:
    """One channel as its file has it.

    Attributes
    ----------
    name : str
        As in the file.
    samples : ndarray [sample] or LazySamples
        As recorded.
    rate_hz : float
        Samples a second [Hz].
    start_s : float
        Time of sample 0 after the trigger [s].
    unit : str or None
        Unit of the recorded value as the file spells it; the setup's scale may turn it into
        another.
    keys : mapping
        What else the file says, by `CHANNEL_KEYS`.
    """

    name: str
    samples: NDArray[Any] | LazySamples
    rate_hz: float
    start_s: float = 0.0
    unit: str | None = None
    keys: Mapping[str, Any] = field(default_factory=dict)


def mapped_record(
    path: Path,
    recorded: Iterable[Recorded],
    inertial: Inertial | None,
    meta: Mapping[str, object] | None = None,
) -> AcquisitionRecord:
    """Make a record of a file's channels, completed by the setup.

    Raises
    ------
    RecordingError
        If there is no channel, a name occurs twice, a channel of the setup is not there, or
        record and setup contradict each other.
    """
    recorded = list(recorded)
    names = [each.name for each in recorded]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(
            f"{path}: two channels are called {twice}; give each a name of its own"
        )
    if not names:
        raise RecordingError(f"{path}: no channels; check that they were recorded")
    said = channel_map(inertial)
    check_present(path, names, list(said))
    channels = {each.name: mapped_channel(path, each, said.get(each.name)) for each in recorded}
    return AcquisitionRecord(path.stem, channels, meta or {})


def channel_map(inertial: Inertial | None) -> dict[str, InertialChannel]:
    """Return the channels of the setup by name."""
    return {channel.name: channel for channel in (inertial.channel if inertial else ())}


def check_present(path: Path, present: list[str], wanted: list[str]) -> None:
    """Refuse a setup that names a channel which the record does not have."""
    missing = next((name for name in wanted if name not in present), None)
    if missing is None:
        return
    near = difflib.get_close_matches(missing, present, n=1)
    raise RecordingError(
        f"{path}: channel {missing} of the setup is not in the record; "
        + (f"did you mean {near[0]}? " if near else "")
        + f"channels here: {', '.join(present) or 'none'}"
    )


def mapped_channel(path: Path, recorded: Recorded, said: InertialChannel | None) -> Channel:
    """Make a channel of what the file and the setup say of it.

    Raises
    ------
    RecordingError
        If both speak and differ, or what was recorded is no sampled signal.
    """
    where = f"{path}: channel {recorded.name}"
    keys = dict.fromkeys(CHANNEL_KEYS) | dict(recorded.keys)
    if recorded.unit is not None and not (said and "scale" in said.model_fields_set):
        keys["units"] = known_unit(recorded.unit)
    keys = _merged(where, keys, _said_by_setup(said))
    try:
        return Channel(
            recorded.name,
            recorded.samples,
            recorded.rate_hz,
            recorded.start_s,
            quantity=keys["quantity"],
            units=keys["units"],
            scale=1.0 if keys["scale"] is None else keys["scale"],
            station_m=keys["station_m"],
            axis=keys["axis"],
            limits=keys["range"],
        )
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def stated_rate_and_start(
    path: Path, rate_hz: float | None, start_s: float | None, inertial: Inertial | None
) -> tuple[float, float]:
    """Return rate [Hz] and start [s] of a record without a time axis: the file's or the setup's.

    Raises
    ------
    RecordingError
        If neither says the rate, or they differ.
    """
    said_rate = inertial.rate if inertial else None
    said_start = inertial.start if inertial else None
    for key, unit, found, said in (
        ("rate", "Hz", rate_hz, said_rate),
        ("start", "s", start_s, said_start),
    ):
        if found is not None and said is not None and not math.isclose(found, said, rel_tol=1e-6):
            raise RecordingError(
                f"{path}: {key} is {found:g} {unit} in the record but {said:g} {unit} in the "
                "setup; correct the setup or leave it out there"
            )
    rate = rate_hz if rate_hz is not None else said_rate
    start = start_s if start_s is not None else said_start
    if rate is None:
        raise RecordingError(
            f"{path}: neither times nor a sampling rate are recorded; "
            "give rate under [inertial] in the setup"
        )
    return rate, 0.0 if start is None else start


def split_unit(text: str) -> tuple[str, str | None]:
    """Split a heading such as ``ay_face [m/s^2]`` into name and unit."""
    found = _UNIT_AT_END.match(text.strip())
    if found is None or not found[1]:
        return text.strip(), None
    return found[1], (found[2] or found[3] or "").strip() or None


def known_unit(unit: str) -> str | None:
    """Return a unit of an acquisition system as pint names it; unchanged where it is not known."""
    plain = unit.strip().strip("[]()")
    if plain.casefold() in {"", "none", "-"}:
        return None
    return _SPELLINGS.get(plain.casefold(), plain)


def _said_by_setup(said: InertialChannel | None) -> dict[str, Any]:
    if said is None:
        return dict.fromkeys(CHANNEL_KEYS)
    return {
        "quantity": said.quantity,
        "units": said.units,
        "scale": said.scale if "scale" in said.model_fields_set else None,
        "station_m": said.station,
        "axis": said.axis,
        "range": said.limits,
    }


def _merged(where: str, recorded: Mapping[str, Any], said: Mapping[str, Any]) -> dict[str, Any]:
    for key in CHANNEL_KEYS:
        both = recorded[key] is not None and said[key] is not None
        if both and not _agree(key, recorded[key], said[key]):
            raise RecordingError(
                f"{where}: {key} is {recorded[key]} in the record but {said[key]} in the setup; "
                "correct the setup or leave it out there"
            )
    return {key: said[key] if recorded[key] is None else recorded[key] for key in CHANNEL_KEYS}


def _agree(key: str, recorded: Any, said: Any) -> bool:
    if key == "units":
        return _same_unit(recorded, said)
    if isinstance(recorded, str):
        return bool(recorded == said)
    return bool(np.allclose(recorded, said, rtol=_SINGLE_PRECISION, atol=0.0))


def _same_unit(recorded: str, said: str) -> bool:
    """Whether two spellings are one unit, such as ``m/s^2`` and ``m/s**2``."""
    try:
        return recorded == said or math.isclose(convert(recorded, said), 1.0, rel_tol=1e-12)
    except ValueError:
        return False
