"""
The paper's federated particle filter against `particles` and `filterpy`, in one run.

The model is the maglev paper's: chainage, speed and acceleration, a loop and a radar once a second.
A step is predict, weigh, draw anew where N_eff < N / 2, mean and covariance. Ours has two clouds of
N particles, one for each sensor, and fuses them and feeds back; it runs as it does live. Either
library gets two filters of N, one for each sensor, and nothing to fuse; or one filter of N with
both sensors, which is half the particles.

They are used as their documentation does: `particles` by its linear Gaussian model and moments,
`filterpy` by the loop around its resampling in its author's book. Beside that stands `tuned`, the
fastest numpy code that we could write around their parts: one random number a particle, no density
objects, moments by matrix products. The Kalman filter is the floor in time and error.

Times are the least of several runs, in processor time, taken in turn: other load matters less so.
Ratios count, within one run.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import particles
from filterpy.kalman import KalmanFilter
from filterpy.monte_carlo import systematic_resample
from numpy.typing import NDArray
from particles import collectors, kalman, state_space_models
from scipy.stats import norm

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import LoopPosition, RadarSpeed
from maglev_localization.paper_filter import PaperFilter
from track_localization.evaluation.tabulate import Table
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
G = np.sqrt(0.001) * np.array([1.0 / 6.0, 0.5, 1.0])
R = 0.01
START, START_SIGMA = np.array([0.0, 20.0, 1.0]), np.array([1.0, 0.5, 1.0])
BOTH, APART = ((0, 1),), ((0,), (1,))
"""Which states filters measure: one filter, or two."""

EPOCHS, TURNS, SETTLED = 100, 7, 10
COUNTS = (1000, 10000)
GOAL = 5.0
ONE_THREAD = 'OPENBLAS_NUM_THREADS'

Means = Array
Run = Callable[[Array], Means]


def drive(seed: int) -> tuple[Array, Array]:
    """Return the truth (EPOCHS, 3) and the readings of loop and radar (EPOCHS, 2)."""
    rng = np.random.default_rng(seed)
    states = [START]
    for _ in range(EPOCHS - 1):
        states.append(F @ states[-1] + G * rng.normal())
    truth = np.array(states)
    return truth, truth[:, :2] + np.sqrt(R) * rng.normal(size=(EPOCHS, 2))


def ours(count: int) -> Run:
    """Return the federated filter, as the pipeline runs it."""
    nothing = BaliseTable((), np.zeros(0), np.zeros(0))
    config = MaglevConfig(method='paper', particles=count)

    def run(z: Array) -> Means:
        filter_, means = PaperFilter(config, nothing), []
        for k, (place, speed) in enumerate(z.tolist()):
            filter_.step(LoopPosition(float(k), place, R))
            estimate = filter_.step(RadarSpeed(float(k), speed, R))
            assert estimate is not None
            means.append(estimate.mean)
        return np.array(means)

    return run


def particles_documented(count: int, measured: Sequence[int]) -> Run:
    """Return the bootstrap filter of the library's linear Gaussian model."""
    model = kalman.MVLinearGauss(
        F=F,
        G=np.eye(3)[list(measured)],
        # A covariance must be regular there.
        covX=np.outer(G, G) + 1e-12 * np.eye(3),
        covY=R * np.eye(len(measured)),
        mu0=START,
        cov0=np.diag(START_SIGMA**2),
    )

    def run(z: Array) -> Means:
        data = list(z[:, None, list(measured)])
        feynman_kac = state_space_models.Bootstrap(ssm=model, data=data)
        filter_ = particles.SMC(fk=feynman_kac, N=count, collect=[collectors.Moments()])
        filter_.run()
        return np.array([moments['mean'] for moments in filter_.summaries.moments])

    return run


def filterpy_documented(count: int, measured: Sequence[int]) -> Run:
    """Return the particle filter of the author's book, chapter 12."""

    def run(z: Array) -> Means:
        rng = np.random.default_rng(1)
        x = START + START_SIGMA * rng.standard_normal((count, 3))
        w, means = np.full(count, 1.0 / count), []
        for k, one in enumerate(z):
            if k:
                x = x @ F.T + rng.standard_normal((count, 1)) * G
            for i in measured:
                w *= norm(x[:, i], np.sqrt(R)).pdf(one[i])
            w += 1e-300
            w /= w.sum()
            mean = np.average(x, weights=w, axis=0)
            np.average((x - mean) ** 2, weights=w, axis=0)
            means.append(mean)
            if 1.0 / np.sum(np.square(w)) < 0.5 * count:
                indices = systematic_resample(w)
                x = x[indices]
                w = np.full(count, 1.0 / count)
        return np.array(means)

    return run


class Tuned(particles.FeynmanKac):
    """The model for `particles`, with one random number a particle and no density objects."""

    def __init__(self, z: Array, measured: Sequence[int]) -> None:
        super().__init__(len(z))
        self._z, self._measured = z, tuple(measured)
        self._rng = np.random.default_rng(1)

    def M0(self, N: int) -> Array:
        """Draw the start."""
        return START + START_SIGMA * self._rng.standard_normal((N, 3))

    def M(self, t: int, xp: Array) -> Array:
        """Move particles."""
        return xp @ F.T + self._rng.standard_normal((len(xp), 1)) * G

    def logG(self, t: int, xp: Array, x: Array) -> Array:
        """Return their log likelihood."""
        return log_likelihood(x, self._z[t], self._measured)


