"""Modal surveys: mode shapes of the fuselage from a record or from a universal file.

From a record the analyser's frequency responses are taken first; a universal file holds either
ready shapes (data set 55) or responses (data set 58).
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.analyser import FrequencyResponses, frequency_responses
from glint_aoa.inertial.identification import SurveyResponses, mode_shapes, real_shape
from glint_aoa.inertial.modes import AXIS_OF_PLANE, PLANES, ModeShape, Plane
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.formats.modal_survey import (
    MeasuredResponse,
    MeasuredShape,
    SurveyFile,
    read_survey_file,
)

__all__ = ["read_survey", "survey_record", "survey_responses"]

_Floats = NDArray[np.float64]

_ROW: dict[Plane, int] = {"yaw": 1, "pitch": 2}  # of a vector in model axes
_SEGMENT_S = 32.0  # bins of a tenth of the first resonances' width: shorter ones bias the shapes
_SEGMENTS = 3.0  # to a record, at least


def survey_responses(responses: FrequencyResponses, plane: Plane) -> SurveyResponses:
    """Take the accelerometers of one plane out of the analyser's frequency responses.

    Parameters
    ----------
    responses : FrequencyResponses
        To a force or moment; channels without a station or of another axis are passed over.
    plane : {"yaw", "pitch"}
        Plane of the survey.

    Returns
    -------
    SurveyResponses
        Accelerances, of channels along -y or -z turned round.

    Raises
    ------
    InputError
        If fewer than two accelerometers of the plane are among them.
    """
    letter = AXIS_OF_PLANE[plane]
    chosen = [
        (index, channel)
        for index, channel in enumerate(responses.channels)
        if channel.quantity == "acceleration"
        and channel.station_m is not None
        and channel.axis in (f"+{letter}", f"-{letter}")
    ]
    if len(chosen) < 2:
        raise InputError(
            f"a survey in {plane} takes accelerometers along model {letter} at two stations or "
            f"more, but {len(chosen)} was given; name more channels, with station and axis"
        )
    sign = np.array([1.0 if channel.axis == f"+{letter}" else -1.0 for _, channel in chosen])
    return SurveyResponses(
        plane=plane,
        frequency_hz=responses.frequency_hz,
        response=sign[:, None] * responses.response[[index for index, _ in chosen]],
        station_m=np.array([channel.station_m for _, channel in chosen], np.float64),
    )


def survey_record(
    record: AcquisitionRecord,
    reference: str,
    plane: Plane,
    *,
    near_hz: Sequence[float] | None = None,
    low_hz: float = 5.0,
    high_hz: float = 60.0,
    segment_s: float = _SEGMENT_S,
) -> list[ModeShape]:
    """Identify the modes of one plane from a record of a sine sweep or random excitation.

    Parameters
    ----------
    record : AcquisitionRecord
        With the shaker's force and accelerometers of the plane at two stations or more.
    reference : str
        Channel of the force.
    plane : {"yaw", "pitch"}
        Plane of the survey.
    near_hz, low_hz, high_hz
        As for `mode_shapes`.
    segment_s : float
        Longest segment of the averaged spectra [s]; a third of the record if that is shorter.

    Returns
    -------
    list of ModeShape
        By rising frequency, numbered from 1.

    Raises
    ------
    InputError, RecordingError
        As for `frequency_responses`, `survey_responses` and `mode_shapes`.

    Notes
    -----
    Windows bend sharp resonances, the more so the shorter the segments. The modes are therefore
    identified a second time from segments half as long, and by how much each figure differs is
    added to its standard deviation. In simulated surveys of Table 1 (64 s, random) radii came out
    within 0.05 in of the truth.
    """
    names = [each.name for each in _accelerometers(record, plane)]
    if not names:
        raise InputError(
            f"{record.name}: no accelerometer along model {AXIS_OF_PLANE[plane]} with a station; "
            "name them under [[inertial.channel]] in the setup"
        )
    length = min(segment_s, len(record[names[0]]) / record[names[0]].rate_hz / _SEGMENTS)

    def identified(length_s: float, near: Sequence[float] | None) -> list[ModeShape]:
        responses = frequency_responses(record, reference, names, segment_s=length_s)
        chosen = survey_responses(responses, plane)
        return mode_shapes(chosen, near_hz=near, low_hz=low_hz, high_hz=high_hz)

    shapes = identified(length, near_hz)
    coarse = identified(length / 2, [shape.frequency_hz for shape in shapes])
    return [_widened(shape, other) for shape, other in zip(shapes, coarse, strict=True)]


def read_survey(
    path: str | Path,
    *,
    forward: str = "+x",
    up: str = "+z",
    origin_m: float = 0.0,
    nodes: Collection[int] | None = None,
    low_hz: float = 5.0,
    high_hz: float = 60.0,
) -> list[ModeShape]:
    """Read the mode shapes of the fuselage from a universal file.

    Parameters
    ----------
    path : str or Path
        Data sets 15 or 2411 (nodes) with 55 (shapes) or, if there are none, 58 (responses).
    forward, up : str
        The file's axes that point to the nose and up, such as ``"+x"`` or ``"-z"``.
    origin_m : float
        Station of the file's origin, model x [m].
    nodes : collection of int, optional
        Labels of the fuselage's nodes; all if not given. Leave out wings, sting and balance.
    low_hz, high_hz : float
        Band in which modes are identified from responses, or taken from the shapes [Hz].

    Returns
    -------
    list of ModeShape
        By rising frequency; numbers are the file's for shapes, from 1 on for responses. Each mode
        is of the plane in which the fuselage moves more.

    Raises
    ------
    InputError
        If the axes are none, or no mode lies in the band.
    RecordingError
        As for `read_survey_file`, or if a node has no position.

    Notes
    -----
    Points with a coefficient of exactly zero were not measured and are left out. With responses
    to several forces, those to the one with the most are used.
    """
    survey = read_survey_file(path)
    axes = _model_axes(forward, up)
    used = set(survey.nodes) if nodes is None else set(nodes)
    if survey.shapes:
        inside = [each for each in survey.shapes if low_hz <= each.frequency_hz <= high_hz]
        shapes = [_from_shape(survey, each, axes, origin_m, used) for each in inside]
    else:
        chosen = (_plane_responses(survey, plane, axes, origin_m, used) for plane in PLANES)
        found = [
            shape
            for each in chosen
            if each is not None
            for shape in mode_shapes(each, low_hz=low_hz, high_hz=high_hz)
        ]
        found.sort(key=lambda shape: shape.frequency_hz)
        shapes = [replace(shape, number=number) for number, shape in enumerate(found, 1)]
    if not shapes:
        raise InputError(f"{path}: no mode between {low_hz:g} and {high_hz:g} Hz; widen the band")
    return sorted(shapes, key=lambda shape: shape.frequency_hz)


def _accelerometers(record: AcquisitionRecord, plane: Plane) -> list[Channel]:
    """Take one accelerometer of the plane at each station, the first in record order."""
    letter = AXIS_OF_PLANE[plane]
    found: dict[float, Channel] = {}
    for channel in record.with_quantity("acceleration"):
        if channel.station_m is not None and channel.axis in (f"+{letter}", f"-{letter}"):
            found.setdefault(channel.station_m, channel)
    return list(found.values())


def _widened(shape: ModeShape, coarse: ModeShape) -> ModeShape:
    """Add to the standard deviations by how much shorter segments change the figures."""
    scale = shape.coefficient @ coarse.coefficient / (coarse.coefficient @ coarse.coefficient)
    change = np.abs(scale * coarse.coefficient - shape.coefficient)
    noise = np.zeros(1) if shape.coefficient_std is None else shape.coefficient_std
    return replace(
        shape,
        coefficient_std=np.hypot(noise, np.sqrt(np.mean(change**2))),
        frequency_std_hz=float(
            np.hypot(shape.frequency_std_hz, shape.frequency_hz - coarse.frequency_hz)
        ),
    )


def _model_axes(forward: str, up: str) -> _Floats:
    """Rows: model x, y, z in the file's axes."""
    x, z = _direction("forward", forward), _direction("up", up)
    if x @ z != 0:
        raise InputError(f"forward {forward} and up {up} lie along one axis; give two axes")
    return np.array([x, np.cross(z, x), z])


