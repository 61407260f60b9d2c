"""Tests of the ROS side are left out where there is no ROS."""

from importlib.util import find_spec

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_ros_*.py']
