"""``evaluate maglev BAG``: every method over one recording; figures, trajectories, a report."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from maglev_localization.config import MaglevConfig
from maglev_localization.methods import METHODS, run_methods
from track_localization.cli.arguments import add_evaluation, check_settings, settings_parser
from track_localization.cli.common import guarded, say
from track_localization.cli.files import make_folder, write_metrics, write_trajectories
from track_localization.cli.maglev.inputs import SENSORS, TRUTH_TOPIC, Inputs, add_arguments
from track_localization.cli.maglev.inputs import read_inputs as read
from track_localization.cli.maglev.pictures import draw
from track_localization.cli.maglev.results import (
    Outcome,
    figures,
    notes,
    outcome,
    refusals,
    tables,
)
from track_localization.cli.parameters import config_text
from track_localization.cli.progress import Progress
from track_localization.evaluation import provenance
from track_localization.evaluation.report import Picture, Section, write_report
from track_localization.evaluation.tabulate import Table
from track_localization.io import bags
from track_localization.io.bag_writer import BagWriter, Message
from track_localization.io.sensor_messages import odometry_messages


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, evaluate, write; return the exit code."""
    parser = make_parser()
    args = parser.parse_args(argv)
    check_settings(parser, args, MaglevConfig())
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; its epilog lists every setting."""
    parser = settings_parser(
        'evaluate maglev',
        'Run every method over a recording and write metrics.json, '
        'trajectory_<method>.csv and .tum, pictures, report.html and a bag of the results. '
        'balises.csv and track.csv are looked for beside the bag.',
        MaglevConfig(),
    )
    add_arguments(parser)
    add_evaluation(parser, METHODS)
    return parser


def run(args: argparse.Namespace) -> None:
    """Evaluate one recording as the arguments say."""
    inputs = read(args)
    for finding in inputs.findings:
        say(finding)
    folder = make_folder(args.output)
    outcomes, metrics = _run_methods(args.methods, inputs)
    content = _content(args, inputs, metrics)
    write_metrics(folder, content)
    write_trajectories(folder, {name: one.trajectory for name, one in outcomes.items()})
    _write_bag(folder / 'results', inputs, outcomes)
    pictures = [] if args.no_plots else draw(folder, inputs, outcomes)
    shown, said, refused = tables(metrics), notes(inputs, outcomes), refusals(metrics)
    if refused is not None:
        shown.append(refused)
    sections = _sections(content, shown, said, pictures, config_text(inputs.config))
    write_report(folder / 'report.html', f'Maglev train: {args.bag}', sections)
    blocks = [table.text() for table in shown] + ['\n'.join(said), str(folder / 'report.html')]
    print('\n\n'.join(block for block in blocks if block))


def _run_methods(
    methods: Sequence[str], inputs: Inputs
) -> tuple[dict[str, Outcome], dict[str, Any]]:
    """Return each method's outcome and its entry in metrics.json."""
    outcomes: dict[str, Outcome] = {}
    metrics: dict[str, Any] = {}
    with Progress(len(methods), 'method') as progress:
        for result in run_methods(
            inputs.measurements,
            inputs.config,
            inputs.balises,
            inputs.line_length_m,
            methods,
            progress.begin,
        ):
            outcomes[result.name] = outcome(result, inputs)
            metrics[result.name] = figures(outcomes[result.name], inputs)
            progress.done()
    return outcomes, metrics


def _content(
    args: argparse.Namespace, inputs: Inputs, metrics: Mapping[str, Any]
) -> dict[str, Any]:
    """Return metrics.json."""
    readings = inputs.readings
    return {
        'system': 'maglev',
        'commit': provenance.commit(),
        'bag': str(args.bag),
        'methods': metrics,
        'data': {
            'files': {role: str(path) for role, path in inputs.files.items()},
            'duration_s': readings.duration_s,
            'samples': {s.sensor: readings.count(s.sensor) for s in SENSORS},
            'rejected': {**readings.rejected, **inputs.rejected},
        },
        'machine': provenance.machine(),
    }


def _write_bag(folder: Path, inputs: Inputs, outcomes: Mapping[str, Outcome]) -> None:
    """
    Write the sensors as they were recorded, the truth, and the results as an mcap bag, by time.

    Topics: ``loop/pose``, ``radar/twist``, ``balise/pose``, ``ground_truth/odometry`` where there
    is one, and ``<method>/odometry`` of every method.
    """
    given = {topic: s.topic for s in SENSORS if (topic := inputs.readings.topics.get(s.sensor))}
    recorded = bags.raw_messages(inputs.files['bag'], list(given), {})
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
