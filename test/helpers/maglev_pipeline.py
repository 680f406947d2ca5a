"""The maglev behind its one door, by any method; what its estimates are held against."""

from __future__ import annotations

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.pipeline import MaglevPipeline
from track_localization.track.balise_table import BaliseTable

METHODS = ('robust', 'kalman', 'paper')
NO_BALISES = BaliseTable((), np.zeros(0), np.zeros(0))


def make(train, method='robust', table=None, length=3000.0, **settings):
    config = MaglevConfig(method=method, **settings)
    return MaglevPipeline(config, train.table if table is None else table, length)


def run(pipeline, measurements):
    return [estimate for z in measurements for estimate in pipeline.push(z)]


def inside(train, estimates, sigmas, begin_s=0.0):
    """Whether every estimate from ``begin_s`` on keeps within so many of its sigmas."""
    time_s, along, sigma, *_ = train.errors(estimates)
    after = time_s >= begin_s
    assert after.any()
    return bool((np.abs(along) <= sigmas * sigma)[after].all())


def only(measurements, *kinds):
    return [z for z in measurements if isinstance(z, kinds)]
