"""``simulate coaster``: a recorded run with sensors and truth, from a seed and a scenario."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import yaml

from track_localization.cli.arguments import (
    add_simulation,
    scenario_list,
    settings_parser,
    simulation,
)
from track_localization.cli.common import guarded, plain, say
from track_localization.cli.files import make_folder
from track_localization.errors import DataError
from track_localization.io.bags import BagWriter
from track_localization.io.tables import write_markers
from track_localization.sim.coaster import (
    SCENARIOS,
    TRACKS,
    CoasterModel,
    CoasterSimConfig,
    SimulatedRide,
    prepare,
    scenario,
    simulate_coaster,
)
from track_localization.sim.coaster.designs import DESIGNS
from track_localization.sim.coaster.ride_plan import read_plan, write_plan
from track_localization.sim.coaster.simulate import built_in_model
from track_localization.sim.coaster.tracks import built_in
from track_localization.track.design_ride import write_design_ride
from track_localization.track.track_file import read_track, write_track


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, simulate, write files; return the exit code."""
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.list:
        print(_listing())
        return 0
    if args.ship is not None:
        return guarded(lambda: ship(args.ship))
    config = simulation(parser, args, SCENARIOS, scenario)
    return guarded(lambda: run(args, config))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; its epilog lists every setting."""
    parser = settings_parser(
        'simulate coaster',
        'Simulate a run: DIR/bag (mcap: imu/data_raw, ground_truth/odometry), '
        'track.csv, design_ride.csv, markers.csv, ride_info.yaml.',
        CoasterSimConfig(),
    )
    add_simulation(parser, 'nominal', 'tracks and scenarios')
    parser.add_argument('--track', help='a built-in track, or a track file with --ride')
    parser.add_argument('--ride', type=Path, help='ride.yaml: train, zones and phases for a file')
    parser.add_argument(
        '--ship', type=Path, metavar='DIR', help='write track and ride plan of each built-in track'
    )
    return parser


def run(args: argparse.Namespace, config: CoasterSimConfig) -> None:
    """Simulate as the arguments say and write everything."""
    model = load_model(args.track, args.ride, args.scenario)
    say(f'simulating {model.name}, {args.scenario}, seed {args.seed}')
    ride = simulate_coaster(model, config, args.seed)
    write(
        ride,
        args.output,
        {
            'system': 'coaster',
            'track': model.name,
            'scenario': args.scenario,
            'seed': args.seed,
            'mount_R_bm': ride.R_bm.tolist(),
            'clock_offset_s': ride.clock_offset_s,
            'config': plain(config),
        },
    )


def load_model(track: str | None, plan: Path | None, scenario_name: str) -> CoasterModel:
    """Return the named or read track made ready; raise DataError when it cannot be ridden."""
    if track is None:
        track = 'shuttle' if scenario_name == 'shuttle' else TRACKS[0]
    if track in TRACKS and plan is None:
        return built_in_model(track)
    path = Path(track)
    if track not in TRACKS and not path.exists():
        raise DataError(f'--track {track}: neither a file nor one of {", ".join(TRACKS)}')
    beside = path.with_suffix('.yaml')
    if plan is None and beside.exists():
        plan = beside
    if plan is None:
        raise DataError(f'--track {track}: name its --ride ride.yaml (see config/tracks/*.yaml)')
    file = built_in(track).file if track in TRACKS else read_track(path)
    return prepare(file, read_plan(plan), path.stem)


def write(ride: SimulatedRide, folder: Path, info: dict[str, object]) -> None:
    """Write the bag and the files beside it."""
    make_folder(folder)
    say(f'writing {len(ride.imu)} samples, {ride.imu.time_s[-1] - ride.imu.time_s[0]:.0f} s')
    with BagWriter(folder / 'bag', overwrite=True) as bag:
        bag.write_imu('imu/data_raw', ride.imu)
        bag.write_odometry('ground_truth/odometry', ride.truth)
    write_track(folder / 'track.csv', ride.track)
    write_design_ride(folder / 'design_ride.csv', ride.design)
    write_markers(folder / 'markers.csv', ride.markers)
    text = yaml.safe_dump(info, sort_keys=False, default_flow_style=None)
    (folder / 'ride_info.yaml').write_text(text, encoding='utf-8')
    print(folder)


def ship(folder: Path) -> None:
    """Write NAME.csv and NAME.yaml of every built-in track."""
    make_folder(folder, '--ship')
    for name in TRACKS:
        track = built_in(name)
        write_track(folder / f'{name}.csv', track.file)
        write_plan(folder / f'{name}.yaml', track.plan, track.title)
        say(f'{folder / name}.csv, .yaml')


def _listing() -> str:
    tracks = '\n'.join(f'  {name:12} {DESIGNS[name].title}' for name in TRACKS)
    listed = scenario_list(SCENARIOS)
    return f'tracks:\n{tracks}\n{listed}\n(shuttle also selects that track)'


if __name__ == '__main__':
    raise SystemExit(main())
