"""Calibration of gravity and torque scales by configurations in which the arm is held."""
