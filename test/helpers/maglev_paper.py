"""A train of the paper's own model, its best filter, and the filter under test."""

from __future__ import annotations

import numpy as np

from maglev_localization.config import MaglevConfig, MotionConfig, PaperConfig
from maglev_localization.measurements import LoopPosition, RadarSpeed
from maglev_localization.paper_filter import PaperFilter
from track_localization.track.balise_table import BaliseTable

NO_BALISES = BaliseTable((), np.zeros(0), np.zeros(0))
H = np.eye(3)[:2]


def motion(T):
    F = np.array([[1.0, T, T * T / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    G = np.array([T**3 / 6.0, T * T / 2.0, T])
    return F, G


def paper_run(seed, steps=100):
    """Return truth (steps + 1, 3) from 20 m/s and 1 m/s^2 on, and readings (steps + 1, 2)."""
    rng = np.random.default_rng([seed, 7])
    F, G = motion(1.0)
    x = [np.array([0.0, 20.0, 1.0])]
    for _ in range(steps):
        x.append(F @ x[-1] + G * np.sqrt(0.001) * rng.normal())
    truth = np.array(x)
    return truth, truth[:, :2] + 0.1 * rng.normal(size=(steps + 1, 2))


def optimum(z):
    """Return the Kalman filter's means, started as the filter under test is."""
    F, G = motion(1.0)
    m, P, out = np.array([z[0, 0], z[0, 1], 0.0]), np.diag([1.0, 0.25, 1.0]), []
    for one in z[1:]:
        m, P = F @ m, F @ P @ F.T + 0.001 * np.outer(G, G)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.01 * np.eye(2))
        m, P = m + K @ (one - H @ m), P - K @ H @ P
        out.append(m)
    return np.array(out)


def make(table=NO_BALISES, count=1000, seed=1, known=True, **paper):
    return PaperFilter(
        MaglevConfig(
            method='paper',
            particles=count,
            seed=seed,
            motion=MotionConfig(start_known=known),
            paper=PaperConfig(**paper),
        ),
        table,
    )


def feed(filter_, z, begin=1000.0, T=1.0):
    """Feed loop and radar in step; return the estimates' means."""
    out = []
    for k, (loop, radar) in enumerate(z):
        assert filter_.step(LoopPosition(begin + k * T, loop, 0.01)) is None
        out.append(filter_.step(RadarSpeed(begin + k * T, radar, 0.01)).mean)
    return np.array(out)


def settled(table, seconds=20, **options):
    """Return a filter that has followed 20 m/s for a while, at 1000 s + ``seconds``."""
    filter_ = make(table, **options)
    feed(filter_, [(20.0 * k, 20.0) for k in range(seconds + 1)])
    return filter_
