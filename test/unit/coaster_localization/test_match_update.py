"""The match update held to the line, against a numerical minimum of the same cost."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from coaster_localization.config import EskfConfig
from coaster_localization.estimate import FusedState
from coaster_localization.match_update import MatchUpdate, usual_speeds
from coaster_localization.observation import MatchObservation, observation_covariance
from track_localization.estimation import eskf
from track_localization.estimation.so3 import quat_from_matrix
from track_localization.track.centreline import Centreline
from track_localization.track.design_ride import DesignRide
from track_localization.track.line_table import LineTable

RADIUS = 20.0
NAN = float('nan')


@pytest.fixture(scope='module')
def circle():
    """A level circle to the left, 20 m, ridden at 10 m/s."""
    s = np.arange(0.0, 2 * np.pi * RADIUS, 0.1)
    c, sn, zero = np.cos(s / RADIUS), np.sin(s / RADIUS), np.zeros_like(s)
    position = RADIUS * np.stack([sn, 1.0 - c, zero], axis=1)
    forward, left = np.stack([c, sn, zero], axis=1), np.stack([-sn, c, zero], axis=1)
    R = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    none = np.zeros((len(s), 3))
    ride = DesignRide(s / 10.0, s, position, quat_from_matrix(R), 10.0 * forward, none, none)
    return LineTable(Centreline.from_design_ride(ride))


def state_at(line, s, sigma):
    R = line.axes[line.index(s)]
    sigmas = (np.full(3, sigma), np.full(3, 1e-3), np.full(3, 1e-3), 1e-3, 1e-4, 1e-3)
    nav = eskf.make_state(10.0, line.point(s), 10.0 * R[:, 0], R, np.array([0, 0, -9.8]), sigmas)
    return FusedState(nav, s, NAN, NAN, 10.0)


def match_at(line, s, sigma, time_s=10.0):
    R = line.axes[line.index(s)]
    V = observation_covariance(R, sigma**2, 1e-4, 1e-4)
    return MatchObservation(time_s, line.point(s), quat_from_matrix(R), V, s)


def test_update_finds_the_least_cost_on_the_curve(circle):
    """Prior 3 m wide about 30 m, match 2 m wide at 36 m: the estimate stays on the circle."""
    config = EskfConfig(line_sigma_m=0.01)
    state = MatchUpdate(circle, config)(state_at(circle, 30.0, 3.0), match_at(circle, 36.0, 2.0))
    prior = circle.point(30.0)

    def cost(s):
        angle = float(s[0]) / RADIUS
        p = RADIUS * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        return float((p - prior) @ (p - prior)) / 9.0 + (float(s[0]) - 36.0) ** 2 / 4.0

    best = minimize(cost, [33.0]).x[0]
    found = state.nav.position
    radius = np.linalg.norm(found - [0.0, RADIUS, 0.0])
    # What is left of the curve's bend in the posterior (sigma 1.7 m) is allowed for across.
    assert radius == pytest.approx(RADIUS, abs=0.1)
    assert circle.project(found, 33.0) == pytest.approx(best, abs=0.1)


def test_the_paper_s_form_leaves_the_curve_where_the_match_is_far(circle):
    """Why the line is used: the straight-line form ends up inside the circle."""
    config = EskfConfig(preset='paper', lambda_x=4.0, n=1e4)
    state = MatchUpdate(circle, config)(state_at(circle, 30.0, 3.0), match_at(circle, 42.0, 2.0))
    assert np.linalg.norm(state.nav.position - [0.0, RADIUS, 0.0]) < RADIUS - 0.3


def test_close_matches_weigh_less_and_slow_ones_least(circle):
    """Ten matches in a second say little more than one; at walking pace hardly more at all."""

    def sigma_after(speed, count):
        state = state_at(circle, 30.0, 5.0)
        x = state.nav.x.copy()
        x[3:6] *= speed / 10.0
        state = state._replace(nav=state.nav._replace(x=x))
        update = MatchUpdate(circle, EskfConfig())
        for k in range(count):
            nav = state.nav._replace(time_s=10.0 + 0.1 * k)
            state = update(state._replace(nav=nav), match_at(circle, 30.0, 2.0, 10.0 + 0.1 * k))
        t = circle.axes[circle.index(30.0), :, 0]
        return float(np.sqrt(t @ state.nav.P[0:3, 0:3] @ t))

    fast, slow, once = sigma_after(20.0, 10), sigma_after(2.0, 10), sigma_after(20.0, 1)
    white = once / np.sqrt(10.0)
    assert white < fast < once
    assert fast < slow <= once + 1e-9


def test_a_filter_that_thinks_it_crawls_is_still_told_how_fast_the_train_goes(circle):
    """Else the slower it thinks it goes the less it listens, and is left behind for good."""
    crawling = state_at(circle, 30.0, 3.0)
    x = crawling.nav.x.copy()
    x[3:6] *= 0.02
    crawling = crawling._replace(nav=crawling.nav._replace(x=x), last_match_s=9.8)
    pulled = {}
    for name, speed in (('alone', None), ('told', np.full(len(circle.position), 10.0))):
        update = MatchUpdate(circle, EskfConfig(), speed)
        after = update(crawling, match_at(circle, 34.0, 2.0))
        pulled[name] = circle.project(after.nav.position, 30.0) - 30.0
    assert pulled['told'] > 0.5
    assert pulled['alone'] < 0.05


def test_usual_speeds_are_the_design_s_over_the_seam_of_a_lap():
    """A ride that begins 26 m into its lap and ends there: 40 m before the seam it goes 14 m/s."""
    s = np.arange(26.0, 26.0 + 2 * np.pi * RADIUS, 0.1)
    c, sn, zero = np.cos(s / RADIUS), np.sin(s / RADIUS), np.zeros_like(s)
    position = RADIUS * np.stack([sn, 1.0 - c, zero], axis=1)
    forward, left = np.stack([c, sn, zero], axis=1), np.stack([-sn, c, zero], axis=1)
    R = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    speed = 10.0 + (s - 26.0) / 20.0
    time_s = np.concatenate([[0.0], np.cumsum(0.1 / speed[1:])])
    none = np.zeros((len(s), 3))
    design = DesignRide(
        time_s, s, position, quat_from_matrix(R), speed[:, None] * forward, none, none
    )
    line = LineTable(Centreline.from_design_ride(design))
    usual = usual_speeds(line, design)
    for chainage in (40.0, 100.0, 120.0, 127.0, 140.0):
        row = line.index(line.nearest(np.array([np.interp(chainage, s, p) for p in position.T])))
        assert usual[row] == pytest.approx(10.0 + (chainage - 26.0) / 20.0, abs=0.1)


def test_matches_that_steadily_disagree_are_believed_though_none_is_refused(circle):
    """Weighed less for their distance and for being alike, they would never win otherwise."""
    update = MatchUpdate(circle, EskfConfig(relocate_s=2.0))
    state = state_at(circle, 30.0, 0.3)
    for k in range(14):
        time_s = 10.0 + 0.2 * k
        still = state.nav._replace(
            time_s=time_s, x=np.r_[state.nav.x[:3], np.zeros(3), state.nav.x[6:]]
        )
        still.P[3:6, 3:6] += 0.01 * np.eye(3)
        before = state._replace(nav=still)
        state = update(before, match_at(circle, 34.0, 0.8, time_s))
        assert 9.0 < update.last_nis < 50.0 or time_s >= 12.0
    assert not update.refused
    assert len(update.relocated) == 1
    assert circle.project(state.nav.position, 34.0) == pytest.approx(34.0, abs=0.5)


def test_a_train_that_stands_is_not_moved_by_matches_that_repeat_themselves(circle):
    update = MatchUpdate(circle, EskfConfig(relocate_s=2.0))
    state = state_at(circle, 30.0, 0.3)
    nav = state.nav._replace(x=np.r_[state.nav.x[:3], np.zeros(3), state.nav.x[6:]])
    nav.P[3:6, 3:6] = 1e-4 * np.eye(3)
    state = state._replace(nav=nav)
    for k in range(100):
        state = state._replace(nav=state.nav._replace(time_s=10.0 + 0.2 * k))
        state = update(state, match_at(circle, 34.0, 0.8, 10.0 + 0.2 * k))
    assert not update.relocated
    assert circle.project(state.nav.position, 30.0) == pytest.approx(30.5, abs=0.5)


def test_a_match_off_the_gate_is_refused_then_believed(circle):
    config = dataclasses.replace(EskfConfig(), relocate_s=1.0)
    update = MatchUpdate(circle, config)
    state = state_at(circle, 30.0, 0.3)
    for k in range(6):
        time_s = 10.0 + 0.25 * k
        nav = state.nav._replace(time_s=time_s)
        before = state._replace(nav=nav)
        state = update(before, match_at(circle, 60.0, 0.5, time_s))
        if k < 4:
            assert state.nav is nav
            assert state.doubted_since_s == 10.0
    assert len(update.refused) == 4
    assert len(update.relocated) == 1
    assert np.linalg.norm(state.nav.position - circle.point(60.0)) < 1.0
