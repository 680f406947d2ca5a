"""What straights tell the train's filter: kernels by finite differences, drives made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from track_localization.cli.train.reproduce_runs import measurements
from track_localization.estimation import so3
from track_localization.estimation.earth import earth_rate, gravity, transport_rate
from track_localization.estimation.ins import inject
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from train_localization import straights
from train_localization.alignment import start_at
from train_localization.config import StraightConfig, TrainConfig
from train_localization.kernels import AUX, COURSE, EARLIER, LINE, MEAN, SIZE, apart, moved
from train_localization.measurements import WheelSpeed
from train_localization.pipeline import TrainPipeline
from train_localization.robust_filter import RobustFilter
from train_localization.state import Stretch
from train_localization.straights import Marks

V, EPOCH_S, STEP = 50.0, 0.1, 1e-4
DPH = math.radians(1.0) / 3600.0


@pytest.fixture
def state(rng):
    """A train in a curve to the left, everything a little off."""
    R = so3.matrix_from_rpy(0.06, -0.02, 0.8)
    nav = np.concatenate([[0.7, 2.0, 300.0], R @ [50.0, 0.4, -0.3], so3.quat_from_matrix(R)])
    root = 0.1 * rng.standard_normal((SIZE, SIZE)) + np.diag(np.full(SIZE, 0.5))
    return nav, 1e-3 * rng.standard_normal(AUX), root @ root.T


def test_the_course_and_its_row(state):
    """The angle from east to north of the first axis, central differences for the row."""
    nav, _, _ = state
    h, slopes = np.zeros(SIZE), np.zeros(SIZE)
    assert straights.course(nav, h) == pytest.approx(0.8)
    for k in range(SIZE):
        ends = []
        for step in (STEP, -STEP):
            dx, there = np.zeros(SIZE), nav.copy()
            dx[k] = step
            inject(there, dx)
            ends.append(straights.course(there, np.zeros(SIZE)))
        slopes[k] = (ends[0] - ends[1]) / (2.0 * STEP)
    np.testing.assert_allclose(h, slopes, atol=1e-7)


R = 0.3


def carried(nav, aux, P, marks, way_m):
    nav, aux, P, Phi = nav.copy(), aux.copy(), P.copy(), np.eye(SIZE)
    return aux, P, Phi, straights.carry(nav, aux, P, marks, way_m, R, Phi)


@pytest.mark.parametrize('due', [0, 1, 2])
def test_marking_is_the_transition_that_it_says(state, due):
    """Nominal states by finite differences of the errors put in, the covariance by F P F' + Q."""
    nav, aux, P = state
    marks = Marks(way_m=20.0, reference=0.79, convergence=0.002, due=due, marked_m=25.0)
    plain, covariance, Phi, after = carried(nav, aux, P, marks, 5.0)
    Q = np.zeros((SIZE, SIZE))
    Q[LINE, LINE] = R if due == 2 else 0.0
    np.testing.assert_allclose(covariance, Phi @ P @ Phi.T + Q, rtol=1e-12, atol=1e-12)
    for k in range(SIZE):
        dx, there = np.zeros(SIZE), nav.copy()
        dx[k] = STEP
        inject(there, dx)
        moved_aux = aux + dx[9:]
        got, _, _, then = carried(there, moved_aux, P, marks, 5.0)
        # The mean is told from a reference, which moves with the mark.
        got[MEAN - 9] += 5.0 * (then.reference - after.reference) if due else 0.0
        expected = Phi[9:, k].copy()
        np.testing.assert_allclose((got - plain) / STEP, expected, atol=2e-3)
    assert after.due == 0
    assert after.way_m == 25.0
    if due == 2:
        assert plain[LINE - 9] == aux[EARLIER - 9]
    if due:
        assert plain[EARLIER - 9] == aux[COURSE - 9]
        assert plain[COURSE - 9] == pytest.approx(0.79 + aux[MEAN - 9] / 25.0)


