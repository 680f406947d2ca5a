"""``evaluate train BAG``: every method over one recording; figures, trajectories, a report."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from track_localization.cli.arguments import add_evaluation, check_settings, settings_parser
from track_localization.cli.common import guarded, say
from track_localization.cli.files import make_folder, write_metrics, write_trajectories
from track_localization.cli.parameters import config_text
from track_localization.cli.progress import Progress
from track_localization.cli.train.inputs import START_TOPIC, TRUTH_TOPIC, Inputs, add_arguments
from track_localization.cli.train.inputs import read_inputs as read
from track_localization.cli.train.pictures import draw
from track_localization.cli.train.results import (
    Outcome,
    figures,
    notes,
    outcome,
    refusals,
    tables,
)
from track_localization.errors import DataError
from track_localization.evaluation import provenance
from track_localization.evaluation.report import Picture, Section, write_report
from track_localization.evaluation.tabulate import Table
from track_localization.io import bags
from track_localization.io.bag_writer import BagWriter, Message
from track_localization.io.gnss import TOPICS
from track_localization.io.sensor_messages import odometry_messages
from train_localization.config import TrainConfig
from train_localization.methods import MAP, METHODS, run_methods


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, evaluate, write; return the exit code."""
    parser = make_parser()
    args = parser.parse_args(argv)
    check_settings(parser, args, TrainConfig())
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; its epilog lists every setting."""
    parser = settings_parser(
        'evaluate train',
        'Run every method over a recording and write metrics.json, '
        'trajectory_<method>.csv and .tum, pictures, report.html and a bag of the results. '
        'track.csv and datum.yaml are looked for beside the bag.',
        TrainConfig(),
    )
    add_arguments(parser)
    add_evaluation(parser, METHODS)
    return parser


def run(args: argparse.Namespace) -> None:
    """Evaluate one recording as the arguments say."""
    inputs = read(args)
    if inputs.track is None and set(args.methods) == {MAP}:
        raise DataError(f'{args.bag}: {MAP} needs a track.csv beside the bag, or --track FILE')
    for finding in inputs.findings:
        say(finding)
    folder = make_folder(args.output)
    outcomes, metrics = _run_methods(args.methods, inputs)
    content = _content(args, inputs, metrics)
    write_metrics(folder, content)
    write_trajectories(folder, {name: one.trajectory for name, one in outcomes.items()})
    _write_bag(folder / 'results', inputs, outcomes)
    pictures = [] if args.no_plots else draw(folder, inputs, outcomes)
    shown, said, refused = tables(metrics, inputs), notes(inputs, outcomes), refusals(metrics)
    if refused is not None:
        shown.append(refused)
    sections = _sections(content, shown, said, pictures, config_text(inputs.config))
    write_report(folder / 'report.html', f'Train: {args.bag}', sections)
    blocks = [table.text() for table in shown] + ['\n'.join(said), str(folder / 'report.html')]
    print('\n\n'.join(block for block in blocks if block))


def _run_methods(
    methods: Sequence[str], inputs: Inputs
) -> tuple[dict[str, Outcome], dict[str, Any]]:
    """Return each method's outcome and its entry in metrics.json."""
    outcomes: dict[str, Outcome] = {}
    metrics: dict[str, Any] = {}
    wanted = [name for name in methods if name != MAP or inputs.track is not None]
    with Progress(len(wanted), 'method') as progress:
        for result in run_methods(
            inputs.measurements,
            inputs.config,
            inputs.track,
            inputs.datum,
            wanted,
            progress.begin,
            inputs.start,
        ):
            outcomes[result.name] = outcome(result, inputs)
            metrics[result.name] = figures(outcomes[result.name], inputs)
            progress.done()
    return outcomes, metrics


def _content(
    args: argparse.Namespace, inputs: Inputs, metrics: Mapping[str, Any]
) -> dict[str, Any]:
    """Return metrics.json."""
    recorded = inputs.recorded
    return {
        'system': 'train',
        'commit': provenance.commit(),
        'bag': str(args.bag),
        'methods': metrics,
        'data': {
            'files': {role: str(path) for role, path in inputs.files.items()},
            'duration_s': recorded.duration_s,
            'samples': {sensor: recorded.count(sensor) for sensor in TOPICS},
            'rejected': {**recorded.rejected, **inputs.rejected},
            'outages_s': [list(span) for span in inputs.outages],
            'start_told': inputs.start is not None,
        },
        'machine': provenance.machine(),
    }


def _write_bag(folder: Path, inputs: Inputs, outcomes: Mapping[str, Outcome]) -> None:
    """
    Write the sensors as they were recorded, the truth, and the results as an mcap bag, by time.

    Topics: those of the sensors, ``initialpose`` and ``ground_truth/odometry`` where there are
    some, and ``<method>/odometry`` of every method.
    """
    bag_in = inputs.files['bag']
    given = {inputs.recorded.topics[s]: TOPICS[s][0] for s in inputs.recorded.topics}
    if inputs.start is not None:
        name = bags.resolve_topic(bag_in, bags.list_topics(bag_in), START_TOPIC)
        given |= {name: START_TOPIC} if name else {}
    recorded = bags.raw_messages(bag_in, list(given), {})
    streams: list[Iterator[Message]] = [
        (Message(given[topic], kind, log_ns, cdr) for topic, kind, log_ns, cdr in recorded)
    ]
    if inputs.truth is not None:
        streams.append(odometry_messages(TRUTH_TOPIC, inputs.truth))
    streams += [
        odometry_messages(f'{name}/odometry', one.trajectory) for name, one in outcomes.items()
    ]
    with BagWriter(folder, overwrite=True, compress=True) as bag:
        bag.write_in_order(*streams)


def _sections(
    content: Mapping[str, Any],
    shown: Sequence[Table],
    said: Sequence[str],
    pictures: Sequence[Picture],
    config: str,
) -> list[Section]:
    """Return the report: figures first, pictures, then what one needs to repeat them."""
    data = content['data']
    facts = dict(data['files']) | {
        'duration': f'{data["duration_s"]:.1f} s',
        'messages': ', '.join(f'{sensor} {count}' for sensor, count in data['samples'].items()),
        'commit': content['commit'],
        **content['machine'],
    }
    return [
        Section('Figures', said, tables=shown),
        Section('Pictures', pictures=pictures),
        Section('Data, code and machine', facts=facts),
        Section('Settings', verbatim=config),
    ]


if __name__ == '__main__':
    raise SystemExit(main())
