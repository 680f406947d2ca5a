import numpy as np
import pytest

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation.clock import fit_clock_offset


def ride() -> Trajectory:
    time = np.arange(0.0, 60.0, 0.02)
    angle = 0.3 * time + 0.5 * np.sin(0.2 * time)
    position = np.stack([40 * np.cos(angle), 40 * np.sin(angle), 5 * np.sin(0.7 * time)], axis=1)
    return Trajectory(time, position)


def test_offset_of_the_markers_clock_is_found_despite_a_wrong_marker():
    markers = np.linspace(5.0, 55.0, 16)
    design = ride().position_at(markers)
    design[3] += 30.0
    offset, left = fit_clock_offset(ride(), markers - 0.737, design)
    assert offset == pytest.approx(0.737, abs=0.0015)
    assert np.median(left) < 0.02


def test_too_few_markers_give_no_offset():
    offset, left = fit_clock_offset(ride(), np.array([100.0, 200.0]), np.zeros((2, 3)))
    assert np.isnan(offset)
    assert np.isnan(left).all()
