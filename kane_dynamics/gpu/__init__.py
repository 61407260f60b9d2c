"""
Dynamics of batches of states in the memory of an NVIDIA GPU.

`function` is a quantity of a robot, `rollout` its motion over many steps, as functions
of arrays of CuPy, PyTorch, JAX and others. The kernels are made here; only the driver of
the GPU is needed.
"""

from kane_dynamics.gpu.device_function import DeviceFunction, function
from kane_dynamics.gpu.device_rollout import DeviceRollout, rollout

__all__ = ['DeviceFunction', 'DeviceRollout', 'function', 'rollout']
