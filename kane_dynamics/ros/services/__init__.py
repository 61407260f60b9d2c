"""The services and the action of the dynamics node."""
