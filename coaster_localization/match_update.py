"""
Correcting the filter by a match: the paper's form, and the form that is held to the line.

The paper takes the matched point as the position, with eq. (21)'s covariance. That is linear, so a
match three metres off in a curve of ten metres' radius also pulls half a metre sideways. The other
form takes the match for what it is, a chainage, and the line for what it is, the place where the
train must be: the innovation is formed where the estimate, not the match, says the train is, and
is iterated (an iterated Kalman update on the curve).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coaster_localization.config import EskfConfig
from coaster_localization.estimate import FusedState
from coaster_localization.observation import MatchObservation
from track_localization.estimation import eskf
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_table import LineTable

Array = NDArray[np.float64]

ITERATIONS = 4
STANDS_MPS = 0.1
SLOWEST = 0.5
"""Speed that turns a correlation length into a time, at least [m/s]."""


def usual_speeds(line: LineTable, design: DesignRide) -> Array:
    """Return the design's speed (M,) at every row of the line, of passes one after the other."""
    rows = line.step_m * np.arange(len(line.position))
    order = np.argsort(design.chainage, kind='stable')
    period = line.length if line.closed else None
    return np.interp(rows, design.chainage[order], design.speed[order], period=period)


def surely_stands(nav: eskf.State) -> bool:
    """Return whether the filter knows that the train stands."""
    sigma = float(np.sqrt(np.trace(nav.P[3:6, 3:6])))
    return sigma < STANDS_MPS and float(np.linalg.norm(nav.velocity)) < STANDS_MPS


