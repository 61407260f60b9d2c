"""Forward simulation: time steps, torque inputs, limit events, trajectories."""
