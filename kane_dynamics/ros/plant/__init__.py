"""A simulated robot behind ROS topics, to test controllers without hardware."""
