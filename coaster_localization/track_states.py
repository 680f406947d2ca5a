"""What the track filter gives out and keeps: states, epochs, and what a doubt began from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coaster_localization.start import Rest

Array = NDArray[np.float64]


class Epoch(NamedTuple):
    """
    One comparison with the line, as a smoother needs it.

    Attributes:
        time_s: stamp [s].
        x_before, P_before: the prediction.
        F: transition from the epoch before; zero at the first one after a start.
        x, P: after all updates.
    """

    time_s: float
    x_before: Array
    P_before: Array
    F: Array
    x: Array
    P: Array


class TrackState(NamedTuple):
    """
    Where the vehicle is at one stamp.

    Attributes:
        time_s: [s].
        x: (30,) nominal state, see ``line_state``.
        P: (18, 18) of the latest epoch.
        lost: probability that the vehicle is somewhere else altogether.
        widened: factor for ``P`` and the line's variance, of a line more crooked than expected.
    """

    time_s: float
    x: Array
    P: Array
    lost: float = 0.0
    widened: float = 1.0


class Origin(NamedTuple):
    """
    What a hypothesis began from.

    Attributes:
        time_s: stamp [s].
        x, P: state and covariance.
        rest: the rest that standstills are compared with.
        fresh: whether the IMU's running means began here as well.
    """

    time_s: float
    x: Array
    P: Array
    rest: Rest | None
    fresh: bool


class Doubt(NamedTuple):
    """A stretch with several hypotheses: what the right one began from, and when it was known."""

    origin: Origin
    until_s: float
