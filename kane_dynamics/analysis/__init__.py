"""Checks and analyses of a robot: power balance, natural vibration, model checks."""
