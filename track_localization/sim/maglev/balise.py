"""Balises: where they truly lie, which are heard, and what they tell."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from track_localization.errors import DataError
from track_localization.sim.maglev.config import BaliseErrors
from track_localization.sim.maglev.motion import Motion
from track_localization.track.balise_table import BaliseTable

Array = NDArray[np.float64]

LEAST_SIGMA_M = 0.001
"""A table's sigma where the survey is without error: it must be positive."""


@dataclasses.dataclass(frozen=True)
class Passings:
    """Balises heard: times (M,) of the run, told ids, offsets and claimed variances."""

    time_s: Array
    id: tuple[str, ...]
    offset: Array
    variance: Array


def lay_balises(rng: Generator, config: BaliseErrors, length: float) -> tuple[BaliseTable, Array]:
    """Return the table of a line's balises and where they truly lie (M,) [m]."""
    count = int(np.ceil((length - config.first_m) / config.spacing_m - 1e-9))
    if count < 1:
        raise DataError(
            f'setting balise.first_m: {config.first_m} m, but the line ends at {length} m; '
            'a line needs a balise'
        )
    chainage = np.asarray(config.first_m + config.spacing_m * np.arange(count), dtype=np.float64)
    sigma = np.repeat(max(config.survey_sigma_m, LEAST_SIGMA_M), count)
    table = BaliseTable(tuple(f'B{i:03d}' for i in range(1, count + 1)), chainage, sigma)
    return table, chainage + config.survey_sigma_m * rng.standard_normal(count)


def hear_balises(
    rng: Generator, config: BaliseErrors, motion: Motion, table: BaliseTable, place: Array
) -> tuple[Passings, dict[str, Any]]:
    """Return the balises that the train hears, and what went wrong."""
    crossed = motion.passing_times(place)
    passed = np.flatnonzero(np.isfinite(crossed))
    time = crossed[passed] + config.jitter_s * rng.standard_normal(len(passed))
    offset = config.offset_sigma_m * rng.standard_normal(len(passed))
    missed = rng.random(len(passed)) < config.missed
    failed = (time >= config.dead_from_s) & (time < config.dead_from_s + config.dead_for_s)
    told, wrong = _told(rng, config, table, passed)
    heard = np.flatnonzero(~missed & ~failed)
    heard = heard[np.argsort(time[heard], kind='stable')]
    info = {
        'passed': len(passed),
        'missed': [table.id[i] for i in passed[missed]],
        'wrong_ids': [[table.id[passed[i]], told[i]] for i in heard if wrong[i]],
        'place_errors_m': (place - table.chainage).tolist(),
    }
    variance = np.full(len(heard), max(config.offset_sigma_m, LEAST_SIGMA_M) ** 2)
    ids = tuple(told[i] for i in heard)
    return Passings(time[heard], ids, offset[heard], variance), info


def _told(
    rng: Generator, config: BaliseErrors, table: BaliseTable, passed: NDArray[np.int64]
) -> tuple[list[str], NDArray[np.bool_]]:
    """Return the ids that passings tell, and which of them are wrong."""
    chance = rng.random(len(passed))
    other = rng.integers(1, max(len(table), 2), len(passed))
    stranger = rng.integers(1000, 10000, len(passed))
    unknown = chance < config.unknown_id
    wrong = ~unknown & (chance < config.unknown_id + config.wrong_id) & (len(table) > 1)
    told = [table.id[i] for i in passed]
    for i in np.flatnonzero(wrong):
        told[i] = table.id[(passed[i] + other[i]) % len(table)]
    for i in np.flatnonzero(unknown):
        told[i] = f'X{stranger[i]}'
    return told, wrong | unknown
