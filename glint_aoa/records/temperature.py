"""The tunnel's temperature at a point, where the recording states it."""

import math
from collections.abc import Mapping

import numpy as np

from glint_aoa.errors import RecordingError
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.units import conversion

__all__ = ["is_of_tunnel", "tunnel_temperature"]

_IN_KELVIN, _WITH_UNIT = "tunnel_temperature_K", "tunnel_temperature"


def tunnel_temperature(
    name: str, meta: Mapping[str, object], record: AcquisitionRecord | None = None
) -> float | None:
    """Find the tunnel's temperature.

    Parameters
    ----------
    name : str
        What to call the recording in an error.
    meta : mapping
        What the recording says of its point: ``tunnel_temperature_K``, a number, or
        ``tunnel_temperature``, a text with its unit such as ``"294 K"``.
    record : AcquisitionRecord, optional
        Else the mean of its first channel of quantity temperature whose name holds "tunnel".

    Returns
    -------
    float or None
        The temperature [K]; None where nothing states it.

    Raises
    ------
    RecordingError
        If what is stated is no temperature.
    """
    for key in (_IN_KELVIN, _WITH_UNIT):
        if key in meta:
            return _stated(name, key, meta[key])
    channels = [] if record is None else record.with_quantity("temperature")
    found = next((channel for channel in channels if is_of_tunnel(channel)), None)
    return None if found is None else float(np.nanmean(found.values("K")))


def is_of_tunnel(channel: Channel) -> bool:
    """Whether a channel of quantity temperature is the tunnel's, not the package's."""
    return "tunnel" in channel.name.lower()


def _stated(name: str, key: str, value: object) -> float:
    kelvins = _from_text(value) if key == _WITH_UNIT else _from_number(value)
    if kelvins is None:
        raise RecordingError(
            f"{name}: /meta {key} is {value!r}; give {_IN_KELVIN} as a number, or {_WITH_UNIT} "
            'with its unit such as "294 K"'
        )
    return kelvins


def _from_number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _from_text(value: object) -> float | None:
    number, _, unit = str(value).strip().partition(" ")
    try:
        factor, offset = conversion(unit.strip(), "K")
        return _from_number(float(number) * factor + offset)
    except ValueError:
        return None
