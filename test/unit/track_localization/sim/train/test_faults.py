"""Bad data: each fault alone, and nothing else changed."""

import numpy as np
import pytest

from track_localization.geodesy import enu_from_geodetic
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.sim.train.config import Faults
from track_localization.sim.train.scenarios import SCENARIOS


def run(name='paper', seed=1, **faults):
    return simulate_train(
        override(scenario(name), {f'faults.{k}': v for k, v in faults.items()}), seed
    )


@pytest.fixture(scope='module')
def good():
    return run()


def same(a, b, *names):
    for name in names:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_all_are_off_by_default_and_on_in_bad():
    assert Faults() == Faults(0.0, 0, 100.0, 0.0, 0.0, 0.0, False, False, False, False, False)
    on = {name for name in SCENARIOS['bad'] if name.startswith('faults.')}
    assert on == {
        *('faults.nan', 'faults.time_jumps', 'faults.imu_gap_s', 'faults.stuck_s'),
        *('faults.gnss_outlier_m', 'faults.no_covariance', 'faults.stale_no_fix'),
        'faults.no_hdop',
    }


def test_nan(good):
    """1 % of samples of each sensor, by the IMU in force or rate; the others as they were."""
    bad = run(nan=0.01)
    force = np.isnan(bad.imu.specific_force).any(axis=1)
    rate = np.isnan(bad.imu.angular_rate).any(axis=1)
    assert (force | rate).mean() == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 20001))
    assert not (force & rate).any()
    assert min(force.sum(), rate.sum()) > 50
    np.testing.assert_array_equal(bad.imu.specific_force[~force], good.imu.specific_force[~force])
    off = np.isnan(bad.wheel.speed)
    assert off.mean() == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / 2000))
    np.testing.assert_array_equal(bad.wheel.speed[~off], good.wheel.speed[~off])
    off = np.isnan(run(nan=0.2).gnss.latitude) & good.gnss.status
    assert off[good.gnss.status].mean() == pytest.approx(0.2, abs=4 * np.sqrt(0.16 / 150))
    same(good.imu, bad.imu, 'time_s')
    same(good.wheel, bad.wheel, 'time_s')


def test_time_jumps(good):
    """Two spells of stamps that are 100 s off, either way; messages arrive as they did."""
    bad = run(time_jumps=2)
    for name, spell in (('imu', 30), ('wheel', 4), ('gnss', 2)):
        off = getattr(bad, name).time_s - getattr(good, name).time_s
        assert set(np.round(off, 6)) <= {-100.0, 0.0, 100.0}
        assert spell <= (off != 0.0).sum() <= 2 * spell
    same(good.gnss, bad.gnss, 'arrival_s', 'latitude', 'hdop')
    same(good.wheel, bad.wheel, 'arrival_s', 'speed')
    same(good, bad, 'imu_arrival_s', 'time_s', 'position')
    signs = [
        np.sign(run(seed=s, time_jumps=1).imu.time_s - good.imu.time_s).sum() for s in range(8)
    ]
    assert min(signs) == -30
    assert max(signs) == 30


def test_imu_gap(good):
    """One gap of 1.5 s; what is left is as it was."""
    bad = run(imu_gap_s=1.5)
    steps = np.diff(bad.imu.time_s)
    assert steps.max() == pytest.approx(1.51, abs=1e-6)
    assert (steps > 0.011).sum() == 1
    kept = np.isin(good.imu.time_s, bad.imu.time_s)
    np.testing.assert_array_equal(good.imu.specific_force[kept], bad.imu.specific_force)
    np.testing.assert_array_equal(bad.imu_arrival_s, bad.imu.time_s)


def test_stuck_odometer(good):
    """For 15 s it repeats one speed, while the train runs; before and after it is right."""
    bad = run('line', 2, stuck_s=15.0)
    whole = run('line', 2)
    changed = np.flatnonzero(bad.wheel.speed != whole.wheel.speed)
    stuck = slice(changed[0], changed[-1] + 1)
    t = bad.wheel.time_s[stuck]
    assert 14.0 < np.ptp(t) <= 15.0
    assert len(np.unique(bad.wheel.speed[stuck])) == 1
    assert bad.wheel.speed[changed[0]] > 5.0


def test_gnss_outlier(good):
    """Three fixes in a row, 80 m to the north, claiming nothing of it."""
    bad = run(gnss_outlier_m=80.0)
    places = [
        enu_from_geodetic(g.latitude, g.longitude, g.height, good.datum)
        for g in (good.gnss, bad.gnss)
    ]
    off = np.nan_to_num(places[1] - places[0])
    far = np.flatnonzero(np.abs(off).max(axis=1) > 1.0)
    assert len(far) == 3
    assert np.ptp(far) == 2
    np.testing.assert_allclose(off[far], [[0.0, 80.0, 0.0]] * 3, atol=1.0)
    assert bad.gnss.status[far].all()
    same(good.gnss, bad.gnss, 'covariance', 'satellites', 'hdop')


def test_no_covariance(good):
    bad = run(no_covariance=True)
    assert (bad.gnss.covariance == 0.0).all()
    same(good.gnss, bad.gnss, 'latitude', 'hdop', 'status')


def test_stale_coordinates_without_a_fix(good):
    """In the outage each message repeats the last fix before it, and says that it is none."""
    bad = run(stale_no_fix=True)
    dark = ~good.gnss.status
    last = np.flatnonzero(dark)[0] - 1
    assert (bad.gnss.latitude[dark] == good.gnss.latitude[last]).all()
    assert (bad.gnss.height[dark] == good.gnss.height[last]).all()
    same(good.gnss, bad.gnss, 'status', 'satellites')
    np.testing.assert_array_equal(bad.gnss.longitude[~dark], good.gnss.longitude[~dark])


def test_hdop_or_all_quality_missing(good):
    bad = run(no_hdop=True)
    assert np.isnan(bad.gnss.hdop).all()
    same(good.gnss, bad.gnss, 'satellites', 'latitude')
    silent = run(no_quality=True)
    assert np.isnan(silent.gnss.hdop).all()
    assert (silent.gnss.satellites == -1).all()


def test_no_wheel(good):
    bad = run(no_wheel=True)
    assert len(bad.wheel) == 0
    same(good.imu, bad.imu, 'specific_force')
