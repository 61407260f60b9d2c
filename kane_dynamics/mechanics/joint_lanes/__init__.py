"""Quantities of trees, computed for the joints in lanes."""
