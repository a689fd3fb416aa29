"""Modal surveys in universal files: nodes, mode shapes and frequency responses, as they stand.

Data sets 15 and 2411 (nodes), 55 (shapes), 58 and 58b (responses) and 164 (units), by `pyuff`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glint_aoa.errors import RecordingError

__all__ = ["MeasuredResponse", "MeasuredShape", "SurveyFile", "is_survey", "read_survey_file"]

_Floats = NDArray[np.float64]
_Complex = NDArray[np.complex128]
Form = Literal["accelerance", "mobility", "receptance"]

_SUFFIXES = {".uff", ".unv", ".uf", ".ufb"}
_NODES = (15, 2411)
_SHAPES, _FUNCTIONS, _UNITS = 55, 58, 164
_NORMAL, _COMPLEX = (2,), (3, 7)  # analysis types of data set 55
_RESPONSE = 4  # function type of data set 58
_FORMS: Mapping[int, Form] = {8: "receptance", 11: "mobility", 12: "accelerance"}


@dataclass(frozen=True, eq=False)
class MeasuredShape:
    """A mode shape as the file holds it (data set 55).

    Attributes
    ----------
    number : int
        Mode number.
    frequency_hz, damping : float
        Natural frequency [Hz] and fraction of critical damping.
    node : ndarray [point]
        Labels of the nodes.
    coefficient : ndarray [point, 3]
        Complex coefficients along the file's X, Y and Z; 0 where nothing was measured.
    """

    number: int
    frequency_hz: float
    damping: float
    node: NDArray[np.int64]
    coefficient: _Complex


@dataclass(frozen=True, eq=False)
class MeasuredResponse:
    """A frequency response as the file holds it (data set 58).

    Attributes
    ----------
    node : int
        Label of the response's node.
    direction : int
        Axis of the response: +-1, +-2, +-3 for the file's X, Y, Z.
    reference : tuple of int
        Node and direction of the force.
    frequency_hz, response : ndarray [bin]
        Frequencies [Hz], evenly spaced, and complex response.
    form : {"accelerance", "mobility", "receptance"}
        What was measured per unit of force.
    """

    node: int
    direction: int
    reference: tuple[int, int]
    frequency_hz: _Floats
    response: _Complex
    form: Form


@dataclass(frozen=True, eq=False)
class SurveyFile:
    """A modal survey.

    Attributes
    ----------
    path : Path
        The file.
    nodes : mapping of int to ndarray [3]
        Positions of the nodes along the file's X, Y, Z [m].
    shapes : tuple of MeasuredShape
        Mode shapes, in the file's order.
    responses : tuple of MeasuredResponse
        Frequency responses, in the file's order.
    """

    path: Path
    nodes: Mapping[int, _Floats]
    shapes: tuple[MeasuredShape, ...]
    responses: tuple[MeasuredResponse, ...]


def is_survey(path: str | Path) -> bool:
    """Tell whether a file is a universal file with mode shapes or frequency responses."""
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return False
    types = _opened(path).get_set_types()
    if np.any(types == _SHAPES):
        return True
    return any(_is_response(each) for each in _sets(path, (_FUNCTIONS,), header_only=True))


def read_survey_file(path: str | Path) -> SurveyFile:
    """Read the nodes, mode shapes and frequency responses of a universal file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    SurveyFile
        Positions in metres; without data set 164 the file is taken to be in SI units.

    Raises
    ------
    RecordingError
        If the file cannot be read, holds neither shapes nor responses or no nodes, or holds
        responses of an unknown kind or of uneven spacing.
    """
    path = Path(path)
    responses = tuple(
        _response(path, each) for each in _sets(path, (_FUNCTIONS,)) if _is_response(each)
    )
    shapes = tuple(
        _shape(each)
        for each in _sets(path, (_SHAPES,))
        if each["analysis_type"] in (*_NORMAL, *_COMPLEX)
    )
    if not shapes and not responses:
        raise RecordingError(
            f"{path}: holds no mode shapes (data set 55) and no frequency responses (data set 58); "
            "export the survey with either"
        )
    nodes = _nodes(path)
    if not nodes:
        raise RecordingError(
            f"{path}: holds no nodes (data set 15 or 2411), so nobody knows where its points are; "
            "export the survey with its geometry"
        )
    return SurveyFile(path, nodes, shapes, responses)


def _opened(path: Path) -> Any:
    import pyuff  # noqa: PLC0415  only surveys and some acquisition records need it

    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        return pyuff.UFF(str(path))
    except Exception as error:
        raise RecordingError(f"{path}: not a universal file that can be read ({error})") from None


def _sets(path: Path, types: tuple[int, ...], *, header_only: bool = False) -> list[dict[str, Any]]:
    opened = _opened(path)
    indices = np.flatnonzero(np.isin(opened.get_set_types(), types))
    try:
        read = [opened.read_sets(int(i), header_only=header_only) for i in indices]
    except Exception as error:
        raise RecordingError(
            f"{path}: a data set {' or '.join(str(each) for each in types)} cannot be read "
            f"({error}); export the file again"
        ) from None
    return [each for each in read if isinstance(each, dict)]


def _nodes(path: Path) -> dict[int, _Floats]:
    units = _sets(path, (_UNITS,))
    per_metre = float(units[0]["length"]) if units else 1.0
    return {
        int(label): np.array(position, np.float64) / per_metre
        for each in _sets(path, _NODES)
        for label, *position in zip(each["node_nums"], each["x"], each["y"], each["z"], strict=True)
    }


def _shape(each: dict[str, Any]) -> MeasuredShape:
    if each["analysis_type"] in _COMPLEX:
        pole = complex(each["eig"])
        frequency, damping = abs(pole) / (2 * np.pi), -pole.real / max(abs(pole), 1e-300)
    else:
        frequency, damping = float(each["freq"]), float(each["modal_damp_vis"])
    return MeasuredShape(
        number=int(each["mode_n"]),
        frequency_hz=frequency,
        damping=damping,
        node=np.asarray(each["node_nums"], np.int64),
        coefficient=np.stack([np.asarray(each[f"r{i}"], np.complex128) for i in (1, 2, 3)], axis=1),
    )


def _is_response(each: dict[str, Any]) -> bool:
    return bool(each["func_type"] == _RESPONSE and 1 <= abs(each["rsp_dir"]) <= 3)


def _response(path: Path, each: dict[str, Any]) -> MeasuredResponse:
    node, direction = int(each["rsp_node"]), int(each["rsp_dir"])
    kind = int(each["ordinate_spec_data_type"])
    if kind not in _FORMS:
        raise RecordingError(
            f"{path}: the frequency response of node {node} measures data type {kind}, expected 8 "
            "(displacement), 11 (velocity) or 12 (acceleration); export it with its type"
        )
    frequency = np.asarray(each["x"], np.float64)
    step = np.diff(frequency)
    if frequency.size < 3 or not np.allclose(step, step[0], rtol=1e-4):
        raise RecordingError(
            f"{path}: the frequency response of node {node} is not evenly spaced; export it on "
            "even frequencies"
        )
    return MeasuredResponse(
        node=node,
        direction=direction,
        reference=(int(each["ref_node"]), int(each["ref_dir"])),
        frequency_hz=frequency,
        response=np.asarray(each["data"], np.complex128),
        form=_FORMS[kind],
    )
