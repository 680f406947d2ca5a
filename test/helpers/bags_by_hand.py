"""Bags written by rosbags alone, apart from the code under test."""

import numpy as np
from rosbags.rosbag2 import CompressionFormat, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from track_localization.estimation.imu import ImuSeries

STORE = get_typestore(Stores.ROS2_JAZZY)


def imu_series(n=400, start=5.0):
    rng = np.random.default_rng(3)
    time = start + np.arange(n) / 100.0
    return ImuSeries(time, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))


def raw_imu(sec, nanosec, force=(0.0, 0.0, 9.81)):
    """Return an Imu message built field by field, apart from the code under test."""
    t = STORE.types
    return t['sensor_msgs/msg/Imu'](
        header=t['std_msgs/msg/Header'](
            stamp=t['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec), frame_id='imu_link'
        ),
        orientation=t['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=0.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=t['geometry_msgs/msg/Vector3'](x=0.1, y=0.2, z=0.3),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=t['geometry_msgs/msg/Vector3'](x=force[0], y=force[1], z=force[2]),
        linear_acceleration_covariance=np.zeros(9),
    )


def write_foreign(path, topics, storage=StoragePlugin.MCAP, compression=None, version=9):
    """Write {topic: (type, [(log ns, message)])} with rosbags alone."""
    writer = Writer(path, version=version, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        for topic, (kind, rows) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for ns, message in rows:
                writer.write(connection, ns, STORE.serialize_cdr(message, kind))


def imu_rows(n, start=100):
    return [
        ((start + k) * 10**9, raw_imu(start + k, 500_000_000, (float(k), 0.0, 9.81)))
        for k in range(n)
    ]
