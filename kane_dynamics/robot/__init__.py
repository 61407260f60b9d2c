"""A robot: one model with its compiled kernels."""
