"""What every hypothesis of a bank is told of a train that stands, crawls or sets out."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.maglev_bank import SHARE, close, joseph, one

from maglev_localization import standing
from maglev_localization.line_kernels import SIZE, A, C, V


def test_depart_opens_count_and_speed():
    _, x, P = one()
    standing.depart(P, 0.2)
    added = SHARE * (P[0, 0] - one()[2][0, 0])
    assert np.array_equal(x, one()[1])
    assert np.diag(added)[[C, V, A]] == pytest.approx([0.04, 0.25, 0.25], rel=1e-9)
    assert added - np.diag(np.diag(added)) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ('off', 'sigma', 'inside'), [(0.05, 0.05, True), (0.15, 0.05, False), (0.05, 0.2, False)]
)
def test_bounded_means_that_a_standing_count_is_no_news(off, sigma, inside):
    """Within 1.7 sigma of the middle (0.06 m), and known about as well as the count tells."""
    _, x, P = one(sigma=[sigma, 0.05, 0.1, 0.1, 1e-4, 2e-3])
    assert standing.bounded(x, P, 500.0 + off, 0.2**2 / 12.0) == inside


def test_a_standing_count_is_news_as_long_as_it_is_to_one_hypothesis():
    """One that has the train half a metre back is not let live."""
    _, x, P = one(sigma=[0.05, 0.05, 0.1, 0.1, 1e-4, 2e-3])
    x, P = np.concatenate([x, x]), np.concatenate([P, P])
    x[1, :, C] -= 0.5
    assert not standing.bounded(x, P, 500.0, 0.2**2 / 12.0)
    assert standing.bounded(x[:1], P[:1], 500.0, 0.2**2 / 12.0)


def test_stand_still_is_two_measurements():
    state = one(v=0.1, a=-0.2)
    mean, spread = state[1][0, 0], SHARE * state[2][0, 0]
    for place, sigma in ((V, 0.05), (A, 0.2)):
        mean, spread = joseph(mean, spread, np.eye(SIZE)[place], -mean[place], sigma**2)
    standing.stand_still(state[1], state[2], 0.05, 0.2)
    for local in range(2):
        assert state[1][0, local] == pytest.approx(mean, rel=1e-9, abs=1e-12)
        assert close(SHARE * state[2][0, local], spread)


def test_a_running_train_is_not_made_to_stand():
    """A loop over a dead zone and a radar that lost the ground look like standing."""
    _, x, P = one()
    standing.stand_still(x, P, 0.05, 0.2)
    assert np.array_equal(x, one()[1])
    assert np.array_equal(P, one()[2])
