"""Dynamic time warping (paper 1, eqs 1-4): the least-cost path through all pairs of two series."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from coaster_localization import kernels
from track_localization.errors import DataError

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
IntArray = NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Alignment:
    """
    A warping path and what it costs.

    Attributes:
        path: (L, 2) int, pairs (i, j) from the start to the end of the match; each step advances
            i, j or both by one.
        cost: sum of point distances and step penalties along it.
    """

    path: IntArray
    cost: float


def align(
    a: Array,
    b: Array,
    step_penalty: float = 0.0,
    held: NDArray[np.bool_] | None = None,
    open_begin: bool = False,
    open_end: bool = False,
) -> Alignment:
    """
    Return the least-cost warping path of ``a`` (m, C) onto ``b`` (n, C).

    The distance of two points is the squared Euclidean distance of their rows (channels are
    weighted by scaling them). ``step_penalty`` is added for each step that is not diagonal, except
    for steps of ``a`` alone into rows where ``held`` (m,) is true (the vehicle stands still).
    All of ``a`` is matched; ``open_begin`` and ``open_end`` let it start and end anywhere in
    ``b``. Raise DataError for empty or non-finite series.
    """
    a, b = checked_series(a, b)
    if not (np.isfinite(step_penalty) and step_penalty >= 0.0):
        raise DataError(f'step penalty {step_penalty}: must be finite and not negative')
    stay = np.full(len(a), float(step_penalty))
    if held is not None:
        stay[held] = 0.0
    forward, backward, scale = compact(a, b)
    last_row, directions, starts = kernels.sweep(
        forward,
        backward,
        (0, len(a), 0, len(b)),
        (stay / scale**2).astype(np.float32),
        np.float32(step_penalty / scale**2),
        open_begin,
        kernels.FLAT,
        0.0,
    )
    end = int(np.argmin(last_row)) if open_end else len(b) - 1
    path = kernels.trace(directions, starts, len(a), len(b), end)
    return Alignment(path, path_cost(a, b, path, stay, step_penalty))


def compact(a: Array, b: Array) -> tuple[Array32, Array32, float]:
    """
    Return ``a`` (C, m) and ``b`` reversed (C, n) as float32 within about +-1, and their scale.

    Centred and scaled first, so that single precision holds any finite series; it decides only
    between paths whose costs differ by less than about 1e-6 of the total.
    """
    centre = b.mean(axis=0)
    a, b = a - centre, b - centre
    scale = max(float(np.abs(a).max()), float(np.abs(b).max())) or 1.0
    forward = np.ascontiguousarray((a / scale).T, dtype=np.float32)
    backward = np.ascontiguousarray((b[::-1] / scale).T, dtype=np.float32)
    return forward, backward, scale


def path_cost(a: Array, b: Array, path: IntArray, stay: Array, skip: float) -> float:
    """Return the sum of distances and penalties along a path, in double precision."""
    i, j = path[:, 0], path[:, 1]
    penalty = float(stay[i[1:]][np.diff(j) == 0].sum() + skip * (np.diff(i) == 0).sum())
    return float(((a[i] - b[j]) ** 2).sum()) + penalty


def with_derivative(series: Array, rate_hz: float, weight: float) -> Array:
    """
    Return (N, 2C): ``series`` (N, C) beside its derivative per second times sqrt(weight).

    The squared distance of two such rows is ``dA^2 + kd dA'^2`` (eq. 14), ``kd = weight``.
    """
    return np.hstack([series, np.sqrt(weight) * derivative(series, rate_hz)])


def derivative(series: Array, rate_hz: float) -> Array:
    """Return the central-difference derivative per second, (N, C); zero for a single sample."""
    if len(series) < 2:
        return np.zeros_like(series)
    slope: Array = np.gradient(series, 1.0 / rate_hz, axis=0)
    return slope


def checked_series(a: Array, b: Array) -> tuple[Array, Array]:
    """Return both as (N, C) float64; raise DataError unless they can be compared."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    a, b = (x[:, None] if x.ndim == 1 else x for x in (a, b))
    for name, series in (('measured', a), ('design', b)):
        if series.ndim != 2 or series.size == 0:
            raise DataError(f'{name} series of shape {series.shape}: nothing to match')
        if not np.isfinite(series).all():
            bad = int((~np.isfinite(series).all(axis=1)).sum())
            raise DataError(f'{name} series: {bad} of {len(series)} samples are not finite')
    if a.shape[1] != b.shape[1]:
        raise DataError(f'{a.shape[1]} measured channels against {b.shape[1]} of the design')
    return a, b
