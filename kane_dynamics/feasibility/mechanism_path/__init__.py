"""Fastest timing of a path of the driving joints of a mechanism."""
