"""Run compiled kernels: single states, batches and threads."""