class MatchUpdate:
    """
    Update of a ``FusedState`` by a match, with gate and recovery.

    Attributes:
        last_nis: NIS along the track of the latest match that was tried.
        refused: matches refused by the gate, replays not counted twice.
    """

    def __init__(
        self, line: LineTable, config: EskfConfig, usual_speed: Array | None = None
    ) -> None:
        """
        Prepare for a line.

        ``usual_speed`` (M,), for every row of it [m/s], tells how long a match's errors last where
        the filter's own speed is wrong; a filter that thinks that it crawls would else weigh the
        matches away that say how fast it goes.
        """
        self.line = line
        self.config = config
        self._usual_speed = usual_speed
        self.last_nis = float('nan')
        self.refused: set[float] = set()
        self.relocated: set[float] = set()

    def __call__(self, state: FusedState, match: MatchObservation) -> FusedState:
        """Return the state after the match, or with the refusal noted."""
        if self.config.preset == 'paper':
            return self._paper(state, match)
        return self._on_line(state, match)

    def _paper(self, state: FusedState, match: MatchObservation) -> FusedState:
        """Apply eqs (21)-(27): fixed lambdas along the vehicle's axes."""
        nav = state.nav
        lambda_x = self.config.lambda_x
        lambda_y = lambda_x / self.config.n
        V = (nav.R_nb * (lambda_x, lambda_y, lambda_y)) @ nav.R_nb.T
        H = np.zeros((3, eskf.ERROR_STATES))
        H[:, eskf.POSITION] = np.eye(3)
        dt = match.time_s - nav.time_s
        H[:, eskf.VELOCITY] = np.eye(3) * dt
        nu = match.position - nav.position - nav.velocity * dt
        self.last_nis = eskf.nis(nav, nu, H, V)
        nav = eskf.update(nav, nu, H, V)
        return self._done(state, nav, match)

    def _on_line(self, state: FusedState, match: MatchObservation) -> FusedState:
        nav, line = state.nav, self.line
        dt = match.time_s - nav.time_s
        p = nav.position + nav.velocity * dt
        s_match = line.project(match.position, self._chainage_of(match))
        i = line.index(s_match)
        tangent = line.axes[i, :, 0]
        variance = float(tangent @ match.covariance @ tangent)
        s_pred = line.project(p, state.chainage)
        tangent = line.axes[line.index(s_pred), :, 0]
        along = line.difference(s_match, s_pred) * float(line.stretch[line.index(s_pred)])
        var_pred = float(tangent @ nav.P[0:3, 0:3] @ tangent)
        nis = along**2 / (var_pred + variance)
        self.last_nis = nis
        since = float('nan')
        stands = surely_stands(nav)
        if nis > self.config.gate_nis:
            begins = stands or np.isnan(state.doubted_since_s)
            since = match.time_s if begins else state.doubted_since_s
            if match.time_s - since >= self.config.relocate_s:
                nav = self._relocate(nav, match, along)
                self.relocated.add(match.time_s)
                since = float('nan')
            elif nis > self.config.reject_nis:
                self.refused.add(match.time_s)
                return state._replace(doubted_since_s=since)
            else:
                variance *= nis / self.config.gate_nis
        # One place has one error, however often a train that stands there is matched.
        usual = 0.0 if stands or self._usual_speed is None else float(self._usual_speed[i])
        speed = max(float(np.linalg.norm(nav.velocity)), usual, SLOWEST)
        config = self.config
        persists_s = config.match_correlation_s * max(1.0, config.match_slow_mps / speed) ** 2
        variance *= self._thinning(state, match, persists_s)
        across = self._thinning(state, match, config.line_correlation_m / speed)
        nav = self._iterate(nav, dt, s_match, variance, config.line_sigma_m**2 * across)
        return self._done(state, nav, match)._replace(doubted_since_s=since)

    def _iterate(
        self, nav: eskf.State, dt: float, s_match: float, variance: float, cross: float
    ) -> eskf.State:
        """Update with the line taken at the estimate that the update itself leads to."""
        line = self.line
        s = line.project(nav.position + nav.velocity * dt, s_match)
        prior_var = float(np.trace(nav.P[0:3, 0:3]))
        if variance < prior_var:
            s = s_match
        new = nav
        for _ in range(ITERATIONS):
            i = line.index(s)
            R_line = line.axes[i]
            nu = -R_line.T @ (nav.position + nav.velocity * dt - line.point(s))
            nu[0] += line.difference(s_match, s) * line.stretch[i]
            sigma2 = 1.0 / (1.0 / variance + 1.0 / max(prior_var, 1e-6))
            cross_var = cross + (0.5 * line.bend[i] * sigma2) ** 2
            H = np.zeros((3, eskf.ERROR_STATES))
            H[:, eskf.POSITION] = R_line.T
            H[:, eskf.VELOCITY] = R_line.T * dt
            new = eskf.update(nav, nu, H, np.diag([variance, cross_var, cross_var]))
            s_new = line.project(new.position + new.velocity * dt, s)
            moved = abs(line.difference(s_new, s))
            s = s_new
            if moved < 0.05:
                break
        return new

    def _relocate(self, nav: eskf.State, match: MatchObservation, along: float) -> eskf.State:
        """Admit that the filter was wrong: open its position and speed to what the match says."""
        P = nav.P.copy()
        P[0:3, 0:3] += np.eye(3) * along**2
        P[3:6, 3:6] += np.eye(3) * 4.0
        x = nav.x.copy()
        x[0:3] = match.position
        return nav._replace(x=x, P=P)

    def _done(self, state: FusedState, nav: eskf.State, match: MatchObservation) -> FusedState:
        chainage = self.line.project(nav.position, self._chainage_of(match))
        return state._replace(nav=nav, chainage=chainage, last_match_s=match.time_s)

    def _thinning(self, state: FusedState, match: MatchObservation, correlation_s: float) -> float:
        """Return the factor by which close matches weigh less: their errors are the same ones."""
        since = match.time_s - state.last_match_s
        if np.isnan(since) or correlation_s <= 0.0:
            return 1.0
        return max(1.0, 2.0 * correlation_s / max(since, 1e-3))

    def _chainage_of(self, match: MatchObservation) -> float:
        if np.isfinite(match.chainage):
            return match.chainage
        return self.line.nearest(match.position)
