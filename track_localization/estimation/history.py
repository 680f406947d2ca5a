"""
Delayed measurements: a bounded history that is rewound and replayed.

A filter here is a function ``apply(state, measurement) -> state`` on immutable states. The history
keeps the last few seconds of measurements with the state after each. A late measurement is put in
its place by its stamp and everything after it is applied again, so the outcome does not depend on
the order of arrival.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar, cast

S = TypeVar('S')
S_co = TypeVar('S_co', covariant=True)
M = TypeVar('M')


class Run(Protocol[S_co]):
    """Successive states, of which each may be made when it is asked for: few ever are."""

    def __len__(self) -> int: ...

    def __getitem__(self, k: int, /) -> S_co: ...


class TooLateError(ValueError):
    """The measurement is older than the history reaches back."""


class History(Generic[S, M]):
    """
    A run of a filter that can be rewound ``horizon_s`` seconds.

    Measurements are ordered by (stamp, rank): at the same stamp the lower rank goes first.
    """

    def __init__(
        self,
        apply: Callable[[S, M], S],
        state: S,
        time_s: float,
        horizon_s: float,
        apply_all: Callable[[S, Sequence[M]], Sequence[Run[S]]] | None = None,
    ) -> None:
        """
        Begin with ``state`` at ``time_s`` [s].

        ``apply_all`` returns the states after each of several measurements, in runs one after the
        other, where there is a quicker way than one ``apply`` at a time; the outcome must be the
        same.
        """
        self._apply = apply
        self._apply_all = apply_all or self._one_by_one
        self._horizon_s = horizon_s
        self._keys: list[tuple[float, int]] = [(time_s, -1)]
        self._measurements: list[M | None] = [None]
        self._states: list[tuple[Run[S], int]] = [((state,), 0)]

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def state(self) -> S:
        """The state after the newest measurement."""
        return self._state(-1)

    def state_before(self, count: int) -> S:
        """Return the state before the newest ``count`` measurements; of those kept, the oldest."""
        return self._state(max(len(self._states) - 1 - count, 0))

    @property
    def newest_s(self) -> float:
        """Stamp of the newest measurement [s]."""
        return self._keys[-1][0]

    @property
    def oldest_s(self) -> float:
        """Stamp that the history reaches back to [s]."""
        return self._keys[0][0]

    def add(self, time_s: float, measurement: M, rank: int = 0) -> int:
        """
        Apply a measurement at its stamp and replay what came after; return how many were replayed.

        Raise TooLateError when it is older than the history.
        """
        key = (time_s, rank)
        index = bisect_right(self._keys, key)
        if index == 0:
            raise TooLateError(
                f'stamp {time_s:.3f} s is older than the history, {self.oldest_s:.3f} s'
            )
        self._keys.insert(index, key)
        self._measurements.insert(index, measurement)
        state = self._apply(self._state(index - 1), measurement)
        self._states.insert(index, ((state,), 0))
        later = cast('list[M]', self._measurements[index + 1 :])
        if later:
            runs = self._apply_all(state, later)
            self._states[index + 1 :] = [(run, k) for run in runs for k in range(len(run))]
        replayed = len(later)
        self._trim()
        return replayed

    def _state(self, index: int) -> S:
        run, k = self._states[index]
        return run[k]

    def _one_by_one(self, state: S, measurements: Sequence[M]) -> list[Run[S]]:
        states = []
        for measurement in measurements:
            state = self._apply(state, measurement)
            states.append(state)
        return [states]

    def entries(self) -> Iterator[tuple[float, M | None, S]]:
        """Yield (stamp, measurement, state after it) in time order; the first has None."""
        for (time_s, _), measurement, (run, k) in zip(
            self._keys, self._measurements, self._states, strict=True
        ):
            yield time_s, measurement, run[k]

    def _trim(self) -> None:
        """Forget the oldest entries, in blocks, so that trimming costs little per measurement."""
        limit = self.newest_s - self._horizon_s
        if self._keys[0][0] >= limit - 0.25 * self._horizon_s:
            return
        first = max(0, bisect_right(self._keys, (limit, -2)) - 1)
        del self._keys[:first], self._measurements[:first], self._states[:first]
