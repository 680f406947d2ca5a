"""Simulated runs behind ``reproduce``: run in worker processes, their figures kept as CSV files."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Generic, TypeVar

from track_localization.cli.common import say
from track_localization.cli.files import make_folder
from track_localization.cli.progress import Progress
from track_localization.errors import DataError

Figures = dict[str, float | str]

T = TypeVar('T')
R = TypeVar('R')


@dataclasses.dataclass(frozen=True)
class Keeper(Generic[T, R]):
    """
    How the tasks T of one exam become results R.

    Attributes:
        what: the results are, for people: ``rides``.
        run: makes a result; a function of a module, for it goes to worker processes.
        file: name of the file that keeps a task's result.
        read: (path, task, code) -> the kept result, or None where there is none that serves: made
            by the same code (None: by any), with all that the task wants.
        write: (path, result, code) keeps a result.
        label: of a result, for progress.
    """

    what: str
    run: Callable[[T], R]
    file: Callable[[T], str]
    read: Callable[[Path, T, str | None], R | None]
    write: Callable[[Path, R, str], None]
    label: Callable[[R], str]

    def gather(
        self, tasks: Sequence[T], folder: Path, jobs: int, reprint: bool, code: str
    ) -> list[R]:
        """
        Return the results, those kept in ``folder`` and the others run now, ``jobs`` at a time.

        With ``reprint`` nothing is run, and results serve that another code has made.
        """
        results, left = self._kept(tasks, folder, None if reprint else code)
        if reprint:
            if not results:
                remedy = 'run without --reprint first'
                raise DataError(f'{folder}: no {self.what} are kept there; {remedy}')
            say(f'{len(results)} {self.what} kept in {folder}, {len(left)} missing')
            return results
        say(f'{len(left)} {self.what} to run, {len(results)} kept in {folder}')
        make_folder(folder)
        with Progress(len(left), self.what, quiet_s=10.0) as progress:
            for task, result in pool(self.run, left, jobs):
                self.write(folder / self.file(task), result, code)
                results.append(result)
                progress.done()
                progress.bar(self.label(result))
        return results

    def _kept(self, tasks: Sequence[T], folder: Path, code: str | None) -> tuple[list[R], list[T]]:
        """Return the results whose files serve, and the tasks left to run."""
        found = [(task, self.read(folder / self.file(task), task, code)) for task in tasks]
        return [r for _, r in found if r is not None], [task for task, r in found if r is None]


def pool(run: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[tuple[T, R]]:
    """Run the tasks, ``jobs`` at a time, and yield each as it ends."""
    if jobs <= 1:
        for task in tasks:
            yield task, run(task)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context('spawn')) as workers:
        running: dict[Future[R], T] = {workers.submit(run, task): task for task in tasks}
        try:
            while running:
                ended, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    yield running.pop(future), future.result()
        finally:
            for future in running:
                future.cancel()


def write_figures(path: Path, about: Figures, methods: Mapping[str, Figures], code: str) -> None:
    """Write figures as rows ``method,figure,value``, whole or not at all; ``about`` has none."""
    rows = [('', 'code', code), *(('', k, v) for k, v in about.items())]
    rows += [(m, k, v) for m, entry in methods.items() for k, v in entry.items()]
    part = path.with_suffix('.part')
    with part.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(('method', 'figure', 'value'))
        writer.writerows((m, k, repr(v) if isinstance(v, float) else v) for m, k, v in rows)
    part.replace(path)


def read_figures(path: Path, code: str | None) -> tuple[Figures, dict[str, Figures]] | None:
    """Return (about, methods) of a file made by ``code`` (None: by any); None without it."""
    if not path.is_file():
        return None
    about: Figures = {}
    methods: dict[str, Figures] = {}
    with path.open(encoding='utf-8', newline='') as file:
        for row in csv.DictReader(file):
            entry = methods.setdefault(row['method'], {}) if row['method'] else about
            entry[row['figure']] = _value(row['value'])
    if code is not None and about.pop('code', None) != code:
        return None
    return about, methods


def flat(content: Mapping[str, Any], prefix: str = '') -> Figures:
    """Return nested figures under dotted names, elements of a list by their number."""
    out: Figures = {}
    for name, value in content.items():
        if isinstance(value, list):
            out |= flat({str(k): element for k, element in enumerate(value)}, f'{prefix}{name}.')
        elif isinstance(value, Mapping):
            out |= flat(value, f'{prefix}{name}.')
        else:
            out[prefix + name] = value if isinstance(value, str) else float(value)
    return out


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
