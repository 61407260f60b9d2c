"""The payload from a recording, and online."""
