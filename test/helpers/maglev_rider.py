"""A bank taken along a train of measurements."""

from __future__ import annotations

import numpy as np

from maglev_localization.config import MaglevConfig
from maglev_localization.measurements import LoopPosition
from maglev_localization.robust_filter import RobustFilter

CONFIG = MaglevConfig()


class Rider:
    """A filter taken along a train of measurements, with what was thought on the way."""

    def __init__(self, train, config=CONFIG, length=3000.0, chainage=None, variance=1.0):
        self.filter = RobustFilter(config, train.table, length)
        place = train.start_m if chainage is None else chainage
        self.state = self.filter.start(train.begin_s, place, variance)
        self.rng = np.random.default_rng(1)
        self.train, self.says, self.estimates = train, [], []

    def ride(self, measurements):
        for z in measurements:
            self.state = self.filter.apply(self.state, (z, float(self.rng.random())))
            self.says.append((z.time_s, type(z), self.state.says))
            if not isinstance(z, LoopPosition):
                self.estimates.append(self.filter.estimate(self.state))
        return self

    def said(self, kind, *what):
        """Return the stamps at which the likeliest hypothesis said any of ``what``."""
        return [t for t, k, says in self.says if k is kind and says in what]

    def errors(self, begin_s=0.0):
        """Return chainage errors and sigmas from a stamp on."""
        time_s, along, sigma, *_ = self.train.errors(self.estimates)
        return along[time_s > begin_s], sigma[time_s > begin_s]
