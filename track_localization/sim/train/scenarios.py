"""Scenarios: what differs from the defaults, which are those of ``line``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from track_localization.errors import DataError
from track_localization.settings import override, validate, walk
from track_localization.sim.train.config import TrainSimConfig

OPEN_SKY: Mapping[str, Any] = {'terrain.tunnels': (0, 0), 'terrain.cuttings': (0, 0)}

PAPER: Mapping[str, Any] = {
    **OPEN_SKY,
    'motion.profile': 'underway',
    'start.given': True,
    'gnss.outage_s': (100.0, 150.0),
    'odometer.slips': 1.0,
    'odometer.slips_in_outage': (0, 0),
}
"""The paper's section 3: 200 s, 11 km, no satellites from 100 to 150 s."""

SCENARIOS: Mapping[str, Mapping[str, Any]] = {
    'line': {},
    'paper': PAPER,
    'navigation': {**PAPER, 'imu.grade': 'navigation'},
    'tactical': {**PAPER, 'imu.grade': 'tactical'},
    'mems': {**PAPER, 'imu.grade': 'mems'},
    'slip': {**PAPER, 'odometer.slips_in_outage': (3, 6)},
    'moving': {
        **PAPER,
        'start.given': False,
        'motion.distance_m': 22e3,
        'motion.duration_s': 400.0,
        'gnss.outage_s': (300.0, 350.0),
    },
    'wrongmap': {**PAPER, 'survey.aside_m': 3.0},
    'bad': {
        'faults.nan': 0.002,
        'faults.time_jumps': 2,
        'faults.imu_gap_s': 1.5,
        'faults.stuck_s': 15.0,
        'faults.gnss_outlier_m': 80.0,
        'faults.no_covariance': True,
        'faults.stale_no_fix': True,
        'faults.no_hdop': True,
    },
}
"""Differences of each scenario from the defaults."""


def check(config: TrainSimConfig) -> TrainSimConfig:
    """Return ``config`` itself, or raise DataError for a setting out of range or order."""
    for name, _, value in walk(validate(config)):
        if isinstance(value, tuple) and len(value) == 2 and value[0] > value[1]:
            raise DataError(f'setting {name}: {list(value)}; give the lesser first')
    return config


def scenario(name: str) -> TrainSimConfig:
    """Return the configuration of a scenario; raise DataError for an unknown name."""
    if name not in SCENARIOS:
        raise DataError(f'unknown scenario {name!r}; known: {", ".join(SCENARIOS)}')
    return override(TrainSimConfig(), SCENARIOS[name])
