"""The maglev's node with its real filter: practice before the start, restarts, starts under way."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode
from maglev_localization.pipeline import MaglevPipeline
from track_localization.ros.convert import seconds, set_stamp

SPEED_MPS, PITCH_M = 20.0, 0.2


def pose(x, frame='track', variance=0.01) -> PoseWithCovarianceStamped:
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = frame
    msg.pose.pose.position.x, msg.pose.covariance[0] = float(x), variance
    return msg


class Train:
    """A train at 20 m/s from chainage 0; its counter begins at ``count_m``."""

    def __init__(self, *nodes, count_m: float = 0.0) -> None:
        self.nodes, self.count_m, self.k = nodes, count_m, 0

    @property
    def s(self) -> float:
        return SPEED_MPS * 0.01 * self.k

    def drive(self, seconds_: float) -> None:
        for _ in range(round(100 * seconds_)):
            self.k += 1
            if self.k % 2 == 0:
                msg = pose((self.s + self.count_m) // PITCH_M * PITCH_M)
                self.tell('on_loop', msg)
            if self.k % 5 == 0:
                msg = TwistWithCovarianceStamped()
                msg.header.frame_id = 'base_link'
                msg.twist.twist.linear.x, msg.twist.covariance[0] = SPEED_MPS, 0.01
                self.tell('on_radar', msg)

    def pass_balise(self, name: str, variance: float = 1e-4) -> None:
        """Tell of a balise where the train was last, a moment later."""
        later_s = 0.004
        self.tell('on_balise', pose(SPEED_MPS * later_s, f'balise_{name}', variance), later_s)

    def tell(self, callback: str, msg, later_s: float = 0.0) -> None:
        set_stamp(msg.header.stamp, 1000.0 + 0.01 * self.k + later_s)
        for node in self.nodes:
            getattr(node, callback)(msg)


@pytest.fixture(params=['robust', 'kalman', 'paper'])
def make(request, ros, maglev_files):
    def node(*args, **settings):
        settings = {'method': request.param, 'motion__start_speed_sigma_mps': 10.0} | settings
        return ros.make(MaglevFederatedPfNode, *args, **maglev_files, **settings)

    return node


def near(node, s: float) -> bool:
    """Whether the chainage published last is ``s``, within 3 sigma and the counter's pitch."""
    along = node._chainage.pose
    return abs(along.pose.position.x - s) < 3.0 * along.covariance[0] ** 0.5 + PITCH_M


def test_warming_up_leaves_no_trace(make):
    cold, warm = make(), make(MaglevPipeline, True)
    Train(cold, warm).drive(8.0)
    assert warm._chainage == cold._chainage
    assert warm._odometry == cold._odometry
    assert warm.filter.diagnostics() == cold.filter.diagnostics()
    assert warm.filter.rejected == cold.filter.rejected


def test_a_start_told_under_way_moves_the_train(make):
    """The counter knows nothing of it; where the train is told to be the estimates go on."""
    node = make()
    train = Train(node)
    train.drive(8.0)
    assert near(node, train.s)
    node.on_initialpose(pose(1500.0, variance=0.25))
    assert dict(node.start.rejected) == {}
    before = train.s
    train.drive(4.0)
    assert node._chainage.pose.pose.position.x == pytest.approx(1500.0 + train.s - before, abs=3.0)


def test_a_place_in_map_is_a_start_too(make):
    """1800 m along (0.6, 0.8, 0) from (100, 200, 5), and 2 m beside the line."""
    node = make()
    train = Train(node)
    train.drive(2.0)
    start = pose(100.0 + 1080.0 - 1.6, frame='map')
    start.pose.pose.position.y, start.pose.pose.position.z = 200.0 + 1440.0 + 1.2, 5.0
    start.pose.covariance[::7] = 0.25
    node.on_initialpose(start)
    before = train.s
    train.drive(4.0)
    assert node._chainage.pose.pose.position.x == pytest.approx(1800.0 + train.s - before, abs=3.0)
    p = node._odometry.pose.pose.position
    assert p.y / 0.8 == pytest.approx((200.0 + 0.8 * node._chainage.pose.pose.position.x) / 0.8)


