"""Many points together: a sweep to calibrate with, and runs to hold optical against inertial."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calibration.drift.check import Drift, check_drift
from calibration.sweep.fit import PitchSweep, Provenance, fit_sweep_points
from calibration.sweep.point import in_order_of_time
from glint_aoa.at_rest import PointAtRest, measure_at_rest
from glint_aoa.benchmark import BenchmarkPoint, check_runs, moment_peak_to_peak_in_lb
from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.correct import correct
from glint_aoa.inertial.static import static_angle
from glint_aoa.process import load_sweep, measure_point, process_point
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.angles import check_new_results, log_result
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.formats import open_acquisition, open_fields, said_of
from glint_aoa.setup import Setup
from glint_aoa.workers import Workers

__all__ = [
    "announced_point",
    "calibrate_sweep",
    "check_sweep",
    "compare_point",
    "compare_points",
]

_SAME_ANGLE_DEG = 0.1  # a run whose nominal angles differ by more is a sweep


def calibrate_sweep(
    paths: Sequence[str | Path],
    setup: Setup,
    *,
    degree: int | None = None,
    onboard_accuracy_deg: float = 0.0,
    jobs: int = 1,
    progress: Callable[[Path], None] | None = None,
) -> PitchSweep:
    """Calibrate the optical angle against the onboard sensor over the points of a no-flow sweep.

    Parameters
    ----------
    paths : sequence of str or Path
        Recorded points with fields and the package's output, the model at rest; at one tunnel
        temperature or several. Where it shakes all the same, the onboard angle is corrected for
        the bias of vibration, if setup and record have what that takes.
    setup : Setup
        The setup; a sweep that it names is not applied.
    degree : int, optional
        Degree of the polynomials; chosen by information criterion if not given.
    onboard_accuracy_deg : float, optional
        Error that all onboard angles share, 1 sigma [deg].
    jobs : int, optional
        How many processes share the points; the results are the same to the bit.
    progress : callable, optional
        Called with each path once its point is measured.

    Returns
    -------
    PitchSweep
        The calibration.

    Raises
    ------
    CalibrationError
        If a point shows no glint, or the points do not determine the polynomials.
    InputError
        If a recording or the setup cannot be used.
    """
    measured = _measured(paths, setup, jobs, progress)
    points = [each.point for each in measured]
    return fit_sweep_points(
        points,
        degree=degree,
        onboard_accuracy_deg=onboard_accuracy_deg,
        setup=measured[0].setup if measured else None,
        provenance=Provenance(
            files=tuple(Path(path).name for path in paths),
            setup_hash=setup.hash,
            date=in_order_of_time(points)[0].time if points else "",
        ),
    )


def check_sweep(
    paths: Sequence[str | Path],
    sweep: PitchSweep,
    setup: Setup,
    *,
    progress: Callable[[Path], None] | None = None,
) -> Drift:
    """Hold points at rest that were taken later against a pitch sweep.

    Parameters
    ----------
    paths : sequence of str or Path
        Recorded points with fields and the package's output, the model at rest.
    sweep : PitchSweep
        The calibration.
    setup : Setup
        The setup that the sweep was measured with; a sweep that it names is not applied.
    progress : callable, optional
        Called with each path once its point is measured.

    Returns
    -------
    Drift
        Whether anything has moved, and what.

    Raises
    ------
    CalibrationError
        If a point shows no glint, or the setup is another than the sweep's.
    InputError
        If a recording or the setup cannot be used.
    """
    sweep.check_setup(setup)
    points = [each.point for each in _measured(paths, setup, 1, progress)]
    return check_drift(sweep, points, setup)


def _measured(
    paths: Sequence[str | Path],
    setup: Setup,
    jobs: int,
    progress: Callable[[Path], None] | None,
) -> list[PointAtRest]:
    measured = []
    with Workers(jobs) as workers:
        each = workers.map(partial(measure_at_rest, setup=setup), map(Path, paths))
        for path, point in zip(map(Path, paths), each, strict=True):
            measured.append(point)
            if progress is not None:
                progress(path)
    return measured


def compare_points(
    paths: Sequence[str | Path],
    setup: Setup,
    out: str | Path,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    progress: Callable[[Path], None] | None = None,
) -> list[BenchmarkPoint]:
    """Process recorded points and hold their optical angles beside the inertial ones.

    Points of a sweep, a run whose nominal angle changes, are left out, and so are single records,
    whose description says ``run_kind`` record. What can be known to fail is looked for in all
    points before the first one is measured.

    Parameters
    ----------
    paths : sequence of str or Path
        Recorded points with fields, acquisition channels and what the shaker did; those of a
        run in the order in which they were taken.
    setup : Setup
        The setup; the inertial angle is corrected if it lists modes, or if the accelerometers
        show the motion without them.
    out : str or Path
        Folder of the optical results, as for `process_point`.
    jobs : int, optional
        How many processes share the points; the results are the same to the bit.
    overwrite : bool, optional
        Whether results of the same names may be replaced.
    progress : callable, optional
        Called with each path once its point is compared.

    Returns
    -------
    list of BenchmarkPoint
        For `glint_aoa.benchmark.point_errors` and the like.

    Raises
    ------
    InputError
        If a recording or the setup cannot be used, a run does not start and end with the shaker
        off, or all points are of sweeps or single records.
    """
    of_runs = [path for path in map(Path, paths) if said_of(path).get("run_kind") != "record"]
    if paths and not of_runs:
        raise InputError("all points are single records; give the points of runs at one angle")
    told = {path: announced_point(path, open_fields(path).meta) for path in of_runs}
    sweeps = _sweeps(told.values())
    in_runs = {path: point for path, point in told.items() if point.run not in sweeps}
    if sweeps and not in_runs:
        raise InputError(
            f"all points are of a pitch sweep ({', '.join(sorted(sweeps))}: its nominal angle "
            "changes); give the points of runs at one angle"
        )
    check_runs(in_runs.values())
    out = Path(out)
    done: list[BenchmarkPoint] = []
    with Workers(jobs) as workers:
        # Say now, not after minutes of work, what would fail.
        check = partial(_check_point, setup=setup, new_in=None if overwrite else out)
        for _ in workers.map(check, in_runs):
            pass
        compare = partial(compare_point, setup=setup, out=out, overwrite=overwrite)
        compared = workers.map(compare, in_runs.items())
        for path in map(Path, paths):
            if path in in_runs:
                point, row = next(compared)
                log_result(out, row)
                done.append(point)
            if progress is not None:
                progress(path)
    return done


def _sweeps(points: Iterable[BenchmarkPoint]) -> set[str]:
    """Find the runs whose nominal angle changes from point to point."""
    angles: dict[str, list[float]] = {}
    for point in points:
        if point.nominal_angle_deg is not None:
            angles.setdefault(point.run, []).append(point.nominal_angle_deg)
    return {run for run, each in angles.items() if max(each) - min(each) > _SAME_ANGLE_DEG}


def _check_point(path: Path, *, setup: Setup, new_in: Path | None) -> None:
    prepared(open_acquisition(path, setup.inertial))
    if new_in is not None:
        check_new_results(new_in, path.stem)


def compare_point(
    told: tuple[Path, BenchmarkPoint],
    *,
    setup: Setup,
    out: Path | None = None,
    overwrite: bool = False,
) -> tuple[BenchmarkPoint, dict[str, Any]]:
    """Measure one point by both systems.

    Parameters
    ----------
    told : (Path, BenchmarkPoint)
        Recorded point with fields and acquisition channels, and what it says of itself.
    setup : Setup
        The setup; the inertial angle is corrected if it lists modes, or if the accelerometers
        show the motion without them.
    out : Path, optional
        Folder of the optical results, but for the log; none are written if not given.
    overwrite : bool, optional
        Whether results of the same names may be replaced.

    Returns
    -------
    point : BenchmarkPoint
        With moment, angles and intercepts.
    row : dict
        Its row of the log.

    Raises
    ------
    InputError
        If the recording or the setup cannot be used.
    """
    path, announced = told
    record = open_acquisition(path, setup.inertial)
    if out is None:
        sweep = load_sweep(setup)
        row = measure_point(open_fields(path), setup, sweep=sweep, acquisition=record).log
    else:
        row = process_point(
            path, setup, out, acquisition=record, overwrite=overwrite, to_log=False
        ).log
    raw, corrected = _inertial_angles(prepared(record), setup)
    point = replace(
        announced,
        moment_in_lb_pp=moment_peak_to_peak_in_lb(record, announced.plane),
        optical_deg=row["mean_angle_deg"],
        optical_std_deg=row["std_angle_deg"],
        intercept_mm=row["mean_intercept_mm"],
        intercept_std_mm=row["std_intercept_mm"],
        inertial_deg=raw,
        corrected_deg=corrected,
        flags=row["flags"],
    )
    return point, row


def _inertial_angles(record: AcquisitionRecord, setup: Setup) -> tuple[float, float | None]:
    """Mean raw and corrected angle [deg] where the low-pass has settled."""
    try:
        # Without modes kinematics alone is certain whatever the vibration.
        rows = correct(
            record, setup.inertial, method="auto" if setup.inertial.mode else "kinematic"
        )
    except InputError:
        if setup.inertial.mode:
            raise
        return static_angle(record, setup.inertial)[0], None
    means = (each[rows.settled].mean() for each in (rows.raw_angle_deg, rows.angle_deg))
    raw, corrected = map(float, means)
    return raw, corrected


def announced_point(path: Path, meta: Mapping[str, object]) -> BenchmarkPoint:
    """Read from a point's description what run it is of and what the shaker did; no angles.

    Parameters
    ----------
    path : Path
        The point, for messages.
    meta : mapping
        Its description.

    Returns
    -------
    BenchmarkPoint
        Its angles are NaN.

    Raises
    ------
    RecordingError
        If it does not say run, point and excitation.
    InputError
        If plane or kind of the excitation are not known.
    """
    missing = [key for key in ("run", "point", "excitation") if key not in meta]
    if missing:
        raise RecordingError(
            f"{path}: /meta does not say {', '.join(missing)}; "
            "a comparison needs run, point and excitation of each point"
        )
    words = str(meta["excitation"]).lower()
    off = words in {"off", "none", "shaker off"}
    plane = next((word for word in ("yaw", "pitch") if word in words), "none")
    kinds = ("modulated sine", "random", "sine sweep")
    kind = next((word for word in kinds if word in words), "sine")
    nominal = meta.get("nominal_angle_deg")
    said: dict[str, Any] = {
        "plane": str(meta.get("excitation_plane", "none" if off else plane)),
        "kind": str(meta.get("excitation_kind", "off" if off else kind)),
    }
    return BenchmarkPoint(
        run=str(meta["run"]),
        point=str(meta["point"]),
        excitation=str(meta["excitation"]),
        **said,
        nominal_angle_deg=float(nominal) if isinstance(nominal, int | float) else None,
        moment_in_lb_pp=None,
        optical_deg=np.nan,
        optical_std_deg=np.nan,
        intercept_mm=np.nan,
        intercept_std_mm=np.nan,
        inertial_deg=np.nan,
    )
