"""``evaluate coaster BAG``: every method over one recording; figures, trajectories, a report."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from typing import Any

from coaster_localization.methods import METHODS, MethodResult, run_methods
from track_localization.cli.arguments import add_evaluation
from track_localization.cli.coaster import inputs as coaster_inputs
from track_localization.cli.coaster import pictures as coaster_pictures
from track_localization.cli.coaster import sweeps as coaster_sweeps
from track_localization.cli.coaster.evaluate_files import report_sections, write_bag
from track_localization.cli.coaster.evaluate_notes import notes
from track_localization.cli.coaster.results import Reference, figures, floor_figures, table
from track_localization.cli.coaster.usable import usable
from track_localization.cli.common import guarded, say
from track_localization.cli.files import make_folder, write_metrics, write_trajectories
from track_localization.cli.parameters import config_text
from track_localization.cli.progress import Progress
from track_localization.evaluation import provenance
from track_localization.evaluation.report import Picture, write_report


def main(argv: Sequence[str] | None = None) -> int:
    """Parse arguments, evaluate, write; return the exit code."""
    args = make_parser().parse_args(argv)
    return guarded(lambda: run(args))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='evaluate coaster',
        description='Run every method over a recording and write metrics.json, '
        'trajectory_<method>.csv and .tum, pictures, report.html and a bag of the results. '
        'track.csv, design_ride.csv and markers.csv are looked for beside the bag.',
    )
    coaster_inputs.add_arguments(parser)
    add_evaluation(parser, METHODS)
    parser.add_argument(
        '--sweeps',
        action='store_true',
        help="draw the paper's Figures 14 and 15 too: some thirty runs of its filter (needs "
        'markers and srdtw_z)',
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Evaluate one recording as the arguments say."""
    inputs = coaster_inputs.read_inputs(args)
    for finding in inputs.recording.findings:
        say(str(finding))
    methods, recording, left_out = usable(args.methods, inputs.recording)
    inputs = dataclasses.replace(inputs, recording=recording)
    make_folder(args.output)
    markers = inputs.markers
    reference = Reference.of(
        inputs.recording.truth,
        inputs.design,
        None if markers is None else markers.time_s,
        None if markers is None else markers.position,
    )
    results, metrics = _run_methods(methods, inputs, reference)
    content = _content(args, inputs, reference, metrics)
    write_metrics(args.output, content)
    write_trajectories(args.output, {name: r.trajectory for name, r in results.items()})
    write_bag(args.output / 'results', inputs, results)
    pictures = [] if args.no_plots else _pictures(args, inputs, results, reference)
    title = 'error [m] over the moving part of the ride' if reference.truth else 'methods'
    shown, said = table(metrics, title), left_out + notes(inputs, results, metrics)
    settings = config_text(inputs.config)
    sections = report_sections(content, shown, said, pictures, settings)
    write_report(args.output / 'report.html', f'Roller coaster: {args.bag}', sections)
    print('\n'.join([shown.text(), '', *said, '', str(args.output / 'report.html')]))


def _run_methods(
    methods: Sequence[str], inputs: coaster_inputs.Inputs, reference: Reference
) -> tuple[dict[str, MethodResult], dict[str, Any]]:
    """Return each method's result and its entry in metrics.json."""
    imu = inputs.recording.imu
    duration_s = float(imu.time_s[-1] - imu.time_s[0])
    results: dict[str, MethodResult] = {}
    metrics: dict[str, Any] = {}
    with Progress(len(methods), 'method') as progress:
        for result in run_methods(
            imu, inputs.design, inputs.config, methods, progress.begin, inputs.learned
        ):
            results[result.name] = result
            metrics[result.name] = figures(result, reference, duration_s)
            progress.done()
    return results, metrics


def _content(
    args: argparse.Namespace,
    inputs: coaster_inputs.Inputs,
    reference: Reference,
    metrics: dict[str, Any],
) -> dict[str, Any]:
    """Return what goes into metrics.json."""
    imu = inputs.recording.imu
    return {
        'system': 'coaster',
        'commit': provenance.commit(),
        'bag': str(args.bag),
        'methods': metrics,
        'floor': floor_figures(reference),
        'data': {
            'files': {role: str(path) for role, path in inputs.files.items()},
            'duration_s': float(imu.time_s[-1] - imu.time_s[0]),
            'samples': len(imu),
            'rejected': inputs.recording.rejected,
        },
        'machine': provenance.machine(),
    }


def _pictures(
    args: argparse.Namespace, inputs: coaster_inputs.Inputs, results: Any, reference: Reference
) -> list[Picture]:
    matches = {name: r.match for name, r in results.items() if r.match is not None}
    sweeps = None
    runs = coaster_sweeps.runs(matches)
    if args.sweeps and inputs.markers is not None and runs and inputs.recording.imu.has_gyro:
        with Progress(runs, 'sweep') as progress:

            def step(label: str) -> None:
                progress.begin(label)
                progress.done()

            sweeps = coaster_sweeps.sweep(
                inputs.recording.imu, inputs.design, inputs.config, matches, reference, step
            )
    return coaster_pictures.draw(args.output, inputs, results, reference, sweeps)


if __name__ == '__main__':
    raise SystemExit(main())
