"""Each picture is written and shows each method in that method's own colour."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation import (
    plots_errors,
    plots_matching,
    plots_sweeps,
    plots_trajectory,
)
from track_localization.evaluation.metrics import ride_errors
from track_localization.evaluation.plots_style import COLOURS, colour


def shows(file: Path, shade: str) -> bool:
    """Whether some pixels have this colour."""
    pixels = imread(file)[..., :3]
    return bool((np.abs(pixels - np.array(to_rgb(shade))).max(axis=-1) < 0.02).sum() > 20)


@pytest.fixture
def ride() -> Trajectory:
    time = np.arange(0.0, 40.0, 0.05)
    s = 12.0 * time
    position = np.stack([60 * np.cos(s / 60), 60 * np.sin(s / 60), 10 * np.sin(s / 20)], axis=1)
    return Trajectory(time, position, chainage=s)


def estimate(ride: Trajectory, offset: float) -> Trajectory:
    n = len(ride)
    return Trajectory(
        ride.time_s, ride.position + offset, sigma_along=np.full(n, 0.5), chainage=ride.chainage
    )


def test_two_methods_never_share_a_colour():
    assert len(set(COLOURS.values())) == len(COLOURS)
    assert colour('some_new_method') == colour('some_new_method')


def test_errors(tmp_path, ride):
    methods = {'eskf': estimate(ride, 0.3), 'dtw_z': estimate(ride, 3.0)}
    errors = {name: ride_errors(e, ride) for name, e in methods.items()}
    for file in (
        plots_errors.error_along_track(tmp_path / 'a.png', errors, {'A1': 120.0}),
        plots_errors.error_distribution(tmp_path / 'b.png', errors),
        plots_errors.error_at_markers(
            tmp_path / 'c.png', ['A1', 'A2'], {n: np.array([1.0, np.nan]) for n in methods}
        ),
    ):
        assert all(shows(file, colour(name)) for name in methods)


def test_error_along_track_without_any_estimate(tmp_path, ride):
    """A method whose epochs all lie after the ride gives an empty panel, not a failure."""
    late = Trajectory(ride.time_s + 1000.0, ride.position)
    file = plots_errors.error_along_track(tmp_path / 'a.png', {'eskf': ride_errors(late, ride)}, {})
    assert file.stat().st_size > 0


def test_paths_and_speeds(tmp_path, ride):
    drift = ride.position + np.linspace(0.0, 900.0, len(ride))[:, None]
    paths = {'imu': drift, 'eskf_smoothed': ride.position + 0.2}
    file = plots_trajectory.paths_3d(tmp_path / 'a.png', ride.position, paths, ride.position[::200])
    assert all(shows(file, colour(name)) for name in paths)
    tracks = {'eskf_smoothed': estimate(ride, 0.1)}
    file = plots_trajectory.speeds(
        tmp_path / 'b.png', ride.time_s, np.full(len(ride), 14.0), tracks, ride
    )
    assert shows(file, colour('eskf_smoothed'))


def test_matching(tmp_path, ride):
    wave = np.sin(ride.time_s)
    i = np.arange(len(wave))
    path = np.stack([i, np.minimum(i + 10, len(wave) - 1)], axis=1)
    lines = plots_matching.MatchLines(
        'srdtw_z', ride.time_s, wave, ride.time_s, np.roll(wave, 10), path, path[::100]
    )
    file = plots_matching.matching_lines(tmp_path / 'a.png', [lines], 'z [-]')
    assert shows(file, '#d55e00')
    no_cuts = plots_matching.MatchLines('dtw_z', *[ride.time_s, wave] * 2, path)
    file = plots_matching.matching_lines(tmp_path / 'b.png', [no_cuts], 'z [-]')
    assert not shows(file, '#d55e00')
    file = plots_matching.matched_positions(
        tmp_path / 'c.png', ride.position, ride.time_s, ride.position, ride.chainage, None, 'dtw_z'
    )
    assert shows(file, colour('dtw_z'))


def test_sweeps(tmp_path):
    error = np.array([[1.0, 0.5], [0.8, 0.3], [0.9, np.nan]])
    file = plots_sweeps.error_by_lambda(
        tmp_path / 'a.png', np.array([0.01, 0.1, 1.0]), np.array([1.0, 100.0]), error, 0.445
    )
    assert file.stat().st_size > 0
    file = plots_sweeps.error_by_channel(
        tmp_path / 'b.png', np.array([1.0, 10.0]), {'z': error[0], 'yaw': 4 * error[1]}
    )
    assert shows(file, colour('srdtw_z'))
    assert shows(file, colour('srdtw_yaw'))
