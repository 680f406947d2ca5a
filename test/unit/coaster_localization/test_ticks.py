"""Samples of any rate into ticks; stamps that may be believed."""

import numpy as np
import pytest

from coaster_localization.stamps import BELIEVED_AFTER, GAP, GOOD, RESTART, StampCheck
from coaster_localization.ticks import FORCE, RATE, SHAKE, VERTICAL, LowPass, Ticker
from track_localization.estimation import so3


def ticks(time_s, force, rate, rate_hz=25.0):
    ticker = Ticker(rate_hz, 1.0)
    out = []
    for t, f, w in zip(time_s, force, rate, strict=True):
        out += ticker.push(float(t), f, w)
    return np.array([t for t, _ in out]), np.array([row for _, row in out])


@pytest.mark.parametrize('native_hz', [20.0, 90.0, 100.0, 1000.0])
def test_rows_are_means_over_their_ticks(native_hz):
    """Of a line of constant slope the mean is the value in the middle, at any rate."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 8, 1 / native_hz)
    t = 50.0 + t + rng.uniform(0, 0.3 / native_hz, len(t))
    slope = np.array([1.0, -2.0, 0.5])
    middle, rows = ticks(t, 3.0 + (t - 50.0)[:, None] * slope, np.zeros((len(t), 3)))
    np.testing.assert_allclose(np.diff(middle), 0.04, atol=1e-9)
    np.testing.assert_allclose(rows[:, FORCE], 3.0 + (middle - 50.0)[:, None] * slope, atol=1e-8)
    assert len(rows) == pytest.approx(8 * 25, abs=4)


def test_vertical_follows_the_rate():
    t = np.arange(0, 10, 0.01)
    rate = np.tile([0.0, 0.3, 0.0], (len(t), 1))
    middle, rows = ticks(t, np.zeros((len(t), 3)), rate)
    expected = so3.exp(np.stack([0 * middle, 0.3 * middle, 0 * middle], axis=-1))[:, 2]
    np.testing.assert_allclose(rows[:, VERTICAL], expected, atol=1e-3)


def test_mount_and_bias_are_taken_out():
    R, bias = so3.matrix_from_rpy(0.3, -0.2, 1.0), np.array([0.01, -0.02, 0.03])
    ticker = Ticker(25.0, 1.0)
    ticker.R_bm, ticker.gyro_bias = R, bias
    body_force, body_rate = np.array([1.0, 2.0, 9.0]), np.array([0.0, 0.1, 0.4])
    found = []
    for k in range(50):
        found += ticker.push(k * 0.01, R.T @ body_force, R.T @ body_rate + bias)
    row = ticker.in_body(found[-1][1])
    np.testing.assert_allclose(row[FORCE], body_force, atol=1e-12)
    np.testing.assert_allclose(row[RATE], body_rate, atol=1e-12)


def test_shaking_is_the_change_from_sample_to_sample():
    rng = np.random.default_rng(4)
    n = 20000
    _, rows = ticks(np.arange(n) * 0.01, rng.normal(0, 0.1, (n, 3)), rng.normal(0, 0.02, (n, 3)))
    np.testing.assert_allclose(rows[:, SHAKE].mean(axis=0), [6 * 0.1**2, 6 * 0.02**2], rtol=0.05)


def test_low_pass_goes_on_where_it_was():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(200, 3))
    whole = LowPass(25.0, 2.5)(rows)
    parts = LowPass(25.0, 2.5)
    np.testing.assert_allclose(np.vstack([parts(r[None]) for r in rows]), whole, atol=1e-12)
    still = LowPass(25.0, 2.5)
    np.testing.assert_allclose(still(np.full((50, 1), 7.0)), 7.0)


def test_good_stamps_pass_and_stray_ones_do_not():
    check = StampCheck(1.0)
    assert [check(t) for t in (10.0, 10.01, 10.02)] == [GOOD] * 3
    assert check(10.02) == 'repeated_time'
    assert check(9.5) == 'backward_time'
    assert check(3e7) == 'time_leap'
    assert check(float('nan')) == 'not_finite'
    assert check(float('inf')) == 'not_finite'
    assert check(10.03) == GOOD


@pytest.mark.parametrize(('jump', 'verdict'), [(500.0, GAP), (-9.0, RESTART)])
def test_a_stream_that_leaps_is_believed_after_a_few(jump, verdict):
    check = StampCheck(1.0)
    for k in range(10):
        check(10.0 + 0.01 * k)
    verdicts = [check(10.1 + jump + 0.01 * k) for k in range(BELIEVED_AFTER + 2)]
    assert verdicts[BELIEVED_AFTER - 1 :] == [verdict, GOOD, GOOD]
    assert verdict not in verdicts[: BELIEVED_AFTER - 1]
