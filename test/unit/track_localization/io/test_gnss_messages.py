"""Messages of a satellite receiver: written in order of arrival, as the message types say."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.io.bag_writer import BagWriter
from track_localization.io.bags import messages
from track_localization.io.gnss_messages import fix_messages, quality_messages

TIME = np.array([10.0, 11.0, 12.0, 13.0])
ARRIVAL = np.array([10.1, 12.5, 12.1, 13.1])  # the second one is late
GEODETIC = np.array([[0.7, 2.0, 500.0], [0.71, 2.1, 501.0], [np.nan] * 3, [-0.7, -2.0, -10.0]])
COVARIANCE = np.array([[[1.0, 0.2, 0.0], [0.2, 2.0, 0.0], [0.0, 0.0, 9.0]]] * 4)
COVARIANCE[2:] = 0.0
STATUS = np.array([True, True, False, True])


def written(path, *streams):
    with BagWriter(path / 'bag') as bag:
        bag.write_in_order(*streams)
    return [(topic, ns, message) for topic, ns, message in messages(path / 'bag')]


def test_fixes(tmp_path):
    """Degrees; status 0 or -1; covariance known but where all zero; the stamp is the fix's."""
    told = written(tmp_path, fix_messages('gnss/fix', TIME, ARRIVAL, GEODETIC, COVARIANCE, STATUS))
    order = [0, 2, 1, 3]
    assert [ns for _, ns, _ in told] == [round(ARRIVAL[i] * 1e9) for i in order]
    for i, (topic, _, message) in zip(order, told, strict=True):
        assert topic == '/gnss/fix'
        stamp = message.header.stamp
        assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(TIME[i], abs=1e-9)
        assert message.header.frame_id == 'gnss'
        assert message.status.status == (0 if STATUS[i] else -1)
        place = message.latitude, message.longitude, message.altitude
        degrees = [np.degrees(GEODETIC[i, 0]), np.degrees(GEODETIC[i, 1]), GEODETIC[i, 2]]
        np.testing.assert_allclose(place, degrees, rtol=1e-15)
        np.testing.assert_array_equal(message.position_covariance, COVARIANCE[i].ravel())
        kind = message.position_covariance_type
        known, unknown = message.COVARIANCE_TYPE_KNOWN, message.COVARIANCE_TYPE_UNKNOWN
        assert kind == (known if i < 2 else unknown)


def test_quality(tmp_path):
    """Key-values; what is not told has no key, and where nothing is told there is no message."""
    satellites = np.array([12, 3, 0, -1])
    hdop = np.array([0.876, np.nan, 99.99, np.nan])
    told = written(tmp_path, quality_messages('gnss/quality', TIME, ARRIVAL, satellites, hdop))
    values, levels = {}, {}
    for _, _, message in told:
        (status,) = message.status
        values[message.header.stamp.sec] = {pair.key: pair.value for pair in status.values}
        levels[message.header.stamp.sec] = status.level
        assert status.name == 'gnss'
    assert list(values) == [10, 12, 11]
    assert values == {
        10: {'satellites_used': '12', 'hdop': '0.88'},
        11: {'satellites_used': '3'},
        12: {'satellites_used': '0', 'hdop': '99.99'},
    }
    assert levels == {10: 0, 11: 1, 12: 2}


def test_hdop_alone(tmp_path):
    """A receiver that does not count is not one without satellites."""
    told = written(
        tmp_path,
        quality_messages('gnss/quality', TIME[:1], ARRIVAL[:1], np.array([-1]), np.array([1.5])),
    )
    ((_, _, message),) = told
    (status,) = message.status
    assert status.level == 0
    assert [(p.key, p.value) for p in status.values] == [('hdop', '1.50')]


def test_stamps_that_cannot_be_written(tmp_path):
    with pytest.raises(DataError, match='stamps run from 0'):
        written(
            tmp_path,
            fix_messages('gnss/fix', -TIME, ARRIVAL, GEODETIC, COVARIANCE, STATUS),
        )
