"""Kernels of a robot that a function compiles once and finds again without a search."""

from collections.abc import Callable
from functools import wraps
from weakref import ref, WeakKeyDictionary

from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.robot.robot import Robot


def kept_kernel(function: Callable[[Robot], Kernel]) -> Callable[[Robot], Kernel]:
    """
    Return a function that asks another one for a kernel once for each robot.

    `Robot.compiled` compiles once, too, but reads its function again at each call, which
    takes longer than many kernels. The robot's set of kernels keeps the kernel, which
    refers to the robot; so here both are held weakly.
    """
    known: WeakKeyDictionary[KernelSet, ref[Kernel]] = WeakKeyDictionary()

    @wraps(function)
    def kernel_of(robot: Robot) -> Kernel:
        reference = known.get(robot.kernels)
        kernel = None if reference is None else reference()
        if kernel is None:
            kernel = function(robot)
            known[robot.kernels] = ref(kernel)
        return kernel
    return kernel_of
