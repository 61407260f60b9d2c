"""What the node estimates and publishes beside the torques."""
