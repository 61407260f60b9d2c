"""
The kernels of the energy balance: energies and dissipation, and the power of moving constraints.

A constraint or a speed that prescribes a motion does work: with q' = T u + X, the joint forces f
have the power f . q' = tau . u + f . X.
"""

from typing import Any
from weakref import WeakKeyDictionary

from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np

TERMS = 3  # results of the energy kernel: kinetic, potential, power of friction
_DRIVEN: WeakKeyDictionary[Mechanism, bool] = WeakKeyDictionary()


def compile_balance(robot: Robot) -> None:
    """Compile the kernels of `EnergyBalance`."""
    for kernel in (energy_kernel(robot), driven_kernel(robot)):
        if kernel is not None:
            kernel.compile_lanes()


def energy_kernel(robot: Robot) -> Kernel:
    """Return the kernel of kinetic energy, potential energy and power of friction, (3,)."""
    equations, n_q, n = robot.equations, robot.n_q, robot.n
    constrained = equations if isinstance(equations, ConstrainedEquations) else None
    tree = equations.tree if isinstance(equations, ConstrainedEquations) else equations

    def terms(state: Any, parameters: Any) -> Any:
        q, u, time = np.split(state, [n_q, n_q + n])
        rates = u if constrained is None else constrained.joint_speeds(q, u, *time)
        return [tree.kinetic_energy(q, rates, parameters),
                tree.potential_energy(q, parameters), tree.friction_force(rates) @ rates]
    return _kernel(robot, 'energy_terms', terms, (TERMS,))


def driven_kernel(robot: Robot) -> Kernel | None:
    """Return the kernel of the power of moving constraints, W; None without any."""
    equations, n_q, n = robot.equations, robot.n_q, robot.n
    if not isinstance(equations, ConstrainedEquations) or not _driven(robot):
        return None

    def power(state: Any, tau: Any, parameters: Any) -> Any:
        q, u, time = np.split(state, [n_q, n_q + n])
        force = equations.actual_joint_forces(q, u, tau, parameters, *time)
        return force @ equations.joint_speeds(q, u, *time) - tau @ u
    return _kernel(robot, 'driven_power', power, (), ('tau', (n,)))


def _driven(robot: Robot) -> bool:
    """Return whether speeds or constraints prescribe joint rates (q' nonzero at u = 0)."""
    mechanism = robot.mechanism
    if mechanism in _DRIVEN:
        return _DRIVEN[mechanism]
    found: list[bool] = []

    def given(state: Any) -> Any:
        q, _, time = np.split(state, [robot.n_q, robot.n_q + robot.n])
        right = mechanism.system(mechanism.state(q, *time))[1]
        found.extend(not is_zero(x) for x in right)
        return right
    trace_program('given_rates', given, [('state', (_size(robot),))])
    _DRIVEN[mechanism] = any(found)
    return _DRIVEN[mechanism]


def _size(robot: Robot) -> int:
    return robot.n_q + robot.n + robot.equations.timed


def _kernel(robot: Robot, name: str, function: Any, shape: tuple[int, ...],
            *more: tuple[str, tuple[int, ...]]) -> Kernel:
    inputs = [('state', (_size(robot),)), *more]

    def traced() -> Program:
        physical = robot.parameters.physical
        return trace_program(name, lambda *x: function(*x[:-1], x[-1][:physical]),
                             [*inputs, ('parameters', robot.parameters.block.shape)])
    return robot.kernels.extra(name, traced, [Argument(*x) for x in inputs],
                               robot.parameters.block, shape)
