"""Code that the nodes share: conversions, files, QoS, processes, real-time settings."""
