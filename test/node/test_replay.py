"""Replay: what was recorded arrives, whole, in order and in time."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from helpers.replayed import START_S, Consumer, series, wait_until
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu

from coaster_localization.nodes.imu_publisher import ImuPublisherNode
from track_localization.errors import DataError
from track_localization.estimation.imu import ImuSeries
from track_localization.io.bag_writer import BagWriter
from track_localization.ros import cdr
from track_localization.ros.convert import seconds
from track_localization.ros.pace import Progress


@pytest.mark.parametrize('rate_hz', [100.0, 1000.0])
def test_rate_zero_loses_nothing(ros, write_bag, rate_hz):
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(3000, rate_hz), rate=0.0)
    ros.run_replay(node)
    assert consumer.numbers == list(range(3000))


def test_rate_zero_waits_for_a_slow_consumer(ros, write_bag):
    """2 ms a message at 1 kHz: a sender that did not wait would be seconds ahead."""
    consumer = Consumer(ros, busy_s=0.002)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(1500, 1000.0), rate=0.0)
    ros.run_replay(node)
    assert consumer.numbers == list(range(1500))


def test_rate_zero_goes_on_while_the_consumer_waits_for_its_start(ros, write_bag):
    consumer = Consumer(ros, silent=800)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(2000), rate=0.0)
    ros.run_replay(node)
    assert consumer.numbers == list(range(2000))


def test_rate_zero_does_not_hang_on_a_consumer_that_stalls(ros, write_bag):
    consumer = Consumer(ros, stall_after=300)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(1000), rate=0.0, pace_timeout=0.3)
    begin = time.monotonic()
    ros.run_replay(node)
    assert consumer.numbers == list(range(1000))
    assert time.monotonic() - begin < 8.0


def test_rate_zero_passes_a_gap_in_the_recording_without_a_stall(ros, tmp_path):
    """30 s without samples: the consumer has taken everything, so there is nothing to wait for."""
    before, after = series(300, 100.0), series(300, 100.0)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('imu/data_raw', before)
        bag.write_imu(
            'imu/data_raw',
            ImuSeries(after.time_s + 33.0, after.specific_force, after.angular_rate),
        )
    consumer = Consumer(ros)
    node = ros.make_apart(
        ImuPublisherNode, source=str(tmp_path / 'bag'), rate=0.0, pace_timeout=60.0
    )
    begin = time.monotonic()
    ros.run_replay(node)
    assert consumer.numbers == [*range(300), *range(300)]
    assert time.monotonic() - begin < 10.0


@pytest.mark.parametrize(('rate_hz', 'gap_s'), [(100.0, 30.0), (1.0, 0.0)])
def test_rate_zero_does_not_wait_for_stamps_that_no_answer_has(ros, tmp_path, rate_hz, gap_s):
    """
    A consumer that answers one message of three, as a filter does that publishes with one sensor.

    Neither before a gap nor at one message a second does it ever tell of the newest stamp sent.
    """
    before, after = series(100, rate_hz), series(100, rate_hz)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_imu('imu/data_raw', before)
        later = before.time_s[-1] - after.time_s[0] + gap_s + 1.0 / rate_hz
        bag.write_imu(
            'imu/data_raw',
            ImuSeries(after.time_s + later, after.specific_force, after.angular_rate),
        )
    consumer = Consumer(ros, each=3)
    node = ros.make_apart(
        ImuPublisherNode, source=str(tmp_path / 'bag'), rate=0.0, pace_timeout=60.0
    )
    begin = time.monotonic()
    ros.run_replay(node)
    assert consumer.numbers == [*range(100), *range(100)]
    assert time.monotonic() - begin < 10.0


def test_progress_shortens_pauses():
    """Steps of 10 of which 4 count at most, two stamps that are late, then a start anew."""
    way = Progress(longest_ns=4)
    assert way.behind_ns() == way.behind_ns(7) == 0
    for stamp in (100, 102, 112, 111, 105):
        assert way.send(stamp)
    assert (way.behind_ns(), way.behind_ns(113), way.behind_ns(1000)) == (6, 7, 10)
    way.consume(111)
    assert (way.behind_ns(), way.behind_ns(101)) == (4, 4)
    way.consume(50)
    assert way.behind_ns() == 4
    way.consume(112)
    assert way.behind_ns() == 0
    assert not way.send(112 - 6 * 10**9)
    assert way.behind_ns() == 0


def test_rate_zero_without_a_consumer_ends_with_a_reason(ros, write_bag):
    node = ros.make_apart(
        ImuPublisherNode, source=write_bag(), rate=0.0, wait_timeout=0.2, subscribers=0
    )
    with pytest.raises(DataError, match=r'/odometry, which nobody publishes: start the consumer'):
        ros.run_replay(node)


def test_real_time_factor_is_kept(ros, write_bag):
    """5 s at 5 x take 1 s; the sender's own measure must agree within a fifth."""
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(500), rate=5.0)
    begin = time.monotonic()
    ros.run_replay(node)
    assert consumer.numbers == list(range(500))
    assert time.monotonic() - begin > 0.99
    assert node.replayer.recorded_s == pytest.approx(4.99)
    assert '500 x imu/data_raw' in node.replayer.report()