def log_likelihood(x: Array, z: Array, measured: Sequence[int]) -> Array:
    """Return the log likelihood of the readings, but for a constant."""
    total = np.zeros(len(x))
    for k in measured:
        off = x[:, k] - z[k]
        total -= (0.5 / R) * off * off
    return total


def moments(w: Array, x: Array) -> dict[str, Array]:
    """Return mean and covariance by matrix products."""
    mean = w @ x
    off = x - mean
    return {'mean': mean, 'cov': (w[:, None] * off).T @ off}


def particles_tuned(count: int, measured: Sequence[int]) -> Run:
    """Return `particles` with ``Tuned``."""

    def run(z: Array) -> Means:
        collect = [collectors.Moments(mom_func=moments)]
        filter_ = particles.SMC(fk=Tuned(z, measured), N=count, collect=collect)
        filter_.run()
        return np.array([found['mean'] for found in filter_.summaries.moments])

    return run


def filterpy_tuned(count: int, measured: Sequence[int]) -> Run:
    """Return `filterpy`'s resampling in a lean loop."""

    def run(z: Array) -> Means:
        model = Tuned(z, measured)
        x, w, means = model.M0(count), np.full(count, 1.0 / count), []
        for k, one in enumerate(z):
            if k:
                x = model.M(k, x)
            w = w * np.exp(log_likelihood(x, one, measured)) + 1e-300
            w /= w.sum()
            means.append(moments(w, x)['mean'])
            if 1.0 / (w @ w) < 0.5 * count:
                x, w = x[systematic_resample(w)], np.full(count, 1.0 / count)
        return np.array(means)

    return run


def kalman_filter(z: Array) -> Means:
    """Run filterpy's Kalman filter: the optimum."""
    filter_ = KalmanFilter(dim_x=3, dim_z=2)
    filter_.x, filter_.P = START.copy(), np.diag(START_SIGMA**2)
    filter_.F, filter_.Q = F, np.outer(G, G)
    filter_.H, filter_.R = np.eye(3)[:2], R * np.eye(2)
    means = []
    for k, one in enumerate(z):
        if k:
            filter_.predict()
        filter_.update(one)
        means.append(filter_.x)
    return np.array(means)


PEERS: Mapping[str, Callable[[int, Sequence[int]], Run]] = {
    'particles': particles_documented,
    'filterpy': filterpy_documented,
    'particles, tuned': particles_tuned,
    'filterpy, tuned': filterpy_tuned,
}
OURS, FLOOR = 'ours: federated, two clouds of N', 'Kalman filter (filterpy)'


def contestants(count: int) -> dict[str, list[Run]]:
    """Return what takes part: filters whose times add up."""
    out = {OURS: [ours(count)]}
    for layout, what in ((APART, 'two filters of N'), (BOTH, 'one filter of N')):
        for name, make in PEERS.items():
            out[f'{name}: {what}'] = [make(count, measured) for measured in layout]
    return out | {FLOOR: [kalman_filter]}


def least_us(entries: Mapping[str, list[Run]], z: Array) -> dict[str, float]:
    """Return the least processor time of each per epoch [us], taken in turn."""
    best = {(name, k): np.inf for name, runs in entries.items() for k in range(len(runs))}
    for turn in range(TURNS + 1):
        for name, k in best:
            begin = time.process_time()
            entries[name][k](z)
            spent = (time.process_time() - begin) / len(z) * 1e6
            # The first one may compile.
            best[name, k] = min(best[name, k], spent) if turn else np.inf
    return {name: sum(t for (n, _), t in best.items() if n == name) for name in entries}


def over_floor(run: Run, drives: Sequence[tuple[Array, Array]]) -> float:
    """Return the rms error of the place over the Kalman filter's, the first epochs left out."""
    own, best = (
        np.concatenate([(one(z) - x)[SETTLED:, 0] for x, z in drives])
        for one in (run, kalman_filter)
    )
    return float(np.sqrt(np.mean(own**2) / np.mean(best**2)))


def compare(count: int) -> Table:
    """Return the table of one N; its title says by how much ours is faster."""
    entries = contestants(count)
    times = least_us(entries, drive(1)[1])
    drives = [drive(seed) for seed in range(2, 10)]
    rows = [
        [
            name,
            spent,
            f'{spent / times[OURS]:.2f}',
            over_floor(entries[name][0], drives) if len(entries[name]) == 1 else None,
        ]
        for name, spent in times.items()
    ]
    documented, tuned = (
        min(times[f'{name}{how}: two filters of N'] for name in ('particles', 'filterpy'))
        for how in ('', ', tuned')
    )
    title = (
        f'N = {count}: ours is {documented / times[OURS]:.1f} x as fast as the better of the two '
        f'(goal {GOAL:g}), {tuned / times[OURS]:.1f} x as the better tuned'
    )
    return Table(title, ('', 'us an epoch', 'over ours', 'RMSE over the optimum'), rows)


def main() -> None:
    """Print a table for each N; in a process without threads of its own, whose waiting counts."""
    if os.environ.get(ONE_THREAD) != '1':
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, ONE_THREAD: '1'})
    for count in COUNTS:
        print(compare(count).text(), end='\n\n', flush=True)


if __name__ == '__main__':
    main()
