"""The ROS 2 node around the library: the only part of the package that imports rclpy."""
