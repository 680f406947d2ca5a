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
    """
    Return (bag, bag with one sample more, design ride file) of the first part of a ride.

    The one sample more comes when all matches are in: its odometry has them all.
    """
    folder = tmp_path_factory.mktemp('ride')
    config = override(CoasterSimConfig(), {'ride.dwell_before_s': [8.0, 8.0]})
    simulated = simulate_coaster('launch', config, seed=3)
    write_design_ride(folder / 'design_ride.csv', simulated.design)
    imu = simulated.imu
    count = int(np.searchsorted(imu.time_s, imu.time_s[0] + FIRST_S))
    for name, end in (('bag', count), ('longer', count + 1)):
        with BagWriter(folder / name) as bag:
            bag.write_imu('imu/data_raw', imu[:end])
    return str(folder / 'bag'), str(folder / 'longer'), str(folder / 'design_ride.csv')


@pytest.fixture(scope='module')
def live(ros_module, ride):
    """Run the nodes; return (matches, odometries, the filter as it ended)."""
    ros, (bag, longer, design) = ros_module, ride
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
    before = matcher.sent
    last = ros.make_apart(ImuPublisherNode, source=longer, subscribers=2, start_offset=FIRST_S)
    ros.run_replay(last)
    ros.settle(lambda: len(odometries) == matcher.imu.received == sent + 1)
    assert dict(last.replayer.sent) == {'imu/data_raw': 1}
    assert matcher.sent == before, 'no match may be due with the last sample: it would race'
    return matches, odometries, filter_.filter


@pytest.fixture(scope='module')
def offline(ride):
    """Return (matches, the filter as it ended) of the loop that ``eskf_live`` is."""
    _, longer, design_file = ride
    imu, rejected = read_imu(longer)
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
    state, expected = live[2].history.state, offline[1].history.state
    assert state.nav.time_s == expected.nav.time_s
    np.testing.assert_allclose(state.nav.x, expected.nav.x, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(state.nav.P, expected.nav.P, rtol=1e-6, atol=1e-9)
    assert live[2].rejected == offline[1].rejected


def test_the_last_odometry_is_the_last_row_of_eskf_live(live, ride):
    """
    What a subscriber got last against what ``evaluate`` writes last.

    The last sample was sent when every match was in, so nothing is on its way: 1e-6 as above.
    """
    _, longer, design = ride
    imu = read_imu(longer)[0]
    result = next(run_methods(imu, read_design_ride(design), CoasterConfig(), ['eskf_live']))
    last, odometry = result.trajectory[-1:], live[1][-1]
    assert len(live[1]) == len(result.trajectory)
    assert seconds(odometry.header.stamp) == last.time_s[0]
    p = odometry.pose.pose.position
    np.testing.assert_allclose([p.x, p.y, p.z], last.position[0], rtol=0.0, atol=1e-6)
    covariance = odometry.pose.covariance.reshape(6, 6)[:3, :3]
    np.testing.assert_allclose(covariance, last.covariance[0], rtol=1e-6, atol=1e-9)
