"""Recordings of a moving arm: read from tables and bags."""
