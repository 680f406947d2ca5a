"""Simulated maglev train: its motion, loop, radar and balises, and the way of their messages."""

from track_localization.sim.maglev.config import SCENARIOS, MaglevSimConfig, scenario
from track_localization.sim.maglev.simulate import (
    BaliseStream,
    SimulatedRun,
    Stream,
    simulate_maglev,
)

__all__ = [
    'SCENARIOS',
    'BaliseStream',
    'MaglevSimConfig',
    'SimulatedRun',
    'Stream',
    'scenario',
    'simulate_maglev',
]
