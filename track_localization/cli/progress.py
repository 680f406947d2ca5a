"""Progress on stderr: how far, what now, how much longer."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

QUIET_S = 2.0
"""On something that is no terminal: least time between two lines [s]."""


class Progress:
    """
    Count steps and tell about them; use it in a ``with`` statement.

    A terminal sees one line that is rewritten; a file or a pipe gets the first line and then one
    every ``quiet_s`` seconds at most.
    """

    def __init__(
        self,
        total: int,
        title: str,
        quiet_s: float = QUIET_S,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total, self._title, self._quiet_s = total, title, quiet_s
        self._stream = stream if stream is not None else sys.stderr
        self._clock = clock
        self._begin = clock()
        self._told = float('-inf')
        self._done = 0
        self._width = 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream.isatty() and self._width:
            self._stream.write('\n')

    def begin(self, label: str) -> None:
        """Say what is being done now, as step number ``done`` + 1."""
        self._tell(f'{self._title} {min(self._done + 1, self._total)}/{self._total}: {label}')

    def done(self, count: int = 1) -> None:
        """Count steps as done."""
        self._done += count

    def bar(self, label: str = '') -> None:
        """Show the share that is done and the time left, judged by the time so far."""
        share = self._done / max(self._total, 1)
        filled = round(20 * share)
        line = f'{self._title} [{"#" * filled}{"." * (20 - filled)}] {self._done}/{self._total}'
        if 0 < self._done < self._total:
            line += f', {duration((self._clock() - self._begin) * (1.0 / share - 1.0))} left'
        self._tell(line + (f'  {label}' if label else ''))

    def _tell(self, line: str) -> None:
        now = self._clock()
        if self._stream.isatty():
            self._stream.write('\r' + line.ljust(self._width))
            self._width = len(line)
        elif now - self._told < self._quiet_s and self._done < self._total:
            return
        else:
            self._stream.write(line + '\n')
        self._told = now
        self._stream.flush()


def duration(seconds: float) -> str:
    """Return a time as people say it: 42 s, 3 min, 1 h 20 min."""
    if seconds < 90.0:
        return f'{seconds:.0f} s'
    minutes = round(seconds / 60.0)
    return f'{minutes} min' if minutes < 90 else f'{minutes // 60} h {minutes % 60} min'
