"""Roller coaster: an IMU matched against the design ride, the match fused by a Kalman filter."""
