"""What the maglev's sensors tell, in the core's own types; times are header stamps."""

from __future__ import annotations

from typing import NamedTuple


class LoopPosition(NamedTuple):
    """
    A reading of the crossed induction loop: counted crossings times their pitch.

    Attributes:
        time_s: stamp [s].
        reading: distance counted [m]; its zero is wherever the counter began.
        variance: claimed by the sender [m^2].
    """

    time_s: float
    reading: float
    variance: float


class RadarSpeed(NamedTuple):
    """
    Speed over ground from the Doppler radar, positive forward.

    Attributes:
        time_s: stamp [s].
        speed: [m/s].
        variance: claimed by the sender [m^2/s^2].
    """

    time_s: float
    speed: float
    variance: float


class BalisePassing(NamedTuple):
    """
    A balise heard, and where the antenna was against it at that time.

    Attributes:
        time_s: stamp [s].
        balise: the id that it told.
        offset: antenna ahead of the balise [m].
        variance: of the offset, claimed by the sender [m^2].
    """

    time_s: float
    balise: str
    offset: float
    variance: float


Measurement = LoopPosition | RadarSpeed | BalisePassing

LOOP, RADAR, BALISE = 'loop', 'radar', 'balise'
"""Sensors by name, as counts and diagnostics call them."""


def sensor_of(measurement: Measurement) -> str:
    """Return the name of the sensor that a measurement comes from."""
    if isinstance(measurement, LoopPosition):
        return LOOP
    return RADAR if isinstance(measurement, RadarSpeed) else BALISE
