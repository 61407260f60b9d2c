"""Native entry points: kernels that CPython calls as built-in functions."""
