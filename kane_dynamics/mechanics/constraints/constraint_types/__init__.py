"""The constraints: velocities of points, closed loops, rolling, couplings, prescribed motion."""
