"""From a joint state to a torque: the path that runs at every cycle."""
