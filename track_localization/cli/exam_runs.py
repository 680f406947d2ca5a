"""One run of an exam: what is to be run, what became of it, and how that is kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from track_localization.cli.kept import Figures, Keeper, read_figures, write_figures


@dataclasses.dataclass(frozen=True)
class Task:
    """One run to simulate, and the entries of its case that take part."""

    case: str
    seed: int
    entries: tuple[str, ...]

    @property
    def file(self) -> str:
        """Name of the file that keeps its figures."""
        return f'{self.case}_{self.seed}.csv'


@dataclasses.dataclass(frozen=True)
class Run:
    """
    Figures of one run.

    Attributes:
        case, seed: which run.
        about: of the run itself, e.g. ``duration_s``, or ``failed`` with the reason.
        entries: dotted names as in metrics.json, e.g. ``position_m.rmse``, by entry.
    """

    case: str
    seed: int
    about: Figures
    entries: Mapping[str, Figures]


def keeper(run_task: Callable[[Task], Run]) -> Keeper[Task, Run]:
    """Return what runs tasks and keeps what they give."""
    return Keeper(
        'runs', run_task, lambda task: task.file, read_run, write_run,
        lambda run: f'{run.case} {run.seed}',
    )  # fmt: skip


def read_run(path: Path, task: Task, code: str | None) -> Run | None:
    """Return a kept run, or None where there is none that serves; see ``Keeper``."""
    found = read_figures(path, code)
    if found is None:
        return None
    about, entries = found
    if 'failed' not in about and not set(task.entries) <= set(entries):
        return None
    return Run(task.case, task.seed, about, {n: entries[n] for n in task.entries if n in entries})


def write_run(path: Path, run: Run, code: str) -> None:
    """Keep a run."""
    write_figures(path, run.about, run.entries, code)


def runs_note(runs: Sequence[Run]) -> list[str]:
    """Return sentences on what was run and what failed."""
    failed = [run for run in runs if 'failed' in run.about]
    told = [f'failed: {run.case} seed {run.seed}: {run.about["failed"]}' for run in failed]
    return [f'{len(runs)} runs, {len(failed)} failed.', *told]
