"""Noise that several sensors have."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def correlated(rng: Generator, n: int, steps: float, columns: int | None = None) -> Array:
    """
    Return a stationary Gauss-Markov process of unit variance, correlated over so many steps.

    Its shape is (n,), or (n, columns) with independent columns.
    """
    shape = (n,) if columns is None else (n, columns)
    keep = np.exp(-1.0 / steps)
    drive = rng.standard_normal(shape)
    drive[1:] *= np.sqrt(1.0 - keep**2)
    out: Array = lfilter([1.0], [1.0, -keep], drive, axis=0)
    return out
