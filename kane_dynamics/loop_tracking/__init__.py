"""Closed loops from measured or driving joints, from configuration to configuration."""
