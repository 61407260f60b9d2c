"""Skip the tests of the ROS side if rclpy is not installed."""

from importlib.util import find_spec

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_ros_*.py']
