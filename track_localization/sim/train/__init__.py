"""Simulated high-speed train: its line on the Earth, its run, IMU, receiver and odometer."""

from track_localization.sim.train.config import TrainSimConfig
from track_localization.sim.train.gnss import GnssStream
from track_localization.sim.train.run import LocalTruth, SimulatedRun, StartPose, WheelStream
from track_localization.sim.train.scenarios import SCENARIOS, scenario
from track_localization.sim.train.simulate import simulate_train

__all__ = [
    'SCENARIOS',
    'GnssStream',
    'LocalTruth',
    'SimulatedRun',
    'StartPose',
    'TrainSimConfig',
    'WheelStream',
    'scenario',
    'simulate_train',
]
