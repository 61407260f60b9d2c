"""Motions that excite the parameters to be identified."""
