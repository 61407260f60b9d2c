"""Quantities of large trees, computed for the joints in lanes."""
