"""Simulated roller coaster: tracks, ride physics, the sensor in row 1."""

from track_localization.sim.coaster.config import SCENARIOS, CoasterSimConfig, scenario
from track_localization.sim.coaster.simulate import (
    CoasterModel,
    SimulatedRide,
    prepare,
    simulate_coaster,
)
from track_localization.sim.coaster.tracks import TRACKS

__all__ = [
    'SCENARIOS',
    'TRACKS',
    'CoasterModel',
    'CoasterSimConfig',
    'SimulatedRide',
    'prepare',
    'scenario',
    'simulate_coaster',
]
