"""Deciding whether a measurement may enter a filter, and keeping count of what was refused."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]


def nis(nu: Array, S: Array) -> float:
    """Return the normalised innovation squared, nu' S^-1 nu."""
    return float(nu @ np.linalg.solve(S, nu))


def chi2_gate(probability: float, dof: int) -> float:
    """Return the NIS that a true measurement of ``dof`` numbers exceeds with 1 - probability."""
    return float(chi2.ppf(probability, dof))


class Rejections:
    """Counts of refused measurements by sensor and reason."""

    def __init__(self) -> None:
        self._counts: dict[str, dict[str, int]] = defaultdict(dict)

    def add(self, sensor: str, reason: str, count: int = 1) -> None:
        """Count one refusal (or ``count`` of them)."""
        reasons = self._counts[sensor]
        reasons[reason] = reasons.get(reason, 0) + count

    def total(self, sensor: str) -> int:
        """Return how many measurements of a sensor were refused."""
        return sum(self._counts.get(sensor, {}).values())

    def as_dict(self) -> dict[str, dict[str, int]]:
        """Return a copy: sensor -> reason -> count."""
        return {sensor: dict(reasons) for sensor, reasons in self._counts.items()}
