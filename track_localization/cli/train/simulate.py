"""``simulate train``: a recorded run with sensors and truth, from a seed and a scenario."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import yaml

from track_localization.cli.arguments import (
    add_simulation,
    scenario_list,
    settings_parser,
    simulation,
)
from track_localization.cli.common import guarded, plain, say
from track_localization.cli.files import make_folder
from track_localization.geodesy import Datum
from track_localization.io import codec
from track_localization.io.bag_writer import BagWriter, Message
from track_localization.io.gnss_messages import fix_messages, quality_messages
from track_localization.io.sensor_messages import odometry_messages, twist_messages
from track_localization.sim.train import (
    SCENARIOS,
    SimulatedRun,
    StartPose,
    TrainSimConfig,
    scenario,
    simulate_train,
)
from track_localization.track.track_file import write_track

INFO, TRACK, DATUM = 'run_info.yaml', 'track.csv', 'datum.yaml'

DECIMALS = 12
"""Of a written degree: a tenth of a micrometre on the ground."""


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, simulate, write files; return the exit code."""
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.list:
        print(scenario_list(SCENARIOS))
        return 0
    config = simulation(parser, args, SCENARIOS, scenario)
    return guarded(lambda: run(args, config))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; its epilog lists every setting."""
    parser = settings_parser(
        'simulate train',
        'Simulate a run: DIR/bag (mcap: imu/data_raw, gnss/fix, gnss/quality, '
        'wheel/twist, ground_truth/odometry, and initialpose where the start is told), track.csv, '
        'datum.yaml, run_info.yaml.',
        TrainSimConfig(),
    )
    add_simulation(parser, 'line', 'scenarios')
    return parser


def run(args: argparse.Namespace, config: TrainSimConfig) -> None:
    """Simulate as the arguments say and write everything."""
    say(f'simulating {args.scenario}, seed {args.seed}')
    simulated = simulate_train(config, args.seed)
    write(
        simulated,
        args.output,
        {
            'system': 'train',
            'scenario': args.scenario,
            'seed': args.seed,
            'outages_s': [list(span) for span in simulated.outages],
            'config': plain(config),
            'injected': simulated.info,
        },
    )


def write(simulated: SimulatedRun, folder: Path, info: dict[str, object]) -> None:
    """Write the bag and the files beside it."""
    make_folder(folder)
    count = len(simulated.imu) + len(simulated.gnss) + len(simulated.wheel)
    say(f'writing {count} measurements, {simulated.duration_s:.0f} s')
    write_bag(simulated, folder / 'bag')
    if simulated.track is not None:
        write_track(folder / TRACK, simulated.track)
    elif (folder / INFO).exists():
        (folder / TRACK).unlink(missing_ok=True)  # of the run that was here before
    _write_yaml(folder / DATUM, datum_settings(simulated.datum))
    _write_yaml(folder / INFO, info)
    print(folder)


def write_bag(simulated: SimulatedRun, path: Path) -> None:
    """Write sensors and truth in the order of arrival; a fix follows what is told of it."""
    gnss, wheel = simulated.gnss, simulated.wheel
    geodetic = np.stack([gnss.latitude, gnss.longitude, gnss.height], axis=1)
    when = gnss.time_s, gnss.arrival_s
    with BagWriter(path, overwrite=True, compress=True) as bag:
        bag.write_in_order(
            _start_messages('initialpose', simulated.start),
            quality_messages('gnss/quality', *when, gnss.satellites, gnss.hdop),
            fix_messages('gnss/fix', *when, geodetic, gnss.covariance, gnss.status),
            twist_messages(
                'wheel/twist', wheel.time_s, wheel.arrival_s, wheel.speed, wheel.variance
            ),
            _imu_messages('imu/data_raw', simulated),
            odometry_messages('ground_truth/odometry', simulated.truth()),
        )


def datum_settings(datum: Datum) -> dict[str, float]:
    """Return a datum as ``datum.yaml`` holds it."""
    return {
        'latitude_deg': round(float(np.degrees(datum.latitude_rad)), DECIMALS),
        'longitude_deg': round(float(np.degrees(datum.longitude_rad)), DECIMALS),
        'height_m': datum.height_m,
    }


def _imu_messages(topic: str, simulated: SimulatedRun) -> Iterator[Message]:
    """Yield Imu in order of arrival; their stamps need not be in order."""
    cdrs = codec.imu_cdrs(simulated.imu, 'imu_link')
    for arrival, (_, cdr) in zip(simulated.imu_arrival_s.tolist(), cdrs, strict=True):
        yield Message(topic, codec.IMU, codec.stamp_ns(arrival), cdr)


def _start_messages(topic: str, start: StartPose | None) -> Iterator[Message]:
    """Yield the pose that an aligned start is told, if it is."""
    if start is None:
        return
    place = (np.array([start.time_s]), start.position[None], None, start.quaternion[None])
    ((ns, cdr),) = codec.pose_cdrs(*place, 'map')
    numbers = start.covariance.astype('<f8').tobytes()
    yield Message(topic, codec.POSE, ns, cdr[: -len(numbers)] + numbers)


def _write_yaml(path: Path, content: dict[str, object] | dict[str, float]) -> None:
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    path.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    raise SystemExit(main())
