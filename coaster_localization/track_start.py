"""Where a train may be when nobody knows: the hypotheses that the track filter starts from."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coaster_localization.sensed import shortest_turn
from coaster_localization.start import Rest
from coaster_localization.track_config import TrackFilterConfig
from track_localization.estimation import line_rows, line_state, line_updates, so3
from track_localization.track.line_map import TURNING, LineMap

Array = NDArray[np.float64]

PLACE_SPACING_M, HEADING_SPACING_DEG = 4.0, 20.0
"""How far apart hypotheses of a doubtful start and of the mount's heading are."""
PLACE_ALONE_M = 2.0
"""A doubt up to this needs one hypothesis only."""
TURNED_SHARE, MOUNT_SIGMAS = 0.1, 3.0
"""How likely a sensor is turned about the vertical, against one that sits as it was said to. One
tilted by more than so many sigmas does not, and any heading is as likely."""
STANDING_MPS, PACE, MET_MPS = 0.05, 0.1, 0.5
"""Speed of a standing train; of one met under way, as a share and at least [m/s]."""
FIRM_REST = (0.03, 0.003)
"""Shaken less than this, in force [m/s^2] and rate [rad/s], the train stands for certain."""
LEVEL_MPS2, LOOSE_REST = 0.02, (0.5, 1.0, 2e-3)
"""Force [m/s^2] besides gravity at a firm rest. Otherwise people move in the train, or it leaves
already: the same, its speed [m/s], and what the gyro shows besides its bias [rad/s]."""
SURE_REST_S, BRIEF_REST = 2.0, (1.0, 1.5, 2e-3)
"""A train that leaves evenly looks for a second as if it stood; not for so long [s]. What a briefer
rest may hide, like LOOSE_REST."""
DRIFT = 1.5e-3
"""How far the gyro's bias may drift between the rests before and after a ride [rad/s]."""
START_SHARE = 0.5
"""Chance that a ride that shows no rest begins at the start all the same."""


class Hypotheses(NamedTuple):
    """
    What a line filter may start from.

    Attributes:
        X: (H, 30) nominal states.
        P: (H, 18, 18) error covariances.
        log_weight: (H,).
    """

    X: Array
    P: Array
    log_weight: Array


def mount_of(line: LineMap, s: float, rest: Rest) -> Array:
    """Return the sensor-to-body rotation (3, 3) by the least turn that gravity at rest allows."""
    R = line_rows.attitude_at(line.rows, line.step_m, line.closed, s)
    return shortest_turn(rest.force, R[2])


def is_firm(rest: Rest) -> bool:
    """Whether the train stands for certain in ``rest``, nobody moving in it."""
    return rest.force_std < FIRM_REST[0] and rest.rate_std < FIRM_REST[1]


def at_rest(
    line: LineMap,
    start_m: float,
    sigma_m: float,
    rest: Rest,
    config: TrackFilterConfig,
    leaves: bool = False,
    lasted_s: float = math.inf,
    likeliest: bool = False,
) -> Hypotheses:
    """
    Return hypotheses of a train that stands near ``start_m``, levelled by ``rest``.

    ``leaves``: the rest is another one, the train leaves the start already. ``lasted_s``: for how
    long the train has stood so. ``likeliest``: only the one that weighs most, by its weight.
    """
    if sigma_m > PLACE_ALONE_M and not likeliest:
        count = math.ceil(3.0 * sigma_m / PLACE_SPACING_M)
        offsets = PLACE_SPACING_M * np.arange(-count, count + 1)
        place_sigma = 0.6 * PLACE_SPACING_M
    else:
        offsets, place_sigma = np.zeros(1), sigma_m
    headings = np.zeros(1)
    if not config.mount_known:
        headings = np.deg2rad(np.arange(0.0, 360.0, HEADING_SPACING_DEG))
    bias_sigma = math.hypot(3.0 * rest.rate_std / math.sqrt(rest.samples), 1e-4)
    level_sigma, speed_sigma = LEVEL_MPS2, STANDING_MPS
    if leaves:
        speed_sigma, bias_sigma = LOOSE_REST[1], DRIFT
    elif not is_firm(rest):
        level_sigma, speed_sigma, bias_sigma = LOOSE_REST
    elif lasted_s < SURE_REST_S:
        level_sigma, speed_sigma, bias_sigma = BRIEF_REST
    if speed_sigma > STANDING_MPS:
        place_sigma = math.hypot(place_sigma, speed_sigma)
    found: list[tuple[Array, Array, float]] = []
    for offset in offsets:
        s = start_m + float(offset)
        if not line.closed and not 0.0 <= s <= line.length:
            continue
        M0, up = mount_of(line, s, rest), _attitude(line, s)[2]
        as_told = sits_as_told(line, s, rest, config)
        turned = TURNED_SHARE / len(headings) if as_told else 1.0
        for heading in headings[:1] if likeliest else headings:
            M = so3.exp(heading * up) @ M0
            x, P = state(line, s, 0.0, M, rest.rate, config)
            free = config.mount_sigma_deg if heading == 0.0 else 0.6 * HEADING_SPACING_DEG
            set_mount(P, _attitude(line, s), math.radians(free) ** 2 * np.eye(3), config)
            set_place(P, line, s, place_sigma)
            P[1, 1] = speed_sigma**2
            P[8:11, 8:11] = bias_sigma**2 * np.eye(3)
            line_updates.level(x, P, rest.force, level_sigma)
            weight = -0.5 * (offset / sigma_m) ** 2
            if heading != 0.0:
                weight += math.log(turned)
            found.append((x, P, weight))
    out = stack(found)
    if likeliest:
        out.log_weight[0] -= math.log1p(turned * (len(headings) - 1))
    return out


