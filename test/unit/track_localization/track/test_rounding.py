"""Rounded track files: rounding is measured and taken out, shape is kept."""

import numpy as np
import pytest

from track_localization.track.centreline import Centreline
from track_localization.track.rounding import row_noise, smooth, without_rounding
from track_localization.track.track_file import TrackFile

RADIUS = 12.0


def circle(decimals: int) -> TrackFile:
    """Return a tight circle in rows of 0.5 m, rounded."""
    t = np.linspace(0.0, 2.0 * np.pi, 151)[:-1]
    zero = np.zeros(150)
    front = np.stack([-np.sin(t), np.cos(t), zero], axis=1)
    left = np.stack([-np.cos(t), -np.sin(t), zero], axis=1)
    up = np.stack([zero, zero, zero + 1.0], axis=1)
    return TrackFile(*(np.round(v, decimals) for v in (-RADIUS * left, front, left, up)))


@pytest.mark.parametrize('decimals', [2, 3, 4])
def test_noise_is_measured(decimals):
    """Uniform rounding has an rms of a step over the root of twelve."""
    positions = circle(decimals).position[:, :2]
    assert row_noise(positions) == pytest.approx(10.0**-decimals / np.sqrt(12.0), rel=0.35)


def test_exact_files_are_not_touched():
    """Nine decimals: the very same object comes back."""
    track = circle(9)
    assert without_rounding(track, True) is track


def test_millimetre_file_keeps_its_curvature():
    """The pull at 25 m/s would be off by 1 m/s^2 and more; smoothed it is right to 0.2 of 52."""
    track = circle(3)
    s = np.linspace(0.0, 75.0, 2000)

    def pull(line: Centreline) -> np.ndarray:
        tangent = line.tangent(np.stack([s - 0.01, s + 0.01]))
        return 25.0**2 * np.linalg.norm(tangent[1] - tangent[0], axis=1) / 0.02

    exact = 25.0**2 / RADIUS
    error = pull(Centreline.from_track(track)) - exact
    assert np.sqrt(np.mean(error**2)) < 0.2
    rough = Centreline(0.5 * np.arange(150), track.position, track.attitude, True, 75.0)
    assert np.sqrt(np.mean((pull(rough) - 25.0**2 / RADIUS) ** 2)) > 0.5


def test_smoothing_keeps_waves_of_a_coaster_and_takes_out_short_ones():
    """15 m waves pass to 0.1 %, 2 m waves are gone."""
    s = 0.5 * np.arange(400)
    for wavelength, low, high in ((15.0, 0.999, 1.001), (2.0, 0.0, 0.03)):
        wave = np.sin(2.0 * np.pi * s / wavelength)[:, None]
        left = smooth(wave, 0.5, False)[100:300]
        ratio = np.sqrt(np.mean(left**2) / np.mean(wave[100:300] ** 2))
        assert low <= ratio <= high


def test_uneven_rows_are_left_alone():
    """Their differences say nothing about rounding."""
    track = circle(3)
    gaps = np.delete(np.arange(150), [20, 21, 22])
    uneven = TrackFile(*(v[gaps] for v in (track.position, track.front, track.left, track.up)))
    assert without_rounding(uneven, True) is uneven
