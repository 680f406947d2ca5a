"""
Time of inertial navigation and of its 15-state filter against pyins, in one run, same samples.

pyins integrates a whole stream by one compiled call, or one sample a call as a live navigator must;
its filter, in Python around that, predicts at its usual 10 Hz, ours at every sample, 100 Hz. Both
take a position at 1 Hz. Errors against the truth are printed beside, so that it is seen that both
do the same work. Prints ratios; asks nothing.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import filters, inertial_sensor, measurements, sim, strapdown, transform
from scipy.spatial.transform import Rotation

from track_localization.estimation import ins, sequential

Array = NDArray[np.float64]

DT = 0.01
RIDE_S, FILTER_S, WARM_S = 200.0, 40.0, 3.0
"""Rides: for mechanising, for pyins' slow filter, and to compile on [s]."""
DEG = np.pi / 180.0
# Noise per sqrt(Hz), bias at first, walk per sqrt(s): gyro [rad/s], accelerometer [m/s^2].
GYRO, ACCEL = (1e-5, 2e-5, 1e-8), (1e-3, 1e-2, 1e-5)
FIX_SIGMA = 1.5
STEPS = 100
"""Samples that pyins is given one by one."""
START_SIGMA = (2.0, 0.1, 0.02, 0.2)
"""Position [m], velocity [m/s], level [deg], course [deg]."""
# pyins has axes north, east, down and forward, right, down.
FLIP = np.array([1.0, -1.0, -1.0])
ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


class Stream(NamedTuple):
    """
    A ride as both sides take it.

    ``start`` is pyins' first state and ``nav`` (10,) the same in ours; ``imu`` its samples and
    ``w``, ``f`` (N, 3) ours; ``fixes`` its positions and ``places`` (K, 3) ours, from 1 s on.
    """

    truth: pd.DataFrame
    start: pd.Series
    nav: Array
    imu: pd.DataFrame
    w: Array
    f: Array
    fixes: pd.DataFrame
    places: Array


def make_stream(seconds: float, seed: int = 1) -> Stream:
    """Return a train-like ride with a noisy IMU at 100 Hz and positions at 1 Hz."""
    rng = np.random.default_rng(seed)
    truth, imu = sim.generate_sine_velocity_motion(
        DT, seconds, [40.3458, 116.0271, 50.0], [40.0, 30.0, 0.0], [5.0, 5.0, 0.0]
    )
    columns = ['gyro_x', 'gyro_y', 'gyro_z', 'accel_x', 'accel_y', 'accel_z']
    noise = np.repeat([GYRO[0], ACCEL[0]], 3) / np.sqrt(DT)
    bias = rng.normal(size=6) * np.repeat([GYRO[1], ACCEL[1]], 3)
    imu = imu[columns] + bias + rng.normal(size=(len(imu), 6)) * noise
    error = rng.normal(size=9) * np.repeat(START_SIGMA, [3, 3, 2, 1])
    start = sim.perturb_pva(
        truth.iloc[0],
        pd.Series(error, ['north', 'east', 'down', 'VN', 'VE', 'VD', 'roll', 'pitch', 'heading']),
    )
    every = round(1.0 / DT)
    fixes = sim.generate_position_measurements(truth.iloc[every::every], FIX_SIGMA, rng=seed)
    sensed = imu.to_numpy()
    places = fixes[['lat', 'lon', 'alt']].to_numpy() * [DEG, DEG, 1.0]
    w, f = sensed[:, :3] * FLIP, sensed[:, 3:] * FLIP
    return Stream(truth, start, as_nav(start), imu, w, f, fixes, places)


def as_nav(pva: pd.Series) -> Array:
    """Return pyins' position, velocity and attitude as ours (10,)."""
    R = ENU_FROM_NED @ transform.mat_from_rph(pva[['roll', 'pitch', 'heading']]) @ np.diag(FLIP)
    velocity = ENU_FROM_NED @ pva[['VN', 'VE', 'VD']].to_numpy(float)
    place = [pva['lat'] * DEG, pva['lon'] * DEG, pva['alt']]
    return np.concatenate([place, velocity, Rotation.from_matrix(R).as_quat()])


@numba.njit(cache=True)
def mechanise_all(nav: Array, w: Array, f: Array, dt: float, out: Array) -> None:
    """Write the state (N, 10) at every sample into ``out``."""
    out[0] = nav
    for k in range(1, len(w)):
        ins.mechanise(nav, w[k], f[k], w[k - 1], f[k - 1], dt)
        out[k] = nav


