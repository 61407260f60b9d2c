"""Compilation of traced programs to native code."""
