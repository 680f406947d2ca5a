"""Each scenario by name: what makes it one, measured from the streams and the truth."""

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.maglev import scenario, simulate_maglev


def run(name='line', seed=1, **changes):
    changes = {k.replace('__', '.'): v for k, v in changes.items()}
    return simulate_maglev(override(scenario(name), changes), seed)


def chainage_at(simulated, time_s):
    """Return the true chainage between the truth's samples: cubics, by speed at both ends."""
    i = np.clip(np.searchsorted(simulated.time_s, time_s) - 1, 0, len(simulated.time_s) - 2)
    h = simulated.time_s[i + 1] - simulated.time_s[i]
    u = (time_s - simulated.time_s[i]) / h
    s, v = simulated.chainage, simulated.speed
    rest = s[i + 1] - s[i]
    out = s[i] + h * u * v[i] + u**2 * (3 * rest - h * (2 * v[i] + v[i + 1]))
    return out + u**3 * (h * (v[i] + v[i + 1]) - 2 * rest)


def at_stamps(simulated, stream):
    return chainage_at(simulated, stream.time_s)


def test_the_papers_scenario():
    """Samples each second; variances of 0.01 from 50 runs (5050 draws, the variance to 2 %)."""
    loop, radar = [], []
    for seed in range(50):
        simulated = run('paper', seed)
        np.testing.assert_allclose(simulated.loop.time_s, 1000.0 + np.arange(101))
        np.testing.assert_array_equal(simulated.loop.time_s, simulated.radar.time_s)
        np.testing.assert_array_equal(simulated.loop.arrival_s, simulated.loop.time_s)
        np.testing.assert_allclose(simulated.loop.variance, 0.01)
        np.testing.assert_allclose(simulated.radar.variance, 0.01)
        loop.append(simulated.loop.value - simulated.chainage[::100])
        radar.append(simulated.radar.value - simulated.speed[::100])
        passed = int(simulated.chainage[-1] // 1000)
        assert simulated.balise.id == simulated.table.id[:passed]
        # The exact crossing time; the truth between its samples is good to a few micrometres.
        at = at_stamps(simulated, simulated.balise)
        np.testing.assert_allclose(at, 1000.0 * np.arange(1, passed + 1), atol=1e-4)
        np.testing.assert_array_equal(simulated.balise.value, 0.0)
    for error in (np.array(loop), np.array(radar)):
        assert error.var() == pytest.approx(0.01, rel=0.08)
        assert error.mean() == pytest.approx(0.0, abs=4 * 0.1 / np.sqrt(5050))


def test_the_papers_loop_as_a_counter():
    """0.14 % of the crossings of 100 runs are missed: 500 each, within four sigma of Poisson."""
    runs = [run('paper_missed', seed) for seed in range(100)]
    for simulated in runs:
        counts = simulated.loop.value / 0.2
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    crossings = sum(np.floor(r.chainage[-1] / 0.2) for r in runs)
    missed = crossings - sum(np.round(r.loop.value[-1] / 0.2) for r in runs)
    assert missed == pytest.approx(0.0014 * crossings, abs=4 * np.sqrt(0.0014 * crossings))
    absolute = run('paper', 5)
    np.testing.assert_array_equal(absolute.chainage, run('paper_missed', 5).chainage)


def test_clean_is_quantised_and_complete():
    """Nothing missing, the loop within a pitch, the radar within five sigma of its noise."""
    simulated = run('clean', 2)
    assert len(simulated.loop) >= 471 * 50
    assert len(simulated.balise) == 6
    behind = at_stamps(simulated, simulated.loop) - simulated.loop.value
    assert behind.min() > -1e-4
    assert behind.max() < 0.2 + 1e-4
    v = np.interp(simulated.radar.time_s, simulated.time_s, simulated.speed)
    assert (np.abs(simulated.radar.value - v) < 5 * (0.05 + 0.003 * v) + 1e-3).all()
    delay = simulated.loop.arrival_s - simulated.loop.time_s
    assert (delay > 0.0099).all()
    assert (delay < 0.0301).all()


def test_wrongid20():
    """A fifth of 60 runs' balises (340 heard; four sigma are 9 %) tell the id of another."""
    wrong = heard = 0
    for seed in range(60):
        simulated = run('wrongid20', seed)
        for told, s in zip(
            simulated.balise.id, at_stamps(simulated, simulated.balise), strict=True
        ):
            nearest = simulated.table.id[int(np.argmin(np.abs(simulated.table.chainage - s)))]
            wrong += told != nearest
            heard += 1
    assert wrong / heard == pytest.approx(0.2, abs=0.09)


def test_startunknown():
    """Anywhere between 100 and 4500 m, most of them at speed; the counter begins at 0."""
    runs = [run('startunknown', seed) for seed in range(40)]
    starts = np.array([r.chainage[0] for r in runs])
    assert starts.min() >= 100.0
    assert starts.max() <= 4500.0
    assert starts.std() == pytest.approx(4400 / np.sqrt(12), rel=0.4)
    assert np.mean([r.speed[0] > 20.0 for r in runs]) > 0.5
    for r in runs:  # the first reading may have been dropped
        run_since = r.chainage[np.searchsorted(r.time_s, r.loop.time_s[0])] - r.chainage[0]
        assert -1e-9 <= r.loop.value[0] <= run_since + 0.2


def test_jumpbalise():
    """
    The reading leaps at the crossings, within 50 ms and two samples.

    By four counts or more, so as not to be taken for a single miss: 37 of 40 sizes are.
    """
    near = []
    for seed in range(10):
        simulated = run('jumpbalise', seed, delivery__dropped=0.0, delivery__gaps=0.0)
        behind = at_stamps(simulated, simulated.loop) - simulated.loop.value
        jumps = simulated.loop.time_s[1:][np.abs(np.diff(behind)) > 0.75]
        for s in simulated.table.chainage:
            crossed = simulated.time_s[np.argmax(simulated.chainage >= s)]
            near.append(np.abs(jumps - crossed).min() < 0.1)
    assert np.mean(near) == pytest.approx(37 / 40, abs=4 * 0.26 / np.sqrt(60))


@pytest.mark.parametrize(('name', 'sensor'), [('loopdead', 'loop'), ('radardead', 'radar')])
def test_a_dead_sensor_is_silent_for_a_minute(name, sensor):
    stream = getattr(run(name), sensor)
    t = stream.time_s - 1000.0
    assert not ((t >= 150.0) & (t < 210.0)).any()
    assert ((t > 149.0) & (t < 150.0)).any()
    assert ((t > 210.0) & (t < 211.0)).any()


@pytest.mark.parametrize(('name', 'sensor'), [('loopfrozen', 'loop'), ('radarfrozen', 'radar')])
def test_a_frozen_sensor_repeats_itself_for_a_minute(name, sensor):
    stream = getattr(run(name), sensor)
    t = stream.time_s - 1000.0
    frozen = stream.value[(t >= 150.0) & (t < 210.0)]
    assert len(frozen) > 1000
    assert len(np.unique(frozen)) == 1
    assert len(np.unique(stream.value[(t >= 210.0) & (t < 220.0)])) > 50


def test_what_a_dead_loop_did_not_count_is_lost():
    """The train ran on for a minute; the counter did not."""
    dead, whole = run('loopdead'), run()
    ran = np.diff(chainage_at(whole, np.array([1150.0, 1210.0])))[0]
    difference = whole.loop.value[-1] - dead.loop.value[-1]
    assert ran > 1000.0
    assert difference == pytest.approx(ran, abs=100.0)  # the whole one may have lost some there


def test_balisedead():
    """Those crossed within the minute are not heard."""
    simulated = run('balisedead', balise__missed=0.0, delivery__dropped=0.0, balise__wrong_id=0.0)
    t = simulated.time_s - 1000.0
    crossed = [t[np.argmax(simulated.chainage >= s)] for s in simulated.table.chainage]
    alive = tuple(
        name
        for name, when in zip(simulated.table.id, crossed, strict=True)
        if not 150.0 <= when < 210.0
    )
    assert simulated.balise.id == alive
    assert len(alive) < 6


def test_long_is_two_hours_of_the_same():
    simulated = run('long')
    assert simulated.duration_s > 7200.0
    assert simulated.chainage[-1] == 119000.0
    assert len(simulated.table) == 118
    standing = simulated.chainage[
        np.flatnonzero((simulated.speed[1:] == 0) & (simulated.speed[:-1] == 0))
    ]
    assert len(np.unique(standing)) == 4 * 17 + 1
