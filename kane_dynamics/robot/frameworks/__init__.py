"""A robot's quantities as functions of other libraries: CasADi, PyTorch, JAX."""
