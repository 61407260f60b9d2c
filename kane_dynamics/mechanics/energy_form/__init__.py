"""Equations of motion by variations of finite poses: the second derivation."""
