"""Equations of motion from energies: an independent formulation for tests."""
