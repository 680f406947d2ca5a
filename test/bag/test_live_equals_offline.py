"""
Live equals offline: a bag through the real nodes over DDS gives what the offline run gives.

The nodes get the bag's messages by DDS as fast as they keep up (``rate: 0``); ``eskf_live`` of an
evaluation calls the same two objects in a loop. A match reaches the live filter some samples later
than the offline one, and is fused at its own stamp all the same.
"""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from coaster_localization.config import CoasterConfig
from coaster_localization.methods import run_methods
from coaster_localization.nodes.eskf import CoasterEskfNode
from coaster_localization.nodes.imu_publisher import ImuPublisherNode
from coaster_localization.nodes.srdtw_matcher import SrdtwMatcherNode
from coaster_localization.online import OnlineMatcher
from coaster_localization.pipeline import CoasterEskf
from track_localization.io.bag_writer import BagWriter
from track_localization.io.bags import read_imu
from track_localization.ros.convert import seconds
from track_localization.settings import override
from track_localization.sim.coaster import CoasterSimConfig, simulate_coaster
from track_localization.track.design_ride import read_design_ride, write_design_ride

FIRST_S = 75.0
"""Of the recording: dwell, lift or launch, and the fast part; enough, and quick to run."""


@pytest.fixture(scope='module')
def ride(tmp_path_factory):
    """Return (bag, design ride file) of the first part of a simulated ride."""
    folder = tmp_path_factory.mktemp('ride')
    config = override(CoasterSimConfig(), {'ride.dwell_before_s': [8.0, 8.0]})
    simulated = simulate_coaster('launch', config, seed=3)
    write_design_ride(folder / 'design_ride.csv', simulated.design)
    imu = simulated.imu
    with BagWriter(folder / 'bag') as bag:
        bag.write_imu('imu/data_raw', imu[imu.time_s < imu.time_s[0] + FIRST_S])
    return str(folder / 'bag'), str(folder / 'design_ride.csv')


@pytest.fixture(scope='module')
def live(ros_module, ride):
    """Run the nodes; return (matches, odometries, the filter as it ended)."""
    ros, (bag, design) = ros_module, ride
    matcher = ros.make(SrdtwMatcherNode, design_ride=design)
    filter_ = ros.make(CoasterEskfNode, design_ride=design)
    listener = ros.node('listener')
    matches = ros.listen(listener, PoseWithCovarianceStamped, 'srdtw/pose')
    odometries = ros.listen(listener, Odometry, 'odometry')
    ros.run_replay(ros.make_apart(ImuPublisherNode, source=bag, rate=0.0, subscribers=2))
    sent = len(read_imu(bag)[0])
    ros.settle(lambda: matcher.imu.received == sent and filter_.match.received == matcher.sent)
    assert matcher.imu.received == sent
    assert filter_.imu.received == sent
    return matches, odometries, filter_


@pytest.fixture(scope='module')
def offline(ride):
    """Return (matches, the filter as it ended) of the loop that ``eskf_live`` is."""
    bag, design_file = ride
    imu, rejected = read_imu(bag)
    assert rejected == {}
    design, config = read_design_ride(design_file), CoasterConfig()
    matcher, filter_ = OnlineMatcher(design, config.matcher), CoasterEskf(design, config.eskf)
    matches = []
    for i in range(len(imu)):
        filter_.push(imu.sample(i))
        for match in matcher.push(imu.sample(i)):
            filter_.push(match)
            matches.append(match)
    return matches, filter_


def test_the_matches_are_the_same(live, offline):
    """The same object on the same numbers: equal to the bit, but for stamps in whole ns."""
    sent, expected = live[0], offline[0]
    assert len(sent) == len(expected) > 100
    for msg, match in zip(sent, expected, strict=True):
        p = msg.pose.pose.position
        assert [p.x, p.y, p.z] == match.position.tolist()
        covariance = msg.pose.covariance.reshape(6, 6)[:3, :3]
        np.testing.assert_array_equal(covariance, match.covariance)
        assert seconds(msg.header.stamp) == pytest.approx(match.time_s, abs=1e-9)


def test_the_final_states_are_the_same(live, offline):
    """
    State and covariance once every match is in.

    What differs: the stamp of a match is rounded to a nanosecond on its way, and its chainage is
    found from its position again; together 2e-9 in the state. 1e-6 leaves room for another build
    of the libraries; one match lost, doubled or fused at another stamp makes 1e-4 and more.
    """
    state, expected = live[2].filter.history.state, offline[1].history.state
    assert state.nav.time_s == expected.nav.time_s
    np.testing.assert_allclose(state.nav.x, expected.nav.x, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(state.nav.P, expected.nav.P, rtol=1e-6, atol=1e-9)
    assert live[2].filter.rejected == offline[1].rejected


def test_the_last_odometry_is_the_last_row_of_eskf_live(live, ride):
    """
    What a subscriber got against what ``evaluate`` writes, at the newest stamp.

    Live, the last matches may still be on their way when the last sample comes (0.5 s at most:
    the replay's window), so the tolerance is what they may move: a fifth of the standard deviation.
    """
    bag, design = ride
    imu = read_imu(bag)[0]
    result = next(run_methods(imu, read_design_ride(design), CoasterConfig(), ['eskf_live']))
    last, odometry = result.trajectory[-1:], live[1][-1]
    assert len(live[1]) == len(result.trajectory)
    assert seconds(odometry.header.stamp) == last.time_s[0]
    p = odometry.pose.pose.position
    off = np.linalg.norm(np.array([p.x, p.y, p.z]) - last.position[0])
    assert off < 0.2 * np.sqrt(np.trace(last.covariance[0]))
