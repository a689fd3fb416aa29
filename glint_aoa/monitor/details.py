"""What the page shows of one point: its row of the log, and what is drawn of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.signal
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from glint_aoa.coverage import coverage_factor
from glint_aoa.errors import InputError, OutputError
from glint_aoa.inertial.correct import correct
from glint_aoa.inertial.static import static_angle
from glint_aoa.optical.drawn_line import drawn_line
from glint_aoa.optical.measure import fit_fields
from glint_aoa.optical.prepare import prepare
from glint_aoa.process import point_identity, process_point
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.angles import result_files
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import channels_beside, open_acquisition, open_fields
from glint_aoa.records.recording import resolve_recording
from glint_aoa.records.tables import read_csv
from glint_aoa.resume import finished_points
from glint_aoa.setup import Setup

__all__ = ["Onboard", "Picture", "PointDetails", "Spectrum", "point_details", "point_row"]

_Floats = NDArray[np.float64]

HIGHEST_HZ = 100.0
"""Spectra are shown up to here [Hz]: models on stings vibrate below."""

_SEGMENT_S = 4.0  # of the averaged periodogram
_LONGEST_S = 120.0  # of a record, its end, that goes into spectra
_MOST_PIXELS = 300_000  # of a picture; larger fields are thinned out


@dataclass(frozen=True, eq=False)
class Picture:
    """A field with its measured line.

    Attributes
    ----------
    number : int
        Number of the field in its stack.
    levels : ndarray [line, column]
        Grey levels, 0 to 255; of a large field every n-th line and column.
    shape : (int, int)
        Lines and columns of the field itself.
    line_row : ndarray [column]
        Row of the line at each column of the field; NaN without a line.
    pixel_aspect : float
        Pitch of a field line over that of a column.
    """

    number: int
    levels: NDArray[np.uint8]
    shape: tuple[int, int]
    line_row: _Floats
    pixel_aspect: float


@dataclass(frozen=True, eq=False)
class Onboard:
    """What the inertial sensor says during the point; angles in degrees.

    Attributes
    ----------
    time_s, raw_deg, corrected_deg : ndarray [row]
        After the trigger; empty if the record allows no correction.
    raw_mean_deg, corrected_mean_deg, corrected_std_deg : float
        Means where the low-pass has settled, and the correction's own 1-sigma uncertainty; NaN
        without a correction.
    why : str
        How it was corrected, or why it was not.
    """

    time_s: _Floats
    raw_deg: _Floats
    corrected_deg: _Floats
    raw_mean_deg: float
    corrected_mean_deg: float
    corrected_std_deg: float
    why: str


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Root of the power spectral density of one channel.

    Attributes
    ----------
    channel, quantity, units : str
        Its name, "moment" or "acceleration", and the unit of its samples.
    frequency_hz, density : ndarray [bin]
        Frequency [Hz] and density [units/Hz^0.5].
    """

    channel: str
    quantity: str
    units: str
    frequency_hz: _Floats
    density: _Floats


@dataclass(frozen=True, eq=False)
class PointDetails:
    """What is drawn of a measured point.

    Attributes
    ----------
    time_s, angle_deg, u95_deg : ndarray [field]
        Middle of the exposure after the trigger, angle, and half its 95 % interval from the
        field's own noise.
    flags : ndarray of int [field]
        Bit masks.
    picture : Picture or None
        The newest field; None if it could not be had.
    onboard : Onboard or None
        None without channels.
    spectra : tuple of Spectrum
        Of moments, then of accelerations.
    notes : tuple of str
        Why something is missing, one sentence each.
    """

    time_s: _Floats
    angle_deg: _Floats
    u95_deg: _Floats
    flags: NDArray[np.int64]
    picture: Picture | None
    onboard: Onboard | None
    spectra: tuple[Spectrum, ...]
    notes: tuple[str, ...]


def point_row(path: Path, setup: Setup, results: Path, *, again: bool = False) -> dict[str, str]:
    """Return a point's row of the log; measure the point first if it has no results yet.

    Parameters
    ----------
    path : Path
        The recording.
    setup : Setup
        The setup.
    results : Path
        Folder of the results.
    again : bool, optional
        Whether to measure the point even if it has results: its recording has changed.

    Returns
    -------
    dict of str to str
        Cells by the columns of ``log.csv``.

    Raises
    ------
    InputError
        If the point cannot be measured, or was measured with another setup.
    """
    if again or not _is_finished(path, setup, results):
        process_point(path, setup, results, overwrite=True)
    said = point_identity(open_fields(path, setup.fields))
    key = {name: " ".join(str(value).splitlines()) for name, value in said.items()}
    key["setup_hash"] = setup.hash
    log = read_csv(results / "log.csv")
    rows = [
        dict(zip(log, cells, strict=True))
        for cells in zip(*log.values(), strict=True)
        if all(cells[list(log).index(name)] == value for name, value in key.items())
    ]
    return rows[-1]


