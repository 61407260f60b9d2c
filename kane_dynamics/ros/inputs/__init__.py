"""Messages that move the arm: trajectories and targets."""