def _direction(name: str, text: str) -> _Floats:
    if text not in (f"{sign}{letter}" for sign in "+-" for letter in "xyz"):
        raise InputError(f"{name} is {text!r}; choose one of +x, -x, +y, -y, +z, -z")
    return np.asarray((1.0 if text[0] == "+" else -1.0) * np.eye(3)["xyz".index(text[1])])


def _station(survey: SurveyFile, node: int, axes: _Floats, origin_m: float) -> float:
    if node not in survey.nodes:
        raise RecordingError(
            f"{survey.path}: node {node} has no position; export the survey with its geometry"
        )
    return origin_m + float(axes[0] @ survey.nodes[node])


def _from_shape(
    survey: SurveyFile, each: MeasuredShape, axes: _Floats, origin_m: float, used: set[int]
) -> ModeShape:
    keep = np.isin(each.node, list(used))
    model = axes @ each.coefficient[keep].T
    plane = max(PLANES, key=lambda one: float(np.sum(np.abs(model[_ROW[one]]) ** 2)))
    row = model[_ROW[plane]]
    measured = row != 0
    if not measured.any():
        raise InputError(
            f"{survey.path}: mode {each.number} does not move the nodes chosen; give the labels of "
            "the fuselage's nodes"
        )
    coefficient, collinearity = real_shape(row[measured])
    labels = each.node[keep][measured]
    return ModeShape(
        number=each.number,
        plane=plane,
        frequency_hz=each.frequency_hz,
        station_m=np.array([_station(survey, int(n), axes, origin_m) for n in labels]),
        coefficient=coefficient,
        damping=each.damping,
        collinearity=collinearity,
    )


def _plane_responses(
    survey: SurveyFile, plane: Plane, axes: _Floats, origin_m: float, used: set[int]
) -> SurveyResponses | None:
    """Gather the responses along one model axis; None if fewer than two stations have one."""

    def along(each: MeasuredResponse) -> float:
        return float(axes[_ROW[plane], abs(each.direction) - 1] * np.sign(each.direction))

    chosen = [each for each in survey.responses if each.node in used and along(each) != 0]
    references = [each.reference for each in chosen]
    chosen = [each for each in chosen if each.reference == max(references, key=references.count)]
    if len({each.node for each in chosen}) < 2:
        return None
    first = chosen[0]
    if any(
        each.form != first.form or not np.array_equal(each.frequency_hz, first.frequency_hz)
        for each in chosen
    ):
        raise RecordingError(
            f"{survey.path}: its responses differ in kind or in frequencies; export them alike"
        )
    return SurveyResponses(
        plane=plane,
        frequency_hz=first.frequency_hz,
        response=np.array([along(each) * each.response for each in chosen]),
        station_m=np.array([_station(survey, each.node, axes, origin_m) for each in chosen]),
        form=first.form,
    )
