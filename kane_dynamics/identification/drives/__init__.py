"""Stiffness, damping and rotor inertia of elastic joints from recordings."""
