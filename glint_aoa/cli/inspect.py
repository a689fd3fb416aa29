"""``glint-aoa inspect``: what is in a recording."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glint_aoa.cli._common import (
    Json,
    Overwrite,
    bar,
    check_folder,
    check_new_files,
    number,
    print_json,
)
from glint_aoa.errors import InputError

if TYPE_CHECKING:
    from glint_aoa.records.acquisition import Channel

__all__ = ["holds_channels", "holds_fields", "inspect"]

_LEVELS = 16  # bars of the exposure histogram
_WIDTH = 28  # of the labels
_DARK = 0.1  # of white
_TOPS = {(1 << bits) - 1 for bits in range(9, 16)}
_UNEQUAL = 0.2  # of a field period, as for the flag TIMING
_UNITS = {
    "_hz": "Hz",
    "_s": "s",
    "_deg": "deg",
    "_K": "K",
    "_in_lb": "in lbf",
}


def inspect(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="POINT",
            help="Recording of fields (a file, or a folder of pictures), or acquisition record.",
            show_default=False,
        ),
    ],
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            "-s",
            metavar="FILE",
            help="Setup file, if there is one; without, the angle is that of the image plane.",
        ),
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Picture to write: the middle field, its line over it."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Say what a recording holds, and where its glint is.

    Shape, timing, scan, exposure, acquisition channels, what was measured of the middle field, and
    what is suspicious. Reads HDF5 points, AVI, MKV, MP4, Phantom .cine, Photron .mraw, TIFF,
    folders of PNG, .npy, .npz and raw dumps; <FILE>.toml beside one tells what it does not say
    itself. Of an acquisition record (TDMS, UFF, MATLAB, CSV, HDF5), its channels. Of a modal survey
    (UFF with mode shapes or frequency responses), effective radii and the modes for the setup.

    \b
    Example: glint-aoa inspect point-01.h5 --setup glint-aoa.toml --png point-01.png
    """
    from glint_aoa.cli.inspect_survey import inspect_survey
    from glint_aoa.records.formats.modal_survey import is_survey
    from glint_aoa.setup import Setup, load_setup

    settings = Setup() if setup is None else load_setup(setup)
    if png is not None:
        check_folder(png.parent)
        check_new_files([png], overwrite=overwrite)
    if is_survey(recording):
        inspect_survey(recording, settings.inertial, as_json=as_json)
        return
    found: dict[str, Any] = {"file": recording}
    if holds_fields(recording):
        found |= _fields(recording, settings, png, overwrite)
    elif png is not None:
        raise InputError(f"{recording}: no fields to show; leave out --png")
    found["channels"] = _channels(recording, settings.inertial)
    if as_json:
        print_json(found)
        return
    histogram = found.pop("histogram", None)
    found["channels"] = [_channel_line(each) for each in found["channels"]]
    for key, value in found.items():
        if value not in (None, [], ""):
            typer.echo(f"{_label(key):{_WIDTH}}{_words(value)}")
    if histogram is not None:
        typer.echo(f"{'histogram':{_WIDTH}}{_bars(histogram)}  (grey levels 0 to white, log scale)")


def holds_fields(recording: Path) -> bool:
    """Whether to open a file as a recording of fields rather than an acquisition record only."""
    from glint_aoa.records.formats import ACQUISITION_SUFFIXES
    from glint_aoa.records.formats.hdf5 import has_acquisition, has_fields

    suffix = recording.suffix.lower()
    if suffix in {".h5", ".hdf5"}:
        return has_fields(recording) or not has_acquisition(recording)
    return suffix not in ACQUISITION_SUFFIXES


def holds_channels(recording: Path) -> bool:
    """Whether a file holds acquisition channels."""
    from glint_aoa.records.formats import ACQUISITION_SUFFIXES
    from glint_aoa.records.formats.hdf5 import has_acquisition

    suffix = recording.suffix.lower()
    is_point = suffix in {".h5", ".hdf5"}
    return suffix in ACQUISITION_SUFFIXES and not (is_point and not has_acquisition(recording))