def test_slow_motion(ros, write_bag):
    node = ros.make_apart(ImuPublisherNode, source=write_bag(6, 20.0), rate=0.25)
    Consumer(ros)
    begin = time.monotonic()
    ros.run_replay(node)
    assert time.monotonic() - begin > 1.0


def test_messages_arrive_as_they_were_recorded(ros, write_bag):
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(50), rate=100.0)
    ros.run_replay(node)
    recorded = series(50, 100.0)
    for i, msg in enumerate(consumer.received):
        assert seconds(msg.header.stamp) == pytest.approx(recorded.time_s[i], abs=1e-9)
        assert msg.header.frame_id == 'imu_link'
        assert msg.linear_acceleration.x == recorded.specific_force[i, 0]
        assert msg.angular_velocity.z == 0.01
        assert msg.orientation_covariance[0] == -1.0


def test_it_waits_for_subscribers_that_come_late(ros, write_bag):
    late = []
    starter = ros.node('starter')
    timer = starter.create_timer(0.5, lambda: (timer.cancel(), late.append(Consumer(ros))))
    node = ros.make_apart(ImuPublisherNode, source=write_bag(100), rate=50.0)
    ros.run_replay(node)
    assert late[0].numbers == list(range(100))


def test_nobody_listening_is_no_reason_to_hang(ros, write_bag):
    node = ros.make_apart(ImuPublisherNode, source=write_bag(100), rate=100.0, wait_timeout=0.2)
    ros.run_replay(node)
    assert node.replayer.sent['imu/data_raw'] == 100


def test_loop_moves_the_stamps_on(ros, write_bag):
    """Two and a half rounds: stamps keep their spacing, also across the seam."""
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(100), rate=50.0, loop=True)
    recording, rounds = node.replayer.recording, itertools.count(1)

    def until_ctrl_c():
        if next(rounds) < 3:
            yield from recording()
            return
        yield from itertools.islice(recording(), 50)
        raise KeyboardInterrupt

    node.replayer.recording = until_ctrl_c
    with pytest.raises(KeyboardInterrupt):
        ros.run_replay(node)
    assert wait_until(lambda: len(consumer.received) >= 250)
    stamps = np.array([seconds(msg.header.stamp) for msg in consumer.received])
    np.testing.assert_allclose(stamps, START_S + np.arange(250) / 100.0, atol=1e-7)
    assert consumer.numbers == [*range(100), *range(100), *range(50)]


def test_start_offset_skips(ros, write_bag):
    consumer = Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(100), rate=50.0, start_offset=0.405)
    ros.run_replay(node)
    assert consumer.numbers == list(range(41, 100))


def test_an_offset_beyond_the_end_is_an_error(ros, write_bag):
    Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(100), rate=50.0, start_offset=5.0)
    with pytest.raises(DataError, match='start_offset lies beyond its end'):
        ros.run_replay(node)


@pytest.mark.parametrize('rate', [0.0, 20.0])
def test_clock_goes_with_the_recording(ros, write_bag, rate):
    listener = ros.node('listener')
    clocks = ros.listen(listener, Clock, '/clock')
    Consumer(ros)
    node = ros.make_apart(ImuPublisherNode, source=write_bag(200), rate=rate, publish_clock=True)
    ros.run_replay(node)
    times = np.array([seconds(msg.clock) for msg in clocks])
    assert (np.diff(times) > 0.0).all()
    assert times[0] == pytest.approx(START_S, abs=0.02)
    assert times[-1] == pytest.approx(START_S + 1.99, abs=0.02)
    assert len(times) > 150


def test_header_stamps_move_in_either_byte_order():
    little = bytes([0, 1, 0, 0]) + (7).to_bytes(4, 'little') + (999_999_999).to_bytes(4, 'little')
    big = bytes([0, 0, 0, 0]) + (7).to_bytes(4, 'big') + (999_999_999).to_bytes(4, 'big')
    for data in (little + b'rest', big + b'rest'):
        assert cdr.header_ns(data) == 7_999_999_999
        moved = cdr.shifted(data, 2)
        assert cdr.header_ns(moved) == 8_000_000_001
        assert (moved[:4], moved[12:]) == (data[:4], b'rest')


def test_message_types_are_found_by_name():
    assert cdr.message_class('sensor_msgs/msg/Imu') is Imu
    assert cdr.message_class('no_such_msgs/msg/Imu') is None
    assert cdr.message_class('sensor_msgs/msg/Nothing') is None
    assert cdr.has_header(Imu)
    assert not cdr.has_header(Clock)


def test_a_pace_topic_without_stamps_is_refused(ros, write_bag):
    teller = ros.node('teller')
    teller.create_publisher(Clock, 'odometry', QoSProfile(depth=1))
    node = ros.make_apart(ImuPublisherNode, source=write_bag(), rate=0.0, subscribers=0)
    with pytest.raises(DataError, match='has no stamp'):
        ros.run_replay(node)
