"""``simulate maglev``: a recorded run with sensors and truth, from a seed and a scenario."""

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
from track_localization.io.bag_writer import BagWriter
from track_localization.io.sensor_messages import (
    odometry_messages,
    pose_messages,
    twist_messages,
)
from track_localization.sim.maglev import (
    SCENARIOS,
    MaglevSimConfig,
    SimulatedRun,
    scenario,
    simulate_maglev,
)
from track_localization.track.balise_table import write_balises
from track_localization.track.track_file import write_track

INFO, TRACK = 'run_info.yaml', 'track.csv'


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
        'simulate maglev',
        'Simulate a run: DIR/bag (mcap: loop/pose, radar/twist, balise/pose, '
        'ground_truth/odometry), balises.csv, run_info.yaml, and track.csv if the line curves.',
        MaglevSimConfig(),
    )
    add_simulation(parser, 'line', 'scenarios')
    return parser


def run(args: argparse.Namespace, config: MaglevSimConfig) -> None:
    """Simulate as the arguments say and write everything."""
    say(f'simulating {args.scenario}, seed {args.seed}')
    simulated = simulate_maglev(config, args.seed)
    write(
        simulated,
        args.output,
        {
            'system': 'maglev',
            'scenario': args.scenario,
            'seed': args.seed,
            'line_length_m': config.line.length_m * config.line.sections,
            'config': plain(config),
            'injected': simulated.info,
        },
    )


def write(simulated: SimulatedRun, folder: Path, info: dict[str, object]) -> None:
    """Write the bag and the files beside it."""
    make_folder(folder)
    count = len(simulated.balise) + len(simulated.loop) + len(simulated.radar)
    say(f'writing {count} measurements, {simulated.duration_s:.0f} s')
    write_bag(simulated, folder / 'bag')
    write_balises(folder / 'balises.csv', simulated.table)
    if simulated.track is not None:
        write_track(folder / TRACK, simulated.track)
    elif (folder / INFO).exists():
        (folder / TRACK).unlink(missing_ok=True)  # of the run that was here before
    text = yaml.safe_dump(info, sort_keys=False, default_flow_style=None)
    (folder / INFO).write_text(text, encoding='utf-8')
    print(folder)


def write_bag(simulated: SimulatedRun, path: Path) -> None:
    """Write sensors and truth in the order of arrival."""
    balise, loop, radar = simulated.balise, simulated.loop, simulated.radar
    frames = [f'balise_{told}' for told in balise.id]
    with BagWriter(path, overwrite=True, compress=True) as bag:
        bag.write_in_order(
            pose_messages('balise/pose', *balise.columns(), frames),
            pose_messages('loop/pose', *loop.columns(), 'track'),
            twist_messages('radar/twist', *radar.columns()),
            odometry_messages('ground_truth/odometry', simulated.truth()),
        )


if __name__ == '__main__':
    raise SystemExit(main())
