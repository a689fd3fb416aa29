"""What every method of correction takes, and what it returns.

A method is one file with two functions: ``missing(task)`` says what the record lacks for it, as
the end of a sentence, or None; ``estimate_bias(task)`` returns the bias sample by sample, before
any low-pass.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glint_aoa.inertial.channels import PackageOutput
from glint_aoa.inertial.modes import Mode
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.setup import InertialFilter

__all__ = ["MISALIGNMENT_STD", "BiasEstimate", "CorrectionTask"]

_Floats = NDArray[np.float64]

MISALIGNMENT_STD = float(np.radians(0.5))
"""Of an accelerometer glued on by hand, 1 sigma [rad]."""


@dataclass(frozen=True, eq=False)
class CorrectionTask:
    """What there is to correct a record with.

    Attributes
    ----------
    record : AcquisitionRecord
        The record, with all its channels.
    package : PackageOutput
        Output of the inertial package, from that record.
    modes : tuple of Mode
        Modes of the setup, in order of frequency; may be empty.
    filter : InertialFilter
        The low-pass that the estimate will run through.
    relative_std : float
        Relative uncertainty, 1 sigma, of an accelerometer's gain (kinematic) or of the bias of
        a mode from its radius and from gains (modal).
    misalignment_std : float
        Uncertainty of the direction in which an accelerometer senses, 1 sigma [rad].
    """

    record: AcquisitionRecord
    package: PackageOutput
    modes: tuple[Mode, ...]
    filter: InertialFilter
    relative_std: float = 0.01
    misalignment_std: float = MISALIGNMENT_STD


@dataclass(frozen=True, eq=False)
class BiasEstimate:
    """Centripetal acceleration that the package took for gravity.

    Attributes
    ----------
    addition : ndarray [sample]
        What to add to the unfiltered specific force [m/s^2], sum of V^2 / rho.
    std_terms : list of ndarray [sample]
        Independent error terms [m/s^2] before the low-pass; after it, the absolute value of each
        is 1 sigma. Where a term is infinite the method cannot know.
    channels : tuple of Channel
        Channels used as they are, besides the package's. Rows around their clipped or bridged
        samples are flagged, and clipped ones widen the uncertainty; a method that repairs its
        channels names none and says so by `flags`.
    settling_s : float
        Time from either end of the record within which the estimate has not settled [s].
    why : str
        What was used, in one sentence.
    settings : mapping
        Figures behind the estimate, for the record of the result.
    flags : ndarray [sample] or None
        Bit mask of `glint_aoa.flags.Flag`; every row whose low-pass remembers a sample bears its
        flags. The uncertainty of what they stand for is in `std_terms`.
    """

    addition: _Floats
    std_terms: list[_Floats]
    channels: tuple[Channel, ...]
    settling_s: float
    why: str
    settings: Mapping[str, object] = field(default_factory=dict)
    flags: NDArray[np.int64] | None = None
