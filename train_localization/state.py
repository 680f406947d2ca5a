"""What the train's filters hear, and what they know after it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train_localization.measurements import GnssFix, WheelSpeed
from train_localization.straights import Marks

Array = NDArray[np.float64]


class Stretch(NamedTuple):
    """
    IMU samples of one filter step.

    Attributes:
        time_s: stamp of the last [s].
        stamps: (m,) [s].
        rates: (m, 3) [rad/s].
        forces: (m, 3) [m/s^2].
    """

    time_s: float
    stamps: Array
    rates: Array
    forces: Array


class Fix(NamedTuple):
    """A fix, and how many axes of it are good: 3, 2 (height-aided) or 0."""

    time_s: float
    gnss: GnssFix
    axes: int


Heard = Stretch | Fix | WheelSpeed


class Fused(NamedTuple):
    """
    What the filter knows; never changed in place.

    Attributes:
        nav: (10,) see ``estimation.ins``.
        aux: (18,) see ``kernels``.
        P: (27, 27).
        time_s: stamp of the last IMU sample [s].
        before: (6,) that sample's rate and force.
        gap_s: an IMU that is silent for longer leaves something unseen; see ``gaps``.
        w_mean: (3,) mean rate of the last step [rad/s].
        gain: forward acceleration over the last step [m/s^2].
        began_s: when the filter started [s].
        fixed_s: stamp of the last good fix [s].
        axes: of it.
        refused_fixes: in a row.
        wheel_s: stamp of the last odometer speed [s].
        refused_wheel: in a row.
        moved_s: when the odometer last turned [s].
        railed_s: when the rails were last used [s].
        mapped_s: when the line was [s].
        chainage: nearest, along the line [m].
        marks: where the train has been marked; see ``straights``.
        map_right: probability that the map is nowhere off, where it is told; else NaN.
        reason: why the newest measurement was refused; '' when it was not.
        nis: of it; NaN when it was not used.
    """

    nav: Array
    aux: Array
    P: Array
    time_s: float
    before: Array
    gap_s: float
    w_mean: Array
    gain: float
    began_s: float
    fixed_s: float
    axes: int
    refused_fixes: int
    wheel_s: float
    refused_wheel: int
    moved_s: float
    railed_s: float
    mapped_s: float
    chainage: float
    marks: Marks
    map_right: float
    reason: str
    nis: float