def _is_finished(path: Path, setup: Setup, results: Path) -> bool:
    try:
        return bool(finished_points([path], setup, results))
    except OutputError:
        raise OutputError(
            f"{results}: {path.stem} has results of another setup there; "
            "start the monitor with another --results, or move them away"
        ) from None


def point_details(path: Path, setup: Setup, results: Path) -> PointDetails:
    """Gather what is drawn of a point that has been measured.

    Parameters
    ----------
    path, setup, results
        As for `point_row`.

    Returns
    -------
    PointDetails
        What cannot be had is left out and named in its notes.

    Raises
    ------
    InputError
        If the results cannot be read.
    """
    table = read_csv(result_files(results, path.stem)[0])
    columns = {
        name: np.array([float(cell or "nan") for cell in table[name]])
        for name in ("time_s", "angle_deg", "angle_std_deg", "flags")
    }
    notes: list[str] = []
    picture = onboard = None
    spectra: tuple[Spectrum, ...] = ()
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            picture = _newest_field(open_fields(path, setup.fields), setup)
        except InputError as error:
            notes.append(str(error))
        try:
            record = _channels(path, setup)
            if record is not None:
                spectra = _spectra(record)
                onboard = _onboard(record, setup)
        except InputError as error:
            notes.append(str(error))
    return PointDetails(
        time_s=columns["time_s"],
        angle_deg=columns["angle_deg"],
        u95_deg=coverage_factor() * columns["angle_std_deg"],
        flags=columns["flags"].astype(np.int64),
        picture=picture,
        onboard=onboard,
        spectra=spectra,
        notes=tuple(notes),
    )


def _newest_field(stack: FieldStack, setup: Setup) -> Picture:
    """Measure the last field alone, with what a sample of the stack teaches."""
    how = prepare(stack, setup, resolve_recording(stack, setup))
    number = stack.n_fields - 1
    field = stack.read(number, number + 1)
    _, fit = fit_fields(field, np.array([number]), how)
    lines, columns = stack.n_lines, stack.n_columns
    pitch = how.to_plane.pixel_pitch
    return Picture(
        number=number,
        levels=grey_picture(field[0], stack.white_level),
        shape=(lines, columns),
        line_row=drawn_line(fit, number, how, (lines, columns)),
        pixel_aspect=pitch[1] / pitch[0],
    )


def grey_picture(field: NDArray[np.integer], white: int) -> NDArray[np.uint8]:
    """Return grey levels [line, column] as 0 to 255, thinned out where there are very many."""
    step = int(np.ceil(np.sqrt(field.size / _MOST_PIXELS)))
    levels: NDArray[np.uint8] = np.clip(field[::step, ::step] * (255 / white), 0, 255).astype(
        np.uint8
    )
    return levels


def _channels(path: Path, setup: Setup) -> AcquisitionRecord | None:
    beside = channels_beside(path)
    return None if beside is None else prepared(open_acquisition(beside, setup.inertial))


def _onboard(record: AcquisitionRecord, setup: Setup) -> Onboard | None:
    """Angle of the package, corrected where the record allows it; None without its output."""
    if not (record.with_quantity("aoa_unfiltered") or record.with_quantity("aoa_filtered")):
        return None
    none = np.empty(0)
    try:
        rows = correct(record, setup.inertial)
    except InputError as error:
        raw, _ = static_angle(record, setup.inertial)
        return Onboard(none, none, none, raw, np.nan, np.nan, f"not corrected: {error}")
    settled = rows.settled
    return Onboard(
        time_s=rows.time_s,
        raw_deg=rows.raw_angle_deg,
        corrected_deg=rows.angle_deg,
        raw_mean_deg=float(rows.raw_angle_deg[settled].mean()),
        corrected_mean_deg=float(rows.angle_deg[settled].mean()),
        corrected_std_deg=float(rows.angle_std_deg[settled].mean()),
        why=f"{rows.method}: {rows.why}",
    )


def _spectra(record: AcquisitionRecord) -> tuple[Spectrum, ...]:
    """Spectra of one channel for each place and axis: of moments, then of accelerations."""
    chosen: dict[object, Channel] = {}
    for quantity in ("moment", "acceleration"):
        for channel in record.with_quantity(quantity):
            if channel.units is not None:
                place = (quantity, channel.axis, channel.station_m)
                chosen.setdefault(channel if channel.axis is None else place, channel)
    return tuple(_spectrum(channel) for channel in chosen.values())


def _spectrum(channel: Channel) -> Spectrum:
    size, rate = len(channel), channel.rate_hz
    end = channel.cut(max(0, size - round(_LONGEST_S * rate)), size)
    units = str(channel.units)
    signal = end.values(units)
    segment = min(signal.size, round(_SEGMENT_S * rate))
    frequency, power = scipy.signal.welch(signal, rate, nperseg=segment)
    shown = (frequency > 0) & (frequency <= HIGHEST_HZ)
    return Spectrum(
        channel.name, str(channel.quantity), units, frequency[shown], np.sqrt(power[shown])
    )
