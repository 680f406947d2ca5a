"""The two local particle filters of the paper: their clouds, weights and moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_localization import paper_kernels as kernels
from track_localization.estimation.cholesky import lower_root
from track_localization.estimation.federated import fuse_information
from track_localization.estimation.particles import RESAMPLING

Array = NDArray[np.float64]

LEAST_EFFECTIVE = 20.0
"""Fewer effective particles do not tell a mean and covariance of three states."""

WITHIN = 9.0
"""
Squared innovation over its variance up to which particles tell the posterior.

A cloud has no particles to speak of beyond three sigma. One that is pulled there time after time
narrows, and follows less and less: what the model allows once in 370 measurements.
"""

RENEWAL_S = 0.7
"""
How long jerks take to make new particles out of copies [s].

Where a cloud must be drawn anew sooner, resampling would leave the same few again: at 50 Hz a
manoeuvre beyond the model then narrows it until nothing moves it, to errors of metres.
"""


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
        self._degenerate, self._since_s = [False, False], [0.0, 0.0]
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
            self._since_s[local] += T
        clouds, w, means, covariances = self._clouds, self._w, self.means, self.covariances
        rest = (T, variance, self._rng)
        if not kernels.advance(clouds, w, means, covariances, mean, P, shares, given, *rest):
            self.draw(mean, P, shares)
            nothing = kernels.NOTHING
            kernels.advance(clouds, w, means, covariances, mean, P, shares, nothing, *rest)

    def correct(self, local: int, z: float, variance: float) -> None:
        """
        Weigh a cloud's particles by its measurement, eqs (5) and (7).

        Where too few would be left to tell the posterior, they are drawn anew from that of the
        normal distribution with the cloud's mean and covariance, as a Kalman filter has it.
        """
        nu, S = z - self.means[local, local], self.covariances[local, local, local] + variance
        if nu * nu > WITHIN * S:
            self._draw_posterior(local, nu, S)
            return
        cloud, (log_w, w, _) = self._clouds[local], self._spare
        mean, P = np.empty(3), np.empty((3, 3))
        kernels.weigh(cloud[local], self._log_w[local], z, variance, log_w)
        np.exp(log_w, out=w)
        total, squares = kernels.measure(cloud, w, self.means[local], mean, P)
        n_eff = self.n_eff[local] = total * total / squares if squares > 0.0 else 0.0
        if n_eff < LEAST_EFFECTIVE:
            self._draw_posterior(local, nu, S)
            return
        kernels.settle(log_w, w, total, self._log_w[local], self._w[local])
        self.means[local], self.covariances[local] = mean, P
        self._degenerate[local] = n_eff < 0.5 * self._count

    def fused(self) -> tuple[Array, Array, bool]:
        """Return mean and covariance of both clouds' information, eq. (8), and whether it is."""
        mean, P, regular = fuse_information(self.means, self.covariances)
        return mean, P, regular

    def _draw_posterior(self, local: int, nu: float, S: float) -> None:
        mean, P = self.means[local], self.covariances[local]
        gain = P[:, local] / S
        self._draw(local, mean + gain * nu, P - np.outer(gain, P[local]))

    def _draw_anew(self, local: int) -> None:
        """Resample a cloud; draw it from a normal distribution where all would be copies."""
        mean, P = self.means[local], self.covariances[local]
        if self._since_s[local] < RENEWAL_S:
            self._draw(local, mean.copy(), P.copy())
            return
        self._degenerate[local], self._since_s[local] = False, 0.0
        indices = self._resample(self._w[local], self._rng)
        mean, P, regular = kernels.pick(self._clouds[local], indices, mean, self._spare)
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
        self.n_eff[local] = float(self._count)
        self._degenerate[local], self._since_s[local] = False, 0.0
        kernels.measure(
            self._clouds[local], self._w[local], mean, self.means[local], self.covariances[local]
        )
