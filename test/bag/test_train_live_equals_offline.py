"""
Live equals offline: a bag through the train's node over DDS gives what the offline run gives.

The node gets the bag's messages by DDS as fast as it keeps up (``rate: 0``); the offline run is the
one of an evaluation: it reads the same bag and pushes into the same object in a loop.
"""

from __future__ import annotations

import argparse

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import NavSatFix

from track_localization.cli.train import simulate
from track_localization.cli.train.inputs import add_arguments, read_inputs
from track_localization.geodesy import enu_from_geodetic
from track_localization.ros.convert import seconds
from track_localization.ros.replay import SensorPublisherNode
from track_localization.settings import override
from track_localization.sim.train import scenario, simulate_train
from train_localization import kernels
from train_localization.config import TrainConfig
from train_localization.nodes.train_kf import TrainKfNode
from train_localization.pipeline import TrainPipeline

SEED = 7
SENSORS = ('imu', 'gnss', 'quality', 'wheel')


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return (simulated run, what an evaluation reads of it, folder)."""
    folder = tmp_path_factory.mktemp('run')
    simulated = simulate_train(scenario('paper'), SEED)
    simulate.write(simulated, folder, {'scenario': 'paper'})
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    parser.set_defaults(set=[])
    return simulated, read_inputs(parser.parse_args([str(folder / 'bag')])), folder


def compiled() -> int:
    """Return how many signatures of the train's kernels are compiled."""
    return sum(len(f.signatures) for f in vars(kernels).values() if hasattr(f, 'signatures'))


@pytest.fixture(scope='module', params=['robust', 'robust_map', 'paper'])
def live(request, ros_module, run):
    """Run the node; return (node, what it published by topic, compiled before and after)."""
    ros, (_, recorded, folder) = ros_module, run
    files = {'track': str(folder / 'track.csv'), 'datum__file': str(folder / 'datum.yaml')}
    node = ros.make(TrainKfNode, TrainPipeline, True, **files, method=request.param)
    before = compiled()
    listener = ros.node('listener')
    published = {
        topic: ros.listen(listener, kind, topic, 20_000)
        for topic, kind in (
            ('odometry', Odometry),
            ('track/pose', PoseWithCovarianceStamped),
            ('gnss/filtered', NavSatFix),
            ('/diagnostics', DiagnosticArray),
        )
    }
    ros.run_replay(ros.make_apart(SensorPublisherNode, source=str(folder / 'bag'), rate=0.0))
    streams = [getattr(node, sensor) for sensor in SENSORS]
    ros.settle(lambda: sum(s.received for s in streams) == len(recorded.measurements))
    ros.settle(lambda: len(published['odometry']) == len(published['gnss/filtered']), 5.0)
    yield node, published, (before, compiled())
    for part in (node, listener):
        ros.executor.remove_node(part)


@pytest.fixture(scope='module')
def offline(live, run):
    """Return (estimates, pipeline as it ended) of the loop that an evaluation is."""
    recorded = run[1]
    config = override(TrainConfig(), {'method': live[0].config.method})
    pipeline = TrainPipeline(config, recorded.track, recorded.datum)
    assert pipeline.set_start(*recorded.start) is None
    return [e for m in recorded.measurements for e in pipeline.push(m)], pipeline


def test_nothing_is_lost(live, run):
    node, recorded = live[0], run[1].recorded
    for sensor in SENSORS:
        stream = getattr(node, sensor)
        assert stream.received == recorded.count(sensor), sensor
        assert not stream.rejected
    assert node.start.received == 1
    assert not node.start.rejected


def test_the_final_states_are_the_same(live, offline):
    """The same object on the same numbers in the same order: equal to the bit."""
    node, expected = live[0], offline[1]
    assert node.filter.diagnostics() == expected.diagnostics()
    assert node.filter.rejected == expected.rejected


def test_every_estimate_has_its_odometry_chainage_and_fix(live, offline):
    """One for each, in order, with its stamp and figures, none lost or doubled."""
    published, estimates = live[1], offline[0]
    topics = [published[topic] for topic in ('odometry', 'track/pose', 'gnss/filtered')]
    assert [len(messages) for messages in topics] == [len(estimates)] * 3
    assert len(estimates) > 1900
    for msg, along, fix, estimate in zip(*topics, estimates, strict=True):
        assert msg.header.stamp == along.header.stamp == fix.header.stamp
        assert seconds(msg.header.stamp) == pytest.approx(estimate.time_s, abs=1e-9)
        p = msg.pose.pose.position
        assert (p.x, p.y, p.z) == tuple(estimate.position)
        assert along.pose.pose.position.x == estimate.chainage
        assert fix.latitude == pytest.approx(np.degrees(estimate.geodetic[0]), abs=1e-12)
        assert msg.pose.covariance[0] == pytest.approx(estimate.covariance[0, 0], rel=1e-9)


def test_everything_was_compiled_before_the_first_message(live):
    before, after = live[2]
    assert before == after > 0


def test_the_train_is_where_it_truly_was(live, run):
    """
    Nothing above would tell if live and offline were wrong alike.

    Before the outage a fix's own error of 1 to 2 m is what remains, of any method; a wrong frame,
    sign or stamp is off by tens of metres at 55 m/s.
    """
    published, (simulated, _, _) = live[1], run
    truth = simulated.truth()
    stamps = np.array([seconds(msg.header.stamp) for msg in published['odometry']])
    seen = stamps < simulated.outages[0][0]
    assert seen.sum() > 900
    places = (msg.pose.pose.position for msg in published['odometry'])
    p = np.array([(m.x, m.y, m.z) for m in places])
    fixes = published['gnss/filtered']
    columns = (
        np.radians([f.latitude for f in fixes]),
        np.radians([f.longitude for f in fixes]),
        np.array([f.altitude for f in fixes]),
    )
    for place in (p, enu_from_geodetic(*columns, simulated.datum)):
        error = np.linalg.norm(place - truth.position_at(stamps), axis=1)[seen]
        assert np.sqrt(np.mean(error[np.isfinite(error)] ** 2)) < 5.0
    s = np.array([msg.pose.pose.position.x for msg in published['track/pose']])
    off = s - np.interp(stamps, simulated.time_s, simulated.chainage)
    assert np.sqrt(np.mean(off[seen] ** 2)) < 5.0
    v = np.array([msg.twist.twist.linear.x for msg in published['odometry']])
    told = np.interp(stamps, simulated.time_s, simulated.speed)
    # The IMU sits up to a degree askew in its car: 0.02 % of its speed.
    assert np.sqrt(np.mean((v - told)[seen][50:] ** 2)) < 0.5


def test_the_mode_is_told_as_it_changes(live, run):
    """No fix between the outage's ends: the odometer carries on, and the diagnostics say so."""
    told = [
        {v.key: v.value for v in status.values}['mode']
        for array in live[1]['/diagnostics']
        for status in array.status
        if status.name == 'train_kf'
    ]
    assert live[0].filter.mode == 'BDS/SINS'
    assert set(told) <= {'aligning', 'BDS/SINS', 'height-aided', 'SINS/DR', 'SINS'}
    assert told
