"""The paper's regression study (Tables 2 and 3), repeated on simulated records.

The records are those of the paper's campaign file: the model is driven in its first yaw or pitch
mode, modulated, for 90 s. A loose mass near the balance, which the balance feels and the package
does not, moves throughout and seven times as far in the last part of the yaw record; the
accelerometers' bracket, which it strikes, trembles. A knock tips the model at 70 s of the pitch
record, as in the paper. The yaw record is driven harder than the campaign's 5300 in lb, up to the
mean bias of Table 3.
"""

from dataclasses import dataclass, replace

import numpy as np

from glint_aoa.inertial.channels import package_output
from glint_aoa.inertial.estimate import CorrectionTask
from glint_aoa.inertial.lateral import SourceKind
from glint_aoa.inertial.record_fit import regress
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.setup import Inertial
from glint_aoa.units import convert
from render_sim.campaign import point_acquisition
from render_sim.campaign_file import Campaign, Drift, load_campaign
from render_sim.modes import Plane

__all__ = ["PAPER_ROWS", "StudyRow", "regression_study", "study_record"]

_RECORDS: dict[Plane, tuple[str, float]] = {
    "pitch": ("pitch-9.2hz-regression", 4000.0),
    "yaw": ("yaw-9.75hz-regression", 6170.0),
}
"""Record of each plane and the level that gives its table's mean [in lbf, peak to peak]."""


@dataclass(frozen=True)
class PaperRow:
    """A row of Table 2 or 3 as printed."""

    plane: Plane
    between_s: tuple[float, float]
    source: SourceKind
    mean_deg: float
    std_deg: float
    bias_deg: float
    corrected_deg: float
    standard_error_deg: float


PAPER_ROWS = (
    PaperRow("pitch", (15, 85), "moment", -0.337, 0.048, -0.064, -0.273, 0.014),
    PaperRow("pitch", (20, 40), "moment", -0.332, 0.046, -0.059, -0.273, 0.006),
    PaperRow("pitch", (40, 60), "moment", -0.335, 0.046, -0.067, -0.268, 0.005),
    PaperRow("pitch", (20, 40), "force", -0.332, 0.046, -0.095, -0.237, 0.030),
    PaperRow("pitch", (20, 40), "acceleration", -0.332, 0.046, -0.064, -0.268, 0.011),
    PaperRow("yaw", (10, 30), "moment", -0.433, 0.078, -0.148, -0.285, 0.007),
    PaperRow("yaw", (40, 60), "moment", -0.440, 0.077, -0.161, -0.280, 0.032),
    PaperRow("yaw", (10, 30), "force", -0.433, 0.078, -0.178, -0.254, 0.050),
    PaperRow("yaw", (10, 30), "acceleration", -0.433, 0.078, -0.149, -0.284, 0.021),
)
"""Tables 2 (pitch) and 3 (yaw) of the paper."""


@dataclass(frozen=True)
class StudyRow:
    """A row of the paper's table beside ours.

    Attributes
    ----------
    paper : PaperRow
        As printed.
    figures : dict of str to float
        Ours: see `glint_aoa.inertial.record_fit.Regression.figures`.
    zero_deg : float
        Angle of the motionless model [deg].
    is_correlated : bool
        False where the method warns.
    """

    paper: PaperRow
    figures: dict[str, float]
    zero_deg: float
    is_correlated: bool

    @property
    def paper_reduction(self) -> float:
        """Reduction of the standard deviation in the paper."""
        return 1 - self.paper.standard_error_deg / self.paper.std_deg


def regression_study(*, seed: int = 1) -> list[StudyRow]:
    """Repeat every row of the paper's Tables 2 and 3.

    Parameters
    ----------
    seed : int
        Of noise and phases.

    Returns
    -------
    list of StudyRow
        In the order of `PAPER_ROWS`.
    """
    rows = []
    for plane in ("pitch", "yaw"):
        zero_deg = float(np.degrees(_plan(plane).points[0].angle_rad))
        record = study_record(plane, seed=seed)
        # the paper's regression was on the filtered output
        filtered = {k: v for k, v in record.channels.items() if v.quantity != "aoa_unfiltered"}
        record = replace(record, channels=filtered)
        task = CorrectionTask(record, package_output(record), (), Inertial().filter)
        for row in PAPER_ROWS:
            if row.plane == plane:
                found = regress(task, source=row.source, planes=(plane,), between_s=row.between_s)
                rows.append(StudyRow(row, found.figures(), zero_deg, found.is_correlated))
    return rows


def study_record(plane: Plane, *, seed: int = 1) -> AcquisitionRecord:
    """Simulate the 12-channel record of one of the two tables.

    Parameters
    ----------
    plane : {"yaw", "pitch"}
        Plane of the excitation.
    seed : int
        Of noise and phases.

    Returns
    -------
    AcquisitionRecord
        From rigid-body kinematics, 800 samples/s, 16 bits.
    """
    plan = _plan(plane)
    acquired = point_acquisition(plan, plan.points[0], seed=seed)
    channels = {k: v for k, v in acquired.channels.items() if not k.startswith("analyser_")}
    return AcquisitionRecord(name=plan.points[0].name, channels=channels)


def _plan(plane: Plane) -> Campaign:
    """Return the paper's campaign with this record alone, at the table's level, not drifting."""
    name, level = _RECORDS[plane]
    campaign = load_campaign("paper")
    record = next(each for each in campaign.record if each.name == name)
    moments = (level * convert("in*lbf", "N*m"),)
    driven = record.excitation and record.excitation.model_copy(update={"moments": moments})
    alone = record.model_copy(update={"excitation": driven})
    return campaign.model_copy(
        update={"drift": Drift(), "sweep": (), "run": (), "record": (alone,)}
    )
