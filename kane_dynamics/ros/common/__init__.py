"""Shared by the nodes: messages, files, processes, real-time settings."""
