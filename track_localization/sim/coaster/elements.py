"""
The elements that coaster tracks are built of.

An element changes heading, slope and roll smoothly over its length and leaves all their first and
second derivatives at zero at both ends, so that elements join without a kink in curvature. Most of
them start and end level; then the height they gain is a parameter and a circuit closes in height
by addition.

Attitude is ``R = Rz(heading) Ry(-slope) Rx(roll)``: positive slope climbs, positive heading turns
left, positive roll lowers the right side. The slope may run through a full turn (a loop).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]

_U = np.linspace(0.0, 1.0, 801)


@dataclasses.dataclass(frozen=True)
class Element:
    """
    A stretch of track.

    Attributes:
        name: what the ride plan calls it.
        length: [m].
        heading, slope, roll: (801,) change since the start of the element, at equal steps [rad].
        banked: roll is added to balance the forces; off where ``roll`` already does.
    """

    name: str
    length: float
    heading: Array
    slope: Array
    roll: Array
    banked: bool = True

    @property
    def rise(self) -> float:
        """Height gained when entered level [m]."""
        return float(np.trapezoid(np.sin(self.slope), _U) * self.length)


def ease(share: float) -> Array:
    """Return a step (801,) from 0 to 1 whose slope has smooth ramps over ``share`` at each end."""
    ramp = np.clip(np.minimum(_U, 1.0 - _U) / share, 0.0, 1.0)
    rate = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    step = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0)])
    return np.asarray(step / step[-1])


def _element(
    name: str,
    length: float,
    heading: Array | float = 0.0,
    slope: Array | float = 0.0,
    roll: Array | float = 0.0,
    banked: bool = True,
) -> Element:
    heading, slope, roll = (
        np.broadcast_to(np.asarray(a, dtype=np.float64), _U.shape) for a in (heading, slope, roll)
    )
    return Element(name, length, heading, slope, roll, banked)


def straight(length: float, name: str = 'straight') -> list[Element]:
    """Go straight on."""
    return [_element(name, length)]


def turn(
    angle_deg: float, radius: float, rise: float = 0.0, share: float = 0.3, name: str = 'turn'
) -> list[Element]:
    """Turn left (right if negative), at its tightest with ``radius``, gaining height evenly."""
    angle = np.radians(angle_deg)
    length = abs(angle) * radius / (1.0 - share)
    hump = _hump(share)

    def gained(grade: float) -> float:
        return float(np.trapezoid(np.sin(grade * hump), _U) * length) - rise

    grade = brentq(gained, -1.2, 1.2) if rise else 0.0
    return [_element(name, length, angle * ease(share), grade * hump)]


def _hump(share: float) -> Array:
    """Return a plateau (801,) that leaves 0 and comes back with two smooth derivatives."""
    ramp = np.clip(np.minimum(_U, 1.0 - _U) / share, 0.0, 1.0)
    return np.asarray(ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2))


def profile(
    levels: list[tuple[float, float]], angles_deg: list[float], name: str = 'hills'
) -> list[Element]:
    """
    Go up and down between levels: a grade, a hill, or hills and valleys in a row.

    Args:
        levels: (height [m], tightest radius [m]) of the start, of each crest and valley, and of
            the end; start and end are level.
        angles_deg: slope between each two, all positive.
        name: of all its elements.

    Raise ValueError when the bends alone gain more than two levels are apart.
    """
    heights = [height for height, _ in levels]
    slopes = [np.radians(a) * np.sign(h) for a, h in zip(angles_deg, np.diff(heights), strict=True)]
    around = [0.0, *slopes, 0.0]
    bends = [
        _bend(after - before, radius, name)
        for before, after, (_, radius) in zip(around[:-1], around[1:], levels, strict=True)
    ]
    out = [bends[0]]
    for i, slope in enumerate(slopes):
        rise = heights[i + 1] - heights[i]
        gained = _gain(bends[i], around[i])[1] + _gain(bends[i + 1], slope)[0]
        left = (rise - gained) / np.sin(slope)
        if left < 0.0:
            raise ValueError(f'{name}: {rise} m is too little; the bends alone take {gained:.1f} m')
        out += [_element(name, left), bends[i + 1]]
    return out


def _bend(angle: float, radius: float, name: str, share: float = 0.35) -> Element:
    """Change the slope by ``angle`` [rad], at its tightest with ``radius``."""
    return _element(name, abs(angle) * radius / (1.0 - share), slope=angle * ease(share))


def _gain(bend: Element, slope: float) -> tuple[float, float]:
    """Return the height gained in a bend entered at ``slope``: up to where it is level, after."""
    s = slope + bend.slope
    level = int(np.argmin(np.abs(s)))
    climb = np.sin(s) * bend.length
    before = float(np.trapezoid(climb[: level + 1], _U[: level + 1]))
    return before, float(np.trapezoid(climb[level:], _U[level:]))


def grade(
    rise: float, angle_deg: float, first_radius: float, second_radius: float, name: str = 'grade'
) -> list[Element]:
    """Climb (or drop, if ``rise`` is negative) by a straight slope and level out."""
    return profile([(0.0, first_radius), (rise, second_radius)], [angle_deg], name)


def hill(
    height: float, angle_deg: float, valley: float, crest: float, name: str = 'hill'
) -> list[Element]:
    """Go over a hill; ``valley`` and ``crest`` are the tightest radii."""
    levels = [(0.0, valley), (height, crest), (0.0, valley)]
    return profile(levels, [angle_deg, angle_deg], name)


def loop(bottom: float, top: float, aside: float, name: str = 'loop') -> list[Element]:
    """
    Go through a vertical loop whose radius shrinks from ``bottom`` to ``top``.

    ``aside`` shifts the exit sideways so that it clears the entry [m], positive to the left.
    """
    slope = 2.0 * np.pi * _clothoid(bottom / top)
    tightest = float(np.max(np.gradient(slope, _U)))
    length = tightest * top
    wobble = np.sin(np.pi * _U) ** 4
    per_rad = float(np.trapezoid(np.cos(slope) * wobble, _U) * length)
    return [_element(name, length, heading=aside / per_rad * wobble, slope=slope, banked=False)]


def _clothoid(ratio: float) -> Array:
    """Return a step (801,) whose rate grows ``ratio`` times from its plateau to its middle."""
    rate = _hump(0.18) * (1.0 + (ratio - 1.0) * np.sin(np.pi * _U) ** 4)
    step = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0)])
    return np.asarray(step / step[-1])


def corkscrew(angle_deg: float, length: float, side: int, name: str = 'corkscrew') -> list[Element]:
    """
    Wind once around a level axis that lies ``angle_deg`` aside of the entry's heading.

    ``side`` is +1 when the track first leans left, -1 right.
    """
    angle, phase = np.radians(angle_deg), 2.0 * np.pi * ease(0.25)
    heading = side * angle * (1.0 - np.cos(phase))
    slope = angle * np.sin(phase)
    return [_element(name, length, heading, slope, -side * phase, banked=False)]


def roll_hill(
    height: float, angle_deg: float, valley: float, crest: float, side: int, name: str = 'roll'
) -> list[Element]:
    """Go over a hill and roll once about the track at its crest (a zero-g roll)."""
    parts = hill(height, angle_deg, valley, crest, name)
    middle = sum(e.length for e in parts[1:4])
    turned = -side * 2.0 * np.pi * ease(0.25)
    done, rolled = 0.0, []
    for part in parts[1:4]:
        u = (done + _U * part.length) / middle
        roll = np.interp(u, _U, turned)
        rolled.append(dataclasses.replace(part, roll=roll - roll[0], banked=False))
        done += part.length
    return [parts[0], *rolled, parts[4]]