def test_a_straight_that_fits_is_held_as_the_textbook_says(state):
    nav, aux, P = state
    h = np.zeros(SIZE)
    h[EARLIER], h[LINE] = 1.0, -1.0
    K = P @ h / (h @ P @ h + R)
    dx = -K * (aux[EARLIER - 9] - aux[LINE - 9])
    expected = nav.copy()
    inject(expected, dx)
    told = nav.copy(), aux.copy(), P.copy()
    assert straights.hold(*told, R)
    np.testing.assert_allclose(told[0], expected, atol=1e-12)
    np.testing.assert_allclose(told[1], aux + dx[9:], atol=1e-12)
    np.testing.assert_allclose(told[2], P - np.outer(K, h @ P), atol=1e-12)


def test_a_line_that_turned_is_not_held(state):
    nav, aux, P = state
    aux[EARLIER - 9] = 3.0
    told = nav.copy(), aux.copy(), 1e-3 * P
    assert not straights.hold(*told, 1e-6)
    np.testing.assert_array_equal(told[0], nav)
    np.testing.assert_array_equal(told[2], 1e-3 * P)


def test_courses_are_compared_across_west(state):
    """From pi to -pi is no turn."""
    _, aux, _ = state
    aux[COURSE - 9], aux[MEAN - 9] = math.pi - 1e-5, 0.0
    P = np.zeros((SIZE, SIZE))
    assert straights.most_turned(aux, P, -math.pi + 1e-5, 25.0, 1e-8) == pytest.approx(2e-5)


def drive(seconds, settings, latitude=0.7, course=np.pi / 2, radius_m=math.inf, bias_dph=0.0):
    """
    Drive without a fix, its gyro biased about the vertical; return state, level error [m].

    Along a geodesic, or from it in a curve to the left; nothing else is wrong, and the level plane
    is taken for the Earth's surface, over 5 km.
    """
    filter_ = RobustFilter(override(TrainConfig(), settings))
    begin = np.array([latitude, 0.3, 0.0])
    covariance = np.diag([1e-4, 1e-4, 1e-4, 1e-8, 1e-8, 1e-8])
    R_nb = so3.matrix_from_rpy(0.0, 0.0, course)
    state = filter_.start(start_at(0.0, begin, R_nb, covariance, V, 0.02))
    earth, transport = np.empty(3), np.empty(3)
    own, fine = V / radius_m, 10
    place, angle, true = np.zeros(2), course, state.nav.copy()
    for k in range(1, round(seconds / EPOCH_S) + 1):
        rates, forces, dt = [], [], EPOCH_S / fine
        for _ in range(fine):
            place = place + V * dt * np.array([math.cos(angle), math.sin(angle)])
            true[:3] = moved(begin, np.array([*place, 0.0]))
            east = V * math.cos(angle) / 6385e3
            angle += (own - east * math.tan(true[0])) * dt
            v = np.array([V * math.cos(angle), V * math.sin(angle), 0.0])
            true[3:6] = v
            earth_rate(true[0], earth)
            transport_rate(true, transport)
            turn = own - east * math.tan(true[0])
            R = so3.matrix_from_rpy(0.0, 0.0, angle)
            pull = np.array([0.0, 0.0, gravity(true[0], 0.0)])
            pull += turn * np.array([-v[1], v[0], 0.0]) + np.cross(2.0 * earth + transport, v)
            rates.append(R.T @ (earth + transport) + [0.0, 0.0, turn + bias_dph * DPH])
            forces.append(R.T @ pull)
        t = k * EPOCH_S
        stamps = t - EPOCH_S + EPOCH_S * np.arange(1, fine + 1) / fine
        stretch = Stretch(t, stamps, np.array(rates), np.array(forces))
        for heard in (stretch, WheelSpeed(t, V, 0.01)):
            state = filter_.apply(state, heard)
    return state, float(np.hypot(*apart(true, *state.nav[:3])[:2]))


PLAIN = {'wheel.mounting_sigma_deg': 1e-3, 'wheel.delay_s': 0.0}
NOT = {**PLAIN, 'straight.used': False}


