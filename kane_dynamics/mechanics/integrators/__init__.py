"""Numerical integrators of the equations of motion."""
