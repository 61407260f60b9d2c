"""Expressions and programs: trace a Python function to straight-line code."""