def test_a_gyro_that_drifts_is_found_out_on_a_straight():
    """10 deg/h over 60 s at 50 m/s are 4.4 m to the side; the straight shows the drift."""
    drifted, off_m = drive(60.0, NOT, bias_dph=10.0)
    held, on_m = drive(60.0, PLAIN, bias_dph=10.0)
    assert off_m > 3.0
    assert on_m < 0.5
    assert held.aux[2] / DPH == pytest.approx(10.0, abs=2.0)
    assert drifted.aux[2] / DPH < 3.0
    assert held.P[8, 8] < 0.2 * drifted.P[8, 8]
    assert held.marks.anchored


def test_nothing_is_held_in_a_curve():
    """6 km of radius: the filter is the one that knows of no straights."""
    other, off_m = drive(30.0, NOT, radius_m=6000.0, bias_dph=5.0)
    curved, on_m = drive(30.0, PLAIN, radius_m=6000.0, bias_dph=5.0)
    assert not curved.marks.anchored
    assert curved.marks.straights == 0
    assert on_m == pytest.approx(off_m, abs=0.01)
    assert curved.P[8, 8] == pytest.approx(other.P[8, 8], rel=1e-3)


@pytest.mark.parametrize('course', [0.0, math.pi])
def test_a_straight_is_a_geodesic(course):
    """At 70 N a train to the east turns by 4 deg/h against north on a straight: no drift."""
    held, off_m = drive(60.0, PLAIN, latitude=1.2, course=course)
    assert held.marks.anchored
    assert abs(held.aux[2]) < 0.5 * DPH
    assert off_m < 0.5


def test_a_long_bow_is_believed_no_second_time():
    """A radius of 100 km is that of no curve: once refused, twenty chords must lie in line."""
    drifted, _ = drive(60.0, PLAIN, radius_m=100e3)
    assert abs(drifted.aux[2]) < 12.0 * DPH
    assert not drifted.marks.anchored


def test_the_first_mark_makes_no_chord(state):
    """Nothing is known of the way before it; what gathered in the mean till then is forgotten."""
    nav, aux, P = state
    marks = straights.tell(nav, aux, P, Marks(), StraightConfig())
    assert marks.straights == -1
    after, covariance, _, then = carried(nav, aux, P, marks, 5.0)
    assert then.way_m == 5.0
    assert after[COURSE - 9] == pytest.approx(0.8)
    assert after[MEAN - 9] == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(covariance).all()


def test_marks_wait_for_their_distance(state):
    nav, aux, P = state
    marks = Marks(way_m=24.0, reference=0.8)
    assert straights.tell(nav, aux, P, marks, StraightConfig()) is marks


def judged(seed, settings):
    """Return true chainage (N,) at the estimates of a run, whether told straight, and curves."""
    run = simulate_train(override(scenario('paper'), settings), seed)
    pipeline = TrainPipeline(TrainConfig(), None, run.datum)
    start = run.start
    pipeline.set_start(start.time_s, start.position, start.quaternion, start.covariance)
    told = []
    for measurement in measurements(run):
        for estimate in pipeline.push(measurement):
            told.append((estimate.time_s, pipeline.diagnostics()['on_straight'] == 'yes'))
    time_s, straight = np.array(told).T
    chainage = np.interp(time_s, run.time_s, run.chainage)
    return chainage, straight > 0.5, np.array(run.info['curves_m']).reshape(-1, 2)


@pytest.mark.parametrize('seed', [3, 4, 5])
@pytest.mark.parametrize('grade', ['industrial', 'mems'])
def test_straights_of_a_simulated_line_are_found_and_curves_are_not_taken_for_them(seed, grade):
    """
    Five chords of 25 m must lie in line; a curve is noticed within 120 m, and chords judged till
    then end 50 m before.

    After the first kilometre, in which a MEMS gyro is not known well enough to tell.
    """
    chainage, told, curves = judged(seed, {'imu.grade': grade})
    later = chainage > 1500.0
    inside = np.zeros(len(chainage), dtype=bool)
    beside = np.zeros(len(chainage), dtype=bool)
    for begin, end in curves:
        inside |= (chainage > begin + 120.0) & (chainage < end)
        beside |= (chainage > begin) & (chainage < end + 150.0)
    assert not told[inside].any()
    assert (~beside & later).sum() > 100
    assert told[~beside & later].mean() > 0.8
