"""The dynamics node."""
