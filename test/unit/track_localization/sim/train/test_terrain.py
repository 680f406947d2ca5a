"""What covers the sky, and the sky that a receiver has."""

import numpy as np
import pytest

from track_localization.sim.train.config import Terrain
from track_localization.sim.train.terrain import lay_cover, see


def cover(seed=1, **changes):
    return lay_cover(np.random.default_rng(seed), Terrain(**changes), 1000.0, 33e3)


def test_tunnels_and_cuttings_as_many_and_as_long_as_agreed():
    """3 to 5 of either, apart from one another, inside the line."""
    counts = []
    for seed in range(40):
        laid = cover(seed)
        spans = np.concatenate([laid.tunnel, laid.cutting])
        spans = spans[np.argsort(spans[:, 0])]
        assert (spans[1:, 0] >= spans[:-1, 1]).all()
        assert spans[0, 0] >= 1000.0
        assert spans[-1, 1] <= 33e3
        for kind, low, high in ((laid.tunnel, 400.0, 3000.0), (laid.cutting, 200.0, 1200.0)):
            length = np.diff(kind, axis=1)
            assert (length > low - 1e-6).all()
            assert (length < high + 1e-6).all()
            counts.append(len(kind))
        assert ((laid.hdop >= 2.5) & (laid.hdop <= 9.0)).all()
        assert len(laid.hdop) == len(laid.cutting)
    assert set(counts) == {3, 4, 5}


def test_what_does_not_fit_is_left_out():
    """At most 60 % is covered, however much is asked for."""
    laid = cover(tunnels=(50, 50), cuttings=(0, 0))
    assert 0.5 * 32e3 < np.diff(laid.tunnel, axis=1).sum() <= 0.6 * 32e3
    assert not len(laid.cutting)
    assert not len(cover(tunnels=(0, 0), cuttings=(0, 0)).tunnel)


@pytest.fixture
def seen():
    """Return a cover, a sky passed at 10 m a fix, and where."""
    laid = cover(3)
    s = np.arange(0.0, 34e3, 10.0)
    return laid, see(np.random.default_rng(2), Terrain(), laid, np.arange(len(s)) * 1.0, s), s


def inside(spans, s, wider=0.0):
    return ((s[:, None] >= spans[:, 0] - wider) & (s[:, None] < spans[:, 1] + wider)).any(axis=1)


def test_sky_by_place(seen):
    """None in tunnels, 3 in cuttings, 4 to 6 about portals, 8 to 14 in the open; HDOP likewise."""
    laid, sky, s = seen
    tunnel, cutting = inside(laid.tunnel, s), inside(laid.cutting, s)
    mouth = inside(laid.tunnel, s, 150.0) & ~tunnel & ~cutting
    clear = ~(tunnel | cutting | mouth)
    assert (sky.satellites[tunnel] == 0).all()
    assert (sky.hdop[tunnel] == 99.99).all()
    assert (sky.satellites[cutting] == 3).all()
    assert set(sky.satellites[mouth]) == {4, 5, 6}
    assert set(sky.satellites[clear]) <= set(range(8, 15))
    assert len(set(sky.satellites[clear])) >= 6
    assert (sky.hdop[clear] >= 0.8).all()
    assert (sky.hdop[clear] <= 1.2).all()
    assert np.median(sky.hdop[clear]) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(sky.hdop[mouth], 2.2, rtol=0.15)
    for (begin, end), mean in zip(laid.cutting, laid.hdop, strict=True):
        np.testing.assert_allclose(sky.hdop[(s >= begin) & (s < end)], mean, rtol=0.15)
    np.testing.assert_array_equal(sky.covered, mouth | cutting)


def test_hdop_in_the_open_wanders_slowly(seen):
    """From fix to fix by a hundredth, over ten minutes by all of it; few satellites, high HDOP."""
    laid, sky, s = seen
    clear = ~(inside(laid.tunnel, s, 150.0) | inside(laid.cutting, s))
    both = clear[1:] & clear[:-1]
    assert np.abs(np.diff(sky.hdop)[both]).mean() < 0.03
    assert np.ptp(sky.hdop[clear]) > 0.3
    assert np.corrcoef(sky.hdop[clear], sky.satellites[clear])[0, 1] < -0.9


def test_cuttings_come_with_low_and_high_hdop():
    """So that both of the paper's branches for three satellites are met."""
    means = np.concatenate([cover(seed).hdop for seed in range(20)])
    assert (means < 4.0).mean() > 0.1
    assert (means > 6.0).mean() > 0.3
