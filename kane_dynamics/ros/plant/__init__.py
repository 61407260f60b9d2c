"""A simulated robot behind ROS topics, for controllers and people to try without hardware."""
