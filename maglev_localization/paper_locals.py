"""The two local particle filters of the paper: their clouds, weights and moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_localization import paper_kernels as kernels
from track_localization.estimation.cholesky import lower_root
from track_localization.estimation.federated import fuse_information
from track_localization.estimation.particles import RESAMPLING

Array = NDArray[np.float64]

LEAST_EFFECTIVE = 4.0
"""Effective particles that a covariance of three states takes; fewer do not tell a posterior."""

GATE = 16.0
"""Squared innovation against its variance beyond which a measurement is refused then."""


class LocalFilters:
    """
    Two clouds of particles of (chainage, speed, acceleration); cloud i measures state i.

    Attributes:
        means: (2, 3) of the clouds.
        covariances: (2, 3, 3) of the clouds.
        n_eff: effective numbers of particles after the last measurement of each.
    """

    def __init__(self, count: int, resampling: str, rng: np.random.Generator) -> None:
        self._count, self._rng = count, rng
        self._resample = RESAMPLING[resampling]
        self._clouds = np.zeros((2, 3, count))
        self._log_w, self._w = np.zeros((2, count)), np.zeros((2, count))
        self._spare = np.zeros((3, count))
        self._degenerate = [False, False]
        self.means, self.covariances = np.zeros((2, 3)), np.zeros((2, 3, 3))
        self.n_eff = [float(count)] * 2

    def draw(self, mean: Array, P: Array, shares: Array) -> None:
        """Draw both clouds around the master's mean (3,), each with its share of ``P`` (3, 3)."""
        for local in range(2):
            self._draw(local, mean, P / shares[local])

    def advance(
        self, mean: Array, P: Array, shares: Array, given: int, T: float, variance: float
    ) -> None:
        """
        Take back what the master gives, and predict over T with a jerk of ``variance``.

        The master's ``mean`` (3,) and ``P`` (3, 3) are predicted too, in place; see the kernel.
        """
        for local in range(2):
            if self._degenerate[local] and given != kernels.NOTHING:
                self._draw_anew(local)
        clouds, w, means, covariances = self._clouds, self._w, self.means, self.covariances
        rest = (T, variance, self._rng)
        if not kernels.advance(clouds, w, means, covariances, mean, P, shares, given, *rest):
            self.draw(mean, P, shares)
            nothing = kernels.NOTHING
            kernels.advance(clouds, w, means, covariances, mean, P, shares, nothing, *rest)

    def correct(self, local: int, z: float, variance: float) -> bool:
        """
        Weigh a cloud's particles by its measurement, eqs (5) and (7).

        Where too few particles are left to tell the posterior, they are drawn anew from that of a
        normal distribution. Return False, nothing done, where that does not explain ``z`` either.
        """
        cloud, (log_w, w, _) = self._clouds[local], self._spare
        mean, P = np.empty(3), np.empty((3, 3))
        kernels.weigh(cloud[local], self._log_w[local], z, variance, log_w)
        np.exp(log_w, out=w)
        total, squares = kernels.measure(cloud, w, self.means[local], mean, P)
        n_eff = self.n_eff[local] = total * total / squares if squares > 0.0 else 0.0
        if n_eff < LEAST_EFFECTIVE:
            return self._rescue(local, z, variance)
        kernels.settle(log_w, w, total, self._log_w[local], self._w[local])
        self.means[local], self.covariances[local] = mean, P
        self._degenerate[local] = n_eff < 0.5 * self._count
        return True

    def fused(self) -> tuple[Array, Array, bool]:
        """Return mean and covariance of both clouds' information, eq. (8), and whether it is."""
        mean, P, regular = fuse_information(self.means, self.covariances)
        return mean, P, regular

    def _rescue(self, local: int, z: float, variance: float) -> bool:
        mean, P = self.means[local], self.covariances[local]
        nu, S = z - mean[local], P[local, local] + variance
        if nu * nu > GATE * S:
            return False
        gain = P[:, local] / S
        self._draw(local, mean + gain * nu, P - np.outer(gain, P[local]))
        return True

    def _draw_anew(self, local: int) -> None:
        """Resample a cloud, unless too few different particles would be left."""
        self._degenerate[local] = False
        indices = self._resample(self._w[local], self._rng)
        mean, P, regular = kernels.pick(
            self._clouds[local], indices, self.means[local], self._spare
        )
        if regular:
            self._clouds[local] = self._spare
            self._w[local], self._log_w[local] = 1.0 / self._count, -np.log(self._count)
            self.means[local], self.covariances[local] = mean, P

    def _draw(self, local: int, mean: Array, P: Array) -> None:
        """Draw a cloud from a normal distribution."""
        L, _ = lower_root(P)
        noise = self._rng.standard_normal((3, self._count))
        self._clouds[local] = mean[:, None] + L @ noise
        self._w[local], self._log_w[local] = 1.0 / self._count, -np.log(self._count)
        self.n_eff[local], self._degenerate[local] = float(self._count), False
        kernels.measure(
            self._clouds[local], self._w[local], mean, self.means[local], self.covariances[local]
        )
