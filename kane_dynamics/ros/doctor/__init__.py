"""Checks of a configuration file and of a running ROS graph."""
