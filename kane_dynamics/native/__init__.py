"""Compile traced programs to native code."""
