"""The constraints: points, closed loops, rolling, couplings, prescribed motion."""
