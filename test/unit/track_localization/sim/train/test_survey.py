"""The surveyed line: ``track.csv`` against the way that the train truly runs."""

import numpy as np
import pytest

from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from track_localization.track.centreline import Centreline

QUICK = {'imu.rate_hz': 5.0, 'clock.truth_rate_hz': 10.0}


def run(name='paper', seed=1, **changes):
    changes = {k.replace('__', '.'): v for k, v in changes.items()}
    return simulate_train(override(scenario(name), {**QUICK, **changes}), seed)


def offsets(simulated):
    """Return how far left and above the file's line (N,) the IMU truly is [m]."""
    line = Centreline.from_track(simulated.track)
    s = line.nearest(simulated.position)
    R = line.attitude(s)
    off = simulated.position - line.position(s)
    left = np.cross([0.0, 0.0, 1.0], R[:, :, 0])
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    return np.sum(off * left, axis=1), off[:, 2], s


def test_the_error_sideways_and_in_height():
    """0.2 to 0.4 m rms and 0.1 to 0.3 m by run, over the part that the train uses."""
    cross, height = [], []
    for seed in range(12):
        left, above, _ = offsets(run(seed=seed))
        cross.append(np.sqrt(np.mean(left**2)))
        height.append(np.sqrt(np.mean(above**2)))
        assert abs(left.mean()) < 0.15
    # the part used is most of the line, so its rms is nearly the whole line's
    assert 0.17 < min(cross) < max(cross) < 0.44
    assert 0.08 < min(height) < max(height) < 0.33
    assert np.ptp(cross) > 0.08


def test_it_is_smooth():
    """Knots every 200 m: from 5 m to the next it changes by centimetres, after 400 m it is new."""
    simulated = run(seed=2, survey__cross_m=(0.3, 0.3))
    left, _, s = offsets(simulated)
    even = np.interp(np.arange(600.0, 11000.0, 5.0), s, left)
    assert np.abs(np.diff(even)).max() < 0.06
    pairs = [np.corrcoef(even[k:], even[:-k])[0, 1] for k in (10, 80)]
    assert pairs[0] > 0.85
    assert abs(pairs[1]) < 0.45


def test_a_perfect_survey_is_the_line():
    """Chainage, place and attitude of the vehicle, to what rows every 5 m can tell."""
    simulated = run(survey__cross_m=(0.0, 0.0), survey__height_m=(0.0, 0.0), odometer__mount_deg=0)
    line = Centreline.from_track(simulated.track)
    left, above, s = offsets(simulated)
    assert np.abs(left).max() < 1e-4
    assert np.abs(above).max() < 1e-4
    np.testing.assert_allclose(s, simulated.chainage, atol=1e-3)
    dot = np.abs(np.sum(line.quaternion(s) * simulated.quaternion, axis=1))
    assert np.degrees(2.0 * np.arccos(np.clip(dot, 0.0, 1.0))).max() < 0.01


def test_front_follows_the_surveyed_rows():
    """Errors included: the file agrees with itself, and its axes are at right angles."""
    track = run('line', 2).track
    along = track.position[2:] - track.position[:-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turned = np.linalg.norm(np.cross(along, track.front[1:-1]), axis=1)
    assert turned.max() < 1e-4  # a chord of 10 m in a curve of 2.2 km: 1e-6, and its transitions
    R = track.attitude
    np.testing.assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )


def test_the_line_reaches_beyond_the_run():
    """By 500 m at either end, in rows of 5 m; the start is the datum."""
    simulated = run('line', 4)
    rows = np.linalg.norm(np.diff(simulated.track.position, axis=0), axis=1)
    np.testing.assert_allclose(rows, 5.0, atol=0.01)
    assert simulated.chainage[0] == 500.0
    assert rows.sum() - simulated.chainage[-1] == pytest.approx(500.0, abs=0.5)


def test_wrongmap_is_three_metres_aside():
    """To the left of the line, all of it: the train is 3 m to its right."""
    left, above, _ = offsets(run('wrongmap', 3))
    assert left.mean() == pytest.approx(-3.0, abs=0.15)
    assert abs(above.mean()) < 0.15
    assert np.std(left) < 0.5


def test_no_survey_no_track():
    assert run(survey__given=False).track is None
