"""The two local particle filters of the paper: their clouds, weights and moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_localization import paper_kernels as kernels
from track_localization.estimation.cholesky import lower_root
from track_localization.estimation.federated import fuse_information
from track_localization.estimation.particles import RESAMPLING, Normals

Array = NDArray[np.float64]

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
        self._count, self._rng, self._normals = count, rng, Normals(rng)
        self._resample = RESAMPLING[resampling]
        self._clouds = np.zeros((2, 3, count))
        self._log_w, self._w = np.zeros((2, count)), np.zeros((2, count))
        self._spare, self._new_log_w, self._new_w = np.zeros((3, count)), *np.zeros((2, count))
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
        rest = (T, variance, self._normals.take(2 * self._count).reshape(2, -1))
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
        cloud, moments = (self._clouds, self._log_w), (self.means, self.covariances)
        log_w, w = self._new_log_w, self._new_w
        n_eff = 0.0
        if kernels.weigh(*cloud, *moments, local, z, variance, log_w):
            np.exp(log_w, out=w)
            n_eff = kernels.settle(*cloud, self._w, *moments, local, log_w, w)
        if n_eff < kernels.LEAST_EFFECTIVE:
            self._draw_posterior(local, z, variance)
            return
        self.n_eff[local] = n_eff
        self._degenerate[local] = n_eff < 0.5 * self._count

    def fused(self) -> tuple[Array, Array, bool]:
        """Return mean and covariance of both clouds' information, eq. (8), and whether it is."""
        mean, P, regular = fuse_information(self.means, self.covariances)
        return mean, P, regular

    def _draw_posterior(self, local: int, z: float, variance: float) -> None:
        mean, P = self.means[local], self.covariances[local]
        gain = P[:, local] / (P[local, local] + variance)
        nu = z - mean[local]
        self._draw(local, mean + gain * nu, P - np.outer(gain, P[local]))

    def _draw_anew(self, local: int) -> None:
        """Resample a cloud; draw it from a normal distribution where all would be copies."""
        if self._since_s[local] < RENEWAL_S:
            self._draw(local, self.means[local].copy(), self.covariances[local].copy())
            return
        self._degenerate[local], self._since_s[local] = False, 0.0
        cloud, moments = (self._clouds, self._log_w, self._w), (self.means, self.covariances)
        indices = self._resample(self._w[local], self._rng)
        kernels.draw(*cloud, *moments, local, indices, self._spare)

    def _draw(self, local: int, mean: Array, P: Array) -> None:
        """Draw a cloud from a normal distribution."""
        L, _ = lower_root(P)
        noise = self._normals.take(3 * self._count).reshape(3, -1)
        self._clouds[local] = mean[:, None] + L @ noise
        self._w[local], self._log_w[local] = 1.0 / self._count, -np.log(self._count)
        self.n_eff[local] = float(self._count)
        self._degenerate[local], self._since_s[local] = False, 0.0
        kernels.measure(
            self._clouds[local], self._w[local], mean, self.means[local], self.covariances[local]
        )
