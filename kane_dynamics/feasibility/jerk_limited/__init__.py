"""Fastest timing of a path with limits of jerk and of the rate of torque."""
