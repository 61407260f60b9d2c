"""The joints of filled trajectories: of trees, and the driving ones of closed loops."""