def under_way(
    line: LineMap,
    start_m: float,
    M: Array,
    gyro_bias: tuple[Array, float],
    mount: Array,
    config: TrackFilterConfig,
) -> Hypotheses:
    """
    Return hypotheses of a train met anywhere on the line, or just leaving the start.

    ``M`` is the mount, ``mount`` (3, 3) its covariance in body axes [rad^2], ``gyro_bias`` the
    bias (3,) and its standard deviation [rad/s].
    """
    found: list[tuple[Array, Array, float]] = []
    count = max(len(line.passes), 1)
    for s, v in [(start_m, 0.0), *line.passes.tolist()]:
        x, P = state(line, s, v, M, gyro_bias[0], config)
        set_mount(P, _attitude(line, s), mount, config)
        set_place(P, line, s, 0.6 * PLACE_SPACING_M)
        P[1, 1] = (PACE * v) ** 2 + MET_MPS**2
        P[8:11, 8:11] = gyro_bias[1] ** 2 * np.eye(3)
        share = START_SHARE if not found else (1.0 - START_SHARE) / count
        found.append((x, P, math.log(share)))
    return stack(found)


def sits_as_told(line: LineMap, s: float, rest: Rest, config: TrackFilterConfig) -> bool:
    """Whether a sensor at rest at ``s`` is tilted no more than it was said to be."""
    tilted = float(np.linalg.norm(so3.log(mount_of(line, s, rest))))
    return tilted < MOUNT_SIGMAS * math.radians(config.mount_sigma_deg)


def either(first: Hypotheses, second: Hypotheses, share: float) -> Hypotheses:
    """Return the hypotheses of both; ``share`` is the chance of the first."""
    return Hypotheses(
        np.concatenate([first.X, second.X]),
        np.concatenate([first.P, second.P]),
        np.concatenate(
            [first.log_weight + math.log(share), second.log_weight + math.log1p(-share)]
        ),
    )


def state(
    line: LineMap, s: float, v: float, M: Array, gyro_bias: Array, config: TrackFilterConfig
) -> tuple[Array, Array]:
    """Return state and covariance of a body that has the line's attitude at ``s``."""
    x, P = np.zeros(line_state.NOMINAL), np.zeros((line_state.ERRORS, line_state.ERRORS))
    x[0], x[1] = s, v
    x[2:11], x[11:20] = (_attitude(line, s) @ M).ravel(), M.ravel()
    x[20:23] = gyro_bias
    P[1, 1] = STANDING_MPS**2
    P[8:11, 8:11] = config.gyro_bias_sigma**2 * np.eye(3)
    P[11:14, 11:14] = config.gyro_scale_sigma**2 * np.eye(3)
    P[14:17, 14:17] = config.accel_bias_sigma**2 * np.eye(3)
    P[17, 17] = config.speed_sigma**2
    return x, P


def set_mount(P: Array, R: Array, free: Array, config: TrackFilterConfig) -> None:
    """
    The body has the line's attitude ``R``: what the mount is off, the sensor is off as well.

    ``free`` (3, 3) is the mount's covariance in body axes [rad^2].
    """
    mount = slice(line_state.MOUNT, line_state.MOUNT + 3)
    tilt = slice(line_state.TILT, line_state.TILT + 3)
    P[mount, mount] = free
    P[tilt, tilt] = R @ free @ R.T + config.attitude_sigma**2 * np.eye(3)
    P[tilt, mount], P[mount, tilt] = R @ free, free @ R.T


def set_place(P: Array, line: LineMap, s: float, sigma: float) -> None:
    """
    Add that the chainage ``s`` is off by ``sigma`` [m]: where the line turns, the attitude with it.

    To be called once, with no doubt of the chainage in ``P`` (18, 18) yet.
    """
    i, _ = line_rows.row_of(line.rows, line.step_m, line.closed, s)
    g = np.zeros(line_state.ERRORS)
    g[line_state.S] = 1.0
    g[line_state.TILT : line_state.TILT + 3] = _attitude(line, s) @ line.rows[i, TURNING]
    P += sigma**2 * np.outer(g, g)


def _attitude(line: LineMap, s: float) -> Array:
    R: Array = line_rows.attitude_at(line.rows, line.step_m, line.closed, s)
    return R


def placed(
    x: Array, P: Array, line: LineMap, place: tuple[float, float], config: TrackFilterConfig
) -> Hypotheses:
    """Return a state (30,), (18, 18) put where somebody says that it is: chainage, sigma [m]."""
    x, P = x.copy(), P.copy()
    R = _attitude(line, place[0])
    x[0], x[2:11] = place[0], (R @ x[11:20].reshape(3, 3)).ravel()
    P[0, :], P[:, 0] = 0.0, 0.0
    turned = slice(line_state.TILT, line_state.TILT + 3)
    P[turned, :], P[:, turned] = 0.0, 0.0
    mount = P[line_state.MOUNT : line_state.MOUNT + 3, line_state.MOUNT : line_state.MOUNT + 3]
    P[turned, turned] = R @ mount @ R.T + config.attitude_sigma**2 * np.eye(3)
    set_place(P, line, *place)
    return Hypotheses(x[None], P[None], np.zeros(1))


def stack(found: list[tuple[Array, Array, float]]) -> Hypotheses:
    """Return states, covariances and weights as hypotheses, the weights normalised."""
    log_weight = np.array([weight for _, _, weight in found])
    log_weight -= np.logaddexp.reduce(log_weight)
    return Hypotheses(
        np.array([x for x, _, _ in found]), np.array([P for _, P, _ in found]), log_weight
    )
