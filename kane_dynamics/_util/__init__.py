"""Tools for all packages: checks, YAML, resources, progress, optional imports."""
