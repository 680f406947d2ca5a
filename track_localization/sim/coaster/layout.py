"""From elements to a track: laid out, closed into a circuit, banked for its own speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from track_localization import GRAVITY
from track_localization.sim.coaster.dynamics import Run, run_train
from track_localization.sim.coaster.elements import Element
from track_localization.sim.coaster.ride_plan import RidePlan
from track_localization.track.centreline import Centreline
from track_localization.track.track_file import TrackFile

Array = NDArray[np.float64]

STEP = 0.1
ROW_SPACING = 0.5
LOWEST = 2.0


@dataclasses.dataclass(frozen=True)
class Layout:
    """
    A track as angles over arc length.

    Attributes:
        s: (N,) uniform [m], to the end of the track.
        position: (N, 3) in ``map`` [m].
        heading, slope, roll: (N,) [rad].
        banked: (N,) whether banking is added there.
        spans: element name -> (start, end) of each element so called [m].
    """

    s: Array
    position: Array
    heading: Array
    slope: Array
    roll: Array
    banked: NDArray[np.bool_]
    spans: dict[str, list[tuple[float, float]]]

    @property
    def length(self) -> float:
        """Length of the track [m]."""
        return float(self.s[-1])

    def span(self, name: str, place: int = 0) -> tuple[float, float]:
        """Return where the elements called ``name`` begin and end, joined if adjacent [m]."""
        merged: list[tuple[float, float]] = []
        for start, end in self.spans[name]:
            if merged and abs(merged[-1][1] - start) < 1e-6:
                merged[-1] = (merged[-1][0], end)
            else:
                merged.append((start, end))
        return merged[place]


def lay(elements: list[Element]) -> Layout:
    """
    Lay elements end to end from the origin, level, heading along x.

    Raise ValueError when their lengths add up to nothing.
    """
    ends = np.cumsum([0.0] + [e.length for e in elements])
    if ends[-1] < 1.0:
        raise ValueError(f'the track does not close: its elements are {ends[-1]:.1f} m long')
    s = np.linspace(0.0, ends[-1], int(np.ceil(ends[-1] / STEP)) + 1)
    angles, banked = np.zeros((len(s), 3)), np.zeros(len(s), dtype=bool)
    base = np.zeros(3)
    spans: dict[str, list[tuple[float, float]]] = {}
    for element, start, end in zip(elements, ends[:-1], ends[1:], strict=True):
        spans.setdefault(element.name, []).append((float(start), float(end)))
        if element.length <= 0.0:
            continue
        here = (s >= start) & (s <= end)
        table = np.stack([element.heading, element.slope, element.roll], axis=1)
        u = np.linspace(0.0, 1.0, len(table))
        angles[here] = base + CubicSpline(u, table)((s[here] - start) / element.length)
        banked[here] = element.banked
        base = base + table[-1]
    heading, slope, roll = angles.T
    return Layout(s, _walk(s, heading, slope), heading, slope, roll, banked, spans)


def _walk(s: Array, heading: Array, slope: Array) -> Array:
    """Integrate the unit tangent of heading and slope into positions (N, 3)."""
    tangent = np.stack(
        [np.cos(slope) * np.cos(heading), np.cos(slope) * np.sin(heading), np.sin(slope)], axis=1
    )
    return np.asarray(CubicSpline(s, tangent).antiderivative()(s))


def close(build: Callable[[Array], list[Element]], guess: Array) -> Layout:
    """
    Find the free lengths with which the layout ends where it began; return it.

    ``build`` makes the elements from the free values; their heading must come round by design.
    Raise ValueError when no such lengths exist near ``guess``.
    """
    x = np.asarray(guess, dtype=np.float64)
    for _ in range(12):
        gap = lay(build(x)).position[-1, :2]
        if np.abs(gap).max() < 1e-9:
            break
        slopes = [
            (lay(build(x + step)).position[-1, :2] - gap) / 0.1 for step in 0.1 * np.eye(len(x))
        ]
        x = x - np.linalg.pinv(np.stack(slopes, axis=1)) @ gap
    elements = build(x)
    layout = lay(elements)
    gap = layout.position[-1] - layout.position[0]
    if np.abs(gap).max() > 1e-2 or min(e.length for e in elements) < 0.0:
        raise ValueError(f'the circuit does not close: {gap} m remain with lengths {x}')
    share = (layout.s / layout.length)[:, None]
    return dataclasses.replace(layout, position=layout.position - share * gap)


def attitude(heading: Array, slope: Array, roll: Array) -> Array:
    """Return R (N, 3, 3) = Rz(heading) Ry(-slope) Rx(roll)."""
    ch, sh, cs, ss = np.cos(heading), np.sin(heading), np.cos(slope), np.sin(slope)
    zero = np.zeros_like(ch)
    front = np.stack([ch * cs, sh * cs, ss], axis=-1)
    left = np.stack([-sh, ch, zero], axis=-1)
    up = np.stack([-ch * ss, -sh * ss, cs], axis=-1)
    cr, sr = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([front, cr * left + sr * up, cr * up - sr * left], axis=-1)


def bank(
    layout: Layout, plan: RidePlan, share: float, most_deg: float, smooth_m: float
) -> tuple[Layout, Run]:
    """
    Bank the track so that a seat feels ``share`` of the sideways force balanced away.

    The speed is that of the nominal ride on the unbanked line. Return the banked layout and that
    ride.
    """
    line = Centreline.from_track(to_track(layout))
    run = run_train(line, plan)
    passed = run.v > 0.3
    order = np.argsort(run.s[passed] % layout.length, kind='stable')
    v = np.interp(layout.s, run.s[passed][order] % layout.length, run.v[passed][order])
    v = gaussian_filter1d(v, 3.0 / STEP, mode='nearest')
    dh = np.gradient(layout.heading, layout.s)
    ds = np.gradient(layout.slope, layout.s)
    sideways = v**2 * dh * np.cos(layout.slope)
    upright = np.maximum(v**2 * ds + GRAVITY * np.cos(layout.slope), 0.7 * GRAVITY)
    wanted = -share * np.arctan(sideways / upright)
    wanted = np.clip(wanted, -np.radians(most_deg), np.radians(most_deg)) * layout.banked
    mode = 'nearest'
    wanted = gaussian_filter1d(wanted, smooth_m / STEP, mode=mode)
    edge = np.clip(np.minimum(layout.s, layout.length - layout.s) / 8.0, 0.0, 1.0)
    roll = layout.roll + wanted * edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2)
    return dataclasses.replace(layout, roll=roll), run


def to_track(layout: Layout, closed_gap: float = 1e-6) -> TrackFile:
    """Return the track's rows about every 0.5 m; a circuit's last row precedes its first."""
    count = int(layout.length / ROW_SPACING) + 1
    s = np.linspace(0.0, layout.length, count)
    columns = np.column_stack([layout.position, layout.heading, layout.slope, layout.roll])
    rows = CubicSpline(layout.s, columns)(s)
    if np.linalg.norm(rows[-1, :3] - rows[0, :3]) < closed_gap:
        rows = rows[:-1]
    lift = LOWEST - float(layout.position[:, 2].min())
    position = np.round(rows[:, :3] + np.array([0.0, 0.0, lift]), 9)
    R = attitude(rows[:, 3], rows[:, 4], rows[:, 5])
    return TrackFile(position, R[:, :, 0], R[:, :, 1], R[:, :, 2])