@numba.njit(cache=True)
def filter_all(
    nav: Array, P: Array, w: Array, f: Array, places: Array, settings: Array, out: Array
) -> None:
    """Run the filter over a stream, ``settings`` (7,) as in ``ours_filter``; states to ``out``."""
    dt, every = settings[0], round(1.0 / settings[0])
    bias, dx, h = np.zeros(6), np.zeros(15), np.zeros(15)
    Phi, Q = np.empty((15, 15)), np.empty((15, 15))
    rate, force = w[0].copy(), f[0].copy()
    out[0] = nav
    for k in range(1, len(w)):
        rate_before, force_before = rate.copy(), force.copy()
        for i in range(3):
            rate[i] = w[k, i] - bias[i]
            force[i] = f[k, i] - bias[3 + i]
        ins.error_transition(nav, force, rate, dt, Phi)
        ins.process_noise(nav, dt, settings[1], settings[2], settings[3], settings[4], Q)
        ins.propagate(P, Phi, Q)
        ins.mechanise(nav, rate, force, rate_before, force_before, dt)
        if k % every == 0:
            fix = places[k // every - 1]
            M, N = ins.curvature_radii(nav[0])
            nu = (
                (fix[1] - nav[1]) * (N + nav[2]) * np.cos(nav[0]),
                (fix[0] - nav[0]) * (M + nav[2]),
                fix[2] - nav[2],
            )
            dx[:] = 0.0
            for i in range(3):
                h[i] = 1.0
                sequential.update(P, h, settings[5], nu[i], dx)
                h[i] = 0.0
            ins.inject(nav, dx)
            bias += dx[9:15]
        out[k] = nav


def ours_mechanise(s: Stream) -> Array:
    """Whole stream, one compiled call."""
    out = np.empty((len(s.w), 10))
    mechanise_all(s.nav.copy(), s.w, s.f, DT, out)
    return out


def ours_stepwise(s: Stream) -> Array:
    """One call from Python per sample."""
    nav = s.nav.copy()
    for k in range(1, len(s.w)):
        ins.mechanise(nav, s.w[k], s.f[k], s.w[k - 1], s.f[k - 1], DT)
    return nav[None]


def ours_filter(s: Stream) -> Array:
    """Prediction at 100 Hz and three scalar updates at 1 Hz."""
    position, velocity, level, course = START_SIGMA
    sigma = [position] * 3 + [velocity] * 3 + [level * DEG] * 2 + [course * DEG]
    P = np.diag(np.array([*sigma, *[GYRO[1]] * 3, *[ACCEL[1]] * 3]) ** 2)
    settings = np.array([0.0, GYRO[0], ACCEL[0], GYRO[2], ACCEL[2], FIX_SIGMA]) ** 2
    settings[0] = DT
    out = np.empty((len(s.w), 10))
    filter_all(s.nav.copy(), P, s.w, s.f, s.places, settings, out)
    return out


def theirs_mechanise(s: Stream) -> pd.DataFrame:
    """Whole stream: increments at once, then one compiled call."""
    increments = strapdown.compute_increments_from_imu(s.imu, 'rate')
    return strapdown.Integrator(s.start).integrate(increments)


def theirs_stepwise(s: Stream) -> pd.DataFrame:
    """One call per sample, the first few: it keeps all of its trajectory, later ones are slower."""
    increments = strapdown.compute_increments_from_imu(s.imu.iloc[: STEPS + 1], 'rate')
    integrator = strapdown.Integrator(s.start)
    for k in range(len(increments)):
        integrator.integrate(increments.iloc[k : k + 1])
    return integrator.trajectory


def theirs_filter(s: Stream) -> pd.DataFrame:
    """Feedback filter: prediction at 10 Hz, its usual step, and positions at 1 Hz."""
    found = filters.run_feedback_filter(
        s.start,
        *START_SIGMA,
        strapdown.compute_increments_from_imu(s.imu, 'rate'),
        gyro_model=inertial_sensor.EstimationModel(GYRO[1], GYRO[0], GYRO[2]),
        accel_model=inertial_sensor.EstimationModel(ACCEL[1], ACCEL[0], ACCEL[2]),
        measurements=[measurements.Position(s.fixes, FIX_SIGMA)],
    )
    return found.trajectory


def best_time(
    run: Callable[[Stream], object], s: Stream, samples: int, times: int
) -> tuple[float, object]:
    """Return the best time per sample of several runs [us], and what the last of them gave."""
    run(make_stream(WARM_S))
    best, found = np.inf, None
    for _ in range(times):
        begin = time.perf_counter()
        found = run(s)
        best = min(best, time.perf_counter() - begin)
    return 1e6 * best / samples, found


def rms_error(s: Stream, found: object) -> float:
    """Return the horizontal error over the ride's second half, root of the mean square [m]."""
    if isinstance(found, pd.DataFrame):
        lat, lon = (found[name].to_numpy() * DEG for name in ('lat', 'lon'))
    else:
        lat, lon = np.asarray(found)[:, :2].T
    half = len(lat) // 2
    north = (lat - s.truth['lat'].to_numpy() * DEG) * 6.36e6
    east = (lon - s.truth['lon'].to_numpy() * DEG) * 6.39e6 * np.cos(lat)
    return float(np.sqrt(np.mean(north[half:] ** 2 + east[half:] ** 2)))


def main() -> None:
    """Print the table."""
    warnings.filterwarnings('ignore', 'The copy keyword is deprecated')
    ride, short = make_stream(RIDE_S), make_stream(FILTER_S)
    print(f'IMU at {1 / DT:g} Hz, us per sample, and horizontal error of the second half')
    for label, s, ours, theirs, calls, times in (
        ('mechanisation, whole stream', ride, ours_mechanise, theirs_mechanise, None, 5),
        ('mechanisation, call by call', ride, ours_stepwise, theirs_stepwise, STEPS, 2),
        ('15-state filter, 1 Hz fixes', short, ours_filter, theirs_filter, None, 1),
    ):
        own, found = best_time(ours, s, len(s.w), 5)
        other, reference = best_time(theirs, s, calls or len(s.w), times)
        print(f'  {label}: {own:.2f}, pyins {other:.2f}, {other / own:.1f} x as fast', end='')
        if calls is None:
            print(f'; {rms_error(s, found):.3f} m, pyins {rms_error(s, reference):.3f} m', end='')
        print()


if __name__ == '__main__':
    main()