def _fields(recording: Path, settings: Any, png: Path | None, overwrite: bool) -> dict[str, Any]:
    from glint_aoa.records.formats import open_fields

    stack = open_fields(recording, settings.fields)
    sample = _sample(stack)
    return {
        **_shape(stack),
        **_exposure(stack, sample),
        **_glint(stack, settings, png, overwrite),
        "suspicious": list(_suspicious(stack, sample)),
    }


def _shape(stack: Any) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "format": "folder" if stack.path.is_dir() else stack.path.suffix.lstrip(".").lower(),
        "fields": stack.n_fields,
        "columns": stack.n_columns,
        "lines": stack.n_lines,
        "data_type": str(stack.dtype),
        "white_level": stack.white_level,
        **asdict(stack.info),
        "timestamps": stack.times_s is not None,
        "notes": list(stack.notes),
        **{key: value for key, value in stack.meta.items() if key != "versions"},
    }


def _sample(stack: Any) -> Any:
    import numpy as np

    step = max(1, stack.n_fields // 8)
    return np.concatenate([stack.read(k, k + 1) for k in range(0, stack.n_fields, step)])


def _exposure(stack: Any, sample: Any) -> dict[str, Any]:
    import numpy as np

    count, _ = np.histogram(sample, bins=_LEVELS, range=(0, stack.white_level + 1))
    return {
        "darkest_level": int(sample.min()),
        "median_level": float(np.median(sample)),
        "brightest_level": int(sample.max()),
        "clipped_share": float((sample >= stack.white_level).mean()),
        "histogram": (count / count.sum()).tolist(),
    }


def _suspicious(stack: Any, sample: Any) -> Iterator[str]:
    """Say what of levels and times may spoil a measurement; the flags say what did."""
    import numpy as np

    brightest, white = int(sample.max()), stack.white_level
    clipped = float((sample >= white).mean())
    if clipped:
        yield f"{clipped:.2%} of the pixels looked at are clipped at {white}"
    has_fewer_bits = brightest < white and brightest in _TOPS and stack.dtype == np.uint16
    if brightest < _DARK * white and not has_fewer_bits:
        yield f"very dark: the brightest level is {brightest} of {white}"
    if int(np.ptp(sample)) == 0:
        yield f"all pixels looked at are {brightest}"
    used = int(np.bitwise_or.reduce(sample, axis=None))
    spare = (used & -used).bit_length() - 1
    if spare > 0 and stack.dtype == np.uint16:
        yield f"levels are multiples of {1 << spare}: stored in the upper {16 - spare} of 16 bits"
    if has_fewer_bits:
        yield (
            f"the brightest level is {brightest}, the top of {brightest.bit_length()} bits: if the "
            f"camera has as many, tell white_level = {brightest}"
        )
    if stack.times_s is not None and stack.n_fields > 1:
        yield from _unequal(np.diff(stack.times_s))


def _unequal(steps: Any) -> Iterator[str]:
    import numpy as np

    usual = float(np.median(steps))
    odd = np.abs(steps - usual) > _UNEQUAL * abs(usual)
    if odd.any():
        yield (
            f"{int(odd.sum())} fields do not follow the one before after {1e3 * usual:.4g} ms, the "
            f"first is {int(np.argmax(odd)) + 1}, after {1e3 * steps[odd][0]:.4g} ms"
        )


def _glint(stack: Any, settings: Any, png: Path | None, overwrite: bool) -> dict[str, Any]:
    """Measure the middle field with what is known; without a field rate, as if it were 1 Hz."""
    import numpy as np

    from glint_aoa.flags import describe
    from glint_aoa.process import measure_point
    from glint_aoa.report.figures import measured_field, save_figure

    if stack.info.rate_hz is None and settings.fields.rate is None:
        fields = settings.fields.model_copy(update={"rate": 1.0})
        settings = settings.model_copy(update={"fields": fields})
    with bar(stack.n_fields) as advance:
        result = measure_point(stack, settings, progress=advance)
    middle = stack.n_fields // 2
    rows = result.measurement.centres(stack.read(middle, middle + 1)).row[0]
    there = np.isfinite(rows)
    if png is not None:
        save_figure(measured_field(stack, result, middle), png, overwrite=overwrite)
    return {
        "measured_field": middle,
        "glint_found": bool(there.any()),
        "glint_rows": [float(rows[there].min()), float(rows[there].max())] if there.any() else None,
        "glint_half_width": result.measurement.shape.half_width if there.any() else None,
        "angle_deg": float(result.values["angle_deg"][middle]),
        "angle_std_deg": float(result.values["angle_std_deg"][middle]),
        "flags": [_counted(words, result) for words in describe(result.flags)],
        "picture": png,
    }


def _counted(words: str, result: Any) -> str:
    """Add to a flag's words at how many fields it is, where it is not at all of them."""
    import numpy as np

    from glint_aoa.flags import Flag

    masks = result.values["flags"]
    there = (masks & int(Flag[words.partition(":")[0]])) != 0
    if not there.any() or there.all():
        return words
    return f"{words} ({int(there.sum())} of {there.size} fields, first {int(np.argmax(there))})"


def _channels(recording: Path, inertial: Any) -> list[dict[str, Any]]:
    """Say of each acquisition channel what it is and what is wrong with its samples."""
    from glint_aoa.records.formats import open_acquisition

    if not holds_channels(recording):
        return []
    record = open_acquisition(recording, inertial)
    return [_channel(channel) for channel in record.channels.values()]


def _channel(channel: "Channel") -> dict[str, Any]:
    from glint_aoa.records.conditioning import missing_stretches

    gaps = list(missing_stretches(channel))
    return {
        "name": channel.name,
        "quantity": channel.quantity,
        "units": channel.units,
        "samples": len(channel),
        "rate_hz": channel.rate_hz,
        "start_s": channel.start_s,
        "station_m": channel.station_m,
        "axis": channel.axis,
        "range": channel.limits,
        "clipped": sum(int(block.clipped.sum()) for _, block in channel.blocks()),
        "missing": sum(end - first for first, end in gaps),
        "longest_gap_s": max((end - first for first, end in gaps), default=0) / channel.rate_hz,
    }


def _channel_line(found: dict[str, Any]) -> str:
    line = (
        f"{found['name']} [{found['units'] or '?'}] {found['samples']} at {found['rate_hz']:g} Hz"
    )
    if found["start_s"]:
        line += f" from {found['start_s']:g} s"
    if found["clipped"]:
        line += f", {found['clipped']} clipped"
    if found["missing"]:
        line += f", {found['missing']} missing (up to {found['longest_gap_s']:.3g} s on end)"
    return line


def _label(key: str) -> str:
    """Turn a key into words, the unit at its end into brackets."""
    for ending, unit in _UNITS.items():
        if key.endswith(ending):
            return f"{key.removesuffix(ending).replace('_', ' ')} [{unit}]"
    return key.replace("_", " ")


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value, ".6g")
    if isinstance(value, list) and all(isinstance(each, float) for each in value):
        return " to ".join(_words(each) for each in value)
    if isinstance(value, list):
        separator = f"\n{'':{_WIDTH}}"
        return separator.join(_words(each) for each in value)
    return str(value)


def _bars(shares: list[float]) -> str:
    import math

    steps = " ▁▂▃▄▅▆▇█"
    least = 1e-5
    heights = [max(0.0, 1 + math.log10(max(s, least)) / 5) * (len(steps) - 1) for s in shares]
    return "".join(steps[math.ceil(height)] for height in heights)
