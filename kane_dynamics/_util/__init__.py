"""Shared by all packages: checks, YAML, resources, progress, optional imports."""
