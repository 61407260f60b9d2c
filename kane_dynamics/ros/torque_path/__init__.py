"""The torque path: computes and publishes one command for each joint state."""
