"""Desired motions: positions, velocities and accelerations as functions of time."""
