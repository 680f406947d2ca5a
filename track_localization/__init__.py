"""
Find where a vehicle is along its track: what every system here shares.

Notation, frames and units (the contract of the whole package)
---------------------------------------------------------------
Units are SI throughout: m, s, rad, m/s, m/s^2. Names carry the unit where a user meets them
(``time_s``, ``chainage_m``, ``mount_rpy_deg``); inside the library a bare name is SI.

Frames follow REP 103 and REP 105. ``n`` is the local level frame ``map`` (x, y horizontal, z up;
east-north-up where it is geographic). ``b`` is the body (x forward, y left, z up). ``m`` is the
sensor's own frame where a mount rotates it against the body.

- ``R_nb`` rotates a vector from ``b`` to ``n``: ``v_n = R_nb @ v_b``.
- Quaternions are ``(x, y, z, w)``, unit, body to map, as in ``geometry_msgs``.
- ``f`` is specific force: what an accelerometer measures, +9.81 on z at rest. ``w`` is the angular
  rate of ``b`` against ``n``, expressed in ``b``.
- Attitude errors are right perturbations: ``R_true = R_est @ exp(theta)``, ``theta`` in ``b``.
- ``x``, ``P``, ``F``, ``H``, ``Q``, ``R``, ``K``, ``S``, ``nu`` are what textbooks call them:
  state, covariance, transition, measurement Jacobian, process noise, measurement noise, gain,
  innovation covariance, innovation. NIS is ``nu' S^-1 nu``; NEES is ``e' P^-1 e``.
- Chainage ``s`` is the arc length along the line, zero at its first row.
- Euler angles are intrinsic ZYX (yaw, pitch, roll), ``R_nb = Rz(yaw) Ry(pitch) Rx(roll)``; with z
  up and x forward a climb has *negative* pitch.

Time is the header stamp, in seconds of the recording's clock.

Arrays are float64, time along the first axis, vectors along the last.
"""

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""
