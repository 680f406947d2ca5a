"""Compiled inner loop of the train's motion: forces at one instant, steps in time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from track_localization import GRAVITY

Array = NDArray[np.float64]

STEP_S = 0.002
RELEASE_S = 0.6
HALT_S = 0.8
GUST_STEP_S = 0.5
LONGEST_S = 900.0


@njit(cache=True)
def _look(table: Array, s: float, length: float, closed: bool, column: int) -> float:
    if closed:
        s -= np.floor(s / length) * length
    n = len(table) - 1
    x = min(max(s / length, 0.0), 1.0) * n
    i = min(int(x), n - 1)
    u = x - i
    value = table[i, column] * (1.0 - u) + table[i + 1, column] * u
    if column == 0 and not closed:
        if s < 0.0:
            value += (table[1, 0] - table[0, 0]) / (length / n) * s
        elif s > length:
            value += (table[n, 0] - table[n - 1, 0]) / (length / n) * (s - length)
    return value


@njit(cache=True)
def _zone(z: Array, s: float, v: float, train: float, front: float, way: float) -> float:
    """Return the acceleration that one zone gives, along the direction of travel."""
    if z[0] == 1.0:
        middle = s + front - 0.5 * train
        cover = min(max(middle - z[1], 0.0), max(z[2] - middle, 0.0), 1.0)
    else:
        inside = min(s + front, z[2]) - max(s + front - train, z[1])
        cover = min(max(inside / min(train, z[2] - z[1]), 0.0), 1.0)
    if cover == 0.0:
        return 0.0
    speed, soft = z[3], 0.08 if z[0] == 1.0 else 0.5
    if z[0] == 6.0:
        left = way * (z[6] - s)
        gentle = 0.4 * max(z[5], 0.5)
        if left > 0.0:
            speed = min(speed, gentle * 1.2 * (np.sqrt(1.0 + 2.0 * left / (gentle * 1.44)) - 1.0))
        else:
            speed = 0.0
        soft, cover = 0.15, min(max(min(s - z[1], z[2] - s), 0.0), 1.0)
    return cover * min(max((speed - v) / soft, -z[5]), z[4])


@njit(cache=True)
def _acceleration(
    s: float,
    v: float,
    gust: float,
    way: float,
    phase: int,
    table: Array,
    length: float,
    closed: bool,
    zones: Array,
    body: Array,
) -> float:
    train, front, cars = body[0], body[1], int(body[2])
    nose = _look(table, s + front, length, closed, 0)
    tail = _look(table, s + front - train, length, closed, 0)
    a = -GRAVITY * (nose - tail) / train
    load = 0.0
    for i in range(cars):
        x = s + front - (i + 0.5) * train / cars
        side = v * v * _look(table, x, length, closed, 1) + _look(table, x, length, closed, 3)
        down = v * v * _look(table, x, length, closed, 2) + _look(table, x, length, closed, 4)
        load += np.sqrt(side * side + down * down)
    a -= body[3] * load / cars * np.tanh(v / 0.05)
    course_x = _look(table, s + front - 0.5 * train, length, closed, 5)
    course_y = _look(table, s + front - 0.5 * train, length, closed, 6)
    air = v - gust * (body[5] * course_x + body[6] * course_y)
    a -= body[4] * air * abs(air)
    for k in range(len(zones)):
        if zones[k, 7] < 0.0 or int(zones[k, 7]) == phase:
            a += way * _zone(zones[k], s, way * v, train, front, way)
    return a


@njit(cache=True)
def integrate(
    start: float,
    table: Array,
    length: float,
    closed: bool,
    zones: Array,
    body: Array,
    gusts: Array,
    directions: NDArray[np.int64],
    ends: NDArray[np.int64],
    until: Array,
    holds: Array,
) -> tuple[Array, int, int]:
    """Step (s, v) by fourth-order Runge-Kutta; return rows of s, v, a, their number, outcome."""
    h = STEP_S
    most = int(LONGEST_S / h)
    out = np.zeros((most, 3))
    s, v, phase, released, still = start, 0.0, 0, 0.0, 0.0
    held_at, held_s, held_v = -1.0, 0.0, 0.0
    for n in range(most):
        t = n * h
        if held_at >= 0.0:
            if t >= held_at + HALT_S + holds[phase]:
                if phase + 1 == len(directions):
                    return out, n, 0
                phase, held_at, released, still = phase + 1, -1.0, t, 0.0
            else:
                s, v, a = _halt(t - held_at, held_s, held_v)
                out[n, 0], out[n, 1], out[n, 2] = s, v, a
                continue
        way = float(directions[phase])
        air = _between(gusts, t / GUST_STEP_S)
        k = np.empty((4, 2))
        x, y = s, v
        for i in range(4):
            later = 0.0 if i == 0 else (h if i == 3 else 0.5 * h)
            ramp = _ramp((t + later - released) / RELEASE_S)
            k[i, 0] = y
            k[i, 1] = ramp * _acceleration(
                x, y, air, way, phase, table, length, closed, zones, body
            )
            ahead = h if i == 2 else 0.5 * h
            x, y = s + ahead * k[i, 0], v + ahead * k[i, 1]
        out[n, 0], out[n, 1], out[n, 2] = s, v, k[0, 1]
        s += h * (k[0, 0] + 2.0 * k[1, 0] + 2.0 * k[2, 0] + k[3, 0]) / 6.0
        v += h * (k[0, 1] + 2.0 * k[1, 1] + 2.0 * k[2, 1] + k[3, 1]) / 6.0
        still = still + h if abs(v) < 0.01 else 0.0
        if ends[phase] == 2:
            if way * v < 0.0:
                phase, released = phase + 1, t - RELEASE_S
        elif way * v < -0.05:
            return out, n + 1, 1
        elif ends[phase] == 1:
            if way * (s - until[phase]) >= 0.0:
                held_at, held_s, held_v = t + h, s, v
        elif t - released > 2.0 and way * v < 0.003 and _stopping(zones, s, phase, way):
            held_at, held_s, held_v = t + h, s, v
        if still > 20.0:
            return out, n + 1, 2
    return out, most, 3


@njit(cache=True)
def _halt(t: float, s: float, v: float) -> tuple[float, float, float]:
    """Return s, v, a a time ``t`` after a train that ran at ``v`` began to be held at ``s``."""
    u = min(t / HALT_S, 1.0)
    gone = HALT_S * (u - u**3 + 0.5 * u**4)
    return s + v * gone, v * (1.0 - _ramp(u)), -v * 6.0 * u * (1.0 - u) / HALT_S


@njit(cache=True)
def _ramp(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


@njit(cache=True)
def _between(values: Array, x: float) -> float:
    i = min(int(x), len(values) - 1)
    return values[i] + (min(x - i, 1.0)) * (values[min(i + 1, len(values) - 1)] - values[i])


@njit(cache=True)
def _stopping(zones: Array, s: float, phase: int, way: float) -> bool:
    """Whether row 1 has arrived at a station's stopping point."""
    for k in range(len(zones)):
        z = zones[k]
        active = z[7] < 0.0 or int(z[7]) == phase
        if z[0] == 6.0 and active and z[1] <= s <= z[2] and way * (z[6] - s) < 0.1:
            return True
    return False
