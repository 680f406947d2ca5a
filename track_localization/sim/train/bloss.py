"""Bloss's curve 3x^2 - 2x^3 from 0 to 1, along which railway transitions run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEEPEST = 1.5
"""Its greatest slope."""

SHARPEST = 6.0
"""Its greatest second derivative."""


def value(x: Array) -> Array:
    """Return the curve (N,): 0 before x = 0, 1 after x = 1."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def slope(x: Array) -> Array:
    """Return its slope (N,)."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(6.0 * x * (1.0 - x))


def area(x: Array) -> Array:
    """Return the area under it (N,), from far before to x."""
    inside = np.clip(x, 0.0, 1.0)
    return np.asarray(inside**3 * (1.0 - 0.5 * inside) + np.maximum(x - 1.0, 0.0))