def test_reset_while_running_starts_from_the_next_reading(ros, make):
    """After it the loop's reading is the chainage again, whatever was before."""
    node = make()
    train = Train(node)
    train.drive(2.0)
    node.on_initialpose(pose(1500.0, variance=0.25))
    train.drive(4.0)
    caller = ros.node('caller')
    client = caller.create_client(Trigger, 'maglev_federated_pf/reset')
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success
    assert len(node._path) == 0
    train.drive(4.0)
    assert near(node, train.s)
    assert seconds(node._odometry.header.stamp) == pytest.approx(1000.0 + 0.01 * train.k, abs=0.1)


def test_a_balise_mends_a_counter_that_began_elsewhere(make):
    """The count is 3 m ahead; balise a at 500 m tells, though another was told in between."""
    node = make(motion__start_sigma_m=5.0)
    train = Train(node, count_m=3.0)
    train.drive(20.0)
    train.pass_balise('nobody')
    train.drive(5.0)
    assert train.s == 500.0
    train.pass_balise('a')
    train.drive(2.0)
    assert node._chainage.pose.pose.position.x == pytest.approx(train.s, abs=0.5)
    assert sum(node.filter.rejected['balise'].values()) == 1


COMPILED = """
import sys
from numba.core.dispatcher import Dispatcher
import rclpy
from rclpy.parameter import Parameter
from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from maglev_localization.nodes.federated_pf import MaglevFederatedPfNode
from track_localization.settings import override
from track_localization.sim.maglev import scenario, simulate_maglev


def compiled():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith(('maglev_localization', 'track_localization')):
            for key, value in list(vars(module).items()):
                if isinstance(value, Dispatcher):
                    found[f'{name}.{key}'] = len(value.signatures)
    return found


method, balises, track = sys.argv[1:]
given = {'method': method, 'balises': balises, 'track': track}
rclpy.init()
node = MaglevFederatedPfNode(
    warm_up=True, parameter_overrides=[Parameter(k, value=v) for k, v in given.items()]
)
before = compiled()
assert sum(before.values()) > 3, before
line = {'line.length_m': 3000.0, 'line.stops_m': '0 1300 3000', 'balise.first_m': 500.0}
for name in ('line', 'startunknown', 'radardead'):
    start = {'motion.start_chainage_m': [100.0, 100.0]} if name == 'startunknown' else {}
    run = simulate_maglev(override(scenario(name), line | start), seed=4)
    node.filter.reset()
    for sensor, i in run.arrivals():
        stream = getattr(run, sensor)
        t, _, value, variance = (float(c[i]) for c in stream.columns())
        if sensor == 'balise':
            measurement = BalisePassing(t, stream.id[i], value, variance)
        else:
            measurement = (LoopPosition if sensor == 'loop' else RadarSpeed)(t, value, variance)
        for estimate in node.filter.push(measurement):
            node._publish(estimate)
after = compiled()
late = {k: n for k, n in after.items() if n > before.get(k, 0) and 'sim' not in k}
print('late:', late)
node.destroy_node()
rclpy.try_shutdown()
"""


@pytest.mark.parametrize('method', ['robust', 'kalman', 'paper'])
def test_warming_up_compiles_all_that_a_run_uses(tmp_path, maglev_files, method):
    """In a process of its own: here other tests have compiled everything already."""
    script = tmp_path / 'compiled.py'
    script.write_text(COMPILED, encoding='utf-8')
    files = (maglev_files['balises'], maglev_files['track'])
    done = subprocess.run(
        [sys.executable, str(script), method, *files],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env=dict(os.environ),
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == 'late: {}'


def test_an_unknown_start_is_told_by_its_sigma(ros, maglev_files):
    """The train may be anywhere on 3 km until a balise tells: uniform, 866 m."""
    node = ros.make(MaglevFederatedPfNode, **maglev_files, motion__start_known=False)
    odometries = ros.listen(ros.node('listener'), Odometry, 'odometry')
    ros.wait_matched(node._odometry_pub)
    train = Train(node)
    train.drive(1.0)
    assert node._chainage.pose.covariance[0] ** 0.5 > 500.0
    assert ros.spin_until(lambda: len(odometries) >= 15)
