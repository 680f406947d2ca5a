"""Waiting for a ride: the rest before it, or the finding that it is under way."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from coaster_localization.start import Rest, observe_rest
from coaster_localization.track_config import TrackFilterConfig
from coaster_localization.track_mixture import mixture
from coaster_localization.track_sought import slow_elsewhere
from coaster_localization.track_start import (
    DRIFT,
    PLACE_ALONE_M,
    SURE_REST_S,
    Hypotheses,
    at_rest,
    either,
    is_firm,
    sits_as_told,
    under_way,
)
from coaster_localization.track_states import TrackState
from track_localization.estimation import line_state
from track_localization.estimation.imu import ImuSample
from track_localization.track.line_map import LineMap

LOOK_INTERVAL_S = 0.25
"""How often a waiting filter looks for a rest, or its end."""
TILTED_STATION_SHARE = 0.9
"""Chance that a train that shows a rest, but another slope than the station's, stands there."""
STATION_SHARE = 0.99
"""Chance that a train which hardly shakes is in the station, against anywhere else."""
TURN_AT_REST, TURN_UNDER_WAY = 0.2, 2.0
"""How far the line turns until one hypothesis may be followed alone, after a start in the station
and after one anywhere [rad]."""


class Begin(NamedTuple):
    """
    What a ride begins from.

    Attributes:
        time_s: stamp [s].
        start: the hypotheses.
        turn: how far the line turns until one may be followed alone [rad].
        rest: the rest that standstills are compared with.
        hasty: whether that may have been none.
        way: 1 where the train is to leave forward, -1 backward, 0 where nobody knows.
        samples: from ``time_s`` on, to be followed now.
    """

    time_s: float
    start: Hypotheses
    turn: float
    rest: Rest | None
    hasty: bool
    way: float
    samples: tuple[ImuSample, ...]


class Departure:
    """
    Stand until the sensor moves; where it never stood, take the ride to be under way.

    Nothing is decided while the train stands: what it stands like is the last second before it
    leaves.

    Attributes:
        standing: the state of a train at rest, or None.
    """

    def __init__(
        self,
        line: LineMap,
        place: tuple[float, float],
        config: TrackFilterConfig,
        known_rest: Rest | None,
    ) -> None:
        """
        Wait on ``line`` at ``place``, a chainage and its standard deviation [m].

        ``known_rest`` was seen elsewhere in the recording.
        """
        self._line, self.place, self._config = line, place, config
        self._known_rest = known_rest
        self._waiting: deque[ImuSample] = deque()
        self._seen: Rest | None = None
        self._stands_s = math.inf
        self._look_s = -math.inf
        self.standing: TrackState | None = None

    def push(self, sample: ImuSample) -> Begin | None:
        """Take a sample; return what the ride begins from, once it does."""
        waiting, config = self._waiting, self._config
        waiting.append(sample)
        span = sample.time_s - waiting[0].time_s
        if span < config.rest_s or sample.time_s < self._look_s:
            if self.standing is not None:
                self.standing = self.standing._replace(time_s=sample.time_s)
            return None
        self._look_s = sample.time_s + LOOK_INTERVAL_S
        latest = [s for s in waiting if s.time_s >= sample.time_s - config.rest_s]
        rest = observe_rest(latest)
        if rest is not None and is_firm(rest):
            self._seen = rest
            self._stands_s = min(self._stands_s, latest[0].time_s)
            while waiting[0].time_s < latest[0].time_s:
                waiting.popleft()
            self._stand(rest, sample.time_s)
            return None
        if self._seen is not None:
            return self._leave(self._seen, sample.time_s)
        if span >= config.seek_after_s:
            start = self._met(rest)
            samples = tuple(waiting)
            return Begin(
                samples[0].time_s, start, TURN_UNDER_WAY, self._known_rest, False, 0.0, samples
            )
        return None

    def _stand(self, rest: Rest, time_s: float) -> None:
        # Nothing but time tells a brief rest from a long one: as yet it is what it seems.
        start, _ = self._standing_since(rest, math.inf, likeliest=True)
        h, P = mixture(start.X, start.P, start.log_weight)
        lost = 1.0 - float(np.exp(start.log_weight[h]))
        self.standing = TrackState(time_s, start.X[h], P, lost)

    def _leave(self, seen: Rest, time_s: float) -> Begin:
        turn = TURN_AT_REST if self.place[1] <= PLACE_ALONE_M else TURN_UNDER_WAY
        lasted_s = time_s - self._stands_s
        start, elsewhere = self._standing_since(seen, lasted_s)
        hasty = elsewhere or lasted_s < SURE_REST_S
        rest, way = self._known_rest if hasty else seen, 0.0
        if not hasty and len(self._line.passes):
            way = float(np.sign(self._line.passes[0, 1]))
        samples = tuple(self._waiting)
        return Begin(samples[0].time_s, start, turn, rest, hasty, way, samples)

    def _standing_since(
        self, seen: Rest, lasted_s: float, likeliest: bool = False
    ) -> tuple[Hypotheses, bool]:
        """
        Return hypotheses of a train that stood as ``seen`` so long, and whether some are elsewhere.

        ``likeliest``: of those in the station only the one that weighs most.
        """
        place = (self._line, *self.place)
        if self._known_rest is not None and lasted_s < SURE_REST_S:
            return at_rest(*place, self._known_rest, self._config, True, math.inf, likeliest), False
        start = at_rest(*place, seen, self._config, False, lasted_s, likeliest)
        if sits_as_told(self._line, self.place[0], seen, self._config):
            return start, False
        elsewhere = slow_elsewhere(self._line, seen, self._config)
        if elsewhere is None:
            return start, False
        return either(start, elsewhere, TILTED_STATION_SHARE), True

    def _met(self, loose: Rest | None) -> Hypotheses:
        """
        Return hypotheses of a train that never stood for certain.

        It may be anywhere; or, where it shakes as little as in ``loose``, in the station still.
        """
        config, rest = self._config, self._known_rest
        M, bias = np.eye(3), (np.zeros(3), config.gyro_bias_sigma)
        free = math.radians(config.mount_sigma_deg) ** 2 * np.eye(3)
        if rest is not None:
            # Gravity told then how the sensor is tilted.
            place = (self._line, *self.place)
            levelled = at_rest(*place, rest, config, leaves=True, likeliest=True)
            M, bias = levelled.X[0, 11:20].reshape(3, 3), (rest.rate, DRIFT)
            mount = slice(line_state.MOUNT, line_state.MOUNT + 3)
            free = levelled.P[0, mount, mount]
        anywhere = under_way(self._line, self.place[0], M, bias, free, config)
        if loose is None:
            return anywhere
        standing = at_rest(self._line, *self.place, rest or loose, config, leaves=rest is not None)
        return either(standing, anywhere, STATION_SHARE)
