"""Where to look for a train that is not where it was thought to be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coaster_localization.start import Rest
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_start import (
    DRIFT,
    LOOSE_REST,
    MET_MPS,
    MOUNT_SIGMAS,
    PACE,
    PLACE_SPACING_M,
    Hypotheses,
    mount_of,
    set_mount,
    set_place,
    stack,
    state,
    under_way,
)
from track_localization.estimation import line_rows, line_state, line_updates, so3
from track_localization.track.line_map import LineMap

Array = NDArray[np.float64]

DOUBTED_MOUNT, DOUBTED_BIAS = math.radians(3.0), 2e-3
"""How far mount [rad] and gyro bias [rad/s] may be off when the train was lost."""
SLOW_MPS = 3.0
"""A train slower than this may look as if it stood."""
NEAR_SIGMAS, NEAR_M, ALIKE_RAD, FAR = 3.0, 10.0, 0.3, 0.02
"""A train that was lost is sought within so many sigmas and metres of where it seemed to be, and
turned so far from how it seemed turned; elsewhere it is by this share as likely."""


def sought(
    x: Array, P: Array, line: LineMap, start_m: float, config: TrackFilterConfig
) -> Hypotheses:
    """Return where a train may be whose state (30,), (18, 18) proved wrong, or broke down."""
    if not (np.isfinite(x).all() and np.isfinite(P).all()):
        free = math.radians(config.mount_sigma_deg) ** 2 * np.eye(3)
        bias = (np.zeros(3), config.gyro_bias_sigma)
        return under_way(line, start_m, np.eye(3), bias, free, config)
    mount = P[line_state.MOUNT : line_state.MOUNT + 3, line_state.MOUNT : line_state.MOUNT + 3]
    sigma = math.hypot(math.sqrt(float(np.trace(mount)) / 3.0), DOUBTED_MOUNT)
    M = x[11:20].reshape(3, 3).copy()
    found = under_way(
        line, start_m, M, (x[20:23].copy(), DOUBTED_BIAS), sigma**2 * np.eye(3), config
    )
    return not_far(found, x, P, line)


def not_far(found: Hypotheses, x: Array, P: Array, line: LineMap) -> Hypotheses:
    """
    Return hypotheses weighed by a state (30,), (18, 18) that went wrong not long ago.

    A train does not leap, keeps its speed for a while, and the gyro still knows about where it is
    turned to; the weights have heavy tails, for the state may have been wrong from the start.
    """
    reach = NEAR_SIGMAS * math.sqrt(P[0, 0]) + NEAR_M
    apart = found.X[:, 0] - x[0]
    if line.closed:
        apart -= line.length * np.round(apart / line.length)
    near = 1.0 / (1.0 + (apart / reach) ** 2)
    turned = so3.log(x[2:11].reshape(3, 3) @ np.swapaxes(found.X[:, 2:11].reshape(-1, 3, 3), 1, 2))
    alike = np.exp(-0.5 * np.sum(turned**2, axis=1) / ALIKE_RAD**2)
    pace = 1.0 / (1.0 + ((found.X[:, 1] - x[1]) / (0.3 * abs(x[1]) + 2.0)) ** 2)
    log_weight = np.log(FAR + near) + np.log(FAR + alike) + np.log(FAR + pace)
    return found._replace(log_weight=log_weight - np.logaddexp.reduce(log_weight))


def slow_elsewhere(line: LineMap, rest: Rest, config: TrackFilterConfig) -> Hypotheses | None:
    """
    Return hypotheses of a train whose ``rest`` was none in the station; None if it was there.

    A sensor that sits as it was said to shows the slope of where it is; a slow drive up a steep
    line shakes no more than a stop.
    """
    found: list[tuple[Array, Array, float]] = []
    sigma = math.radians(config.mount_sigma_deg)
    for s, v in line.passes[np.abs(line.passes[:, 1]) < SLOW_MPS].tolist():
        M = mount_of(line, s, rest)
        tilted = float(np.linalg.norm(so3.log(M)))
        if tilted > MOUNT_SIGMAS * sigma:
            continue
        x, P = state(line, s, v, M, rest.rate, config)
        R = line_rows.attitude_at(line.rows, line.step_m, line.closed, s)
        set_mount(P, R, sigma**2 * np.eye(3), config)
        set_place(P, line, s, 0.6 * PLACE_SPACING_M)
        P[1, 1] = (PACE * v) ** 2 + MET_MPS**2
        P[8:11, 8:11] = DRIFT**2 * np.eye(3)
        line_updates.level(x, P, rest.force, LOOSE_REST[0])
        found.append((x, P, -0.5 * (tilted / sigma) ** 2))
    return stack(found) if found else None
