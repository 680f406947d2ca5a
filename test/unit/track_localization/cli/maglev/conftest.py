"""A run of known motion in a bag: 20 m/s from chainage 0 for 20 s, after 2 s at rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
TWIST = 'geometry_msgs/msg/TwistWithCovarianceStamped'
ODOMETRY = 'nav_msgs/msg/Odometry'
BEGIN_S, REST_S, RIDE_S, SPEED = 1000.0, 2.0, 20.0, 20.0
BALISES = {'A': 100.0, 'B': 200.0, 'C': 300.0}


def make(kind: str, **content: Any) -> Any:
    return STORE.types[kind](**content)


def header(time_s: float, frame: str) -> Any:
    sec, nanosec = divmod(round(time_s * 1e9), 10**9)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def with_pose(x: float, y: float, z: float, variance: float) -> Any:
    covariance = np.zeros(36)
    covariance[0] = variance
    inner = make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', x=x, y=y, z=z),
        orientation=make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return make('geometry_msgs/msg/PoseWithCovariance', pose=inner, covariance=covariance)


def with_twist(x: float, variance: float) -> Any:
    covariance = np.zeros(36)
    covariance[0] = variance
    zero = make('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=0.0)
    linear = make('geometry_msgs/msg/Vector3', x=x, y=0.0, z=0.0)
    twist = make('geometry_msgs/msg/Twist', linear=linear, angular=zero)
    return make('geometry_msgs/msg/TwistWithCovariance', twist=twist, covariance=covariance)


def pose(time_s: float, x: float, variance: float, frame: str) -> Any:
    return make(POSE, header=header(time_s, frame), pose=with_pose(x, 0.0, 0.0, variance))


def twist(time_s: float, x: float, variance: float, frame: str = 'base_link') -> Any:
    return make(TWIST, header=header(time_s, frame), twist=with_twist(x, variance))


def odometry(time_s: float, place: tuple[float, float, float], speed: float) -> Any:
    return make(
        ODOMETRY,
        header=header(time_s, 'map'),
        child_frame_id='base_link',
        pose=with_pose(*place, 0.0),
        twist=with_twist(speed, 0.0),
    )


def motion(time_s: float) -> tuple[float, float]:
    """Return the true chainage and speed."""
    ridden = max(time_s - BEGIN_S - REST_S, 0.0)
    return SPEED * ridden, SPEED if ridden > 0.0 else 0.0


Topics = dict[str, tuple[str, list[tuple[float, Any]]]]


def topics_of_the_run(
    place: Callable[[float], tuple[float, float, float]] = lambda s: (s, 0.0, 0.0),
) -> Topics:
    """Return {topic: (type, [(arrival [s], message)])}; ``place`` gives ``map`` by chainage."""
    times = BEGIN_S + np.arange(0.0, REST_S + RIDE_S, 0.1)
    passed = {name: BEGIN_S + REST_S + at / SPEED for name, at in BALISES.items()}
    return {
        '/loop/pose': (POSE, [(t + 0.01, pose(t, motion(t)[0], 0.01, 'track')) for t in times]),
        '/radar/twist': (TWIST, [(t + 0.02, twist(t, motion(t)[1], 0.01)) for t in times]),
        '/balise/pose': (
            POSE,
            [(t + 0.03, pose(t, 0.0, 1e-4, f'balise_{name}')) for name, t in passed.items()],
        ),
        '/ground_truth/odometry': (
            ODOMETRY,
            [(t, odometry(t, place(motion(t)[0]), motion(t)[1])) for t in times],
        ),
    }


@dataclasses.dataclass
class Run:
    """A folder as ``simulate maglev`` leaves it: ``bag`` and ``balises.csv``."""

    folder: Path
    topics: Topics

    @property
    def bag(self) -> Path:
        return self.folder / 'bag'

    def write(self) -> Path:
        """Write the bag anew; return its path."""
        if self.bag.exists():
            for file in self.bag.iterdir():
                file.unlink()
            self.bag.rmdir()
        with Writer(self.bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for topic, (kind, rows) in self.topics.items():
                connection = writer.add_connection(topic, kind, typestore=STORE)
                for arrival_s, message in rows:
                    cdr = STORE.serialize_cdr(message, kind)
                    writer.write(connection, round(arrival_s * 1e9), cdr)
        return self.bag

    def write_balises(self, *rows: str) -> Path:
        path = self.folder / 'balises.csv'
        known = rows or [f'{name},{at},0.05' for name, at in BALISES.items()]
        path.write_text('\n'.join(['id,chainage_m,sigma_m', *known]) + '\n')
        return path


@pytest.fixture
def run(tmp_path: Path) -> Run:
    made = Run(tmp_path / 'run', topics_of_the_run())
    made.folder.mkdir()
    made.write()
    made.write_balises()
    return made
