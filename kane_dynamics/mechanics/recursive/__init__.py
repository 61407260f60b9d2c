"""Recursive algorithms that are compiled: RNEA, CRBA, reactions, derivatives, regressor."""
