"""Kernels, batches and threads."""
