"""Monitors: estimates that the node publishes beside the torques."""
