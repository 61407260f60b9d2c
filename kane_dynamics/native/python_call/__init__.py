"""Machine code that CPython calls directly."""
