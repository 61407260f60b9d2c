"""Compiled recursive algorithms: RNEA, CRBA, reactions, derivatives, regressor."""
